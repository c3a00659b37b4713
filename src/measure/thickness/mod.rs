//! Thickness and ropelength of curves, and the places where they come close (Ashton & Cantarella,
//! A Fast Octree-Based Algorithm for Computing Ropelength, 2005).
//!
//! The thickness of a curve is the diameter of the largest tube around it that neither bends too
//! sharply nor overlaps itself. [`MinRad`] bounds the bend at each vertex, and a [`Strut`] is a
//! place where two parts of the curves approach one another.
//!
//! In a periodic cell, these are the bends and struts of the infinite structure: of each curve with
//! every image of every other one and with its own images. A curve that runs through the cell goes
//! on in its next period. Each strut stands for its images.

mod approach;
mod clearance;
mod edges;
mod lattice;
mod octree;
mod splines;
#[cfg(test)]
mod tests;
mod words;

pub(crate) use self::clearance::ClearanceMonitor;
pub use self::clearance::ClearanceOptions;
#[cfg(feature = "rerun")]
pub(crate) use self::clearance::{CloseBlock, REACH, close_blocks};
use self::edges::{Edges, Found};
use self::octree::Octree;
use crate::curve::{Cell, CurveSet, Image, Point};
use crate::error::Result;
use crate::pool;
use serde::Serialize;

/// A point of a curve.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct CurvePoint {
    /// Curve.
    pub curve: u32,
    /// Segment of the curve.
    pub segment: u32,
    /// Parameter on the segment, from 0 at its start to 1 at its end.
    pub t: f64,
    /// Position.
    pub point: Point,
}

/// Two points of curves whose distance is a local minimum: the distance grows, to first order, if
/// one of them moves along its curve (a pair of closest approach; section 1, Definition 2). A point
/// of a curve and itself are no such pair.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Strut {
    /// The two points. The position of the second one is translated by `image`.
    pub ends: [CurvePoint; 2],
    /// Translation of the second curve, in lattice vectors: zeros without a cell.
    pub image: Image,
    /// Their distance.
    pub length: f64,
    /// Upper bound of the error of `length`: 0 for polylines, whose error is that of rounding. For
    /// splines, the length of the local minimum near these points is at most this much less.
    pub error: f64,
}

impl Strut {
    /// Returns the derivatives of the length of a strut of polylines with respect to the positions
    /// of the vertices of the segments of both ends: start and end of the first segment, then of
    /// the second. `None` if the length is 0, where there is no derivative.
    ///
    /// The gradient is that of the distance between two points that stay at their places on the
    /// segments. It is the gradient of the minimum as well, because to first order the distance
    /// does not change if a point of the strut moves along its segment.
    ///
    /// ```
    /// use linkwatch::{Basis, CurveSet, Positions, Thickness};
    ///
    /// let line = |z: f64| [0.0, 0.0, z, 1.0, 0.0, z];
    /// let crossed = [&line(0.0)[..], &[0.5, -1.0, 0.25, 0.5, 1.0, 0.25]].concat();
    /// let set = CurveSet::from_counts(Basis::Polyline, &[2, 2], Positions::F64(&crossed))?;
    /// let strut = Thickness::of(&set, None)?.poca.unwrap();
    /// let gradient = strut.gradient().unwrap();
    /// assert_eq!(strut.length, 0.25);
    /// assert_eq!(gradient[0], [[0.0, 0.0, -0.5]; 2]);
    /// assert_eq!(gradient[1], [[0.0, 0.0, 0.5]; 2]);
    /// # Ok::<(), linkwatch::Error>(())
    /// ```
    pub fn gradient(&self) -> Option<[[Point; 2]; 2]> {
        let [a, b] = &self.ends;
        if self.length == 0.0 {
            return None;
        }
        // Quotients of halves, because the difference may overflow.
        let half = crate::curve::vector::half_difference(b.point, a.point);
        let away = half.map(|x| x / (0.5 * self.length));
        let of = |end: &CurvePoint, sign: f64| {
            [1.0 - end.t, end.t].map(|weight| away.map(|x| sign * weight * x))
        };
        Some([of(a, -1.0), of(b, 1.0)])
    }
}

/// Radius of curvature where a curve bends most sharply. For polylines, at a vertex: half of the
/// shorter edge at the vertex, divided by the tangent of half the turning angle (section 1,
/// Definition 1).
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct MinRad {
    /// Radius. 0 if the curve reverses its direction, or if segments of a spline meet in a corner.
    pub radius: f64,
    /// Upper bound of the error of `radius`: 0 for polylines. No bend of a spline has a smaller
    /// radius than `radius - error`.
    pub error: f64,
    /// Curve.
    pub curve: u32,
    /// Vertex of the curve: the start of the segment with this number.
    pub vertex: u32,
    /// Place on this segment, from 0 to 1: 0 for polylines.
    pub t: f64,
    /// Position.
    pub point: Point,
}

/// Thickness of all curves of a scene together.
///
/// ```
/// use linkwatch::{Basis, CurveSet, Positions, Thickness};
///
/// // A square of side 2: the tube around it bends with radius 1, and its sides are 2 apart.
/// let square = [0., 0., 0., 2., 0., 0., 2., 2., 0., 0., 2., 0.];
/// let set = CurveSet::from_counts(Basis::Polyline, &[-4], Positions::F64(&square))?;
/// let found = Thickness::of(&set, None)?;
/// assert!((found.thickness(1.0) - 2.0).abs() < 1e-12);
/// assert!((found.ropelength(1.0) - 4.0).abs() < 1e-12);
/// # Ok::<(), linkwatch::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Thickness {
    /// Length of all curves; that of splines is measured to nine digits or more.
    pub length: f64,
    /// Sharpest bend; `None` if no curve bends.
    pub min_rad: Option<MinRad>,
    /// Shortest strut; `None` if there is none.
    pub poca: Option<Strut>,
}

impl Thickness {
    /// Measures curves, open or closed. Repeated vertices of polylines count once. Bends and struts
    /// of splines have bounds of their errors, a ten-thousandth of the value unless a curve has a
    /// cusp, or curves coincide over long parts.
    ///
    /// In a periodic cell, all images that may be closer than the shortest strut are considered;
    /// their positions are rounded sums of coordinates and lattice vectors. The length is that of
    /// the given curves.
    ///
    /// Cost: `O(n log n)` for `n` edges, of which few come close; at most `O(n^2 log n)`. In a
    /// cell, each edge is compared with the images of the scene within the length of the shortest
    /// strut, which are few unless curves are larger than the cell.
    ///
    /// # Errors
    ///
    /// [`Error::Count`](crate::Error::Count) for splines with too many segments;
    /// [`Error::Usage`](crate::Error::Usage) if the cell is invalid, or
    /// curves span too many cells.
    ///
    /// ```
    /// use linkwatch::{Basis, Cell, CurveSet, Positions, Thickness};
    ///
    /// // A straight yarn that runs through the cell along x, and its images.
    /// let yarn = [0.0, 0.0, 0.0, 2.0, 0.0, 0.0];
    /// let set = CurveSet::from_counts(Basis::Polyline, &[2], Positions::F64(&yarn))?;
    /// let cell: Cell = "2,0.5,3".parse()?;
    /// let strut = Thickness::of(&set, Some(&cell))?.poca.unwrap();
    /// assert_eq!((strut.length, strut.image), (0.5, [0, 1, 0]));
    /// # Ok::<(), linkwatch::Error>(())
    /// ```
    pub fn of(set: &CurveSet, cell: Option<&Cell>) -> Result<Thickness> {
        pool::check_process()?;
        let edges = Edges::of(set, cell)?;
        let shortest = Octree::new(&edges).shortest(&edges)?;
        Ok(Thickness {
            length: edges.length(),
            min_rad: match set.basis().is_polyline() {
                true => edges.min_rad(),
                false => splines::min_rad(set, cell),
            },
            poca: shortest.map(|found| edges.strut(&found)),
        })
    }

    /// Returns the thickness `min{2 minRad / stiffness, POCA}`: a diameter, as in Definition 3.
    /// `stiffness` is 1 there; with 2, for example, the tube may bend to twice its diameter only.
    /// Infinite if no curve bends or comes close.
    ///
    /// liboctrope returns half of this: the radius `min{minRad / lambda, POCA / 2}`.
    pub fn thickness(&self, stiffness: f64) -> f64 {
        let bend = self.min_rad.map_or(f64::INFINITY, |m| m.radius);
        let strut = self.poca.map_or(f64::INFINITY, |strut| strut.length);
        (2.0 * bend / stiffness).min(strut)
    }

    /// Returns the quotient of length and thickness. liboctrope divides by the radius, which gives
    /// twice this number.
    pub fn ropelength(&self, stiffness: f64) -> f64 {
        self.length / self.thickness(stiffness)
    }
}

/// Returns all struts up to a length, shortest first; of splines, the shortest one of each pair of
/// segments, as other local minima between them can be part of the same approach.
///
/// In a periodic cell, each strut once, without its images.
///
/// # Errors
///
/// [`Error::Count`](crate::Error::Count) for splines with too many segments;
/// [`Error::Usage`](crate::Error::Usage) if the cell is invalid, or if too
/// many cells are within this length.
///
/// ```
/// use linkwatch::{Basis, Cell, CurveSet, Positions, struts};
///
/// let yarn = [0.0, 0.0, 0.0, 2.0, 0.0, 0.0];
/// let set = CurveSet::from_counts(Basis::Polyline, &[2], Positions::F64(&yarn))?;
/// let cell: Cell = "2,0.5,3".parse()?;
/// let found = struts(&set, Some(&cell), 0.6)?;
/// // The yarn has two neighbours: a period of it is at this distance on either side.
/// assert!(found.iter().all(|strut| strut.length == 0.5));
/// # Ok::<(), linkwatch::Error>(())
/// ```
pub fn struts(set: &CurveSet, cell: Option<&Cell>, longest: f64) -> Result<Vec<Strut>> {
    pool::check_process()?;
    let edges = Edges::of(set, cell)?;
    let mut found = Octree::new(&edges).up_to(&edges, longest)?;
    found.sort_by(Found::order);
    Ok(found.iter().map(|found| edges.strut(found)).collect())
}
