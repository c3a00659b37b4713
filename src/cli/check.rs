//! `linkwatch check`: compares models with a certificate, or with the first of them.

use super::Outcome;
use super::clearance_args::ClearanceArgs;
use super::event_args::EventArgs;
use super::files::{Content, write_text};
use super::kernel::KernelArgs;
use super::order;
use super::output::with_progress;
use super::session::{Baseline, FrameCounts, Ingested, Judge, JunitArgs, Run, Session, Sinks};
use linkwatch::kernels::Device;
use linkwatch::model::MODEL_FILES;
use linkwatch::{AbortOn, CurveSet, Error, Overflow, Result, Strategy, Verdict, model};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Maximum wait for a blocked sink. After that, frames are dropped and counted.
const PATIENCE: Duration = Duration::from_secs(60);

/// Compare the topology of models with a certificate, or with the first model
#[derive(Debug, clap::Args)]
pub struct Args {
    #[arg(
        required = true, value_name = "MODEL",
        help = format!(
            "Models ({MODEL_FILES}); several are frames of one motion, and sorted by number if \
             their names differ in numbers only"
        )
    )]
    models: Vec<PathBuf>,
    /// Keep the order in which the models are given
    #[arg(long)]
    keep_order: bool,
    /// Expected linking numbers: those of the first model, or a certificate as `linkwatch certify
    /// -o` writes it [default: first-frame]
    #[arg(long, value_name = "first-frame|CERT", help_heading = super::COMPARE)]
    against: Option<Baseline>,
    #[command(flatten)]
    event_args: EventArgs,
    /// Stop at the first change of a model, the most suspect pairs first
    #[arg(
        long, conflicts_with_all = ["events", "with_self", "method"],
        help_heading = super::COMPARE
    )]
    early_exit: bool,
    /// Write the pairs that differ, a line `i,j,expected,found` each
    #[arg(long, value_name = "FILE", help_heading = super::WRITE)]
    diff_pairs: Option<PathBuf>,
    /// Write the curves that take part in a difference, a line each
    #[arg(long, value_name = "FILE", help_heading = super::WRITE)]
    diff_curves: Option<PathBuf>,
    #[command(flatten)]
    junit: JunitArgs,
    #[command(flatten)]
    sinks: Sinks,
    #[command(flatten)]
    kernel: KernelArgs,
}

/// Runs the command.
pub fn run(args: &Args, json: bool) -> Result<Outcome> {
    let mut models = args.models.clone();
    if !args.keep_order && order::sort(&mut models) {
        tracing::warn!(
            "models are sorted by the numbers in their names: {} .. {} (--keep-order keeps the \
             given order)",
            models[0].display(),
            models[models.len() - 1].display(),
        );
    }
    let from_first_frame = !matches!(args.against, Some(Baseline::File(_)));
    if from_first_frame && models.len() == 1 {
        let why = "one model and nothing to compare it with: also give later models of its motion, \
                   or --against CERT (`linkwatch certify MODEL -o CERT` writes one)";
        return Err(Error::Usage(why.into()));
    }
    if args.early_exit && !matches!(args.kernel.device, Device::Auto | Device::Cpu) {
        let why = "--early-exit computes few pairs at a time, on the CPU: omit --device";
        return Err(Error::Usage(why.into()));
    }
    let judge = Judge {
        baseline: args.against.clone(),
        abort_on: Some(AbortOn::Never),
        event_args: args.event_args,
        clearance_args: ClearanceArgs::default(),
        kernel: args.kernel.clone(),
        paranoid: false,
        // The models are files of the user, and no simulator runs on.
        max_pairs: Some(usize::MAX),
    };
    let mut files = judge.files(args.sinks.overwrite);
    models.iter().for_each(|path| files.reads(path));
    for (option, file) in [
        ("--diff-pairs", &args.diff_pairs),
        ("--diff-curves", &args.diff_curves),
    ] {
        if let Some(file) = file {
            files.writes(option, file, Content::Text)?;
        }
    }
    let mut session = Session::new(Run {
        judge: &judge,
        sinks: &args.sinks,
        junit: Some(&args.junit),
        files,
        strategy: match args.early_exit {
            true => Strategy::EarlyExit,
            false if models.len() == 1 => Strategy::Full,
            false => Strategy::Incremental,
        },
        models: true,
        baseline: None,
        recorded_events: None,
        recorded_clearance: None,
        title: &format!("check of {}", models[0].display()),
        metadata: BTreeMap::from([("models".to_owned(), models.len().to_string())]),
        overflow: Overflow::WaitForProgress(PATIENCE),
        json,
    })?;
    let mut tally = FrameCounts::default();
    let mut pairs = BTreeSet::new();
    let mut failed = None;
    for (seq, path) in models.iter().enumerate() {
        let name = path.display().to_string();
        let judged = read(path).and_then(|frame| {
            let progress = session.progress();
            with_progress(&name, progress, || session.judge(seq as u64, 0.0, frame))
        });
        let mut judged = match judged {
            Ok(judged) => judged,
            Err(e) => {
                let nothing_closed = matches!(e, Error::NothingClosed { .. });
                // The other models still get their verdicts.
                let e = e.in_file(path);
                match &failed {
                    None => failed = Some(e),
                    Some(_) => tracing::error!("{e}"),
                }
                // Without a first frame there is no baseline for the others.
                if nothing_closed && from_first_frame {
                    break;
                }
                continue;
            }
        };
        match judged.report.verdict {
            Verdict::Rejected => tally.rejected += 1,
            _ => tally.verified += 1,
        }
        let changes = judged.report.changes.iter();
        pairs.extend(changes.map(|c| (c.i, c.j, c.expected, c.found)));
        judged.model = Some(name);
        session.publish(judged, tally);
    }
    if failed.is_some() {
        session.data_lost();
    }
    let outcome = session.finish(tally);
    if let Some(file) = &args.diff_pairs {
        let lines = pairs
            .iter()
            .map(|(i, j, expected, found)| format!("{i},{j},{expected},{found}"));
        write_text(file, args.sinks.overwrite, &text(lines))?;
    }
    if let Some(file) = &args.diff_curves {
        let curves: BTreeSet<u32> = pairs.iter().flat_map(|p| [p.0, p.1]).collect();
        let lines = curves.iter().map(u32::to_string);
        write_text(file, args.sinks.overwrite, &text(lines))?;
    }
    failed.map_or(Ok(outcome), Err)
}

/// Reads a model. A file with invalid content becomes a rejected frame.
///
/// Errors: the file cannot be read, or is not a model.
fn read(path: &Path) -> Result<Ingested> {
    let curves: Result<CurveSet> = match model::read(path) {
        Err(Error::InFile { source, .. }) => Err(*source),
        read => Ok(read?),
    };
    Ok(curves.into())
}

fn text(lines: impl Iterator<Item = String>) -> String {
    lines.map(|line| line + "\n").collect()
}
