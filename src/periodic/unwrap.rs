//! Curves that are torn at the boundary of a periodic cell, and unwrapping of their coordinates.
//!
//! Simulations move points that leave the cell to its opposite side. A curve that crosses the
//! boundary is then torn: two consecutive points are about a cell apart. No simulation has
//! a segment of more than half a cell, because an image of its other end would be closer, so such
//! a curve is refused.
//!
//! Cost: three products per segment and periodic direction.

use super::nearest::Neighbors;
use crate::curve::vector::{add, dot, per_axis, sub};
use crate::curve::{Basis, Cell, CurveSet, Image, Point, Positions};
use crate::error::{Error, Result};

/// Maximum length of a segment along a lattice vector, as a share of the cell. For a longer
/// segment, the choice of the nearest image of its end would be a guess.
pub(super) const LONGEST: f64 = 1.0 / 3.0;

/// Unwraps the curves of successive frames.
///
/// Each vertex becomes the image that is nearest to the previous vertex of its curve. The first
/// vertex of a curve becomes the image that is nearest to its place in the previous frame, so that
/// curves move continuously across the boundary. Coordinates become double precision.
///
/// A closed curve may close up to a lattice vector instead: a yarn that runs through the cell. It
/// becomes an open curve from its first vertex to the image of that vertex.
///
/// ```
/// use linkwatch::{Basis, Cell, CurveSet, Positions, Unwrap};
///
/// let cell: Cell = "10,10,10".parse()?;
/// // A ring across the boundary, and a yarn along x.
/// let wrapped = [
///     9.0, 5.0, 5.0, 1.0, 5.0, 5.0, 1.0, 7.0, 5.0, 9.0, 7.0, 5.0,
///     1.0, 0.0, 0.0, 4.0, 0.0, 0.0, 7.0, 0.0, 0.0, 9.0, 0.0, 0.0,
/// ];
/// let set = CurveSet::from_counts(Basis::Polyline, &[-4, -4], Positions::F64(&wrapped))?;
/// let set = Unwrap::default().unwrap(&set, &cell)?;
/// assert_eq!(set.point(0, 1), [11.0, 5.0, 5.0]);
/// assert_eq!((set.curve(1).closed, set.point(1, 4)), (false, [11.0, 0.0, 0.0]));
/// # Ok::<(), linkwatch::Error>(())
/// ```
#[derive(Clone, Debug, Default, serde::Serialize, serde::Deserialize)]
pub struct Unwrap {
    /// First vertex of each curve in the previous frame as given, in fractional coordinates of the
    /// cell of that frame, and the translation of that vertex by the unwrapping.
    before: Vec<(Point, Image)>,
}

/// Returns the function that converts points to fractional coordinates, from the corner of the
/// cell. These do not change if a scene is scaled together with its cell.
pub(super) fn fractional(cell: &Cell) -> impl Fn(Point) -> Point + use<> {
    let (inverse, origin) = (cell.inverse().unwrap_or_default(), cell.origin);
    move |p| inverse.map(|b| dot(b, sub(p, origin)))
}

impl Unwrap {
    /// Returns the curves of a frame, unwrapped.
    ///
    /// # Errors
    ///
    /// [`Error::Usage`] if a segment is longer than a third of the cell, or a curve moved further
    /// than that since the previous frame, since the nearest image would be a guess; or if the
    /// lattice vectors are linearly dependent. The next frame is compared with the one before.
    pub fn unwrap(&mut self, set: &CurveSet, cell: &Cell) -> Result<CurveSet> {
        cell.check()?;
        let (fractional, periodic) = (fractional(cell), cell.periodic());
        let (positions, neighbors) = (set.positions(), Neighbors::of(cell));
        // Returns the translation that brings `to` nearest to `from`, and the lattice vector along
        // which they are then furthest apart, with this distance as a share of the cell.
        let nearest = |from: Point, to: Point| -> (Image, (usize, f64)) {
            let u = sub(to, from);
            let (mut image, mut most) = (Image::default(), (0, 0.0));
            for x in (0..3).filter(|&x| periodic[x]) {
                image[x] = -u[x].round().clamp(-1e9, 1e9) as i32;
                let apart = (u[x] + f64::from(image[x])).abs();
                if apart > most.1 {
                    most = (x, apart);
                }
            }
            // In a cell with oblique vectors, another image may be nearer than the rounded one.
            let step = cell.translation_by(per_axis(|x| match periodic[x] {
                true => u[x] + f64::from(image[x]),
                false => 0.0,
            }));
            match neighbors.shorten(step) {
                (by, _) if by == Image::default() => (image, most),
                (by, true) => (add(image, by), (0, 0.0)),
                (_, false) => (image, (most.0, most.1.max(0.5))),
            }
        };
        let moved = |p: Point, image: Image| add(p, cell.translation(image));
        let known = Some(&self.before).filter(|b| b.len() == set.len());
        let mut firsts = Vec::with_capacity(set.len());
        let (mut counts, mut xyz) = (Vec::with_capacity(set.len()), Vec::new());
        let mut guess = None;
        for (i, curve) in set.curves().iter().enumerate() {
            let points = set.points_of(i);
            let raw = |k: usize| positions.point(points.start + k);
            let first = fractional(raw(0));
            let (before, start) = known.map_or((first, Image::default()), |before| before[i]);
            let (by, share) = nearest(before, first);
            if share.1 > LONGEST {
                guess.get_or_insert_with(|| moved_too_far(i, share.0, share.1));
            }
            let start = add(start, by);
            firsts.push((first, start));
            let mut unwrapped = Vec::with_capacity(points.len() + 3);
            unwrapped.push(moved(raw(0), start));
            let count = points.len();
            let closing = usize::from(curve.closed);
            let (mut image, mut last) = (start, first);
            for k in 0..count - 1 + closing {
                let next = fractional(raw((k + 1) % count));
                let (by, share) = nearest(std::mem::replace(&mut last, next), next);
                if share.1 > LONGEST {
                    guess.get_or_insert_with(|| too_long(i, k, share.0, share.1));
                }
                image = add(image, by);
                if k + 1 < count {
                    unwrapped.push(moved(raw(k + 1), image));
                }
            }
            let period = sub(image, start);
            let through = curve.closed && period != Image::default();
            if through {
                lengthen(&mut unwrapped, set.basis(), |p, times: i32| {
                    moved(p, period.map(|n| times * n))
                });
            }
            let count = unwrapped.len() as i32;
            let closed = curve.closed && !through;
            counts.push(if closed { -count } else { count });
            xyz.extend_from_slice(unwrapped.as_flattened());
        }
        if let Some(guess) = guess {
            return Err(guess);
        }
        let unwrapped = CurveSet::from_counts(set.basis(), &counts, Positions::F64(&xyz))?;
        self.before = firsts;
        Ok(unwrapped)
    }
}

/// Adds control points to those of a closed curve, so that an open curve runs from its first point
/// to the image of that point.
fn lengthen(points: &mut Vec<Point>, basis: Basis, moved: impl Fn(Point, i32) -> Point) {
    let (first, last) = (points[0], points[points.len() - 1]);
    let second = points.get(1).copied().unwrap_or(first);
    points.push(moved(first, 1));
    if let Basis::CatmullRom | Basis::BSpline = basis {
        points.push(moved(second, 1));
        points.insert(0, moved(last, -1));
    }
}

/// Returns a text for a share of the cell along vector `x`.
fn words(x: usize, share: f64) -> String {
    let (percent, vector) = (100.0 * share, x + 1);
    format!("{percent:.0} % of the periodic cell along vector {vector}")
}

fn too_long(curve: usize, vertex: usize, x: usize, share: f64) -> Error {
    Error::Usage(format!(
        "curve {curve}: the segment after vertex {vertex} has {}, so the image of its end is a \
         guess (at most a third): write unwrapped coordinates, or finer curves",
        words(x, share)
    ))
}

fn moved_too_far(curve: usize, x: usize, share: f64) -> Error {
    Error::Usage(format!(
        "curve {curve} moved by {} since the previous frame, so its image is a guess (at most a \
         third): publish more frames, or unwrapped coordinates",
        words(x, share)
    ))
}

/// A segment that may be longer than half of the cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Torn {
    pub curve: usize,
    /// Points of the curve at both ends of the segment.
    pub ends: [usize; 2],
    /// Index of the lattice vector.
    pub direction: usize,
    /// Length along this vector, in units of the vector.
    pub share: f64,
}

/// Returns the first segment of these curves that is torn.
///
/// # Errors
///
/// [`Error::Usage`] if the cell is invalid.
pub(crate) fn find_torn(
    set: &CurveSet,
    cell: &Cell,
    curves: impl IntoIterator<Item = usize>,
) -> Result<Option<Torn>> {
    cell.check()?;
    // A vector of a sheared cell may be far longer than the shortest ones of its lattice.
    let cell = cell.reduced();
    let (inverse, periodic) = (cell.inverse_or_error()?, cell.periodic());
    for curve in curves {
        for ends in set.curve(curve).pairs_of_points() {
            let [p, q] = ends.map(|k| set.point(curve, k));
            let shares = inverse.map(|b| dot(sub(q, p), b).abs());
            for direction in (0..3).filter(|&k| periodic[k]) {
                let share = shares[direction];
                // Written so that NaN counts as torn.
                let whole = share <= 0.5;
                if !whole {
                    return Ok(Some(Torn {
                        curve,
                        ends,
                        direction,
                        share,
                    }));
                }
            }
        }
    }
    Ok(None)
}

/// Same as [`CurveSet::check_whole`], for these curves.
pub(crate) fn check_whole(
    set: &CurveSet,
    cell: &Cell,
    curves: impl IntoIterator<Item = usize>,
) -> Result<()> {
    let torn = find_torn(set, cell, curves)?;
    torn.map_or(Ok(()), |torn| Err(Error::Usage(torn.to_string())))
}

impl CurveSet {
    /// Checks that no curve is torn at the boundary of a periodic cell, as wrapped coordinates are.
    ///
    /// # Errors
    ///
    /// [`Error::Usage`] if a segment is longer than half of the cell along a lattice vector,
    /// or these vectors are linearly dependent.
    pub fn check_whole(&self, cell: &Cell) -> Result<()> {
        check_whole(self, cell, 0..self.len())
    }
}

impl std::fmt::Display for Torn {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (curve, [p, q], share) = (self.curve, self.ends, self.share);
        let vector = ["first", "second", "third"][self.direction];
        write!(
            f,
            "curve {curve} is {share:.3} of the {vector} lattice vector long from \
             point {p} to {q}, more than half: pass the option `wrapped` if coordinates are \
             wrapped, else the option `wrapped=false`"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::vector::per_axis;
    use crate::random::Random;

    /// Random walks that close in space, or up to a lattice vector, wrapped into a sheared cell.
    fn walk(random: &mut Random, n: usize, period: Point) -> Vec<Point> {
        let start = [0; 3].map(|_| 20.0 * random.unit() - 10.0);
        let phase = [0; 3].map(|_| std::f64::consts::TAU * random.unit());
        let point = |k: usize| {
            let t = k as f64 / n as f64;
            per_axis(|x| {
                let wave = 2.0 * (std::f64::consts::TAU * t + phase[x]).sin();
                start[x] + wave + t * period[x]
            })
        };
        (0..n).map(point).collect()
    }

    #[test]
    fn wrapped_curves_are_unwrapped_frame_after_frame() {
        let cell: Cell = "8,0,0,2,9,0,-1,1,10".parse().unwrap();
        let inverse = cell.inverse().unwrap();
        let mut random = Random::new(8);
        for _ in 0..200 {
            let image: Image = [0; 3].map(|_| random.below(3) - 1);
            let n = 60;
            let curve = walk(&mut random, n, cell.translation(image));
            let mut unwrap = Unwrap::default();
            let mut offset: Option<Image> = None;
            for frame in 0..20 {
                let drift = [0.7 * f64::from(frame), -0.9 * f64::from(frame), 0.3];
                let at = |p: &Point| per_axis(|x| p[x] + drift[x]);
                let wrapped: Vec<Point> = curve
                    .iter()
                    .map(|p| {
                        let p = at(p);
                        let home = per_axis(|x| {
                            let b = inverse[x];
                            -(b[0] * p[0] + b[1] * p[1] + b[2] * p[2]).floor() as i32
                        });
                        let by = cell.translation(home);
                        per_axis(|x| p[x] + by[x])
                    })
                    .collect();
                let positions = Positions::F64(wrapped.as_flattened());
                let set = CurveSet::from_counts(Basis::Polyline, &[-(n as i32)], positions);
                let out = unwrap.unwrap(&set.unwrap(), &cell).unwrap();
                let through = image != Image::default();
                assert_eq!(out.curve(0).closed, !through);
                assert_eq!(out.points(), n + usize::from(through));
                // The same image in all frames, for all vertices.
                for (k, p) in curve.iter().enumerate() {
                    let (found, expected) = (out.point(0, k), at(p));
                    let by = per_axis(|x| {
                        let b = inverse[x];
                        let d = per_axis(|x| found[x] - expected[x]);
                        b[0] * d[0] + b[1] * d[1] + b[2] * d[2]
                    });
                    let rounded = by.map(|u| u.round() as i32);
                    assert!((0..3).all(|x| (by[x] - f64::from(rounded[x])).abs() < 1e-9));
                    assert_eq!(*offset.get_or_insert(rounded), rounded, "frame {frame}");
                }
            }
        }
    }

    /// Regression test: a position in the previous cell was compared with one in the current cell,
    /// so that a curve that had drifted by many cells jumped to another image.
    #[test]
    fn a_curve_stays_at_its_image_if_the_cell_changes() {
        for corner in [0.0, -5.0, 1000.0] {
            let mut unwrap = Unwrap::default();
            for frame in 0..80 {
                // The box grows about its corner in the last frames.
                let size = if frame < 60 { 10.0 } else { 10.5 };
                let cell = Cell::orthogonal([corner; 3], [size; 3]);
                let x = 0.3 + 0.27 * f64::from(frame);
                let at = |dx: f64| [corner + size * (x + dx).rem_euclid(1.0), corner + 1.0, 0.5];
                let xyz = [at(0.0), at(0.1), at(0.2)];
                let positions = Positions::F64(xyz.as_flattened());
                let set = CurveSet::from_counts(Basis::Polyline, &[3], positions).unwrap();
                let out = unwrap.unwrap(&set, &cell).unwrap();
                for (k, dx) in [0.0, 0.1, 0.2].into_iter().enumerate() {
                    let expected = corner + size * (x + dx);
                    assert!((out.point(0, k)[0] - expected).abs() < 1e-9, "{frame}");
                }
            }
        }
    }

    #[test]
    fn refuses_segments_and_motions_that_would_be_a_guess() {
        let cell: Cell = "9,9,0".parse().unwrap();
        let ring = |x: f64, long: f64| {
            let xyz = [x, 0.0, 0.0, x + long, 0.0, 50.0, x, 1.0, 99.0];
            CurveSet::from_counts(Basis::Polyline, &[-3], Positions::F64(&xyz)).unwrap()
        };
        let mut unwrap = Unwrap::default();
        // Along z, the scene does not repeat.
        assert!(unwrap.unwrap(&ring(0.0, 2.9), &cell).is_ok());
        let e = unwrap
            .unwrap(&ring(4.4, 1.0), &cell)
            .unwrap_err()
            .to_string();
        assert!(
            e.contains("curve 0 moved by 49 % of the periodic cell along vector 1"),
            "{e}"
        );
        // The next frame is compared with the one before.
        assert!(unwrap.unwrap(&ring(5.0, 1.0), &cell).is_err());
        assert!(unwrap.unwrap(&ring(2.0, 1.0), &cell).is_ok());
        let e = unwrap
            .unwrap(&ring(2.0, 3.1), &cell)
            .unwrap_err()
            .to_string();
        assert!(
            e.contains("curve 0: the segment after vertex 0 has 34 %"),
            "{e}"
        );
    }

    #[test]
    fn a_spline_through_the_cell_keeps_its_shape() {
        let cell: Cell = "6,0,0".parse().unwrap();
        let xyz: Vec<f64> = (0..6)
            .flat_map(|k| {
                let k = f64::from(k);
                [k, k.sin(), (2.0 * k).cos()]
            })
            .collect();
        for basis in [Basis::CatmullRom, Basis::BSpline] {
            let set = CurveSet::from_counts(basis, &[-6], Positions::F64(&xyz)).unwrap();
            let out = Unwrap::default().unwrap(&set, &cell).unwrap();
            assert_eq!(out.curve(0).segments, 6);
            // A segment away from the ends of the list.
            for t in [0.0, 0.3, 1.0] {
                assert_eq!(out.eval(0, 2, t), set.eval(0, 2, t), "{basis:?}");
            }
            let (start, end) = (out.knot(0, 0), out.knot(0, 6));
            assert!((end[0] - start[0] - 6.0).abs() < 1e-12);
            assert!((end[1] - start[1]).abs() < 1e-12);
        }
    }
}
