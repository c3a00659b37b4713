//! `linkwatch study`: measures alternatives alternately in one run, so that their times are
//! comparable.

mod csv;
mod frames;
mod kernels;
mod sizes;
mod table1;

use super::Outcome;
use clap::Subcommand;
use linkwatch::Result;

/// Measure the cost of verification, compared with alternatives
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(subcommand)]
    study: Study,
}

#[derive(Debug, Subcommand)]
enum Study {
    Frames(frames::Args),
    Kernels(kernels::Args),
    Sizes(sizes::Args),
    Table1(table1::Args),
}

/// Runs the command.
pub fn run(args: &Args, as_json: bool) -> Result<Outcome> {
    match &args.study {
        Study::Frames(args) => frames::run(args, as_json),
        Study::Kernels(args) => kernels::run(args, as_json),
        Study::Sizes(args) => sizes::run(args, as_json),
        Study::Table1(args) => table1::run(args, as_json),
    }
}
