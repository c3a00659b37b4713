//! Work of 1 to 4 verifiers that share the pairs of a scene, relative to a single verifier.
//!
//! `cargo bench --bench shards` measures; with `--smoke` (or under `cargo test`) it runs each step
//! twice. Names of cases (`-- chainmail`) select some of them.
//!
//! All verifiers run in this process, one after another, each with one thread: the total work is
//! the sum of their times, with the copy of the frame and the join. The wall time with a machine
//! for each is the time of the slowest one, and the join. Single and shared runs of each frame
//! alternate; all figures are medians over frames.

use linkwatch::lab::median;
use linkwatch::scenes::{Frames, Motion, Scene};
use linkwatch::{
    CurveSet, Events, Joiner, Partition, RawFrame, Report, Result, Stats, Strategy, Verifier,
    VerifierOptions,
};
use std::sync::Arc;
use std::time::Instant;

/// Name, scene, scene of a smoke run.
const CASES: [[&str; 3]; 4] = [
    ["chainmail", "chainmail", "chainmail:rows=4,columns=5"],
    [
        "crumpled",
        "chainmail:crumple=1",
        "chainmail:rows=4,columns=5,crumple=1",
    ],
    ["garment", "knit", "knit:rows=3,stitches=16,segments=576"],
    [
        "woundball",
        "woundball",
        "woundball:segments=2000,crossings=11",
    ],
];

/// Number of first frames that are not measured.
const WARM_UP: usize = 2;

fn main() -> Result<()> {
    let args: Vec<String> = std::env::args().collect();
    let has = |word: &str| args.iter().any(|a| a == word);
    let smoke = !has("--bench") || has("--smoke");
    let named = |case: &&[&str; 3]| args.iter().any(|a| a == case[0]);
    let all = !CASES.iter().any(|case| named(&case));
    println!("total work and wall time over those of one verifier, medians");
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let pool = pool.expect("a pool of one thread");
    pool.install(|| {
        for [name, usual, small] in CASES.iter().filter(|case| all || named(case)) {
            measure(name, if smoke { small } else { usual }, smoke)?;
        }
        Ok(())
    })
}

fn measure(name: &str, scene: &str, smoke: bool) -> Result<()> {
    let set = scene.parse::<Scene>()?.build()?.curves;
    let motion: Motion = "smooth+translate".parse()?;
    let mut frames = Frames::new(&set, 0.1);
    // Far more than the allowances, so that the frames are not quiet.
    let amplitude = 0.02;
    let count = if smoke { 2 } else { 15 } + WARM_UP;
    println!(
        "\n{name}: {} curves, {} segments",
        set.len(),
        set.segments()
    );
    for (title, strategy, events) in [
        ("full run", Strategy::Full, Events::Off),
        ("full run, pull-throughs", Strategy::Full, Events::Between),
        (
            "incremental, pull-throughs",
            Strategy::Incremental,
            Events::Between,
        ),
    ] {
        for shards in 1..=4 {
            let options = || VerifierOptions {
                strategy,
                events,
                ..VerifierOptions::default()
            };
            let mut single = Shard::new(&options())?;
            let mut several = (0..shards)
                .map(|_| Shard::new(&options()))
                .collect::<Result<Vec<Shard>>>()?;
            let mut joiner = Joiner::new(shards, events);
            let mut ratios = Vec::new();
            for k in 0..count {
                let counts: Vec<i32> = set.counts().collect();
                let raw = RawFrame {
                    basis: set.basis(),
                    counts: &counts,
                    positions: frames.at(&motion, amplitude * k as f64, 1),
                };
                let (report, alone) = single.step(k, raw)?;
                if k == 0 {
                    let partition = Partition::new(&set, shards)?;
                    for (k, shard) in several.iter_mut().enumerate() {
                        shard.verifier.verify_share(partition.share(k))?;
                    }
                }
                let mut times = Vec::new();
                let mut parts = Vec::new();
                for shard in &mut several {
                    let (report, time) = shard.step(k, raw)?;
                    times.push(time);
                    parts.push(Ok(shard.verifier.part(report)));
                }
                let start = Instant::now();
                let joined = joiner.join(k as u64, 0.0, parts);
                let join = start.elapsed().as_secs_f64();
                assert_eq!(findings(joined), findings(report), "{name}, frame {k}");
                let total: f64 = times.iter().sum();
                let slowest = times.iter().copied().fold(0.0, f64::max);
                if k >= WARM_UP {
                    ratios.push([(total + join) / alone, (slowest + join) / alone, alone]);
                }
            }
            let of = |n: usize| median(ratios.iter().map(|r| r[n]));
            let [work, wall, alone] = [of(0), of(1), of(2) * 1e3];
            println!(
                "  {title:<27} {shards} shards: work {work:.2}, wall {wall:.2} of {alone:.2} ms"
            );
        }
    }
    Ok(())
}

/// A verifier, and its copy of the frame.
struct Shard {
    verifier: Verifier,
    /// Copies of the current frame and of the previous one.
    sets: [Option<Arc<CurveSet>>; 2],
}

impl Shard {
    fn new(options: &VerifierOptions) -> Result<Shard> {
        Ok(Shard {
            verifier: Verifier::new(options.clone())?,
            sets: [None, None],
        })
    }

    /// Copies and verifies a frame. Returns the time in seconds, too.
    fn step(&mut self, k: usize, raw: RawFrame<'_>) -> Result<(Report, f64)> {
        let start = Instant::now();
        self.sets.rotate_right(1);
        let mut set = self.sets[0].take().and_then(Arc::into_inner);
        self.verifier.receive(raw, &mut set)?;
        let set = Arc::new(set.expect("received"));
        let report = self.verifier.step_shared(k as u64, 0.0, &set)?;
        self.sets[0] = Some(set);
        let time = start.elapsed().as_secs_f64();
        // The time of a reference frame is not that of a verdict.
        self.verifier.settle();
        Ok((report, time))
    }
}

/// Returns what must be equal: all but the work, and the safe fraction of a step with findings.
fn findings(mut report: Report) -> Report {
    report.stats = Stats::default();
    report.safe_fraction = report.safe_fraction.filter(|&safe| safe == 1.0);
    report
}
