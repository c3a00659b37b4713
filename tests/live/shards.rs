//! Several watches that share the pairs of one scene.

use super::support::random::Random;
use super::*;
use linkwatch::scenes::Scene;
use linkwatch::{
    CurveChange, CurveLabels, CurveSet, Events, Report, Strategy, Verifier, VerifierOptions,
};

/// Rings of a sheet of chainmail that a random walk deforms, and sometimes tears.
struct Sheet {
    random: Random,
    names: Vec<String>,
    /// Positions of each ring.
    rings: Vec<Vec<f64>>,
}

impl Sheet {
    fn new(seed: u64) -> Sheet {
        let set = "chainmail:rows=3,columns=4".parse::<Scene>();
        let set = set.unwrap().build().unwrap().curves;
        let ring = |i: usize| {
            let points = set.curve(i).segments as usize;
            (0..points).flat_map(|k| set.point(i, k)).collect()
        };
        Sheet {
            random: Random::new(seed),
            names: (0..set.len()).map(|i| format!("ring {i}")).collect(),
            rings: (0..set.len()).map(ring).collect(),
        }
    }

    fn counts(&self) -> Vec<i32> {
        let count = |ring: &Vec<f64>| -((ring.len() / 3) as i32);
        self.rings.iter().map(count).collect()
    }

    fn positions(&self) -> Vec<f64> {
        self.rings.concat()
    }

    fn labels(&self) -> CurveLabels {
        CurveLabels::named(self.names.iter().map(String::as_str))
    }

    /// Moves one ring a little or, rarely, so far that it may pass through others.
    fn advance(&mut self) {
        let ring = self.random.below(self.rings.len());
        let far = if self.random.one_in(6) { 2.0 } else { 0.02 };
        let shift: [f64; 3] = std::array::from_fn(|_| far * (self.random.unit() - 0.5));
        let points = self.rings[ring].iter_mut().enumerate();
        points.for_each(|(k, x)| *x += shift[k % 3]);
    }

    fn describe(&self, sim: &mut Client) {
        let counts = self.counts();
        sim.describe_labelled(Basis::Polyline, Precision::F64, &counts, self.labels())
            .unwrap();
    }

    fn set(&self) -> CurveSet {
        let positions = self.positions();
        let positions = Positions::F64(&positions);
        CurveSet::from_counts(Basis::Polyline, &self.counts(), positions).unwrap()
    }

    /// Publishes a frame and waits for its verdict.
    fn step(&self, sim: &mut Client) -> Verdict {
        let seq = sim.publish(0.0, Positions::F64(&self.positions())).unwrap();
        match sim.wait(seq, PATIENCE).unwrap() {
            Outcome::Verdict(message) => message.verdict,
            other => panic!("frame {seq}: {other:?}"),
        }
    }
}

/// Starts a watch with each of these shards.
fn shards(folder: &Path, service: &str, of: usize, args: &[&str]) -> Vec<Watch> {
    let start = |k| match k {
        1 => shard(folder, service, 1, of, args),
        k => shard(folder, service, k, of, &[]),
    };
    (1..=of).map(start).collect()
}

fn shard(folder: &Path, service: &str, k: usize, of: usize, args: &[&str]) -> Watch {
    let shard = format!("{k}/{of}");
    let args: Vec<&str> = ["--shard", &shard]
        .into_iter()
        .chain(args.iter().copied())
        .collect();
    let name = format!("shard-{k}-{}", Random::new(service.len() as u64).next());
    Watch::start(folder, &name, service, &args)
}

/// Returns what must be equal, whoever verifies: all but the work, and the safe fraction of a step
/// with findings.
fn findings(report: &Value) -> Value {
    let mut report = report.clone();
    report["stats"] = Value::Null;
    if report["safe_fraction"] != 1.0 {
        report["safe_fraction"] = Value::Null;
    }
    report
}

#[test]
fn shards_report_what_one_watch_reports() {
    let folder = TempDir::new().unwrap();
    let service = service("shards");
    let recording = folder.path().join("run.mcap");
    let args = [
        "--events",
        "--self",
        "--record",
        recording.to_str().unwrap(),
    ];
    let watches = shards(folder.path(), &service, 3, &args);
    let mut sim = Client::open(&service, &ClientOptions::lockstep()).unwrap();
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    let mut sheet = Sheet::new(5);
    sheet.describe(&mut sim);
    let mut single = Verifier::new(VerifierOptions {
        events: Events::All,
        strategy: Strategy::Incremental,
        ..VerifierOptions::default()
    })
    .unwrap();
    let mut wanted: Vec<Report> = Vec::new();
    for frame in 0..60 {
        if frame == 25 {
            sim.cut();
            single.cut();
        }
        if frame == 40 {
            // One ring disappears, and another one appears as the first.
            let before = sheet.labels();
            sheet.rings.remove(3);
            sheet.names.remove(3);
            let far = sheet.rings[0].iter().map(|x| x + 50.0).collect();
            sheet.rings.insert(0, far);
            sheet.names.insert(0, "new".into());
            sheet.describe(&mut sim);
            single.change_curves(CurveChange::by_name(&before, &sheet.labels()).unwrap());
        }
        let report = single.step(frame, 0.0, &sheet.set()).unwrap();
        assert_eq!(sheet.step(&mut sim), report.verdict, "frame {frame}");
        wanted.push(report);
        sheet.advance();
    }
    sim.finish().unwrap();
    let mut ended: Vec<Ended> = watches.into_iter().map(Watch::end).collect();
    let members = ended.split_off(1);
    let leader = ended.pop().unwrap();
    let reports = leader.reports();
    assert_eq!(reports.len(), wanted.len(), "{}", leader.stderr);
    for (report, wanted) in reports.into_iter().zip(&wanted) {
        // Through text, like the report: reading a number may change its last digit.
        let wanted = serde_json::to_string(wanted).unwrap();
        assert_eq!(
            findings(report),
            findings(&serde_json::from_str(&wanted).unwrap())
        );
    }
    assert!(wanted.iter().any(|r| r.verdict == Verdict::Changed));
    assert_eq!(leader.code, Some(1), "{}", leader.stderr);
    for member in members {
        assert_eq!(member.code, Some(0), "{}", member.stderr);
        let verified = "its pairs were verified in 60 frames; shard 1 has the results";
        assert!(member.stderr.contains(verified), "{}", member.stderr);
    }
    // The recording has the whole baseline, so a replay by one process gives the same verdicts.
    let replayed = replay(&recording);
    assert_eq!(replayed.code, Some(1), "{}", replayed.stderr);
    replayed.assert_recorded_verdicts();
}

#[test]
fn without_a_shard_no_frame_is_intact_until_another_one_takes_its_place() {
    let folder = TempDir::new().unwrap();
    let service = service("lost-shard");
    let mut watches = shards(folder.path(), &service, 3, &["--abort-on", "never"]);
    let mut sim = Client::open(&service, &ClientOptions::lockstep()).unwrap();
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    let mut sheet = Sheet::new(7);
    sheet.describe(&mut sim);
    assert_eq!(sheet.step(&mut sim), Verdict::Intact);
    // A killed one, and a second one that takes its place.
    watches[1].process.kill().unwrap();
    assert_eq!(sheet.step(&mut sim), Verdict::Undecided);
    assert_eq!(sheet.step(&mut sim), Verdict::Undecided);
    let other = TempDir::new().unwrap();
    watches[1] = shard(other.path(), &service, 2, 3, &[]);
    stderr_with(
        &watches[0],
        &["shard 2 of 3 was silent for 3 s", "start it again"],
    );
    let leader = watches[0].stderr.clone();
    let there = |times| {
        until(format_args!("shard 2, {times} times"), || {
            let stderr = std::fs::read_to_string(&leader).unwrap();
            (stderr.matches("shard 2 of 3 is there").count() >= times).then_some(())
        });
    };
    let intact_again = |sim: &mut Client| {
        until("an intact frame", || {
            (sheet.step(sim) == Verdict::Intact).then_some(())
        });
    };
    intact_again(&mut sim);
    there(2);
    // A stopped one, which goes on.
    watches[2].signal("STOP");
    assert_eq!(sheet.step(&mut sim), Verdict::Undecided);
    watches[2].signal("CONT");
    intact_again(&mut sim);
    // One that ends itself.
    watches[1].signal("TERM");
    let why = "shard 2 of 3 left: it was stopped by a signal";
    stderr_with(&watches[1], &["stopped by a signal"]);
    until("the goodbye of the shard", || {
        (sheet.step(&mut sim) == Verdict::Undecided).then_some(())
    });
    // A change is found by the shards that are there, or the frame is undecided.
    let far = sheet.rings[0].iter().map(|x| x + 50.0).collect();
    sheet.rings[0] = far;
    assert_ne!(sheet.step(&mut sim), Verdict::Intact);
    sim.finish().unwrap();
    let leader = watches.remove(0).end();
    assert!(leader.stderr.contains(why), "{}", leader.stderr);
    let missing = leader.reports().iter().any(|r| r["missing"][0] == why);
    assert!(missing, "{}", leader.stderr);
    let code = leader.code.unwrap();
    assert!(code == 1 || code == 3, "{code}");
}

#[test]
fn the_other_shards_end_if_the_leader_is_killed() {
    let folder = TempDir::new().unwrap();
    let service = service("lost-leader");
    let mut watches = shards(folder.path(), &service, 2, &[]);
    let mut sim = Client::open(&service, &ClientOptions::lockstep()).unwrap();
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    let sheet = Sheet::new(9);
    sheet.describe(&mut sim);
    assert_eq!(sheet.step(&mut sim), Verdict::Intact);
    watches[0].process.kill().unwrap();
    let member = watches.pop().unwrap().end();
    assert_eq!(member.code, Some(3), "{}", member.stderr);
    assert!(member.stderr.contains("shard 1 died"), "{}", member.stderr);
}

#[test]
fn a_leader_verifies_one_session_after_another() {
    let folder = TempDir::new().unwrap();
    let service = service("shards-sessions");
    let keep = ["--keep-watching"];
    let watches = [
        shard(folder.path(), &service, 1, 2, &keep),
        shard(folder.path(), &service, 2, 2, &keep),
    ];
    for seed in 0..3 {
        let mut sim = Client::open(&service, &ClientOptions::lockstep()).unwrap();
        assert!(sim.wait_for_watcher(PATIENCE).unwrap());
        let sheet = Sheet::new(seed);
        sheet.describe(&mut sim);
        for _ in 0..3 {
            assert_eq!(sheet.step(&mut sim), Verdict::Intact);
        }
        sim.finish().unwrap();
    }
    for watch in &watches {
        watch.signal("TERM");
    }
    for watch in watches {
        let ended = watch.end();
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    }
}

#[test]
fn a_signal_to_all_shards_leaves_no_undecided_frame() {
    for round in 0..3 {
        let folder = TempDir::new().unwrap();
        let service = service(&format!("shards-signal-{round}"));
        let watches = shards(folder.path(), &service, 3, &[]);
        let mut sim = Client::open(&service, &ClientOptions::lockstep()).unwrap();
        assert!(sim.wait_for_watcher(PATIENCE).unwrap());
        let sheet = Sheet::new(round);
        sheet.describe(&mut sim);
        let pids: Vec<u32> = watches.iter().map(|w| w.process.id()).collect();
        let signals = std::thread::spawn(move || {
            std::thread::sleep(Duration::from_millis(300));
            // The members first.
            for pid in pids.iter().rev() {
                let pid = pid.to_string();
                let sent = Command::new("kill").args(["-s", "INT", &pid]).status();
                assert!(sent.unwrap().success());
            }
        });
        loop {
            let positions = sheet.positions();
            let seq = sim.publish(0.0, Positions::F64(&positions)).unwrap();
            match sim.wait(seq, PATIENCE).unwrap() {
                Outcome::Verdict(message) => assert_eq!(message.verdict, Verdict::Intact),
                _ => break,
            }
        }
        signals.join().unwrap();
        for watch in watches {
            let ended = watch.end();
            assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        }
    }
}

#[test]
fn a_leader_waits_for_all_shards_and_names_those_that_are_missing() {
    let folder = TempDir::new().unwrap();
    let service = service("missing-shards");
    let wait = ["--wait", "0.5"];
    let watches = [
        shard(folder.path(), &service, 1, 4, &wait),
        shard(folder.path(), &service, 3, 4, &wait),
        shard(folder.path(), &service, 2, 3, &wait),
    ];
    let [leader, _, stranger] = watches.map(Watch::end);
    assert_eq!(leader.code, Some(3), "{}", leader.stderr);
    let waiting = "waiting for shard 2, 4 of 4";
    let all = "waiting for shard 2, 3, 4 of 4";
    let words = leader.stderr.contains(waiting) || leader.stderr.contains(all);
    assert!(words, "{}", leader.stderr);
    assert_eq!(stranger.code, Some(3), "{}", stranger.stderr);
}

#[test]
fn wrong_shards_are_refused_with_words() {
    for (args, words) in [
        (&["--shard", "3/2"][..], "expected K/N, such as 1/3"),
        (&["--shard", "1/1"], "expected K/N, such as 1/3"),
        (&["--shard", "0/2"], "expected K/N, such as 1/3"),
        (&["--shard", "1/17"], "2 to 16"),
        (&["--shard", "two"], "expected K/N, such as 1/3"),
        (&["--shard", "2/2", "--events"], "--events with --shard"),
        (
            &["--shard", "2/2", "--record", "x.mcap"],
            "an output option with --shard",
        ),
        (
            &["--shard", "2/2", "--metrics", "0"],
            "--metrics with --shard",
        ),
        (
            &["--shard", "1/2", "--service", "a", "--service", "b"],
            "--shard takes one --service",
        ),
    ] {
        let args: Vec<&str> = ["watch"].into_iter().chain(args.iter().copied()).collect();
        let (code, output) = printed(&args);
        assert_eq!(code, Some(2), "{args:?}: {output}");
        assert!(output.contains(words), "{args:?}: {output}");
    }
}
