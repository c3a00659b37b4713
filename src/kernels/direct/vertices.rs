//! The vertices of closed polylines, as sums read them.

use super::block::Strip;
use crate::curve::{Axes, CurveSet};
use std::ops::Range;

/// The vertices of all closed polylines of a set in double precision, each with its first vertex again at its end, times
/// a power of two that brings them between -1 and 1: products of six lengths neither overflow nor, unless curves nearly
/// touch, underflow.
///
/// The scaling is exact but for coordinates below `2^-1022` after it, which are off by `2^-1075`.
#[derive(Debug)]
pub(crate) struct Vertices {
    axes: [Vec<f64>; 3],
    /// Those of each curve; empty where it has no linking numbers: an open curve, or a spline.
    curves: Vec<Range<usize>>,
    scale: Scale,
}

/// A power of two, as a product of two that are neither too large nor too small for a number.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scale([f64; 2]);

impl Scale {
    /// What brings numbers up to `largest` below 1.
    pub fn new(largest: f64) -> Scale {
        let power = |exponent: i32| f64::from_bits(((1023 + exponent) as u64) << 52);
        let exponent = (largest.to_bits() >> 52) as i32 - 1023;
        // Up to 2^1000: what is smaller yet stays small.
        let down = (exponent + 1).max(-1000);
        Scale([power(-(down / 2)), power(-(down - down / 2))])
    }

    /// The scaled number: exact but where it is below `2^-1022`.
    pub fn apply(self, x: f64) -> f64 {
        x * self.0[0] * self.0[1]
    }
}

impl Vertices {
    /// Copies them.
    pub fn new(set: &CurveSet) -> Vertices {
        let scale = Scale::new(set.max_abs());
        let mut axes = [0; 3].map(|_| Vec::with_capacity(set.points() + set.len()));
        let mut curves = Vec::with_capacity(set.len());
        for (i, curve) in set.curves().iter().enumerate() {
            let start = axes[0].len();
            if curve.closed && set.basis().is_polyline() {
                let body = set.body(i);
                for (x, to) in axes.iter_mut().enumerate() {
                    match set.axes() {
                        Axes::F32(v) => {
                            to.extend(v[x][body.clone()].iter().map(|&p| scale.apply(p.into())));
                        }
                        Axes::F64(v) => {
                            to.extend(v[x][body.clone()].iter().map(|&p| scale.apply(p)));
                        }
                    }
                    to.push(to[start]);
                }
            }
            curves.push(start..axes[0].len());
        }
        Vertices {
            axes,
            curves,
            scale,
        }
    }

    /// Those of curve `i`, if it is a closed polyline.
    pub fn of(&self, i: usize) -> Option<Strip<'_>> {
        let range = self.curves.get(i).filter(|range| !range.is_empty())?;
        Some(self.axes.each_ref().map(|v| &v[range.clone()]))
    }

    /// A length in the units of the set, in those of these vertices.
    pub fn scaled(&self, length: f64) -> f64 {
        self.scale.apply(length)
    }
}
