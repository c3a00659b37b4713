//! Linking numbers by counting crossings, exactly, on the input floats.
//!
//! Source: Qu & James 2021, section 3.4.1 (count crossings), with these changes: projection along a coordinate
//! axis instead of a rotated frame, so that exact predicates apply to the input itself and degenerate views
//! are decided by a proven rule ([`crate::exact`]) instead of a retry; only crossings where the first loop is
//! on top are counted, so no factor 1/2 and everything wholly below is culled in space; the best of six
//! directions for every pair ([`direction`]); trees over both loops ([`traverse`]).
//!
//! Cost: near-linear in segments and crossings for curves that are spatially coherent. Beaten by summation
//! where crossings in every direction are far more than segments.
//! Requires: closed curves, finite coordinates (both are invariants of [`CurveSet`] and of the pair list).
//! Undefined: curves that touch, that are too close to discretize, or that have fewer than three distinct
//! vertices.

mod direction;
mod evaluate;
#[cfg(test)]
mod spline_tests;
#[cfg(test)]
mod tests;
mod traverse;

use self::traverse::Candidates;
use super::Linking;
#[cfg(target_arch = "x86_64")]
use crate::curve::Avx2;
use crate::curve::{CurveSet, Lanes, Portable};
use crate::discretize::{Splits, refine_pair};
use crate::pairs::{Node, Pair, Trees, closest_of_segments};
use crate::verdict::{DefectKind, Stats};

/// Candidates of one pair of splines at which it counts as too close: a tangle in which everything overlaps
/// everything would fill the memory.
const MAX_CANDIDATES: usize = 1 << 25;

/// A direction of projection: an axis, and which of the two curves is counted when on top.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Direction {
    /// Axis of projection; up is its positive end.
    pub axis: usize,
    /// Whether the second curve of the pair is the one on top.
    pub second_over: bool,
}

impl Direction {
    /// All six, in the order of their bits in masks.
    pub const ALL: [Direction; 6] = [
        Direction::new(0, false),
        Direction::new(0, true),
        Direction::new(1, false),
        Direction::new(1, true),
        Direction::new(2, false),
        Direction::new(2, true),
    ];

    const fn new(axis: usize, second_over: bool) -> Self {
        Direction { axis, second_over }
    }
}

/// What a pair is computed from: curves and their trees, of one frame.
#[derive(Clone, Copy)]
pub(crate) struct Scene<'a> {
    pub set: &'a CurveSet,
    pub trees: &'a Trees,
}

/// Buffers of one thread. Reused from pair to pair and frame to frame.
#[derive(Debug, Default)]
pub(crate) struct Scratch {
    /// Node pairs of the coarse pass: first curve, second curve, directions in which they overlap.
    front: Vec<(Node, Node, u8)>,
    next: Vec<(Node, Node, u8)>,
    /// Node pairs to visit: upper curve, lower curve.
    stack: Vec<(Node, Node)>,
    candidates: Candidates,
    splits: [Splits; 2],
    /// Work done since the caller last took it.
    pub stats: Stats,
}

/// Linking number of the curves `i` and `j`; `fixed` leaves no choice of the direction.
pub(crate) fn linking_number(
    scene: Scene<'_>,
    pair: Pair,
    fixed: Option<Direction>,
    scratch: &mut Scratch,
) -> Linking {
    #[cfg(target_arch = "x86_64")]
    if let Some(avx2) = Avx2::detect() {
        #[expect(unsafe_code, reason = "vector instructions")]
        // SAFETY: the token says that the processor has them.
        return unsafe { with_avx2(avx2, scene, pair, fixed, scratch) };
    }
    compute(Portable, scene, pair, fixed, scratch)
}

/// [`compute`], compiled with AVX2.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn with_avx2(
    avx2: Avx2,
    scene: Scene<'_>,
    pair: Pair,
    fixed: Option<Direction>,
    scratch: &mut Scratch,
) -> Linking {
    compute(avx2, scene, pair, fixed, scratch)
}

#[inline(always)]
fn compute<L: Lanes>(
    simd: L,
    scene: Scene<'_>,
    (i, j): Pair,
    fixed: Option<Direction>,
    scratch: &mut Scratch,
) -> Linking {
    scratch.stats.potential_links += 1;
    let [i, j] = [i as usize, j as usize];
    let Some(direction) = direction::choose(simd, scene, i, j, fixed, scratch) else {
        scratch.stats.separated += 1;
        return Linking::Number(0);
    };
    // From here on the first curve of everything is the one on top.
    let curves = if direction.second_over {
        [j, i]
    } else {
        [i, j]
    };
    let mut count = evaluate::Count::new(scene.set, curves, direction.axis);
    let polyline = scene.set.basis().is_polyline();
    let Scratch {
        stack,
        candidates,
        splits,
        ..
    } = scratch;
    candidates.clear();
    let mut entangled = None;
    traverse::traverse(
        simd,
        scene,
        curves,
        direction.axis,
        stack,
        candidates,
        |c| {
            // Polylines are evaluated as they come, so the list of candidates stays short however many there
            // are. Splines wait for their final polylines.
            if polyline {
                count.touches(&c.overlaps);
                count.add(&c.tests);
                c.clear();
            } else if c.tests.len() > MAX_CANDIDATES {
                entangled = c.tests.first().map(|&(s, t)| [s, t]);
                c.clear();
            }
        },
    );
    let mut too_close = entangled;
    if !polyline && too_close.is_none() {
        splits.iter_mut().for_each(Splits::clear);
        count.stats.overlaps += candidates.overlaps.len() as u64;
        match refine_pair(scene.set, curves, &candidates.overlaps, splits) {
            Ok(()) => {
                count.stats.refined += (splits[0].len() + splits[1].len()) as u64;
                count.add_split(&candidates.tests, splits);
            }
            Err(segments) => too_close = Some(segments),
        }
    }
    scratch.stats.add(&count.stats());
    let undefined = |kind, mut segments: [u32; 2]| {
        if direction.second_over {
            segments.swap(0, 1);
        }
        Linking::Undefined(kind, closest_of_segments(scene.set, [i, j], segments))
    };
    match (too_close, count.contact()) {
        (Some(segments), _) => undefined(DefectKind::TooClose, segments),
        (None, Some(segments)) => undefined(DefectKind::Contact, segments),
        (None, None) => Linking::Number(count.sum()),
    }
}

impl Scratch {
    /// Takes the counts of the work done so far.
    pub fn take_stats(&mut self) -> Stats {
        std::mem::take(&mut self.stats)
    }
}
