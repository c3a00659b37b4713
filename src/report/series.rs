//! Figures over time: bins of successive frames, as many as a plot can show.
//!
//! A bin has one frame until there are [`MOST`] bins. Then each two are merged, and all later bins
//! are twice as wide. So a recording of any length takes the same memory, and every frame is in the
//! figures: counts are added, and of other figures the extremes are kept.

use super::rows::Moment;
use crate::curve::vector::per_axis;
use crate::verdict::{ChangeKind, Report, Verdict};

/// Maximum number of bins, even.
pub(super) const MOST: usize = 400;

/// Figures of successive frames.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub(super) struct Bin {
    /// The first frame, and the number of the last one.
    #[serde(flatten)]
    pub first: Moment,
    pub last_frame: u64,
    pub frames: u64,
    /// Number of frames with each verdict, in the order of [`Verdict::ALL`].
    pub verdicts: [u64; 6],
    /// Maximum number of links lost, gained and otherwise changed; `None` if all frames were
    /// rejected.
    pub links: Option<[u64; 3]>,
    pub pull_throughs: u64,
    pub unresolved: u64,
    pub skipped: u64,
    pub missing: u64,
    pub total_ms: f64,
    pub max_ms: f64,
    /// Lowest clearance.
    pub clearance: Option<f64>,
}

impl Bin {
    fn of(report: &Report, milliseconds: f64, [skipped, missing]: [u64; 2]) -> Bin {
        let mut verdicts = [0; 6];
        verdicts[report.verdict as usize] = 1;
        Bin {
            first: Moment::of(report),
            last_frame: report.seq,
            frames: 1,
            verdicts,
            links: (report.verdict != Verdict::Rejected)
                .then(|| ChangeKind::ALL.map(|kind| report.count(kind) as u64)),
            pull_throughs: report.events.len() as u64,
            unresolved: report.unresolved.len() as u64,
            skipped,
            missing,
            total_ms: milliseconds,
            max_ms: milliseconds,
            clearance: report.clearance.and_then(|c| Some(c.closest?.ratio)),
        }
    }

    /// Adds the frames of the next bin.
    fn add(&mut self, next: &Bin) {
        self.last_frame = next.last_frame;
        self.frames += next.frames;
        for (sum, n) in self.verdicts.iter_mut().zip(next.verdicts) {
            *sum += n;
        }
        let links = self.links.into_iter().chain(next.links);
        self.links = links.reduce(|a, b| per_axis(|k| a[k].max(b[k])));
        self.pull_throughs += next.pull_throughs;
        self.unresolved += next.unresolved;
        self.skipped = self.skipped.saturating_add(next.skipped);
        self.missing = self.missing.saturating_add(next.missing);
        self.total_ms += next.total_ms;
        self.max_ms = self.max_ms.max(next.max_ms);
        let clearances = self.clearance.into_iter().chain(next.clearance);
        self.clearance = clearances.reduce(f64::min);
    }
}

/// All frames, in bins.
#[derive(Clone, Debug, Default)]
pub(super) struct Series {
    pub bins: Vec<Bin>,
}

impl Series {
    /// Returns the number of frames of each bin but the last, which may have fewer.
    pub fn width(&self) -> u64 {
        self.bins.first().map_or(1, |bin| bin.frames)
    }

    /// Adds a frame, with the time from its receipt to its report, and the numbers of frames
    /// before it that were not verified, and that are not in the recording.
    pub fn add(&mut self, report: &Report, milliseconds: f64, lost: [u64; 2]) {
        let bin = Bin::of(report, milliseconds, lost);
        let full = self.bins.last().is_none_or(|b| b.frames == self.width());
        if full && self.bins.len() == MOST {
            let (pairs, _) = self.bins.as_chunks_mut();
            pairs.iter_mut().for_each(|[a, b]| a.add(b));
            self.bins = self.bins.drain(..).step_by(2).collect();
        }
        let width = self.width();
        match self.bins.last_mut() {
            Some(last) if last.frames < width => last.add(&bin),
            _ => self.bins.push(bin),
        }
    }

    /// Returns the position of the bin that has a frame.
    pub fn bin_of(&self, frame: u64) -> Option<usize> {
        let within = |b: &Bin| (b.first.frame..=b.last_frame).contains(&frame);
        self.bins.iter().position(within)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::verdict::{Clearance, PullThrough};

    fn series(frames: u64, broken: u64) -> Series {
        let mut series = Series::default();
        for seq in 0..frames {
            let verdict = match seq == broken {
                true => Verdict::Changed,
                false => Verdict::Intact,
            };
            let mut report = Report::new(seq, seq as f64, verdict);
            if seq == broken {
                report.events = vec![PullThrough {
                    i: 0,
                    j: 1,
                    image: Default::default(),
                    segments: [0, 0],
                    fraction: 0.5,
                    sign: 1,
                    point: [0.0; 3],
                    lengths: 0.5,
                }];
            }
            report.clearance = Some(Clearance {
                at_least: 1.0,
                closest: None,
                low: false,
                frames_left: None,
            });
            series.add(&report, 1.0, [1, 0]);
        }
        series
    }

    #[test]
    fn few_frames_have_a_bin_each() {
        let series = series(MOST as u64, 7);
        assert_eq!((series.bins.len(), series.width()), (MOST, 1));
        assert_eq!(series.bins[7].verdicts[Verdict::Changed as usize], 1);
        assert_eq!(series.bin_of(7), Some(7));
        assert_eq!(series.bin_of(MOST as u64), None);
    }

    #[test]
    fn a_million_frames_take_a_few_bins_and_none_is_lost() {
        let series = series(1_000_000, 777_777);
        assert!(series.bins.len() <= MOST, "{}", series.bins.len());
        assert!(series.bins.len() >= MOST / 2, "{}", series.bins.len());
        let sum = |of: fn(&Bin) -> u64| series.bins.iter().map(of).sum::<u64>();
        assert_eq!(sum(|b| b.frames), 1_000_000);
        assert_eq!(sum(|b| b.skipped), 1_000_000);
        assert_eq!(sum(|b| b.pull_throughs), 1);
        assert_eq!(sum(|b| b.verdicts[Verdict::Changed as usize]), 1);
        let bin = series.bin_of(777_777).unwrap();
        assert_eq!(series.bins[bin].verdicts[Verdict::Changed as usize], 1);
        let mut next = 0;
        for bin in &series.bins {
            assert_eq!((bin.first.frame, bin.max_ms), (next, 1.0));
            next = bin.last_frame + 1;
        }
    }
}
