//! Cost model of all stages: a table of constants, and the sums that use it.
//!
//! Measured on one core of a cloud machine, in CPU time, by `study --threads 1 stages SCENE`
//! (benches/study). The documentation of [`crate::plan`] reports its accuracy.

use crate::curve::Basis;
use crate::kernels::KernelWork;

/// Nanoseconds of each kind of work.
struct Nanoseconds {
    /// Boxes of a segment of a polyline, with its share of the tree above.
    polyline_box: f64,
    /// Boxes of a segment of a spline, likewise.
    spline_box: f64,
    /// Tree of a curve of any length.
    tree: f64,
    /// A curve in the search for potential links: sorting, columns.
    sorted: f64,
    /// Comparison of a box with a group of eight boxes.
    sweep_step: f64,
    /// A potential link that is found and sorted.
    found: f64,
    /// Overhead of a potential link in the kernel.
    link: f64,
    /// A node pair visited to choose the direction.
    front: f64,
    /// A node pair visited on the way to the segments, if its boxes are stored.
    node: f64,
    /// The same, if its boxes are computed.
    computed_node: f64,
    /// Additional memory latency of a node pair of either kind, if the curves and their boxes
    /// exceed the cache.
    far_node: f64,
    /// Test of a segment pair for a crossing.
    test: f64,
    /// Additional time of a test that is decided exactly.
    exact: f64,
    /// Comparison of two hulls.
    hulls: f64,
    /// A point added by the discretization, and the repeated tests of its segments.
    refined: f64,
    /// A segment in the fast multipole method, if few pairs of segments are close.
    multipole: f64,
    /// Check of a segment for repeated vertices.
    repeat: f64,
    /// A point of a periodic scene: its fractional coordinates, for the box of its curve.
    fractional: f64,
    /// A point of a translated curve.
    translated: f64,
}

/// Size of the last-level cache.
const CACHE_BYTES: usize = 32 << 20;

const NS: Nanoseconds = Nanoseconds {
    polyline_box: 1.4,
    spline_box: 2.8,
    tree: 60.0,
    sorted: 40.0,
    sweep_step: 2.0,
    found: 36.0,
    link: 105.0,
    front: 20.0,
    node: 22.0,
    computed_node: 30.0,
    far_node: 30.0,
    test: 10.0,
    exact: 60.0,
    hulls: 50.0,
    refined: 140.0,
    multipole: 1300.0,
    repeat: 0.5,
    fractional: 6.0,
    translated: 4.0,
};

/// Time on one thread.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Time {
    ns: f64,
}

impl Time {
    /// Returns the time in milliseconds.
    pub fn ms(self) -> f64 {
        self.ns * 1e-6
    }

    /// Returns this time with a part of it replaced.
    pub fn instead_of(self, part: Time, other: Time) -> Time {
        Time {
            ns: (self.ns - part.ns).max(0.0) + other.ns,
        }
    }
}

impl std::ops::Add for Time {
    type Output = Time;

    fn add(self, other: Time) -> Time {
        Time {
            ns: self.ns + other.ns,
        }
    }
}

/// Returns the time of the boxes of all segments.
pub(crate) fn boxes(basis: Basis, curves: usize, segments: usize) -> Time {
    let segment = if basis.is_polyline() {
        NS.polyline_box
    } else {
        NS.spline_box
    };
    Time {
        ns: curves as f64 * NS.tree + segments as f64 * segment,
    }
}

/// Returns the time of the search for potential links.
pub(crate) fn potential_links(curves: usize, steps: u64, links: usize) -> Time {
    Time {
        ns: curves as f64 * NS.sorted + steps as f64 * NS.sweep_step + links as f64 * NS.found,
    }
}

/// Returns the time to prepare the periodic images of a frame: the boxes of all curves in
/// fractional coordinates, and the translated curves.
pub(crate) fn images(points: usize, translated: usize) -> Time {
    Time {
        ns: points as f64 * NS.fractional + translated as f64 * NS.translated,
    }
}

/// Returns the time of the choice of directions.
pub(crate) fn direction(links: usize, work: KernelWork) -> Time {
    Time {
        ns: links as f64 * NS.link + work.front as f64 * NS.front,
    }
}

/// Returns the time to convert splines to polylines.
pub(crate) fn discretization(work: KernelWork) -> Time {
    Time {
        ns: work.overlaps as f64 * NS.hulls + work.refined as f64 * NS.refined,
    }
}

/// Returns the time of the fast multipole method for this number of segments, in any number of
/// links that are each predicted to gain by it.
pub(super) fn multipole(segments: usize) -> Time {
    Time {
        ns: segments as f64 * NS.multipole,
    }
}

/// Returns the time of counting crossings and repeated vertices. `bytes` of curves and boxes are
/// read.
pub(crate) fn crossings(segments: usize, work: KernelWork, bytes: usize) -> Time {
    let far = if bytes > CACHE_BYTES {
        NS.far_node
    } else {
        0.0
    };
    Time {
        ns: work.nodes as f64 * NS.node
            + work.computed as f64 * NS.computed_node
            + (work.nodes + work.computed) as f64 * far
            + work.tests as f64 * NS.test
            + work.exact as f64 * NS.exact
            + segments as f64 * NS.repeat,
    }
}
