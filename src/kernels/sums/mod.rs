//! Kernels that sum the Gauss integral: a value with a proven error bound ([`Estimate`]).
//!
//! | kernel | terms | cost for n segments |
//! |---|---|---|
//! | [`direct`] | all segment pairs | n^2 |
//! | [`barnes_hut`] | node pairs of two trees | n log n |
//! | [`fmm`] | expansions of nodes about nodes | n |
//! | [`interval`] | all segment pairs, in interval arithmetic | n^2, some hundred times `direct` |
//!
//! [`Chain`] has the Gauss integrals that are no integers: of open curves, and of a curve and
//! itself.

#![allow(
    clippy::needless_range_loop,
    reason = "one index runs over lanes, axes or degrees of several arrays"
)]

pub(crate) mod barnes_hut;
mod chain;
mod descent;
pub(crate) mod direct;
mod estimate;
pub(crate) mod fmm;
pub(crate) mod interval;

pub(crate) use chain::Chain;
pub use estimate::Estimate;
pub(crate) use estimate::Summation;

use crate::curve::{CurveSet, Point};
use direct::Scale;
use rayon::prelude::*;

/// Makes something of each closed polyline for which `some` holds, a tree for example, from its
/// points, scaled so that coordinates are below 1. Other curves have no linking numbers, and get
/// `None`.
fn of_polylines<T: Send>(
    set: &CurveSet,
    some: impl Fn(u32) -> bool + Sync,
    make: impl Fn(&[Point]) -> T + Sync,
) -> Vec<Option<T>> {
    let scale = Scale::new(set.max_abs());
    let polyline = set.basis().is_polyline();
    let made = (0..set.len()).into_par_iter().map(|i| {
        let curve = set.curve(i);
        let fits = polyline && curve.closed && curve.points > 0 && some(i as u32);
        let points = || set.points_in(i).map(|p| p.map(|x| scale.apply(x)));
        fits.then(|| make(&points().collect::<Vec<Point>>()))
    });
    made.collect()
}

/// Runs two parts of the work on a tree, in parallel tasks if it is large.
fn join<A: Send, B: Send>(
    is_large: bool,
    first: impl FnOnce() -> A + Send,
    second: impl FnOnce() -> B + Send,
) -> (A, B) {
    match is_large {
        true => rayon::join(first, second),
        false => (first(), second()),
    }
}
