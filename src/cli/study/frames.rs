//! `linkwatch study frames`: cost of a moving frame against the amplitude of its motion.
//!
//! Every frame is read once, copied into the curve set, and verified incrementally. Every few
//! frames a second verifier computes the frame in full, for its time and its verdict. All
//! measurements alternate frame by frame, so that a busy machine slows all of them equally.

use crate::cli::Outcome;
use crate::cli::event_args::EventArgs;
use crate::cli::input;
use crate::cli::number::positive;
use crate::cli::output::{self, count, plural};
use linkwatch::scenes::{Frames, Motion, Scene};
use linkwatch::{
    AbortOn, CurveSet, Error, Events, Positions, Report, Result, Strategy, Verifier,
    VerifierOptions,
};
use serde_json::{Value, json};
use std::hint::black_box;
use std::path::Path;
use std::time::Instant;

/// Number of full runs of a row: enough for a median.
const FULL_RUNS: u64 = 25;

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
    #[arg(long, value_name = "N", default_value_t = 200, value_parser = clap::value_parser!(u64).range(1..))]
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
    let mut set = input::read(Path::new(&args.input))?;
    // An input that could be read and parses as a scene is a scene, unless it is a file.
    let scene = args.input.parse::<Scene>().ok();
    let own = scene.and_then(|scene| scene.value("diameter"));
    let diameter = args.diameter.or(own).ok_or_else(|| {
        let what = "has no diameter, the unit of the amplitudes: give --diameter";
        Error::Usage(format!("{} {what}", args.input))
    })?;
    let mut frames = Frames::new(&set, diameter);
    let events = args.event_args.events(AbortOn::Never);
    let threads = rayon::current_num_threads();
    if !as_json {
        output::line(format_args!(
            "{}: {} of {}, {diameter} across; {} each, {}; medians",
            args.input,
            plural(set.len() as u64, "curve"),
            plural(set.segments() as u64, "segment"),
            plural(args.frames, "frame"),
            plural(threads as u64, "thread"),
        ));
        if events != Events::Off {
            output::line("with the search for pull-throughs from frame to frame, in both");
        }
        output::line(HEADER);
    }
    let cases: Vec<(&Motion, f64)> = args
        .motions
        .iter()
        .flat_map(|motion| {
            // Motions without an amplitude are measured once.
            let amplitudes = match motion.has_amplitude() {
                true => &args.amplitudes[..],
                false => &[0.0],
            };
            amplitudes.iter().map(move |&a| (motion, a))
        })
        .collect();
    let bar = output::bar(args.frames * cases.len() as u64, "frames");
    let mut rows = Vec::with_capacity(cases.len());
    for (motion, amplitude) in cases {
        bar.set_message(format!("{motion} {amplitude}"));
        let mut row = Row::new(motion, amplitude);
        let mut verifiers = Verifiers::of(&mut set, &mut frames, args.event_args)?;
        for frame in 1..=args.frames {
            let positions = frames.at(motion, amplitude * diameter, frame);
            // The search for pull-throughs must see every frame.
            let every = match events {
                Events::Off => (args.frames / FULL_RUNS).max(1),
                _ => 1,
            };
            let full = frame % every == 0;
            let differs = row.measure(&mut verifiers, &mut set, positions, (frame, full))?;
            if let Some(what) = differs {
                bar.suspend(|| tracing::error!("{motion} {amplitude}, frame {frame}: {what}"));
            }
            bar.inc(1);
        }
        if !as_json {
            bar.suspend(|| output::line(row.line()));
        }
        rows.push(row);
    }
    bar.finish_and_clear();

    let all = |f: fn(&Row) -> &Vec<f64>| median(rows.iter().flat_map(f).copied());
    let (read, update, full) = (all(|r| &r.read), all(|r| &r.update), all(|r| &r.full));
    let sum = |f: fn(&Row) -> u64| rows.iter().map(f).sum::<u64>();
    let (compared, equal) = (sum(Row::compared), sum(|r| r.equal));
    if as_json {
        output::json(&json!({
            "model": args.input,
            "diameter": diameter,
            "curves": set.len(),
            "segments": set.segments(),
            "frames": args.frames,
            "threads": threads,
            "events": events.to_string(),
            "read_ms": read,
            "update_ms": update,
            "full_ms": full,
            "compared": compared,
            "equal": equal,
            "rows": rows.iter().map(Row::json).collect::<Vec<_>>(),
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

/// The incremental verifier that is measured, and the one that computes every frame in full.
struct Verifiers {
    incremental: Verifier,
    full: Verifier,
}

impl Verifiers {
    /// Creates both verifiers. Both have seen frame 0, which is their baseline.
    fn of(set: &mut CurveSet, frames: &mut Frames, event_args: EventArgs) -> Result<Verifiers> {
        let verifier = |strategy| {
            Verifier::new(VerifierOptions {
                strategy,
                events: event_args.events(AbortOn::Never),
                motion_limit: event_args.motion_limit,
                ..VerifierOptions::default()
            })
        };
        let mut verifiers = Verifiers {
            incremental: verifier(Strategy::Incremental)?,
            full: verifier(Strategy::Full)?,
        };
        set.update(frames.at(&Motion::new([]), 0.0, 0))?;
        for verifier in [&mut verifiers.incremental, &mut verifiers.full] {
            let _ = verifier.step(0, 0.0, set)?;
        }
        Ok(verifiers)
    }
}

/// Measurements of one motion and amplitude. Times are in milliseconds.
struct Row {
    motion: String,
    /// Amplitude in diameters.
    amplitude: f64,
    read: Vec<f64>,
    update: Vec<f64>,
    frame: Vec<f64>,
    full: Vec<f64>,
    /// Number of frames on the full, the quiet and the partial route.
    routes: [u64; 3],
    /// Sums over all frames.
    blocks: u64,
    marked: u64,
    recertified: u64,
    recomputed: u64,
    /// Number of reported pull-throughs.
    events: u64,
    /// Number of full runs with an equal result.
    equal: u64,
    /// Number of full runs whose verdict was not intact.
    broken: u64,
}

const HEADER: &str = "motion             amplitude     read    full   frame   /read     p95  marked  \
                      recertified  recomputed  full/quiet/partial %  verdicts";

/// Number of first frames after each of which the background work is awaited.
const SETTLED: u64 = 3;

impl Row {
    fn new(motion: &Motion, amplitude: f64) -> Row {
        Row {
            motion: motion.to_string(),
            amplitude,
            read: Vec::new(),
            update: Vec::new(),
            frame: Vec::new(),
            full: Vec::new(),
            routes: [0; 3],
            blocks: 0,
            marked: 0,
            recertified: 0,
            recomputed: 0,
            events: 0,
            equal: 0,
            broken: 0,
        }
    }

    /// Measures one frame. Returns the difference if the full run has another result.
    fn measure(
        &mut self,
        verifiers: &mut Verifiers,
        set: &mut CurveSet,
        positions: Positions<'_>,
        (frame, full): (u64, bool),
    ) -> Result<Option<String>> {
        timed(&mut self.read, || largest(black_box(positions)));
        timed(&mut self.update, || set.update(black_box(positions)))?;
        let verifier = &mut verifiers.incremental;
        let report = timed(&mut self.frame, || verifier.step(frame, 0.0, set))?;
        let work = verifier.work();
        self.routes[work.route as usize] += 1;
        self.blocks += work.blocks;
        self.marked += work.marked;
        self.recertified += work.recertified;
        self.recomputed += work.recomputed;
        self.events += report.events.len() as u64;
        // A simulation leaves enough time for the first reference frame; here frames follow at
        // once.
        if frame < SETTLED {
            verifier.settle();
        }
        if !full {
            return Ok(None);
        }
        // Updated again, so that both verifiers run after the same single-threaded work.
        set.update(black_box(positions))?;
        let expected = timed(&mut self.full, || verifiers.full.step(frame, 0.0, set))?;
        self.broken += u64::from(expected.verdict != linkwatch::Verdict::Intact);
        if same(&expected, &report) {
            self.equal += 1;
            return Ok(None);
        }
        let words = |r: &Report| {
            let (changes, defects) = (r.changes.len() as u64, r.defects.len() as u64);
            let (changes, defects) = (plural(changes, "change"), plural(defects, "defect"));
            format!("{} ({changes}, {defects})", r.verdict)
        };
        let (expected, found) = (words(&expected), words(&report));
        Ok(Some(format!("{found}, but the full run says {expected}")))
    }

    fn compared(&self) -> u64 {
        self.full.len() as u64
    }

    /// Returns the share of frames that took a route.
    fn share(&self, route: usize) -> f64 {
        self.routes[route] as f64 / self.frame.len() as f64
    }

    fn marked_share(&self) -> f64 {
        self.marked as f64 / self.blocks.max(1) as f64
    }

    /// Returns the mean of a sum over the frames.
    fn each(&self, sum: u64) -> f64 {
        sum as f64 / self.frame.len() as f64
    }

    fn line(&self) -> String {
        let [read, full, frame] = [&self.read, &self.full, &self.frame].map(|v| median_of(v));
        let [whole, quiet, partial] = [0, 1, 2].map(|route| 100.0 * self.share(route));
        let broken = match self.broken {
            0 => String::new(),
            n => format!(" ({} not intact)", count(n)),
        };
        let events = match self.events {
            0 => String::new(),
            n => format!(", {}", plural(n, "pull-through")),
        };
        format!(
            "{:18} {:>9} {read:>8.4} {full:>7.3} {frame:>7.3} {:>7.2} {:>7.3} {:>6.2}% {:>12.1} {:>11.1}  {:>20}  {}/{}{broken}{events}",
            self.motion,
            self.amplitude,
            frame / read,
            percentile(&self.frame, 95),
            100.0 * self.marked_share(),
            self.each(self.recertified),
            self.each(self.recomputed),
            format!("{whole:.0}/{quiet:.0}/{partial:.0}"),
            self.equal,
            self.compared(),
        )
    }

    fn json(&self) -> Value {
        let [read, update, full, frame] =
            [&self.read, &self.update, &self.full, &self.frame].map(|v| median_of(v));
        json!({
            "motion": self.motion,
            "amplitude": self.amplitude,
            "read_ms": read,
            "update_ms": update,
            "full_ms": full,
            "frame_ms": frame,
            "frame_p95_ms": percentile(&self.frame, 95),
            "ratio_to_read": frame / read,
            "marked_share": self.marked_share(),
            "recertified": self.each(self.recertified),
            "recomputed": self.each(self.recomputed),
            "routes": {
                "full": self.routes[0],
                "quiet": self.routes[1],
                "partial": self.routes[2],
            },
            "events": self.events,
            "compared": self.compared(),
            "equal": self.equal,
            "not_intact": self.broken,
        })
    }
}

/// Returns true if two reports agree on the topology of a frame.
fn same(a: &Report, b: &Report) -> bool {
    (a.verdict, &a.changes) == (b.verdict, &b.changes)
        && (&a.events, &a.defects) == (&b.events, &b.defects)
}

/// Runs `work` and appends the milliseconds that it took.
fn timed<T>(times: &mut Vec<f64>, work: impl FnOnce() -> T) -> T {
    let start = Instant::now();
    let result = black_box(work());
    times.push(start.elapsed().as_secs_f64() * 1e3);
    result
}

/// Returns the largest coordinate: the minimum work that reads a whole frame, by one thread.
fn largest(positions: Positions<'_>) -> f64 {
    // Computes several maxima in parallel, so that the compiler uses vectors.
    fn of<T: Copy + PartialOrd>(values: &[T], least: T) -> T {
        let larger = |a: T, b: T| if a > b { a } else { b };
        let mut lanes = [least; 32];
        let mut chunks = values.chunks_exact(lanes.len());
        for chunk in &mut chunks {
            for (lane, &x) in lanes.iter_mut().zip(chunk) {
                *lane = larger(*lane, x);
            }
        }
        let rest = chunks.remainder().iter().copied();
        lanes.into_iter().chain(rest).fold(least, larger)
    }
    match positions {
        Positions::F32(v) => of(v, f32::NEG_INFINITY).into(),
        Positions::F64(v) => of(v, f64::NEG_INFINITY),
    }
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    median_of(&values.collect::<Vec<f64>>())
}

/// Returns the median of some values, of which there is at least one.
pub fn median_of(values: &[f64]) -> f64 {
    percentile(values, 50)
}

/// Returns the nearest value at or above a percentile of some values, of which there is at least
/// one.
fn percentile(values: &[f64], percent: usize) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[(sorted.len() * percent / 100).min(sorted.len() - 1)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_plain_read_covers_all_coordinates() {
        let mut v: Vec<f32> = (0..1000).map(|k| -(k as f32)).collect();
        assert_eq!(largest(Positions::F32(&v)), 0.0);
        for at in [1, 500, 999] {
            v[at] = 7.0;
            assert_eq!(largest(Positions::F32(&v)), 7.0);
            v[at] = -1.0;
        }
        assert_eq!(largest(Positions::F64(&[-3.0, -2.0, -5.0])), -2.0);
    }

    #[test]
    fn computes_percentiles_of_few_and_many_values() {
        assert_eq!((median_of(&[5.0]), percentile(&[5.0], 95)), (5.0, 5.0));
        let v: Vec<f64> = (0..100).rev().map(f64::from).collect();
        assert_eq!((median_of(&v), percentile(&v, 95)), (50.0, 95.0));
    }
}
