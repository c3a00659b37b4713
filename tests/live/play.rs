//! `linkwatch play`: recorded frames on the bus.

use super::keep::record;
use super::written::Chainmail;
use super::*;
use linkwatch::{
    CurveSet, Events, FrameInfo, FrameRecord, RecordedItem, RecordedVerdict, RecordingReader,
    RecordingSink, Sink,
};
use std::sync::Arc;

/// Publishes a recording as fast as a watch answers. Returns the results of both.
fn publish(name: &str, recording: &Path, args: &[&str], watch: &[&str]) -> [Ended; 2] {
    let folder = TempDir::new().unwrap();
    let service = service(name);
    let watch = Watch::start(folder.path(), "watch", &service, watch);
    let always = ["--service", &service, "--speed", "max", "--lockstep"];
    let published = run_with("play", recording, &[&always[..], args].concat());
    [published, watch.end()]
}

fn items(recording: &Path) -> Vec<RecordedItem> {
    let mut reader = RecordingReader::open(recording).unwrap();
    let next = || reader.next_item().unwrap();
    std::iter::from_fn(next).collect()
}

#[test]
fn a_watch_of_a_published_recording_gives_the_recorded_verdicts() {
    let flight = recordings().join("flight.mcap");
    let watch = ["--events", "--abort-on", "event", "--motion-limit", "10"];
    let [published, watch] = publish("again", &flight, &[], &watch);
    assert_eq!(
        (published.code, watch.code),
        (Some(1), Some(1)),
        "{}",
        published.stderr
    );
    assert_eq!(watch.reports(), replay(&flight).reports());
    let summary = published.summary();
    assert_eq!(summary["published"], 5);
    assert_eq!(summary["watcher"]["verified"], 5);
    assert_eq!(summary["aborts"], 1);
    assert!(
        published.stderr.contains("frame 3: the watcher asks"),
        "{}",
        published.stderr
    );
    assert!(
        watch.stderr.contains("the simulator ended after 5 frames"),
        "{}",
        watch.stderr
    );
}

#[test]
fn published_frames_keep_their_numbers_and_rejected_ones_are_left_out() {
    let squares = recordings().join("squares.mcap");
    let [published, watch] = publish("numbers", &squares, &["--from", "12", "--to", "17"], &[]);
    let seqs: Vec<_> = watch
        .reports()
        .iter()
        .map(|r| r["seq"].as_u64().unwrap())
        .collect();
    assert_eq!(seqs, [12, 13, 14, 16, 17]);
    let summary = published.summary();
    let counts = ["published", "rejected", "numbers_between"].map(|n| summary[n].as_u64());
    assert_eq!(counts, [Some(5), Some(1), Some(1)]);
}

#[test]
fn publishing_stops_on_an_abort_if_that_is_requested() {
    let squares = recordings().join("squares.mcap");
    let [published, watch] = publish("abort", &squares, &["--stop-on-abort"], &[]);
    assert_eq!(published.code, Some(3), "{}", published.stderr);
    assert_eq!(published.summary()["published"], 11);
    assert_eq!(watch.reports().len(), 11);
    let words = "stopped, because the watcher asked for it";
    assert!(published.stderr.contains(words), "{}", published.stderr);
    // The watch saw a proper end.
    assert!(
        watch.stderr.contains("the simulator ended after 11 frames"),
        "{}",
        watch.stderr
    );
}

/// Writes a recording again, with a rollback before frame 2 and a change of the curves before
/// frame 4.
fn with_cut_and_change(from: &Path, to: &Path) {
    let mut sink = Box::new(RecordingSink::create(to, &Default::default()).unwrap());
    let (mut curves, mut set, mut info) = (None, None, FrameInfo::default());
    for item in items(from) {
        match item {
            RecordedItem::Baseline(baseline) => sink.begin(&baseline).unwrap(),
            RecordedItem::Frame(frame) => {
                frame.ingest(&mut set).unwrap();
                curves = set.clone().map(Arc::new);
                info = frame.info.clone();
                info.cuts = 5 + u32::from(frame.seq >= 2);
                if frame.seq >= 4 {
                    let mut labels = (*info.labels).clone();
                    labels.names.swap(0, 1);
                    (info.layout, info.labels) = (1, Arc::new(labels));
                }
            }
            RecordedItem::Verdict(recorded) => {
                let RecordedVerdict { report, progress } = *recorded;
                let record = FrameRecord {
                    curves: curves.take(),
                    info: info.clone(),
                    report: Arc::new(report),
                    progress,
                };
                sink.frame(&record).unwrap();
            }
        }
    }
    sink.finish().unwrap();
}

#[test]
fn names_time_steps_cuts_and_changes_of_curves_are_published() {
    let folder = TempDir::new().unwrap();
    let at = |name: &str| folder.path().join(name);
    let scene = "chainmail:rows=2,columns=3".to_owned();
    let run = Chainmail {
        scene,
        frames: 6,
        pulled: u64::MAX,
        released: u64::MAX,
    };
    run.record(&at("plain.mcap"), Events::Off, true);
    with_cut_and_change(&at("plain.mcap"), &at("run.mcap"));
    let again = at("again.mcap");
    let record = ["--record", again.to_str().unwrap()];
    let [published, watch] = publish("labels", &at("run.mcap"), &[], &record);
    assert_eq!(watch.code, published.code, "{}", watch.stderr);
    let infos = |path: &Path| -> Vec<FrameInfo> {
        let frames = items(path).into_iter().filter_map(|item| match item {
            RecordedItem::Frame(frame) => Some(frame.info),
            _ => None,
        });
        frames.collect()
    };
    let (before, after) = (infos(&at("run.mcap")), infos(&again));
    assert_eq!(before.len(), 6);
    for (k, [before, after]) in before.iter().zip(&after).map(|(a, b)| [a, b]).enumerate() {
        assert_eq!(after.labels, before.labels, "frame {k}");
        assert_eq!(after.time_step, before.time_step);
        assert_eq!(after.cuts, before.cuts - 5);
        assert_eq!(after.layout, 1 + before.layout);
    }
    assert_eq!(after.len(), 6);
}

/// Regression test: a pull-through was found on the straight path over skipped frames.
#[test]
fn frames_around_a_gap_of_a_recording_are_not_joined() {
    let folder = TempDir::new().unwrap();
    let frames = around_an_end().into_iter();
    let live = record(folder.path(), "thinned", (",every=3", &[]), &[2, 2], frames);
    assert_eq!(live.code, Some(0), "{}", live.stderr);
    let again = folder.path().join("again.mcap");
    let args = ["--record", again.to_str().unwrap()];
    let [published, watch] = publish("joined", &folder.path().join("run.mcap"), &[], &args);
    assert_eq!(published.code, Some(3), "{}", published.stderr);
    assert_eq!(published.summary()["gaps"], 1);
    assert_eq!(watch.reports().len(), 2);
    let cuts = items(&again).into_iter().filter_map(|item| match item {
        RecordedItem::Frame(frame) => Some(frame.info.cuts),
        _ => None,
    });
    assert_eq!(cuts.collect::<Vec<_>>(), [0, 1]);
}

#[test]
fn publishing_waits_for_a_watcher_and_gives_up_after_the_limit() {
    let flight = recordings().join("flight.mcap");
    let service = service("nobody");
    let args = ["--service", &service, "--wait", "0.2"];
    let published = run_with("play", &flight, &args);
    assert_eq!(published.code, Some(3));
    let words = "no watcher connected within the limit of --wait";
    assert!(published.stderr.contains(words), "{}", published.stderr);
}

#[test]
fn a_signal_ends_publishing_with_a_proper_end_of_the_session() {
    let folder = TempDir::new().unwrap();
    let service = service("signal");
    let watch = Watch::start(folder.path(), "watch", &service, &[]);
    let stderr = folder.path().join("publish.err");
    let mut publishing = command()
        .args(["play", "--service", &service, "--speed", "0.0001"])
        .arg(recordings().join("chainmail.mcap"))
        .stdout(Stdio::null())
        .stderr(std::fs::File::create(&stderr).unwrap())
        .spawn()
        .unwrap();
    lines_of(&watch, 1);
    let pid = publishing.id().to_string();
    assert!(
        Command::new("kill")
            .args(["-s", "INT", &pid])
            .status()
            .unwrap()
            .success()
    );
    assert_eq!(wait(&mut publishing).code(), Some(3));
    let ended = watch.end();
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    assert!(
        ended.stderr.contains("the simulator ended after 1 frame"),
        "{}",
        ended.stderr
    );
    let stderr = std::fs::read_to_string(stderr).unwrap();
    assert!(stderr.contains("stopped by a signal"), "{stderr}");
}

#[test]
fn a_converted_model_is_published_as_one_frame() {
    let folder = TempDir::new().unwrap();
    let model = folder.path().join("mail.bcc");
    let scene = [
        "generate",
        "chainmail:rows=2,columns=2",
        "-o",
        model.to_str().unwrap(),
    ];
    assert_eq!(printed(&scene).0, Some(0));
    let recording = folder.path().join("mail.mcap");
    let [model, to] = [&model, &recording].map(|path| path.to_str().unwrap());
    assert_eq!(printed(&["convert", model, to]).0, Some(0));
    let [published, watch] = publish("model", &recording, &[], &[]);
    assert_eq!(
        (published.code, watch.code),
        (Some(0), Some(0)),
        "{}",
        published.stderr
    );
    assert_eq!(watch.reports().len(), 1);
    assert_eq!(published.summary()["published"], 1);
}

/// Regression test: the watcher counted skipped frames, and rejected sequence numbers that were far
/// apart.
#[test]
fn converted_frames_are_numbered_from_0() {
    let folder = TempDir::new().unwrap();
    let recording = folder.path().join("steps.mcap");
    let mut sink = Box::new(RecordingSink::create(&recording, &Default::default()).unwrap());
    let positions = squares(0.0);
    let set = CurveSet::from_counts(Basis::Polyline, &[-4, -4], Positions::F32(&positions));
    let set = set.unwrap();
    for step in 1..=4 {
        let info = FrameInfo::at(1_000_000 * step, step as f64);
        sink.curves(&set, &info).unwrap();
    }
    sink.finish().unwrap();
    let [published, watch] = publish("steps", &recording, &["--from", "2000000"], &[]);
    let codes = (published.code, watch.code);
    assert_eq!(codes, (Some(0), Some(0)), "{}", watch.stderr);
    let frames = watch.reports();
    let times: Vec<_> = frames
        .iter()
        .map(|r| (r["seq"].as_u64(), r["time"].as_f64()))
        .collect();
    let expected = [(0, 2.0), (1, 3.0), (2, 4.0)].map(|(seq, time)| (Some(seq), Some(time)));
    assert_eq!(times, expected);
    let summary = watch.summary();
    let counts = ["verified", "skipped", "rejected"].map(|n| summary[n].as_u64());
    assert_eq!(counts, [Some(3), Some(0), Some(0)]);
    assert_eq!(published.summary()["numbers_between"], 0);
}
