//! `linkwatch sweep`: reduces a model step by step until its topology breaks.

use super::Outcome;
use super::cell_args::CellArgs;
use super::files::{Content, Files, Overwrite, write_text};
use super::frames::{Selected, Selection};
use super::input::FormatArgs;
use super::output::{self, count, plural, with_progress};
use linkwatch::sweep::{MOST_BITS, Reduction, Sweep, SweepStep, plot};
use linkwatch::{Events, Report, Result, SessionOptions, Verdict};
use serde_json::json;
use std::collections::BTreeSet;
use std::path::PathBuf;
use std::str::FromStr;

/// Maximum number of findings of the first broken step that are printed; the rest is counted.
const SENTENCES: usize = 20;

/// Maximum number of steps.
const MOST_STEPS: usize = 1000;

/// Difference of two shares, unless another one is given.
const SHARE_STEP: f64 = 0.05;

/// Reduce a model step by step until its topology breaks: fewer bits, or fewer control points
///
/// Linking numbers of each step are compared with those of the model. Pull-throughs are searched
/// for from each step to the next, so that errors that cancel are found. A step is intact if no
/// curve was pulled through another one on the way to it.
#[derive(Debug, clap::Args)]
#[command(group(clap::ArgGroup::new("reduction").required(true)))]
pub struct Args {
    /// Model, recording, or scene as `linkwatch generate` takes it
    #[arg(value_name = "MODEL|SCENE")]
    model: PathBuf,
    /// Quantize coordinates to a grid of 2^BITS cells along each axis of the bounding box, for
    /// example 24..8: from 24 bits to 8
    #[arg(long, value_name = "FROM..TO", group = "reduction")]
    quantize: Option<Bits>,
    /// Resample each curve to a share of its control points, at equal distances along it, for
    /// example 1.0..0.5
    #[arg(long, value_name = "FROM..TO", group = "reduction")]
    resample: Option<Shares>,
    /// Difference of two steps [default: 1 bit, or a share of 0.05]
    #[arg(long, value_name = "D")]
    step: Option<f64>,
    /// Frame to reduce, by its number, of files with several frames [default: the first one]
    #[arg(long, value_name = "SEQ")]
    frame: Option<u64>,
    #[command(flatten)]
    format: FormatArgs,
    #[command(flatten)]
    cell_args: CellArgs,
    /// Also search for curves that are pulled through themselves
    #[arg(long = "self", help_heading = super::COMPARE)]
    with_self: bool,
    /// Motion between two steps, in segment lengths, beyond which two pull-throughs that cancel
    /// count as undecided [default: 1.5]
    #[arg(long, value_name = "LENGTHS", help_heading = super::COMPARE)]
    motion_limit: Option<f64>,
    /// Write a plot of the violations of each step, an .svg file
    #[arg(long, value_name = "FILE", help_heading = super::WRITE)]
    plot: Option<PathBuf>,
    #[command(flatten)]
    overwrite: Overwrite,
}

/// Range of bits, from many to few.
#[derive(Clone, Copy, Debug)]
struct Bits([u32; 2]);

/// Range of shares, from many points to few.
#[derive(Clone, Copy, Debug)]
struct Shares([f64; 2]);

/// Splits `FROM..TO`. A single value is a range of one step.
fn ends(text: &str) -> (&str, &str) {
    text.split_once("..").unwrap_or((text, text))
}

impl FromStr for Bits {
    type Err = String;

    fn from_str(text: &str) -> Result<Bits, String> {
        let (from, to) = ends(text);
        let parse = |text: &str| match text.trim().parse::<u32>() {
            Ok(bits) if (1..=MOST_BITS).contains(&bits) => Ok(bits),
            _ => Err(format!("expected bits from 1 to {MOST_BITS}, as in 24..8")),
        };
        let (from, to) = (parse(from)?, parse(to)?);
        match from >= to {
            true => Ok(Bits([from, to])),
            false => Err(format!("a sweep goes from fine to coarse: {to}..{from}")),
        }
    }
}

impl FromStr for Shares {
    type Err = String;

    fn from_str(text: &str) -> Result<Shares, String> {
        let (from, to) = ends(text);
        let parse = |text: &str| match text.trim().parse::<f64>() {
            Ok(share) if share > 0.0 && share <= 1.0 => Ok(share),
            _ => Err("expected shares above 0 and up to 1, as in 1.0..0.5".to_owned()),
        };
        let (from, to) = (parse(from)?, parse(to)?);
        match from >= to {
            true => Ok(Shares([from, to])),
            false => Err(format!("a sweep goes from fine to coarse: {to}..{from}")),
        }
    }
}

/// Returns the reductions of the sweep.
fn reductions(args: &Args) -> Result<Vec<Reduction>> {
    let usage = |why: String| Err(linkwatch::Error::Usage(why));
    let range = args
        .quantize
        .map(|Bits([from, to])| [f64::from(from), f64::from(to)]);
    let shares = args.resample.map(|Shares(ends)| ends);
    let [from, to] = range.or(shares).expect("clap requires one of both");
    let step = args
        .step
        .unwrap_or(if range.is_some() { 1.0 } else { SHARE_STEP });
    if !(step > 0.0 && step.is_finite()) || range.is_some() && step.fract() != 0.0 {
        return usage(match range {
            Some(_) => format!("--step {step}: expected a whole number of bits above 0"),
            None => format!("--step {step}: expected a share above 0"),
        });
    }
    // The last step is exactly the end of the range, as far as rounding errors go.
    let steps = ((from - to) / step + 1e-9).floor() + 1.0;
    if steps > MOST_STEPS as f64 {
        return usage(format!(
            "--step {step}: {steps} steps from {from} to {to}, expected {MOST_STEPS} or fewer"
        ));
    }
    let values = (0..steps as usize).map(|k| from - k as f64 * step);
    Ok(match range {
        Some(_) => values.map(|x| Reduction::Bits(x as u32)).collect(),
        None => {
            // Without the rounding errors of the multiples, but not below the end.
            let values = values.map(|x| ((x * 1e12).round() / 1e12).max(to));
            values.map(Reduction::Share).collect()
        }
    })
}

/// Runs the command.
pub fn run(args: &Args, json: bool) -> Result<Outcome> {
    let mut files = Files::new(args.overwrite);
    files.reads(&args.model);
    args.format.files().for_each(|path| files.reads(path));
    if let Some(file) = &args.plot {
        files.writes("--plot", file, Content::Text)?;
    }
    let reductions = reductions(args)?;
    let selection = args
        .frame
        .map_or(Selection::First, |n| Selection::Numbers(n, n));
    let picked = Selected::open(&args.model, &args.format, args.cell_args, selection)?.one()?;
    let complete = picked.outcome();
    let (set, cell) = (picked.curves, picked.cell);
    let name = args.model.display().to_string();
    if cell.is_some() {
        args.cell_args.warn_of_segments(&name, &set, cell);
    }
    let mut options = SessionOptions::default();
    options.cell = cell;
    options.events = match args.with_self {
        true => Events::All,
        false => Events::Between,
    };
    options.motion_limit = args.motion_limit;
    // The model is a file of the user, and no simulator waits.
    options.max_pairs = usize::MAX;
    let mut sweep = Sweep::new(set, reductions, options)?;
    introduce(&name, &sweep, json);
    let mut steps: Vec<SweepStep> = Vec::new();
    loop {
        let progress = sweep.progress();
        let Some(step) = with_progress(&name, progress, || sweep.next()).transpose()? else {
            break;
        };
        match json {
            true => output::json(&to_json(&name, &step)),
            false => output::line(row(&step)),
        }
        steps.push(step);
    }
    let broken = steps.iter().position(|s| s.verdict == Verdict::Changed);
    conclude(&name, &steps, broken, json);
    if let Some(file) = &args.plot {
        let words = conclusion(&steps, broken);
        let model = args.model.file_name().unwrap_or(args.model.as_os_str());
        let model = model.to_string_lossy();
        write_text(
            file,
            args.overwrite,
            &plot(&format!("{model}: {words}"), &steps),
        )?;
        tracing::info!("{}: written", file.display());
    }
    let undecided = steps.iter().any(|s| s.verdict != Verdict::Intact);
    Ok(match broken {
        Some(_) => Outcome::Changed,
        None if undecided => Outcome::Undecided,
        None => complete,
    })
}

/// Prints the head of the table.
fn introduce(name: &str, sweep: &Sweep, json: bool) {
    let (set, report) = (sweep.original(), sweep.original_report());
    output::warn_of_open_curves(name, &report.stats, Some(Events::Between));
    for defect in &report.defects {
        tracing::warn!("{name}: {}", defect.sentence(report.stats.extent));
    }
    if json {
        return;
    }
    output::line(format_args!(
        "{name}: {} of {}, {}",
        plural(set.len() as u64, "curve"),
        plural(set.points() as u64, "control point"),
        plural(sweep.links() as u64, "link")
    ));
    output::line(format_args!(
        "{:>24} {:>10} {:>13} {:>13} {:>9}  verdict",
        "step", "points", "changed links", "pull-throughs", "undecided"
    ));
}

fn row(step: &SweepStep) -> String {
    let number = |n: usize| count(n as u64);
    format!(
        "{:>24} {:>10} {:>13} {:>13} {:>9}  {}",
        step.reduction.to_string(),
        number(step.curves.points()),
        number(step.report.changes.len()),
        number(step.report.events.len()),
        number(step.undecided()),
        step.verdict
    )
}

fn to_json(name: &str, step: &SweepStep) -> serde_json::Value {
    let mut line = json!({
        "model": name,
        "points": step.curves.points(),
        "verdict": step.verdict,
        "changes": step.report.changes,
        "events": step.report.events,
        "unresolved": step.report.unresolved,
        "defects": step.report.defects,
    });
    match step.reduction {
        Reduction::Bits(bits) => line["bits"] = bits.into(),
        Reduction::Share(share) => line["share"] = share.into(),
    }
    line
}

/// Returns the result in a few words.
fn conclusion(steps: &[SweepStep], broken: Option<usize>) -> String {
    let intact = steps
        .iter()
        .take_while(|s| s.verdict == Verdict::Intact)
        .count();
    let until = match intact.checked_sub(1) {
        Some(last) => format!("intact down to {}", steps[last].reduction),
        None => "no step is intact".to_owned(),
    };
    match broken {
        Some(k) => format!("{until}, broken at {}", steps[k].reduction),
        None if intact < steps.len() => {
            format!("{until}, undecided at {}", steps[intact].reduction)
        }
        None => until,
    }
}

/// Prints the result, and the findings of the first broken step.
fn conclude(name: &str, steps: &[SweepStep], broken: Option<usize>, json: bool) {
    let words = conclusion(steps, broken);
    let not_intact = steps.iter().find(|s| s.verdict != Verdict::Intact);
    let first = broken.map(|k| &steps[k]).or(not_intact);
    let curves: BTreeSet<u32> = first.map_or_else(BTreeSet::new, |step| {
        let Report {
            changes, events, ..
        } = &step.report;
        let changes = changes.iter().map(|c| [c.i, c.j]);
        let events = events.iter().map(|e| [e.i, e.j]);
        let undecided = step.report.unresolved.iter().map(|e| [e.i, e.j]);
        let defects = step
            .report
            .defects
            .iter()
            .map(|d| [d.i, d.j.unwrap_or(d.i)]);
        match broken {
            Some(_) => changes.chain(events).flatten().collect(),
            None => undecided.chain(defects).flatten().collect(),
        }
    });
    if json {
        output::json(&json!({
            "model": name,
            "conclusion": words,
            "first_broken": broken.map(|k| steps[k].reduction),
            "first_not_intact": not_intact.map(|step| step.reduction),
            "curves": curves,
        }));
        return;
    }
    output::line(format_args!("{name}: {words}"));
    let Some(step) = first else {
        return;
    };
    let listed: Vec<String> = curves.iter().map(u32::to_string).collect();
    let what = if broken.is_some() {
        "broken"
    } else {
        "undecided"
    };
    output::line(format_args!(
        "{}: {} {what}: {}",
        step.reduction,
        plural(curves.len() as u64, "curve"),
        listed.join(", ")
    ));
    let findings: Vec<String> = step.report.findings().collect();
    output::first_lines("  ", &findings, SENTENCES);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_go_from_fine_to_coarse() {
        assert_eq!("24..8".parse::<Bits>().unwrap().0, [24, 8]);
        assert_eq!("12".parse::<Bits>().unwrap().0, [12, 12]);
        assert_eq!("1.0..0.5".parse::<Shares>().unwrap().0, [1.0, 0.5]);
        for text in ["8..24", "0..0", "53..8", "x..8", "", "24..", "-4..2"] {
            text.parse::<Bits>().unwrap_err();
        }
        for text in ["0.5..1.0", "1.5..1", "1..0", "NaN..NaN", "1..", "inf..1"] {
            text.parse::<Shares>().unwrap_err();
        }
        let e = "8..24".parse::<Bits>().unwrap_err();
        assert!(e.ends_with("fine to coarse: 24..8"), "{e}");
    }
}
