//! `linkwatch study sizes`: time and memory of a moving scene against its size.

use super::csv::{Csv, check_outputs};
use crate::cli::Outcome;
use crate::cli::files::{Files, Overwrite};
use crate::cli::motion_args::MotionArgs;
use crate::cli::number::segments;
use crate::cli::output::{self, count, plural};
use linkwatch::lab::{self, ScalingRow, ScalingStudy, StageCost, Table};
use linkwatch::scenes::{MovingScene, Scene};
use linkwatch::{Error, Events, Result};
use serde_json::{Value, json};
use std::path::PathBuf;

/// Measure a moving scene in growing sizes: time and peak memory of each stage
///
/// The frames of each size are written to a file and read one at a time. The certificate of the
/// first frame is compared with the one that follows from the construction. The exit code is 1 if a
/// result is not as expected.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// A scene as `linkwatch generate` takes it
    #[arg(value_name = "SCENE")]
    scene: Scene,
    /// Numbers of segments, separated by commas [default: 1, 3 and 10 times that of the scene]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = segments)]
    sizes: Vec<u64>,
    /// Number of frames. With 1, only the certificate is measured
    #[arg(
        long, value_name = "N", default_value_t = 6,
        value_parser = clap::value_parser!(u64).range(1..)
    )]
    frames: u64,
    #[command(flatten)]
    motion: MotionArgs,
    /// From this frame on, two curves of each scene are pulled through one another
    #[arg(long, value_name = "SEQ")]
    pull: Option<u64>,
    /// Search for pull-throughs between successive frames
    #[arg(long)]
    events: bool,
    /// Folder for the file of the frames, which is removed after each size
    #[arg(long, value_name = "DIR", default_value = ".")]
    scratch: PathBuf,
    /// Write the table to a file
    #[arg(long, value_name = "FILE", help_heading = crate::cli::WRITE)]
    csv: Option<PathBuf>,
    /// Write plots to a folder, as PNG and SVG: time and memory against size
    #[arg(long, value_name = "DIR", help_heading = crate::cli::WRITE)]
    plot: Option<PathBuf>,
    #[command(flatten)]
    overwrite: Overwrite,
}

/// Plots in the folder of --plot, each as PNG and SVG.
const PLOTS: [&str; 2] = ["sizes-time", "sizes-memory"];

/// Fields of the file: names of [`row_json`].
const FIELDS: &[&str] = &[
    "scene",
    "curves",
    "segments",
    "links",
    "frame_mb",
    "generate_s",
    "generate_mb",
    "read_s",
    "certify_ms",
    "certify_cpu_ms",
    "certify_mb",
    "first_ms",
    "later_ms",
    "later_cpu_ms",
    "check_mb",
    "changed",
    "as_constructed",
];

/// Runs the command.
pub fn run(args: &Args, as_json: bool) -> Result<Outcome> {
    if let Some(pull) = args.pull.filter(|&pull| pull >= args.frames) {
        let frames = plural(args.frames, "frame");
        let what = format!("--pull {pull}: there are {frames}, numbered from 0");
        return Err(Error::Usage(what));
    }
    let mut files = Files::new(args.overwrite);
    check_outputs(
        &mut files,
        args.csv.as_deref(),
        args.plot.as_deref(),
        &PLOTS,
    )?;
    let study = ScalingStudy {
        moving: MovingScene {
            pull: args.pull,
            ..args.motion.moving(&args.scene, args.frames)?
        },
        events: match args.events {
            true => Events::Between,
            false => Events::Off,
        },
        folder: args.scratch.clone(),
    };
    let scenes = scenes(args)?;
    let mut csv = Csv::create(args.csv.as_deref(), FIELDS)?;
    let say = |line: &dyn std::fmt::Display| match as_json {
        true => {}
        false => output::line(line),
    };
    say(&format_args!(
        "{}: {}, {}, events {}; times in ms unless marked, memory is the peak of the process in MB",
        args.scene,
        plural(args.frames, "frame"),
        plural(rayon::current_num_threads() as u64, "thread"),
        study.events,
    ));
    let table = table();
    say(&table.header());
    let bar = output::bar(scenes.len() as u64, "sizes");
    let mut rows = Vec::new();
    let mut outcome = Outcome::Fine;
    for scene in &scenes {
        bar.set_message(scene.to_string());
        let row = study.measure(scene)?;
        bar.inc(1);
        bar.suspend(|| say(&table.row(cells(&row))));
        csv.row(&row_json(&row))?;
        if !row.as_constructed {
            tracing::error!("{scene}: a result is not the one that follows from the construction");
            outcome = Outcome::Changed;
        }
        rows.push(row);
    }
    bar.finish_and_clear();
    if as_json {
        output::json(&json!({
            "scene": args.scene.to_string(),
            "threads": rayon::current_num_threads(),
            "frames": args.frames,
            "events": study.events.to_string(),
            "rows": rows,
        }));
    }
    if let Some(folder) = &args.plot {
        let name = args.scene.kind().name;
        let [time, memory] = PLOTS.map(|plot| folder.join(plot));
        lab::scaling_time(name, &rows).write(&time)?;
        lab::scaling_memory(name, &rows).write(&memory)?;
    }
    Ok(outcome)
}

/// Returns the scene in all sizes, the smallest first.
fn scenes(args: &Args) -> Result<Vec<Scene>> {
    let mut sizes = args.sizes.clone();
    if sizes.is_empty() {
        let own = args.scene.build()?.curves.segments() as u64;
        sizes.extend([1, 3, 10].map(|factor| factor * own));
    }
    sizes.sort_unstable();
    sizes.dedup();
    let resized = |&size: &u64| lab::resized(&args.scene, size);
    sizes.iter().map(resized).collect()
}

fn table() -> Table {
    Table::new(vec![
        ("curves", 10),
        ("segments", 12),
        ("frame\nMB", 8),
        ("generate\ns", 9),
        ("\nMB", 7),
        ("read\ns", 7),
        ("certify\nms", 9),
        ("\nMB", 7),
        ("check:\nfirst", 9),
        ("\nlater", 9),
        ("\nMB", 7),
        (" results", -1),
    ])
}

fn cells(row: &ScalingRow) -> Vec<String> {
    let mb = |x: Option<f64>| x.map_or("-".into(), |x| count(x.round() as u64));
    let ms = |x: Option<f64>| x.map_or("-".into(), |x| format!("{x:.1}"));
    let check = row.check.as_ref();
    vec![
        count(row.curves as u64),
        count(row.segments as u64),
        format!("{:.1}", row.frame_mb),
        format!("{:.2}", row.generate.s),
        mb(row.generate.peak_mb),
        format!("{:.2}", read_s(row)),
        format!("{:.1}", row.certificate_ms),
        mb(row.certify.peak_mb),
        ms(check.map(|c| c.first_ms)),
        ms(check.map(|c| c.later_ms)),
        mb(check.and_then(|c| c.all.peak_mb)),
        match row.as_constructed {
            true => format!(" as expected, {} changed", count(row.changed as u64)),
            false => " NOT as constructed".into(),
        },
    ]
}

/// Returns the time to read the first frame.
fn read_s(row: &ScalingRow) -> f64 {
    (row.certify.s - 1e-3 * row.certificate_ms).max(0.0)
}

/// Returns the fields of the file.
fn row_json(row: &ScalingRow) -> Value {
    let check = row.check.as_ref();
    let StageCost { s, peak_mb, .. } = row.generate;
    json!({
        "scene": row.scene,
        "curves": row.curves,
        "segments": row.segments,
        "links": row.links,
        "frame_mb": row.frame_mb,
        "generate_s": s,
        "generate_mb": peak_mb,
        "read_s": read_s(row),
        "certify_ms": row.certificate_ms,
        "certify_cpu_ms": row.certificate_cpu_ms,
        "certify_mb": row.certify.peak_mb,
        "first_ms": check.map(|c| c.first_ms),
        "later_ms": check.map(|c| c.later_ms),
        "later_cpu_ms": check.map(|c| c.cpu_ms[1]),
        "check_mb": check.and_then(|c| c.all.peak_mb),
        "changed": row.changed,
        "as_constructed": row.as_constructed,
    })
}
