//! The command line, one file per subcommand. It uses only the public API of the library, by the
//! name `linkwatch`, although it is a module of it.

/// Creates the error of arguments or input that cannot be used, from a format string.
macro_rules! usage {
    ($($words:tt)*) => { $crate::error::Error::Usage(format!($($words)*)) };
}

/// Writes a line, or several, to stdout, from a format string.
macro_rules! out {
    ($($words:tt)*) => { $crate::cli::output::line(format_args!($($words)*)) };
}

mod arguments;
mod braid_args;
mod cell_args;
mod certify;
mod check;
mod clearance_args;
mod completions;
mod convert;
mod devices;
mod diagram;
mod diff;
mod each;
mod event_args;
mod explain;
mod file_reader;
mod files;
mod frames;
mod generate;
mod input;
mod kernel;
mod live;
mod man;
mod measure;
mod metrics;
mod motion;
mod number;
mod open;
mod order;
mod output;
mod play;
mod range;
mod recorded;
mod replay;
mod report;
mod run;
mod sequence;
mod services;
mod settings;
mod signals;
mod source;
mod stream;
mod watch;

pub use file_reader::FileReader;
pub use order::sort_by_number;

use clap::{ArgAction, Parser, Subcommand};
use linkwatch::formats::ExternalReader;
use linkwatch::{Result, Verdict};
use serde::{Deserialize, Serialize};
use std::ffi::OsString;
use std::io::Write;
#[cfg(unix)]
use std::sync::Arc;

/// Verifies the topology of moving curves (yarn, chainmail or any loopy structure), frame by frame
#[derive(Debug, Parser)]
#[command(
    version, about, after_help = EXIT_CODES, disable_help_flag = true, disable_version_flag = true
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    /// Print results as JSON on stdout, a line each
    #[arg(long, global = true, help_heading = GENERAL)]
    json: bool,
    /// Print only warnings and errors on stderr
    #[arg(short, long, global = true, help_heading = GENERAL)]
    quiet: bool,
    /// Also print how frames were verified, and the times of the stages, on stderr
    #[arg(short, long, global = true, help_heading = GENERAL, conflicts_with = "quiet")]
    verbose: bool,
    /// Number of CPU threads to compute with [default: one per core]
    #[arg(
        long, global = true, help_heading = GENERAL, value_name = "N",
        value_parser = clap::value_parser!(u16).range(1..=MOST_THREADS)
    )]
    threads: Option<u16>,
    /// Print help (`-h`: common options, `--help`: all options)
    #[arg(short, long, global = true, help_heading = GENERAL, action = ArgAction::Help)]
    help: Option<bool>,
    /// Print the version
    #[arg(short = 'V', long, help_heading = GENERAL, action = ArgAction::Version)]
    version: Option<bool>,
}

/// Headings of `--help`. Options without a heading belong to one command only.
const WATCH: &str = "Simulation";
const INPUT: &str = "Input";
const COMPARE: &str = "Comparison";
const WRITE: &str = "Output";
const KERNELS: &str = "Kernels";
const GENERAL: &str = "General";

/// Maximum of --threads: more than the cores of any machine that linkwatch targets, and few enough
/// to start.
const MOST_THREADS: i64 = 1024;

const EXIT_CODES: &str = "\
Exit codes: 0 intact, recovered, accepted or done, 1 topology changed, 2 bad arguments or bad \
input, 3 undecided (curves touch or are too close) or incomplete (data lost, or a file that was \
not read as a whole)";

// Common commands first: `--help` lists them in this order.
#[derive(Debug, Subcommand)]
enum Command {
    Watch(watch::Args),
    /// List the live services of this machine, with their simulators and watchers
    ///
    /// Lists only services of this user that a living process uses. Running sessions are not
    /// disturbed.
    Services,
    Replay(replay::Args),
    Report(report::Args),
    Diff(diff::Args),
    Play(play::Args),
    Certify(certify::Args),
    Check(check::Args),
    Convert(convert::Args),
    Generate(generate::Args),
    Measure(measure::Args),
    Diagram(diagram::Args),
    #[command(hide = true)]
    Thickness(measure::thickness::Args),
    #[command(hide = true)]
    Writhe(measure::writhe::Args),
    /// List the GPU adapters that kernels can run on
    Devices,
    Completions(completions::Args),
    /// Print the manual page, with all commands
    ///
    /// `linkwatch man | man -l -` shows it.
    Man,
}

/// Result of a command, worst last.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
enum Outcome {
    /// Intact, or done.
    #[default]
    Fine,
    /// Undecided, or data lost.
    Undecided,
    /// The topology changed.
    Changed,
}

impl Outcome {
    /// Returns the outcome that a verdict gives the run.
    fn of(verdict: Verdict) -> Outcome {
        match verdict {
            Verdict::Intact => Outcome::Fine,
            Verdict::Changed => Outcome::Changed,
            _ => Outcome::Undecided,
        }
    }

    /// Returns the outcome of a run that is incomplete, or that has no finding.
    fn undecided_if(incomplete: bool) -> Outcome {
        match incomplete {
            true => Outcome::Undecided,
            false => Outcome::Fine,
        }
    }

    fn code(self) -> u8 {
        match self {
            Outcome::Fine => 0,
            Outcome::Changed => 1,
            Outcome::Undecided => 3,
        }
    }
}

/// Parses the arguments, the first of which is the name of the program, and runs the command.
/// Returns the exit code. `reader` reads formats that the command does not know.
///
/// Installs signal handlers and the global subscriber of log messages, so that a process can call
/// it only once.
pub fn run_command(
    args: impl IntoIterator<Item = OsString>,
    reader: Option<Box<dyn ExternalReader>>,
) -> u8 {
    if let Some(reader) = reader {
        linkwatch::formats::install(reader);
    }
    let cli = match arguments::parse(args) {
        Ok(cli) => cli,
        Err(text) => {
            // Also the texts of --help and --version, which go to stdout. A failed write has no
            // better place to report.
            text.print().ok();
            std::io::stdout().flush().ok();
            return if text.use_stderr() { 2 } else { 0 };
        }
    };
    output::init(cli.quiet, cli.verbose);
    let code = match run(&cli) {
        Ok(outcome) => outcome.code(),
        Err(e) => {
            output::error(e);
            2
        }
    };
    let all_written = output::finish();
    match code {
        0 if !all_written => Outcome::Undecided.code(),
        code => code,
    }
}

fn run(cli: &Cli) -> Result<Outcome> {
    // A write beyond `ulimit -f` then returns an error, instead of ending the process.
    #[cfg(unix)]
    signal_hook::flag::register(signal_hook::consts::SIGXFSZ, Arc::default())?;
    if let Some(n) = cli.threads {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n.into());
        pool.build_global()
            .map_err(|e| usage!("--threads {n}: {e}"))?;
    }
    match &cli.command {
        Command::Certify(args) => certify::run(args, cli.json),
        Command::Check(args) => check::run(args, cli.json),
        Command::Convert(args) => convert::run(args, cli.json),
        Command::Diagram(args) => diagram::run(args, cli.json),
        Command::Devices => devices::run(cli.json),
        Command::Generate(args) => generate::run(args, cli.json),
        Command::Measure(args) => measure::run(args, cli.json),
        // Names of earlier versions, which take the same arguments.
        Command::Thickness(args) => measure::thickness::run(args, cli.json),
        Command::Writhe(args) => measure::writhe::run(args, cli.json),
        Command::Watch(args) => watch::run(args, cli.json),
        Command::Replay(args) => replay::run(args, cli.json),
        Command::Report(args) => report::run(args, cli.json),
        Command::Diff(args) => diff::run(args, cli.json),
        Command::Play(args) => play::run(args, cli.json),
        Command::Services => services::run(cli.json),
        Command::Completions(args) => completions::run(args),
        Command::Man => man::run(),
    }
}
