//! Quantization of control points, as lossy compression of models does it.

use crate::curve::{CurveSet, Point, Positions, Precision};
use crate::error::{Error, Result};

/// Maximum number of bits: coordinates of doubles have no more.
pub const MOST_BITS: u32 = 52;

/// Rounds all control points to a grid of 2^`bits` cells along each axis of their bounding box, as
/// a file of `bits` bits per coordinate does. Each coordinate becomes the middle of its cell, in
/// the precision of the curves.
///
/// A coordinate moves by at most half a cell, and by the rounding to the precision: single
/// precision has 24 bits, so that finer grids hardly move it. An axis along which all points agree
/// is kept.
///
/// ```
/// use linkwatch::scenes::Scene;
///
/// let set = "chainmail:rows=2,columns=2".parse::<Scene>()?.build()?.curves;
/// let coarse = linkwatch::sweep::quantize(&set, 8)?;
/// assert_eq!(coarse.points(), set.points());
/// let moved = (set.point(0, 0)[0] - coarse.point(0, 0)[0]).abs();
/// assert!(moved > 0.0 && moved <= 0.51 / 256.0 * set.extent());
/// # Ok::<(), linkwatch::Error>(())
/// ```
///
/// Errors: [`Error::Usage`] for 0 bits, or more than [`MOST_BITS`].
pub fn quantize(set: &CurveSet, bits: u32) -> Result<CurveSet> {
    check_bits(bits)?;
    let (low, high) = set.corners();
    let cells = 2f64.powi(bits as i32);
    let round = |p: Point| {
        [0, 1, 2].map(|x| {
            // Halved, since the difference of two finite numbers may be infinite.
            let half = 0.5 * high[x] - 0.5 * low[x];
            if half == 0.0 {
                return p[x];
            }
            let share = (0.5 * p[x] - 0.5 * low[x]) / half;
            let cell = (share * cells).floor().clamp(0.0, cells - 1.0);
            let middle = (cell + 0.5) / cells;
            // A convex combination, so that it does not overflow either.
            low[x] * (1.0 - middle) + high[x] * middle
        })
    };
    from_points(
        set,
        &set.counts().collect::<Vec<i32>>(),
        points(set).map(round),
    )
}

/// Checks a number of bits.
pub(super) fn check_bits(bits: u32) -> Result<()> {
    match (1..=MOST_BITS).contains(&bits) {
        true => Ok(()),
        false => Err(Error::Usage(format!(
            "quantization to {bits} bits, expected 1 to {MOST_BITS}"
        ))),
    }
}

/// Returns all control points in order.
fn points(set: &CurveSet) -> impl Iterator<Item = Point> + '_ {
    let curves = set.curves().iter().enumerate();
    curves.flat_map(move |(i, c)| (0..c.points as usize).map(move |k| set.point(i, k)))
}

/// Returns a set of curves with the basis and the precision of another one.
pub(super) fn from_points(
    like: &CurveSet,
    counts: &[i32],
    points: impl Iterator<Item = Point>,
) -> Result<CurveSet> {
    match like.precision() {
        Precision::F32 => {
            let xyz: Vec<f32> = points.flatten().map(|x| x as f32).collect();
            CurveSet::from_counts(like.basis(), counts, Positions::F32(&xyz))
        }
        Precision::F64 => {
            let xyz: Vec<f64> = points.flatten().collect();
            CurveSet::from_counts(like.basis(), counts, Positions::F64(&xyz))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::Basis;

    fn set(xyz: &[f64]) -> CurveSet {
        let counts = [-(xyz.len() as i32 / 3)];
        CurveSet::from_counts(Basis::Polyline, &counts, Positions::F64(xyz)).unwrap()
    }

    #[test]
    fn coordinates_become_the_middle_of_their_cell() {
        // Four cells of 2 along x; z is flat.
        let set = set(&[0., 0., 5., 8., 4., 5., 3.9, 1.1, 5.]);
        let coarse = quantize(&set, 2).unwrap();
        let points: Vec<Point> = (0..3).map(|k| coarse.point(0, k)).collect();
        assert_eq!(points, [[1., 0.5, 5.], [7., 3.5, 5.], [3., 1.5, 5.]]);
    }

    #[test]
    fn no_coordinate_moves_by_more_than_half_a_cell() {
        let set = set(&[0.1, -7., 3., 8.3, 4., 5.5, 3.9, 1.1, 4.2, 1.0, 2.0, 3.3]);
        for bits in 1..=MOST_BITS {
            let coarse = quantize(&set, bits).unwrap();
            for k in 0..4 {
                for (x, side) in [8.2, 11.0, 2.5].into_iter().enumerate() {
                    let moved = (coarse.point(0, k)[x] - set.point(0, k)[x]).abs();
                    let half = 0.5 * side / 2f64.powi(bits as i32);
                    assert!(
                        moved <= half + 4e-15,
                        "{bits} bits, axis {x}: {moved} > {half}"
                    );
                }
            }
        }
    }

    #[test]
    fn extreme_coordinates_stay_finite() {
        let most = f64::MAX;
        let set = set(&[-most, 0., 0., most, 0., 0., 0., 1e-300, 0.]);
        let coarse = quantize(&set, 4).unwrap();
        assert!(coarse.max_abs() < most);
    }

    #[test]
    fn refuses_numbers_of_bits_that_no_grid_has() {
        let set = set(&[0., 0., 0., 1., 0., 0., 0., 1., 0.]);
        for bits in [0, 53, u32::MAX] {
            let e = quantize(&set, bits).unwrap_err().to_string();
            assert!(
                e.contains(&bits.to_string()) && e.contains("1 to 52"),
                "{e}"
            );
        }
    }
}
