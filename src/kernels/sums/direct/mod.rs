//! Direct summation: the Gauss linking integral over all segment pairs, exact for polylines.
//!
//! # Method
//!
//! Source: Arai 2013 for the term, Bertolazzi et al. 2019 and Qu & James 2021 (section 3.4.2 and
//! algorithm 7) for the sum without arctangents, with these changes:
//!
//! * One argument for each pair instead of two. One is enough, because the angle of a pair is below
//!   half a turn.
//! * A bound of every term and of the sum ([`block`]).
//! * Quarter turns are counted instead of half turns, so that no count is uncertain.
//! * Columns are vectorized, instead of one running product.
//!
//! # Cost and limits
//!
//! Cost: quadratic for all curves. Every other kernel is faster on curves of many segments. This
//! kernel is the reference for their timings, and sums their near pairs.
//!
//! Undefined: curves that touch or nearly touch get an error bound of 1/2 or more.

pub(crate) mod block;
#[cfg(test)]
pub(super) mod tests;
mod vertices;

pub(crate) use block::Formula;
pub(crate) use vertices::{Scale, Vertices};

use super::{Estimate, Summation};
use crate::curve::CurveSet;
use crate::pairs::Pair;
use block::{Strip, Sum};
use rayon::prelude::*;

/// Number of rows of a task: segments of the curve with more segments.
const ROWS: usize = 64;

/// Number of segment pairs above which the rows are split into parallel tasks.
const GRAIN: usize = 1 << 14;

/// Direct summation for all pairs of a set of polylines.
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
}

impl Summation for Direct {
    fn linking_number(&self, (i, j): Pair) -> Estimate {
        let curve = |i: u32| self.vertices.of(i as usize);
        let (true, Some(first), Some(second)) = (i != j, curve(i), curve(j)) else {
            return Estimate::UNKNOWN;
        };
        let segments = |strip: Strip<'_>| strip[0].len() - 1;
        // The sum does not depend on the order of the curves.
        let (rows, columns) = match (segments(first), i) {
            (n, i) if (n, i) > (segments(second), j) => (first, second),
            _ => (second, first),
        };
        let n = segments(rows);
        let task = |k: usize| {
            let rows = rows.map(|v| &v[k * ROWS..=n.min((k + 1) * ROWS)]);
            block::gauss_sum(self.formula, rows, columns)
        };
        let tasks = 0..n.div_ceil(ROWS);
        let mut sum = Sum::default();
        if n * segments(columns) < GRAIN {
            tasks.for_each(|k| sum.add(task(k)));
        } else {
            let parts: Vec<Estimate> = tasks.into_par_iter().map(task).collect();
            parts.into_iter().for_each(|part| sum.add(part));
        }
        sum.estimate()
    }
}
