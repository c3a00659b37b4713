//! `linkwatch study`: measurements that alternate, in one run, what is measured with what it is compared to.

mod frames;
mod kernels;
mod plots;

use super::Outcome;
use clap::Subcommand;
use linkwatch::Result;

/// Measure what verification costs, beside what it is compared with
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(subcommand)]
    study: Study,
}

#[derive(Debug, Subcommand)]
enum Study {
    Frames(frames::Args),
    Kernels(kernels::Args),
}

/// Runs the command.
pub fn run(args: &Args, as_json: bool) -> Result<Outcome> {
    match &args.study {
        Study::Frames(args) => frames::run(args, as_json),
        Study::Kernels(args) => kernels::run(args, as_json),
    }
}
