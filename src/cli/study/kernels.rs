//! `linkwatch study kernels`: speed against error of every kernel, on one scene.
//!
//! The exact certificate is computed first, and every sum is compared with it. Each certificate
//! must be the exact one whatever the error of its sums, because only sums that their proven bound
//! decides are used.

use super::csv::{Csv, check_outputs};
use crate::cli::files::{Files, Overwrite};
use crate::cli::kernel::beta;
use crate::cli::number::{positive, segments};
use crate::cli::output::{self, count, plural, plural_of};
use crate::cli::{Outcome, input};
use linkwatch::kernels::{Accuracy, Device};
use linkwatch::lab::{self, KernelEffort, KernelRow, Setting, Slope, Subject, Table};
use linkwatch::model::MODEL_FILES;
use linkwatch::scenes::Scene;
use linkwatch::{Certifier, Error, Result, SessionOptions};
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};

/// Measure the kernels: speed against error
///
/// Measures counting crossings, direct sums, interval arithmetic, and Barnes-Hut by beta, by the
/// proven bound and as published. The exit code is 1 if a certificate is not the exact one.
#[derive(Debug, clap::Args)]
pub struct Args {
    #[arg(
        value_name = "MODEL|SCENE",
        help = format!("A model ({MODEL_FILES}), or a scene as `linkwatch generate` takes it")
    )]
    input: String,
    /// Betas of Barnes-Hut (distance of expanded nodes, in radii), separated by commas
    #[arg(
        long,
        value_name = "LIST",
        value_delimiter = ',',
        default_value = "1.5,2,3,4,6,8",
        value_parser = beta
    )]
    betas: Vec<f64>,
    /// Also measure a generated scene at these sizes: numbers of segments, separated by commas
    /// [default with --plot: a 64th, a 16th and a 4th of its own]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = segments)]
    sizes: Vec<u64>,
    /// Device that runs the kernels: auto, cpu, gpu, or the index or name of an adapter (`linkwatch
    /// devices`)
    #[arg(
        long,
        help_heading = crate::cli::KERNELS,
        value_name = "DEVICE",
        default_value_t = Device::Cpu
    )]
    device: Device,
    /// Number of runs of each kernel; the median is printed
    #[arg(
        long,
        value_name = "N",
        default_value_t = 3,
        value_parser = clap::value_parser!(u32).range(1..)
    )]
    repeat: u32,
    /// Skip sums over all pairs of segments that would take longer than this; run anything longer
    /// only once
    #[arg(long, value_name = "SECONDS", default_value_t = 30.0, value_parser = positive)]
    limit: f64,
    /// Write the table to a file
    #[arg(long, value_name = "FILE", help_heading = crate::cli::WRITE)]
    csv: Option<PathBuf>,
    /// Write plots to a folder, as PNG and SVG: error against time and beta, time against size
    #[arg(long, value_name = "DIR", help_heading = crate::cli::WRITE)]
    plot: Option<PathBuf>,
    #[command(flatten)]
    overwrite: Overwrite,
}

/// Plots in the folder of --plot, each as PNG and SVG.
const PLOTS: [&str; 3] = ["error-time", "error-beta", "time-size"];

/// Runs the command.
pub fn run(args: &Args, as_json: bool) -> Result<Outcome> {
    let mut files = Files::new(args.overwrite);
    files.reads(Path::new(&args.input));
    check_outputs(
        &mut files,
        args.csv.as_deref(),
        args.plot.as_deref(),
        &PLOTS,
    )?;
    // Opened before the measurements, so that no run includes it.
    let on_device = Certifier::new(&SessionOptions {
        device: args.device.clone(),
        ..SessionOptions::default()
    })?;
    let device = on_device.device();
    let subject = Subject::new(&args.input, input::read(Path::new(&args.input))?)?;
    // An input that could be read and parses as a scene is a scene, unless it is a file.
    let scene = args.input.parse::<Scene>().ok();
    let own = subject.curves.segments() as u64;
    let others = match scene {
        None if !args.sizes.is_empty() => {
            return Err(Error::Usage(format!(
                "--sizes: {} is not a generated scene, so its size cannot be changed",
                args.input
            )));
        }
        Some(scene) if !args.sizes.is_empty() || args.plot.is_some() => {
            lab::at_sizes(&scene, own, &args.sizes)?
        }
        _ => Vec::new(),
    };
    let mut csv = Csv::create(args.csv.as_deref(), FIELDS)?;
    let say = |line: &dyn std::fmt::Display| match as_json {
        true => {}
        false => output::line(line),
    };
    let threads = rayon::current_num_threads();
    say(&format_args!(
        "{}: {} of {}, {} of {}, {}{}; median of {}",
        args.input,
        plural(subject.curves.len() as u64, "curve"),
        plural(own, "segment"),
        plural(subject.stats.potential_links, "potential link"),
        plural_of(
            subject.segment_pairs,
            "pair of segments",
            "pairs of segments"
        ),
        plural(threads as u64, "thread"),
        device
            .as_ref()
            .map_or(String::new(), |d| format!(", {}", d.name)),
        args.repeat,
    ));
    let table = table();
    say(&table.header());
    let (settings, at_sizes) = (Setting::all(&args.betas), Setting::for_sizes());
    let effort = KernelEffort {
        device: args.device.clone(),
        fast_device: device.as_ref().is_some_and(|d| !d.software),
        repeat: args.repeat,
        limit_s: args.limit,
    };
    let bar = output::bar(
        (settings.len() + others.len() * at_sizes.len()) as u64,
        "rows",
    );
    let mut measure = |subject: &Subject, settings: &[Setting], rows: &mut Vec<KernelRow>| {
        for &setting in settings {
            bar.set_message(setting.to_string());
            let row = KernelRow::measure(setting, subject, &effort)?;
            bar.inc(1);
            bar.suspend(|| say(&line(&table, &row)));
            csv.row(&row_json(&row))?;
            rows.push(row);
        }
        Ok::<(), linkwatch::Error>(())
    };
    let mut rows = Vec::new();
    measure(&subject, &settings, &mut rows)?;
    let slopes = Slope::all(&rows);
    for slope in &slopes {
        say(slope);
    }
    let mut resized = Vec::new();
    for scene in others {
        let subject = Subject::new(&scene.to_string(), scene.build()?.curves)?;
        let segments = subject.curves.segments() as u64;
        bar.suspend(|| say(&format_args!("{} segments:", count(segments))));
        measure(&subject, &at_sizes, &mut resized)?;
    }
    bar.finish_and_clear();
    if as_json {
        output::json(&json!({
            "model": args.input,
            "curves": subject.curves.len(),
            "segments": own,
            "potential_links": subject.stats.potential_links,
            "segment_pairs": subject.segment_pairs,
            "threads": threads,
            "repeat": args.repeat,
            "rows": rows.iter().map(row_json).collect::<Vec<_>>(),
            "device": device,
            "slopes": slopes.iter().map(power).collect::<Map<_, _>>(),
            "sizes": resized.iter().map(row_json).collect::<Vec<_>>(),
        }));
    }
    if let Some(folder) = &args.plot {
        let [error_time, error_beta, time_size] = PLOTS.map(|name| folder.join(name));
        lab::error_against_time(&args.input, &rows).write(&error_time)?;
        lab::error_against_beta(&args.input, &rows).write(&error_beta)?;
        if !resized.is_empty() {
            let own = rows.iter().filter(|row| at_sizes.contains(&row.setting));
            let plot = lab::time_against_size(&args.input, own.chain(&resized));
            plot.write(&time_size)?;
        }
    }
    let mut outcome = Outcome::Fine;
    for row in rows.iter().chain(&resized).filter(|row| row.differs()) {
        let segments = plural(row.segments as u64, "segment");
        tracing::error!(
            "{}, {segments}: the certificate differs from the exact one",
            row.setting
        );
        outcome = Outcome::Changed;
    }
    Ok(outcome)
}

/// Fields of the file: names of [`row_json`].
const FIELDS: &[&str] = &[
    "segments",
    "segment_pairs",
    "kernel",
    "order",
    "beta",
    "target",
    "ms",
    "total_ms",
    "cpu_ms",
    "mean_error",
    "largest_error",
    "largest_bound",
    "summed",
    "counted",
    "equal",
    "skipped_s",
];

/// Returns the measurement of a kernel as an object.
pub fn row_json(row: &KernelRow) -> Value {
    let run = row.run();
    let Accuracy { beta, target, .. } = row.setting.accuracy;
    json!({
        "segments": row.segments,
        "segment_pairs": row.segment_pairs,
        "kernel": row.setting.method,
        "order": row.setting.order(),
        "beta": beta,
        "target": target,
        "ms": row.ms(),
        "total_ms": run.map(|run| run.times.total_ms),
        "cpu_ms": run.map(|run| run.times.cpu_ms),
        "mean_error": row.mean_error(),
        "largest_error": row.largest_error(),
        "largest_bound": row.largest_bound(),
        "summed": run.map(|run| run.ladder.summed),
        "counted": run.map(|run| run.ladder.counted),
        "equal": run.map(|run| run.equal),
        "skipped_s": row.measured.as_ref().err(),
    })
}

/// Returns the field of a slope.
fn power(slope: &Slope) -> (String, Value) {
    (slope.order.to_owned(), slope.power.into())
}

fn table() -> Table {
    Table::new([
        ("kernel", -33),
        ("sums ms", 9),
        ("total ms", 10),
        ("cpu ms", 10),
        ("mean error", 13),
        ("largest error", 13),
        ("proven bound", 13),
        ("decided", 9),
        ("counted", 9),
        ("certificate", 12),
    ])
}

fn line(table: &Table, row: &KernelRow) -> String {
    let run = match &row.measured {
        Ok(run) => run,
        Err(s) => return format!("{:33} skipped: about {s:.0} s", row.setting),
    };
    let ms = |ms: f64| format!("{ms:.2}");
    table.row([
        row.setting.to_string(),
        ms(row.ms().unwrap_or(f64::NAN)),
        ms(run.times.total_ms),
        ms(run.times.cpu_ms),
        brief(row.mean_error()),
        brief(row.largest_error()),
        brief(row.largest_bound()),
        run.ladder.summed.to_string(),
        run.ladder.counted.to_string(),
        if run.equal { "equal" } else { "DIFFERS" }.into(),
    ])
}

/// Formats a number with two digits, or a dash.
pub fn brief(x: Option<f64>) -> String {
    x.map_or("-".into(), |x| format!("{x:.1e}"))
}
