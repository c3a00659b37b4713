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
//! `Lk` costs as much as counting crossings, `Wr` as much as [`crate::kernels::sums`]; `Tw` is
//! linear. Polylines only: the writhe of a spline changes when it is replaced by a polyline.

mod gauss;
mod pairing;
#[cfg(test)]
mod tests;
mod twist;

pub use gauss::GaussIntegrals;
pub use pairing::{Pairing, PairingReason};

use crate::curve::vector::per_axis;
use crate::curve::{CurveSet, Point};
use crate::error::{Error, Result};
use crate::kernels::crossings::{Input, Workspaces, linking_number};
use crate::kernels::{Chain, Estimate, Linking, sums::direct::Scale};
use crate::pairs::Trees;
use crate::pool;
use crate::verdict::{DefectKind, Place};
use std::time::{Duration, Instant};

/// Axis of a ribbon: the curve whose writhe is measured, and about which the ribbon twists.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Axis {
    /// The centre line of both strands, as for DNA. Each of its vertices is halfway between a pair
    /// of vertices, rounded to double precision. If the paired vertices are not on opposite sides
    /// of the axis of the helix, the centre line winds around that axis.
    #[default]
    Centre,
    /// The first curve; the second one is an edge of the ribbon.
    First,
}

/// Options of [`Ribbon::of`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RibbonOptions {
    /// Axis of the ribbon.
    pub axis: Axis,
    /// Pairing of the vertices. `None`: found from the order and the distances of the vertices.
    pub pairing: Option<Pairing>,
    /// Error bound of the writhe that is reached, if possible.
    pub tolerance: f64,
}

impl Default for RibbonOptions {
    fn default() -> Self {
        RibbonOptions {
            axis: Axis::Centre,
            pairing: None,
            tolerance: 1e-4,
        }
    }
}

/// Linking number, twist and writhe of a closed ribbon between two curves.
#[derive(Clone, Debug)]
pub struct Ribbon {
    /// Exact linking number of the two curves, which run in the same direction. `None` if they
    /// touch.
    pub linking: Option<i64>,
    /// The place where the curves touch, if they do.
    pub contact: Option<(DefectKind, Place)>,
    /// Twist of the ribbon about its axis, in turns.
    pub twist: Estimate,
    /// Writhe of the axis.
    pub writhe: Estimate,
    /// Pairing of the vertices. If it is antiparallel, the second curve was reversed.
    pub pairing: Pairing,
    /// Reason why this pairing was taken.
    pub reason: PairingReason,
    /// Pairings that fit nearly as well, but give another twist, with that twist. Empty if the
    /// pairing was given.
    pub rivals: Vec<(Pairing, Estimate)>,
    /// Times that linking number, twist and writhe took.
    pub times: [Duration; 3],
}

impl Ribbon {
    /// Computes linking number, twist and writhe of the ribbon between two curves of a set, which
    /// must be closed polylines with the same number of vertices.
    ///
    /// ```
    /// use linkwatch::scenes::Scene;
    /// use linkwatch::{Pairing, Ribbon, RibbonOptions};
    ///
    /// let curves = "ribbon:segments=400,lambda=3".parse::<Scene>()?.build()?.curves;
    /// let ribbon = Ribbon::of(&curves, [0, 1], RibbonOptions::default())?;
    /// assert_eq!((ribbon.linking, ribbon.pairing), (Some(3), Pairing::PARALLEL));
    /// assert!((ribbon.twist.value - 3.0).abs() < 0.01);
    /// # Ok::<(), linkwatch::Error>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`Error::Usage`] if the curves cannot be the strands of a ribbon.
    pub fn of(set: &CurveSet, [i, j]: [usize; 2], options: RibbonOptions) -> Result<Ribbon> {
        pool::check_process()?;
        check(set, [i, j])?;
        let scale = Scale::new(set.max_abs());
        let points = |i: usize| set.points_in(i).map(|p| p.map(|x| scale.apply(x)));
        let [first, second]: [Vec<Point>; 2] = [i, j].map(|i| points(i).collect());
        let (pairing, reason, rivals) = match options.pairing {
            Some(pairing) => (pairing, PairingReason::Given, Vec::new()),
            None => pairing::find([&first, &second]),
        };
        let start = Instant::now();
        let linking = count(&set.subset(&[i as u32, j as u32]));
        let counted = start.elapsed();
        let (axis, twist) = twist_about(options.axis, &first, &pairing.apply(&second));
        let twisted = start.elapsed();
        let writhe = Chain::new(axis, true).writhe(options.tolerance);
        let times = [counted, twisted - counted, start.elapsed() - twisted];
        let rivals = rivals.into_iter().map(|rival| {
            let (_, twist) = twist_about(options.axis, &first, &rival.apply(&second));
            (rival, twist)
        });
        let differs = |other: &Estimate| {
            let apart = (other.value - twist.value).abs();
            apart > other.bound + twist.bound + TWIST_DIFFERS
        };
        let (linking, contact) = match linking {
            Linking::Number(n) if pairing.antiparallel => (Some(-n), None),
            Linking::Number(n) => (Some(n), None),
            Linking::Undefined(kind, place) => (None, Some((kind, place))),
        };
        Ok(Ribbon {
            linking,
            contact,
            twist,
            writhe,
            pairing,
            reason,
            rivals: rivals.filter(|(_, twist)| differs(twist)).collect(),
            times,
        })
    }

    /// Returns `Lk - Tw - Wr`: 0 for a ribbon that does not pass through itself, otherwise an
    /// integer.
    pub fn residual(&self) -> Estimate {
        let turns = self.twist.plus(self.writhe).negated();
        let residual = |linking: i64| Estimate::new(linking as f64, 0.0).plus(turns);
        self.linking.map_or(Estimate::UNKNOWN, residual)
    }

    /// Returns the signed number of passages of the ribbon through itself: 0 for a ribbon without
    /// any. `None` if the bound of the residual admits several numbers.
    pub fn passages(&self) -> Option<i64> {
        self.residual().integer()
    }
}

/// Two pairings agree if their twists, in turns, differ by at most this.
const TWIST_DIFFERS: f64 = 0.01;

/// Returns the axis of a ribbon between two strands with paired vertices, and the twist about it.
fn twist_about(axis: Axis, first: &[Point], second: &[Point]) -> (Vec<Point>, Estimate) {
    // The vector from the centre line to the first strand is half of that from the second strand to
    // the first one.
    let (axis, edge) = match axis {
        Axis::First => (first.to_vec(), second),
        Axis::Centre => {
            let both = first.iter().zip(second);
            let halfway = |(a, b): (&Point, &Point)| per_axis(|x| 0.5 * (a[x] + b[x]));
            (both.map(halfway).collect(), first)
        }
    };
    let twist = twist::twist(&axis, edge).estimate();
    (axis, twist)
}

/// Checks that two curves may be the strands of a ribbon.
fn check(set: &CurveSet, [i, j]: [usize; 2]) -> Result<()> {
    let fail = |what: String| {
        let what = format!("ribbon of curves {i} and {j}: {what}");
        Err(Error::Usage(what))
    };
    if i == j || i.max(j) >= set.len() {
        let last = set.len() - 1;
        return fail(format!("expected two different curves of 0 to {last}"));
    }
    gauss::check_polylines(set)?;
    if let Some(open) = [i, j].into_iter().find(|&i| !set.curve(i).closed) {
        return fail(format!("curve {open} is open"));
    }
    let [n, m] = [i, j].map(|i| set.curve(i).points);
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
