//! `linkwatch replay`: verifies a recording again.

mod comparison;
mod verify;

use super::Outcome;
use super::range::Range;
use super::run::{Judge, JunitArgs, Sinks};
use super::source::Source;
use linkwatch::Result;
use std::path::PathBuf;

/// Verify a recording again, frame by frame, and compare with the recorded verdicts
///
/// Without options, the settings and the baseline are those of the recording, and the verdicts must
/// be the same. The last line reports how many are. `linkwatch check` verifies other files.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// A recording, as written by `linkwatch watch --record`
    #[arg(value_name = "FILE")]
    file: PathBuf,
    #[command(flatten)]
    range: Range,
    #[command(flatten)]
    judge: Judge,
    #[command(flatten)]
    junit: JunitArgs,
    #[command(flatten)]
    sinks: Sinks,
}

/// Runs the command.
pub fn run(args: &Args, json: bool) -> Result<Outcome> {
    args.range.check()?;
    let source = Source::open(&args.file)?;
    verify::run(args, source, json)
}
