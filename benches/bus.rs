//! Cost of a frame on the bus, compared with a copy of the same bytes.
//!
//! `cargo bench --bench bus` measures; with `--smoke` (or under `cargo test`) it runs each step
//! once. Names of cases (`-- yarn/f32`) select some of them.
//! Percentiles are over all rounds of one run. Every ratio is relative to the copy of the same
//! frame.

use linkwatch::scenes::{Frames, Motion, Scene};
use linkwatch::{
    Basis, Client, ClientOptions, CurveSet, Event, Events, FrameInfo, Outcome, Positions,
    Precision, Report, Session, SessionOptions, Sidecar, SidecarOptions, Strategy, Verdict,
    WaitMode,
};
use std::hint::black_box;
use std::time::{Duration, Instant};

const DEADLINE: Duration = Duration::from_secs(20);

/// Number of frames of the motion, which repeats.
const FRAMES: u64 = 8;

/// Number of first frames after each of which the watcher waits for a reference frame.
const SETTLED: u64 = 3;

struct Case {
    name: &'static str,
    /// Empty: two linked pentagons, 120 bytes.
    scene: &'static str,
    precision: Precision,
}

const CASES: [Case; 4] = [
    Case {
        name: "tiny/f32",
        scene: "",
        precision: Precision::F32,
    },
    Case {
        name: "chainmail/f32",
        scene: "chainmail",
        precision: Precision::F32,
    },
    Case {
        name: "yarn/f32",
        scene: "knit:rows=70,stitches=126,segments=211680",
        precision: Precision::F32,
    },
    Case {
        name: "yarn/f64",
        scene: "knit:rows=70,stitches=126,segments=211680",
        precision: Precision::F64,
    },
];

/// Frames of a case.
struct Input {
    basis: Basis,
    precision: Precision,
    counts: Vec<i32>,
    /// Positions of all frames, in both precisions.
    single: Vec<Vec<f32>>,
    double: Vec<Vec<f64>>,
}

impl Input {
    /// Generates a motion of quiet frames: waves of a thousandth of a unit, and a translation of
    /// the whole scene.
    fn new(case: &Case) -> Input {
        let set = match case.scene {
            "" => pentagons(),
            scene => {
                scene
                    .parse::<Scene>()
                    .expect("a scene")
                    .build()
                    .expect("fits")
                    .curves
            }
        };
        let motion: Motion = "smooth+translate".parse().expect("a motion");
        let mut frames = Frames::new(&set, 0.1);
        let of = |frame| match frames.at(&motion, 0.001, frame) {
            Positions::F32(v) => v.iter().map(|&x| f64::from(x)).collect(),
            Positions::F64(v) => v.to_vec(),
        };
        let double: Vec<Vec<f64>> = (0..FRAMES).map(of).collect();
        let narrow = |v: &Vec<f64>| v.iter().map(|&x| x as f32).collect();
        Input {
            basis: set.basis(),
            precision: case.precision,
            counts: set.counts().collect(),
            single: double.iter().map(narrow).collect(),
            double,
        }
    }

    /// Returns the positions of a frame.
    fn at(&self, frame: u64) -> Positions<'_> {
        let k = (frame % FRAMES) as usize;
        match self.precision {
            Precision::F32 => Positions::F32(&self.single[k]),
            Precision::F64 => Positions::F64(&self.double[k]),
        }
    }

    fn bytes(&self) -> usize {
        self.at(0).len() * self.precision.bytes()
    }
}

fn pentagons() -> CurveSet {
    let corner = |k: usize| (k as f64 * std::f64::consts::TAU / 5.0).sin_cos();
    let flat = (0..5).map(corner).flat_map(|(s, c)| [c, s, 0.0]);
    let upright = (0..5).map(corner).flat_map(|(s, c)| [1.0 + c, 0.0, s]);
    let points: Vec<f64> = flat.chain(upright).collect();
    CurveSet::from_counts(Basis::Polyline, &[-5, -5], Positions::F64(&points)).expect("good")
}

fn main() {
    let args: Vec<String> = std::env::args().collect();
    let has = |word: &str| args.iter().any(|a| a == word);
    let rounds = if has("--bench") && !has("--smoke") {
        2000
    } else {
        20
    };
    println!("{rounds} rounds, microseconds p50 / p99, and p50 over the copy's");
    let named = |case: &&Case| args.iter().any(|a| a == case.name);
    let all = !CASES.iter().any(|case| named(&case));
    for case in CASES.iter().filter(|case| all || named(case)) {
        measure(case, rounds);
    }
}

fn measure(case: &Case, rounds: u64) {
    let input = Input::new(case);
    let (curves, bytes) = (input.counts.len(), input.bytes());
    println!("\n{}: {curves} curves, {bytes} bytes", case.name);

    let from: Vec<u8> = (0..bytes).map(|k| k as u8).collect();
    let mut to = vec![0u8; bytes];
    let copy = times(rounds, |_| {
        black_box(&mut to).copy_from_slice(black_box(&from))
    });
    let base = copy[copy.len() / 2];
    let show = |what: &str, sorted: &[Duration]| {
        let at = |q: usize| sorted[(sorted.len() - 1) * q / 100].as_secs_f64() * 1e6;
        let ratio = at(50) / (base.as_secs_f64() * 1e6).max(1e-3);
        println!(
            "  {what:<34} {:>9.1} / {:>9.1}  {ratio:>6.2}",
            at(50),
            at(99)
        );
    };
    show("copy", &copy);

    let set = CurveSet::from_counts(input.basis, &input.counts, input.at(0));
    let mut set = set.expect("good");
    let update = times(rounds, |k| {
        set.update(black_box(input.at(k))).expect("good");
    });
    show("ingest from private memory", &update);

    for mode in WaitMode::ALL {
        for verify in [false, true] {
            let verdict = match verify {
                false => "the verdict is sent without verification",
                true => "incremental verification, with pull-throughs",
            };
            println!("  both sides wait by {mode}; {verdict}:");
            exchange(&input, rounds, mode, verify, &show);
        }
    }
}

/// Measures a session.
fn exchange(
    input: &Input,
    rounds: u64,
    mode: WaitMode,
    verify: bool,
    show: &impl Fn(&str, &[Duration]),
) {
    let name = format!("linkwatch bench {}", std::process::id());
    let mut options = ClientOptions::lockstep();
    options.wait_mode = mode;
    let mut client = Client::open(&name, &options).expect("client");
    client
        .describe(input.basis, input.precision, &input.counts)
        .expect("describe");
    if !verify {
        let alone = times(rounds, |k| {
            client.publish(0.0, input.at(k)).expect("publish");
        });
        show("write and publish, without a watcher", &alone);
    }

    let watcher = std::thread::spawn({
        let mut options = SidecarOptions::default();
        options.wait_mode = mode;
        let sidecar = Sidecar::open(&name, &options).expect("sidecar");
        move || watch(sidecar, verify.then(session))
    });
    assert!(client.wait_for_watcher(DEADLINE).expect("handshake"));
    let mut published = Vec::new();
    let trip = times(rounds, |k| {
        let mut frame = client.loan(k as f64).expect("loan");
        match input.at(k) {
            Positions::F32(v) => frame.positions_f32().expect("single").copy_from_slice(v),
            Positions::F64(v) => frame.positions_f64().expect("double").copy_from_slice(v),
        }
        let start = Instant::now();
        let seq = frame.publish().expect("publish");
        match client.wait(seq, DEADLINE).expect("wait") {
            Outcome::Verdict(m) => assert_eq!(m.verdict, Verdict::Intact),
            other => panic!("frame {seq}: {other:?}"),
        }
        published.push(start.elapsed());
    });
    published.sort();
    show("published to verdict", &published);
    show("write, publish, ingest, verdict", &trip);
    if !verify {
        let free = times(rounds, |k| {
            client.publish(0.0, input.at(k)).expect("publish");
            client.poll().expect("poll");
        });
        show("write, publish, poll, free-running", &free);
    }
    client.finish().expect("finish");
    let mut watched = watcher.join().expect("watcher");
    watched.ingest.sort();
    show("ingest from shared memory", &watched.ingest);
    if verify {
        watched.verification.sort();
        show("verification", &watched.verification);
        let [full, quiet, partial] = watched.routes;
        println!("  frames: {quiet} quiet, {partial} partial, {full} full");
    }
}

fn session() -> Session {
    let options = SessionOptions {
        strategy: Strategy::Incremental,
        events: Events::Between,
        ..SessionOptions::default()
    };
    Session::new(options).expect("valid options")
}

/// Times of a watcher.
#[derive(Default)]
struct Watched {
    ingest: Vec<Duration>,
    verification: Vec<Duration>,
    /// Number of frames on the full, the quiet and the partial route.
    routes: [u64; 3],
}

/// Answers every frame.
fn watch(mut sidecar: Sidecar, mut session: Option<Session>) -> Watched {
    let mut watched = Watched::default();
    let mut set = None;
    loop {
        match sidecar.wait(DEADLINE).expect("wait") {
            Event::Frame(frame) => {
                let start = Instant::now();
                let (seq, time) = (frame.seq(), frame.time());
                let received = session.as_mut().map(|session| {
                    session.receive(FrameInfo::at(seq, time), |copy| frame.read(copy))
                });
                if received.is_none() {
                    frame.ingest(&mut set).expect("a good frame");
                }
                drop(frame);
                let ingested = Instant::now();
                watched.ingest.push(ingested - start);
                let report = match session.as_mut().zip(received) {
                    Some((session, received)) => {
                        let verified = session.verify(received).expect("a frame");
                        watched.routes[verified.work.route as usize] += 1;
                        verified.report
                    }
                    None => Report::new(seq, time, Verdict::Intact),
                };
                watched.verification.push(ingested.elapsed());
                sidecar
                    .send_verdict(&report, start.elapsed())
                    .expect("send");
                if let Some(session) = session.as_mut().filter(|_| seq < SETTLED) {
                    session.settle();
                }
            }
            Event::NewSession { .. } => {}
            Event::End {
                published,
                counters,
                ..
            } => {
                assert_eq!(counters.verified + counters.skipped, published);
                return watched;
            }
            other => panic!("{other:?}"),
        }
    }
}

/// Returns the times of all rounds, sorted.
fn times(rounds: u64, mut work: impl FnMut(u64)) -> Vec<Duration> {
    let mut out: Vec<Duration> = (0..rounds)
        .map(|k| {
            let start = Instant::now();
            work(k);
            start.elapsed()
        })
        .collect();
    out.sort();
    out
}
