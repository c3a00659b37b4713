//! Linking numbers that no noise below a given amplitude can change.
//!
//! # Proof
//!
//! Let every vertex move by at most `R` along each axis, on a straight line from its given position
//! to its true one. On the way every point of a segment stays within `R` of its initial position
//! along each axis, and so within the segment dilated by `R` in the maximum norm. If no dilated
//! segment of one curve meets one of the other, the curves do not meet on the way. So the linking
//! number is that of the given curves, which is counted exactly ([`crate::kernels::crossings`]).
//! Dilated segments are disjoint exactly if the segments are more than `2 R` apart in the maximum
//! norm.
//!
//! The converse holds as well: if two dilated segments meet, some noise makes the curves touch.
//!
//! Cost: that of counting crossings, and of the segment pairs whose boxes are within `2 R`.

use crate::curve::vector::{cross, sub};
use crate::curve::{CurveSet, Point};
use crate::kernels::Linking;
use crate::kernels::crossings::{self, Input, Workspace};
use crate::pairs::{Pair, Query, SegmentPairs, closest_approach, closest_of_segments, descend};
use crate::simd::{Lanes, dispatch};
use crate::verdict::DefectKind;

/// Returns the linking number of two closed polylines if it is the same for all positions of the
/// vertices in cubes of half-width `noise`. Returns [`DefectKind::TooClose`] with two segments that
/// may meet otherwise.
pub(crate) fn linking_number(
    input: Input<'_>,
    pair: Pair,
    noise: f64,
    workspace: &mut Workspace,
) -> Linking {
    let exact = crossings::linking_number(input, pair, None, workspace);
    if noise == 0.0 || matches!(exact, Linking::Undefined(..)) {
        return exact;
    }
    let curves = [pair.0 as usize, pair.1 as usize];
    let meeting = may_meet(input, curves, noise);
    if let Meeting::Never = meeting {
        return exact;
    }
    let nearest = closest_approach(input.set, input.trees, curves[0], curves[1]);
    // If the nearest segments may meet as well, they are more informative than the first ones
    // found.
    let place = match meeting {
        Meeting::Maybe(segments) if apart(input.set, curves, nearest.segments, 2.0 * noise) => {
            closest_of_segments(input.set, curves, segments)
        }
        _ => nearest,
    };
    Linking::Undefined(DefectKind::TooClose, place)
}

/// Result of the search for segments that may meet if every vertex moves by up to the noise.
enum Meeting {
    Never,
    /// These segments meet, or nearly meet.
    Maybe([u32; 2]),
    /// Not decided: the curves are splines, the noise is negative, NaN or larger than the largest
    /// coordinate, or coordinates exceed single precision.
    Unknown,
}

/// Searches for segments of two curves that meet when they are dilated.
fn may_meet(input: Input<'_>, curves: [usize; 2], noise: f64) -> Meeting {
    const LARGEST: f64 = 1e38;
    let set = input.set;
    let size = set.max_abs();
    if !set.basis().is_polyline() || !(0.0..=size).contains(&noise) || size > LARGEST {
        return Meeting::Unknown;
    }
    let gap = 2.0 * noise;
    // Boxes are dilated in single precision, with a relative rounding error of 2^-24.
    let reach = (1.001 * (gap + 1e-6 * size)) as f32;
    dispatch!(simd => search(simd, input, curves, gap, reach))
}

/// Searches for segments that are not further apart than `gap`, in the maximum norm, among those
/// whose boxes are within `reach`. That is larger than `gap`, to cover rounding.
#[inline(always)]
fn search<L: Lanes>(
    simd: L,
    input: Input<'_>,
    curves: [usize; 2],
    gap: f64,
    reach: f32,
) -> Meeting {
    /// Number of segment pairs that are collected before they are tested.
    const BATCH: usize = 1 << 10;
    let trees = curves.map(|i| input.trees.of(input.set, i));
    let query = Query::in_space(reach);
    let mut agenda = vec![(trees[0].root(), trees[1].root())];
    let mut found = SegmentPairs::default();
    while !agenda.is_empty() {
        found.all.clear();
        let limits = (usize::MAX, BATCH);
        descend::<L, _, true>(simd, trees, query, &mut agenda, &mut found, limits);
        let near = |&&(s, t): &&(u32, u32)| !apart(input.set, curves, [s, t], gap);
        if let Some(&(s, t)) = found.all.iter().find(near) {
            return Meeting::Maybe([s, t]);
        }
    }
    Meeting::Never
}

/// Returns true if two segments are proven to be further apart than `gap` in the maximum norm.
fn apart(set: &CurveSet, [i, j]: [usize; 2], [s, t]: [u32; 2], gap: f64) -> bool {
    let ends = |i: usize, s: usize| [set.knot(i, s), set.knot(i, s + 1)];
    segments_apart(ends(i, s as usize), ends(j, t as usize), gap)
}

/// Returns true if two segments are proven to be further apart than `gap` in the maximum norm.
///
/// # Proof
///
/// The differences of the points of two segments form a parallelogram. It is disjoint from the cube
/// of half-width `gap` around the origin exactly if one of ten directions separates both: those of
/// the faces of the cube, that of the parallelogram, and those orthogonal to an edge of either (the
/// facets of the sum of both bodies).
///
/// Any direction `n` is a proof if `n . w > gap |n|_1` for the four corners `w`. Along an axis
/// rounding does not matter: a difference that is rounded to more than `gap` is more than `gap`.
/// Otherwise `n . w` is off by `4 u` times the sum of the magnitudes of its terms, and the right
/// side has a relative error of `3 u`. The last term covers underflow.
fn segments_apart(p: [Point; 2], q: [Point; 2], gap: f64) -> bool {
    const SLACK: f64 = 8.0 * f64::EPSILON;
    let corners = [
        sub(q[0], p[0]),
        sub(q[0], p[1]),
        sub(q[1], p[1]),
        sub(q[1], p[0]),
    ];
    let on_one_side =
        |x: usize| corners.iter().all(|w| w[x] > gap) || corners.iter().all(|w| w[x] < -gap);
    if (0..3).any(on_one_side) {
        return true;
    }
    let (e, f) = (sub(p[1], p[0]), sub(q[1], q[0]));
    let separates = |n: Point| {
        let need = gap * (n[0].abs() + n[1].abs() + n[2].abs()) * (1.0 + SLACK);
        let heights = corners.map(|w| {
            let terms = [n[0] * w[0], n[1] * w[1], n[2] * w[2]];
            let size = terms[0].abs() + terms[1].abs() + terms[2].abs();
            let off = SLACK * size + 4.0 * f64::MIN_POSITIVE;
            (terms[0] + terms[1] + terms[2], off)
        });
        heights.iter().all(|&(height, off)| height - off > need)
            || heights.iter().all(|&(height, off)| height + off < -need)
    };
    let across = |e: Point| {
        separates([0.0, e[2], -e[1]])
            || separates([-e[2], 0.0, e[0]])
            || separates([e[1], -e[0], 0.0])
    };
    separates(cross(e, f)) || across(e) || across(f)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    /// Returns the minimum of a convex function on the interval from 0 to 1.
    fn least(f: impl Fn(f64) -> f64) -> f64 {
        let (mut lo, mut hi) = (0.0, 1.0);
        for _ in 0..60 {
            let (a, b) = ((2.0 * lo + hi) / 3.0, (lo + 2.0 * hi) / 3.0);
            match f(a) < f(b) {
                true => hi = b,
                false => lo = a,
            }
        }
        f(lo).min(f(hi))
    }

    #[test]
    fn segments_are_separated_up_to_their_distance_in_the_maximum_norm() {
        let mut random = Random::new(5);
        for _ in 0..300 {
            let points = [(); 4].map(|()| random.point(1.0));
            let (p, q) = ([points[0], points[1]], [points[2], points[3]]);
            // Nested ternary search: the function is convex.
            let far = |s: f64, t: f64| {
                let on = |v: [Point; 2], t: f64, x: usize| v[0][x] + t * (v[1][x] - v[0][x]);
                let each = (0..3).map(|x| (on(p, s, x) - on(q, t, x)).abs());
                each.fold(0.0, f64::max)
            };
            let best = least(|s| least(|t| far(s, t)));
            assert!(!segments_apart(p, q, best), "{p:?} {q:?} {best}");
            let less = best - 1e-9;
            assert!(
                less < 0.0 || segments_apart(p, q, less),
                "{p:?} {q:?} {best}"
            );
        }
    }
}
