//! Parts of curves within a window around a place.
//!
//! Coordinates are relative to the centre of the window, in units of its reach. Curves are clipped
//! to a ball, and of those of the finding and of all others only the parts closest to the place are
//! kept if there are too many, so that curves of any length give a small picture.

use crate::curve::vector::{dot, hypot, mix, sub};
use crate::curve::{CurveSet, Point, feature, nearest, point_at};
use crate::verdict::Spot;

/// Radius of the ball for the curves of the finding, which is large enough for a ring that passes
/// the place, and for the others, which would hide them.
const OWN: f64 = 2.2;
const OTHERS: f64 = 1.15;

/// Maximum number of edges of each group, and their maximum length. A longer line would fill the
/// picture.
const OWN_MOST: (usize, f64) = (1500, 60.0);
const OTHER_MOST: (usize, f64) = (1200, 40.0);

/// Length of a strand up to which it is shown whole, like a ring that fills the window, and length
/// of the part around the place of a longer one. The rest of the curve is context.
const WHOLE: f64 = 16.0;
const FOCUS: f64 = 4.0;

/// Number of edges of a spline segment, and size of segments that have one edge only.
const SAMPLES: usize = 8;
const DOT: f64 = 0.01;

/// A window around a place.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Window {
    pub centre: Point,
    /// Half of its width.
    pub reach: f64,
    /// Largest distance of the two strands at the place, over the frames, in units of the reach.
    pub apart: f64,
}

/// Radii of the strands of a frame, as far as the recording has them.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Radii<'a> {
    /// Radii that the simulator published: one per curve, or none.
    pub published: &'a [f32],
    /// The one of all strands for which clearance was measured.
    pub measured: Option<f64>,
}

impl Radii<'_> {
    /// Returns the radius of a curve; 0 if it is unknown.
    pub fn of(&self, curve: u32) -> f64 {
        let published = self.published.get(curve as usize).map(|r| f64::from(*r));
        let radius = self.measured.or(published);
        radius.filter(|r| r.is_finite()).unwrap_or(0.0).max(0.0)
    }
}

/// A frame, and the place of the finding in it.
pub(crate) type Placed<'a> = (&'a CurveSet, Spot);

impl Window {
    /// Returns the windows of the frames before, at and after a finding. They have one reach, in
    /// which the passage of both strands and the shape of the curves are visible: enough for some
    /// segments, for the motion, and for the surfaces of strands with this sum of radii, but not
    /// more than the feature of the curves that passes. Their centres move with the points of the
    /// two strands that are closest to the place.
    ///
    /// `None` for frames that are `None`; all are if the second one is.
    pub fn around(frames: [Option<Placed<'_>>; 3], radii: f64) -> [Option<Window>; 3] {
        let Some((set, spot)) = frames[1] else {
            return [None; 3];
        };
        let ends = || spot.curves.into_iter().zip(spot.segments);
        let sizes = ends().filter_map(|(i, s)| feature(set, i, s));
        let size = sizes.min_by(f64::total_cmp).unwrap_or(0.0);
        let mut segment = 0.0_f64;
        let mut at = [None; 2];
        for (k, (i, s)) in ends().enumerate() {
            at[k] = nearest(set, i, s, spot.point);
            if at[k].is_some() {
                let (i, s) = (i as usize, s as usize);
                segment = segment.max(hypot(sub(set.knot(i, s + 1), set.knot(i, s))));
            }
        }
        // The points that are closest to the place, and their middle.
        let points = |(set, spot): Placed<'_>| {
            let point = |k: usize| {
                let (i, s) = (spot.curves[k] as usize, spot.segments[k] as usize);
                at[k].map(|t| set.eval(i, s, t))
            };
            [point(0), point(1)]
        };
        let centre = |placed: Placed<'_>| match points(placed) {
            [Some(p), Some(q)] => mix(p, q, 0.5),
            [p, q] => p.or(q).unwrap_or(spot.point),
        };
        let mut motion = 0.0_f64;
        for placed in frames.into_iter().flatten() {
            let apart = points(placed).into_iter().flatten();
            let apart = apart.map(|p| hypot(sub(p, centre(placed))));
            motion = apart.fold(motion, f64::max);
        }
        let wanted = (5.0 * segment).max(1.5 * motion);
        let reach = wanted.min(1.4 * size).max(0.5 * size);
        let reach = reach.max((1.5 * motion).min(3.0 * size));
        let valid = Some(reach).filter(|reach| *reach > 0.0 && reach.is_finite());
        let reach = valid.unwrap_or(segment.max(f64::MIN_POSITIVE));
        let reach = reach.max((1.5 * radii).min(3.0 * size));
        let apart = 2.0 * motion / reach;
        frames.map(|frame| {
            let centre = centre(frame?);
            Some(Window {
                centre,
                reach,
                apart,
            })
        })
    }

    pub fn local(&self, p: Point) -> Point {
        sub(p, self.centre).map(|x| x / self.reach)
    }
}

/// Group of a strand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Part {
    First,
    Second,
    /// Other parts of the curves of the finding.
    Rest,
    /// Other curves.
    Other,
}

/// A connected part of a curve in a window.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Strand {
    pub curve: u32,
    pub part: Part,
    /// True if the end is joined to the start, which is then repeated.
    pub closed: bool,
    pub points: Vec<Point>,
}

impl Strand {
    /// Returns true if it is one of the two strands of the finding.
    pub fn is_own(&self) -> bool {
        matches!(self.part, Part::First | Part::Second)
    }

    #[cfg(test)]
    fn edges(&self) -> usize {
        self.points.len() - 1
    }
}

/// Returns all strands of a frame in a window, those of the finding last.
pub(super) fn strands(set: &CurveSet, spot: Spot, window: Window) -> Vec<Strand> {
    let mut others = Vec::new();
    for i in (0..set.len()).filter(|i| !spot.curves.contains(&(*i as u32))) {
        clip(set, i, window, OTHERS, |_| Part::Other, &mut others);
    }
    limit(&mut others, OTHER_MOST);
    others.append(&mut own(set, spot, window));
    others
}

/// Returns the strands of the curves of a finding.
pub(crate) fn own(set: &CurveSet, spot: Spot, window: Window) -> Vec<Strand> {
    let [a, b] = spot.curves;
    let mut own = Vec::new();
    for i in std::iter::once(a).chain((a != b).then_some(b)) {
        if (i as usize) < set.len() {
            let part = |s: u32| part_of(set, spot, i, s);
            clip(set, i as usize, window, OWN, part, &mut own);
        }
    }
    limit(&mut own, OWN_MOST);
    focus(own)
}

/// Returns strands, the closest one first, of which only the closest one of each curve keeps its
/// group, with a length of [`FOCUS`] if it is long. The others become [`Part::Rest`], and come
/// first.
fn focus(strands: Vec<Strand>) -> Vec<Strand> {
    let mut rest = Vec::new();
    let mut own: Vec<Strand> = Vec::new();
    for mut strand in strands {
        let mut context = |points: &[Point]| {
            if points.len() > 1 {
                rest.push(Strand {
                    curve: strand.curve,
                    part: Part::Rest,
                    closed: false,
                    points: points.to_vec(),
                });
            }
        };
        if own.iter().any(|known| known.part == strand.part) {
            context(&strand.points);
            continue;
        }
        if strand.closed {
            // The closest point is in the middle.
            let last = strand.points.len() - 1;
            strand.points.truncate(last);
            let at = closest(&strand).0;
            strand.points.rotate_left((at + last - last / 2) % last);
            strand.points.push(strand.points[0]);
        }
        let edges = strand.points.array_windows::<2>();
        let length: f64 = edges.map(|[a, b]| hypot(sub(*b, *a))).sum();
        let mut most = if length > WHOLE { FOCUS } else { WHOLE };
        let (from, to) = around_closest(&strand, &mut { usize::MAX }, &mut most);
        context(&strand.points[..=from]);
        context(&strand.points[to..]);
        trim(&mut strand, from, to);
        own.push(strand);
    }
    rest.append(&mut own);
    rest
}

/// Returns the group of segment `s` of curve `i`. If a curve meets itself, its groups are the parts
/// that are nearer to either segment, along the curve.
fn part_of(set: &CurveSet, spot: Spot, i: u32, s: u32) -> Part {
    let [a, b] = spot.curves;
    let second = if a == b {
        let curve = set.curve(i as usize);
        let along = |to: u32| {
            let apart = to.abs_diff(s);
            match curve.closed {
                true => apart.min(curve.segments.saturating_sub(apart)),
                false => apart,
            }
        };
        let [s, t] = spot.segments.map(along);
        t < s
    } else {
        i == b
    };
    if second { Part::Second } else { Part::First }
}

/// Appends the parts of curve `i` in a ball around the window, of this radius.
pub(super) fn clip(
    set: &CurveSet,
    i: usize,
    window: Window,
    radius: f64,
    part: impl Fn(u32) -> Part,
    out: &mut Vec<Strand>,
) {
    let curve = set.curve(i);
    let first = out.len();
    // True if the last strand ends where the next edge starts.
    let mut continues = false;
    for s in 0..curve.segments {
        let hull = set.segment(i, s as usize).map(|p| window.local(p));
        let apart = |x: usize| {
            let x = hull.map(|p| p[x]);
            x.iter().all(|x| *x > radius) || x.iter().all(|x| *x < -radius)
        };
        let finite = hull.as_flattened().iter().all(|x| x.is_finite());
        if !finite || (0..3).any(apart) {
            continues = false;
            continue;
        }
        let part = part(s);
        let size = [1, 2, 3].map(|k| hypot(sub(hull[k], hull[0])));
        let is_line = set.basis().is_polyline() || size.into_iter().all(|x| x < DOT);
        let steps = if is_line { 1 } else { SAMPLES };
        for k in 0..steps {
            let at = |k: usize| match steps {
                1 => hull[3 * k],
                _ => point_at(&hull, k as f64 / steps as f64),
            };
            let (a, b) = (at(k), at(k + 1));
            let Some([from, to]) = within(a, b, radius) else {
                continues = false;
                continue;
            };
            let p = if from > 0.0 { mix(a, b, from) } else { a };
            let q = if to < 1.0 { mix(a, b, to) } else { b };
            match out.last_mut() {
                Some(last) if continues && from == 0.0 && last.part == part => last.points.push(q),
                _ => out.push(Strand {
                    curve: i as u32,
                    part,
                    closed: false,
                    points: vec![p, q],
                }),
            }
            continues = to == 1.0;
        }
    }
    // If a closed curve is within the ball at its start, the last strand and the first one are one.
    if !(continues && curve.closed && out.len() > first) {
        return;
    }
    let end = out[out.len() - 1].points.last().copied();
    if end != out[first].points.first().copied() || out[first].part != out[out.len() - 1].part {
        return;
    }
    if out.len() == first + 1 {
        out[first].closed = true;
    } else if let Some(mut last) = out.pop() {
        last.points.extend_from_slice(&out[first].points[1..]);
        out[first] = last;
    }
}

/// Returns the parameters between which an edge lies in the ball, if it does.
fn within(a: Point, b: Point, radius: f64) -> Option<[f64; 2]> {
    let along = sub(b, a);
    let length_sq = dot(along, along);
    if length_sq == 0.0 {
        return (dot(a, a) <= radius * radius).then_some([0.0, 1.0]);
    }
    // From the point closest to the centre, because long edges would cancel.
    let closest = -dot(a, along) / length_sq;
    let p = mix(a, b, closest);
    // A NaN, if the line misses the ball, fails the comparison.
    let half = ((radius * radius - dot(p, p)) / length_sq).sqrt();
    let (from, to) = ((closest - half).max(0.0), (closest + half).min(1.0));
    (half >= 0.0 && from < to).then_some([from, to])
}

/// Keeps at most this number of edges, and this length: the strands that come closest to the
/// centre, and of the last one the part around its closest point.
fn limit(strands: &mut Vec<Strand>, (mut edges, mut length): (usize, f64)) {
    // Squares are not negative, so that their bits have their order.
    strands.sort_by_cached_key(|strand| closest(strand).1.to_bits());
    for strand in strands.iter_mut() {
        let (from, to) = around_closest(strand, &mut edges, &mut length);
        trim(strand, from, to);
    }
    strands.retain(|strand| strand.points.len() > 1);
}

/// Returns the point of a strand that is closest to the centre, and the square of its distance.
fn closest(strand: &Strand) -> (usize, f64) {
    let distances = strand.points.iter().map(|p| dot(*p, *p)).enumerate();
    let closest = distances.min_by(|a, b| a.1.total_cmp(&b.1));
    closest.unwrap_or((0, 0.0))
}

/// Returns the first and the last point of the part around the closest point that has at most this
/// number of edges and this length, of which it takes what it uses.
fn around_closest(strand: &Strand, edges: &mut usize, length: &mut f64) -> (usize, usize) {
    let (at, last) = (closest(strand).0, strand.points.len() - 1);
    let (mut from, mut to) = (at, at);
    while *edges > 0 && *length > 0.0 && (from > 0 || to < last) {
        let back = from > 0 && (to == last || at - from <= to - at);
        match back {
            true => from -= 1,
            false => to += 1,
        }
        let k = if back { from } else { to - 1 };
        *edges -= 1;
        *length -= hypot(sub(strand.points[k + 1], strand.points[k]));
    }
    (from, to)
}

/// Removes the points before and after a part.
fn trim(strand: &mut Strand, from: usize, to: usize) {
    strand.closed &= (from, to) == (0, strand.points.len() - 1);
    strand.points = strand.points[from..=to].to_vec();
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::vector::norm;
    use crate::curve::{Basis, Positions};
    use std::f64::consts::TAU;

    fn ring(points: usize, radius: f64, basis: Basis) -> CurveSet {
        let point = |k: usize| {
            let (sin, cos) = (TAU * k as f64 / points as f64).sin_cos();
            [radius * cos, radius * sin, 0.0]
        };
        let xyz: Vec<f64> = (0..points).flat_map(point).collect();
        CurveSet::from_counts(basis, &[-(points as i32)], Positions::F64(&xyz)).unwrap()
    }

    fn spot(segments: [u32; 2]) -> Spot {
        Spot {
            curves: [0, 0],
            image: Default::default(),
            segments,
            point: [0.0; 3],
        }
    }

    fn shown(set: &CurveSet, centre: Point, reach: f64) -> Vec<Strand> {
        let other = Spot {
            curves: [7, 8],
            image: Default::default(),
            ..spot([0, 0])
        };
        strands(
            set,
            other,
            Window {
                centre,
                reach,
                apart: 0.0,
            },
        )
    }

    #[test]
    fn a_closed_curve_inside_the_window_stays_closed() {
        for basis in [Basis::Polyline, Basis::CatmullRom, Basis::BSpline] {
            let found = shown(&ring(12, 1.0, basis), [0.0; 3], 2.0);
            assert_eq!(found.len(), 1, "{basis:?}");
            assert!(found[0].closed);
            let steps = if basis.is_polyline() { 1 } else { SAMPLES };
            assert_eq!(found[0].edges(), 12 * steps);
            assert_eq!(found[0].points.first(), found[0].points.last());
        }
    }

    #[test]
    fn a_curve_that_leaves_the_window_is_clipped_and_passes_its_start() {
        // The window is around the start of the curve.
        let found = shown(&ring(1000, 1.0, Basis::Polyline), [1.0, 0.0, 0.0], 0.1);
        assert_eq!(found.len(), 1);
        assert!(!found[0].closed);
        let ends = [found[0].points[0], *found[0].points.last().unwrap()];
        for end in ends {
            assert!((norm(end) - OTHERS).abs() < 1e-9, "{end:?}");
        }
    }

    #[test]
    fn a_huge_edge_through_the_window_is_clipped() {
        let xyz = [-1e200, 0.0, 0.0, 1e200, 0.0, 0.0, 0.0, 1e200, 0.0];
        let set = CurveSet::from_counts(Basis::Polyline, &[-3], Positions::F64(&xyz)).unwrap();
        for strand in shown(&set, [0.0; 3], 1.0) {
            assert!(strand.points.iter().all(|p| norm(*p) < 1.0 + OTHERS));
        }
        let xyz = [-1e9, 0.0, 0.0, 1e9, 0.0, 0.0, 0.0, 1e9, 0.0];
        let set = CurveSet::from_counts(Basis::Polyline, &[-3], Positions::F64(&xyz)).unwrap();
        assert_eq!(shown(&set, [0.0; 3], 1.0).len(), 1);
    }

    #[test]
    fn the_edges_closest_to_the_place_are_kept() {
        let found = shown(&ring(100_000, 1.0, Basis::Polyline), [0.9, 0.0, 0.0], 1.0);
        let edges: usize = found.iter().map(Strand::edges).sum();
        assert_eq!(edges, OTHER_MOST.0);
        assert!(found[0].points.iter().all(|p| norm(*p) < 0.2));
    }

    #[test]
    fn a_curve_that_meets_itself_has_two_parts() {
        let set = ring(12, 1.0, Basis::Polyline);
        let window = Window {
            centre: [0.0; 3],
            reach: 2.0,
            apart: 0.0,
        };
        let found = strands(&set, spot([1, 7]), window);
        let parts: Vec<Part> = found.iter().map(|s| s.part).collect();
        assert!(parts.contains(&Part::First) && parts.contains(&Part::Second));
        let edges: usize = found.iter().map(Strand::edges).sum();
        assert_eq!(edges, 12);
    }
}
