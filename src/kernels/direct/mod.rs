//! Direct summation: the Gauss linking integral, exact for polylines, over all pairs of segments.
//!
//! Source: Arai 2013 for the term, Bertolazzi et al. 2019 and Qu & James 2021 (section 3.4.2 and algorithm 7) for the sum
//! without arctangents, with these changes: one argument a pair instead of two, which is enough because the angle of a
//! pair stays below half a turn; a bound of every term and of the sum ([`block`]); quarter turns are counted instead of
//! half turns, so that no count is in doubt; vectors of columns instead of one running product.
//!
//! Cost: quadratic, whatever the curves look like.
//! Beaten by every other kernel on curves of many segments; what they are measured against, and what ends them.
//! Undefined: curves that touch or nearly touch get a bound of 1/2 or more.

pub(crate) mod block;
#[cfg(test)]
pub(super) mod tests;
mod vertices;

pub(crate) use block::Formula;
#[cfg(feature = "gpu")]
pub(crate) use vertices::Scale;
pub(crate) use vertices::Vertices;

use super::{Estimate, Summation};
use crate::curve::CurveSet;
use crate::pairs::Pair;
use block::{Strip, Sum};
use rayon::prelude::*;
use std::ops::Range;

/// Rows that make a task: segments of the curve with more of them.
const ROWS: usize = 64;

/// Pairs of segments from which on rows are shared out among threads.
const GRAIN: usize = 1 << 14;

/// Direct summation over the pairs of a set of polylines.
#[derive(Debug)]
pub(crate) struct Direct {
    vertices: Vertices,
    formula: Formula,
}

impl Direct {
    /// Copies the vertices of all closed polylines.
    pub fn new(set: &CurveSet, formula: Formula) -> Direct {
        Direct {
            vertices: Vertices::new(set),
            formula,
        }
    }

    /// What some rows contribute.
    fn task(&self, rows: Strip<'_>, columns: Strip<'_>, range: Range<usize>) -> Estimate {
        let rows = rows.map(|v| &v[range.start..=range.end]);
        block::gauss_sum(self.formula, rows, columns)
    }
}

impl Summation for Direct {
    fn linking_number(&self, (i, j): Pair) -> Estimate {
        let curve = |i: u32| self.vertices.of(i as usize);
        let (true, Some(first), Some(second)) = (i != j, curve(i), curve(j)) else {
            return Estimate::UNKNOWN;
        };
        let segments = |strip: Strip<'_>| strip[0].len() - 1;
        // The same sum whichever curve is named first.
        let (rows, columns) = match (segments(first), i) {
            (n, i) if (n, i) > (segments(second), j) => (first, second),
            _ => (second, first),
        };
        let n = segments(rows);
        let range = |k: usize| k * ROWS..n.min((k + 1) * ROWS);
        let tasks = n.div_ceil(ROWS);
        let mut sum = Sum::default();
        if n * segments(columns) < GRAIN {
            for k in 0..tasks {
                sum.add(self.task(rows, columns, range(k)));
            }
        } else {
            let parts: Vec<Estimate> = (0..tasks)
                .into_par_iter()
                .map(|k| self.task(rows, columns, range(k)))
                .collect();
            for part in parts {
                sum.add(part);
            }
        }
        sum.estimate()
    }
}
