//! Comparison of the verdicts of a replay with the recorded ones.

use crate::cli::output::{count, if_any, plural_of};
use linkwatch::{Report, Retention};
use serde::Serialize;
use std::collections::BTreeMap;

/// Numbers of verdicts of a replay that equal the recorded ones, and that do not.
#[derive(Default, Serialize)]
pub struct Comparison {
    /// Options that differ from those of the recording. If there are any, verdicts are not
    /// compared.
    pub differing: Vec<&'static str>,
    /// Recorded verdicts on the replayed frames.
    pub recorded: u64,
    pub equal: u64,
    pub unlike: u64,
    /// Rejected frames. Their curves are not recorded, so their verdicts cannot be repeated.
    pub rejected: u64,
    /// Frames that were not fully verified, as the step to a frame after a restart.
    pub incomplete: u64,
    /// Frames after missing ones: the motion to them differs from the recorded one.
    pub after_missing: u64,
    /// Frames that are not compared, and were recorded with a worse verdict.
    pub worse: u64,
    /// Frames of which the recorder kept only the verdict, on purpose.
    pub thinned: u64,
    /// Frames that the recorder skipped on purpose, or wrote to another file.
    pub left_out: u64,
    /// Text about the reason.
    #[serde(skip)]
    pub left_out_by: String,
}

/// Returns a text that names the option with which a recording skips frames on purpose.
pub fn left_out_by(metadata: &BTreeMap<String, String>) -> String {
    let option = |key, option: &str| {
        let value = metadata.get(key)?;
        Some(format!("recorded with {option} {value}"))
    };
    let option = option(Retention::EVERY, "every").or(option(Retention::WINDOW, "window"));
    option.unwrap_or_else(|| "they are in other files of this recording".into())
}

impl Comparison {
    /// Returns a sentence about a replay.
    pub fn words(&self) -> String {
        if self.recorded == 0 {
            return "verdicts: the recording has none to compare with".into();
        }
        if !self.differing.is_empty() {
            let options = self.differing.join(", ");
            let what = "not compared with the recorded ones";
            return format!("verdicts: {what}: recorded with another {options}");
        }
        let unlike = count(self.unlike);
        let unlike = if_any(self.unlike, || format!(", {unlike} different"));
        let rejected = "the curves of rejected frames are not recorded";
        let after_missing = "the frames before them are not in the recording";
        let uncompared = [
            (self.rejected, rejected),
            (self.incomplete, "recorded as not fully verified"),
            (self.after_missing, after_missing),
            (self.thinned, "their curves were left out on purpose"),
        ];
        let equal = count(self.equal);
        let mut words = format!("verdicts: {equal} equal to the recorded ones{unlike}");
        for (n, why) in uncompared.into_iter().filter(|(n, _)| *n > 0) {
            words += &format!("; {} not compared: {why}", count(n));
        }
        if self.worse > 0 {
            let frames = plural_of(self.worse, "verdict is", "verdicts are");
            words += &format!("; {frames} worse in the recording");
        }
        if self.left_out > 0 {
            let frames = plural_of(self.left_out, "frame was", "frames were");
            words += &format!("; {frames} left out on purpose");
        }
        if self.thinned + self.left_out > 0 {
            words += &format!(" ({})", self.left_out_by);
        }
        words
    }
}

/// Returns true if a report equals a recorded one. Work counters and clearance are not compared.
/// Motions and the state to roll back to are not compared if the recording has none, as in earlier
/// versions. The last intact frame may be one that the recording lacks, and after a gap it is
/// unknown which curves are new.
pub fn alike(found: &Report, recorded: &Report, after_gap: bool) -> bool {
    let (mut found, mut recorded) = (found.clone(), recorded.clone());
    // NaN differs from itself.
    if found.time.is_nan() && recorded.time.is_nan() {
        (found.time, recorded.time) = (0.0, 0.0);
    }
    if after_gap {
        found.appeared.clone_from(&recorded.appeared);
        found.gone.clone_from(&recorded.gone);
    }
    found.stats = recorded.stats;
    // It was measured with options of its own, and depends on the frames before.
    found.clearance = recorded.clearance;
    found.last_intact = recorded.last_intact;
    // Only words: a recording has the pairs, but not the partners of their loops.
    found.loops.clone_from(&recorded.loops);
    if found.safe_fraction.is_none() || recorded.safe_fraction.is_none() {
        found.safe_fraction = recorded.safe_fraction;
    }
    if recorded.events.iter().all(|e| e.lengths == 0.0) {
        found.events.iter_mut().for_each(|e| e.lengths = 0.0);
    }
    found == recorded
}
