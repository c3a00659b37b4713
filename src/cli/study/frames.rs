//! `linkwatch study frames`: cost of a moving frame against the amplitude of its motion.

use crate::cli::Outcome;
use crate::cli::event_args::EventArgs;
use crate::cli::input;
use crate::cli::number::positive;
use crate::cli::output::{self, count, plural};
use linkwatch::lab::{MotionRow, MotionStudy, Table, median, percentile};
use linkwatch::scenes::{Frames, Motion, Scene};
use linkwatch::{AbortOn, Error, Events, Report, Result};
use serde_json::{Value, json};
use std::path::Path;

/// Time moving frames: incremental verification against a plain read of the frame and a full run
///
/// Motions are words joined by `+`: still, smooth (waves of 40 diameters), iid (independent noise
/// of each point), translate (5 diameters a frame), rotate (3 degrees a frame), stretch and scale
/// (0.8 to 1.25). The amplitude applies to smooth and iid. The exit code is 1 if a verdict differs
/// from that of the full run.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// A model (.bcc, .obj, .vect), or a scene as `linkwatch generate` takes it
    #[arg(value_name = "MODEL|SCENE")]
    input: String,
    /// Diameter of the yarn, in units of the model [default: that of the scene, if it has one]
    #[arg(long, value_name = "D", value_parser = positive)]
    diameter: Option<f64>,
    /// Number of frames of each motion and amplitude
    #[arg(
        long,
        value_name = "N",
        default_value_t = 200,
        value_parser = clap::value_parser!(u64).range(1..)
    )]
    frames: u64,
    /// Motions, separated by commas
    #[arg(
        long,
        value_name = "LIST",
        value_delimiter = ',',
        default_value = "smooth,iid,smooth+translate,translate,rotate,stretch"
    )]
    motions: Vec<Motion>,
    /// Amplitudes in diameters, separated by commas
    #[arg(
        long,
        value_name = "LIST",
        value_delimiter = ',',
        default_value = "0,1e-4,1e-3,1e-2,0.05,0.1,0.2,0.5",
        value_parser = amplitude
    )]
    amplitudes: Vec<f64>,
    #[command(flatten)]
    event_args: EventArgs,
}

fn amplitude(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(x) if f64::is_finite(x) && x >= 0.0 => Ok(x),
        _ => Err("expected numbers of at least 0".into()),
    }
}

/// Runs the command.
pub fn run(args: &Args, as_json: bool) -> Result<Outcome> {
    let curves = input::read(Path::new(&args.input))?;
    // An input that could be read and parses as a scene is a scene, unless it is a file.
    let scene = args.input.parse::<Scene>().ok();
    let own = scene.and_then(|scene| scene.value("diameter"));
    let diameter = args.diameter.or(own).ok_or_else(|| {
        let what = "has no diameter, the unit of the amplitudes: give --diameter";
        Error::Usage(format!("{} {what}", args.input))
    })?;
    let mut study = MotionStudy {
        frames: Frames::new(&curves, diameter),
        curves,
        diameter,
        count: args.frames,
        events: args.event_args.events(AbortOn::Never),
        motion_limit: args.event_args.motion_limit,
    };
    let (curves, segments) = (study.curves.len(), study.curves.segments());
    let threads = rayon::current_num_threads();
    let table = table();
    if !as_json {
        output::line(format_args!(
            "{}: {} of {}, {diameter} across; {} each, {}; medians",
            args.input,
            plural(curves as u64, "curve"),
            plural(segments as u64, "segment"),
            plural(args.frames, "frame"),
            plural(threads as u64, "thread"),
        ));
        if study.events != Events::Off {
            output::line("with the search for pull-throughs from frame to frame, in both");
        }
        output::line(table.header());
    }
    let mut cases: Vec<(&Motion, f64)> = Vec::new();
    for motion in &args.motions {
        match motion.has_amplitude() {
            true => cases.extend(args.amplitudes.iter().map(|&a| (motion, a))),
            // Motions without an amplitude are measured once.
            false => cases.push((motion, 0.0)),
        }
    }
    let bar = output::bar(args.frames * cases.len() as u64, "frames");
    let mut rows = Vec::with_capacity(cases.len());
    for (motion, amplitude) in cases {
        bar.set_message(format!("{motion} {amplitude}"));
        let row = study.measure(motion, amplitude, |frame, difference| {
            if let Some([expected, found]) = difference.map(|reports| reports.map(words)) {
                let what = format!("{found}, but the full run says {expected}");
                bar.suspend(|| tracing::error!("{motion} {amplitude}, frame {frame}: {what}"));
            }
            bar.inc(1);
        })?;
        if !as_json {
            bar.suspend(|| output::line(table.row(cells(&row))));
        }
        rows.push(row);
    }
    bar.finish_and_clear();

    let all = |f: fn(&MotionRow) -> &Vec<f64>| median(rows.iter().flat_map(f).copied());
    let (read, update, full) = (all(|r| &r.read), all(|r| &r.update), all(|r| &r.full));
    let sum = |f: fn(&MotionRow) -> u64| rows.iter().map(f).sum::<u64>();
    let (compared, equal) = (sum(MotionRow::compared), sum(|r| r.equal));
    if as_json {
        output::json(&json!({
            "model": args.input,
            "diameter": diameter,
            "curves": curves,
            "segments": segments,
            "frames": args.frames,
            "threads": threads,
            "events": study.events.to_string(),
            "read_ms": read,
            "update_ms": update,
            "full_ms": full,
            "compared": compared,
            "equal": equal,
            "rows": rows.iter().map(row_json).collect::<Vec<_>>(),
        }));
    } else {
        output::line(format_args!(
            "read {read:.4} ms, update {update:.3} ms, full run {full:.3} ms; \
             {} of {} verdicts as in the full run",
            count(equal),
            count(compared),
        ));
    }
    Ok(match equal == compared {
        true => Outcome::Fine,
        false => Outcome::Changed,
    })
}

/// Returns a report in a few words.
fn words(report: &Report) -> String {
    let changes = plural(report.changes.len() as u64, "change");
    let defects = plural(report.defects.len() as u64, "defect");
    format!("{} ({changes}, {defects})", report.verdict)
}

fn table() -> Table {
    Table::new([
        ("motion", -18),
        ("amplitude", 9),
        ("read", 8),
        ("full", 7),
        ("frame", 7),
        ("/read", 7),
        ("p95", 7),
        ("marked", 7),
        ("recertified", 12),
        ("recomputed", 11),
        ("full/quiet/partial %", 21),
        (" verdicts", -1),
    ])
}

fn cells(row: &MotionRow) -> [String; 12] {
    let [read, full, frame] = medians([&row.read, &row.full, &row.frame]);
    let share = |n: u64| format!("{:.0}", 100.0 * n as f64 / row.frame.len() as f64);
    let broken = match row.not_intact {
        0 => String::new(),
        n => format!(" ({} not intact)", count(n)),
    };
    let events = match row.events {
        0 => String::new(),
        n => format!(", {}", plural(n, "pull-through")),
    };
    [
        row.motion.clone(),
        row.amplitude.to_string(),
        format!("{read:.4}"),
        format!("{full:.3}"),
        format!("{frame:.3}"),
        format!("{:.2}", frame / read),
        format!("{:.3}", percentile(row.frame.iter().copied(), 95)),
        format!("{:.2}%", 100.0 * row.marked_share()),
        format!("{:.1}", row.per_frame(row.recertified)),
        format!("{:.1}", row.per_frame(row.recomputed)),
        row.routes.map(share).join("/"),
        format!(" {}/{}{broken}{events}", row.equal, row.compared()),
    ]
}

fn row_json(row: &MotionRow) -> Value {
    let [read, update, full, frame] = medians([&row.read, &row.update, &row.full, &row.frame]);
    json!({
        "motion": row.motion,
        "amplitude": row.amplitude,
        "read_ms": read,
        "update_ms": update,
        "full_ms": full,
        "frame_ms": frame,
        "frame_p95_ms": percentile(row.frame.iter().copied(), 95),
        "ratio_to_read": frame / read,
        "marked_share": row.marked_share(),
        "recertified": row.per_frame(row.recertified),
        "recomputed": row.per_frame(row.recomputed),
        "routes": {
            "full": row.routes[0],
            "quiet": row.routes[1],
            "partial": row.routes[2],
        },
        "events": row.events,
        "compared": row.compared(),
        "equal": row.equal,
        "not_intact": row.not_intact,
    })
}

fn medians<const N: usize>(times: [&Vec<f64>; N]) -> [f64; N] {
    times.map(|times| median(times.iter().copied()))
}
