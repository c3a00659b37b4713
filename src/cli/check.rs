//! `linkwatch check`: models against a certificate.

use super::Outcome;
use super::files::{Content, Files, Overwrite, write_text};
use super::kernel::KernelArgs;
use super::look_for::LookFor;
use super::output::{self, plural, with_progress};
use linkwatch::kernels::Device;
use linkwatch::{AbortOn, Certificate, Error, Report, Result, Verifier, model};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Compare the topology of models with a certificate
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Models: .bcc, .obj (lines) or .vect; several are frames of one motion
    #[arg(required = true, value_name = "MODEL")]
    models: Vec<PathBuf>,
    /// The certificate to compare with, as `linkwatch certify -o` writes it
    #[arg(long, value_name = "CERT", help_heading = super::COMPARE)]
    against: PathBuf,
    /// Stop at the first change of a model, the most suspect pairs first
    #[arg(long, conflicts_with_all = ["events", "own", "method"], help_heading = super::COMPARE)]
    early_exit: bool,
    #[command(flatten)]
    look_for: LookFor,
    #[command(flatten)]
    kernel: KernelArgs,
    /// Write the pairs that differ, a line `i,j,expected,found` each
    #[arg(long, value_name = "FILE", help_heading = super::WRITE)]
    diff_pairs: Option<PathBuf>,
    /// Write the curves that take part in a difference, a line each
    #[arg(long, value_name = "FILE", help_heading = super::WRITE)]
    diff_curves: Option<PathBuf>,
    #[command(flatten)]
    overwrite: Overwrite,
}

/// Runs the command.
pub fn run(args: &Args, json: bool) -> Result<Outcome> {
    let mut files = Files::new(args.overwrite);
    args.models.iter().for_each(|path| files.reads(path));
    files.reads(&args.against);
    for (option, file) in [
        ("--diff-pairs", &args.diff_pairs),
        ("--diff-curves", &args.diff_curves),
    ] {
        if let Some(file) = file {
            files.writes(option, file, Content::Text)?;
        }
    }
    if args.early_exit && !matches!(args.kernel.device, Device::Auto | Device::Cpu) {
        let why = "--early-exit computes few pairs at a time, on the processor: leave --device out";
        return Err(Error::Usage(why.into()));
    }
    let expected = Certificate::read(&args.against)?;
    let mut verifier = Verifier::with_baseline(AbortOn::Never, expected);
    verifier.set_early_exit(args.early_exit);
    args.kernel.set(&mut verifier)?;
    verifier.set_events(args.look_for.events(AbortOn::Never));
    if let Some(limit) = args.look_for.motion_limit {
        verifier.set_motion_limit(limit)?;
    }
    let mut outcome = Outcome::Fine;
    let mut pairs = BTreeSet::new();
    let mut failed = None;
    for (frame, path) in args.models.iter().enumerate() {
        let report = match judge(&mut verifier, frame, path) {
            Ok(report) => report,
            Err(e) => {
                // The other frames are still worth their verdicts.
                let e = e.in_file(path);
                match &failed {
                    None => failed = Some(e),
                    Some(_) => tracing::error!("{e}"),
                }
                continue;
            }
        };
        let changes = report.changes.iter();
        pairs.extend(changes.map(|c| (c.i, c.j, c.expected, c.found)));
        outcome = outcome.max(Outcome::of(report.verdict));
        if json {
            output::json(&serde_json::json!({ "model": path, "report": report }));
            continue;
        }
        output::line(format_args!("{}: {}", path.display(), report.verdict));
        for finding in report.findings() {
            output::line(format_args!("  {finding}"));
        }
        if report.stats.unchecked > 0 {
            let unchecked = plural(report.stats.unchecked, "pair");
            output::line(format_args!("  {unchecked} left unchecked"));
        }
    }
    if let Some(file) = &args.diff_pairs {
        let lines = pairs
            .iter()
            .map(|(i, j, expected, found)| format!("{i},{j},{expected},{found}"));
        write_text(file, args.overwrite, &text(lines))?;
    }
    if let Some(file) = &args.diff_curves {
        let curves: BTreeSet<u32> = pairs.iter().flat_map(|p| [p.0, p.1]).collect();
        let lines = curves.iter().map(u32::to_string);
        write_text(file, args.overwrite, &text(lines))?;
    }
    failed.map_or(Ok(outcome), Err)
}

fn judge(verifier: &mut Verifier, frame: usize, path: &Path) -> Result<Report> {
    let set = model::read(path)?;
    let name = path.display().to_string();
    let report = with_progress(&name, verifier.progress(), || {
        verifier.step(frame as u64, 0.0, &set)
    })?;
    output::warn_of_open_curves(&name, &report.stats);
    Ok(report)
}

fn text(lines: impl Iterator<Item = String>) -> String {
    lines.map(|line| line + "\n").collect()
}
