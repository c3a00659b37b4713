//! `linkwatch diff`: compares the recorded verdicts of two runs.

mod reports;
mod runs;

use self::runs::{FrameDiff, RunDiff, diff_runs};
use super::Outcome;
use super::output::{self, count, list, plural};
use super::source::Source;
use linkwatch::Result;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Settings of a run that change its verdicts: the name in the metadata of a recording, and the
/// value if the metadata lacks it.
const RECORDED: [(&str, &str); 3] = [
    ("events", "unknown"),
    ("motion_limit", "unknown"),
    ("invariants", "none"),
];

/// Maximum number of findings that are printed for each run.
const FINDINGS: usize = 8;

/// Compare the recorded verdicts of two runs, frame by frame, and report the first difference
///
/// Nothing is verified. Exit code: 0 equal, 1 different, 3 not all frames could be compared.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// A recording, as written by `linkwatch watch --record`
    #[arg(value_name = "FIRST.mcap")]
    first: PathBuf,
    /// The recording to compare it with
    #[arg(value_name = "SECOND.mcap")]
    second: PathBuf,
    /// Frames with the same simulation time are the same frame [default: with the same number]
    #[arg(long)]
    by_time: bool,
}

/// Runs the command.
pub fn run(args: &Args, json: bool) -> Result<Outcome> {
    let paths = [args.first.as_path(), args.second.as_path()];
    let same = paths.map(|path| std::fs::canonicalize(path).ok());
    if same[0].is_some() && same[0] == same[1] {
        return Err(usage!("{}: both are the same file", args.second.display()));
    }
    let mut runs = [Source::new(paths[0])?, Source::new(paths[1])?];
    let diff = diff_runs(&mut runs, args.by_time)?;
    let settings = other_settings(runs.each_ref().map(|run| run.reader.metadata()));
    let names = paths.map(|path| path.display().to_string());
    if json {
        output::json(&serde_json::json!({
            "diff": diff,
            "files": names,
            "by_time": args.by_time,
            "other_settings": settings,
        }));
    } else {
        print(&diff, &names, args.by_time);
    }
    for setting in &settings {
        tracing::warn!("the runs were recorded with other settings: {setting}");
    }
    for (name, _) in names.iter().zip(diff.cut).filter(|(_, cut)| *cut) {
        tracing::warn!("{name}: the recording was cut off, or its run has no end");
    }
    if let Some(seq) = diff.other_time.filter(|_| !args.by_time) {
        tracing::warn!(
            "frame {seq} has another simulation time in each run; --by-time compares frames of the \
             same time"
        );
    }
    let only = diff.only.iter().any(|only| only.frames > 0);
    let partial = diff.compared == 0 || only || diff.without_verdict > 0 || diff.cut != [false; 2];
    Ok(match diff.different {
        0 => Outcome::undecided_if(partial),
        _ => Outcome::Changed,
    })
}

/// Returns the settings that differ, as text.
fn other_settings(runs: [&BTreeMap<String, String>; 2]) -> Vec<String> {
    let differing = RECORDED.into_iter().filter_map(|(name, absent)| {
        let [a, b] = runs.map(|run| run.get(name).map_or(absent, String::as_str));
        (a != b).then(|| format!("{name} is {a} in the first, {b} in the second"))
    });
    differing.collect()
}

fn print(diff: &RunDiff, names: &[String; 2], by_time: bool) {
    let (compared, different, curves) = (diff.compared, diff.different, &diff.curves);
    let unlike = match different {
        0 => "none".to_owned(),
        n => count(n),
    };
    let equal = count(compared - different);
    out!("verdicts: {equal} equal, {unlike} different");
    if let Some(first) = &diff.first {
        print_frame(first, names);
    }
    let frames = plural(curves.compared, "frame");
    match curves.first {
        _ if curves.compared == 0 => {}
        None => out!("curves: bitwise equal in all {frames}"),
        Some(seq) => {
            let (first, equal) = (frame(seq), count(curves.equal));
            out!("curves: the runs diverge at {first}; {equal} of {frames} are bitwise equal");
        }
    }
    for (name, only) in names.iter().zip(&diff.only) {
        if let Some([from, to]) = only.range {
            let frames = plural(only.frames, "frame");
            out!("only in {name}: {frames}, from {from} to {to}");
        }
    }
    if diff.without_verdict > 0 {
        let frames = plural(diff.without_verdict, "frame");
        out!("not compared: {frames} without a verdict in one or both");
    }
    if compared == 0 && diff.without_verdict == 0 {
        let (what, advice) = match by_time {
            false => ("number", "; --by-time compares by simulation time"),
            true => ("simulation time", ""),
        };
        out!("no frame has the same {what} in both{advice}");
    }
}

/// Prints the first frame with different verdicts.
fn print_frame(first: &FrameDiff, names: &[String; 2]) {
    out!("first difference: {}", frame(first.seq));
    let runs = names.iter().zip(&first.headlines);
    for ((name, headline), only) in runs.zip(&first.difference.only) {
        out!("  {name}: {headline}");
        let only: Vec<String> = only.iter().map(|f| format!("only here: {f}")).collect();
        list("    ", &only, FINDINGS);
    }
}

/// Returns the words for a frame that may have another number in the second run.
fn frame([a, b]: [u64; 2]) -> String {
    match a == b {
        true => format!("frame {a}"),
        false => format!("frame {a} ({b} in the second)"),
    }
}
