//! Yarns: curves that run through the cell. A yarn ends at an image of its start; the lattice
//! vector between the two is its period.
//!
//! Such a curve is given as an open curve from a vertex to an image of that vertex, up to the
//! rounding of the coordinates ([`tolerance`]). Together with
//! its images by the multiples of its period it is an infinite curve without ends. Two of them have
//! no linking number, but the linking number of a closed curve and an infinite one exists: the
//! closed curve lies in a box, and all ways to close the infinite one outside of this box give the
//! same number ([`linking`](super::linking)).

use super::ImagePair;
use crate::curve::vector::{dot, norm, per_axis, sub};
use crate::curve::{Cell, CurveSet, Image, Point, Precision, pow2, significant};
use crate::words::if_any;
use serde::{Deserialize, Serialize};

/// Returns the tolerance of [`period`]: the largest distance of the end of a curve from the image
/// of its start along a direction, relative to the size of the cell and of both coordinates.
///
/// # Derivation
///
/// Let the end be the exact image of the start. With `u` the rounding unit of the input, both have
/// an error of at most `u` times their size, and the lattice vectors of `u` times theirs. A
/// simulation that adds the vectors in this precision causes three more roundings. The tolerance is
/// eight roundings of single precision. For double precision it is much larger than eight
/// roundings, because such coordinates may have been computed, or read from a text.
fn tolerance(precision: Precision) -> f64 {
    match precision {
        Precision::F32 => 8.0 * pow2(-24),
        Precision::F64 => 1e-9,
    }
}

/// A closed curve, and an image of a yarn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub(crate) struct RingAndYarn {
    pub ring: u32,
    pub yarn: u32,
    /// Translation of the yarn, up to multiples of its period.
    pub image: Image,
    pub period: Image,
}

impl RingAndYarn {
    pub fn new(ring: u32, yarn: u32, image: Image, period: Image) -> RingAndYarn {
        RingAndYarn {
            ring,
            yarn,
            image: reduced(image, period),
            period,
        }
    }

    /// Returns the pair of curve `i` and curve `j` translated by `image`, if one of them is a yarn:
    /// a curve with a period in `periods`.
    pub fn between(
        i: u32,
        j: u32,
        image: Image,
        periods: [Option<Image>; 2],
    ) -> Option<RingAndYarn> {
        match periods {
            [None, Some(period)] => Some(RingAndYarn::new(i, j, image, period)),
            [Some(period), None] => Some(RingAndYarn::new(j, i, image.map(|n| -n), period)),
            _ => None,
        }
    }

    /// Returns the pair as certificates name it.
    pub fn pair(&self) -> ImagePair {
        let (i, j, image) = match self.ring < self.yarn {
            true => (self.ring, self.yarn, self.image),
            false => {
                let image = reduced(self.image.map(|n| -n), self.period);
                (self.yarn, self.ring, image)
            }
        };
        ImagePair { i, j, image }
    }
}

/// A yarn, and its period.
pub(crate) type YarnPeriod = (u32, Image);

/// Returns the period of the yarn if one of two curves is a yarn. `periods` is sorted.
pub(crate) fn period_of_pair(periods: &[YarnPeriod], i: u32, j: u32) -> Option<Image> {
    let period = |i: u32| {
        let k = periods.binary_search_by_key(&i, |p| p.0).ok()?;
        Some(periods[k].1)
    };
    period(i).xor(period(j))
}

/// Returns a canonical representative of a translation modulo a period.
pub(crate) fn reduced(image: Image, period: Image) -> Image {
    let Some(x) = (0..3).find(|&x| period[x] != 0) else {
        return image;
    };
    let times = image[x].div_euclid(period[x]);
    per_axis(|x| image[x].wrapping_sub(times.wrapping_mul(period[x])))
}

/// Returns true if a translation is a multiple of a period.
pub(crate) fn is_multiple(image: Image, period: Image) -> bool {
    reduced(image, period) == Image::default()
}

/// Returns the period of a curve, if it is open and ends at an image of its start: the translation
/// from its start to its end, in lattice vectors.
///
/// The end may differ from the image by the rounding of the coordinates: 4.8e-7 of the cell and of
/// their size in single precision, 1e-9 in double precision.
pub fn period(set: &CurveSet, i: usize, cell: &Cell) -> Option<Image> {
    period_in(set, i, cell, set.precision())
}

/// Same as [`period`], for coordinates that were given in this precision.
pub(crate) fn period_in(
    set: &CurveSet,
    i: usize,
    cell: &Cell,
    precision: Precision,
) -> Option<Image> {
    let ends = Ends::new(set, i, cell)?;
    let tolerance = tolerance(precision);
    let is_near = |x: usize| ends.off[x].abs() <= tolerance * ends.size[x];
    (0..3).all(is_near).then_some(ends.image)
}

/// The ends of an open curve.
struct Ends {
    /// The image of the start, other than the start itself, that is nearest to the end.
    image: Image,
    /// Difference of the end from that image along each direction.
    off: Point,
    /// Size of the cell and of both coordinates, along each direction.
    size: Point,
    /// Distance of the end from the image.
    distance: f64,
}

impl Ends {
    fn new(set: &CurveSet, i: usize, cell: &Cell) -> Option<Ends> {
        let curve = set.curve(i);
        if curve.closed {
            return None;
        }
        let inverse = cell.inverse()?;
        let [start, end] = [0, curve.segments as usize].map(|s| set.knot(i, s));
        let d = sub(end, start);
        let along = inverse.map(|b| dot(b, d));
        let periodic = cell.periodic();
        let nearest = per_axis(|x| if periodic[x] { along[x].round() } else { 0.0 });
        if nearest == [0.0; 3] || !nearest.iter().all(|n| n.abs() <= 1e6) {
            return None;
        }
        let image = nearest.map(|n| n as i32);
        let (units, by) = (cell.units(), cell.translation(image));
        let size_of = |b: &Point, p: &Point| (0..3).map(|x| (b[x] * p[x]).abs()).sum::<f64>();
        Some(Ends {
            image,
            off: sub(along, nearest),
            size: per_axis(|x| {
                units[x] + size_of(&inverse[x], &start) + size_of(&inverse[x], &end)
            }),
            distance: norm(sub(d, by)),
        })
    }
}

/// Returns a text that names the curves that almost run through the cell, but are treated as open
/// curves: their ends differ from an image of their starts by more than rounding, and by less than
/// their longest segment. `None` if there are none.
pub(crate) fn almost_yarns(set: &CurveSet, cell: &Cell) -> Option<String> {
    let mut almost = (0..set.len()).filter_map(|i| {
        let ends = Ends::new(set, i, cell)?;
        let segments = 0..set.curve(i).segments as usize;
        let lengths = segments.map(|s| norm(sub(set.knot(i, s + 1), set.knot(i, s))));
        let is_near = ends.distance <= lengths.fold(0.0, f64::max);
        (is_near && period(set, i, cell).is_none()).then_some((i, ends))
    });
    let (i, ends) = almost.next()?;
    let ([n1, n2, n3], distance) = (ends.image, significant(ends.distance));
    let n = almost.count() as u64;
    let others = if_any(n, || format!(", and so do {n} others"));
    Some(format!(
        "curve {i} almost runs through the cell{others}: its end is {distance} away from the image \
         {n1},{n2},{n3} of its start, more than rounding; it is taken for an open curve"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::{Basis, Positions};

    /// A yarn of four segments whose end is off by `gap`.
    fn yarn(gap: f64) -> CurveSet {
        let xyz: Vec<f64> = (0..5).flat_map(|k| [f64::from(k), 0.5, 0.0]).collect();
        let xyz = [&xyz[..12], &[4.0 + gap, 0.5, 0.0]].concat();
        CurveSet::from_counts(Basis::Polyline, &[5], Positions::F64(&xyz)).unwrap()
    }

    #[test]
    fn a_curve_that_almost_runs_through_the_cell_is_named_with_the_gap() {
        let cell: Cell = "4,4,4".parse().unwrap();
        for (gap, words) in [
            (1e-10, None),
            (
                1e-6,
                Some("is 1 x 10^-6 away from the image 1,0,0 of its start"),
            ),
            (
                -0.02,
                Some("is 0.02 away from the image 1,0,0 of its start"),
            ),
            // Further than the longest segment.
            (-1.2, None),
        ] {
            let set = yarn(gap);
            let found = almost_yarns(&set, &cell);
            let is_as_expected = match (&found, words) {
                (Some(found), Some(words)) => found.contains(words),
                (found, words) => found.is_none() && words.is_none(),
            };
            assert!(is_as_expected, "{gap}: {found:?}");
            assert_eq!(period(&set, 0, &cell).is_some(), gap == 1e-10);
        }
    }

    #[test]
    fn the_tolerance_of_a_period_is_a_share_of_the_cell_in_all_directions() {
        for unit in [1e-6, 1.0, 1e6] {
            for cell in ["4,4,4", "4,4,0", "4,0,0"] {
                let mut cell: Cell = cell.parse().unwrap();
                cell.vectors.iter_mut().flatten().for_each(|x| *x *= unit);
                for (off, expected) in [(1e-10, true), (1e-7, false)] {
                    let ends = [0.0, 0.0, 0.0, 2.0, 0.0, 1.0, 4.0, 0.0, 4.0 * off];
                    let xyz = ends.map(|x| unit * x);
                    let set = CurveSet::from_counts(Basis::Polyline, &[3], Positions::F64(&xyz));
                    let found = period(&set.unwrap(), 0, &cell).is_some();
                    assert_eq!(found, expected, "{unit} {cell} {off}");
                }
            }
        }
    }
}
