//! `linkwatch replay`: verifies a recording again, or the frames of a model file; publishes them,
//! compares two runs, or finds the first changed frame.

mod bisect;
mod comparison;
mod diff;
#[cfg(feature = "bus")]
mod publish;
mod range;
mod source;
mod verify;

use self::diff::DiffArgs;
#[cfg(feature = "bus")]
use self::publish::PublishArgs;
use self::range::Range;
use self::source::Source;
use super::Outcome;
use super::input::FormatArgs;
use super::kernel::KernelArgs;
use super::run::{Judge, JunitArgs, Sinks};
use linkwatch::Result;
use std::path::PathBuf;
use std::time::Duration;

/// Maximum wait for a blocked sink or standard output. After that, frames or lines are dropped and
/// counted.
const PATIENCE: Duration = Duration::from_secs(60);

/// Settings of the verification, by their identifiers, for options that verify nothing.
const SETTINGS: &[&str] = &[
    "baseline",
    "abort_on",
    "max_pairs",
    "paranoid",
    "EventArgs",
    "ClearanceArgs",
    "KernelArgs",
];

/// Outputs for verified frames.
const OUTPUTS: &[&str] = &["record", "shown", "Overwrite", "JunitArgs"];

/// Verify a recording again, frame by frame, and compare with the recorded verdicts
///
/// Without options, the settings and the baseline are those of the recording, and the verdicts must
/// be the same. The last line reports how many are. Other files with frames are verified as well;
/// they have no verdicts to compare with.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// A recording, as written by `linkwatch watch --record`, or a model file
    #[arg(value_name = "FILE")]
    file: PathBuf,
    #[command(flatten)]
    format: FormatArgs,
    /// Model files with several frames each continue one another: all are frames of one motion
    #[arg(long)]
    one_motion: bool,
    #[command(flatten)]
    range: Range,
    #[cfg(feature = "bus")]
    #[command(flatten)]
    publish: PublishArgs,
    #[command(flatten)]
    diff: DiffArgs,
    /// Find the first changed frame by a binary search that verifies few frames, each in full
    /// against the baseline. With --events: also the strands that were pulled through one another
    /// in the step to it, how fast they moved, and the time step that would have kept them apart
    #[arg(
        long,
        conflicts_with_all = OUTPUTS,
        conflicts_with_all = ["abort_on", "paranoid", "ClearanceArgs"]
    )]
    bisect: bool,
    #[command(flatten)]
    judge: Judge,
    #[command(flatten)]
    junit: JunitArgs,
    #[command(flatten)]
    sinks: Sinks,
    #[command(flatten)]
    kernel: KernelArgs,
}

/// Runs the command.
pub fn run(args: &Args, json: bool) -> Result<Outcome> {
    args.range.check()?;
    if let Some(other) = &args.diff.diff {
        return diff::run(args, other, json);
    }
    let format = args
        .format
        .wrapped(args.judge.cell_args.wrapped().is_some());
    let source = Source::open(&args.file, &format, args.one_motion)?;
    #[cfg(feature = "bus")]
    if let Some(service) = &args.publish.publish {
        return publish::run(args, source, service, json);
    }
    match args.bisect {
        true => bisect::run(args, source, json),
        false => verify::run(args, source, json),
    }
}
