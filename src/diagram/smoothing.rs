//! Passages of a curve through itself: the change of `v2` that each one causes.
//!
//! # Derivation
//!
//! At the moment of the passage two segments share a point. In the projection they are a crossing,
//! which changes its sign from `-s` to `s`, where `s` is the sign of the passage. Smoothing it cuts
//! the curve into two, whose linking number `L` does not depend on which segment is above. By the
//! crossing change formula, `v2` changes by `s L` (see the module on Vassiliev invariants).

use super::project::Edges;
use super::{Diagram, vassiliev};
use crate::curve::vector::mix;
use crate::curve::{Basis, CurveSet, Point, Positions};
use crate::verdict::PullThrough;

/// Times before a passage at which the curve is projected, relative to its time, until it does not
/// touch itself: rounded positions may do so at the time itself.
const EARLIER: [f64; 3] = [0.0, 1e-9, 1e-6];

/// Difference of the times of passages, as fractions of the step, that count as simultaneous.
const SIMULTANEOUS: f64 = 1e-5;

/// Returns the change of `v2` of a closed polyline from one frame to another, and the sum of the
/// changes that its passages through itself, in their order, cause. `None` if one of them is
/// unknown, because the curve touches itself in a frame, for example.
pub(crate) fn change_of_v2(
    frames: [&CurveSet; 2],
    curve: u32,
    passages: &[&PullThrough],
) -> Option<[i64; 2]> {
    let v2 = |set: &CurveSet| {
        let diagram = Diagram::of(set, &[curve]).ok()?.reduced();
        Some(diagram.v2())
    };
    let [before, after] = [v2(frames[0])?, v2(frames[1])?];
    let linking = passages.iter().enumerate().map(|(k, passage)| {
        // Passages at the same time count as ordered: those before this one have taken place.
        let others = passages.iter().enumerate().filter(|(l, other)| {
            *l != k && (other.fraction - passage.fraction).abs() < SIMULTANEOUS
        });
        let others = others.map(|(l, e)| (e.segments, if l < k { e.sign } else { -e.sign }));
        let others: Vec<([u32; 2], i32)> = others.collect();
        let mut tries = EARLIER.iter();
        let found = tries.find_map(|earlier| {
            let set = between(frames, curve, passage.fraction * (1.0 - earlier))?;
            linking_of_parts(&set, passage.segments, &others)
        })?;
        Some(i64::from(passage.sign) * found)
    });
    let expected = linking.sum::<Option<i64>>()?;
    Some([after - before, expected])
}

/// Returns a curve at a time of the step.
fn between(frames: [&CurveSet; 2], curve: u32, time: f64) -> Option<CurveSet> {
    let [before, after] = frames.map(|set| set.points_in(curve as usize));
    let points = before.zip(after).map(|(a, b)| mix(a, b, time));
    let points: Vec<Point> = points.collect();
    let counts = [-(points.len() as i32)];
    let positions = Positions::F64(points.as_flattened());
    CurveSet::from_counts(Basis::Polyline, &counts, positions).ok()
}

/// Returns the linking number of the two parts of a curve that result from smoothing it at a
/// crossing of these segments. If these segments do not cross, the passage is at a vertex, and the
/// crossing of neighbours with the smallest height is used. Crossings of other segments get the
/// given signs. `None` if the curve touches itself.
fn linking_of_parts(set: &CurveSet, segments: [u32; 2], others: &[([u32; 2], i32)]) -> Option<i64> {
    let curve = set.curve(0);
    let near = |of: u32, s: u32| [curve.before(of), of, curve.after(of)].contains(&s);
    let mut edges = Edges::new(set, &[0]).ok()?;
    let ((components, mut signs), found) = edges.with_heights()?;
    let crossing_of = |[a, b]: [u32; 2]| {
        let crossings = found.iter().enumerate();
        let near = crossings
            .filter(|(_, (_, [s, t]))| near(a, *s) && near(b, *t) || near(a, *t) && near(b, *s));
        let other = |[s, t]: [u32; 2]| [s, t] != [a, b] && [t, s] != [a, b];
        let nearest = near.min_by(|(_, p), (_, q)| {
            (other(p.1).cmp(&other(q.1))).then_with(|| p.0.total_cmp(&q.0))
        });
        nearest.map(|(crossing, _)| crossing)
    };
    let crossing = crossing_of(segments)?;
    for &(segments, sign) in others {
        signs[crossing_of(segments)?] = sign as i8;
    }
    let passages = &components[0];
    let ends = passages.iter().enumerate();
    let mut ends = ends.filter(|(_, passage)| **passage as usize / 2 == crossing);
    let (start, end) = (ends.next()?.0, ends.next()?.0);
    let part = &passages[start + 1..end];
    Some(vassiliev::linking_number(part, &signs))
}
