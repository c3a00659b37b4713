//! Summary of a run: numbers of frames, and unresolved pull-throughs.

use crate::cli::output::{count, percent, plural};
use linkwatch::Report;

/// Numbers of frames verified, skipped and rejected so far.
#[derive(Clone, Copy, Debug, Default)]
pub struct FrameCounts {
    pub verified: u64,
    pub skipped: u64,
    pub rejected: u64,
}

impl FrameCounts {
    /// Returns the share of all frames that were skipped.
    pub fn skipped_share(self) -> f64 {
        let all = self.verified + self.skipped + self.rejected;
        self.skipped as f64 / all.max(1) as f64
    }

    /// Returns the frames after other counts of the same session. A count that a simulator claimed
    /// may be wrong, and smaller.
    pub fn since(self, before: FrameCounts) -> FrameCounts {
        FrameCounts {
            verified: self.verified.saturating_sub(before.verified),
            skipped: self.skipped.saturating_sub(before.skipped),
            rejected: self.rejected.saturating_sub(before.rejected),
        }
    }

    /// Returns the counts in words. Model files cannot be skipped.
    pub fn words(self, models: bool) -> String {
        let mut parts = vec![format!("{} verified", plural(self.verified, "frame"))];
        match self.skipped {
            0 if models => {}
            0 => parts.push("0 skipped".into()),
            n => {
                let share = percent(self.skipped_share());
                parts.push(format!("{} skipped ({share})", count(n)));
            }
        }
        parts.push(format!("{} rejected", count(self.rejected)));
        parts.join(", ")
    }
}

/// Pull-throughs that cannot be resolved, because the frames are too far apart.
#[derive(Clone, Copy, Default, serde::Serialize)]
pub struct Unresolved {
    pub pull_throughs: u64,
    pub frames: u64,
    /// The largest motion of the unresolved pull-throughs, in segment lengths.
    pub lengths: f64,
    /// The limit of the motion, in segment lengths.
    pub limit: f64,
}

impl Unresolved {
    pub fn add(&mut self, report: &Report) {
        self.pull_throughs += report.unresolved.len() as u64;
        self.frames += u64::from(!report.unresolved.is_empty());
        let lengths = report.unresolved.iter().map(|p| p.lengths);
        self.lengths = lengths.fold(self.lengths, f64::max);
    }

    /// Returns a sentence with their number, and the factor by which frames would have to be closer
    /// together so that all of them are within the limit.
    pub fn words(&self) -> String {
        let remedy = match self.limit {
            0.0 => "none is resolved".to_owned(),
            limit => {
                let closer = (self.lengths / limit).ceil();
                format!("frames {closer} times closer together would resolve them")
            }
        };
        format!(
            "unresolved pull-throughs: {} in {}, with motions of up to {:.1} segment lengths a \
             frame; {remedy} (--motion-limit {})",
            count(self.pull_throughs),
            plural(self.frames, "frame"),
            self.lengths,
            self.limit,
        )
    }
}
