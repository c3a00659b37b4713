//! Summary of a run.

use super::Run;
use super::clearance::ClearanceLog;
use super::news::Violation;
use super::times::RunTimes;
use super::violations::Violations;
use crate::cli::Outcome;
use crate::cli::output::{count, milliseconds, percent, plural, plural_of};
use linkwatch::{Continuation, Counters, LeftOut, Report, SinkSummary};
use serde_json::json;

impl Counters {
    /// Returns the share of all frames that were skipped.
    pub(crate) fn skipped_share(self) -> f64 {
        let all = self.verified + self.skipped + self.rejected;
        self.skipped as f64 / all.max(1) as f64
    }

    /// Returns the counts since `before`, of the same session. They do not become negative, because
    /// the counts that a simulator sends may be wrong.
    pub(crate) fn since(self, before: Counters) -> Counters {
        Counters {
            verified: self.verified.saturating_sub(before.verified),
            skipped: self.skipped.saturating_sub(before.skipped),
            rejected: self.rejected.saturating_sub(before.rejected),
        }
    }

    /// Returns a text for the counts. Model files cannot be skipped.
    pub(crate) fn words(self, models: bool) -> String {
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

/// Figures of all frames of a run.
#[derive(Default)]
pub struct Summary {
    pub violations: Violations,
    pub unresolved: Unresolved,
    pub clearance: ClearanceLog,
    pub times: RunTimes,
    /// Numbers of frames on the full, the quiet and the partial route.
    pub routes: [u64; 3],
    /// Number of open curves in the frames of all runs; `None` before the first verified frame.
    pub open_curves: Option<u64>,
    /// True if a frame has a pair to verify: several curves, or periodic images.
    pub has_pairs: bool,
    /// True if all curves of the last frame are open.
    pub only_open: bool,
    /// Number of curves that are closed because they end where they start, and of jumps by a
    /// lattice vector.
    pub joined: usize,
    pub jumps: u64,
    /// Elements of the files that were not read, over all frames.
    pub left_out: Vec<LeftOut>,
    /// Reason why clearance is not measured, although it is requested.
    pub unmeasured: Option<String>,
    /// Number of gaps in which no step is searched: in a recording, or before a watch started.
    pub gaps: u64,
    /// Number of followed steps and of cuts, summed over all runs ([`Steps`]).
    pub followed: u64,
    pub cuts: u64,
    /// Number of open curves in runs without a search for pull-throughs.
    pub unsearched: u64,
    /// Number of open curves in runs with a search, but without any searched step.
    pub unfollowed: u64,
    /// True if a run had curves that run through the cell, which have no linking number.
    pub through: bool,
    /// True if no step of such a run was searched.
    pub unsearched_through: bool,
    /// Number of runs without a search for pull-throughs.
    pub unsearched_runs: u64,
    /// Number of runs after the first one.
    pub further_runs: u64,
    /// Comparison with the recorded verdicts, as text and as JSON, if this is a replay.
    pub comparison: Option<(String, serde_json::Value)>,
}

impl Summary {
    /// Returns true if curves have no linking number, and were not searched for pull-throughs.
    pub fn has_unverified_curves(&self) -> bool {
        let has_curves = self.open_curves > Some(0) || self.through;
        let unsearched = self.unsearched + self.unfollowed > 0 || self.unsearched_through;
        unsearched || has_curves && self.gaps > 0
    }
}

/// Steps between the verified frames of a run.
#[derive(Default)]
pub struct Steps {
    /// Number of verified frames.
    pub verified: u64,
    /// Number of steps that continue the motion, and number of cuts.
    pub followed: u64,
    pub cuts: u64,
}

impl Steps {
    /// Counts a verified frame. No step leads to the first frame of a run, or to the first after a
    /// gap.
    pub fn count(&mut self, has_step: bool, step: Continuation) {
        let is = |kind| u64::from(has_step && step == kind);
        self.verified += 1;
        self.followed += is(Continuation::Continues);
        self.cuts += is(Continuation::Cut);
    }
}

impl Run {
    /// Prints the summary.
    pub(super) fn sum_up(&self, sinks: &[SinkSummary], notes: &[String]) {
        let (tally, sum) = (self.tally, &self.sum);
        let (recovered, accepted) = (sum.violations.recovered, sum.violations.accepted);
        let word = match (tally.verified, self.outcome()) {
            (0, _) => "nothing was verified",
            (_, Outcome::Fine) if accepted > 0 => "accepted",
            (_, Outcome::Fine) if recovered > 0 => "recovered",
            (_, Outcome::Fine) => "intact",
            (_, Outcome::Changed) => "changed",
            (_, Outcome::Undecided) => "undecided or incomplete",
        };
        let [full, quiet, partial] = sum.routes;
        let first = self.news.first_violation.as_ref();
        let checked = sum.unsearched_runs == 0;
        let (runs, yarns) = (1 + sum.further_runs, self.yarns());
        // True if steps were searched, and no curve remained unverified.
        let followed =
            sum.followed > 0 && sum.unsearched_runs < runs && !sum.has_unverified_curves();
        if self.setup.json {
            self.live.json(json!({
                "summary": {
                    "verdict": word,
                    "recovered": recovered,
                    "accepted": accepted,
                    "baseline": self.baseline_json(),
                    "verified": tally.verified,
                    "skipped": tally.skipped,
                    "skipped_share": tally.skipped_share(),
                    "rejected": tally.rejected,
                    "median_ms": milliseconds(sum.times.checks.median()),
                    "max_ms": milliseconds(sum.times.checks.longest),
                    "times_ms": sum.times.to_json(),
                    "first_violation": first,
                    "routes": { "full": full, "quiet": quiet, "partial": partial },
                    "runs": runs,
                    "open_curves": sum.open_curves,
                    "joined_curves": sum.joined,
                    "open_curves_verified": followed,
                    "left_out": sum.left_out,
                    "curves_through_the_cell": yarns,
                    "jumps": sum.jumps,
                    "gaps": sum.gaps,
                    "sinks": sinks,
                    "recorded_verdicts": sum.comparison.as_ref().map(|(_, json)| json),
                    "unresolved": sum.unresolved,
                    "clearance": sum.clearance.to_json(),
                    "unmeasured_clearance": sum.unmeasured,
                }
            }));
            return;
        }
        if quiet + partial > 0 {
            let [quiet, partial, full] = [quiet, partial, full].map(count);
            tracing::debug!("frames: {quiet} quiet, {partial} partial, {full} full");
        }
        if let Some(times) = sum.times.words() {
            tracing::debug!("{times}");
        }
        let some = |there: bool, words: String| there.then_some(words);
        let tally_words = tally.words(self.setup.models);
        let checks = match tally.verified {
            0 => String::new(),
            _ => format!("; {}", sum.times.checks.words()),
        };
        let ended = |n: u32, what: &str| {
            let violations = plural_of(n, "violation was", "violations were");
            some(n > 0, format!("{violations} {what}"))
        };
        let low = self.options.clearance.map_or(0.0, |options| options.low);
        let open = sum.open_curves.unwrap_or(0);
        let open_curves = plural(open, "open curve");
        let joined = |parts: &[Option<String>], separator: &str| {
            let parts: Vec<&str> = parts.iter().flatten().map(String::as_str).collect();
            parts.join(separator)
        };
        // One line for each topic, in the order in which users ask for them.
        let with = match self.options.baseline {
            Some(_) => "the baseline",
            None => "its own first frame",
        };
        let own = format!("each compared with {with} (--one-motion: all files are one motion)");
        let verdict = [
            Some(format!(
                "{word}{}: {tally_words}{checks}",
                so_far(word, tally)
            )),
            self.baseline_words().filter(|_| self.setup.live),
            some(runs > 1, format!("{}, {own}", plural(runs, "run"))),
        ];
        let words_of = |v: &Violation| joined(&[Some(v.name.clone()), v.finding.clone()], ": ");
        let rolled_back = "rolled back, and the simulation went on from an intact frame";
        let violation = [
            first.map(|v| format!("first violation: {}", words_of(v))),
            ended(recovered, rolled_back),
            ended(accepted, "accepted by the simulator as a new baseline"),
        ];
        let through = format!("{} curves that run through the cell", count(yarns));
        let hidden = "pull-throughs that linking numbers do not show".to_owned();
        let not_searched = [
            some(sum.unsearched > 0, plural(sum.unsearched, "open curve")),
            some(yarns > 1, through),
            Some(hidden),
        ];
        let in_runs = match sum.unsearched_runs {
            n if n < runs => format!(" in {}", plural(n, "run")),
            _ => String::new(),
        };
        let not_searched = format!(
            "not verified: {}{in_runs} (--events=between searches for pull-throughs)",
            joined(&not_searched, ", ")
        );
        let unfollowed = plural(sum.unfollowed, "open curve");
        let no_step = format!("not verified: {unfollowed}, because no step was searched");
        let gaps = plural(sum.gaps, "gap");
        let place = match self.setup.live {
            true => "before the watch started",
            false => "of the recording",
        };
        let gaps = format!("not verified: pull-throughs in {gaps} {place}");
        let unmeasured = |why| format!("clearance was not measured in all frames: {why}");
        let unverified = [
            some(!checked, not_searched),
            some(checked && sum.gaps > 0, gaps),
            some(sum.unfollowed > 0 && sum.gaps == 0, no_step),
            some(!sum.left_out.is_empty(), LeftOut::sentence(&sum.left_out)),
            some(sum.unresolved.pull_throughs > 0, sum.unresolved.words()),
            sum.unmeasured.as_ref().map(unmeasured),
        ];
        let cuts = match sum.cuts {
            0 => String::new(),
            n => format!(
                ", but not in {}",
                plural_of(n, "cut of the motion", "cuts of the motion")
            ),
        };
        let passed =
            format!("{open_curves} verified for pull-throughs{cuts}, without linking numbers");
        let jumps = format!("{}, and were followed", jumped(sum.jumps));
        let others = [
            some(followed && open > 0, passed),
            some(sum.jumps > 0, jumps),
            sum.clearance.words(low),
            sum.comparison.as_ref().map(|(words, _)| words.clone()),
        ];
        let files = self.sinks.paths().into_iter().filter(|path| path.exists());
        let files = files.map(|path| Some(path.display().to_string()));
        let files = joined(&files.collect::<Vec<_>>(), ", ");
        let mut outputs = vec![some(!files.is_empty(), format!("files: {files}"))];
        let notes = notes.iter().flat_map(|note| note.lines());
        outputs.extend(notes.map(|note| Some(note.to_owned())));
        let groups = [&verdict[..], &violation, &unverified, &others, &outputs];
        let lines = groups.map(|parts| joined(parts, "; "));
        let lines: Vec<String> = lines.into_iter().filter(|line| !line.is_empty()).collect();
        self.live.line(lines.join("\n"));
    }
}

/// Returns a qualifier of the verdict if frames were skipped that could contradict it. None can
/// contradict "changed".
fn so_far(word: &str, tally: Counters) -> &'static str {
    match (word, tally) {
        ("changed", _) | (_, Counters { verified: 0, .. } | Counters { skipped: 0, .. }) => "",
        _ => " as far as verified",
    }
}

/// Returns a text for the number of jumps of curves.
pub fn jumped(count: u64) -> String {
    let times = plural(count, "time");
    format!("curves jumped by a lattice vector {times}")
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

    /// Returns a sentence with the number of unresolved pull-throughs, and the factor by which
    /// frames would have to be closer together to resolve all of them.
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
             frame; {remedy} (--motion-limit {}); --events=off compares linking numbers alone",
            count(self.pull_throughs),
            plural(self.frames, "frame"),
            self.lengths,
            self.limit,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Regression test: the summary said "nothing was verified as far as verified".
    #[test]
    fn only_verdicts_on_some_of_the_frames_are_limited() {
        let tally = |verified, skipped| Counters {
            verified,
            skipped,
            rejected: 0,
        };
        let limited = " as far as verified";
        assert_eq!(so_far("intact", tally(2, 1)), limited);
        assert_eq!(so_far("undecided or incomplete", tally(2, 1)), limited);
        assert_eq!(so_far("intact", tally(2, 0)), "");
        assert_eq!(so_far("changed", tally(2, 1)), "");
        assert_eq!(so_far("nothing was verified", tally(0, 1)), "");
    }
}
