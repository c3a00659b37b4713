//! Spreads positions, `x y z x y z ..`, over three arrays.

use super::basis::Basis;
use super::coordinates::Scalar;
use super::curve::{Curve, slots_of};

/// Writes all points of all curves, with the slots around them ([`finish_curve`]). Returns the
/// largest magnitude.
#[inline(always)]
pub(super) fn write_curves<T: Scalar>(
    dst: &mut [Vec<T>; 3],
    curves: &[Curve],
    basis: Basis,
    src: &[T],
) -> f64 {
    let (mut rest, mut largest) = (src, 0);
    for c in curves {
        let (own, after) = rest.split_at(3 * c.points as usize);
        rest = after;
        largest = largest.max(T::largest(own));
        let body = c.first as usize + basis.lead(c.closed);
        for (x, dst) in dst.iter_mut().enumerate() {
            let points = own.as_chunks::<3>().0.iter();
            for (to, p) in dst[body..].iter_mut().zip(points) {
                *to = p[x];
            }
            finish_curve(dst, c, basis);
        }
    }
    T::from_magnitude(largest)
}

/// Writes the slots around the points of a curve, one axis: the copies of points that a closed
/// curve stores at its ends, including the padding of its last row. The padding of an open curve is
/// 0.
#[inline(always)]
fn finish_curve<T: Scalar>(dst: &mut [T], c: &Curve, basis: Basis) {
    let (first, n) = (c.first as usize, c.points as usize);
    let body = first + basis.lead(c.closed);
    let (end, slots) = (body + n, slots_of(basis, c.segments as usize));
    if !c.closed {
        return dst[end..first + slots].fill(T::default());
    }
    for k in first..body {
        dst[k] = dst[k + n];
    }
    for k in end..first + slots {
        dst[k] = dst[k - n];
    }
}

#[cfg(test)]
mod tests {
    use crate::curve::{Basis, CurveSet, Positions, Precision};
    use crate::error::Error;
    use crate::random::Random;

    /// Curves of few and of many points.
    fn counts(random: &mut Random, basis: Basis) -> Vec<i32> {
        let most = random.pick(&[4, 20, 700]);
        let counts = (0..60).map(|_| {
            let closed = random.one_in(2);
            let points = 1 + random.below(most);
            let allowed = (points..).find(|&n| basis.segments(n, closed).is_some());
            let points = allowed.expect("a larger number is allowed") as i32;
            if closed { -points } else { points }
        });
        counts.collect()
    }

    /// Returns the expected coordinates of all slots of an axis, by the description of
    /// [`CurveSet`].
    fn slots(set: &CurveSet, basis: Basis, xyz: &[f64], axis: usize) -> Vec<f64> {
        let (mut out, mut at) = (vec![0.0; set.slots()], 0);
        for c in set.curves() {
            let n = c.points as usize;
            let lead = basis.lead(c.closed);
            let groups = (c.segments as usize).div_ceil(8);
            let slots = (8 * groups - 1) * basis.stride() + basis.window();
            for k in 0..slots {
                let point = match c.closed {
                    true => (k + n - lead) % n,
                    false if k < n => k,
                    false => continue,
                };
                out[c.first as usize + k] = xyz[3 * (at + point) + axis];
            }
            at += n;
        }
        out
    }

    fn set_of(basis: Basis, counts: &[i32], xyz: &[f64], precision: Precision) -> CurveSet {
        let narrow: Vec<f32> = xyz.iter().map(|&x| x as f32).collect();
        let positions = match precision {
            Precision::F32 => Positions::F32(&narrow),
            Precision::F64 => Positions::F64(xyz),
        };
        CurveSet::from_counts(basis, counts, positions).unwrap()
    }

    fn axis(set: &CurveSet, x: usize) -> Vec<f64> {
        (0..set.slots()).map(|slot| set.at(slot)[x]).collect()
    }

    #[test]
    fn every_slot_has_its_point_after_construction_and_after_an_update() {
        for seed in 0..40 {
            let mut random = Random::new(seed);
            for basis in Basis::ALL {
                let counts = counts(&mut random, basis);
                let points: usize = counts.iter().map(|c| c.unsigned_abs() as usize).sum();
                // Multiples of 2^-10, which single precision represents.
                let mut frame = || -> Vec<f64> {
                    let mut value = || f64::from(random.below(1 << 20)) / 1024.0 - 512.0;
                    (0..3 * points).map(|_| value()).collect()
                };
                let [first, second] = [frame(), frame()];
                for precision in [Precision::F32, Precision::F64] {
                    let mut set = set_of(basis, &counts, &first, precision);
                    for x in 0..3 {
                        let expected = slots(&set, basis, &first, x);
                        assert_eq!(axis(&set, x), expected, "{seed}, {basis:?}, new");
                    }
                    let narrow: Vec<f32> = second.iter().map(|&x| x as f32).collect();
                    set.update(match precision {
                        Precision::F32 => Positions::F32(&narrow),
                        Precision::F64 => Positions::F64(&second),
                    })
                    .unwrap();
                    for x in 0..3 {
                        let expected = slots(&set, basis, &second, x);
                        assert_eq!(axis(&set, x), expected, "{seed}, {basis:?}, updated");
                    }
                    let largest = second.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
                    assert_eq!(set.max_abs(), largest);
                }
            }
        }
    }

    #[test]
    fn an_update_names_the_curve_and_the_point_of_a_bad_value() {
        let mut random = Random::new(1);
        for basis in Basis::ALL {
            let counts = counts(&mut random, basis);
            let points: usize = counts.iter().map(|c| c.unsigned_abs() as usize).sum();
            let good = vec![0.5; 3 * points];
            let mut set = set_of(basis, &counts, &good, Precision::F64);
            for _ in 0..200 {
                let at = random.below(3 * points);
                let mut before = 0;
                let curve = counts.iter().position(|c| {
                    before += c.unsigned_abs() as usize;
                    at / 3 < before
                });
                let curve = curve.unwrap();
                let point = at / 3 + counts[curve].unsigned_abs() as usize - before;
                let mut bad = good.clone();
                for value in [f64::NAN, f64::NEG_INFINITY] {
                    bad[at] = value;
                    let found = set.update(Positions::F64(&bad)).unwrap_err().to_string();
                    let axis = ["x", "y", "z"][at % 3];
                    let named = format!("curve {curve}, point {point}: coordinate {axis} is");
                    assert!(found.starts_with(&named), "{found}, expected {named}");
                }
                bad[at] = -1e300;
                match set.update(Positions::F64(&bad)) {
                    Ok(()) => assert!(basis.is_polyline()),
                    Err(Error::TooLarge { curve: c, .. }) => assert_eq!(c, curve),
                    Err(e) => panic!("{e}"),
                }
            }
            set.update(Positions::F64(&good)).unwrap();
            assert_eq!(set.max_abs(), 0.5);
        }
    }
}
