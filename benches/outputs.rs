//! Cost of what happens to a verified frame: recording it, in full and in part, reading it back,
//! writing it for the viewer, and the round trip between a simulator in lockstep and `linkwatch
//! watch`.
//!
//! `cargo bench --bench outputs` measures; with `--smoke` (or under `cargo test`) it runs each step
//! a few times.

#[path = "outputs/handing.rs"]
mod handing;
#[allow(dead_code, reason = "shared with the other benches")]
#[path = "study/src/measure.rs"]
mod measure;

use linkwatch::scenes::Scene;
use linkwatch::{
    Basis, Client, ClientOptions, CurveSet, FrameInfo, FrameRecord, Outcome, Overflow, Positions,
    Precision, RecordedItem, RecordingReader, RecordingSink, RunProgress, Session, SessionOptions,
    Sink, SinkQueue, Verdict, ViewerSink, ViewerTarget,
};
use measure::timed;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime};

const DEADLINE: Duration = Duration::from_secs(20);

fn main() {
    let args: Vec<String> = std::env::args().collect();
    let has = |word: &str| args.iter().any(|a| a == word);
    let measures = has("--bench") && !has("--smoke");
    let (handed, rounds) = if measures { (400, 3) } else { (20, 1) };
    handing::measure(handed, rounds);
    let frames = frames(if measures { 60 } else { 3 });
    let folder = tempfile::tempdir().expect("a folder");
    let recording = folder.path().join("frames.mcap");
    let sink = RecordingSink::create(&recording, &Default::default()).expect("a recording");
    write("recording", Box::new(sink), &frames);
    let bytes = std::fs::metadata(&recording).expect("a recording").len();
    println!("recording: {} bytes a frame", bytes / frames.len() as u64);
    read(&recording, frames.len());
    for (what, every) in [("all curves move", 1), ("1 % of the curves move", 100)] {
        view(
            what,
            &moving(&frames, every),
            &folder.path().join(format!("{every}.rrd")),
        );
    }
    for (curves, segments) in [(2, 4), (100, 10), (100, 20), (400, 50)] {
        round_trips(curves, segments, if measures { 2000 } else { 20 });
    }
}

/// Returns records of a sheet of chainmail.
fn frames(count: u64) -> Vec<FrameRecord> {
    let scene: Scene = "chainmail".parse().expect("a scene");
    let curves = Arc::new(scene.build().expect("a scene").curves);
    let mut session = Session::new(SessionOptions::default()).expect("valid options");
    let record = |seq| {
        let info = FrameInfo::at(seq, seq as f64);
        let report = session.feed(info.clone(), &curves).expect("a frame");
        assert_eq!(report.verdict, Verdict::Intact);
        FrameRecord {
            curves: Some(curves.clone()),
            info,
            report: Arc::new(report),
            progress: RunProgress {
                verified: seq + 1,
                ..RunProgress::default()
            }
            .received(SystemTime::now()),
        }
    };
    (0..count).map(record).collect()
}

fn write(what: &str, mut sink: Box<dyn Sink>, frames: &[FrameRecord]) {
    let start = Instant::now();
    for frame in frames {
        sink.frame(frame).expect("the frame is written");
    }
    let taken = start.elapsed() / frames.len() as u32;
    sink.finish().expect("the file is closed");
    let written = start.elapsed() / frames.len() as u32;
    println!("{what}: taken in {taken:?}, on disk after {written:?}, a frame");
}

/// Returns at most 20 frames in which every n-th ring moves a little.
fn moving(frames: &[FrameRecord], every: usize) -> Vec<FrameRecord> {
    let frames = frames.iter().take(20).zip(0..);
    let moved = frames.map(|(frame, k)| {
        let set = frame.curves.as_deref().expect("curves");
        let shift = |i: usize| {
            if i.is_multiple_of(every) {
                1e-3 * f64::from(k)
            } else {
                0.0
            }
        };
        let points = (0..set.len()).flat_map(|i| {
            let points = (0..set.curve(i).points as usize).map(move |k| set.point(i, k));
            points.flat_map(move |[x, y, z]| [x + shift(i), y, z])
        });
        let points: Vec<f32> = points.map(|x| x as f32).collect();
        let counts: Vec<i32> = set.counts().collect();
        let set = CurveSet::from_counts(set.basis(), &counts, Positions::F32(&points));
        FrameRecord {
            curves: Some(Arc::new(set.expect("curves"))),
            ..frame.clone()
        }
    });
    moved.collect()
}

/// Writes frames for the viewer, and passes them to its thread.
fn view(what: &str, frames: &[FrameRecord], path: &std::path::Path) {
    let written = |frames: &[FrameRecord]| {
        let target = ViewerTarget::File(path.to_owned());
        let mut sink = Box::new(ViewerSink::open(&target, what).expect("a file for the viewer"));
        let (_, cpu) = timed(|| {
            frames
                .iter()
                .for_each(|f| sink.frame(f).expect("it is written"))
        });
        sink.finish().expect("the file is closed");
        (std::fs::metadata(path).expect("the file").len(), cpu.cpu_ms)
    };
    // The first frames have all curves.
    let [(some, some_ms), (all, all_ms)] = [&frames[..2], frames].map(written);
    let count = frames.len() as u64 - 2;
    println!(
        "viewer, {what}: {} bytes and {:.2} ms of CPU time a frame",
        (all - some) / count,
        (all_ms - some_ms) / count as f64
    );
    // Cost in the thread of the verification.
    let target = ViewerTarget::File(path.with_extension("queue.rrd"));
    let patience = Overflow::WaitForProgress(DEADLINE);
    let queue = SinkQueue::spawn("viewer", frames.len(), patience, move || {
        Ok(Box::new(ViewerSink::open(&target, "frames")?))
    })
    .expect("a thread");
    let frames: Vec<_> = frames.iter().cloned().map(Arc::new).collect();
    let start = Instant::now();
    frames
        .iter()
        .for_each(|frame| queue.frame(Arc::clone(frame)));
    let taken = start.elapsed() / frames.len() as u32;
    println!("viewer, {what}: passed to its thread in {taken:?} a frame");
    assert_eq!(queue.finish(DEADLINE).dropped, 0);
}

fn read(recording: &std::path::Path, frames: usize) {
    let start = Instant::now();
    let mut reader = RecordingReader::open(recording).expect("a recording");
    let mut set: Option<CurveSet> = None;
    let mut found = 0;
    while let Some(item) = reader.next_item().expect("an item") {
        if let RecordedItem::Frame(frame) = item {
            frame.ingest(&mut set).expect("curves");
            found += 1;
        }
    }
    assert_eq!(found, frames);
    let taken = start.elapsed() / frames as u32;
    println!("recording: read back in {taken:?} a frame");
}

/// Measures the time from a frame of separate rings to its verdict, with `linkwatch watch` as a
/// process.
fn round_trips(curves: usize, segments: i32, count: usize) {
    let service = format!("bench-{}-{curves}-{segments}", std::process::id());
    let mut watch = Command::new(env!("CARGO_BIN_EXE_linkwatch"))
        .args(["watch", "--quiet", "--service", &service])
        .stdout(Stdio::null())
        .spawn()
        .expect("the command starts");
    let mut client = Client::open(&service, &ClientOptions::lockstep()).expect("a client");
    let counts = vec![-segments; curves];
    let described = client.describe(Basis::Polyline, Precision::F32, &counts);
    described.expect("valid curves");
    assert!(client.wait_for_watcher(DEADLINE).expect("the bus"));
    let points = (0..curves).flat_map(|i| {
        (0..segments).flat_map(move |k| {
            let t = std::f32::consts::TAU * k as f32 / segments as f32;
            [3.0 * i as f32 + t.cos(), t.sin(), 0.1 * (2.0 * t).sin()]
        })
    });
    let points: Vec<f32> = points.collect();
    let trip = |frame| {
        let start = Instant::now();
        let seq = client.publish(frame as f64, Positions::F32(&points));
        let outcome = client.wait(seq.expect("the bus"), DEADLINE);
        let Outcome::Verdict(message) = outcome.expect("the bus") else {
            panic!("no verdict on frame {frame}");
        };
        assert_eq!(message.verdict, Verdict::Intact);
        start.elapsed()
    };
    let mut trips: Vec<Duration> = (0..count).map(trip).collect();
    trips.sort();
    let [median, slow] = [trips[count / 2], trips[count * 19 / 20]];
    println!(
        "round trip of {curves} curves of {segments} segments: {median:?}, {slow:?} for one in 20"
    );
    client.finish().expect("the bus");
    assert!(watch.wait().expect("it ends").success());
}
