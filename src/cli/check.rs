//! `linkwatch check`: compares models with a certificate, or with the first of them.

use super::Outcome;
use super::braid_args::BraidArgs;
use super::cell_args::CellArgs;
use super::each::EachArgs;
use super::event_args::EventArgs;
use super::input::{self, FormatArgs};
use super::output::with_progress;
use super::run::{Baseline, Judge, JunitArgs, Run, Setup, Sinks};
use super::sequence::{Frame, Sequence};
use crate::curve::Metric;
use crate::curve::vector::{distance, per_axis};
use linkwatch::formats::{ReadOptions, without_compression};
use linkwatch::{AbortOn, Cell, CurveSet, Error, Events, Point, Result, SessionOptions};
use std::collections::{BTreeMap, VecDeque};
use std::path::PathBuf;
use std::slice;

/// Compare the topology of models with a certificate, or with the first model
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Models or folders of them: the frames of one motion, sorted by number if their names differ
    /// in numbers only. Or files with several frames each: each is a run of its own
    #[arg(required = true, value_name = "MODEL")]
    models: Vec<PathBuf>,
    /// Keep the order in which the models are given
    #[arg(long)]
    keep_order: bool,
    /// Files with several frames each continue one another: all are frames of one motion
    #[arg(long)]
    one_motion: bool,
    #[command(flatten)]
    each_args: EachArgs,
    #[command(flatten)]
    format: FormatArgs,
    /// Expected linking numbers: those of the first model, or a certificate as `linkwatch certify
    /// -o` writes it [default: first-frame]
    #[arg(long, value_name = "first-frame|CERT", help_heading = super::COMPARE)]
    baseline: Option<Baseline>,
    #[command(flatten)]
    event_args: EventArgs,
    #[command(flatten)]
    braid_args: BraidArgs,
    #[command(flatten)]
    cell_args: CellArgs,
    /// Stop at the first change of a model, the most suspect pairs first
    #[arg(long, conflicts_with = "events", help_heading = super::COMPARE)]
    early_exit: bool,
    #[command(flatten)]
    junit: JunitArgs,
    #[command(flatten)]
    sinks: Sinks,
}

/// Largest number of frames that are read before the first one is verified.
const MOST_AHEAD: usize = 64;

/// Runs the command.
pub fn run(args: &Args, json: bool) -> Result<Outcome> {
    let models = match &args.each_args.only {
        Some(model) => vec![model.clone()],
        None if args.each_args.each => {
            let compared = (&args.baseline, &args.event_args, &args.braid_args);
            let options = (&args.format, compared, &args.cell_args, args.early_exit);
            let models = input::expand_models(&args.models)?;
            let certificate = match &args.baseline {
                Some(Baseline::File(path)) => Some(path.as_path()),
                _ => None,
            };
            let reads = |model: &PathBuf| {
                let others = [Some(model.as_path()), certificate, args.braid_args.file()];
                let others = others.into_iter().flatten().map(PathBuf::from);
                // The topology of oxDNA.
                let topology = without_compression(model).with_extension("top");
                let bonds = args.format.bonds(slice::from_ref(model));
                others.chain(bonds).chain([topology]).collect()
            };
            return args.each_args.run(&models, &format!("{options:?}"), reads);
        }
        None => input::expand(&args.models, args.keep_order)?,
    };
    let from_first_frame = !matches!(args.baseline, Some(Baseline::File(_)));
    let single = models.len() == 1 && !input::holds_frames(&models[0]);
    let options = ReadOptions {
        keep_order: args.keep_order,
        one_motion: args.one_motion,
        ..args.format.options(&args.cell_args)
    };
    let name = models[0].display().to_string();
    let metadata = BTreeMap::from([("models".to_owned(), models.len().to_string())]);
    let mut judge = Judge {
        baseline: args.baseline.clone(),
        abort_on: Some(AbortOn::Never),
        event_args: args.event_args.clone(),
        braid_args: args.braid_args.clone(),
        cell_args: CellArgs::of(&options),
        // The models are files of the user, and no simulator runs on.
        max_pairs: Some(usize::MAX),
        ..Judge::default()
    };
    let mut files = judge.files(args.sinks.overwrite);
    files.reads(&models);
    files.reads(args.format.bonds(&models));
    let mut frames = Sequence::new(&models, options)?;
    let mut ahead = VecDeque::new();
    let far = args.is_far_apart(&mut frames, &mut ahead);
    let several = ahead.len() > 1;
    if ahead.is_empty() {
        return Err(usage!("{name}: no frame"));
    }
    if from_first_frame
        && !several
        && let Some(first) = ahead.pop_front()
    {
        // If the frame cannot be read, that is the reason.
        let Frame { curves, path, .. } = first?;
        curves.map_err(|e| e.in_file(&path))?;
        return Err(usage!(
            "one frame and nothing to compare it with: also give later ones of its motion, \
                    or --baseline CERT (`linkwatch certify MODEL -o CERT` writes one)"
        ));
    }
    if let (false, Some(Ok(first))) = (from_first_frame, ahead.front())
        && !first.info.labels.names.is_empty()
    {
        tracing::warn!(
            "{}: its curves have names, but a certificate has numbers alone: curves are compared \
             in their order",
            first.name
        );
    }
    if !several || args.early_exit || far {
        // There is no step to search, or another option excludes it.
        judge.event_args.events.get_or_insert(Events::Off);
    }
    let setup = Setup {
        junit: args.junit.clone(),
        full: single || args.early_exit || far,
        early_exit: args.early_exit,
        models: true,
        title: format!("check of {name}"),
        metadata,
        json,
        ..Setup::default()
    };
    let mut run = Run::new(&judge, &args.sinks, files, setup)?;
    let mut failed = None;
    loop {
        if ahead.is_empty() {
            ahead.extend(frames.next());
        }
        let begins_run = |next: &Result<Frame>| matches!(next, Ok(frame) if frame.begins_run);
        if ahead.front().is_some_and(begins_run) {
            let far = args.is_far_apart(&mut frames, &mut ahead);
            let events = args.event_args.events(AbortOn::Never);
            let off = args.early_exit || far;
            run.begin_run(if off { Events::Off } else { events });
        }
        let Some(frame) = ahead.pop_front() else {
            break;
        };
        let judged = frame.and_then(|frame| {
            let (name, path) = (frame.name.clone(), frame.path.clone());
            if frame.after_gap && !frame.begins_run {
                run.begin_after_gap();
            }
            let progress = run.session.progress();
            let judged = with_progress(&name, progress, || run.judge(frame.received()));
            let mut judged = judged.map_err(|e| e.in_file(&path))?;
            judged.model = Some(name);
            Ok(judged)
        });
        match judged {
            Ok(judged) => run.publish(judged),
            Err(e) => {
                let nothing = has_nothing_to_verify(&e);
                // The other models still get their verdicts.
                match &failed {
                    None => failed = Some(e),
                    // The frames of a file fail in the same way.
                    Some(first) if first.to_string() == e.to_string() => {}
                    Some(_) => tracing::error!("{e}"),
                }
                // Without the first frame, there is no baseline for the others.
                if nothing && from_first_frame {
                    break;
                }
            }
        }
    }
    if frames.warn_of_unfinished() || failed.is_some() {
        run.data_lost();
    }
    let outcome = run.finish();
    failed.map_or(Ok(outcome), Err)
}

impl Args {
    /// Reads frames of a run up to the second one that will be verified. Returns true if both are
    /// so far apart that no step is searched, unless the user wants it.
    fn is_far_apart(&self, frames: &mut Sequence, ahead: &mut VecDeque<Result<Frame>>) -> bool {
        let step = first_step(frames, ahead, &self.cell_args);
        let step = step.filter(|_| !self.event_args.are_given());
        step.is_some_and(|step| are_far_apart(&self.cell_args, step.map(|k| &ahead[k])))
    }
}

/// Reads frames up to the second one that will be verified; rejected frames do not matter. Returns
/// the positions of these two frames if the step between them is searched.
fn first_step(
    frames: &mut Sequence,
    ahead: &mut VecDeque<Result<Frame>>,
    cell_args: &CellArgs,
) -> Option<[usize; 2]> {
    let is_valid = |frame: &Frame| match (&frame.curves, cell_args.cell(frame.info.cell)) {
        (Ok(curves), Some(cell)) => {
            cell_args.wrapped.is_some() || curves.check_whole(&cell).is_ok()
        }
        (curves, _) => curves.is_ok(),
    };
    let counts =
        |frame: &Frame| -> Vec<i32> { frame.curves.iter().flat_map(CurveSet::counts).collect() };
    let mut first: Option<(usize, Vec<i32>, u32)> = None;
    // True if a step that is not searched lies between the two.
    let mut apart = false;
    for k in 0..MOST_AHEAD {
        if k == ahead.len() {
            ahead.push_back(frames.next()?);
        }
        let Ok(frame) = &ahead[k] else {
            continue;
        };
        apart |= frame.begins_run || frame.after_gap;
        match &first {
            _ if !is_valid(frame) => {}
            None => {
                first = Some((k, counts(frame), frame.info.cuts));
                apart = false;
            }
            // Curves with names may come and go.
            Some((j, before, cuts))
                if !frame.info.labels.names.is_empty() || counts(frame) == *before =>
            {
                apart |= frame.info.cuts != *cuts;
                return (!apart).then_some([*j, k]);
            }
            Some(_) => {}
        }
    }
    None
}

/// Returns true, with a warning, if two frames are so far apart that straight lines do not describe
/// the motion between them: most pull-throughs would be unresolved, and a search would take long.
fn are_far_apart(cell_args: &CellArgs, step: [&Result<Frame>; 2]) -> bool {
    let [Ok(first), Ok(second)] = step else {
        return false;
    };
    let (Ok(from), Ok(to)) = (&first.curves, &second.curves) else {
        return false;
    };
    let cell = cell_args.cell(second.info.cell);
    let lengths = motion(from, to, cell.as_ref()).unwrap_or(0.0);
    let is_far = lengths > SessionOptions::MOTION_LIMIT;
    // Without closed curves there is nothing else to verify.
    let compares = is_far && from.curves().iter().any(|curve| curve.closed);
    if compares {
        tracing::warn!(
            "{} and {} are far apart: half of the points moved by {lengths:.1} segment lengths or \
             more; linking numbers alone are compared (--events=between searches the steps for \
             pull-throughs)",
            first.name,
            second.name,
        );
    }
    compares
}

/// Returns the median motion of the points in a step, in median segment lengths, relative to the
/// median translation; `None` if the curves differ. In a cell, points move to their nearest images.
fn motion(from: &CurveSet, to: &CurveSet, cell: Option<&Cell>) -> Option<f64> {
    if !from.counts().eq(to.counts()) {
        return None;
    }
    let curves = from.curves().iter().enumerate();
    let slots = curves.flat_map(|(i, curve)| (0..curve.points as usize).map(move |k| (i, k)));
    let slots: Vec<(usize, usize)> = slots.collect();
    let within = slots.iter().filter(|(_, k)| *k > 0);
    let length = median(within.map(|&(i, k)| distance(from.point(i, k - 1), from.point(i, k))))?;
    let metric = Metric::new(cell);
    let moved = |&(i, k): &(usize, usize)| metric.difference(from.point(i, k), to.point(i, k));
    let moved: Vec<Point> = slots.iter().map(moved).collect();
    let all = per_axis(|x| median(moved.iter().map(|by| by[x])).unwrap_or(0.0));
    Some(median(moved.iter().map(|by| distance(*by, all)))? / length)
}

/// Returns the median of some numbers, or `None` if there are none.
fn median(numbers: impl Iterator<Item = f64>) -> Option<f64> {
    let mut numbers: Vec<f64> = numbers.collect();
    let middle = numbers.len() / 2;
    (!numbers.is_empty()).then(|| *numbers.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// Returns true if a model has no closed curve, or not the braids that are to be verified.
fn has_nothing_to_verify(e: &Error) -> bool {
    match e {
        Error::InFile { source, .. } => has_nothing_to_verify(source),
        e => matches!(e, Error::Braid(_) | Error::NothingClosed { .. }),
    }
}
