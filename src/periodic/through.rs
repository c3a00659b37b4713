//! Curves that run through the cell: yarns that close up to a lattice vector, their period.
//!
//! Such a curve is given as an open curve from a vertex to an image of that vertex. Together with
//! its images by the multiples of its period it is an infinite curve without ends. Two of them have
//! no linking number, but the linking number of a closed curve and an infinite one exists: the
//! closed curve lies in a box, and all ways to close the infinite one outside of this box give the
//! same number ([`linking`](super::linking)).

use super::ImagePair;
use crate::curve::{Cell, CurveSet, Image};

/// Largest distance of the end of a curve from the image of its start, as a share of the cell.
const TOLERANCE: f64 = 1e-9;

/// A closed curve, and an infinite curve translated by a lattice vector.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
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
    /// it has one of these periods.
    pub fn between(
        (i, j): (u32, u32),
        image: Image,
        periods: [Option<Image>; 2],
    ) -> Option<RingAndYarn> {
        match periods {
            [None, Some(period)] => Some(RingAndYarn::new(i, j, image, period)),
            [Some(period), None] => Some(RingAndYarn::new(j, i, image.map(|n| -n), period)),
            _ => None,
        }
    }

    /// Returns the pair under the name that certificates have for it.
    pub fn pair(&self) -> ImagePair {
        match self.ring < self.yarn {
            true => ImagePair {
                i: self.ring,
                j: self.yarn,
                image: self.image,
            },
            false => ImagePair {
                i: self.yarn,
                j: self.ring,
                image: reduced(self.image.map(|n| -n), self.period),
            },
        }
    }
}

/// A yarn that runs through the cell, and its period.
pub(crate) type YarnPeriod = (u32, Image);

/// Returns the period of the yarn if one of two curves is a yarn. `periods` is sorted.
pub(crate) fn period_of_pair(periods: &[YarnPeriod], i: u32, j: u32) -> Option<Image> {
    let period = |i: u32| {
        let k = periods.binary_search_by_key(&i, |p| p.0).ok()?;
        Some(periods[k].1)
    };
    period(i).xor(period(j))
}

/// Returns a translation that differs by a multiple of a period, the same one for all that do.
pub(crate) fn reduced(image: Image, period: Image) -> Image {
    let Some(x) = (0..3).find(|&x| period[x] != 0) else {
        return image;
    };
    let times = image[x].div_euclid(period[x]);
    [0, 1, 2].map(|x| image[x].wrapping_sub(times.wrapping_mul(period[x])))
}

/// Returns true if a translation is a multiple of a period.
pub(crate) fn is_multiple(image: Image, period: Image) -> bool {
    reduced(image, period) == Image::default()
}

/// Returns the period of a curve, if it is open and ends at an image of its start: the translation
/// from its start to its end, in vectors of the cell.
pub fn period(set: &CurveSet, i: usize, cell: &Cell) -> Option<Image> {
    let curve = set.curve(i);
    if curve.closed {
        return None;
    }
    let inverse = cell.inverse()?;
    let [start, end] = [0, curve.segments as usize].map(|s| set.knot(i, s));
    let d = [0, 1, 2].map(|x| end[x] - start[x]);
    let mut period = Image::default();
    for (x, b) in inverse.iter().enumerate() {
        let u = b[0] * d[0] + b[1] * d[1] + b[2] * d[2];
        let nearest = if cell.periodic()[x] { u.round() } else { 0.0 };
        let size = (0..3).map(|k| (b[k] * start[k]).abs()).sum::<f64>();
        let near = (u - nearest).abs() <= TOLERANCE * (1.0 + size);
        if !near || nearest.abs() > 1e6 {
            return None;
        }
        period[x] = nearest as i32;
    }
    (period != Image::default()).then_some(period)
}
