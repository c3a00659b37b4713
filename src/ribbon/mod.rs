//! Writhe of curves, linking integrals of open curves, and linking number, twist and writhe of
//! ribbons such as closed DNA.
//!
//! # `Lk = Tw + Wr` for polygons
//!
//! Let two closed polygons have `n` vertices each, and let the ribbon that joins them be that of
//! [`twist`], from its axis `A` to its edge `B`. If no vector `u` across the ribbon is parallel to
//! the tangent of the axis there, then
//!
//! ```text
//! Tw + Wr(A) = Lk(A, A + s u) for all small s > 0, an integer.
//! ```
//!
//! Proof. With its corners rounded by arcs of radius `r`, the axis has a continuous tangent and
//! piecewise continuous curvature, and `u` is a continuous, piecewise smooth field across it. For
//! these the theorem of Calugareanu (1961), White (1969) and Fuller (1971) holds. As `r` decreases:
//!
//! - The twist does not depend on `r`: see [`twist`].
//! - The writhe converges to that of the polygon. The integrand vanishes for the pairs of points of
//!   two adjacent segments and of the arc between them, which lie in a plane. All other pairs with
//!   a point on an arc keep a distance, and the lengths of the arcs decrease to 0.
//! - The linking number does not change, because the polygons do not meet.
//!
//! `Lk(A, B) = Lk(A, A + s u)` if the ribbon does not pass through its axis, that is, if `A + t u`
//! does not meet `A` for `t` from `s` to 1. In general both differ by the signed number of such
//! passages, an integer. The same holds if the axis is the centre line of two strands: `Lk` of the
//! strands differs by the number of passages of `A - t u` through `A + t u`.
//!
//! So [`Ribbon::residual`], `Lk - Tw - Wr`, is 0 for every ribbon that does not pass through
//! itself, and an integer for all others. It compares three independent computations: an exact
//! count of crossings, a sum along the ribbon, and a sum over all pairs of segments of the axis.
//!
//! # Cost and limits
//!
//! That of counting crossings for `Lk`, linear for `Tw`, that of [`crate::kernels::sums`] for `Wr`.
//! Polylines only: the writhe of a spline changes when it is replaced by a polyline.

mod gauss;
#[cfg(test)]
mod tests;
mod twist;

pub use gauss::GaussIntegrals;

use crate::curve::{CurveSet, Point};
use crate::error::{Error, Result};
use crate::kernels::crossings::{Input, Workspaces, linking_number};
use crate::kernels::{Chain, Estimate, Linking, sums::direct::Scale};
use crate::pairs::Trees;
use crate::verdict::{DefectKind, Place};
use std::time::{Duration, Instant};

/// Axis of a ribbon: the curve whose writhe counts, about which the ribbon twists.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Axis {
    /// The centre line of both strands, as for DNA: its vertices are halfway between theirs,
    /// rounded to double precision.
    #[default]
    Centre,
    /// The first curve; the second one is an edge of the ribbon.
    First,
}

/// Linking number, twist and writhe of a closed ribbon between two curves.
#[derive(Clone, Debug)]
pub struct Ribbon {
    /// Linking number of the two curves, in the same direction, exact. `None` if they touch.
    pub linking: Option<i64>,
    /// The place where the curves touch, if they do.
    pub contact: Option<(DefectKind, Place)>,
    /// Twist of the ribbon about its axis, in turns.
    pub twist: Estimate,
    /// Writhe of the axis.
    pub writhe: Estimate,
    /// True if the second curve was reversed, because it runs against the first one, as the second
    /// strand of DNA usually does.
    pub reversed: bool,
    /// Times to compute linking number, twist and writhe.
    pub times: [Duration; 3],
}

impl Ribbon {
    /// Computes linking number, twist and writhe of the ribbon between two curves of a set. The
    /// bound of the writhe is at most `tolerance` if possible.
    ///
    /// The curves must be closed polylines with the same number of vertices. Vertex `k` of the
    /// first one belongs to vertex `k` of the second one; or to vertex `n - 1 - k` or `n - k`, if
    /// the sum of the squared distances is smaller then, because the strands run in opposite
    /// directions.
    pub fn of(set: &CurveSet, [i, j]: [usize; 2], axis: Axis, tolerance: f64) -> Result<Ribbon> {
        check(set, [i, j])?;
        let scale = Scale::new(set.max_abs());
        let points = |i: usize| -> Vec<Point> {
            let n = set.curve(i).points as usize;
            (0..n)
                .map(|k| set.point(i, k).map(|x| scale.apply(x)))
                .collect()
        };
        let first = points(i);
        let (second, reversed) = align(&first, &points(j));
        let axis = match axis {
            Axis::First => first.clone(),
            Axis::Centre => {
                let both = first.iter().zip(&second);
                let halfway = |(a, b): (&Point, &Point)| [0, 1, 2].map(|x| 0.5 * (a[x] + b[x]));
                both.map(halfway).collect()
            }
        };
        let start = Instant::now();
        let linking = count(&set.subset(&[i as u32, j as u32]));
        let counted = start.elapsed();
        // The first strand is half as far from the centre line as from the second strand.
        let edge = match axis == first {
            true => &second,
            false => &first,
        };
        let twist = twist::twist(&axis, edge).estimate();
        let twisted = start.elapsed();
        let writhe = Chain::new(axis, true).writhe(tolerance);
        let (linking, contact) = match linking {
            Linking::Number(n) => (Some(if reversed { -n } else { n }), None),
            Linking::Undefined(kind, place) => (None, Some((kind, place))),
        };
        Ok(Ribbon {
            linking,
            contact,
            twist,
            writhe,
            reversed,
            times: [counted, twisted - counted, start.elapsed() - twisted],
        })
    }

    /// Returns `Lk - Tw - Wr`: 0 for a ribbon, a different integer if it passes through itself.
    pub fn residual(&self) -> Estimate {
        let Some(linking) = self.linking else {
            return Estimate::UNKNOWN;
        };
        let linking = Estimate {
            value: linking as f64,
            bound: 0.0,
        };
        let sum = self.twist.plus(self.writhe).negated();
        linking.plus(sum)
    }

    /// Returns the signed number of passages of the ribbon through itself: 0 for a ribbon without
    /// any. `None` if the bound of the residual admits several numbers.
    pub fn passages(&self) -> Option<i64> {
        self.residual().integer()
    }
}

/// Checks that two curves may be the strands of a ribbon.
fn check(set: &CurveSet, [i, j]: [usize; 2]) -> Result<()> {
    let fail = |what: String| {
        Err(Error::Usage(format!(
            "ribbon of curves {i} and {j}: {what}"
        )))
    };
    if i == j || i.max(j) >= set.len() {
        return fail(format!(
            "expected two different curves of 0 to {}",
            set.len() - 1
        ));
    }
    gauss::check_polylines(set)?;
    let curves = [i, j].map(|i| set.curve(i));
    if let Some(k) = curves.iter().position(|c| !c.closed) {
        return fail(format!("curve {} is open", [i, j][k]));
    }
    let [n, m] = curves.map(|c| c.points);
    if n != m {
        return fail(format!(
            "{n} and {m} vertices; both strands need the same number, one for each rung"
        ));
    }
    Ok(())
}

/// Counts the linking number of the two curves of a set.
fn count(pair: &CurveSet) -> Linking {
    let mut trees = Trees::default();
    trees.refit(pair);
    let workspaces = Workspaces::default();
    let input = Input {
        set: pair,
        trees: &trees,
        workspaces: &workspaces,
    };
    linking_number(input, (0, 1), None, &mut workspaces.take())
}

/// Returns the second strand in the order of the first one, and whether it was reversed.
///
/// Strands are not shifted along each other: the nearest point of the other strand of DNA is not
/// the opposite one.
fn align(first: &[Point], second: &[Point]) -> (Vec<Point>, bool) {
    let n = first.len();
    let square = |a: &Point, b: &Point| (0..3).map(|x| (a[x] - b[x]).powi(2)).sum::<f64>();
    let last = n.saturating_sub(1);
    // Vertex k, or n - 1 - k, or n - k of the second strand belongs to vertex k of the first one.
    let ways = [(0, false), (last, true), (0, true)];
    let at = |(start, reversed): (usize, bool), k: usize| match reversed {
        false => second[k],
        true => second[(start + n - k) % n],
    };
    let distance = |way| -> f64 { (0..n).map(|k| square(&first[k], &at(way, k))).sum() };
    let ways = ways.map(|way| (way, distance(way)));
    let best = ways.into_iter().min_by(|a, b| a.1.total_cmp(&b.1));
    let way = best.map_or((0, false), |(way, _)| way);
    ((0..n).map(|k| at(way, k)).collect(), way.1)
}
