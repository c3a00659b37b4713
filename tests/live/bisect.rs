//! `linkwatch replay --bisect`: the first changed frame and its cause.

use super::written::{Chainmail, INTERVAL, drop_verdicts};
use super::*;
use crate::support::session::Step;
use linkwatch::{CurveSet, Events, RecordingReader, Session, SessionOptions};
use std::time::Instant;

fn chainmail(frames: u64, pulled: u64, released: u64) -> Chainmail {
    Chainmail {
        scene: "chainmail:rows=3,columns=3".into(),
        frames,
        pulled,
        released,
    }
}

/// Runs `--bisect`. Returns its result and the exit code.
fn bisect(recording: &Path, args: &[&str]) -> (Value, Option<i32>) {
    let ended = replay_with(recording, &[&["--bisect"], args].concat());
    let line = ended
        .lines
        .first()
        .unwrap_or_else(|| panic!("{}", ended.stderr));
    (line["bisect"].clone(), ended.code)
}

fn positions(set: &CurveSet) -> Vec<f32> {
    let mut bytes = Vec::new();
    set.write_positions(&mut bytes);
    let parse = |b: &[u8]| f32::from_le_bytes(b.try_into().unwrap());
    bytes.chunks_exact(4).map(parse).collect()
}

#[test]
fn finds_the_first_changed_frame_its_cause_and_a_step_that_keeps_the_strands_apart() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("run.mcap");
    let run = chainmail(100, 61, u64::MAX);
    run.record(&path, Events::Off, true);
    let (found, code) = bisect(&path, &["--events"]);
    assert_eq!(code, Some(1), "{found}");
    let seqs = ["changed", "before"].map(|name| found[name]["seq"].as_u64());
    assert_eq!(seqs, [Some(61), Some(60)]);
    assert!(found["verified"].as_u64().unwrap() <= 9, "{found}");
    assert_eq!(found["recorded_verdicts"]["agrees"], true);
    let step = &found["step"];
    let (passage, cause) = (&step["pull_throughs"][0], &step["causes"][0]);
    let number = |value: &Value| value.as_f64().unwrap();
    let until = number(&passage["fraction"]) * INTERVAL;
    assert!((number(&cause["until"]) - until).abs() < 1e-12, "{cause}");
    assert!((number(&cause["interval"]) - INTERVAL).abs() < 1e-12);
    assert!((number(&cause["steps"]) - 1.0).abs() < 1e-9);
    let speed = number(&cause["distance"]) / number(&cause["interval"]);
    assert!((number(&cause["speed"]) - speed).abs() < 1e-9 * speed);

    // The same motion at the same speed, with the proposed step: its first frame is intact.
    let mut frames = Vec::new();
    run.each(|k, set| {
        if k == 60 || k == 61 {
            frames.push(set.clone());
        }
    });
    let [x0, x1] = [&frames[0], &frames[1]].map(positions);
    let verdict = |share: f32| {
        let mut session = Session::new(SessionOptions {
            events: Events::Between,
            ..SessionOptions::default()
        })
        .unwrap();
        let mut set = frames[0].clone();
        session.step(0, &set);
        let at: Vec<f32> = x0
            .iter()
            .zip(&x1)
            .map(|(a, b)| a + share * (b - a))
            .collect();
        set.update(Positions::F32(&at)).unwrap();
        session.step(1, &set).report.verdict
    };
    let safe = number(&step["safe_fraction"]) as f32;
    assert!(safe > 0.0 && safe < 1.0);
    assert_eq!(verdict(safe), Verdict::Intact);
    assert_ne!(verdict(safe + 1e-3), Verdict::Intact);

    let (code, text) = printed(&["replay", path.to_str().unwrap(), "--bisect", "--events"]);
    assert_eq!(code, Some(1), "{text}");
    for words in [
        "first changed frame: frame 61 at 0.244 s: changed",
        "the frame before it: frame 60 at 0.24 s: intact",
        "(ring/",
        "from frame 60 to 61 the strands moved ",
        "would have kept all strands apart at this speed; it was 0.004 s",
        "proven: frame 61 is changed, and frame 60 is intact; frame 61 is the first one if",
        "the recorded verdicts say the same",
        " of 100 frames in ",
    ] {
        assert!(text.contains(words), "{words}: {text}");
    }
}

#[test]
fn a_change_that_reverts_is_found_by_the_recorded_verdicts_only() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("run.mcap");
    chainmail(40, 11, 20).record(&path, Events::Off, true);
    let (found, code) = bisect(&path, &[]);
    assert_eq!(code, Some(1), "{found}");
    assert_eq!(found["changed"]["seq"], 11);
    drop_verdicts(&path);
    let (found, code) = bisect(&path, &[]);
    assert_eq!((&found["changed"], code), (&Value::Null, Some(0)));
    assert_eq!(found["recorded_verdicts"], Value::Null);
    let proof = found["proof"].as_str().unwrap();
    assert!(
        proof.contains("an earlier change may have reverted"),
        "{proof}"
    );
    // Up to a changed frame, it is found again.
    let (found, code) = bisect(&path, &["--to", "15"]);
    assert_eq!((&found["changed"]["seq"], code), (&11.into(), Some(1)));
    let (found, _) = bisect(&path, &["--from", "14", "--to", "0.064s"]);
    let proof = found["proof"].as_str().unwrap();
    assert_eq!(found["changed"]["seq"], 14);
    assert_eq!(proof, "proven: frame 14, the first one, is changed");
}

#[test]
fn finds_pull_throughs_that_cancel_by_the_recorded_verdicts() {
    let flight = recordings().join("flight.mcap");
    let (found, code) = bisect(&flight, &[]);
    assert_eq!(code, Some(1), "{found}");
    assert_eq!(found["changed"]["seq"], 3);
    assert_eq!(found["step"]["frames"], serde_json::json!([2, 3]));
    assert_eq!(found["step"]["causes"].as_array().unwrap().len(), 4);
    assert_eq!(found["recorded_verdicts"]["agrees"], true);
}

/// The recorded pull-throughs are not searched for, so the result contradicts the recording.
#[test]
fn is_undecided_if_the_recorded_verdicts_disagree() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("claimed.mcap");
    super::recordings::rewrite_flight(&path, |report| {
        report.events.clear();
        if report.seq == 1 {
            report.verdict = Verdict::Changed;
        }
        report.seq != 3
    });
    let (found, code) = bisect(&path, &[]);
    assert_eq!(code, Some(3), "{found}");
    assert_eq!(found["recorded_verdicts"]["agrees"], false);
}

#[test]
fn a_passage_through_a_contact_is_followed_from_the_last_intact_frame() {
    let squares = recordings().join("squares.mcap");
    let (found, code) = bisect(&squares, &["--events"]);
    assert_eq!(code, Some(1), "{found}");
    assert_eq!(found["changed"]["seq"], 11);
    assert_eq!(found["before"]["verdict"], "contact");
    assert_eq!(found["step"]["pull_throughs"].as_array().unwrap().len(), 1);
    assert_eq!(found["step"]["causes"][0]["lengths"], 0.0);
}

#[test]
fn a_recording_that_was_cut_off_is_searched_up_to_its_end() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("cut.mcap");
    chainmail(60, 21, u64::MAX).record(&path, Events::Off, true);
    let whole = std::fs::read(&path).unwrap();
    std::fs::write(&path, &whole[..whole.len() / 2]).unwrap();
    let (found, code) = bisect(&path, &[]);
    assert_eq!((&found["changed"]["seq"], code), (&21.into(), Some(1)));
    let frames = found["frames"].as_u64().unwrap();
    assert!((22..40).contains(&frames), "{found}");
}

#[test]
fn refuses_what_cannot_be_searched() {
    let folder = TempDir::new().unwrap();
    let flight = recordings().join("flight.mcap");
    let empty = folder.path().join("empty.mcap");
    let whole = std::fs::read(&flight).unwrap();
    std::fs::write(&empty, &whole[..100]).unwrap();
    for (file, args, words) in [
        (&flight, &["--from", "100"][..], "no frame to verify"),
        (&empty, &[], "no frame to verify"),
        (&flight, &["--abort-on", "any"], "cannot be used with"),
        (&flight, &["--record", "x.mcap"], "cannot be used with"),
        (&flight, &["--baseline", "none.json"], "none.json"),
    ] {
        let ended = replay_with(file, &[&["--bisect"], args].concat());
        assert_eq!(ended.code, Some(2), "{args:?}: {}", ended.stderr);
        assert!(ended.stderr.contains(words), "{args:?}: {}", ended.stderr);
    }
}

/// Measures a bisection and a seek, compared with a replay of all frames. Takes a minute:
#[test]
fn a_bisection_of_a_recording_that_was_cut_off_is_incomplete() {
    let recording = recordings().join("cut_off.mcap");
    for (args, code) in [
        (&["--bisect"][..], 3),
        (&["--bisect", "--to", "19"], 3),
        (&["--bisect", "--to", "18"], 0),
    ] {
        let ended = replay_with(&recording, args);
        assert_eq!(ended.code, Some(code), "{args:?}: {}", ended.stderr);
        let says = "cut_off.mcap: the recording is truncated at byte 210,728";
        assert_eq!(ended.stderr.contains(says), code == 3, "{}", ended.stderr);
    }
}

/// `cargo test --release --test live two_thousand_frames -- --ignored --nocapture`
#[test]
#[ignore = "takes a minute; prints times"]
fn a_bisection_of_two_thousand_frames_verifies_few() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("long.mcap");
    let run = Chainmail {
        scene: "chainmail:rows=24,columns=24".into(),
        frames: 2000,
        pulled: 1371,
        released: u64::MAX,
    };
    run.record(&path, Events::Off, true);
    let bytes = std::fs::metadata(&path).unwrap().len();
    println!("{} MB", bytes >> 20);
    let timed = |args: &[&str]| {
        let start = Instant::now();
        let ended = replay_with(&path, args);
        let took = start.elapsed();
        println!("replay {}: {took:?}", args.join(" "));
        (ended, took.as_secs_f64())
    };
    for events in [&[][..], &["--events"]] {
        let (all, sequential) = timed(events);
        assert_eq!(all.code, Some(1), "{}", all.stderr);
        let (found, searched) = timed(&[&["--bisect"], events].concat());
        let found = &found.lines[0]["bisect"];
        assert_eq!(found["changed"]["seq"], 1371);
        let verified = found["verified"].as_u64().unwrap();
        assert!(verified <= 13, "{verified}");
        println!(
            "{verified} of 2000 frames verified; {:.0} times as fast",
            sequential / searched
        );
    }
    let (end, sought) = timed(&["--from", "1990"]);
    assert_eq!(end.reports().len(), 10);
    // Without the seek, all frames before it are read.
    let start = Instant::now();
    let mut reader = RecordingReader::open(&path).unwrap();
    while reader.next_item().unwrap().is_some() {}
    let read = start.elapsed();
    println!(
        "reading all: {read:?}, {:.0} times as long",
        read.as_secs_f64() / sought
    );
    timed(&["--from", "7.96s"]);
}
