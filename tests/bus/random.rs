//! Random sessions: watchers that start, leave and are killed, hostile sequence numbers and cuts,
//! in any order.

use super::death::Process;
use super::hostile::HostilePublisher;
use super::support::random::Random;
use super::*;
use linkwatch::{Departure, Outcome};

/// Returns a sequence number that a frame between `next - 1` and `next` cannot have.
fn hostile_number(random: &mut Random, next: u64) -> u64 {
    match random.below(8) {
        0 => u64::MAX,
        1 => u64::MAX - random.below(100),
        2 => 1 << (40 + random.below(24)),
        3 => next + 1 + random.below(100),
        4 => next + random.below(1 << 20),
        5 => random.below(next.max(1)),
        6 => next.saturating_sub(1),
        _ => random.next(),
    }
}

/// The newest frame of the simulator.
#[derive(Clone, Copy, Default)]
struct Published {
    seq: u64,
    cuts: u32,
}

/// Time stamp of hostile frames.
const HOSTILE: f64 = -1.0;

/// A watcher in this process, which runs only inside [`Watcher::work`].
struct Watcher {
    sidecar: Sidecar,
    set: Option<CurveSet>,
    session: Option<u64>,
    answered: u64,
    /// True if the last frame that it saw was hostile, and so may have been accepted.
    tainted: bool,
}

impl Watcher {
    fn new(name: &str) -> Watcher {
        Watcher {
            sidecar: sidecar(name),
            set: None,
            session: None,
            answered: 0,
            tainted: false,
        }
    }

    /// Answers every pending frame. Returns the end of the session, if it arrived.
    fn work(&mut self, newest: Published, random: &mut Random) -> Option<(u64, Counters)> {
        loop {
            match self.sidecar.wait(Duration::from_millis(5)).unwrap() {
                Event::Idle => return None,
                Event::Frame(frame) => {
                    answer(&mut self.sidecar, &frame, &mut self.set);
                    self.answered += 1;
                    self.session = Some(frame.session());
                    self.tainted = frame.time() == HOSTILE;
                    let newest_one = !self.tainted && frame.seq() == newest.seq;
                    assert!(!newest_one || frame.cuts() == newest.cuts);
                }
                Event::End {
                    published,
                    counters,
                    ..
                } => return Some((published, counters)),
                Event::NewSession { .. } | Event::Unreadable(_) => {}
                other => panic!("{other:?}"),
            }
            if random.below(10) == 0 {
                self.sidecar.heartbeat().unwrap();
            }
            let Counters {
                verified, rejected, ..
            } = self.sidecar.counters();
            assert_eq!(verified + rejected, self.answered);
        }
    }
}

/// Runs one simulator in lockstep, over `steps` random steps.
fn session(seed: u64, steps: usize) {
    let mut random = Random::new(seed);
    let name = service();
    let mut client = client(&name);
    let mut watcher: Option<Watcher> = None;
    let (mut publisher, mut id) = (None::<HostilePublisher>, None);
    let (mut seq, mut cuts, mut hostile, mut met) = (0, 0, 0, false);
    let mut newest = Published::default();
    for _ in 0..steps {
        match random.below(10) {
            0 => watcher = None,
            1 if watcher.is_none() => {
                let mut new = Watcher::new(&name);
                new.work(newest, &mut random);
                watcher = Some(new);
            }
            2 => {
                client.resume();
                cuts += 1;
            }
            3 | 4 if id.is_some() => {
                let number = hostile_number(&mut random, seq);
                let publisher = publisher.get_or_insert_with(|| HostilePublisher::open(&name));
                publisher.send(|h, _| (h.session, h.seq, h.time) = (id.unwrap(), number, HOSTILE));
                hostile += 1;
                if let Some(watcher) = &mut watcher {
                    let before = watcher.sidecar.counters().rejected;
                    watcher.work(newest, &mut random);
                    let rejected = watcher.sidecar.counters().rejected - before;
                    assert!(number < 1 << 53 || rejected > 0, "seed {seed}: {number}");
                }
            }
            _ => {
                publish(&mut client, seq);
                newest = Published { seq, cuts };
                let trusting = watcher.as_ref().is_some_and(|w| !w.tainted);
                if let Some(watcher) = &mut watcher {
                    watcher.work(newest, &mut random);
                    id = watcher.session;
                    met = true;
                }
                let patience = if met { LONG } else { Duration::ZERO };
                let what = format!("seed {seed}, frame {seq}");
                match without_time_out(&what, || client.wait(seq, patience)).unwrap() {
                    Outcome::Verdict(m) => {
                        assert!(watcher.is_some(), "seed {seed}");
                        assert_eq!(m.seq, seq);
                        let intact = m.verdict == Verdict::Intact;
                        assert!(intact || !trusting, "{what}: {m}");
                        assert!(m.counters.skipped <= seq + hostile || !intact, "{m}");
                    }
                    Outcome::NoWatcher(how) => {
                        assert!(watcher.is_none(), "{what}");
                        assert_eq!(how, Departure::Goodbye);
                    }
                    Outcome::Stale => assert!(!met, "{what}"),
                }
                seq += 1;
            }
        }
        assert!(client.aborted().is_none());
    }
    assert_eq!(client.finish().unwrap(), seq);
    if let Some(mut watcher) = watcher
        && let Some((published, counters)) = watcher.work(newest, &mut random)
    {
        assert!((seq..=seq + hostile).contains(&published), "seed {seed}");
        let Counters {
            verified,
            skipped,
            rejected,
        } = counters;
        assert!(verified + skipped + rejected >= published, "seed {seed}");
        assert!(skipped <= published, "seed {seed}: {counters:?}");
        assert!(rejected <= 2 * hostile, "seed {seed}: {counters:?}");
    }
}

#[test]
fn random_sessions_in_lockstep_wait_for_no_deadline() {
    for seed in 0..30 {
        session(seed, 60);
    }
}

#[test]
#[ignore = "takes minutes"]
fn hundreds_of_random_sessions_in_lockstep_wait_for_no_deadline() {
    for seed in 1000..1300 {
        session(seed, 100);
    }
}

/// Watchers in their own processes are killed, stopped and restarted while a simulator runs in
/// lockstep.
fn killed_watchers(seed: u64, rounds: usize) {
    let mut random = Random::new(seed);
    let name = service();
    let mut client = client(&name);
    let mut seq = 0;
    let mut step = |client: &mut Client, deadline: Duration| {
        publish(client, seq);
        seq += 1;
        let what = format!("seed {seed}, frame {}", seq - 1);
        without_time_out(what, || client.wait(seq - 1, deadline)).unwrap()
    };
    let pause = |random: &mut Random| {
        std::thread::sleep(Duration::from_millis(random.below(400)));
    };
    for round in 0..rounds {
        let watcher = Process::start("watcher", &name, None);
        // At first, frames may still be reported without the new watcher.
        until(
            format_args!("seed {seed}, round {round}: a verdict"),
            || matches!(step(&mut client, LONG), Outcome::Verdict(_)).then_some(()),
        );
        for _ in 0..random.below(40) {
            let outcome = step(&mut client, LONG);
            assert!(matches!(outcome, Outcome::Verdict(_)), "{outcome:?}");
        }
        if random.below(2) == 0 {
            watcher.stop();
            // On a loaded machine it answers a few more frames before the system has stopped it.
            let mut outcome = step(&mut client, Duration::from_millis(600));
            while matches!(outcome, Outcome::Verdict(_)) {
                outcome = step(&mut client, Duration::from_millis(600));
            }
            assert_eq!(outcome, Outcome::Stale, "seed {seed}, round {round}");
            if random.below(2) == 0 {
                watcher.signal("-CONT");
            }
        }
        pause(&mut random);
        watcher.kill();
        if random.below(2) == 0 {
            pause(&mut random);
        }
        for _ in 0..3 {
            let outcome = step(&mut client, LONG);
            let crashed = Outcome::NoWatcher(Departure::Crashed);
            assert_eq!(outcome, crashed, "seed {seed}, round {round}");
        }
    }
}

#[test]
fn watchers_killed_at_random_are_detected_before_any_deadline() {
    killed_watchers(1, 6);
}

#[test]
#[ignore = "takes minutes"]
fn hundreds_of_watchers_killed_at_random_are_detected_before_any_deadline() {
    for seed in 10..40 {
        killed_watchers(seed, 10);
    }
}
