//! `replay --bisect`: finds the first changed frame without verifying all.
//!
//! A recording is searched by bisection, each frame in full and alone against the baseline. Frames
//! of a model file cannot be skipped, so they are verified one by one, up to the first changed one.

mod print;

use self::print::{Found, Recorded};
use super::Args;
use super::verify::recorded_events;
use crate::cli::Outcome;
use crate::cli::cell_args::{CellArgs, say};
use crate::cli::output::with_progress;
use crate::cli::run::{Baseline, Judge};
use crate::cli::source::{Frame, Item, Recording, Source, warn_of_cut};
use linkwatch::{
    AbortOn, Cause, Certificate, CurveSet, Defect, DefectKind, Ending, Error, Events, FrameInfo,
    FramePlace, Outline, Received, RecordedItem, Report, Result, Session, SessionOptions, Strategy,
    Verdict, bisect,
};
use std::path::Path;
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
    fn new(frame: Frame) -> Result<Loaded> {
        Ok(Loaded {
            info: frame.info.clone(),
            curves: Arc::new(frame.curves()?),
        })
    }

    /// Verifies the frame. Returns the report; the frame has the curves and the cell with which it
    /// was verified then.
    ///
    /// Errors: those of [`Session::verify`], and the reason why the frame is rejected.
    fn feed(&mut self, session: &mut Session, name: &Path) -> Result<Report> {
        let given = Received::new(self.info.clone(), Ok(Arc::clone(&self.curves)));
        let verified = session.verify(given)?;
        say(&name.display(), &verified.notes);
        let Some(curves) = verified.curves else {
            return Err(Error::Usage(verified.report.rejected.unwrap_or_default()));
        };
        (self.curves, self.info) = (curves, verified.info);
        Ok(verified.report)
    }
}

/// Settings of the verification.
struct Settings {
    options: SessionOptions,
    /// Pull-throughs to search for in the step to the changed frame.
    events: Events,
    /// Motion limit of that search.
    limit: f64,
}

impl Settings {
    fn new(args: &Args, cells: CellArgs, recorded: Option<(Events, f64)>) -> Result<Settings> {
        let judge = &args.judge;
        let (recorded, limit) = recorded.unwrap_or((Events::Off, SessionOptions::MOTION_LIMIT));
        let baseline = match &judge.baseline {
            Some(Baseline::File(path)) => Some(Certificate::read(path)?),
            _ => None,
        };
        Ok(Settings {
            options: SessionOptions {
                abort_on: AbortOn::Never,
                baseline,
                cell: cells.given(),
                ignore_cell: cells.ignores_cells(),
                wrapped: cells.wrapped(),
                keep_open: cells.keep_open(),
                max_pairs: judge.max_pairs.unwrap_or(SessionOptions::MAX_PAIRS),
                ..SessionOptions::default()
            },
            events: judge.event_args.events(AbortOn::Never, recorded),
            limit: judge.event_args.motion_limit.unwrap_or(limit),
        })
    }

    /// Returns a session that searches for pull-throughs.
    fn searching(&self, strategy: Strategy) -> Result<Session> {
        let limit = (self.events != Events::Off).then_some(self.limit);
        Session::new(SessionOptions {
            strategy,
            events: self.events,
            motion_limit: limit,
            ..self.options.clone()
        })
    }
}

/// Runs the command.
pub fn run(args: &Args, mut source: Source, json: bool) -> Result<Outcome> {
    let judge: &Judge = &args.judge;
    if args.range.from.is_some() && judge.baseline.is_none() && source.recording().is_none() {
        tracing::info!("the baseline is the first frame of the range");
    }
    let start = Instant::now();
    let path = source.path().to_owned();
    let in_file = |e: Error| match e {
        Error::NothingClosed { curves, .. } => Error::Usage(format!(
            "{}: none of {curves} curves is closed, and --bisect compares linking numbers; \
             `linkwatch replay --events=between` verifies every step",
            path.display()
        )),
        other => other.in_file(&path),
    };
    let mut ending = None;
    let found = match source.recording() {
        Some(reader) => {
            let mut search = Search::new(args, reader, &path).map_err(in_file)?;
            ending = search.ending.take();
            search.run().map_err(in_file)?
        }
        None => in_sequence(args, &mut source).map_err(in_file)?,
    };
    let cut = warn_of_cut(&path, ending.as_ref());
    let outcome = found.outcome();
    found.print(&path, start.elapsed(), json);
    Ok(match outcome {
        Outcome::Fine if cut || source.lacks_curves() => Outcome::Undecided,
        outcome => outcome,
    })
}

/// A search in a recording.
struct Search<'a> {
    reader: &'a mut Recording,
    settings: Settings,
    session: Session,
    path: &'a Path,
    frames: Vec<FramePlace>,
    outline: Outline,
    /// End of the file, if no frame there is after the range.
    ending: Option<Ending>,
    /// Layout of the curves of the first frame that was verified.
    layout: Option<FrameInfo>,
    /// Reports on the verified frames, by their index.
    reports: Vec<(usize, Report)>,
}

impl<'a> Search<'a> {
    fn new(args: &Args, reader: &'a mut Recording, path: &'a Path) -> Result<Search<'a>> {
        let baseline = read_baseline(reader)?;
        let recorded = recorded_events(reader.metadata());
        let cells = args.judge.cell_args.or_recorded(reader.metadata());
        let mut settings = Settings::new(args, cells, Some(recorded))?;
        if args.judge.baseline.is_none() {
            settings.options.baseline = baseline;
        }
        let mut outline = reader.outline()?;
        let range = args.range;
        let mut frames = std::mem::take(&mut outline.frames);
        let ends_before = frames.iter().any(|f| range.is_before(f.seq, f.time));
        let ending = reader.ending().filter(|_| !ends_before).cloned();
        frames.retain(|frame| range.contains(frame.seq, frame.time));
        let verdicts = &mut outline.verdicts;
        verdicts.retain(|verdict| range.contains(verdict.at.seq, verdict.at.time));
        if frames.is_empty() {
            return Err(Error::Usage(format!(
                "{}: no frame to verify",
                path.display()
            )));
        }
        let mut search = Search {
            reader,
            session: Session::new(settings.options.clone())?,
            settings,
            path,
            frames,
            outline,
            ending,
            layout: None,
            reports: Vec::new(),
        };
        if search.settings.options.baseline.is_none() {
            // The first frame is the baseline.
            let _ = search.verify(0)?;
            search.settings.options.baseline = search.session.baseline().cloned();
        }
        Ok(search)
    }

    fn run(mut self) -> Result<Found> {
        let last = self.frames.len() - 1;
        let mut first = bisect(0..=last, |frame| self.is_changed(frame))?;
        // An earlier change may have reverted, or changed no linking number.
        let recorded = self.recorded_change();
        let earlier = recorded.filter(|(frame, _)| first.is_none_or(|first| *frame < first));
        let mut step = None;
        match earlier {
            Some((frame, true)) => {
                first = bisect(0..=frame, |frame| self.is_changed(frame))?.or(first);
            }
            Some((frame, false)) if frame > 0 && self.settings.events != Events::Off => {
                let search = self.search_step(frame)?;
                if search.report.verdict == Verdict::Changed {
                    (first, step) = (Some(frame), Some(search));
                }
            }
            _ => {}
        }
        let mut found = Found {
            frames: self.frames.len(),
            names: self.load(first.unwrap_or(last))?.info.labels.names.clone(),
            ..Found::default()
        };
        match first {
            None => found.before = self.report(last),
            Some(changed) => {
                if step.is_none() && changed > 0 && self.settings.events != Events::Off {
                    step = Some(self.search_step(changed)?);
                }
                found.changed = match &step {
                    Some(step) => Some(step.report.clone()),
                    None => self.report(changed),
                };
                found.before = changed
                    .checked_sub(1)
                    .and_then(|before| self.report(before));
            }
        }
        found.step = step;
        found.verified = self.reports.len();
        found.recorded = self.compare_with_recorded(first, recorded.map(|(frame, _)| frame));
        Ok(found)
    }

    /// Searches the step to a frame for pull-throughs. Begins with the last intact frame before it,
    /// if that is one of the last few: a passage through a contact takes several frames.
    fn search_step(&mut self, frame: usize) -> Result<Step> {
        let mut start = frame - 1;
        while self.verdict(start)? != Verdict::Intact && start > 0 && frame - start < CONTACT {
            start -= 1;
        }
        let mut session = self.settings.searching(Strategy::Full)?;
        let mut before = self.load(start)?;
        let _ = before.feed(&mut session, self.path)?;
        for k in start + 1..=frame {
            let mut next = self.load(k)?;
            let report = next.feed(&mut session, self.path)?;
            if k == frame {
                return Ok(Step::new(report, &[before, next]));
            }
            before = next;
        }
        unreachable!("the loop ends with the frame")
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
        let first = self.layout.get_or_insert_with(|| loaded.info.clone());
        if first.layout != loaded.info.layout {
            return Err(Error::Usage(format!(
                "{}: the curves of frame {} are others than those of the first frame that was \
                 verified, so it cannot be compared alone; limit --bisect to frames of the same \
                 curves with --from and --to, or verify all frames without it",
                self.path.display(),
                loaded.info.seq
            )));
        }
        let title = format!("frame {}", loaded.info.seq);
        let report = with_progress(&title, self.session.progress(), || {
            loaded.feed(&mut self.session, self.path)
        })?;
        let is_fresh = |d: &Defect| d.kind == DefectKind::NoBaseline;
        let adopted = report.defects.iter().any(is_fresh);
        if self.settings.options.baseline.is_some() && (adopted || loaded.info.cell.is_some()) {
            // Each frame is compared with the same baseline. A cell would be followed from frame to
            // frame.
            self.session = Session::new(self.settings.options.clone())?;
        }
        self.reports.push((frame, report.clone()));
        Ok(report)
    }

    fn load(&mut self, frame: usize) -> Result<Loaded> {
        let place = &self.frames[frame];
        self.reader.go_to(place)?;
        match self.reader.next_item()? {
            Some(RecordedItem::Frame(frame)) if frame.seq == place.seq => Loaded::new(frame.into()),
            _ => Err(Error::Usage(format!(
                "{}: frame {} is not at its place: the file changed while it was read",
                self.path.display(),
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
        if self.outline.verdicts.is_empty() {
            return None;
        }
        let seq = |frame: usize| self.frames[frame].seq;
        Some(match (found, recorded) {
            _ if found == recorded => Recorded {
                agrees: true,
                words: "the recorded verdicts say the same".into(),
            },
            (_, Some(frame)) => Recorded {
                agrees: false,
                words: format!(
                    "the recorded verdicts disagree: their first changed frame is {}; verify all \
                     frames without --bisect, with --events=between for pull-throughs that change \
                     no linking number",
                    seq(frame)
                ),
            },
            (_, None) => Recorded {
                agrees: false,
                words: "the recorded verdicts disagree: they call no frame changed; `linkwatch \
                        replay` without --bisect verifies them"
                    .into(),
            },
        })
    }
}

/// Reads the baseline of a recording, if it has one before its first frame.
fn read_baseline(reader: &mut Recording) -> Result<Option<Certificate>> {
    while let Some(item) = reader.next_item()? {
        match item {
            RecordedItem::Baseline(b) => return Ok(Some(Arc::unwrap_or_clone(b.certificate))),
            RecordedItem::Frame(_) => break,
            RecordedItem::Verdict(_) => {}
        }
    }
    Ok(None)
}

/// Verifies the frames of a model file one by one, up to the first changed one.
fn in_sequence(args: &Args, source: &mut Source) -> Result<Found> {
    let settings = Settings::new(args, args.judge.cell_args, None)?;
    let mut session = settings.searching(Strategy::Incremental)?;
    let mut found = Found {
        in_sequence: true,
        ..Found::default()
    };
    let mut before: Option<Loaded> = None;
    while let Some(item) = source.next()? {
        let Item::Frame(frame) = item else {
            continue;
        };
        if args.range.is_before(frame.seq, frame.time) {
            break;
        }
        if args.range.is_after(frame.seq, frame.time) {
            continue;
        }
        let seq = frame.seq;
        let at_frame = |e: Error| match e {
            e @ Error::NothingClosed { .. } => e,
            e => Error::Usage(format!("frame {seq}: {e}")),
        };
        frame.check_one_run()?;
        let mut frame = Loaded::new(*frame).map_err(at_frame)?;
        if before
            .as_ref()
            .is_some_and(|b| b.info.layout != frame.info.layout)
        {
            return Err(Error::Usage(format!(
                "frame {seq} has other curves than the frames before it; limit --bisect to frames \
                 of the same curves with --from and --to, or verify all frames without it"
            )));
        }
        let report = frame.feed(&mut session, &args.file).map_err(at_frame)?;
        found.frames += 1;
        found.verified += 1;
        if report.verdict == Verdict::Changed {
            found.names = frame.info.labels.names.clone();
            if let Some(before) = before
                && settings.events != Events::Off
            {
                found.step = Some(Step::new(report.clone(), &[before, frame]));
            }
            found.changed = Some(report);
            return Ok(found);
        }
        found.before = Some(report);
        before = Some(frame);
    }
    if found.frames == 0 {
        return Err(Error::Usage("no frame to verify".into()));
    }
    Ok(found)
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
