//! Extents of small polylines along the diagonals of the coordinate planes.

use super::basis::Real;
use super::boxes::{above, below, larger, smaller};
use super::coordinates::Coordinates;
use super::vector::per_axis;
use super::{Basis, CurveSet, pow2};
use crate::simd::{LANES, Lanes};

/// Extent of a curve along the six diagonals of the coordinate planes: `x + y`, `x - y`, `y + z`,
/// `y - z`, `z + x` and `z - x`. A ring that is not parallel to an axis plane fills its bounding
/// box badly; these bounds cut off the corners.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
pub(crate) struct Diagonals {
    /// Bounds along the diagonals. The last two lanes are not used and equal in all curves.
    lo: [f32; LANES],
    hi: [f32; LANES],
}

impl Diagonals {
    /// Bounds that contain everything.
    pub const UNBOUNDED: Diagonals = Diagonals {
        lo: [f32::NEG_INFINITY; LANES],
        hi: [f32::INFINITY; LANES],
    };

    /// Returns true if a plane orthogonal to a diagonal separates the curves.
    #[inline(always)]
    pub fn apart(&self, other: &Diagonals) -> bool {
        let mut apart = false;
        for k in 0..LANES {
            apart |= (self.hi[k] < other.lo[k]) | (other.hi[k] < self.lo[k]);
        }
        apart
    }
}

impl CurveSet {
    /// Returns the bounds of curve `i` along the diagonals. They are infinite for open
    /// curves and splines.
    ///
    /// # Derivation: the bounds contain the curve
    ///
    /// A linear function has its extremes at the vertices. The sum or difference of two numbers is
    /// rounded once, by at most `2^-53` of the result in double precision, which [`below`] and
    /// [`above`] cover. In single precision it is `2^-24`, and the result is first moved outward by
    /// `2^-22` of itself. A sum that overflows is replaced by the largest finite number. No overlap
    /// is lost by that, because bounds are only ever compared, and clamping is monotone.
    /// Coordinates that are rounded sums add twice their error.
    #[inline(always)]
    pub(crate) fn diagonals<L: Lanes>(&self, simd: L, i: usize) -> Diagonals {
        let c = &self.curves[i];
        if self.basis != Basis::Polyline || !c.closed {
            return Diagonals::UNBOUNDED;
        }
        let rows = (c.segments as usize).div_ceil(LANES);
        // The slots behind the last vertex are copies of the first vertices.
        let slots = c.first as usize..c.first as usize + rows * LANES;
        match self.coordinates() {
            Coordinates::F32(v) => {
                let axes = per_axis(|x| &v[x][slots.clone()]);
                let outward = |x: f64| x.abs() * pow2(-22);
                let wide = |x: f32| f64::from(x.clamp(f32::MIN, f32::MAX));
                let below = |x: f32| below(wide(x) - outward(wide(x)));
                let above = |x: f32| above(wide(x) + outward(wide(x)));
                bounds(simd, axes, below, above)
            }
            Coordinates::F64(v) => {
                let axes = per_axis(|x| &v[x][slots.clone()]);
                let pad = 2.0 * self.rounding();
                let below = |x: f64| below((x - pad).clamp(f64::MIN, f64::MAX));
                let above = |x: f64| above((x + pad).clamp(f64::MIN, f64::MAX));
                bounds(simd, axes, below, above)
            }
        }
    }
}

/// Returns the bounds of points, whose coordinates are full rows. `below` and `above` round a sum
/// outward.
#[inline(always)]
fn bounds<L: Lanes, T: Real>(
    simd: L,
    axes: [&[T]; 3],
    below: impl Fn(T) -> f32,
    above: impl Fn(T) -> f32,
) -> Diagonals {
    let [x, y, z] = axes.map(|v| v.as_chunks::<LANES>().0);
    let row = |k: usize| {
        let mut row = [[T::default(); LANES]; 6];
        let planes = [[&x[k], &y[k]], [&y[k], &z[k]], [&z[k], &x[k]]];
        for (d, [p, q]) in planes.iter().enumerate() {
            for l in 0..LANES {
                row[2 * d][l] = p[l] + q[l];
                row[2 * d + 1][l] = p[l] - q[l];
            }
        }
        row
    };
    let mut lo = row(0);
    let mut hi = lo;
    for k in 1..x.len() {
        let row = row(k);
        for d in 0..6 {
            for l in 0..LANES {
                lo[d][l] = smaller(lo[d][l], row[d][l]);
                hi[d][l] = larger(hi[d][l], row[d][l]);
            }
        }
    }
    let zero = simd.splat(0.0);
    let [mut low, mut high] = [[zero; LANES]; 2];
    for d in 0..6 {
        let (mut least, mut greatest) = ([0.0; LANES], [0.0; LANES]);
        for l in 0..LANES {
            least[l] = below(lo[d][l]);
            greatest[l] = above(hi[d][l]);
        }
        (low[d], high[d]) = (simd.load(&least), simd.load(&greatest));
    }
    let mut out = Diagonals::UNBOUNDED;
    simd.store_floats(simd.least(low), &mut out.lo);
    simd.store_floats(simd.greatest(high), &mut out.hi);
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::{Point, Positions};
    use crate::random::Random;
    use crate::simd::{Portable, avx2};

    /// Returns the exact sums along the diagonals as pairs of a rounded sum and its error.
    fn sums([x, y, z]: Point) -> [(f64, f64); 6] {
        [(x, y), (x, -y), (y, z), (y, -z), (z, x), (z, -x)].map(|(a, b)| {
            let sum = a + b;
            let part = sum - a;
            (sum, (a - (sum - part)) + (b - part))
        })
    }

    fn contain(set: &CurveSet, bounds: &Diagonals, i: usize) {
        for s in 0..set.curve(i).segments as usize {
            for (d, (sum, error)) in sums(set.knot(i, s)).into_iter().enumerate() {
                let (lo, hi) = (f64::from(bounds.lo[d]), f64::from(bounds.hi[d]));
                let largest = f64::from(f32::MAX);
                let above = lo < sum || (lo == sum && error >= 0.0) || lo == largest;
                let below = sum < hi || (hi == sum && error <= 0.0) || hi == largest;
                let clamped = sum < -largest && lo == -largest;
                assert!((above || clamped) && below, "{lo} {sum} + {error} {hi}");
                assert!(lo <= hi);
            }
        }
    }

    /// The bounds contain all vertices, for numbers of all magnitudes, sums that cancel, and sums
    /// that overflow.
    #[test]
    fn bounds_contain_the_vertices() {
        let mut random = Random::new(3);
        for case in 0..4000 {
            let n = 3 + random.below(62);
            let exponent = random.pick(&[-320, -150, -140, -20, 0, 20, 126, 127, 1022]);
            let near = 1.0 + random.unit();
            let xyz: Vec<f64> = (0..3 * n)
                .map(|_| {
                    let x = match random.one_in(2) {
                        true => near * (1.0 + f64::EPSILON * f64::from(random.below(9))),
                        false => 2.0 * random.unit() - 1.0,
                    };
                    let sign = if random.one_in(2) { -1.0 } else { 1.0 };
                    sign * x * 2f64.powi(exponent / 2) * 2f64.powi(exponent - exponent / 2)
                })
                .collect();
            let narrow: Vec<f32> = xyz
                .iter()
                .map(|&x| (x as f32).clamp(f32::MIN, f32::MAX))
                .collect();
            let positions = match case % 2 {
                0 => Positions::F32(&narrow),
                _ => Positions::F64(&xyz),
            };
            let set = CurveSet::from_counts(Basis::Polyline, &[-n], positions).unwrap();
            let bounds = set.diagonals(Portable, 0);
            contain(&set, &bounds, 0);
            if let Some(avx2) = avx2() {
                let same = set.diagonals(avx2, 0);
                assert_eq!((same.lo, same.hi), (bounds.lo, bounds.hi));
            }
        }
    }

    #[test]
    fn tilted_rings_are_apart_although_their_boxes_overlap() {
        // Two parallel triangles in the planes x + y = 0 and x + y = 1.
        let flat = [[0., 0., 0.], [3., -3., 0.], [0., 0., 3.]];
        let ring = |shift: f32| flat.map(|[x, y, z]| [x + shift, y, z]).concat();
        let near = |shift: f32| {
            let xyz = [ring(0.0), ring(shift)].concat();
            let set =
                CurveSet::from_counts(Basis::Polyline, &[-3, -3], Positions::F32(&xyz)).unwrap();
            !set.diagonals(Portable, 0)
                .apart(&set.diagonals(Portable, 1))
        };
        assert!(!near(1.0) && !near(0.01));
        assert!(near(0.0));
    }

    #[test]
    fn open_curves_and_splines_have_no_bounds() {
        let xyz: Vec<f32> = (0..30).map(|k| k as f32).collect();
        for (basis, count) in [(Basis::Polyline, 10), (Basis::CatmullRom, -10)] {
            let set = CurveSet::from_counts(basis, &[count], Positions::F32(&xyz)).unwrap();
            let bounds = set.diagonals(Portable, 0);
            assert_eq!(
                (bounds.lo, bounds.hi),
                (Diagonals::UNBOUNDED.lo, Diagonals::UNBOUNDED.hi)
            );
        }
    }
}
