//! `linkwatch study frames`: cost of a moving frame against the amplitude of its motion.

use crate::cli::Outcome;
use crate::cli::event_args::EventArgs;
use crate::cli::input;
use crate::cli::number::positive;
use crate::cli::output::{self, count, plural};
use indicatif::ProgressBar;
#[cfg(feature = "mcap")]
use linkwatch::lab::RecordedMotion;
use linkwatch::lab::{
    FrameSource, GeneratedMotion, MotionRow, MotionStudy, Table, median, percentile,
};
use linkwatch::model::MODEL_FILES;
use linkwatch::scenes::{Frames, Motion, Scene};
use linkwatch::{AbortOn, ClearanceOptions, CurveSet, Error, Events, Report, Result};
use serde_json::{Value, json};
use std::path::Path;
#[cfg(feature = "mcap")]
use std::path::PathBuf;

/// Time moving frames: incremental verification against a plain read of the frame and a full run
///
/// Motions are words joined by `+`: still, smooth (waves of 40 diameters), iid (independent noise
/// of each point), translate (5 diameters a frame), rotate (3 degrees a frame), stretch and scale
/// (0.8 to 1.25). The amplitude applies to smooth and iid. The exit code is 1 if a verdict differs
/// from that of the full run.
#[derive(Debug, clap::Args)]
pub struct Args {
    #[arg(
        value_name = "MODEL|SCENE",
        help = format!("A model ({MODEL_FILES}), or a scene as `linkwatch generate` takes it")
    )]
    #[cfg_attr(feature = "mcap", arg(required_unless_present = "recording"))]
    input: Option<String>,
    /// Measure the frames of a recording instead of a generated motion. Every frame is computed in
    /// full as well
    #[cfg(feature = "mcap")]
    #[arg(
        long,
        value_name = "FILE.mcap",
        conflicts_with_all = ["input", "diameter", "frames", "motions", "amplitudes"]
    )]
    recording: Option<PathBuf>,
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
    /// Measure the clearance of strands of this radius as well, in units of the model: its time,
    /// and the share of a full run
    #[arg(long, value_name = "R", value_parser = positive)]
    thickness: Option<f64>,
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
    #[cfg(feature = "mcap")]
    if let Some(file) = &args.recording {
        let mut motion = RecordedMotion::open(file)?;
        let curves = motion.curves().clone();
        let mut study = Study::new(args, &file.display().to_string(), curves, as_json);
        study.announce("");
        study.measure("recorded", 0.0, &mut motion, None, &ProgressBar::hidden())?;
        return Ok(study.finish(None, None));
    }
    let Some(input) = &args.input else {
        return Err(Error::Usage("give a model or a scene".into()));
    };
    let curves = input::read(Path::new(input))?;
    // An input that could be read and parses as a scene is a scene, unless it is a file.
    let scene = input.parse::<Scene>().ok();
    let own = scene.and_then(|scene| scene.value("diameter"));
    let diameter = args.diameter.or(own).ok_or_else(|| {
        let what = "has no diameter, the unit of the amplitudes: give --diameter";
        Error::Usage(format!("{input} {what}"))
    })?;
    let mut cases: Vec<(&Motion, f64)> = Vec::new();
    for motion in &args.motions {
        match motion.has_amplitude() {
            true => cases.extend(args.amplitudes.iter().map(|&a| (motion, a))),
            // Motions without an amplitude are measured once.
            false => cases.push((motion, 0.0)),
        }
    }
    let mut frames = Frames::new(&curves, diameter);
    let mut study = Study::new(args, input, curves, as_json);
    let each = plural(args.frames, "frame");
    study.announce(&format!(", {diameter} across; {each} each"));
    let bar = output::bar(args.frames * cases.len() as u64, "frames");
    for (motion, amplitude) in cases {
        let length = amplitude * diameter;
        let mut source = GeneratedMotion::new(&mut frames, motion, length, args.frames);
        let name = motion.to_string();
        study.measure(&name, amplitude, &mut source, Some(args.frames), &bar)?;
    }
    bar.finish_and_clear();
    Ok(study.finish(Some(diameter), Some(args.frames)))
}

/// A study, and its results so far.
struct Study {
    input: String,
    motions: MotionStudy,
    as_json: bool,
    table: Table,
    rows: Vec<MotionRow>,
}

impl Study {
    fn new(args: &Args, input: &str, curves: CurveSet, as_json: bool) -> Study {
        Study {
            input: input.to_owned(),
            motions: MotionStudy {
                curves,
                events: args.event_args.events(AbortOn::Never, Events::Off),
                motion_limit: args.event_args.motion_limit,
                clearance: args.thickness.map(|r| ClearanceOptions::new(Some(r))),
            },
            as_json,
            table: table(),
            rows: Vec::new(),
        }
    }

    /// Prints the heading of the table.
    fn announce(&self, details: &str) {
        if self.as_json {
            return;
        }
        output::line(format_args!(
            "{}: {} of {}{details}, {}; medians",
            self.input,
            plural(self.motions.curves.len() as u64, "curve"),
            plural(self.motions.curves.segments() as u64, "segment"),
            plural(rayon::current_num_threads() as u64, "thread"),
        ));
        if self.motions.events != Events::Off {
            output::line("with the search for pull-throughs from frame to frame, in both");
        }
        output::line(self.table.header());
    }

    /// Measures one motion, and prints its row.
    fn measure(
        &mut self,
        motion: &str,
        amplitude: f64,
        source: &mut dyn FrameSource,
        count: Option<u64>,
        bar: &ProgressBar,
    ) -> Result<()> {
        bar.set_message(format!("{motion} {amplitude}"));
        let report = |frame: u64, difference: Option<[&Report; 2]>| {
            if let Some([expected, found]) = difference.map(|reports| reports.map(words)) {
                let what = format!("{found}, but the full run says {expected}");
                bar.suspend(|| tracing::error!("{motion} {amplitude}, frame {frame}: {what}"));
            }
            bar.inc(1);
        };
        let described = (motion.to_owned(), amplitude);
        let row = self.motions.measure(described, source, count, report)?;
        if !self.as_json {
            bar.suspend(|| {
                output::line(self.table.row(cells(&row)));
                if self.motions.clearance.is_some() {
                    output::line(clearance(&row));
                }
            });
        }
        self.rows.push(row);
        Ok(())
    }

    /// Prints the sums. `frames` is the number of frames of each motion, if it was given.
    fn finish(self, diameter: Option<f64>, frames: Option<u64>) -> Outcome {
        let rows = &self.rows;
        let all = |f: fn(&MotionRow) -> &Vec<f64>| median(rows.iter().flat_map(f).copied());
        let (read, update, full) = (all(|r| &r.read), all(|r| &r.update), all(|r| &r.full));
        let receive = all(|r| &r.receive);
        let sum = |f: fn(&MotionRow) -> u64| rows.iter().map(f).sum::<u64>();
        let (compared, equal) = (sum(MotionRow::compared), sum(|r| r.equal));
        if self.as_json {
            output::json(&json!({
                "model": self.input,
                "diameter": diameter,
                "curves": self.motions.curves.len(),
                "segments": self.motions.curves.segments(),
                "frames": frames,
                "threads": rayon::current_num_threads(),
                "events": self.motions.events.to_string(),
                "read_ms": read,
                "receive_ms": receive,
                "update_ms": update,
                "full_ms": full,
                "compared": compared,
                "equal": equal,
                "rows": rows.iter().map(row_json).collect::<Vec<_>>(),
            }));
        } else {
            output::line(format_args!(
                "read {read:.4} ms, receive {receive:.3} ms, full run {full:.3} ms; \
                 {} of {} verdicts as in the full run",
                count(equal),
                count(compared),
            ));
        }
        match equal == compared {
            true => Outcome::Fine,
            false => Outcome::Changed,
        }
    }
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
        ("receive", 7),
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

fn cells(row: &MotionRow) -> [String; 13] {
    let [read, full, frame] = medians([&row.read, &row.full, &row.frame]);
    let receive = median(row.receive.iter().copied());
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
        format!("{receive:.3}"),
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

/// Returns the time of the clearance, and its share of a full run.
fn clearance(row: &MotionRow) -> String {
    let [clearance, full] = medians([&row.clearance, &row.full]);
    let mean = row.clearance.iter().sum::<f64>() / row.clearance.len() as f64;
    let share = |ms: f64| 100.0 * ms / full;
    format!(
        "  clearance: {clearance:.4} ms, {:.1} % of a full run; mean {mean:.4} ms, {:.1} %; lowest \
         {:.3}",
        share(clearance),
        share(mean),
        row.lowest,
    )
}

fn row_json(row: &MotionRow) -> Value {
    let [read, full, frame] = medians([&row.read, &row.full, &row.frame]);
    let [receive, update] = medians([&row.receive, &row.update]);
    json!({
        "motion": row.motion,
        "amplitude": row.amplitude,
        "read_ms": read,
        "receive_ms": receive,
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
        "clearance_ms": median(row.clearance.iter().copied()),
        "lowest_clearance": row.lowest.is_finite().then_some(row.lowest),
        "events": row.events,
        "compared": row.compared(),
        "equal": row.equal,
        "not_intact": row.not_intact,
    })
}

fn medians<const N: usize>(times: [&Vec<f64>; N]) -> [f64; N] {
    times.map(|times| median(times.iter().copied()))
}
