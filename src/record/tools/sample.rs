//! Points on curves for drawing, in a bounded number.

use super::State;
use crate::curve::{CurveSet, Point};

/// Least number of points of a thinned curve: fewer would not show a loop.
const LEAST: usize = 4;

/// Limits of the number of points that stand for some of the curves.
#[derive(Clone, Copy)]
pub(super) struct Limits {
    /// Number of segments above which curves are thinned to about as many points, at most twice as
    /// many: each curve that is drawn has at least [`LEAST`].
    pub most: usize,
    /// Number up to which segments are divided.
    pub wanted: usize,
    /// Maximum number of points per segment of a spline, and per edge of a polyline.
    pub per_segment: usize,
    pub per_edge: usize,
}

/// Selection of points on the curves of one state.
pub(super) struct Sample<'a> {
    set: &'a CurveSet,
    limits: Limits,
    /// Number of segments of all these curves.
    segments: usize,
    /// One curve out of this many is drawn.
    every: usize,
}

impl<'a> Sample<'a> {
    /// Chooses the points of the curves that have one of these states.
    pub fn new(
        set: &'a CurveSet,
        states: &[State],
        is_member: impl Fn(State) -> bool,
        limits: Limits,
    ) -> Self {
        let members = set.curves().iter().zip(states);
        let members = members.filter(|(_, state)| is_member(**state));
        let (mut curves, mut segments) = (0, 0);
        for (curve, _) in members {
            curves += 1;
            segments += curve.segments as usize;
        }
        let is_thinned = segments > limits.most;
        Sample {
            set,
            limits,
            segments,
            every: if is_thinned {
                (LEAST * curves).div_ceil(limits.most).max(1)
            } else {
                1
            },
        }
    }

    /// Returns points of curve `i` in its order, or nothing if it is not drawn. The start of a
    /// closed curve is not repeated. Points of a polyline that is thinned are vertices.
    pub fn points(&self, i: usize) -> impl Iterator<Item = Point> + use<'a> {
        let (set, limits, segments) = (self.set, self.limits, self.segments);
        let curve = set.curve(i);
        let n = curve.segments as usize;
        // Parts into which the curve is divided, each a part of a segment or several segments.
        let most = match set.basis().is_polyline() {
            true => limits.per_edge,
            false => limits.per_segment,
        };
        let detail = (limits.wanted / segments.max(1)).clamp(1, most);
        let parts = match segments > limits.most {
            false => n * detail,
            true => share(limits.most, n, segments),
        };
        let parts = match i.is_multiple_of(self.every) {
            true => parts.max(LEAST.min(n)),
            false => 0,
        };
        let ends = usize::from(!curve.closed && parts > 0);
        (0..parts + ends).map(move |k| {
            if parts == n {
                set.knot(i, k)
            } else if parts < n {
                set.knot(i, share(k, n, parts))
            } else {
                match (k / detail, k % detail) {
                    (s, 0) => set.knot(i, s),
                    (s, part) => set.eval(i, s, part as f64 / detail as f64),
                }
            }
        })
    }
}

/// Returns `a * b / c`, rounded down. `a` and `b` are numbers of segments or points, which have 32
/// bits.
fn share(a: usize, b: usize, c: usize) -> usize {
    (a as u64 * b as u64 / c as u64) as usize
}
