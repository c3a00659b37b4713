//! Common refinement of two closed curves that differ in their numbers of points, so that the
//! motion from one to the other is defined.
//!
//! The points at the same share of both curves belong together: the share of the length of the
//! original curve, and of the segments of a resampled one, which are equally long. The ends of all
//! segments of both curves cut each of them into the same number of pieces. Splines are cut in
//! Bezier form, in which the straight motion of the control points is a straight motion of all
//! points of the curve. The pieces are the curve itself, apart from rounding errors in double
//! precision. The linking numbers of a step do not depend on them.

use super::resample::{Along, At, bezier, point};
use crate::input::usage;
use linkwatch::{Basis, CurveSet, Point, Positions, Result};

/// Difference of shares below which two ends of segments are one cut.
const SAME: f64 = 1e-12;

/// Meaning of a share of a curve.
#[derive(Clone, Copy, Debug)]
pub enum By {
    /// Share of the length.
    Length,
    /// Share of the segments.
    Segments,
}

/// A set of curves that are cut into pieces.
pub struct Refined {
    /// The pieces: polylines, or Bezier curves.
    pub set: CurveSet,
    /// For each curve, the segment of each piece.
    segments: Vec<Vec<u32>>,
}

impl Refined {
    /// Returns the segment to which a piece of curve `i` belongs.
    pub fn segment(&self, i: u32, piece: u32) -> u32 {
        let pieces = &self.segments[i as usize];
        pieces.get(piece as usize).copied().unwrap_or(piece)
    }
}

/// Returns two sets of the same curves, cut into the same pieces.
pub fn refine(a: (&CurveSet, By), b: (&CurveSet, By)) -> Result<[Refined; 2]> {
    let mut cuts = [Vec::with_capacity(a.0.len()), Vec::with_capacity(a.0.len())];
    for i in 0..a.0.len() {
        let [of_a, of_b] = cuts_of(&Shares::of(a, i)?, &Shares::of(b, i)?);
        cuts[0].push(of_a);
        cuts[1].push(of_b);
    }
    Ok([cut(a.0, &cuts[0])?, cut(b.0, &cuts[1])?])
}

/// A curve by its shares.
enum Shares<'a> {
    Length(Along<'a>),
    Segments(usize),
}

impl<'a> Shares<'a> {
    fn of((set, by): (&'a CurveSet, By), i: usize) -> Result<Shares<'a>> {
        let segments = Shares::Segments(set.curve(i).segments as usize);
        Ok(match by {
            By::Segments => segments,
            By::Length => match Along::of(set, i)? {
                // All points of the curve are one point.
                along if along.length() == 0.0 => segments,
                along => Shares::Length(along),
            },
        })
    }

    fn segments(&self) -> usize {
        match self {
            Shares::Length(along) => along.segments(),
            Shares::Segments(n) => *n,
        }
    }

    /// Returns the share at the start of segment `s`.
    fn start(&self, s: usize) -> f64 {
        match self {
            Shares::Length(along) => along.start(s) / along.length(),
            Shares::Segments(n) => s as f64 / *n as f64,
        }
    }

    /// Returns the parameter of a share within segment `s`.
    fn within(&self, s: usize, share: f64) -> f64 {
        match self {
            Shares::Segments(n) => share * *n as f64 - s as f64,
            Shares::Length(along) => match along.at(share * along.length()) {
                (found, t) if found == s => t,
                (found, _) if found < s => 0.0,
                _ => 1.0,
            },
        }
    }
}

/// Returns the cuts of two curves: the ends of the segments of both, in order. They walk along both
/// curves at once, so that rounding errors never reverse two cuts.
fn cuts_of(a: &Shares<'_>, b: &Shares<'_>) -> [Vec<At>; 2] {
    let curves = [a, b];
    let ends = curves.map(Shares::segments);
    let mut at: [At; 2] = [(0, 0.0); 2];
    let mut cuts = [vec![at[0]], vec![at[1]]];
    while at[0].0 < ends[0] || at[1].0 < ends[1] {
        let next = [0, 1].map(|c| match at[c].0 + 1 {
            s if s <= ends[c] => curves[c].start(s),
            _ => f64::INFINITY,
        });
        let share = next[0].min(next[1]);
        for c in 0..2 {
            at[c] = match next[c] - share <= SAME {
                true => (at[c].0 + 1, 0.0),
                // The end of the curve stays where it is.
                false if at[c].0 == ends[c] => at[c],
                false => {
                    let within = curves[c].within(at[c].0, share);
                    (at[c].0, within.clamp(at[c].1, 1.0))
                }
            };
            cuts[c].push(at[c]);
        }
    }
    cuts
}

/// Cuts the curves of `set`.
fn cut(set: &CurveSet, cuts: &[Vec<At>]) -> Result<Refined> {
    let straight = set.basis().is_polyline();
    let stride = if straight { 1 } else { 3 };
    let mut points: Vec<Point> = Vec::new();
    let (mut counts, mut segments) = (Vec::new(), Vec::new());
    for (i, cuts) in cuts.iter().enumerate() {
        let curve = set.curve(i);
        let mut of_curve = Vec::with_capacity(cuts.len());
        for ends in cuts.windows(2) {
            let ((s, t0), (end, t1)) = (ends[0], ends[1]);
            // A piece beyond the end is a point.
            let (s, t0) = match s == curve.segments as usize {
                true => (s - 1, 1.0),
                false => (s, t0),
            };
            let t1 = if end > s { 1.0 } else { t1 };
            of_curve.push(s as u32);
            match straight {
                true => points.push(point(set, i, (s, t0))),
                false => points.extend(&bezier(set, i, s, [t0, t1])[..3]),
            }
        }
        let count = stride * of_curve.len();
        let count = i32::try_from(count)
            .map_err(|_| usage(format!("curve {i}: too many pieces ({count} points)")))?;
        counts.push(-count);
        segments.push(of_curve);
    }
    let basis = match straight {
        true => Basis::Polyline,
        false => Basis::Bezier,
    };
    let set = CurveSet::from_counts(basis, &counts, Positions::F64(points.as_flattened()))?;
    Ok(Refined { set, segments })
}

#[cfg(test)]
mod tests {
    use super::super::resample::{distance, resample};
    use super::*;

    /// Returns a curve with points in arbitrary places.
    fn curve(basis: Basis, count: i32, seed: f64) -> CurveSet {
        let xyz = (0..3 * count.unsigned_abs()).map(|k| (f64::from(k * k) * seed).sin());
        let xyz: Vec<f64> = xyz.collect();
        CurveSet::from_counts(basis, &[count], Positions::F64(&xyz)).unwrap()
    }

    /// Two curves whose numbers of points have a common divisor, or none, or are equal.
    #[test]
    fn pieces_are_the_curves() {
        let pairs = [(-12, -9), (-12, -12), (-15, -21)];
        let all = pairs
            .into_iter()
            .flat_map(|p| [(p, By::Length), (p, By::Segments)]);
        for (basis, ((n, m), by)) in Basis::ALL
            .into_iter()
            .flat_map(|b| all.clone().map(move |x| (b, x)))
        {
            let (a, b) = (curve(basis, n, 0.7), curve(basis, m, 1.3));
            let refined = refine((&a, by), (&b, By::Segments)).unwrap();
            let [p, q] = refined.each_ref().map(|r| r.set.curve(0).segments);
            assert_eq!(p, q, "{basis:?}");
            for (set, refined) in [&a, &b].into_iter().zip(&refined) {
                for piece in 0..p {
                    let s = refined.segment(0, piece) as usize;
                    for half in [0.0, 0.5] {
                        let at = point(&refined.set, 0, (piece as usize, half));
                        let fine = (0..=1000).map(|k| point(set, 0, (s, f64::from(k) / 1000.0)));
                        let off = fine.map(|p| distance(p, at)).fold(f64::MAX, f64::min);
                        assert!(off < 5e-3, "{basis:?}, piece {piece}: {off}");
                    }
                }
            }
        }
    }

    #[test]
    fn repeated_points_make_no_cut_go_back() {
        let xyz = [
            0., 0., 0., 1., 0., 0., 1., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.,
        ];
        let a = CurveSet::from_counts(Basis::Polyline, &[-6], Positions::F64(&xyz)).unwrap();
        let b = resample(&a, 0.7).unwrap();
        let [p, q] = refine((&a, By::Length), (&b, By::Segments)).unwrap();
        assert_eq!(p.set.points(), q.set.points());
        let sorted = [&p, &q].map(|r| r.segments[0].is_sorted());
        assert_eq!(sorted, [true; 2]);
    }

    /// Regression test: a reparameterization slides points along the curve. Paired by their share
    /// of the segments, strands that lie beside one another seemed to pass through one another.
    #[test]
    fn a_reparameterized_curve_hardly_moves() {
        let at = |k: usize| {
            let t = k as f64 / 200.0 * std::f64::consts::TAU;
            let t = t + 0.8 * t.sin();
            [t.cos(), t.sin(), 0.0]
        };
        let xyz: Vec<f64> = (0..200).flat_map(at).collect();
        for basis in [Basis::Polyline, Basis::CatmullRom, Basis::BSpline] {
            let a = CurveSet::from_counts(basis, &[-200], Positions::F64(&xyz)).unwrap();
            let b = resample(&a, 1.0).unwrap();
            let [p, q] = refine((&a, By::Length), (&b, By::Segments)).unwrap();
            for k in 0..p.set.points() {
                let moved = distance(p.set.point(0, k), q.set.point(0, k));
                assert!(moved < 1e-2, "{basis:?}, point {k}: {moved}");
            }
        }
    }
}
