//! Thickness of trefoils of 20 to 100,000 edges: the octree with one thread and with all.
//!
//! `cargo bench --bench thickness` measures; with `--smoke` (or under `cargo test`) it measures the
//! smallest ones only. The runs of one size alternate; all times are medians.
//!
//! If `../shared/models/octrope.json` has times of liboctrope, they are shown as well. They were
//! measured on such a machine, but on another day.

#[allow(dead_code, reason = "shared with the other benches")]
#[path = "study/src/measure.rs"]
mod measure;

use linkwatch::{Basis, CurveSet, Positions, Result, Thickness};
use measure::median;
use serde_json::Value;
use std::f64::consts::TAU;
use std::hint::black_box;
use std::path::Path;
use std::time::Instant;

/// Numbers of edges. Those of liboctrope's times are among them.
const SIZES: [u32; 16] = [
    20, 36, 50, 80, 100, 120, 150, 200, 500, 1000, 2000, 5000, 10_000, 20_000, 50_000, 100_000,
];

fn main() -> Result<()> {
    let args: Vec<String> = std::env::args().collect();
    let has = |word: &str| args.iter().any(|a| a == word);
    let smoke = !has("--bench") || has("--smoke");
    let known = times_of_liboctrope();
    let pool = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        pool.build().expect("a thread pool")
    };
    let (one, all) = (pool(1), pool(0));
    println!("times in ms, medians");
    println!(
        "{:>8} {:>9} {:>9} {:>10} {:>11} {:>11}",
        "edges", "1 thread", "all", "ns / edge", "liboctrope", "/ 1 thread"
    );
    for n in SIZES.into_iter().filter(|&n| !smoke || n <= 150) {
        let set = trefoil(n)?;
        let mut times = [Vec::new(), Vec::new()];
        let begin = Instant::now();
        while times[0].len() < 5 || !smoke && begin.elapsed().as_secs_f64() < 1.0 {
            let octree = || black_box(Thickness::of(&set, None)).is_ok();
            times[0].push(ms(|| one.install(octree)));
            times[1].push(ms(|| all.install(octree)));
        }
        let [one, all] = times.map(median);
        let found = known.iter().find(|(edges, _)| *edges == u64::from(n));
        let theirs = found.map_or(f64::NAN, |(_, ms)| *ms);
        println!(
            "{n:>8} {one:>9.4} {all:>9.4} {:>10.0} {theirs:>11.4} {:>11.1}",
            one * 1e6 / f64::from(n),
            theirs / one
        );
    }
    Ok(())
}

/// Returns the time of a run that must succeed, in milliseconds.
fn ms(run: impl FnOnce() -> bool) -> f64 {
    let start = Instant::now();
    assert!(run());
    start.elapsed().as_secs_f64() * 1e3
}

/// The trefoil of Ashton and Cantarella 2005, section 6, at equally spaced parameters.
fn trefoil(n: u32) -> Result<CurveSet> {
    let point = |k: u32| {
        let t = TAU * f64::from(k) / f64::from(n);
        let r = 1.0 + 2.0 / 3.0 * (3.0 * t).cos();
        let z = 2.0 / 3.0 * (3.0 * t).sin();
        [r * (2.0 * t).cos(), r * (2.0 * t).sin(), z]
    };
    let xyz: Vec<f64> = (0..n).flat_map(point).collect();
    CurveSet::from_counts(Basis::Polyline, &[-(n as i32)], Positions::F64(&xyz))
}

/// Returns the edges of the trefoils that liboctrope measured, and its times in milliseconds.
fn times_of_liboctrope() -> Vec<(u64, f64)> {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/models/octrope.json");
    let content = std::fs::read_to_string(file).unwrap_or_default();
    let known: Value = serde_json::from_str(&content).unwrap_or_default();
    let time = |curve: &Value| {
        let trefoil = curve["name"].as_str()?.starts_with("trefoil");
        let edges = curve["n"].as_u64().filter(|_| trefoil)?;
        Some((edges, curve["median_s"].as_f64()? * 1e3))
    };
    let curves = known["curves"].as_array();
    curves.map_or_else(Vec::new, |all| all.iter().filter_map(time).collect())
}
