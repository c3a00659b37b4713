//! Pairing of the vertices of two strands: which vertex of the second strand belongs to which one
//! of the first.
//!
//! # Rule
//!
//! A pairing is a direction and a shift, so two strands of `n` vertices have `2 n` pairings. The
//! distance of paired vertices is nearly constant along a ribbon, because something holds the
//! strands together: the base pairs of DNA, the material of a strip. The nearest vertices need not
//! be paired. In DNA, they are three to four bases off, across a groove of the helix.
//!
//! 1. The direction is that of the pairing with the smallest mean distance.
//! 2. *Close* pairings have this direction, and a mean distance of at most [`NEAR`] times the
//!    smallest one.
//! 3. If the order of the vertices gives a close pairing, it is used: `k` with `k`; or, for strands
//!    in opposite directions, `k` with `n - 1 - k`, as in files of DNA, else `k` with `n - k`,
//!    which is a reversed curve with the same first vertex.
//! 4. Otherwise the pairing with the smallest spread (standard deviation) of distances is used. If
//!    several spreads are equal, the shortest centre line decides, then the smallest distance.
//! 5. A close pairing whose distances are constant up to rounding ([`RIGID`]) is preferred to the
//!    order of the vertices, if the distances of the latter are not constant.
//!
//! The rule cannot find the pairing if thermal motion hides the differences of distances. So other
//! close pairings whose distances have a similar spread are returned as alternatives.
//!
//! # Cost
//!
//! Linear: all pairings are compared at [`SAMPLES`] vertices at most.

use crate::curve::Point;
use crate::curve::vector::{norm, per_axis, sub};
use crate::error::{Error, Result};
use rayon::prelude::*;
use std::fmt;
use std::str::FromStr;

/// Maximum ratio of the mean distance of a close pairing to the smallest one. In B-DNA the
/// phosphates of a base pair are 1.8 times as far apart as those across the minor groove.
const NEAR: f64 = 2.0;

/// Spreads of distances count as similar if their ratio is at most this.
const SIMILAR: f64 = 1.25;

/// Distances count as constant if their spread is at most this share of their mean, which covers
/// the rounding of coordinates in single precision.
const RIGID: f64 = 1e-5;

/// Maximum number of vertices at which pairings are compared.
const SAMPLES: usize = 256;

/// Maximum number of alternative pairings that are returned.
const RIVALS: usize = 4;

/// Maps each vertex of the first strand to its partner on the second strand.
///
/// Displayed as `parallel`, `antiparallel`, or one of these with a shift, `antiparallel:1`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pairing {
    /// True if the strands run in opposite directions, as those of DNA do.
    pub antiparallel: bool,
    /// Shift of the second strand: vertex `k` belongs to vertex `k + shift`, or to vertex
    /// `n - 1 - k + shift` if the strands are antiparallel, modulo their number of vertices `n`.
    pub shift: usize,
}

impl Pairing {
    /// Pairs vertex `k` with vertex `k`.
    pub const PARALLEL: Pairing = Pairing {
        antiparallel: false,
        shift: 0,
    };

    /// Returns the vertex of the second strand that belongs to vertex `k < n` of the first one.
    pub fn partner(self, k: usize, n: usize) -> usize {
        let start = if self.antiparallel { n - 1 - k } else { k };
        (start + self.shift % n) % n
    }

    /// Returns the second strand in the order of the first one.
    pub(super) fn apply(self, second: &[Point]) -> Vec<Point> {
        let n = second.len();
        (0..n).map(|k| second[self.partner(k, n)]).collect()
    }

    /// Returns a text for the pairing: `antiparallel, vertex k with n - 1 - k`.
    pub fn words(self) -> String {
        let partner = if self.antiparallel { "n - 1 - k" } else { "k" };
        match (self.word(), self.shift) {
            (word, 0) => format!("{word}, vertex k with {partner}"),
            (word, shift) => format!("{word}, vertex k with {partner} + {shift}"),
        }
    }

    fn word(self) -> &'static str {
        match self.antiparallel {
            false => "parallel",
            true => "antiparallel",
        }
    }
}

impl fmt::Display for Pairing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self.word(), self.shift) {
            (word, 0) => write!(f, "{word}"),
            (word, shift) => write!(f, "{word}:{shift}"),
        }
    }
}

impl FromStr for Pairing {
    type Err = Error;

    fn from_str(text: &str) -> Result<Pairing> {
        let (word, shift) = text.split_once(':').unwrap_or((text, "0"));
        match (word, shift.parse()) {
            ("parallel" | "antiparallel", Ok(shift)) => Ok(Pairing {
                antiparallel: word == "antiparallel",
                shift,
            }),
            _ => Err(Error::Usage(format!(
                "pairing {text:?}: expected auto, parallel, antiparallel, or one of the last two \
                 with a shift, antiparallel:1 for example"
            ))),
        }
    }
}

/// Reason why a pairing was taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum PairingReason {
    /// The caller gave it.
    Given,
    /// The order of the vertices gives a pairing of close vertices.
    Order,
    /// The distances of paired vertices vary least.
    Distances,
}

/// Distances of the paired vertices of a pairing.
#[derive(Clone, Copy)]
struct Distances {
    pairing: Pairing,
    mean: f64,
    /// Standard deviation.
    spread: f64,
}

impl Distances {
    fn of(pairing: Pairing, [first, second]: [&[Point]; 2], samples: &[usize]) -> Distances {
        let n = first.len();
        let distance = |k: usize| norm(sub(first[k], second[pairing.partner(k, n)]));
        let count = samples.len() as f64;
        let mean = samples.iter().map(|&k| distance(k)).sum::<f64>() / count;
        let square = |&k: &usize| (distance(k) - mean).powi(2);
        let spread = (samples.iter().map(square).sum::<f64>() / count).sqrt();
        Distances {
            pairing,
            mean,
            spread,
        }
    }

    /// Returns true if the spread is smaller than that of another pairing, or similar to it.
    fn is_similar(&self, other: &Distances) -> bool {
        self.spread <= SIMILAR * other.spread + 1e-2 * RIGID * other.mean
    }
}

/// Finds the pairing of two strands with the same number of vertices. Returns it with the reason
/// for the choice, and the pairings that are nearly as good.
pub(super) fn find(strands: [&[Point]; 2]) -> (Pairing, PairingReason, Vec<Pairing>) {
    let n = strands[0].len();
    let samples = samples(n);
    let all = (0..2 * n).into_par_iter().map(|p| {
        let (antiparallel, shift) = (p >= n, p % n);
        let pairing = Pairing {
            antiparallel,
            shift,
        };
        Distances::of(pairing, strands, &samples)
    });
    let all: Vec<Distances> = all.collect();
    let by_mean = |a: &&Distances, b: &&Distances| a.mean.total_cmp(&b.mean);
    let nearest = *all.iter().min_by(by_mean).expect("strands have vertices");
    let antiparallel = nearest.pairing.antiparallel;
    let close =
        |d: &&Distances| d.pairing.antiparallel == antiparallel && d.mean <= NEAR * nearest.mean;
    let close: Vec<Distances> = all.iter().filter(close).copied().collect();
    let by_spread = |a: &&Distances, b: &&Distances| a.spread.total_cmp(&b.spread);
    let best = close.iter().min_by(by_spread);
    let best = *best.expect("the nearest is close");
    let last = usize::from(antiparallel);
    let usual = close.iter().find(|d| d.pairing.shift <= last);
    let overruled = |order: &Distances| {
        best.spread <= RIGID * best.mean
            && order.spread > 10.0 * best.spread
            && !order.is_similar(&best)
    };
    let (taken, reason) = match usual {
        Some(order) if !overruled(order) => (*order, PairingReason::Order),
        _ => {
            let smoothest = smoothest(&close, best, strands, &samples);
            (smoothest, PairingReason::Distances)
        }
    };
    let rival = |d: &&Distances| {
        let ordered = usual.is_some_and(|order| order.pairing == d.pairing);
        d.pairing != taken.pairing && (ordered || d.is_similar(&taken))
    };
    let rivals: Vec<Pairing> = close.iter().filter(rival).map(|d| d.pairing).collect();
    let step = rivals.len().div_ceil(RIVALS).max(1);
    let rivals = rivals.into_iter().step_by(step).collect();
    (taken.pairing, reason, rivals)
}

/// Returns the pairing with the shortest centre line of those whose spread is similar to the best
/// one. Among lengths that agree to a hundredth, the pairing with the smallest mean distance.
fn smoothest(
    close: &[Distances],
    best: Distances,
    [first, second]: [&[Point]; 2],
    samples: &[usize],
) -> Distances {
    let n = first.len();
    let length = |d: &Distances| -> f64 {
        let centre = |k: usize| {
            let (a, b) = (first[k % n], second[d.pairing.partner(k % n, n)]);
            per_axis(|x| 0.5 * (a[x] + b[x]))
        };
        let step = |&k: &usize| norm(sub(centre(k + 1), centre(k)));
        samples.iter().map(step).sum()
    };
    let similar = close.iter().filter(|d| d.is_similar(&best));
    let similar: Vec<(f64, &Distances)> = similar.map(|d| (length(d), d)).collect();
    let shortest = similar.iter().map(|s| s.0).fold(f64::INFINITY, f64::min);
    let short = similar.iter().filter(|s| s.0 <= 1.01 * shortest);
    let nearest = short.min_by(|a, b| a.1.mean.total_cmp(&b.1.mean));
    nearest.map_or(best, |s| *s.1)
}

/// Returns the vertices at which pairings are compared. They are spread by the golden ratio,
/// because equal steps could be in phase with the turns of a helix.
fn samples(n: usize) -> Vec<usize> {
    if n <= SAMPLES {
        return (0..n).collect();
    }
    let golden = 0.5 * (5f64.sqrt() - 1.0);
    let at = |k: usize| ((k as f64 * golden).fract() * n as f64) as usize;
    (0..SAMPLES).map(|k| at(k).min(n - 1)).collect()
}
