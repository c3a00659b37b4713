//! Cost model of all stages: a table of constants, and the sums that use it.
//!
//! Measured on one core of a cloud machine, in CPU time, by `study --threads 1 stages SCENE`
//! (benches/study). The documentation of [`crate::engine`] reports its accuracy.

use crate::curve::Basis;
use crate::kernels::KernelWork;

/// Time on one thread, in nanoseconds.
pub(crate) type Nanoseconds = f64;

/// A nanosecond in milliseconds.
pub(crate) const MS: f64 = 1e-6;

/// Boxes of a segment of a polyline, with its share of the tree above.
const POLYLINE_BOX: Nanoseconds = 1.4;
/// Boxes of a segment of a spline, with its share of the tree above.
const SPLINE_BOX: Nanoseconds = 2.8;
/// Tree of a curve of any length.
const TREE: Nanoseconds = 60.0;
/// A curve in the search for potential links: sorting, columns.
const SORTED: Nanoseconds = 40.0;
/// Comparison of a box with a group of eight boxes.
const SWEEP_STEP: Nanoseconds = 2.0;
/// A potential link that is found and sorted.
const FOUND: Nanoseconds = 36.0;
/// Time for a potential link before its segments are visited.
const LINK: Nanoseconds = 105.0;
/// A node pair visited to choose the direction.
const FRONT: Nanoseconds = 20.0;
/// A node pair visited on the way to the segments, if its boxes are stored.
const NODE: Nanoseconds = 22.0;
/// The same, if its boxes are computed.
const COMPUTED_NODE: Nanoseconds = 30.0;
/// Additional memory latency of a node pair of either kind, if the curves and their boxes
/// exceed the cache.
const FAR_NODE: Nanoseconds = 30.0;
/// Test of a segment pair for a crossing.
const TEST: Nanoseconds = 10.0;
/// Additional time of a test that is decided exactly.
const EXACT: Nanoseconds = 60.0;
/// Comparison of two hulls.
const HULLS: Nanoseconds = 50.0;
/// A point added by the discretization, and the repeated tests of its segments.
const REFINED: Nanoseconds = 140.0;
/// A segment in the fast multipole method, if few pairs of segments are close.
const MULTIPOLE: Nanoseconds = 1300.0;
/// Check of a segment for repeated vertices.
const REPEAT: Nanoseconds = 0.5;
/// A point of a periodic scene: its fractional coordinates, for the box of its curve.
const FRACTIONAL: Nanoseconds = 6.0;
/// A point of a translated curve.
const TRANSLATED: Nanoseconds = 4.0;

/// Size of the last-level cache.
const CACHE_BYTES: usize = 32 << 20;

/// Returns the time of the boxes of all segments.
pub(crate) fn boxes(basis: Basis, curves: usize, segments: usize) -> Nanoseconds {
    let segment = match basis.is_polyline() {
        true => POLYLINE_BOX,
        false => SPLINE_BOX,
    };
    curves as f64 * TREE + segments as f64 * segment
}

/// Returns the time of the search for potential links.
pub(crate) fn potential_links(curves: usize, steps: u64, links: usize) -> Nanoseconds {
    curves as f64 * SORTED + steps as f64 * SWEEP_STEP + links as f64 * FOUND
}

/// Returns the time to prepare the periodic images of a frame: the boxes of all curves in
/// fractional coordinates, and the translated curves.
pub(crate) fn images(points: usize, translated: usize) -> Nanoseconds {
    points as f64 * FRACTIONAL + translated as f64 * TRANSLATED
}

/// Returns the time of the choice of directions.
pub(crate) fn direction(links: usize, work: KernelWork) -> Nanoseconds {
    links as f64 * LINK + work.front as f64 * FRONT
}

/// Returns the time to convert splines to polylines.
pub(crate) fn discretization(work: KernelWork) -> Nanoseconds {
    work.overlaps as f64 * HULLS + work.refined as f64 * REFINED
}

/// Returns the time of the fast multipole method for this number of segments, in any number of
/// links that are each predicted to gain by it.
pub(super) fn multipole(segments: usize) -> Nanoseconds {
    segments as f64 * MULTIPOLE
}

/// Returns the time of counting crossings and repeated vertices. `bytes` of curves and boxes are
/// read.
pub(crate) fn crossings(segments: usize, work: KernelWork, bytes: usize) -> Nanoseconds {
    let far = if bytes > CACHE_BYTES { FAR_NODE } else { 0.0 };
    work.nodes as f64 * NODE
        + work.computed as f64 * COMPUTED_NODE
        + (work.nodes + work.computed) as f64 * far
        + work.tests as f64 * TEST
        + work.exact as f64 * EXACT
        + segments as f64 * REPEAT
}
