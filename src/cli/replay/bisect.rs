//! `replay --bisect`: finds the first changed frame of a recording without verifying all: by
//! bisection, each frame in full and alone against the baseline.

mod print;

use self::print::{Found, Recorded};
use super::Args;
use super::verify::recorded_events;
use crate::cli::Outcome;
use crate::cli::cell_args::say;
use crate::cli::output::with_progress;
use crate::cli::run::Baseline;
use crate::cli::source::{Source, warn_of_cut};
use linkwatch::{
    AbortOn, Cause, Certificate, CurveSet, Defect, DefectKind, Ending, Error, Events, FrameInfo,
    FramePlace, Outline, Received, RecordedItem, Report, Result, Session, SessionOptions, Verdict,
    bisect,
};
use std::sync::Arc;
use std::time::Instant;

/// Number of frames before a changed one in which an intact one is searched, as the start of a
/// passage through a contact.
const CONTACT: usize = 16;

/// A frame in memory.
struct Loaded {
    info: FrameInfo,
    curves: Arc<CurveSet>,
}

impl Loaded {
    /// Verifies the frame. Returns the report; the frame has the curves and the cell with which it
    /// was verified then.
    ///
    /// Errors: those of [`Session::verify`], and the reason why the frame is rejected.
    fn feed(&mut self, session: &mut Session) -> Result<Report> {
        let given = Received::new(self.info.clone(), Ok(Arc::clone(&self.curves)));
        let verified = session.verify(given)?;
        say(&"the recording", &verified.notes);
        let Some(curves) = verified.curves else {
            return Err(Error::Usage(verified.report.rejected.unwrap_or_default()));
        };
        (self.curves, self.info) = (curves, verified.info);
        Ok(verified.report)
    }
}

/// Runs the command.
pub fn run(args: &Args, source: Source, json: bool) -> Result<Outcome> {
    let start = Instant::now();
    let path = source.path.clone();
    let mut ending = None;
    let mut lacks_curves = false;
    let search = || {
        let mut search = Search::new(args, source)?;
        ending = search.ending.take();
        let found = search.run();
        lacks_curves = search.source.lacks_curves;
        found
    };
    let found = search().map_err(|e| match e {
        Error::NothingClosed { curves, .. } => Error::Usage(format!(
            "{}: none of {curves} curves is closed, and --bisect compares linking numbers; \
             `linkwatch replay --events=between` verifies every step",
            path.display()
        )),
        other => other.in_file(&path),
    })?;
    let cut = warn_of_cut(&path, ending.as_ref());
    let outcome = found.outcome();
    found.print(&path, start.elapsed(), json);
    Ok(match outcome {
        Outcome::Fine if cut || lacks_curves => Outcome::Undecided,
        outcome => outcome,
    })
}

/// A search in a recording.
struct Search {
    source: Source,
    options: SessionOptions,
    /// Pull-throughs to search for in the step to the changed frame, and their motion limit.
    events: (Events, f64),
    session: Session,
    frames: Vec<FramePlace>,
    outline: Outline,
    /// End of the file, if no frame there is after the range.
    ending: Option<Ending>,
    /// Layout of the curves of the first frame that was verified.
    layout: Option<u32>,
    /// Reports on the verified frames, by their index.
    reports: Vec<(usize, Report)>,
}

impl Search {
    fn new(args: &Args, mut source: Source) -> Result<Search> {
        let (judge, range) = (&args.judge, args.range);
        let mut baseline = read_baseline(&mut source)?;
        if let Some(given) = &judge.baseline {
            baseline = match given {
                Baseline::File(path) => Some(Certificate::read(path)?),
                Baseline::FirstFrame => None,
            };
        }
        let reader = &mut source.reader;
        let cells = judge.cell_args.or_recorded(reader.metadata());
        let (events, limit) = recorded_events(reader.metadata());
        let mut outline = reader.outline()?;
        let mut frames = std::mem::take(&mut outline.frames);
        let ends_before = frames.iter().any(|f| range.is_before(f.seq, f.time));
        let ending = reader.ending().filter(|_| !ends_before).cloned();
        frames.retain(|frame| range.contains(frame.seq, frame.time));
        let verdicts = &mut outline.verdicts;
        verdicts.retain(|verdict| range.contains(verdict.at.seq, verdict.at.time));
        if frames.is_empty() {
            return Err(Error::Usage("no frame to verify".into()));
        }
        let options = SessionOptions {
            abort_on: AbortOn::Never,
            baseline,
            cell: cells.given(),
            ignore_cell: cells.ignores_cells(),
            wrapped: cells.wrapped(),
            keep_open: cells.keep_open(),
            max_pairs: judge.max_pairs.unwrap_or(SessionOptions::MAX_PAIRS),
            ..SessionOptions::default()
        };
        let mut search = Search {
            source,
            session: Session::new(options.clone())?,
            options,
            events: (
                judge.event_args.events(AbortOn::Never, events),
                judge.event_args.motion_limit.unwrap_or(limit),
            ),
            frames,
            outline,
            ending,
            layout: None,
            reports: Vec::new(),
        };
        if search.options.baseline.is_none() {
            // The first frame is the baseline.
            let _ = search.verify(0)?;
            search.options.baseline = search.session.baseline().cloned();
        }
        Ok(search)
    }

    fn run(&mut self) -> Result<Found> {
        let last = self.frames.len() - 1;
        let searches = self.events.0 != Events::Off;
        let mut first = bisect(0..=last, |frame| self.is_changed(frame))?;
        // An earlier change may have reverted, or changed no linking number.
        let recorded = self.recorded_change();
        let earlier = recorded.filter(|(frame, _)| first.is_none_or(|first| *frame < first));
        let mut step = None;
        match earlier {
            Some((frame, true)) => {
                first = bisect(0..=frame, |frame| self.is_changed(frame))?.or(first);
            }
            Some((frame, false)) if frame > 0 && searches => {
                let search = self.search_step(frame)?;
                if search.report.verdict == Verdict::Changed {
                    (first, step) = (Some(frame), Some(search));
                }
            }
            _ => {}
        }
        if let Some(changed @ 1..) = first
            && step.is_none()
            && searches
        {
            step = Some(self.search_step(changed)?);
        }
        let of_step = step.as_ref().map(|step| step.report.clone());
        let before = match first {
            Some(changed) => changed.checked_sub(1),
            None => Some(last),
        };
        Ok(Found {
            frames: self.frames.len(),
            names: self.load(first.unwrap_or(last))?.info.labels.names.clone(),
            changed: of_step.or(first.and_then(|changed| self.report(changed))),
            before: before.and_then(|before| self.report(before)),
            step,
            verified: self.reports.len(),
            recorded: self.compare_with_recorded(first, recorded.map(|(frame, _)| frame)),
        })
    }

    /// Searches the step to a frame for pull-throughs. Begins with the last intact frame before it,
    /// if that is one of the last few: a passage through a contact takes several frames.
    fn search_step(&mut self, frame: usize) -> Result<Step> {
        let mut start = frame - 1;
        while self.verdict(start)? != Verdict::Intact && start > 0 && frame - start < CONTACT {
            start -= 1;
        }
        let (events, limit) = self.events;
        let mut session = Session::new(SessionOptions {
            events,
            motion_limit: Some(limit),
            ..self.options.clone()
        })?;
        let mut before = self.load(start)?;
        let _ = before.feed(&mut session)?;
        for k in start + 1..frame {
            before = self.load(k)?;
            let _ = before.feed(&mut session)?;
        }
        let mut after = self.load(frame)?;
        let report = after.feed(&mut session)?;
        Ok(Step::new(report, &[before, after]))
    }

    fn report(&self, frame: usize) -> Option<Report> {
        let known = self.reports.iter().find(|(k, _)| *k == frame);
        known.map(|(_, report)| report.clone())
    }

    fn is_changed(&mut self, frame: usize) -> Result<bool> {
        Ok(self.verdict(frame)? == Verdict::Changed)
    }

    /// Returns the verdict on a frame alone, which is verified once.
    fn verdict(&mut self, frame: usize) -> Result<Verdict> {
        match self.report(frame) {
            Some(report) => Ok(report.verdict),
            None => Ok(self.verify(frame)?.verdict),
        }
    }

    /// Verifies a frame alone.
    fn verify(&mut self, frame: usize) -> Result<Report> {
        let mut loaded = self.load(frame)?;
        let layout = loaded.info.layout;
        if *self.layout.get_or_insert(layout) != layout {
            return Err(Error::Usage(format!(
                "the curves of frame {} are others than those of the first frame that was \
                 verified, so it cannot be compared alone; limit --bisect to frames of the same \
                 curves with --from and --to, or verify all frames without it",
                loaded.info.seq
            )));
        }
        let title = format!("frame {}", loaded.info.seq);
        let report = with_progress(&title, self.session.progress(), || {
            loaded.feed(&mut self.session)
        })?;
        let is_fresh = |d: &Defect| d.kind == DefectKind::NoBaseline;
        let adopted = report.defects.iter().any(is_fresh);
        if self.options.baseline.is_some() && (adopted || loaded.info.cell.is_some()) {
            // Each frame is compared with the same baseline. A cell would be followed from frame to
            // frame.
            self.session = Session::new(self.options.clone())?;
        }
        self.reports.push((frame, report.clone()));
        Ok(report)
    }

    fn load(&mut self, frame: usize) -> Result<Loaded> {
        let place = &self.frames[frame];
        self.source.reader.go_to(place)?;
        match self.source.next()? {
            Some(RecordedItem::Frame(frame)) if frame.seq == place.seq => {
                let mut set = None;
                frame.ingest(&mut set)?;
                Ok(Loaded {
                    curves: Arc::new(set.expect("set by a frame without errors")),
                    info: frame.info,
                })
            }
            _ => Err(Error::Usage(format!(
                "frame {} is not at its place: the file changed while it was read",
                place.seq
            ))),
        }
    }

    /// Returns the first frame that the recorded verdicts call changed, and true if its linking
    /// numbers changed.
    fn recorded_change(&self) -> Option<(usize, bool)> {
        let mut verdicts = self.outline.verdicts.iter();
        let first = verdicts.find(|v| v.verdict == Verdict::Changed)?;
        let mut frames = self.frames.iter();
        let frame = frames.position(|frame| frame.seq == first.at.seq)?;
        Some((frame, first.changes > 0))
    }

    /// Compares the result with the recorded verdicts, if there are any.
    fn compare_with_recorded(
        &self,
        found: Option<usize>,
        recorded: Option<usize>,
    ) -> Option<Recorded> {
        let words = match recorded {
            _ if self.outline.verdicts.is_empty() => return None,
            _ if found == recorded => "the recorded verdicts say the same".into(),
            Some(frame) => format!(
                "the recorded verdicts disagree: their first changed frame is {}; verify all \
                 frames without --bisect, with --events=between for pull-throughs that change no \
                 linking number",
                self.frames[frame].seq
            ),
            None => "the recorded verdicts disagree: they call no frame changed; `linkwatch \
                     replay` without --bisect verifies them"
                .into(),
        };
        Some(Recorded {
            agrees: found == recorded,
            words,
        })
    }
}

/// Reads the baseline of a recording, if it has one before its first frame.
fn read_baseline(source: &mut Source) -> Result<Option<Certificate>> {
    while let Some(item) = source.next()? {
        match item {
            RecordedItem::Baseline(b) => return Ok(Some(Arc::unwrap_or_clone(b.certificate))),
            RecordedItem::Frame(_) => break,
            RecordedItem::Verdict(_) => {}
        }
    }
    Ok(None)
}

/// The step to the changed frame.
struct Step {
    report: Report,
    /// Numbers of both frames.
    frames: [u64; 2],
    /// True if the simulator rolled back or jumped between the frames.
    cut: bool,
    /// Causes of the pull-throughs, in their order.
    causes: Vec<Cause>,
}

impl Step {
    fn new(report: Report, [before, after]: &[Loaded; 2]) -> Step {
        let times = (after.info.time - before.info.time, after.info.time_step);
        let frames = [&*before.curves, &*after.curves];
        let cells = [before.info.cell, after.info.cell];
        let events = report.events.iter();
        Step {
            causes: events
                .map(|event| Cause::of(event, frames, cells, times))
                .collect(),
            frames: [before.info.seq, after.info.seq],
            cut: before.info.cuts != after.info.cuts,
            report,
        }
    }
}
