//! Compares the recorded verdicts and curves of two runs.
//!
//! Both recordings are read once, side by side; memory holds one frame of each.

use super::reports::{ReportDifference, difference};
use crate::cli::source::Source;
use crate::record::CUT_OFF;
use linkwatch::{Ending, RecordedFrame, RecordedItem, Report, Result};
use serde::Serialize;
use std::cmp::Ordering;

/// Largest difference of the times of one frame in two runs, relative to the time: sums of time
/// steps round differently.
const SAME_TIME: f64 = 1e-7;

/// A frame that both runs have, with different verdicts or findings.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FrameDiff {
    /// Numbers of the frame in the runs.
    pub seq: [u64; 2],
    /// Simulation times of the frame in the runs, in seconds.
    pub time: [f64; 2],
    /// Both reports in one line each.
    pub headlines: [String; 2],
    /// The difference.
    pub difference: ReportDifference,
}

/// Frames that one run has and the other one lacks.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct OnlyIn {
    /// Number of these frames.
    pub frames: u64,
    /// First and last of these frames.
    pub range: Option<[u64; 2]>,
}

impl OnlyIn {
    fn add(&mut self, seq: u64) {
        self.frames += 1;
        self.range = Some([self.range.map_or(seq, |[first, _]| first), seq]);
    }
}

/// Comparison of the curves of two runs.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct CurveDiff {
    /// Number of frames whose curves were recorded in both runs.
    pub compared: u64,
    /// Number of these frames whose curves are bitwise equal, in the same cell.
    pub equal: u64,
    /// First of these frames with other bits or another cell: its numbers in the runs.
    pub first: Option<[u64; 2]>,
}

/// Differences of the recorded verdicts of two runs.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct RunDiff {
    /// Number of frames with a verdict in both runs.
    pub compared: u64,
    /// Number of these frames whose verdicts or findings differ.
    pub different: u64,
    /// First frame whose verdicts or findings differ.
    pub first: Option<FrameDiff>,
    /// Frames that only the first run and only the second one has.
    pub only: [OnlyIn; 2],
    /// Number of frames that both runs have, but with a verdict in one of them at most.
    pub without_verdict: u64,
    /// Comparison of the curves.
    pub curves: CurveDiff,
    /// First frame with different times in both runs, if frames are aligned by number: its number.
    pub other_time: Option<u64>,
    /// True for a run without an end, or whose recording was cut off.
    pub cut: [bool; 2],
}

/// A frame of a run.
struct Entry {
    seq: u64,
    time: f64,
    frame: Option<RecordedFrame>,
    report: Option<Report>,
}

/// Frames of a run, one by one.
struct Run<'a> {
    source: &'a mut Source,
    /// Frame whose verdict was not read yet.
    waiting: Option<RecordedFrame>,
}

impl Run<'_> {
    fn next(&mut self) -> Result<Option<Entry>> {
        let alone = |frame: RecordedFrame| Entry {
            seq: frame.seq,
            time: frame.time,
            frame: Some(frame),
            report: None,
        };
        loop {
            let before = match self.source.next()? {
                Some(RecordedItem::Baseline(_)) => continue,
                Some(RecordedItem::Frame(frame)) => self.waiting.replace(frame),
                Some(RecordedItem::Verdict(recorded)) => {
                    let report = recorded.report;
                    return Ok(Some(Entry {
                        seq: report.seq,
                        time: report.time,
                        frame: self.waiting.take().filter(|f| f.seq == report.seq),
                        report: Some(report),
                    }));
                }
                None => return Ok(self.waiting.take().map(alone)),
            };
            if before.is_some() {
                return Ok(before.map(alone));
            }
        }
    }
}

fn same_time(a: f64, b: f64) -> bool {
    (a - b).abs() <= SAME_TIME * a.abs().max(b.abs())
}

/// Compares the recorded verdicts of two runs frame by frame, and whether their curves are bitwise
/// equal. Nothing is verified. A frame is the same in both if it has the same number, or the same
/// time, up to rounding, if `by_time`. Frames of a run follow one another in this order.
///
/// # Errors
///
/// The errors of reading, with the path of the recording; [`Error::Usage`] if the runs have
/// different numbers of curves, so that their findings are about other curves.
pub fn diff_runs(runs: &mut [Source; 2], by_time: bool) -> Result<RunDiff> {
    let mut diff = RunDiff::default();
    let [mut first, mut second] = runs.each_mut().map(|source| Run {
        source,
        waiting: None,
    });
    let (mut a, mut b) = (first.next()?, second.next()?);
    loop {
        let order = match (&a, &b) {
            (None, None) => break,
            (Some(_), None) => Ordering::Less,
            (None, Some(_)) => Ordering::Greater,
            (Some(a), Some(b)) if !by_time => a.seq.cmp(&b.seq),
            (Some(a), Some(b)) if same_time(a.time, b.time) => Ordering::Equal,
            (Some(a), Some(b)) => a.time.total_cmp(&b.time),
        };
        match (order, &a, &b) {
            (Ordering::Equal, Some(a), Some(b)) => diff.add(a, b)?,
            (Ordering::Less, Some(a), _) => diff.only[0].add(a.seq),
            (_, _, Some(b)) => diff.only[1].add(b.seq),
            _ => {}
        }
        if order.is_le() {
            a = first.next()?;
        }
        if order.is_ge() {
            b = second.next()?;
        }
    }
    let was_cut = |run: &Source| {
        let is_cut = matches!(run.reader.ending(), Some(Ending::Cut { .. }));
        is_cut || run.reader.metadata().contains_key(CUT_OFF)
    };
    diff.cut = runs.each_ref().map(was_cut);
    Ok(diff)
}

impl RunDiff {
    /// Adds a frame that both runs have.
    fn add(&mut self, a: &Entry, b: &Entry) -> Result<()> {
        if !same_time(a.time, b.time) {
            self.other_time.get_or_insert(a.seq);
        }
        if let (Some(p), Some(q)) = (&a.frame, &b.frame) {
            self.compare_curves(p, q)?;
        }
        let (Some(p), Some(q)) = (&a.report, &b.report) else {
            self.without_verdict += 1;
            return Ok(());
        };
        self.compared += 1;
        let names = a.frame.as_ref().map(|f| &f.info.labels.names[..]);
        if let Some(difference) = difference([p, q], names.unwrap_or_default()) {
            self.different += 1;
            self.first.get_or_insert_with(|| FrameDiff {
                seq: [a.seq, b.seq],
                time: [a.time, b.time],
                headlines: [p.headline(), q.headline()],
                difference,
            });
        }
        Ok(())
    }

    fn compare_curves(&mut self, p: &RecordedFrame, q: &RecordedFrame) -> Result<()> {
        let [m, n] = [p, q].map(|frame| frame.counts.len());
        // Curves that a simulator adds or removes later are a difference of the runs.
        if m != n && self.curves.compared == 0 {
            let [p, q] = [p.seq, q.seq];
            return Err(usage!(
                "the recordings are of different scenes: {m} curves in frame {p} of the first, {n} \
                 in frame {q} of the second"
            ));
        }
        self.curves.compared += 1;
        match p.same_curves(q) {
            true => self.curves.equal += 1,
            false => {
                self.curves.first.get_or_insert([p.seq, q.seq]);
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn diff(names: [&str; 2], by_time: bool) -> Result<RunDiff> {
        let paths = names.map(|name| format!("recordings/{name}.mcap"));
        let mut runs = paths.map(|path| Source::new(path.as_ref()).unwrap());
        diff_runs(&mut runs, by_time)
    }

    #[test]
    fn a_recording_does_not_differ_from_itself() {
        for (name, verdicts, frames) in [("squares", 20, 19), ("flight", 5, 5)] {
            for by_time in [false, true] {
                let found = diff([name, name], by_time).unwrap();
                let expected = RunDiff {
                    compared: verdicts,
                    curves: CurveDiff {
                        compared: frames,
                        equal: frames,
                        first: None,
                    },
                    ..RunDiff::default()
                };
                assert_eq!(found, expected);
            }
        }
    }

    /// `chainmail_steps` has every time step of the first frames of `chainmail`.
    #[test]
    fn frames_of_runs_with_other_numbers_are_aligned_by_time() {
        let names = ["chainmail", "chainmail_steps"];
        let found = diff(names, true).unwrap();
        assert_eq!((found.compared, found.different), (5, 0));
        assert_eq!((found.curves.compared, found.curves.equal), (5, 5));
        assert_eq!(found.only[0].range, Some([5, 59]));
        assert_eq!(found.only[1].frames, 60);
        let found = diff(names, false).unwrap();
        assert_eq!((found.compared, found.other_time), (60, Some(1)));
        assert_eq!(found.curves.first, Some([1, 1]));
    }

    #[test]
    fn runs_of_other_curves_are_not_compared() {
        let message = diff(["flight", "chainmail"], false)
            .unwrap_err()
            .to_string();
        assert!(message.contains("2 curves in frame 0"), "{message}");
        assert!(message.contains("65 in frame 0"), "{message}");
    }
}
