//! Sweeps: how far a model can be reduced before its topology breaks (Qu & James 2021, section
//! 4.3.2).
//!
//! A sweep reduces a model step by step, from fine to coarse, by quantization of its coordinates or
//! by resampling of its curves:
//!
//! ```text
//! original ─▶ step 1 ─▶ step 2 ─▶ ..   pull-throughs from each step to the next
//!     └──────────┴─────────┴─────────  linking numbers of each step and of the original
//! ```
//!
//! Each step is compared with the original. A large reduction may make several errors that cancel
//! in the linking numbers. So the pull-throughs of the straight motion from each step to the next
//! are searched for, too; a step after a pull-through is not intact, whatever its linking numbers.
//!
//! Steps of a resampling differ in their numbers of points. Both curves of such a motion are cut
//! into the same pieces, and the points at equal shares of their lengths belong together.
//!
//! Cost: a verification per step; a step of a resampling takes three, one of them with a search for
//! pull-throughs. Memory: two steps.
//!
//! Limits: nothing is known about reductions between two steps. Pull-throughs in motions longer
//! than [`SessionOptions::motion_limit`] that cancel are undecided; smaller steps decide them.

mod along;
mod plot;
mod quantize;
mod refine;
mod resample;
#[cfg(test)]
mod tests;

pub use plot::plot;
pub use quantize::{MOST_BITS, quantize};
pub use resample::resample;

use self::refine::{By, refine};
use crate::curve::CurveSet;
use crate::engine::{Progress, SessionOptions, Strategy};
use crate::error::{Error, Result};
use crate::incremental::Events;
use crate::ingest::FrameInfo;
use crate::periodic::period;
use crate::session::{Received, Session, VerifiedFrame};
use crate::verdict::{Report, Verdict};
use std::fmt;
use std::sync::Arc;

/// A reduction of a model.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Reduction {
    /// Quantization to this number of bits per coordinate ([`quantize`]).
    Bits(u32),
    /// Resampling to this share of the control points ([`resample`]).
    Share(f64),
}

impl Reduction {
    /// Returns the reduced curves.
    ///
    /// Errors: those of [`quantize`] and [`resample`].
    pub fn apply(self, set: &CurveSet) -> Result<CurveSet> {
        match self {
            Reduction::Bits(bits) => quantize(set, bits),
            Reduction::Share(share) => resample(set, share),
        }
    }

    /// Checks that this reduction of the curves is possible.
    fn check(self, set: &CurveSet) -> Result<()> {
        match self {
            Reduction::Bits(bits) => quantize::check_bits(bits),
            Reduction::Share(share) => resample::check(set, share),
        }
    }
}

impl fmt::Display for Reduction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Reduction::Bits(1) => f.write_str("1 bit"),
            Reduction::Bits(bits) => write!(f, "{bits} bits"),
            Reduction::Share(share) => {
                // Without the rounding errors of the steps of a range.
                write!(f, "{} % of the points", (share * 1e8).round() / 1e6)
            }
        }
    }
}

/// A step of a sweep.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct SweepStep {
    /// Reduction of the original.
    pub reduction: Reduction,
    /// The reduced curves.
    pub curves: CurveSet,
    /// Verdict on the reduction: changed if a linking number differs from that of the original, or
    /// if a curve was pulled through another one in any step so far. Undecided if neither is
    /// proven.
    pub verdict: Verdict,
    /// Findings of this step: linking numbers that differ from those of the original, and the
    /// pull-throughs since the previous step. Segments are those of the reduced curves.
    pub report: Report,
}

impl SweepStep {
    /// Returns the number of pairs and pull-throughs that are undecided.
    pub fn undecided(&self) -> usize {
        self.report.defects.len() + self.report.unresolved.len()
    }
}

/// A sweep over reductions of a model: an iterator over its steps.
///
/// ```
/// use linkwatch::scenes::Scene;
/// use linkwatch::sweep::{Reduction, Sweep};
/// use linkwatch::{Verdict, SessionOptions};
///
/// let set = "knit:rows=2,stitches=16,segments=512".parse::<Scene>()?.build()?.curves;
/// let bits = [16, 12, 8, 4, 2].map(Reduction::Bits);
/// let sweep = Sweep::new(set, bits.to_vec(), SessionOptions::default())?;
/// let steps = sweep.collect::<Result<Vec<_>, _>>()?;
/// assert_eq!(steps[0].verdict, Verdict::Intact);
/// assert_ne!(steps[4].verdict, Verdict::Intact);
/// # Ok::<(), linkwatch::Error>(())
/// ```
pub struct Sweep {
    original: CurveSet,
    report: Report,
    reductions: std::vec::IntoIter<Reduction>,
    options: SessionOptions,
    /// Compares each step with the original.
    session: Session,
    /// The previous step.
    previous: CurveSet,
    seq: u64,
    /// True if a curve was pulled through another one in a step.
    passed: bool,
    /// True if that may have happened in a step.
    may_have_passed: bool,
}

impl Sweep {
    /// Verifies the original and prepares its reductions. If the options report no events,
    /// pull-throughs of each two curves are searched for ([`Events::Between`]).
    ///
    /// With a periodic cell ([`SessionOptions::cell`]), all images take part. Open curves stay
    /// open, also if they end where they start.
    ///
    /// Errors: [`Error::Usage`] if there is no reduction, if they are of both kinds, or if one of
    /// them is impossible, as quantization is of a curve that runs through the cell; errors of
    /// [`Session::new`] and [`Session::feed`].
    pub fn new(
        original: CurveSet,
        reductions: Vec<Reduction>,
        mut options: SessionOptions,
    ) -> Result<Sweep> {
        let shares = reductions
            .iter()
            .filter(|r| matches!(r, Reduction::Share(_)))
            .count();
        if reductions.is_empty() || shares != 0 && shares != reductions.len() {
            let what = "a sweep needs one reduction or more, all of one kind";
            return Err(Error::Usage(what.into()));
        }
        reductions.iter().try_for_each(|r| r.check(&original))?;
        if let Some(cell) = options.cell.filter(|_| shares == 0) {
            let mut curves = 0..original.len();
            if let Some(i) = curves.find(|&i| period(&original, i, &cell).is_some()) {
                return Err(Error::Usage(format!(
                    "curve {i} runs through the periodic cell: quantized, it would no longer end \
                     at the image of its start"
                )));
            }
        }
        if options.events == Events::Off {
            options.events = Events::Between;
        }
        options.keep_open = true;
        let mut of_numbers = options.clone();
        match shares {
            0 => of_numbers.strategy = Strategy::Incremental,
            // Numbers of points differ, so another session looks at the motion.
            _ => {
                of_numbers.events = Events::Off;
                of_numbers.motion_limit = None;
            }
        }
        let mut session = Session::new(of_numbers)?;
        let report = compare(&mut session, 0, &original)?;
        Ok(Sweep {
            previous: original.clone(),
            original,
            report,
            reductions: reductions.into_iter(),
            options,
            session,
            seq: 0,
            passed: false,
            may_have_passed: false,
        })
    }

    /// Returns the original curves.
    pub fn original(&self) -> &CurveSet {
        &self.original
    }

    /// Returns the report on the original: its defects, and work counters.
    pub fn original_report(&self) -> &Report {
        &self.report
    }

    /// Returns the number of links of the original.
    pub fn links(&self) -> usize {
        self.session.baseline().map_or(0, |baseline| {
            baseline.links.len() + baseline.images.as_ref().map_or(0, Vec::len)
        })
    }

    /// Returns a view of the progress of the comparison with the original.
    pub fn progress(&self) -> Arc<Progress> {
        self.session.progress()
    }

    fn step(&mut self, reduction: Reduction) -> Result<SweepStep> {
        self.seq += 1;
        let curves = reduction.apply(&self.original)?;
        let mut report = compare(&mut self.session, self.seq, &curves)?;
        if let Reduction::Share(_) = reduction {
            self.add_motion(&curves, &mut report)?;
        }
        self.passed |= !report.events.is_empty();
        let undecided = report.defects.iter().any(|d| d.kind.is_of_step());
        self.may_have_passed |= undecided || !report.unresolved.is_empty();
        let verdict = match report.verdict {
            _ if self.passed => Verdict::Changed,
            Verdict::Intact if self.may_have_passed => Verdict::Undecided,
            verdict => verdict,
        };
        self.previous = curves.clone();
        Ok(SweepStep {
            reduction,
            curves,
            verdict,
            report,
        })
    }

    /// Adds the pull-throughs of the motion from the previous step to curves with other numbers of
    /// points.
    fn add_motion(&self, curves: &CurveSet, report: &mut Report) -> Result<()> {
        let by = if self.seq == 1 {
            By::Length
        } else {
            By::Segments
        };
        let [from, to] = refine((&self.previous, by), (curves, By::Segments))?;
        let mut session = Session::new(self.options.clone())?;
        verify(&mut session, 0, &from.set)?;
        let mut motion = verify(&mut session, 1, &to.set)?.report;
        for event in motion.events.iter_mut().chain(&mut motion.unresolved) {
            let [s, t] = event.segments;
            event.segments = [to.segment(event.i, s), to.segment(event.j, t)];
        }
        for mut defect in motion.defects.into_iter().filter(|d| d.kind.is_of_step()) {
            let [s, t] = defect.place.segments;
            let j = defect.j.unwrap_or(defect.i);
            defect.place.segments = [to.segment(defect.i, s), to.segment(j, t)];
            report.defects.push(defect);
        }
        report.defects.sort_by_key(|d| (d.i, d.j, d.image));
        report.events = motion.events;
        report.unresolved = motion.unresolved;
        report.verdict = report.verdict_of_findings();
        Ok(())
    }
}

impl Iterator for Sweep {
    type Item = Result<SweepStep>;

    fn next(&mut self) -> Option<Result<SweepStep>> {
        let reduction = self.reductions.next()?;
        let step = self.step(reduction);
        if step.is_err() {
            // The next step would have no previous one.
            self.reductions = Vec::new().into_iter();
        }
        Some(step)
    }
}

/// Compares the linking numbers of curves with those of the first ones. Open curves have none.
fn compare(session: &mut Session, seq: u64, set: &CurveSet) -> Result<Report> {
    match verify(session, seq, set) {
        // Only their pull-throughs are searched for.
        Err(Error::NothingClosed { .. }) if !set.is_empty() => {
            Ok(Report::new(seq, 0.0, Verdict::Intact))
        }
        verified => Ok(verified?.report),
    }
}

/// Verifies a frame.
///
/// Errors: those of [`Session::verify`], and the reason why the frame is rejected.
fn verify(session: &mut Session, seq: u64, set: &CurveSet) -> Result<VerifiedFrame> {
    let frame = Received::new(FrameInfo::at(seq, 0.0), Ok(Arc::new(set.clone())));
    session.verify(frame)?.valid()
}
