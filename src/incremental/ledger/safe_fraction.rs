//! Safe fraction of a step: the fraction after which a simulator can stop, before the first
//! pull-through.
//!
//! # Proof
//!
//! If points move on straight lines, the step to the fraction `f` is the first part of the whole
//! step: it has the passages before `f` and no others. But its last frame is rounded, and the
//! pieces of splines depend on it. Therefore the result is proven as a step of its own, from the
//! first frame to the rounded frame at `f`, for all pairs.
//!
//! # Search
//!
//! The search considers only the pairs with findings; the proof considers all. The moment of the
//! first passage of polylines is known well enough for a guess. Splines are split into straight
//! pieces, which are shorter if the curves are near in one of the frames. So the moment of their
//! first passage depends on the last frame, and bisection finds it.

use super::{Contacts, Ledger, Outcome};
use crate::curve::{CurveSet, Precision};
use crate::pairs::{Pair, distinct};
use crate::verdict::DefectKind;

/// Half-width of the interval around the first known passage that is tried first. It exceeds the
/// error bound of proven times, `1e-9`.
const GUESS_HALF_WIDTH: f64 = 2e-9;

/// The search ends if a safe fraction and one that is not safe differ by at most this.
const ACCURACY: f64 = 2e-7;

/// Maximum number of searches of all pairs.
const MAX_PROOFS: u32 = 4;

/// Maximum number of trial steps with pairs that are too close. The search ends then, because each
/// of them may take very long.
const MAX_TOO_CLOSE: u32 = 4;

impl Outcome {
    /// Returns the pairs that make the step unsafe: they passed through each other, are undecided,
    /// or came into contact during the step.
    fn unsafe_pairs(&self, before: &Contacts) -> Vec<Pair> {
        let known = before.pairs();
        let contacts = self.contacts.pairs().into_iter();
        let new = contacts.filter(|pair| !known.contains(pair));
        self.passed_or_undecided().chain(new).collect()
    }

    /// Returns true if the whole step is safe.
    pub fn is_safe(&self, before: &Contacts) -> bool {
        self.unsafe_pairs(before).is_empty()
    }

    /// Returns the time of the first passage, or 1.
    fn first_passage(&self) -> f64 {
        let first = [&self.events, &self.unresolved].map(|events| events.first());
        let times = first.into_iter().flatten().map(|e| e.fraction);
        times.fold(1.0, f64::min)
    }

    fn is_too_close(&self) -> bool {
        let mut kinds = self.undecided.iter().map(|d| d.kind);
        kinds.any(|kind| kind == DefectKind::TooClose)
    }
}

impl Ledger {
    /// Returns the largest proven fraction of a step, from 0 to 1, during which nothing passed
    /// through anything and no pair came into contact that had none before. The step to the frame
    /// at this fraction, `x0 + f (x1 - x0)` with every operation rounded to the precision of the
    /// coordinates, is proven to be safe. The fraction has that precision, too. 1 stands for the
    /// last frame itself.
    ///
    /// `outcome` is that of the whole step for all pairs, or for those that may meet.
    ///
    /// Cost, if the whole step is not safe: usually one search of all pairs, and a few of the pairs
    /// with findings (about 25 for splines).
    pub fn safe_fraction(
        &mut self,
        [before, after]: [&CurveSet; 2],
        contacts: &Contacts,
        outcome: &Outcome,
    ) -> f64 {
        let mut pairs = outcome.unsafe_pairs(contacts);
        if pairs.is_empty() {
            return 1.0;
        }
        let mut too_close = u32::from(outcome.is_too_close());
        let mut at = None;
        let mut findings = |fraction: f64, pairs: Option<&[Pair]>| -> Option<Vec<Pair>> {
            if self.cancel.is_set() || too_close >= MAX_TOO_CLOSE {
                return None;
            }
            before.toward(after, fraction, &mut at).ok()?;
            let outcome = self.step([before, at.as_ref()?], contacts, pairs);
            too_close += u32::from(outcome.is_too_close());
            Some(outcome.unsafe_pairs(contacts))
        };
        let passage = outcome.first_passage();
        let mut beyond = 1.0;
        for _ in 0..MAX_PROOFS {
            let guesses = [passage - GUESS_HALF_WIDTH, passage + GUESS_HALF_WIDTH];
            let is_safe = |f| findings(f, Some(&pairs)).map(|found| found.is_empty());
            let fraction = last_safe(beyond, &guesses, before.precision(), is_safe);
            if fraction == 0.0 {
                break;
            }
            match findings(fraction, None) {
                Some(found) if found.is_empty() => return fraction,
                Some(found) => pairs = distinct([pairs, found].concat()),
                None => break,
            }
            beyond = fraction;
        }
        0.0
    }
}

/// Returns a safe number of this precision from 0 up to `beyond`, such that some number at most
/// [`ACCURACY`] above it is not safe. Tries the guesses first, then bisects. If `is_safe` returns
/// `None`, ends and returns the largest safe number so far, or 0.
fn last_safe(
    mut beyond: f64,
    guesses: &[f64],
    precision: Precision,
    mut is_safe: impl FnMut(f64) -> Option<bool>,
) -> f64 {
    let mut safe = 0.0;
    let mut guesses = guesses.iter().map(|&guess| round_down(guess, precision));
    while beyond - safe > ACCURACY {
        let within = |f: &f64| safe < *f && *f < beyond;
        let middle = round_down(0.5 * (safe + beyond), precision);
        // Single precision may have no number in between.
        let Some(fraction) = guesses.find(within).or(Some(middle).filter(within)) else {
            break;
        };
        match is_safe(fraction) {
            Some(true) => safe = fraction,
            Some(false) => beyond = fraction,
            None => break,
        }
    }
    safe
}

/// Returns the largest number of this precision that is at most `x`.
fn round_down(x: f64, precision: Precision) -> f64 {
    let nearest = x as f32;
    match precision {
        Precision::F64 => x,
        Precision::F32 if f64::from(nearest) > x => nearest.next_down().into(),
        Precision::F32 => nearest.into(),
    }
}
