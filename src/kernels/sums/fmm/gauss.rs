//! Gauss integrals of single polylines, open or closed: of two of them, and of one and itself.

use super::tree::Tree;
use super::{Accept, Fmm, Options};
use crate::curve::Point;
use crate::kernels::{Estimate, Summation};
use crate::pairs::Pair;

/// Approximate maximum work, in microseconds of one core. A sum that needs more has a larger bound.
const LIMIT: f64 = 6e7;

/// Error bounds above this are not tried, because they would be of no use.
const LARGEST: f64 = 10.0;

/// Returns the Gauss integral of two polylines, at an accuracy of `budget` if possible. Both have a
/// segment, and coordinates are at most 1.
pub(in crate::kernels::sums) fn between(chains: [(&[Point], bool); 2], budget: f64) -> Estimate {
    within(&chains, (0, 1), budget)
}

/// Returns the Gauss integral of a polyline and itself over all unordered pairs of segments, at an
/// accuracy of `budget` if possible. Coordinates are at most 1, and no two consecutive points are
/// the same.
pub(in crate::kernels::sums) fn itself(points: &[Point], closed: bool, budget: f64) -> Estimate {
    within(&[(points, closed)], (0, 0), budget)
}

fn within(chains: &[(&[Point], bool)], pair: Pair, budget: f64) -> Estimate {
    let tree = |&(points, closed): &(&[Point], bool)| Some(Tree::of(points, closed));
    let mut fmm = Fmm {
        options: Options {
            limit: LIMIT,
            ..Options::default()
        },
        trees: chains.iter().map(tree).collect(),
        cancel: None,
    };
    let mut budget = budget;
    loop {
        fmm.options.accept = Accept::Within(budget);
        let sum = fmm.linking_number(pair);
        if sum.bound.is_finite() || budget > LARGEST {
            return sum;
        }
        budget *= 10.0;
    }
}
