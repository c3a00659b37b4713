//! The image of a curve that lies beside another curve.

use crate::curve::vector::{add, dot, per_axis, sub};
use crate::curve::{Cell, CurveSet, Image, Point, Positions};
use crate::error::Result;

/// Returns curve `i` of a periodic scene, and the image of curve `j` whose centre is nearest to
/// that of curve `i`: the two strands of a ribbon, whose coordinates may be those of any image.
/// Returns the translation of curve `j`, too.
///
/// Coordinates become double precision. The centre is the mean of the control points.
///
/// # Panics
///
/// If the set does not have the curves.
///
/// # Errors
///
/// The errors of [`Cell::check`]; a coordinate overflows.
pub fn beside(set: &CurveSet, [i, j]: [usize; 2], cell: &Cell) -> Result<(CurveSet, Image)> {
    cell.check()?;
    let inverse = cell.inverse().unwrap_or_default();
    let centre = |i: usize| -> Point {
        let n = f64::from(set.curve(i).points);
        set.points_in(i)
            .fold([0.0; 3], |sum, p| add(sum, p.map(|x| x / n)))
    };
    let apart = sub(centre(i), centre(j));
    let image: Image = per_axis(|x| match cell.periodic()[x] {
        true => dot(inverse[x], apart).round().clamp(-1e9, 1e9) as i32,
        false => 0,
    });
    let by = cell.translation(image);
    let moved = set.points_in(j).map(|p| add(p, by));
    let xyz: Vec<f64> = set.points_in(i).chain(moved).flatten().collect();
    let counts = [i, j].map(|i| set.curve(i).count());
    let pair = CurveSet::from_counts(set.basis(), &counts, Positions::F64(&xyz))?;
    Ok((pair, image))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::Basis;

    #[test]
    fn a_strand_is_moved_beside_the_other_one() {
        let xyz = [
            0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 20.1, 0.0, -8.0, 21.1, 0.0, -8.0, 20.1,
            1.0, -8.0,
        ];
        let set = CurveSet::from_counts(Basis::Polyline, &[-3, -3], Positions::F64(&xyz)).unwrap();
        // Sheared: the third vector is (2, 0, 8).
        let cell: Cell = "10,0,0,0,10,0,2,0,8".parse().unwrap();
        let (moved, image) = beside(&set, [0, 1], &cell).unwrap();
        assert_eq!(image, [-2, 0, 1]);
        let first = moved.point(1, 0);
        assert!(
            (first[0] - 2.1).abs() < 1e-12 && first[2] == 0.0,
            "{first:?}"
        );
        let (same, image) = beside(&set, [0, 1], &"10,10,0".parse().unwrap()).unwrap();
        assert_eq!((image, same.point(1, 0)[2]), ([-2, 0, 0], -8.0));
    }
}
