//! Conclusion of a recorded run in one sentence, and its limitations.

use super::facts::{End, Facts, NamedFinding};
use crate::incremental::Events;
use crate::record::{CONTINUED, CUT_OFF, Retention};
use crate::verdict::{LeftOut, Verdict};
use crate::words::{count, if_any, percent, plural, plural_of, truncated};
use std::fmt;

vocabulary! {
    /// Conclusion of a recorded run: the worst of its frames, and of what it lacks.
    pub enum Conclusion {
        /// All frames with a verdict are intact, and the recording lacks none. Frames that the
        /// watch skipped are not known to be intact.
        Intact = "intact",
        /// The same, without violations that the simulator rolled back before it went on.
        Recovered = "recovered",
        /// The same, without violations that the simulator accepted as a new baseline.
        Accepted = "accepted",
        /// The topology changed in at least one frame.
        Changed = "changed",
        /// Curves touch in at least one frame. No frame is known to have changed.
        Contact = "contact",
        /// At least one frame is undecided, stale or rejected. No frame is known to have changed or
        /// to have a contact.
        Undecided = "undecided",
        /// All recorded verdicts are intact, but the recording lacks frames or verdicts, or it has
        /// none.
        Incomplete = "incomplete",
    }
}

impl Facts {
    pub fn conclusion(&self) -> Conclusion {
        let some = |verdict| self.lasting.counts[verdict as usize] > 0;
        let all: u64 = self.lasting.counts.iter().sum();
        let intact = self.lasting.counts[Verdict::Intact as usize];
        let worst_first = [
            (some(Verdict::Changed), Conclusion::Changed),
            (some(Verdict::Contact), Conclusion::Contact),
            (all > intact, Conclusion::Undecided),
            (self.is_incomplete(), Conclusion::Incomplete),
            (self.counts.accepted > 0, Conclusion::Accepted),
            (self.counts.recovered > 0, Conclusion::Recovered),
        ];
        let worst = worst_first.into_iter().find(|(holds, _)| *holds);
        worst.map_or(Conclusion::Intact, |(_, conclusion)| conclusion)
    }

    /// Returns what happened, in one sentence.
    pub fn sentence(&self) -> String {
        let conclusion = self.conclusion();
        let found = match conclusion {
            Conclusion::Changed => &self.lasting.changed,
            Conclusion::Intact | Conclusion::Incomplete => &None,
            Conclusion::Accepted | Conclusion::Recovered => &self.verdicts.unsettled,
            _ => &self.lasting.unsettled,
        };
        let Some(found) = found else {
            return self.intact();
        };
        match conclusion {
            Conclusion::Changed => format!("The topology changed in {found}."),
            Conclusion::Recovered => {
                let n = self.counts.recovered;
                let violations = plural_of(n, "violation was", "violations were");
                format!(
                    "Recovered: {violations} rolled back, and the simulation went on from an \
                     intact frame; the first was in {found}."
                )
            }
            Conclusion::Accepted => format!(
                "Accepted: the simulator went on from a changed topology; the first violation was \
                 in {found}."
            ),
            _ => {
                let all = self.counts.verified + self.counts.rejected;
                let lasting: u64 = self.lasting.counts.iter().sum();
                let unproven = count(lasting - self.lasting.counts[Verdict::Intact as usize]);
                let frames = plural_of(all, "frame is", "frames are");
                let lasts = if self.verdicts.changed.is_some() {
                    "lasts"
                } else {
                    "was found"
                };
                format!(
                    "No change {lasts}, but {unproven} of {frames} not known to be intact; the \
                     first is {found}."
                )
            }
        }
    }

    /// Returns the sentence of a run whose recorded frames are all intact.
    fn intact(&self) -> String {
        if self.counts.verified == 0 {
            let foreign = plural(self.foreign, "message");
            let of = if_any(self.foreign, || {
                format!(", only {foreign} of other programs")
            });
            return format!("Nothing was verified: the recording has no verdict{of}.");
        }
        let span = self.span.map(|[first, last]| match first == last {
            true => format!(", {first}"),
            false => format!(", from {first} to {last}"),
        });
        let open = self.unverified_curves();
        let curves = plural_of(open, "open curve was", "open curves were");
        let open = if_any(open, || format!("; {curves} not verified"));
        let frames = plural(self.counts.verified, "frame");
        let frames = format!("{frames}{}{open}", span.unwrap_or_default());
        let gaps = self.gaps().join(", ");
        let recorded = match self.verdicts.unsettled {
            None => "what was recorded is intact",
            Some(_) => "no violation lasts in what was recorded",
        };
        match (self.is_incomplete(), gaps.as_str()) {
            (false, "") => format!("Intact: {frames}."),
            (false, gaps) => format!("Intact as far as verified: {frames}; {gaps}."),
            (true, "") => format!("Not complete: {recorded}: {frames}."),
            (true, gaps) => format!("Not complete: {gaps}; {recorded}: {frames}."),
        }
    }

    /// Returns the number of open curves, if they were not verified. Several curves that run
    /// through the periodic cell have no linking number with one another.
    pub(super) fn unverified_curves(&self) -> u64 {
        match self.events() {
            Events::Off => self.open_curves + self.baseline.as_ref().map_or(0, |b| b.through),
            _ => self.unfollowed,
        }
    }

    /// Returns what is not known about the run, because frames are missing, in a few words each.
    pub fn gaps(&self) -> Vec<String> {
        let counts = &self.counts;
        let mut gaps = Vec::new();
        let before = "published before the baseline, and not verified";
        for (n, what) in [
            (self.unverified(), before),
            (counts.skipped, "skipped"),
            (counts.missing, "not recorded"),
            (counts.left_out, "left out of the recording on purpose"),
            (self.recorded_in_part(), "recorded in part"),
            (self.unmeasured(), "verified without the clearance"),
        ] {
            let frames = plural_of(n, "frame was", "frames were");
            gaps.extend((n > 0).then(|| format!("{frames} {what}")));
        }
        gaps.extend(self.has_one_curve().then(|| {
            "nothing was compared: one curve alone has no linking number, and pull-throughs of a \
             curve with itself were not searched for"
                .into()
        }));
        let unread = self.left_out.iter();
        gaps.extend(unread.map(|found| format!("not read: {found}")));
        gaps.extend(self.metadata.get(CUT_OFF).cloned());
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
        let frames = |n: u64| plural(n, "frame");
        let mut notes = Vec::new();
        let mut note = |n: u64, words: String| notes.extend((n > 0).then_some(words));
        if let Some(found) = &self.verdicts.changed {
            let more = found.more as u64;
            let findings = plural(more, "more finding");
            note(more, format!("{} has {findings}", found.moment));
            let pairs = self.violations.pairs.iter().filter(|pair| pair.changed());
            let pairs = plural(pairs.count(), "pair");
            let more = self.violations.more;
            let at_least = if more { "more than " } else { "" };
            let changed = plural_of(self.of(Verdict::Changed), "frame has", "frames have");
            let words = format!("{changed} a changed topology, in {at_least}{pairs} of curves");
            note(1, words);
        }
        let touch = "curves touch, so that their linking number is not defined";
        let invalid = "the frame is invalid and was not verified";
        for (verdict, what) in [
            (Verdict::Contact, touch),
            (Verdict::Undecided, "pairs could not be decided"),
            (Verdict::Stale, "the verdict came too late"),
            (Verdict::Rejected, invalid),
        ] {
            let n = self.of(verdict);
            let frames = plural_of(n, "frame is", "frames are");
            note(n, format!("{frames} {verdict}: {what}"));
        }
        let unread = self.left_out.len() as u64;
        note(unread, LeftOut::sentence(&self.left_out));
        let all = (counts.verified + counts.rejected) as f64 + counts.skipped as f64;
        let skipped = plural_of(counts.skipped, "frame was", "frames were");
        let share = percent(counts.skipped as f64 / all);
        let why = "published, but not verified, because the simulator was faster";
        let words = format!("{skipped} skipped ({share}): {why}");
        note(counts.skipped, words);
        let on_purpose = "left out on purpose (outside a window, or in another file): verified, \
                          but their verdicts are not in this file";
        for (n, what) in [
            (counts.missing, "missing: verified, but not recorded"),
            (counts.left_out, on_purpose),
            (counts.unanswered, "without a verdict"),
        ] {
            note(n, format!("{} {what}", frames(n)));
        }
        let every = match self.metadata.get(Retention::EVERY) {
            Some(n) => format!(", left out on purpose (every {n})"),
            None => String::new(),
        };
        let verdicts = plural(counts.without_curves, "verdict");
        let words = format!("{verdicts} without the curves of the frame{every}");
        note(counts.without_curves, words);
        if let Some(next) = self.metadata.get(CONTINUED) {
            note(1, format!("the run continues in {next}"));
        }
        match &self.end {
            End::Finished => {}
            End::Cut(at, what) => {
                let cut = truncated(*at, what);
                note(1, format!("{cut}; later frames are lost"));
            }
            End::Damaged(why) => {
                let what = "the recording is damaged, and is read up to there";
                note(1, format!("{what}: {why}"));
            }
        }
        let unresolved = plural(self.unresolved, "pull-through");
        let why = "cannot be resolved, because the frames are too far apart";
        note(self.unresolved, format!("{unresolved} {why}"));
        if counts.verified > 0 && self.events() == Events::Off {
            let open = match self.unverified_curves() {
                0 => "",
                _ => ", nor are those of open curves",
            };
            let what = "pull-throughs were not searched for: two that cancel are not detected";
            note(1, format!("{what}{open}"));
        }
        let curves = plural_of(self.unfollowed, "open curve was", "open curves were");
        let words = format!("{curves} not verified, because no step was searched");
        note(self.unfollowed, words);
        let unmeasured = frames(self.unmeasured());
        let words = format!("the clearance of {unmeasured} was not measured");
        note(self.unmeasured(), words);
        if let Some(closest) = &self.closest {
            let low = self.clearances[1];
            let low = if_any(low, || format!("; low in {}", frames(low)));
            let (sentence, moment) = (&closest.sentence, closest.moment);
            note(1, format!("lowest clearance: {sentence}, in {moment}{low}"));
        }
        let wrong = frames(counts.disagreed);
        let what = "the incremental verification was wrong in";
        let words = format!("{what} {wrong}, which is a bug of linkwatch");
        note(counts.disagreed, words);
        notes
    }
}

impl fmt::Display for NamedFinding {
    /// Writes a frame and its finding: "frame 28 at 0.93 s: curves 17 and 18 came apart, near ..".
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.moment)?;
        if self.verdict != Verdict::Changed {
            write!(f, " ({})", self.verdict)?;
        }
        if let Some(what) = &self.finding {
            write!(f, ": {what}")?;
        }
        match &self.place {
            Some(place) => write!(f, ", near {place}"),
            None => Ok(()),
        }
    }
}
