//! Cost of a frame on the bus, compared with a copy of the same bytes.
//!
//! `cargo bench --bench bus` measures; with `--smoke` (or under `cargo test`) it runs each step
//! once.
//! Percentiles are over all rounds of one run. Every ratio is relative to the copy of the same
//! frame.

use linkwatch::{
    Basis, Client, ClientOptions, CurveSet, Event, Outcome, Positions, Precision, Report, Sidecar,
    SidecarOptions, Verdict, WaitMode,
};
use std::hint::black_box;
use std::time::{Duration, Instant};

const DEADLINE: Duration = Duration::from_secs(20);

struct Case {
    name: &'static str,
    curves: usize,
    points_each: i32,
    precision: Precision,
}

const CASES: [Case; 4] = [
    Case {
        name: "tiny/f32",
        curves: 2,
        points_each: 5,
        precision: Precision::F32,
    },
    Case {
        name: "chainmail/f32",
        curves: 14_112,
        points_each: 15,
        precision: Precision::F32,
    },
    Case {
        name: "yarn/f32",
        curves: 70,
        points_each: 3_024,
        precision: Precision::F32,
    },
    Case {
        name: "yarn/f64",
        curves: 70,
        points_each: 3_024,
        precision: Precision::F64,
    },
];

fn main() {
    let args: Vec<String> = std::env::args().collect();
    let has = |word: &str| args.iter().any(|a| a == word);
    let rounds = if has("--bench") && !has("--smoke") {
        2000
    } else {
        20
    };
    println!("{rounds} rounds, microseconds p50 / p99, and p50 over the copy's");
    for case in &CASES {
        measure(case, rounds);
    }
}

fn measure(case: &Case, rounds: u64) {
    let counts = vec![-case.points_each; case.curves];
    let n = 3 * case.curves * case.points_each as usize;
    let single: Vec<f32> = (0..n).map(|k| k as f32 * 0.001).collect();
    let double: Vec<f64> = single.iter().map(|&x| f64::from(x)).collect();
    let positions = match case.precision {
        Precision::F32 => Positions::F32(&single),
        Precision::F64 => Positions::F64(&double),
    };
    let bytes = n * case.precision.bytes();
    println!("\n{}: {} curves, {bytes} bytes", case.name, case.curves);

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

    let mut set = CurveSet::from_counts(Basis::Polyline, &counts, positions).expect("good");
    let update = times(rounds, |_| set.update(black_box(positions)).expect("good"));
    show("ingest from private memory", &update);

    for mode in WaitMode::ALL {
        println!("  both sides wait by --wait-mode {mode}:");
        exchange(case, &counts, positions, rounds, mode, &show);
    }
}

/// Measures a session.
fn exchange(
    case: &Case,
    counts: &[i32],
    positions: Positions<'_>,
    rounds: u64,
    mode: WaitMode,
    show: &impl Fn(&str, &[Duration]),
) {
    let name = format!("linkwatch bench {}", std::process::id());
    let mut options = ClientOptions::lockstep();
    options.wait_mode = mode;
    let mut client = Client::open(&name, &options).expect("client");
    client
        .describe(Basis::Polyline, case.precision, counts)
        .expect("describe");
    let alone = times(rounds, |_| {
        client.publish(0.0, positions).expect("publish");
    });
    show("write and publish, without a watcher", &alone);

    let watcher = std::thread::spawn({
        let mut options = SidecarOptions::default();
        options.wait_mode = mode;
        let sidecar = Sidecar::open(&name, &options).expect("sidecar");
        move || watch(sidecar)
    });
    assert!(client.wait_for_watcher(DEADLINE).expect("handshake"));
    let trip = times(rounds, |k| {
        let seq = client.publish(k as f64, positions).expect("publish");
        match client.wait(seq, DEADLINE).expect("wait") {
            Outcome::Verdict(m) => assert_eq!(m.verdict, Verdict::Intact),
            other => panic!("frame {seq}: {other:?}"),
        }
    });
    show("write, publish, ingest, verdict", &trip);
    let free = times(rounds, |_| {
        client.publish(0.0, positions).expect("publish");
        client.poll().expect("poll");
    });
    show("write, publish, poll, free-running", &free);
    client.finish().expect("finish");
    let mut ingest = watcher.join().expect("watcher");
    ingest.sort();
    show("ingest from shared memory", &ingest);
}

/// Answers every frame. Returns the time of each ingest.
fn watch(mut sidecar: Sidecar) -> Vec<Duration> {
    let (mut set, mut times) = (None, Vec::new());
    loop {
        match sidecar.wait(DEADLINE).expect("wait") {
            Event::Frame(frame) => {
                let start = Instant::now();
                frame.ingest(&mut set).expect("a good frame");
                times.push(start.elapsed());
                let report = Report::new(frame.seq(), frame.time(), Verdict::Intact);
                sidecar
                    .send_verdict(&report, start.elapsed())
                    .expect("send");
            }
            Event::NewSession { .. } => {}
            Event::End {
                published,
                counters,
                ..
            } => {
                assert_eq!(counters.verified + counters.skipped, published);
                return times;
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
