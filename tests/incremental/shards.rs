//! Several verifiers that share the pairs of curves, against a single one.

use crate::movie::Movie;
use crate::sets::{MOST, random_set};
use crate::support::random::Random;
use linkwatch::{
    Basis, Certificate, CurveChange, CurveLabels, Events, Joiner, Part, Partition, Precision,
    Report, Stats, Strategy, Verdict, Verifier, VerifierOptions,
};
use std::ops::Range;

/// What happened in the frames of all sequences.
#[derive(Debug, Default)]
struct Tally {
    frames: u32,
    intact: u32,
    changed: u32,
    undecided: u32,
    pull_throughs: u32,
    changes_of_curves: u32,
    cuts: u32,
    killed: u32,
    quiet: u32,
    partial: u32,
}

impl Tally {
    fn add(&mut self, report: &Report) {
        self.frames += 1;
        match report.verdict {
            Verdict::Intact => self.intact += 1,
            Verdict::Changed => self.changed += 1,
            _ => self.undecided += 1,
        }
        self.pull_throughs += report.events.len() as u32;
    }
}

/// Verifiers of all shards, and the join of their parts.
struct Shards {
    partition: Partition,
    verifiers: Vec<Verifier>,
    joiner: Joiner,
    events: Events,
    strategies: Vec<Strategy>,
}

fn verifier(strategy: Strategy, events: Events, baseline: Option<Certificate>) -> Verifier {
    Verifier::new(VerifierOptions {
        strategy,
        events,
        baseline,
        ..VerifierOptions::default()
    })
    .unwrap()
}

impl Shards {
    fn new(random: &mut Random, set: &linkwatch::CurveSet, events: Events) -> Shards {
        let count = 1 + random.below(5);
        let partition = Partition::new(set, count).unwrap();
        let strategies = (0..count).map(|_| {
            random.pick(&[
                Strategy::Incremental,
                Strategy::Incremental,
                Strategy::Full,
                Strategy::Paranoid,
            ])
        });
        let strategies: Vec<Strategy> = strategies.collect();
        let share = |(k, &strategy): (usize, &Strategy)| {
            let mut verifier = verifier(strategy, events, None);
            verifier.verify_share(partition.share(k)).unwrap();
            verifier
        };
        Shards {
            verifiers: strategies.iter().enumerate().map(share).collect(),
            joiner: Joiner::new(count, events),
            partition,
            events,
            strategies,
        }
    }

    fn step(&mut self, seq: u64, set: &linkwatch::CurveSet, killed: Option<usize>) -> Report {
        let verifiers = self.verifiers.iter_mut().enumerate();
        let parts = verifiers.map(|(k, verifier)| -> Result<Part, String> {
            if killed == Some(k) {
                return Err(format!("shard {} was killed", k + 1));
            }
            let report = verifier.step(seq, 0.0, set).unwrap();
            assert!(!verifier.work().disagreed);
            Ok(verifier.part(report))
        });
        let parts = parts.collect();
        let report = self.joiner.join(seq, 0.0, parts);
        if let Some(k) = killed {
            let baseline = self.joiner.baseline(k).expect("a part of the first frame");
            let mut fresh = verifier(self.strategies[k], self.events, Some(baseline.clone()));
            fresh.verify_share(self.partition.share(k)).unwrap();
            self.verifiers[k] = fresh;
        }
        report
    }
}

/// Returns what must be equal, whoever verifies: all but the work, and the safe fraction of a step
/// with findings.
fn findings(mut report: Report) -> Report {
    report.stats = Stats::default();
    if report.safe_fraction != Some(1.0) {
        report.safe_fraction = None;
    }
    report
}

fn sequences(basis: Basis, precision: Precision, seeds: Range<u64>, many: bool) -> Tally {
    let mut tally = Tally::default();
    for seed in seeds {
        let mut random = Random::new(seed);
        let curves = match many {
            true => 40 + random.below(50),
            false => 2 + random.below(MOST - 1),
        };
        let set = random_set(&mut random, basis, precision, curves);
        let events = random.pick(&[Events::Off, Events::Between, Events::All]);
        let what = format!("seed {seed}, {basis:?}, {precision:?}, events {events}");
        let mut shards = Shards::new(&mut random, &set, events);
        let mut single = verifier(Strategy::Incremental, events, None);
        let mut movie = Movie::new(Random::new(random.next()), set);
        for frame in 0..25 {
            movie.advance(frame);
            if frame > 0 && random.one_in(12) {
                tally.cuts += 1;
                single.cut();
                shards.verifiers.iter_mut().for_each(Verifier::cut);
                shards.joiner.cut();
            }
            // In some frames the reference frame is ready, however busy the machine is.
            if random.one_in(2) {
                shards.verifiers.iter_mut().for_each(Verifier::settle);
            }
            let wanted = single.step(frame, 0.0, &movie.set).unwrap();
            let report = shards.step(frame, &movie.set, None);
            tally.add(&report);
            let routes = shards.verifiers.iter().map(|v| v.work().route);
            for route in routes {
                tally.quiet += u32::from(route == linkwatch::Route::Quiet);
                tally.partial += u32::from(route == linkwatch::Route::Partial);
            }
            assert_eq!(findings(report), findings(wanted), "{what}, frame {frame}");
            assert_eq!(
                shards.joiner.whole_baseline().as_ref(),
                single.baseline(),
                "{what}, frame {frame}"
            );
        }
    }
    tally
}

/// Runs sequences in which shards are killed and replaced. A finding is never lost without a word,
/// and linking numbers are still compared with those of the first frame.
fn sequences_with_kills(basis: Basis, seeds: Range<u64>) -> Tally {
    let mut tally = Tally::default();
    for seed in seeds {
        let mut random = Random::new(seed);
        let curves = 2 + random.below(MOST - 1);
        let set = random_set(&mut random, basis, Precision::F64, curves);
        let events = random.pick(&[Events::Off, Events::Between, Events::All]);
        let what = format!("seed {seed}, {basis:?}, events {events}");
        let mut shards = Shards::new(&mut random, &set, events);
        let mut single = verifier(Strategy::Full, events, None);
        let mut movie = Movie::new(Random::new(random.next()), set);
        let mut undefined = Certificate::default();
        for frame in 0..25 {
            movie.advance(frame);
            let kill = frame > 0 && random.one_in(4);
            let killed = kill.then(|| random.below(shards.verifiers.len()));
            let wanted = single.step(frame, 0.0, &movie.set).unwrap();
            let report = shards.step(frame, &movie.set, killed);
            if frame == 0 {
                undefined = single.baseline().unwrap().clone();
            }
            tally.add(&report);
            tally.killed += u32::from(kill);
            assert!(
                killed.is_none() || !report.missing.is_empty(),
                "{what}, frame {frame}"
            );
            assert!(
                report.missing.is_empty() || report.verdict != Verdict::Intact,
                "{what}, frame {frame}"
            );
            let lacks = |i: u32, j: Option<u32>| {
                let of = |d: &linkwatch::Defect| (d.i, d.j) == (i, j);
                undefined.undefined.iter().any(of)
            };
            let known = |c: &&linkwatch::Change| {
                !lacks(c.i, Some(c.j)) && !lacks(c.i, None) && !lacks(c.j, None)
            };
            let owned = |c: &&linkwatch::Change| {
                killed.is_none_or(|k| shards.partition.owner(c.i, c.j) != k)
            };
            let found: Vec<_> = report.changes.iter().filter(known).collect();
            let expected: Vec<_> = wanted.changes.iter().filter(known).filter(owned).collect();
            assert_eq!(found, expected, "{what}, frame {frame}");
            if report.verdict == Verdict::Intact {
                assert!(wanted.events.is_empty(), "{what}, frame {frame}");
            }
            if report.last_intact == Some(frame) && events != Events::Off {
                assert_eq!(wanted.last_intact, Some(frame), "{what}, frame {frame}");
            }
        }
    }
    tally
}

/// Runs sequences in which curves appear, leave and change places.
fn sequences_with_changes_of_curves(basis: Basis, seeds: Range<u64>) -> Tally {
    let mut tally = Tally::default();
    for seed in seeds {
        let mut random = Random::new(seed);
        let all = 7;
        let set = random_set(&mut random, basis, Precision::F32, all);
        let events = random.pick(&[Events::Between, Events::All]);
        let what = format!("seed {seed}, {basis:?}, events {events}");
        let mut active: Vec<usize> = (0..4).collect();
        let mut waiting: Vec<usize> = (4..all).collect();
        let mut movie = Movie::new(Random::new(random.next()), set);
        let first = crate::curves::some_curves(&movie.set, &active);
        let mut shards = Shards::new(&mut random, &first, events);
        let mut single = verifier(Strategy::Full, events, None);
        for frame in 0..25 {
            movie.advance(frame);
            let before = active.clone();
            if frame > 0 && random.one_in(4) {
                crate::curves::change(&mut random, &mut active, &mut waiting);
            }
            let set = crate::curves::some_curves(&movie.set, &active);
            if active != before {
                tally.changes_of_curves += 1;
                let names = [&before, &active]
                    .map(|curves| CurveLabels::named(curves.iter().map(|i| format!("curve {i}"))));
                let change = CurveChange::by_name(&names[0], &names[1]).unwrap();
                single.change_curves(change.clone());
                for verifier in &mut shards.verifiers {
                    verifier.change_curves(change.clone());
                }
                shards.joiner.change_curves();
            }
            let wanted = single.step(frame, 0.0, &set).unwrap();
            let report = shards.step(frame, &set, None);
            tally.add(&report);
            assert_eq!(findings(report), findings(wanted), "{what}, frame {frame}");
        }
    }
    tally
}

fn all_sequences(count: u64) -> u32 {
    let mut frames = 0;
    for (k, basis) in (0..).zip(Basis::ALL) {
        for precision in [Precision::F32, Precision::F64] {
            let first = 400_000 + 10_000 * k;
            let tally = sequences(basis, precision, first..first + count, false);
            println!("{basis:?}, {precision:?}: {tally:?}");
            let least = tally.frames / 50;
            assert!(tally.intact > least && tally.changed > least, "{tally:?}");
            assert!(tally.quiet > least && tally.partial > least, "{tally:?}");
            frames += tally.frames;
        }
        let many = 450_000 + 10_000 * k;
        let tally = sequences(basis, Precision::F32, many..many + count / 8 + 1, true);
        println!("{basis:?}, many curves: {tally:?}");
        frames += tally.frames;
        let kills = 500_000 + 10_000 * k;
        let tally = sequences_with_kills(basis, kills..kills + count);
        println!("{basis:?}, with kills: {tally:?}");
        assert!(
            tally.killed > tally.frames / 8 && tally.intact > 0,
            "{tally:?}"
        );
        frames += tally.frames;
        let changes = 550_000 + 10_000 * k;
        let tally = sequences_with_changes_of_curves(basis, changes..changes + count);
        println!("{basis:?}, with changes of curves: {tally:?}");
        assert!(tally.changes_of_curves > tally.frames / 20, "{tally:?}");
        frames += tally.frames;
    }
    frames
}

#[test]
fn shards_find_together_what_one_verifier_finds() {
    assert!(all_sequences(8) > 2_000);
}

/// The same test with more than 10,000 frames.
#[test]
#[ignore = "takes minutes"]
fn very_many_frames_of_shards() {
    let frames = all_sequences(100);
    println!("{frames} frames");
    assert!(frames > 10_000);
}
