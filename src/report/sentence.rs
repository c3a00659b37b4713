//! What happened, in one sentence, and what limits it.

use super::facts::{End, Facts, Found, RECORD_EVERY};
use crate::incremental::Events;
use crate::verdict::Verdict;
use crate::words::{count, percent, plural, plural_of};

/// Conclusion of a recorded run: the worst of its frames, and of what it lacks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Conclusion {
    /// All frames with a verdict are intact, and the recording lacks none. Frames that the watch
    /// skipped are not known to be intact.
    Intact,
    /// The same, without violations that the simulator rolled back before it went on.
    Recovered,
    /// The same, without violations that the simulator accepted as a new baseline.
    Accepted,
    /// The topology changed in at least one frame.
    Changed,
    /// Curves touch in at least one frame. No frame is known to have changed.
    Contact,
    /// At least one frame is undecided, stale or rejected. No frame is known to have changed or to
    /// have a contact.
    Undecided,
    /// All recorded verdicts are intact, but the recording lacks frames or verdicts, or it has
    /// none.
    Incomplete,
}

impl Conclusion {
    /// Returns the word for this conclusion.
    pub fn word(self) -> &'static str {
        match self {
            Conclusion::Intact => "intact",
            Conclusion::Recovered => "recovered",
            Conclusion::Accepted => "accepted",
            Conclusion::Changed => "changed",
            Conclusion::Contact => "contact",
            Conclusion::Undecided => "undecided",
            Conclusion::Incomplete => "incomplete",
        }
    }
}

impl Facts {
    pub fn conclusion(&self) -> Conclusion {
        let some = |verdict| self.lasting[verdict as usize] > 0;
        let all: u64 = self.lasting.iter().sum();
        if some(Verdict::Changed) {
            Conclusion::Changed
        } else if some(Verdict::Contact) {
            Conclusion::Contact
        } else if all > self.lasting[Verdict::Intact as usize] {
            Conclusion::Undecided
        } else if self.is_incomplete() {
            Conclusion::Incomplete
        } else if self.counts.accepted > 0 {
            Conclusion::Accepted
        } else if self.counts.recovered > 0 {
            Conclusion::Recovered
        } else {
            Conclusion::Intact
        }
    }

    /// Returns what happened, in one sentence.
    pub fn sentence(&self) -> String {
        let verified = plural(self.counts.verified, "frame");
        match (self.conclusion(), &self.changed, &self.unsettled) {
            (Conclusion::Changed, Some(found), _) => {
                format!("The topology changed in {}.", words(found))
            }
            (Conclusion::Incomplete, ..) if self.counts.verified == 0 => {
                let of = match self.foreign {
                    0 => String::new(),
                    n => format!(", only {} of other programs", plural(n, "message")),
                };
                format!("Nothing was verified: the recording has no verdict{of}.")
            }
            (Conclusion::Recovered, _, Some(found)) => {
                let n = self.counts.recovered.into();
                let violations = plural_of(
                    n,
                    "violation was rolled back",
                    "violations were rolled back",
                );
                format!(
                    "Recovered: {violations}, and the simulation went on from an intact frame; the \
                     first was in {}.",
                    words(found)
                )
            }
            (Conclusion::Accepted, _, Some(found)) => {
                format!(
                    "Accepted: the simulator went on from a changed topology; the first violation \
                     was in {}.",
                    words(found)
                )
            }
            (Conclusion::Intact | Conclusion::Incomplete, ..) => {
                let gaps = self.gaps().join(", ");
                let span = self.span.map(|[first, last]| match first == last {
                    true => format!(", {first}"),
                    false => format!(", from {first} to {last}"),
                });
                let open = match self.unverified_curves() {
                    0 => String::new(),
                    n => format!(
                        "; {} not verified",
                        plural_of(n, "open curve was", "open curves were")
                    ),
                };
                let frames = format!("{verified}{}{open}", span.unwrap_or_default());
                match gaps.as_str() {
                    "" => format!("Intact: {frames}."),
                    gaps if self.is_incomplete() => {
                        format!("Not complete: {gaps}; what was recorded is intact: {frames}.")
                    }
                    gaps => format!("Intact as far as verified: {frames}; {gaps}."),
                }
            }
            (_, _, Some(found)) => {
                let intact = self.verdicts[Verdict::Intact as usize];
                let all = self.counts.verified + self.counts.rejected;
                let unproven = count(all - intact);
                format!(
                    "No change was found, but {unproven} of {} not known to be intact; the first \
                     is {}.",
                    plural_of(all, "frame is", "frames are"),
                    words(found),
                )
            }
            (_, _, None) => unreachable!("every conclusion but intact has a frame"),
        }
    }

    /// Returns the number of open curves, if they were not verified.
    fn unverified_curves(&self) -> u64 {
        match self.events() {
            Events::Off => self.stats.open_curves,
            _ => 0,
        }
    }

    /// Returns what is not known about the run, because frames are missing, in a few words each.
    pub fn gaps(&self) -> Vec<String> {
        let counts = &self.counts;
        let mut gaps = Vec::new();
        let mut gap = |n: u64, what: &str| {
            if n > 0 {
                gaps.push(format!(
                    "{} {what}",
                    plural_of(n, "frame was", "frames were")
                ));
            }
        };
        gap(
            self.unverified(),
            "published before the baseline, and not verified",
        );
        gap(counts.skipped, "skipped");
        gap(counts.missing, "not recorded");
        gap(counts.left_out, "left out of the recording on purpose");
        gap(self.recorded_in_part(), "recorded in part");
        gap(self.unmeasured(), "verified without the clearance");
        match &self.end {
            End::Finished => {}
            End::Cut(..) => gaps.push("the recording was cut off".into()),
            End::Damaged(_) => gaps.push("the recording is damaged".into()),
        }
        gaps
    }

    /// Returns what limits the first sentence, and what a reader should know beside it.
    pub fn notes(&self) -> Vec<String> {
        let counts = &self.counts;
        let mut notes = Vec::new();
        if let Some(Found {
            more: n @ 1..,
            moment,
            ..
        }) = &self.changed
        {
            let findings = plural_of(*n as u64, "more finding", "more findings");
            notes.push(format!("{moment} has {findings}"));
        }
        if self.changed.is_some() {
            let changed = self.verdicts[Verdict::Changed as usize];
            let frames = plural_of(changed, "frame has", "frames have");
            let pairs = self.violations.pairs.iter().filter(|pair| pair.changed());
            let pairs = plural(pairs.count() as u64, "pair");
            let more = if self.violations.more {
                "more than "
            } else {
                ""
            };
            notes.push(format!(
                "{frames} a changed topology, in {more}{pairs} of curves"
            ));
        }
        for (verdict, what) in [
            (
                Verdict::Contact,
                "curves touch, so that their linking number is not defined",
            ),
            (Verdict::Undecided, "pairs could not be decided"),
            (Verdict::Stale, "the verdict came too late"),
            (
                Verdict::Rejected,
                "the frame is invalid and was not verified",
            ),
        ] {
            let n = self.verdicts[verdict as usize];
            if n > 0 {
                notes.push(format!(
                    "{} {verdict}: {what}",
                    plural_of(n, "frame is", "frames are")
                ));
            }
        }
        if counts.skipped > 0 {
            let all = counts.verified + counts.rejected;
            let share = counts.skipped as f64 / (all as f64 + counts.skipped as f64);
            notes.push(format!(
                "{} skipped ({}): published, but not verified, because the simulator was faster",
                plural_of(counts.skipped, "frame was", "frames were"),
                percent(share)
            ));
        }
        if counts.missing > 0 {
            let frames = plural(counts.missing, "frame");
            notes.push(format!("{frames} missing: verified, but not recorded"));
        }
        if counts.left_out > 0 {
            let frames = plural(counts.left_out, "frame");
            notes.push(format!(
                "{frames} left out on purpose (--record-window or --record-max): verified, but \
                 their verdicts are not in this file"
            ));
        }
        if counts.unanswered > 0 {
            let frames = plural(counts.unanswered, "frame");
            notes.push(format!("{frames} without a verdict"));
        }
        if counts.without_curves > 0 {
            let verdicts = plural(counts.without_curves, "verdict");
            let why = match self.metadata.get(RECORD_EVERY) {
                Some(n) => format!(", left out on purpose (--record-every {n})"),
                None => String::new(),
            };
            notes.push(format!("{verdicts} without the curves of the frame{why}"));
        }
        match &self.end {
            End::Finished => {}
            End::Cut(at, what) => notes.push(format!(
                "the recording is truncated at byte {}, in {what}: the recorder was stopped, or \
                 its disk was full; later frames are lost",
                count(*at)
            )),
            End::Damaged(why) => {
                notes.push(format!(
                    "the recording is damaged, and is read up to there: {why}"
                ));
            }
        }
        if self.unresolved > 0 {
            let passages = plural(self.unresolved, "pull-through");
            notes.push(format!(
                "{passages} cannot be resolved, because the frames are too far apart"
            ));
        }
        if counts.verified > 0 && self.events() == Events::Off {
            let open = match self.unverified_curves() {
                0 => "",
                _ => ", nor are those of open curves",
            };
            notes.push(format!(
                "pull-throughs were not searched for (--events): two that cancel are not \
                 detected{open}"
            ));
        }
        if self.unmeasured() > 0 {
            let frames = plural(self.unmeasured(), "frame");
            notes.push(format!("the clearance of {frames} was not measured"));
        }
        if let Some(closest) = &self.closest {
            let low = match self.clearances[1] {
                0 => String::new(),
                n => format!("; low in {}", plural(n, "frame")),
            };
            notes.push(format!(
                "lowest clearance: {}, in {}{low}",
                closest.sentence, closest.moment
            ));
        }
        if counts.disagreed > 0 {
            let frames = plural_of(counts.disagreed, "frame", "frames");
            notes.push(format!(
                "the incremental verification was wrong in {frames}, which is a bug of linkwatch"
            ));
        }
        notes
    }
}

/// Returns a frame and its finding: "frame 28 at 0.93 s: curves 17 and 18 came apart, near ..".
fn words(found: &Found) -> String {
    let mut text = found.moment.to_string();
    if found.verdict != Verdict::Changed {
        text += &format!(" ({})", found.verdict);
    }
    if let Some(what) = &found.what {
        text += &format!(": {what}");
    }
    if let Some(place) = &found.place {
        text += &format!(", near {place}");
    }
    text
}
