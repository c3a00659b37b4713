//! Verdicts on frames of a live simulation, and what they ask the simulator to do.

use super::*;

#[test]
fn a_pull_through_is_found_aborted_recorded_and_replayed_identically() {
    let folder = TempDir::new().unwrap();
    let service = service("replay");
    let recording = folder.path().join("run.mcap");
    let rrd = folder.path().join("run.rrd");
    let args = [
        "--record",
        recording.to_str().unwrap(),
        "--show",
        rrd.to_str().unwrap(),
    ];
    let watch = Watch::start(folder.path(), "watch", &service, &args);
    let mut sim = client(&service);
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    for frame in 0..20 {
        // Linked up to frame 9, touching at 10, apart from 11 on; one frame with a NaN.
        let shift = frame as f32 * 0.1 - f32::from(frame == 10) * 1e-9;
        let shift = if frame < 10 { shift.min(0.9) } else { shift };
        let shift = if frame == 15 { f32::NAN } else { shift };
        let want = match frame {
            0..10 => Verdict::Intact,
            10 => Verdict::Contact,
            15 => Verdict::Rejected,
            _ => Verdict::Changed,
        };
        assert_eq!(step(&mut sim, frame, shift), want, "frame {frame}");
        assert_eq!(sim.aborted().is_some(), frame >= 10, "frame {frame}");
    }
    let last = sim.finish_within(PATIENCE).unwrap().expect("goodbye");
    assert_eq!(
        (
            last.counters.verified,
            last.counters.skipped,
            last.counters.rejected
        ),
        (19, 0, 1)
    );
    let live = watch.end();
    assert_eq!(live.code, Some(1), "{}", live.stderr);
    assert_eq!(live.reports().len(), 20);
    let first = &live.summary()["first_violation"];
    let keys = ["frame", "verdict", "curves"].map(|key| first[key].to_string());
    assert_eq!(keys, ["10", "\"contact\"", "[0,1]"], "{first}");
    let finding = first["finding"].as_str().unwrap();
    assert!(finding.starts_with("curves 0 and 1 touch"), "{first}");
    assert!(std::fs::metadata(&rrd).unwrap().len() > 1000);

    let replayed = replay(&recording);
    assert_eq!(replayed.code, Some(1), "{}", replayed.stderr);
    assert_eq!(replayed.reports(), live.reports());
    replayed.assert_recorded_verdicts();
    keep("squares", &recording, &live);
}

/// One square passes through the whole other one between two frames: two pull-throughs that cancel,
/// which no linking number shows.
#[test]
fn reports_pull_throughs_that_cancel_unless_they_are_off() {
    let folder = TempDir::new().unwrap();
    let recording = folder.path().join("run.mcap");
    let shifts = [3.0, 3.0, 3.001, -5.0, -5.0];
    let run = |name: &str, args: &[&str]| {
        let service = service(name);
        let watch = Watch::start(folder.path(), name, &service, args);
        let mut sim = client(&service);
        assert!(sim.wait_for_watcher(PATIENCE).unwrap());
        let verdicts = shifts
            .iter()
            .enumerate()
            .map(|(frame, &shift)| step(&mut sim, frame as u64, shift));
        let verdicts: Vec<Verdict> = verdicts.collect();
        let abort = sim.aborted().map(|m| m.to_string());
        sim.finish().unwrap();
        (verdicts, abort, watch.end())
    };
    let (verdicts, abort, live) = run("unseen", &["--events=off"]);
    assert_eq!(verdicts, [Verdict::Intact; 5]);
    assert_eq!((abort, live.code), (None, Some(0)), "{}", live.stderr);

    let record = ["--record", recording.to_str().unwrap()];
    // The curve moves four edge lengths in one step, beyond the default limit.
    let policy = ["--abort-on", "event", "--motion-limit", "5"];
    let (verdicts, abort, live) = run("seen", &[&record[..], &policy].concat());
    let changed = |k: usize| [Verdict::Intact, Verdict::Changed][usize::from(k == 3)];
    assert_eq!(verdicts, [0, 1, 2, 3, 4].map(changed));
    let abort = abort.expect("an abort");
    assert!(
        abort.starts_with("frame 3: changed, 4 pull-throughs: curves 0 and 1 passed through"),
        "{abort}"
    );
    assert_eq!(live.code, Some(1), "{}", live.stderr);
    let events = live.reports()[3]["events"].as_array().unwrap();
    let signs: i64 = events.iter().map(|e| e["sign"].as_i64().unwrap()).sum();
    assert_eq!((events.len(), signs), (4, 0));
    let first = &live.summary()["first_violation"];
    let finding = first["finding"].as_str().unwrap();
    assert!(finding.starts_with("curves 0 and 1 passed"), "{first}");
    assert_eq!(first["frame"], 3);
    // The work of each frame is reported, and no frame disagreed.
    for line in live.lines.iter().filter_map(|l| l.get("work")) {
        assert_eq!(line["disagreed"], false);
        assert!(["full", "quiet", "partial"].contains(&line["route"].as_str().unwrap()));
    }
    let replayed = replay(&recording);
    assert_eq!(replayed.code, Some(1), "{}", replayed.stderr);
    assert_eq!(replayed.reports(), live.reports());
    replayed.assert_recorded_verdicts();
    keep("flight", &recording, &live);
}

/// A curve is pulled through; the simulator goes back to an earlier frame and continues from there.
#[test]
fn a_rollback_of_a_pull_through_is_aborted_once() {
    let folder = TempDir::new().unwrap();
    // The simulator reports the rollback with `resume`, or does not report it. In the latter case,
    // the way back is a pull-through.
    for (name, resumes) in [("resumed", true), ("not resumed", false)] {
        let service = service(name);
        let recording = folder.path().join(format!("{name}.mcap"));
        let record = [
            "--events",
            "--motion-limit",
            "5",
            "--record",
            recording.to_str().unwrap(),
        ];
        let watch = Watch::start(folder.path(), name, &service, &record);
        let mut sim = client(&service);
        assert!(sim.wait_for_watcher(PATIENCE).unwrap());
        let mut aborts = Vec::new();
        let shifts = [3.0, 3.0, 3.001, -5.0, 3.0, 3.001, 3.002, 2.9, 2.8];
        for (frame, shift) in shifts.into_iter().enumerate() {
            let verdict = step(&mut sim, frame as u64, shift);
            if verdict == Verdict::Changed {
                aborts.push(frame);
                assert!(sim.aborted().is_some());
                if resumes {
                    sim.resume();
                }
            }
        }
        let last = sim.finish_within(PATIENCE).unwrap().expect("goodbye");
        assert_eq!((last.abort, last.recovered), (!resumes, resumes.into()));
        let recovered = "; recovered: 1 violation was rolled back";
        assert_eq!(last.to_string().ends_with(recovered), resumes, "{last}");
        let expected = if resumes { vec![3] } else { vec![3, 4] };
        assert_eq!(aborts, expected);
        let live = watch.end();
        let junit = folder.path().join(format!("{name}.xml"));
        let replayed = replay_with(&recording, &["--junit", junit.to_str().unwrap()]);
        let (code, word) = if resumes {
            (0, "recovered")
        } else {
            (1, "changed")
        };
        for run in [&live, &replayed] {
            assert_eq!(run.code, Some(code), "{}", run.stderr);
            assert_eq!(run.summary()["verdict"], word);
            assert_eq!(run.summary()["recovered"], u32::from(resumes));
        }
        let xml = std::fs::read_to_string(junit).unwrap();
        assert_eq!(xml.contains("failures=\"0\""), resumes, "{xml}");
        assert_eq!(xml.contains("skipped=\"1\""), resumes, "{xml}");
        let (reported, text) = printed(&["report", "--text", recording.to_str().unwrap()]);
        assert_eq!(reported, Some(code), "{text}");
        assert_eq!(
            text.starts_with("Recovered: 1 violation was"),
            resumes,
            "{text}"
        );
        assert_eq!(replayed.reports(), live.reports());
        replayed.assert_recorded_verdicts();
    }
}

/// The frame after the rollback is skipped or rejected. The next verified frame still does not
/// continue the frame before the rollback.
#[test]
fn a_rollback_in_a_frame_that_was_not_verified_is_detected() {
    let folder = TempDir::new().unwrap();
    for (name, cut) in [("skipped", true), ("uncut", false)] {
        let service = service(name);
        let recording = folder.path().join(format!("{name}.mcap"));
        let events = ["--events", "--motion-limit", "5"];
        let record = [&events[..], &["--record", recording.to_str().unwrap()]].concat();
        let watch = Watch::start(folder.path(), name, &service, &record);
        let mut sim = client(&service);
        assert!(sim.wait_for_watcher(PATIENCE).unwrap());
        assert_eq!(step(&mut sim, 0, 3.0), Verdict::Intact);
        assert_eq!(step(&mut sim, 1, 3.001), Verdict::Intact);
        let publish = |sim: &mut Client, shift: f32| {
            sim.publish(0.5, Positions::F32(&squares(shift))).unwrap()
        };
        // The watcher is stopped, and takes the newest frame when it continues.
        watch.signal("STOP");
        std::thread::sleep(Duration::from_millis(50));
        if cut {
            sim.cut();
        }
        let skipped: Vec<u64> = [-5.0, -5.0, -5.0].map(|x| publish(&mut sim, x)).into();
        let seq = publish(&mut sim, -5.0);
        watch.signal("CONT");
        let Outcome::Verdict(first) = sim.wait(seq, PATIENCE).unwrap() else {
            panic!("no verdict on frame {seq}");
        };
        let last = skipped.last().copied().unwrap();
        assert_eq!(sim.wait(last, PATIENCE).unwrap(), Outcome::Stale);
        assert_eq!(first.events, if cut { 0 } else { 4 });
        // The frame after the cut is rejected: the one after that does not continue the frame
        // before the cut.
        if cut {
            sim.cut();
        }
        assert_eq!(step(&mut sim, seq + 1, f32::NAN), Verdict::Rejected);
        let seq = publish(&mut sim, 3.0);
        let Outcome::Verdict(second) = sim.wait(seq, PATIENCE).unwrap() else {
            panic!("no verdict on frame {seq}");
        };
        assert_eq!(second.events, if cut { 0 } else { 4 });
        sim.finish().unwrap();
        let live = watch.end();
        assert!(live.summary()["skipped"].as_u64().unwrap() >= 2);
        let replayed = replay(&recording);
        assert_eq!(replayed.reports(), live.reports());
        replayed.assert_recorded_verdicts();
    }
}

#[test]
fn a_simulation_that_became_nan_is_asked_to_stop() {
    let folder = TempDir::new().unwrap();
    for (policy, stops) in [("any", true), ("rejected", true), ("lost", false)] {
        let service = service(&format!("nan-{policy}"));
        let recording = folder.path().join(format!("{policy}.mcap"));
        let args = [
            "--abort-on",
            policy,
            "--record",
            recording.to_str().unwrap(),
        ];
        let watch = Watch::start(folder.path(), policy, &service, &args);
        let mut sim = client(&service);
        assert!(sim.wait_for_watcher(PATIENCE).unwrap());
        assert_eq!(step(&mut sim, 0, 0.0), Verdict::Intact);
        assert_eq!(step(&mut sim, 1, f32::NAN), Verdict::Rejected);
        let abort = sim.aborted().map(|m| m.to_string());
        let words = "frame 1: rejected: curve 1, point 0: coordinate x is NaN. Stop or roll back: \
                     frame 0 is intact";
        assert_eq!(abort, stops.then(|| words.into()));
        // The simulator goes back to the previous frame.
        sim.resume();
        assert_eq!(step(&mut sim, 2, 0.0), Verdict::Intact);
        assert!(sim.aborted().is_none());
        sim.finish().unwrap();
        let live = watch.end();
        // A rollback ends a violation only if the frame asked the simulator to stop.
        let code = if stops { 0 } else { 3 };
        assert_eq!(live.code, Some(code), "{}", live.stderr);
        assert_eq!(live.reports()[1]["abort"], stops);
        let replayed = replay(&recording);
        assert_eq!(replayed.code, Some(code), "{}", replayed.stderr);
        assert_eq!(replayed.reports(), live.reports());
        replayed.assert_recorded_verdicts();
        // With another `--abort-on`, the abort flag differs, even for a frame whose curves are not
        // recorded.
        let other = ["--abort-on", if stops { "never" } else { "any" }];
        let other = replay_with(&recording, &other);
        assert_eq!(other.reports()[1]["abort"], !stops);
    }
}

#[test]
fn a_baseline_file_may_hold_undefined_pairs() {
    let folder = TempDir::new().unwrap();
    let service = service("undefined");
    let baseline = folder.path().join("touching.txt");
    std::fs::write(&baseline, "2 # lines: 1\n0,1,undefined\n").unwrap();
    let args = ["--baseline", baseline.to_str().unwrap()];
    let watch = Watch::start(folder.path(), "undefined", &service, &args);
    let mut sim = client(&service);
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    // The squares touch, as in the baseline, then come apart and have a linking number from then
    // on.
    for (frame, (shift, verdict)) in [
        (1.0, Verdict::Contact),
        (3.0, Verdict::Undecided),
        (3.0, Verdict::Intact),
    ]
    .into_iter()
    .enumerate()
    {
        assert_eq!(step(&mut sim, frame as u64, shift), verdict, "{frame}");
        assert!(sim.aborted().is_none(), "{frame}");
    }
    sim.finish().unwrap();
    let live = watch.end();
    assert_eq!(live.code, Some(3), "{}", live.stderr);
    assert_eq!(live.reports()[1]["defects"][0]["kind"], "no-baseline");
}

/// Regression test: a contact in the first frame hid every later one, and asked the simulator to
/// stop in each frame.
#[test]
fn contact_in_the_first_frame_hides_no_later_finding() {
    let folder = TempDir::new().unwrap();
    let service = service("touching");
    let output = folder.path().join("watch.txt");
    let mut process = command()
        .args(["watch", "--service", &service])
        .stdout(std::fs::File::create(&output).unwrap())
        .stderr(Stdio::null())
        .stdin(Stdio::null())
        .spawn()
        .unwrap();
    let mut sim = Client::open(&service, &ClientOptions::lockstep()).unwrap();
    let counts = [-4; 4];
    sim.describe(Basis::Polyline, Precision::F32, &counts)
        .unwrap();
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    // Two pairs of squares, far from each other; they touch at a shift of 1.
    for (first, second, verdict, abort) in [
        (1.0, 0.0, Verdict::Contact, false),
        (1.0, 0.0, Verdict::Contact, false),
        (1.0, 1.0, Verdict::Contact, true),
        (1.0, 1.0, Verdict::Contact, true),
        (0.5, 0.0, Verdict::Undecided, false),
        (0.5, 0.0, Verdict::Intact, false),
        (1.0, 0.0, Verdict::Contact, true),
    ] {
        let far = squares(second).into_iter().map(|x| x + 100.0);
        let positions: Vec<f32> = squares(first).into_iter().chain(far).collect();
        let seq = sim.publish(0.0, Positions::F32(&positions)).unwrap();
        let Outcome::Verdict(message) = sim.wait(seq, PATIENCE).unwrap() else {
            panic!("no verdict on frame {seq}");
        };
        assert_eq!(
            (message.verdict, message.abort),
            (verdict, abort),
            "frame {seq}"
        );
        sim.resume();
    }
    sim.finish_within(PATIENCE).unwrap();
    assert_eq!(wait(&mut process).code(), Some(3));
    let said = std::fs::read_to_string(&output).unwrap();
    let lines = |words: &str| said.lines().filter(|l| l.contains(words)).count();
    // Each is printed once when it begins: in frames 0 and 6, in frame 2, and the linking number in
    // frame 4.
    assert_eq!(lines("  curves 0 and 1 touch"), 2, "{said}");
    assert_eq!(lines("  curves 2 and 3 touch"), 1, "{said}");
    assert_eq!(lines("is expected from here on"), 1, "{said}");
}

/// Regression test: the verdict was "intact" with exit code 0, whatever share of frames was
/// skipped.
#[test]
fn the_share_of_skipped_frames_is_reported_and_can_be_limited() {
    let folder = TempDir::new().unwrap();
    for (limit, code) in [("0.5", 3), ("59%", 3), ("0.6", 0), ("100%", 0)] {
        let service = service(&format!("skipped-{code}-{}", limit.len()));
        let mut sim = client(&service);
        for frame in 0..4 {
            let squares = squares(0.0);
            sim.publish(frame.into(), Positions::F32(&squares)).unwrap();
        }
        let args = ["--max-skipped", limit];
        let watch = Watch::start(folder.path(), limit, &service, &args);
        assert!(sim.wait_for_watcher(PATIENCE).unwrap());
        assert_eq!(step(&mut sim, 4, 0.0), Verdict::Intact);
        sim.finish().unwrap();
        let ended = watch.end();
        let share = ended.summary()["skipped_share"].as_f64().unwrap();
        // An earlier frame, the newest one then, may have been verified as well.
        if share == 0.6 {
            assert_eq!(ended.code, Some(code), "{limit}: {}", ended.stderr);
            let reported = "60.00 % of the frames were skipped, more than";
            assert_eq!(
                ended.stderr.contains(reported),
                code == 3,
                "{}",
                ended.stderr
            );
        } else {
            assert_eq!(share, 0.4);
        }
    }
    for share in ["1.5", "-1", "nan", "101%", "many"] {
        let args = [&format!("--max-skipped={share}")[..]];
        let ended = Watch::start(folder.path(), "bad", "unused", &args).end();
        assert_eq!(ended.code, Some(2), "{share}");
    }
    for wait in ["nan", "-1", "inf"] {
        let args = [&format!("--wait={wait}")[..]];
        let ended = Watch::start(folder.path(), "bad", "unused", &args).end();
        assert_eq!(ended.code, Some(2), "{wait}");
    }
}
