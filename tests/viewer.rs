//! The viewer sink on a small chainmail of which two rings come apart, and on pull-throughs that no
//! linking number detects.
//!
//! To look at them: `LINKWATCH_RRD=. cargo test --features rerun --test viewer`, then `rerun
//! mail.rrd`; `chain.rrd` has 30 rings and a break, `pairs.rrd` 40 rings and 20 breaks. For a
//! picture: `rerun chain.rrd --screenshot-to chain.png --window-size 1600x1000`. To look at a scene
//! live: start `rerun`, then `LINKWATCH_VIEW=localhost cargo test --features rerun --test viewer
//! twenty`.

mod support;

use linkwatch::{
    BaselineRecord, Basis, Certificate, Change, CurveSet, Defect, DefectKind, Events, FrameInfo,
    FrameRecord, FrameTimes, Link, LiveTimes, Overflow, Place, Positions, PullThrough, Report,
    Route, RunProgress, Session, SessionOptions, Sink, SinkQueue, Timings, Verdict, VerifiedFrame,
    ViewerSink, ViewerTarget, Work,
};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;
use support::session::Step;

const SIDE: usize = 12;
const POINTS: usize = 24;
const FRAMES: u64 = 30;
/// Index of the ring that is pulled out, and of the two neighbours that it leaves.
const PULLED: u32 = 78;
const LEFT: [u32; 2] = [66, 90];

/// Rings of the European 4-in-1 weave, moving in waves; from frame 15 on one of them is pulled
/// upwards.
fn mail(frame: u64, side: usize, points: usize) -> CurveSet {
    let t = frame as f32 / 30.0;
    let mut xyz = Vec::new();
    for ring in 0..side * side {
        let (row, column) = (ring / side, ring % side);
        let odd = (row % 2) as f32;
        let (x, y) = (1.45 * (column as f32 + 0.5 * odd), 0.78 * row as f32);
        let mut z = 0.5 * (0.4 * x + 3.0 * t).sin() + 0.35 * (0.5 * y - 2.0 * t).cos();
        if ring == PULLED as usize {
            z += 0.13 * frame.saturating_sub(14) as f32;
        }
        let (sin, cos) = (0.62 - 1.24 * odd).sin_cos();
        for k in 0..points {
            let (v, u) = (std::f32::consts::TAU * k as f32 / points as f32).sin_cos();
            xyz.extend([x + u, y + v * cos, z + v * sin]);
        }
    }
    let counts = vec![-(points as i32); side * side];
    CurveSet::from_counts(Basis::Polyline, &counts, Positions::F32(&xyz)).unwrap()
}

fn center(set: &CurveSet, i: u32) -> [f64; 3] {
    let n = set.curve(i as usize).points as usize;
    let mut sum = [0.0; 3];
    for k in 0..n {
        let p = set.point(i as usize, k);
        (0..3).for_each(|x| sum[x] += p[x] / n as f64);
    }
    sum
}

fn place(set: &CurveSet, i: u32, j: u32) -> Place {
    let (a, b) = (center(set, i), center(set, j));
    Place {
        segments: [3, 15],
        point: [0, 1, 2].map(|x| 0.5 * (a[x] + b[x])),
        distance: 0.0213,
    }
}

fn pair(j: u32) -> (u32, u32) {
    (j.min(PULLED), j.max(PULLED))
}

/// Report of a session: contact in frame 17, a link lost in 18, another in 24, each by a
/// pull-through.
fn report(seq: u64, set: &CurveSet) -> Report {
    let lost = [18, 24].iter().filter(|&&f| seq >= f).count();
    let change = |&j: &u32| {
        let (i, j) = pair(j);
        Change {
            i,
            j,
            image: Default::default(),
            expected: 1,
            found: 0,
            place: Some(place(set, i, j)),
        }
    };
    let mut changes: Vec<Change> = LEFT[..lost].iter().map(change).collect();
    changes.sort_by_key(|c| (c.i, c.j));
    let pulled = |&j: &u32| {
        let (i, j) = pair(j);
        PullThrough {
            i,
            j,
            image: Default::default(),
            segments: [3, 15],
            fraction: 0.25,
            sign: -1,
            point: place(set, i, j).point,
            lengths: 0.5,
        }
    };
    let events = match seq {
        18 => LEFT[..1].iter().map(pulled).collect(),
        24 => LEFT[1..].iter().map(pulled).collect(),
        _ => Vec::new(),
    };
    let (i, j) = pair(LEFT[0]);
    let contact = Defect {
        i,
        j: Some(j),
        image: Default::default(),
        kind: DefectKind::Contact,
        place: place(set, i, j),
    };
    let defects = if seq == 17 { vec![contact] } else { Vec::new() };
    let verdict = match (changes.is_empty(), defects.is_empty()) {
        (false, _) => Verdict::Changed,
        (true, false) => Verdict::Contact,
        (true, true) => Verdict::Intact,
    };
    let mut report = Report::new(seq, seq as f64 / 60.0, verdict);
    report.abort = verdict != Verdict::Intact;
    (report.changes, report.defects, report.events) = (changes, defects, events);
    report.stats.curves = set.len() as u64;
    report.stats.segments = set.segments() as u64;
    report.stats.potential_links = 742;
    report
}

fn record(seq: u64, set: CurveSet) -> Arc<FrameRecord> {
    let report = report(seq, &set);
    Arc::new(verified(Arc::new(set), report, work(seq)))
}

fn verified(set: Arc<CurveSet>, report: Report, work: Work) -> FrameRecord {
    let seq = report.seq;
    FrameRecord {
        curves: Some(set),
        info: FrameInfo::default(),
        report: Arc::new(report),
        progress: RunProgress {
            verified: seq,
            skipped: seq / 10,
            times: FrameTimes {
                ingest: Duration::from_micros(400 + 50 * (seq * 3 % 7)),
                verification: Duration::from_micros(1400 + 300 * (seq * 7 % 5)),
                stages: Timings::default(),
                live: (seq > 0).then(|| LiveTimes {
                    interval: Duration::from_millis(16),
                    wait: Duration::from_micros(14_000 - 300 * (seq * 7 % 5)),
                    send: Duration::from_micros(8),
                }),
            },
            work,
            received_ns: 16_000_000 * seq,
            ..RunProgress::default()
        },
    }
}

/// Quiet at first, then partial, then full.
fn work(seq: u64) -> Work {
    let (route, marked, recomputed) = match seq {
        0..5 => (Route::Quiet, 0, 0),
        5..16 => (Route::Partial, 3 * seq, seq / 2),
        _ => (Route::Full, 20 * seq, 742),
    };
    let mut work = Work::default();
    (work.route, work.blocks) = (route, 432);
    (work.marked, work.recomputed) = (marked.min(432), recomputed);
    work
}

fn baseline() -> Arc<BaselineRecord> {
    let link = |&j: &u32| {
        let (i, j) = pair(j);
        Link { i, j, lambda: 1 }
    };
    let mut links: Vec<Link> = LEFT.iter().map(link).collect();
    links.sort();
    let certificate = Certificate::new(SIDE * SIDE, links, Vec::new());
    Arc::new(BaselineRecord {
        certificate: Arc::new(certificate),
        origin: "first frame".into(),
        frame: Some(0),
        unverified: 0,
    })
}

/// Path of a file: in the folder of the user, if one is given, or else in a temporary one.
fn file(name: &str, removed: &Path) -> PathBuf {
    let kept = std::env::var_os("LINKWATCH_RRD").map(PathBuf::from);
    kept.unwrap_or_else(|| removed.into()).join(name)
}

#[test]
fn writes_a_file_of_a_broken_run() {
    let folder = tempfile::tempdir().unwrap();
    let path = file("mail.rrd", folder.path());
    let target = ViewerTarget::File(path.clone());
    let patience = Overflow::Wait(Duration::from_secs(60));
    let queue = SinkQueue::spawn("viewer", 4, patience, move || {
        Ok(Box::new(ViewerSink::open(&target, "chainmail")?))
    })
    .unwrap();
    queue.begin(baseline());
    for seq in 1..=FRAMES {
        queue.frame(record(seq, mail(seq, SIDE, POINTS)));
    }
    let summary = queue.finish(Duration::from_secs(30));
    assert_eq!((summary.written, summary.dropped), (FRAMES, 0));
    assert_eq!(summary.failed, None);
    // Every frame has the positions of all rings; the file is compressed slightly.
    let least = FRAMES * (SIDE * SIDE * POINTS * 12) as u64 / 2;
    assert!(std::fs::metadata(&path).unwrap().len() > least);
}

/// Two rings, one above the other, and a figure eight beside them. In frame 4 the upper ring has
/// passed through the lower one: two pull-throughs that cancel. In frame 8 one strand of the eight
/// has passed through the other.
fn crossings(frame: u64) -> CurveSet {
    let t = frame as f32;
    let ring = |_: f32, v: f32, u: f32| [2.0 * u, v, 0.05 * u];
    let sinking = |t: f32, v: f32, u: f32| [u + 0.3, 2.0 * v + 1.7, 0.9 - 0.26 * t - 0.01 * v];
    let eight = |t: f32, v: f32, u: f32| {
        let height = 0.1 * (7.4 - t) * u + 0.3 * v * v * v;
        [4.5 + 2.0 * v * u, 1.7 * v, height]
    };
    let shapes: [&dyn Fn(f32, f32, f32) -> [f32; 3]; 3] = [&ring, &sinking, &eight];
    let mut xyz = Vec::new();
    for shape in shapes {
        for k in 0..POINTS {
            let (v, u) = (std::f32::consts::TAU * (k as f32 + 0.3) / POINTS as f32).sin_cos();
            xyz.extend(shape(t, v, u));
        }
    }
    let counts = [-(POINTS as i32); 3];
    CurveSet::from_counts(Basis::Polyline, &counts, Positions::F32(&xyz)).unwrap()
}

#[test]
fn shows_pull_throughs_that_linking_numbers_do_not_detect() {
    let folder = tempfile::tempdir().unwrap();
    let path = file("crossings.rrd", folder.path());
    let target = ViewerTarget::File(path.clone());
    let mut sink = Box::new(ViewerSink::open(&target, "crossings").unwrap());
    let mut session = Session::new(SessionOptions {
        events: Events::All,
        ..SessionOptions::default()
    })
    .unwrap();
    for seq in 1..=8 {
        let set = Arc::new(crossings(seq));
        let VerifiedFrame { report, work, .. } =
            session.step_at(FrameInfo::at(seq, seq as f64), &set);
        let reported: Vec<_> = report.events.iter().map(|e| (e.i, e.j)).collect();
        let expected: &[(u32, u32)] = match seq {
            4 => &[(0, 1), (0, 1)],
            8 => &[(2, 2)],
            _ => &[],
        };
        assert_eq!((reported.as_slice(), &report.changes), (expected, &vec![]));
        let record = verified(set, report, work);
        sink.frame(&record).unwrap();
    }
    sink.finish().unwrap();
    assert!(std::fs::metadata(&path).unwrap().len() > 1000);
}

/// A ring of radius 1 around `center`, in the plane of `u` and `v`.
fn ring(center: [f32; 3], u: [f32; 3], v: [f32; 3]) -> impl Iterator<Item = f32> {
    (0..POINTS).flat_map(move |k| {
        let angle = std::f32::consts::TAU * (k as f32 + 0.3) / POINTS as f32;
        let (sin, cos) = angle.sin_cos();
        [0, 1, 2].map(|x| center[x] + cos * u[x] + sin * v[x])
    })
}

const UP: [f32; 3] = [0.0, 0.0, 1.0];

/// A chain of 30 rings along an arc. From frame 5 on its second half moves on, and the links
/// between rings 14 and 15 part.
fn chain(frame: u64) -> Vec<f32> {
    let moved = 0.15 * frame.saturating_sub(4) as f32;
    let shape = |k: usize| {
        let along = 1.3 * k as f32 + if k < 15 { 0.0 } else { moved };
        let (sin, cos) = (along / 7.5).sin_cos();
        let (center, tangent) = ([7.5 * cos, 7.5 * sin, 0.0], [-sin, cos, 0.0]);
        let side = [[cos, sin, 0.0], UP][k % 2];
        ring(center, tangent, side)
    };
    (0..30).flat_map(shape).collect()
}

/// 20 pairs of linked rings. Ring 2 p + 1 is drawn out of ring 2 p, each pair later than another.
fn pairs(frame: u64) -> Vec<f32> {
    let shape = |k: usize| {
        let pair = k / 2;
        let start = 2 + 7 * pair as u64 % 20;
        let (sin, cos) = (0.9 * pair as f32).sin_cos();
        let along = match k % 2 {
            0 => 0.0,
            _ => 1.1 + 0.17 * frame.saturating_sub(start).min(11) as f32,
        };
        let corner = [7.0 * (pair % 5) as f32, 7.0 * (pair / 5) as f32];
        let center = [corner[0] + along * cos, corner[1] + along * sin, 0.0];
        let side = [[-sin, cos, 0.0], UP][k % 2];
        ring(center, [cos, sin, 0.0], side)
    };
    (0..40).flat_map(shape).collect()
}

/// Verifies the frames of a motion and shows them. Returns the frame of each lost link.
fn show(name: &str, unit: f32, frames: u64, motion: fn(u64) -> Vec<f32>) -> Vec<u64> {
    let folder = tempfile::tempdir().unwrap();
    let path = file(&format!("{name}.rrd"), folder.path());
    let live = std::env::var("LINKWATCH_VIEW").ok();
    let target = match &live {
        Some(address) => ViewerTarget::Connect(address.clone()),
        None => ViewerTarget::File(path.clone()),
    };
    let mut sink = Box::new(ViewerSink::open(&target, name).unwrap());
    let mut session = Session::new(SessionOptions {
        events: Events::All,
        ..SessionOptions::default()
    })
    .unwrap();
    let mut lost = Vec::new();
    for seq in 0..frames {
        let xyz: Vec<f32> = motion(seq).iter().map(|x| x * unit).collect();
        let counts = vec![-(POINTS as i32); xyz.len() / 3 / POINTS];
        let set = CurveSet::from_counts(Basis::Polyline, &counts, Positions::F32(&xyz)).unwrap();
        let set = Arc::new(set);
        let VerifiedFrame { report, work, .. } =
            session.step_at(FrameInfo::at(seq, seq as f64 / 60.0), &set);
        lost.resize(report.changes.len(), seq);
        sink.frame(&verified(set, report, work)).unwrap();
    }
    sink.finish().unwrap();
    assert!(live.is_some() || std::fs::metadata(&path).unwrap().len() > 1000);
    lost
}

#[test]
fn a_chain_that_breaks_once_is_shown() {
    assert_eq!(show("chain", 1.0, 24, chain), [9]);
}

#[test]
fn twenty_breaks_are_shown() {
    let expected: Vec<u64> = (8..28).collect();
    assert_eq!(show("pairs", 1.0, 44, pairs), expected);
}

#[test]
fn tiny_and_large_scenes_are_shown() {
    for (name, unit) in [("tiny", 1e-9), ("large", 1e6)] {
        assert_eq!(show(name, unit, 24, chain), [9], "{name}");
    }
}

#[test]
fn logs_frames_without_curves() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("rejected.rrd");
    let target = ViewerTarget::File(path.clone());
    let mut sink = Box::new(ViewerSink::open(&target, "rejected").unwrap());
    let mut first = FrameRecord::clone(&record(1, mail(1, SIDE, 8)));
    let mut report = Report::clone(&first.report);
    report.verdict = Verdict::Rejected;
    report.rejected = Some("curve 3, point 2: coordinate y is NaN".into());
    report.time = f64::NAN;
    (first.curves, first.report) = (None, Arc::new(report));
    sink.frame(&first).unwrap();
    sink.flush().unwrap();
    sink.finish().unwrap();
    assert!(std::fs::metadata(&path).unwrap().len() > 1000);
}

#[test]
fn a_viewer_that_never_answers_delays_no_caller() {
    // The system accepts connections for a listener that does not accept them; nothing is ever
    // read.
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let target = ViewerTarget::Connect(address);
    let queue = SinkQueue::spawn("viewer", 2, Overflow::DropOldest, move || {
        Ok(Box::new(ViewerSink::open(&target, "deaf")?))
    })
    .unwrap();
    queue.open(Duration::from_secs(60)).unwrap();
    for seq in 1..=FRAMES {
        queue.frame(record(seq, mail(seq, SIDE, POINTS)));
    }
    let summary = queue.finish(Duration::from_millis(500));
    assert!(summary.failed.is_some(), "{summary:?}");
}
