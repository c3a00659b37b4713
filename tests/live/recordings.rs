//! Recordings of live runs, and `linkwatch replay`.

use super::support::command::Run;
use super::*;
use linkwatch::{
    FrameInfo, FrameRecord, RecordedItem, RecordingReader, RecordingSink, Report, Sink,
};
use std::sync::Arc;

/// Recordings of earlier versions stay readable, and their verdicts do not change. The script
/// `recordings/regenerate` writes them again.
#[test]
fn recordings_of_earlier_versions_give_the_same_verdicts() {
    let files = std::fs::read_dir(recordings()).unwrap().map(|e| e.unwrap());
    let files: Vec<_> = files.collect();
    let bytes: u64 = files.iter().map(|e| e.metadata().unwrap().len()).sum();
    assert!(bytes < 5_000_000, "{bytes} bytes of recordings");
    let kept = files.iter().map(|e| e.path());
    let kept: Vec<PathBuf> = kept
        .filter(|p| p.extension().is_some_and(|e| e == "mcap"))
        .collect();
    assert!(!kept.is_empty());
    for recording in kept {
        let expected = std::fs::read_to_string(recording.with_extension("jsonl")).unwrap();
        let replayed = replay(&recording);
        let expected = json_lines(&expected);
        // The work for a verdict may differ between versions.
        let said = |report: &serde_json::Value| {
            let mut report = report.clone();
            report["stats"].take();
            // Recordings of earlier versions lack these fields.
            for list in ["events", "unresolved", "adopted"] {
                if report[list].is_null() {
                    report[list] = serde_json::json!([]);
                }
            }
            report["last_intact"].take();
            report["safe_fraction"].take();
            for event in report["events"].as_array_mut().unwrap() {
                event["lengths"].take();
            }
            for list in ["changes", "events", "unresolved", "defects"] {
                for finding in report[list].as_array_mut().unwrap() {
                    finding["image"].take();
                }
            }
            report
        };
        assert_eq!(
            replayed.reports().into_iter().map(said).collect::<Vec<_>>(),
            expected.iter().map(said).collect::<Vec<_>>(),
            "{recording:?}"
        );
        replayed.assert_recorded_verdicts();
    }
}

/// Writes the recording of the flight again, with other reports. A frame whose report is dropped
/// leaves a gap.
pub fn rewrite_flight(to: &Path, mut keep: impl FnMut(&mut Report) -> bool) {
    let mut reader = RecordingReader::open(&recordings().join("flight.mcap")).unwrap();
    let (mut sink, mut curves, mut set) = (None, None, None);
    while let Some(item) = reader.next_item().unwrap() {
        let create = || RecordingSink::create(to, reader.metadata()).unwrap();
        let sink = sink.get_or_insert_with(|| Box::new(create()));
        match item {
            RecordedItem::Baseline(baseline) => sink.begin(&baseline).unwrap(),
            RecordedItem::Frame(frame) => {
                frame.ingest(&mut set).unwrap();
                curves = set.clone().map(Arc::new);
            }
            RecordedItem::Verdict(mut verdict) => {
                if !keep(&mut verdict.report) {
                    continue;
                }
                let record = FrameRecord {
                    curves: curves.take(),
                    info: FrameInfo::default(),
                    report: Arc::new(verdict.report),
                    progress: verdict.progress,
                };
                sink.frame(&record).unwrap();
            }
        }
    }
    sink.unwrap().finish().unwrap();
}

/// A recorder with a slow disk drops frames. The motion to the frame after such a gap differs from
/// that of the live run.
#[test]
fn counts_frames_that_were_not_recorded_without_an_error() {
    let folder = TempDir::new().unwrap();
    let gappy = folder.path().join("gappy.mcap");
    rewrite_flight(&gappy, |report| report.seq != 2);
    let replayed = replay(&gappy);
    assert_eq!(replayed.code, Some(1), "{}", replayed.stderr);
    assert_eq!(replayed.reports().len(), 4);
    assert!(
        replayed.stderr.contains("1 frame missing"),
        "{}",
        replayed.stderr
    );
    let compared = &replayed.summary()["recorded_verdicts"];
    assert_eq!(
        (&compared["equal"], &compared["after_missing"]),
        (&3.into(), &1.into())
    );
    replayed.assert_recorded_verdicts();
}

#[test]
fn rejects_hostile_recordings_in_one_line() {
    let folder = TempDir::new().unwrap();
    for (name, bytes) in [
        ("empty.mcap", &b""[..]),
        ("text.mcap", b"hello"),
        ("magic.mcap", b"\x89MCAP0\r\n\xff\xff"),
    ] {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        let Ended { code, stderr, .. } = replay(&path);
        assert!(matches!(code, Some(2 | 3)), "{name}: {stderr}");
        assert!(stderr.contains(name), "{stderr}");
        assert!(!stderr.contains("panicked"), "{stderr}");
    }
}

/// Options that differ from the defaults are part of the recording, so that a replay without
/// options gives the same verdicts.
#[test]
fn a_replay_keeps_the_policy_of_the_recording() {
    let folder = TempDir::new().unwrap();
    let service = service("policy");
    let recording = folder.path().join("run.mcap");
    let args = [
        "--abort-on",
        "never",
        "--record",
        recording.to_str().unwrap(),
    ];
    let watch = Watch::start(folder.path(), "watch", &service, &args);
    let mut sim = client(&service);
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    // Two broken frames come before the first good one.
    for (frame, shift) in [f32::NAN, f32::NAN, 0.0, 2.5].into_iter().enumerate() {
        step(&mut sim, frame as u64, shift);
    }
    assert!(sim.aborted().is_none());
    sim.finish().unwrap();
    let live = watch.end();
    assert_eq!(live.code, Some(1), "{}", live.stderr);
    let replayed = replay(&recording);
    assert_eq!(replayed.code, Some(1), "{}", replayed.stderr);
    assert_eq!(replayed.reports(), live.reports());
    replayed.assert_recorded_verdicts();
    assert_eq!(replayed.summary()["rejected"], 2);
}

/// Regression test: each of these commands lost part of the recording, or replaced its content.
#[test]
fn a_replay_overwrites_neither_its_input_nor_an_existing_file() {
    let folder = TempDir::new().unwrap();
    let at = |name: &str| folder.path().join(name);
    let recording = recordings().join("squares.mcap");
    let before = std::fs::read(&recording).unwrap();
    std::fs::write(at("run.mcap"), &before).unwrap();
    #[cfg(unix)]
    for soft in ["soft.rrd", "soft.mcap"] {
        std::os::unix::fs::symlink(at("run.mcap"), at(soft)).unwrap();
    }
    std::fs::write(at("other.mcap"), "mine").unwrap();
    let refused = |args: &[&str], says: &str| {
        let run: Run = command()
            .current_dir(folder.path())
            .args(["replay", "run.mcap"])
            .args(args)
            .output()
            .unwrap()
            .into();
        assert_eq!(run.code, 2, "{args:?}: {}", run.stderr);
        assert!(run.stderr.contains(says), "{args:?}: {}", run.stderr);
        assert!(std::fs::read(at("run.mcap")).unwrap() == before, "{args:?}");
        assert_eq!(std::fs::read(at("other.mcap")).unwrap(), b"mine");
    };
    for force in [&[][..], &["--force"]] {
        let with = |args: &[&'static str]| [args, force].concat();
        refused(
            &with(&["--record", "run.mcap"]),
            "same file as the input run.mcap",
        );
        if cfg!(unix) {
            refused(
                &with(&["--record", "./soft.mcap"]),
                "same file as the input run.mcap",
            );
            refused(
                &with(&["--show", "soft.rrd"]),
                "same file as the input run.mcap",
            );
        }
        refused(
            &with(&["--show", "run.mcap"]),
            "--record writes a recording",
        );
        refused(
            &with(&["--record", "new.rrd"]),
            "--show writes a file for the viewer",
        );
        refused(
            &with(&["--record", "new.mcap", "--show", "new.mcap"]),
            "--record writes",
        );
        refused(&with(&["--record", "."]), "an .mcap file");
    }
    refused(
        &["--record", "other.mcap"],
        "the file exists; --force overwrites it",
    );
    assert!(!at("new.rrd").exists() && !at("new.mcap").exists());
}

/// Opening a pipe blocks until its other end is opened.
#[test]
#[cfg(unix)]
fn rejects_a_pipe_as_a_recording() {
    let folder = TempDir::new().unwrap();
    let pipe = folder.path().join("pipe.mcap");
    assert!(
        Command::new("mkfifo")
            .arg(&pipe)
            .status()
            .unwrap()
            .success()
    );
    let other = folder.path().join("pipe.rrd");
    assert!(
        Command::new("mkfifo")
            .arg(&other)
            .status()
            .unwrap()
            .success()
    );
    for (option, path) in [("--record", &pipe), ("--show", &other)] {
        let args = [option, path.to_str().unwrap(), "--force", "--wait", "0.1"];
        let ended = Watch::start(folder.path(), "watch", &service("pipe"), &args).end();
        assert_eq!(ended.code, Some(2), "{}", ended.stderr);
        assert!(
            ended.stderr.contains("not a regular file"),
            "{}",
            ended.stderr
        );
    }
    let replayed = replay(&pipe);
    assert_eq!(replayed.code, Some(2), "{}", replayed.stderr);
    assert!(
        replayed.stderr.contains("regular file"),
        "{}",
        replayed.stderr
    );
}

#[test]
fn a_recording_is_created_at_the_first_frame_and_overwrites_none() {
    let folder = TempDir::new().unwrap();
    let service = service("first-frame");
    let recording = folder.path().join("run.mcap");
    let record = ["--record", recording.to_str().unwrap()];
    let nobody = [&record[..], &["--wait", "0.2"]].concat();
    let ended = Watch::start(folder.path(), "nobody", &service, &nobody).end();
    assert_eq!(ended.code, Some(3), "{}", ended.stderr);
    assert!(!recording.exists(), "a recording of nothing");

    std::fs::write(&recording, "mine").unwrap();
    let ended = Watch::start(folder.path(), "refused", &service, &nobody).end();
    assert_eq!(ended.code, Some(2), "{}", ended.stderr);
    assert!(
        ended.stderr.contains("--force overwrites it"),
        "{}",
        ended.stderr
    );
    let forced = [&nobody[..], &["--force"]].concat();
    let ended = Watch::start(folder.path(), "forced", &service, &forced).end();
    assert_eq!(ended.code, Some(3), "{}", ended.stderr);
    assert_eq!(std::fs::read(&recording).unwrap(), b"mine", "no frame came");

    let forced = [&record[..], &["--force"]].concat();
    let watch = Watch::start(folder.path(), "recorded", &service, &forced);
    let mut sim = client(&service);
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    assert_eq!(step(&mut sim, 0, 0.0), Verdict::Intact);
    sim.finish().unwrap();
    assert_eq!(watch.end().code, Some(0));
    assert_eq!(replay(&recording).code, Some(0));

    // A file that another process creates meanwhile is not overwritten either.
    std::fs::remove_file(&recording).unwrap();
    let watch = Watch::start(folder.path(), "late", &service, &record);
    let mut sim = client(&service);
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    std::fs::write(&recording, "mine").unwrap();
    assert_eq!(step(&mut sim, 0, 0.0), Verdict::Intact);
    sim.finish().unwrap();
    let ended = watch.end();
    assert_eq!(ended.code, Some(3), "{}", ended.stderr);
    assert!(
        ended.stderr.contains("recording failed"),
        "{}",
        ended.stderr
    );
    assert_eq!(std::fs::read(&recording).unwrap(), b"mine");
}

#[test]
fn a_replay_reports_if_its_verdicts_equal_the_recorded_ones() {
    let recording = recordings().join("squares.mcap");
    let path = recording.to_str().unwrap();
    let last = |args: &[&str]| {
        let (_, all) = printed(&[&["replay", path, "--quiet"], args].concat());
        let line = all.lines().find(|l| l.starts_with("verdicts: "));
        line.unwrap_or_else(|| panic!("{all}")).to_owned()
    };
    let equal =
        "verdicts: 19 equal to the recorded ones; 1 not compared: the curves of rejected frames";
    assert!(last(&[]).starts_with(equal), "{}", last(&[]));
    for (args, option) in [
        (&["--abort-on", "lost"][..], "--abort-on"),
        (&["--baseline", "first-frame"], "--baseline"),
        (&["--events"], "--events"),
        (&["--motion-limit", "2"], "--motion-limit"),
        (
            &["--events=all", "--abort-on", "never"],
            "--abort-on, --events",
        ),
    ] {
        let expected = format!(
            "verdicts: not compared with the recorded ones: recorded with another {option}"
        );
        assert_eq!(last(args), expected);
    }
    let compared = replay(&recording).summary()["recorded_verdicts"].clone();
    let counts = ["equal", "unlike", "rejected", "after_missing"].map(|n| compared[n].clone());
    assert_eq!(counts, [19, 0, 1, 0]);
    assert_eq!(compared["differing"], serde_json::json!([]));
}

#[test]
fn counts_verdicts_that_differ_from_the_recorded_ones() {
    let folder = TempDir::new().unwrap();
    let changed = folder.path().join("changed.mcap");
    rewrite_flight(&changed, |report| {
        if report.seq == 1 {
            report.verdict = Verdict::Undecided;
        }
        true
    });
    let (code, all) = printed(&["replay", changed.to_str().unwrap()]);
    assert_eq!(code, Some(1), "{all}");
    assert!(
        all.contains("verdicts: 4 equal to the recorded ones, 1 different"),
        "{all}"
    );
}

#[test]
fn a_replay_of_some_frames_gives_their_recorded_verdicts() {
    let flight = recordings().join("flight.mcap");
    let seqs = |run: &Ended| -> Vec<u64> {
        let reports = run.reports().into_iter();
        reports.map(|r| r["seq"].as_u64().unwrap()).collect()
    };
    let all = replay(&flight);
    let some = replay_with(&flight, &["--from", "2", "--to", "3"]);
    assert_eq!(seqs(&some), [2, 3]);
    assert_eq!(some.reports()[1]["events"], all.reports()[3]["events"]);
    // The motion to the first frame is unknown.
    let compared = &some.summary()["recorded_verdicts"];
    assert_eq!(
        (&compared["equal"], &compared["unlike"]),
        (&1.into(), &0.into())
    );
    assert_eq!(compared["after_missing"], 1, "{compared}");
    assert_eq!(some.code, Some(1), "{}", some.stderr);
    let before = replay_with(&flight, &["--to", "2"]);
    assert_eq!((seqs(&before), before.code), (vec![0, 1, 2], Some(0)));

    // The links of the recorded baseline are expected, not those of the first frame.
    let squares = recordings().join("squares.mcap");
    let late = replay_with(&squares, &["--from", "12"]);
    assert_eq!(seqs(&late)[0], 12);
    assert_eq!(late.reports()[0]["changes"].as_array().unwrap().len(), 1);
    assert_eq!(late.summary()["recorded_verdicts"]["unlike"], 0);
    let none = replay_with(&squares, &["--from", "1000"]);
    assert_eq!((seqs(&none), none.code), (vec![], Some(3)));
    let wrong = replay_with(&squares, &["--from", "5", "--to", "3"]);
    assert_eq!(wrong.code, Some(2));
    assert!(
        wrong.stderr.contains("--from 5 is after --to 3"),
        "{}",
        wrong.stderr
    );
}

#[test]
fn a_replay_begins_and_ends_at_simulation_times() {
    let squares = recordings().join("squares.mcap");
    let seqs = |args: &[&str]| -> Vec<u64> {
        let run = replay_with(&squares, args);
        assert_eq!(
            run.summary()["recorded_verdicts"]["unlike"],
            0,
            "{}",
            run.stderr
        );
        let reports = run.reports().into_iter();
        reports.map(|r| r["seq"].as_u64().unwrap()).collect()
    };
    // The rejected frame 15 is in the range, and its verdict is replayed.
    assert_eq!(
        seqs(&["--from", "1.15s", "--to", "1.65s"]),
        [12, 13, 14, 15, 16]
    );
    assert_eq!(seqs(&["--from", "15", "--to", "1.65s"]), [15, 16]);
    assert_eq!(seqs(&["--to", "0.1s"]), [0, 1]);
    let wrong = replay_with(&squares, &["--from", "2s", "--to", "1s"]);
    assert_eq!(wrong.code, Some(2));
    assert!(
        wrong.stderr.contains("--from 2s is after --to 1s"),
        "{}",
        wrong.stderr
    );
    let wrong = replay_with(&squares, &["--from", "1.5"]);
    assert_eq!(wrong.code, Some(2));
    assert!(
        wrong.stderr.contains("a simulation time in seconds (1.5s)"),
        "{}",
        wrong.stderr
    );
}

/// The chunks before `--from` are not read, except the first one, which has the baseline. So damage
/// there does not matter.
#[test]
fn a_replay_of_the_last_frames_skips_the_chunks_before_them() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("run.mcap");
    let run = super::written::Chainmail {
        scene: "chainmail:rows=12,columns=12".into(),
        frames: 30,
        pulled: u64::MAX,
        released: u64::MAX,
    };
    run.record(&path, linkwatch::Events::Off, true);
    let mut bytes = std::fs::read(&path).unwrap();
    assert!(bytes.len() > 2 << 20, "{} bytes", bytes.len());
    // A coordinate of a frame in the second chunk.
    bytes[1 << 20] ^= 1;
    std::fs::write(&path, &bytes).unwrap();
    assert_eq!(replay(&path).code, Some(2));
    let last = replay_with(&path, &["--from", "25"]);
    assert_eq!(last.code, Some(0), "{}", last.stderr);
    assert_eq!(last.summary()["recorded_verdicts"]["equal"], 5);
}

#[test]
fn files_without_verdicts_are_verified_with_a_note() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("run.mcap");
    std::fs::copy(recordings().join("chainmail.mcap"), &path).unwrap();
    super::written::drop_verdicts(&path);
    let last = |path: &Path, args: &[&str]| {
        let (code, all) = printed(&[&["replay", path.to_str().unwrap()], args].concat());
        assert_eq!(code, Some(0), "{all}");
        let line = all.lines().find(|l| l.starts_with("verdicts: "));
        line.unwrap_or_else(|| panic!("{all}")).to_owned()
    };
    for args in [&[][..], &["--events"], &["--from", "20"]] {
        let expected = "verdicts: the recording has none to compare with";
        assert_eq!(last(&path, args), expected);
    }
    let recording = folder.path().join("again.mcap");
    last(&path, &["--record", recording.to_str().unwrap()]);
    let replayed = replay(&recording);
    assert_eq!(replayed.code, Some(0), "{}", replayed.stderr);
    let counts = &replayed.summary()["recorded_verdicts"];
    assert!(counts["equal"].as_u64() > Some(20), "{counts}");
}

#[test]
fn a_range_behind_the_last_frame_verifies_nothing_and_names_that_frame() {
    let recording = recordings().join("squares.mcap");
    for range in [["--from", "20"], ["--from", "1.95s"]] {
        let replayed = replay_with(&recording, &range);
        assert_eq!(replayed.code, Some(3), "{}", replayed.stderr);
        let says = "no frame in this range; the last one of the recording is frame 19";
        assert!(replayed.stderr.contains(says), "{}", replayed.stderr);
    }
}

#[test]
fn a_replay_writes_a_complete_file_of_a_recording_that_was_cut_off() {
    let folder = TempDir::new().unwrap();
    let at = |name: &str| folder.path().join(name);
    let bytes = std::fs::read(recordings().join("chainmail.mcap")).unwrap();
    let (cut, whole) = (at("cut.mcap"), at("whole.mcap"));
    let mut most = 0;
    for share in [0.3, 0.77, 0.97] {
        let length = (share * bytes.len() as f64) as usize;
        std::fs::write(&cut, &bytes[..length]).unwrap();
        let run = replay_with(&cut, &["--force", "--record", whole.to_str().unwrap()]);
        assert_eq!(run.code, Some(3), "{}", run.stderr);
        let after = replay(&whole);
        assert_eq!(after.code, Some(0), "{}", after.stderr);
        assert_eq!(after.reports(), run.reports());
        after.assert_recorded_verdicts();
        let frames = after.reports().len();
        assert!(frames > most, "{frames} of {share}");
        most = frames;
    }
}
