//! Measurements of linkwatch for its authors: the figures of `docs/design/accuracy.md` and
//! `docs/design/applications.md`, and the calibration of GPU adapters.
//!
//! Every measurement compares its results with the exact ones. Only the public API of the library
//! is used.

mod devices;
mod fit;
mod frames;
mod input;
mod kernels;
#[allow(dead_code, reason = "the benches use it as well")]
mod measure;
mod plot;
mod published;
mod sizes;
mod stages;
mod sweep;
mod table1;

use clap::{Parser, Subcommand};
use linkwatch::{Error, Result};
use std::process::ExitCode;

/// Measures linkwatch: speed against error, moving frames, growing sizes, adapters
#[derive(Parser)]
#[command(
    after_help = "Exit codes: 0 as expected, 1 a result is wrong or a topology broke, 2 bad \
                        arguments or bad input, 3 undecided"
)]
struct Cli {
    #[command(subcommand)]
    study: Study,
    /// Number of CPU threads to compute with [default: one per core]
    #[arg(
        long, global = true, value_name = "N",
        value_parser = clap::value_parser!(u16).range(1..=1024)
    )]
    threads: Option<u16>,
}

#[derive(Subcommand)]
enum Study {
    Kernels(kernels::Args),
    Table1(table1::Args),
    Frames(frames::Args),
    Sizes(sizes::Args),
    Sweep(sweep::Args),
    Stages(stages::Args),
    Devices(devices::Args),
}

fn main() -> ExitCode {
    run(&Cli::parse()).map_or_else(
        |e| {
            eprintln!("error: {e}");
            ExitCode::from(2)
        },
        ExitCode::from,
    )
}

/// Runs a study. Returns the exit code.
fn run(cli: &Cli) -> Result<u8> {
    if let Some(n) = cli.threads {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n.into());
        pool.build_global()
            .map_err(|e| Error::Usage(format!("--threads {n}: {e}")))?;
    }
    match &cli.study {
        Study::Kernels(args) => kernels::run(args),
        Study::Table1(args) => table1::run(args),
        Study::Frames(args) => frames::run(args),
        Study::Sizes(args) => sizes::run(args),
        Study::Sweep(args) => sweep::run(args),
        Study::Stages(args) => stages::run(args),
        Study::Devices(args) => devices::run(args),
    }
}
