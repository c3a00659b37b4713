//! `study frames`: cost of a moving frame against the amplitude of its motion.
//!
//! Every frame is read once, then received and verified incrementally. Every few frames a second
//! session receives the frame and computes it in full, for its time and its verdict. All
//! measurements alternate frame by frame, so that a busy machine slows all of them equally.

use crate::input::{self, at_least, count, plural, positive, threads, usage};
use crate::measure::{Table, median, ms, timed};
use linkwatch::scenes::{Frames, Motion};
use linkwatch::{
    ClearanceOptions, CurveSet, Error, Events, FrameInfo, Positions, RawFrame, RecordedFrame,
    RecordedItem, RecordingReader, Report, Result, Session, SessionOptions, Strategy, Verdict,
    VerifiedFrame,
};
use std::hint::black_box;
use std::path::{Path, PathBuf};

/// Number of full runs of a row: enough for a median.
const FULL_RUNS: u64 = 25;

/// Number of first frames after each of which the background work is awaited.
const SETTLED: u64 = 3;

/// Time moving frames: incremental verification against a plain read of the frame and a full run
///
/// Motions are words joined by `+`: still, smooth (waves of 40 diameters), iid (independent noise
/// of each point), translate (5 diameters a frame), rotate (3 degrees a frame), stretch and scale
/// (0.8 to 1.25). The amplitude applies to smooth and iid. The exit code is 1 if a verdict differs
/// from that of the full run.
#[derive(clap::Args)]
pub struct Args {
    /// A model, or a scene as `linkwatch generate` takes it
    #[arg(value_name = "MODEL|SCENE", required_unless_present = "recording")]
    input: Option<String>,
    /// Measure the frames of a recording instead of a generated motion. Every frame is computed in
    /// full as well
    #[arg(
        long, value_name = "FILE.mcap",
        conflicts_with_all = ["input", "diameter", "frames", "motions", "amplitudes"]
    )]
    recording: Option<PathBuf>,
    /// Diameter of the yarn, in units of the model [default: that of the scene, if it has one]
    #[arg(long, value_name = "D", value_parser = positive)]
    diameter: Option<f64>,
    /// Number of frames of each motion and amplitude
    #[arg(
        long, value_name = "N", default_value_t = 200,
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
        long, value_name = "LIST", value_delimiter = ',',
        default_value = "0,1e-4,1e-3,1e-2,0.05,0.1,0.2,0.5",
        value_parser = |text: &str| at_least(0.0, text)
    )]
    amplitudes: Vec<f64>,
    /// Measure the clearance of strands of this radius as well, in units of the model: its time,
    /// and the share of a full run
    #[arg(long, value_name = "R", value_parser = positive)]
    radius: Option<f64>,
    /// Search for pull-throughs of two curves as well
    #[arg(long)]
    events: bool,
    /// Search for pull-throughs of a curve through itself as well (implies --events)
    #[arg(long = "self")]
    with_self: bool,
}

/// Takes the positions of a frame, and whether it does not continue the previous one.
type Take<'a> = dyn FnMut(Positions<'_>, bool) -> Result<()> + 'a;

/// Passes the frame of a number on. Returns false if there is none.
type Source<'a> = dyn FnMut(u64, &mut Take<'_>) -> Result<bool> + 'a;

/// Runs the command.
pub fn run(args: &Args) -> Result<u8> {
    if let Some(file) = &args.recording {
        let (curves, frames) = recorded(file)?;
        let mut study = Study::new(args, curves);
        study.announce(&file.display().to_string(), "");
        let (mut frames, mut cuts) = (frames.into_iter(), 0);
        study.measure("recorded", 0.0, None, &mut |_, take| {
            let Some(frame) = frames.next() else {
                return Ok(false);
            };
            let cut = std::mem::replace(&mut cuts, frame.info.cuts) != frame.info.cuts;
            frame.read(|raw| take(raw.positions, cut))?;
            Ok(true)
        })?;
        return Ok(study.finish());
    }
    let input = args.input.as_deref().unwrap_or_default();
    let curves = input::read(input)?;
    let diameter = input::diameter(args.diameter, input::as_scene(input).as_ref(), input)?;
    let mut frames = Frames::new(&curves, diameter);
    let mut study = Study::new(args, curves);
    let each = plural(args.frames as usize, "frame");
    study.announce(input, &format!(", {diameter} across; {each} each"));
    for motion in &args.motions {
        // Motions without an amplitude are measured once.
        let amplitudes = match motion.has_amplitude() {
            true => &args.amplitudes[..],
            false => &[0.0],
        };
        for &amplitude in amplitudes {
            let name = motion.to_string();
            study.measure(&name, amplitude, Some(args.frames), &mut |frame, take| {
                if frame > args.frames {
                    return Ok(false);
                }
                take(frames.at(motion, amplitude * diameter, frame), false)?;
                Ok(true)
            })?;
        }
    }
    Ok(study.finish())
}

/// Reads the curves and the frames of a recording. Frames that break their contract (a NaN), and
/// those of other curves, are skipped.
fn recorded(path: &Path) -> Result<(CurveSet, Vec<RecordedFrame>)> {
    let mut reader = RecordingReader::open(path)?;
    let (mut curves, mut frames) = (None, Vec::new());
    while let Some(item) = reader.next_item()? {
        if let RecordedItem::Frame(frame) = item
            && frame.ingest(&mut curves).is_ok()
        {
            frames.push(frame);
        }
    }
    let name = path.display();
    match curves {
        _ if frames.iter().any(|frame| frame.info.cell.is_some()) => {
            Err(usage(format!("{name}: studies have no periodic scenes")))
        }
        Some(curves) if !frames.is_empty() => Ok((curves, frames)),
        _ => Err(usage(format!("{name}: a recording without a valid frame"))),
    }
}

/// A study, and its results so far.
struct Study {
    curves: CurveSet,
    events: Events,
    clearance: Option<ClearanceOptions>,
    table: Table,
    rows: Vec<Row>,
}

impl Study {
    fn new(args: &Args, curves: CurveSet) -> Study {
        Study {
            curves,
            events: match (args.with_self, args.events) {
                (true, _) => Events::All,
                (false, true) => Events::Between,
                (false, false) => Events::Off,
            },
            clearance: args.radius.map(|r| ClearanceOptions::new(Some(r))),
            table: table(),
            rows: Vec::new(),
        }
    }

    /// Prints the heading of the table.
    fn announce(&self, input: &str, details: &str) {
        println!(
            "{input}: {} of {}{details}, {}; medians in ms",
            plural(self.curves.len(), "curve"),
            plural(self.curves.segments(), "segment"),
            plural(threads(), "thread"),
        );
        if self.events != Events::Off {
            println!("with the search for pull-throughs from frame to frame, in both");
        }
        println!("{}", self.table.header());
    }

    fn session(&self, strategy: Strategy) -> Result<Session> {
        Session::new(SessionOptions {
            strategy,
            events: self.events,
            clearance: self.clearance.filter(|_| strategy == Strategy::Incremental),
            keep_open: true,
            ..SessionOptions::default()
        })
    }

    /// Measures all frames of a motion, and prints their row. The first frame is the baseline.
    /// `count` is the number of frames, if it is known: then some of many frames are computed in
    /// full, else all.
    fn measure(
        &mut self,
        motion: &str,
        amplitude: f64,
        count: Option<u64>,
        source: &mut Source<'_>,
    ) -> Result<()> {
        let mut row = Row {
            motion: motion.to_owned(),
            amplitude,
            lowest: f64::INFINITY,
            ..Row::default()
        };
        // The search for pull-throughs must see every frame.
        let every = match (self.events, count) {
            (Events::Off, Some(count)) => (count / FULL_RUNS).max(1),
            _ => 1,
        };
        let mut incremental = self.session(Strategy::Incremental)?;
        let mut full = self.session(Strategy::Full)?;
        let counts: Vec<i32> = self.curves.counts().collect();
        let basis = self.curves.basis();
        let mut frame = 0;
        let mut take = |positions: Positions<'_>, cut: bool| {
            let raw = RawFrame {
                basis,
                counts: &counts,
                positions,
            };
            frame += 1;
            if frame == 1 {
                verify(&mut incremental, 0, raw)?;
                verify(&mut full, 0, raw)?;
                return Ok(());
            }
            if cut {
                incremental.cut();
                full.cut();
            }
            let (_, read) = timed(|| black_box(largest(black_box(positions))));
            row.read.push(read.wall_ms);
            let seq = frame - 1;
            let verified = verify(&mut incremental, seq, raw)?;
            row.add(&verified);
            // A simulation leaves enough time for the first reference frame; here frames follow at
            // once.
            if seq < SETTLED {
                incremental.settle();
            }
            if seq % every != 0 {
                return Ok(());
            }
            let computed = verify(&mut full, seq, raw)?;
            let [expected, found] = [&computed.report, &verified.report];
            row.full.push(ms(computed.ingest + computed.verification));
            row.not_intact += u64::from(expected.verdict != Verdict::Intact);
            match same(expected, found) {
                true => row.equal += 1,
                false => eprintln!(
                    "error: {motion} {amplitude}, frame {seq}: {}, but the full run says {}",
                    words(found),
                    words(expected)
                ),
            }
            Ok(())
        };
        let mut next = 0;
        while source(next, &mut take)? {
            next += 1;
        }
        println!("{}", self.table.row(cells(&row)));
        if self.clearance.is_some() {
            println!("{}", clearance(&row));
        }
        self.rows.push(row);
        Ok(())
    }

    /// Prints the sums. Returns the exit code.
    fn finish(self) -> u8 {
        let all = |f: fn(&Row) -> &Vec<f64>| median(self.rows.iter().flat_map(f).copied());
        let sum = |f: fn(&Row) -> u64| self.rows.iter().map(f).sum::<u64>();
        let (equal, compared) = (sum(|r| r.equal), sum(|r| r.full.len() as u64));
        println!(
            "read {:.4} ms, receive {:.3} ms, full run {:.3} ms; {} of {} verdicts as in the full \
             run",
            all(|r| &r.read),
            all(|r| &r.receive),
            all(|r| &r.full),
            count(equal),
            count(compared),
        );
        u8::from(equal != compared)
    }
}

/// Verifies a frame, which is received as in a live run.
///
/// Errors: those of [`Session::verify`], and the reason why the frame is rejected.
fn verify(session: &mut Session, frame: u64, raw: RawFrame<'_>) -> Result<VerifiedFrame> {
    let received = session.receive(FrameInfo::at(frame, 0.0), |copy| copy(black_box(raw)));
    let verified = session.verify(received)?;
    match verified.report.rejected.clone() {
        Some(why) => Err(Error::Usage(why)),
        None => Ok(verified),
    }
}

/// Measurements of one motion and amplitude. Times are in milliseconds, one for each frame.
#[derive(Default)]
struct Row {
    motion: String,
    /// Amplitude in diameters.
    amplitude: f64,
    /// Times of a plain read of the frame by one thread.
    read: Vec<f64>,
    /// Times to receive a frame for the incremental verification: to copy it, and to compare it on
    /// the way.
    receive: Vec<f64>,
    /// Times to receive and to verify a frame incrementally.
    frame: Vec<f64>,
    /// Times to measure the clearance, not contained in `frame`.
    clearance: Vec<f64>,
    /// Lowest clearance of all frames; infinite if it was not measured, or nothing came close.
    lowest: f64,
    /// Times to copy a frame and to verify it in full.
    full: Vec<f64>,
    /// Number of frames on the full, the quiet and the partial route.
    routes: [u64; 3],
    /// Numbers of marked blocks and of all blocks.
    marked: [u64; 2],
    /// Number of reported pull-throughs.
    events: u64,
    /// Number of full runs with an equal result.
    equal: u64,
    /// Number of full runs whose verdict was not intact.
    not_intact: u64,
}

impl Row {
    fn add(&mut self, verified: &VerifiedFrame) {
        let report = &verified.report;
        // The clearance has a column of its own.
        let clearance = report.clearance.as_ref().map_or(0.0, |found| {
            let ratio = found.closest.as_ref().map_or(f64::INFINITY, |c| c.ratio);
            self.lowest = self.lowest.min(ratio);
            ms(verified.timings.clearance)
        });
        self.clearance.push(clearance);
        let receive = ms(verified.ingest);
        self.receive.push(receive);
        self.frame
            .push(receive + ms(verified.verification) - clearance);
        let work = verified.work;
        self.routes[work.route as usize] += 1;
        self.marked[0] += work.marked;
        self.marked[1] += work.blocks;
        self.events += report.events.len() as u64;
    }
}

/// Returns true if two reports agree on the topology of a frame.
fn same(a: &Report, b: &Report) -> bool {
    (a.verdict, &a.changes) == (b.verdict, &b.changes)
        && (&a.events, &a.defects) == (&b.events, &b.defects)
}

/// Returns a report in a few words.
fn words(report: &Report) -> String {
    let changes = plural(report.changes.len(), "change");
    let defects = plural(report.defects.len(), "defect");
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
        ("marked", 7),
        ("full/quiet/partial %", 21),
        (" verdicts", -1),
    ])
}

fn cells(row: &Row) -> [String; 10] {
    let median = |times: &Vec<f64>| median(times.iter().copied());
    let (read, frame) = (median(&row.read), median(&row.frame));
    let frames = row.frame.len() as f64;
    let share = |n: u64| format!("{:.0}", 100.0 * n as f64 / frames);
    let [marked, blocks] = row.marked.map(|n| n as f64);
    let broken = match row.not_intact {
        0 => String::new(),
        n => format!(" ({} not intact)", count(n)),
    };
    let events = match row.events {
        0 => String::new(),
        n => format!(", {}", plural(n as usize, "pull-through")),
    };
    [
        row.motion.clone(),
        row.amplitude.to_string(),
        format!("{read:.4}"),
        format!("{:.3}", median(&row.full)),
        format!("{:.3}", median(&row.receive)),
        format!("{frame:.3}"),
        format!("{:.2}", frame / read),
        format!("{:.2}%", 100.0 * marked / blocks.max(1.0)),
        row.routes.map(share).join("/"),
        format!(" {}/{}{broken}{events}", row.equal, row.full.len()),
    ]
}

/// Returns the time of the clearance, and its share of a full run.
fn clearance(row: &Row) -> String {
    let [clearance, full] = [&row.clearance, &row.full].map(|t| median(t.iter().copied()));
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
}
