//! `--repeat` of `linkwatch certify` and `plan`: median times of a certificate, stage by stage.
//!
//! Measures the work from control points in memory to the sorted linking numbers. "First" is a new
//! certifier, which allocates its buffers. "Later" is the same certifier again.

use super::Outcome;
use super::output::{self, count, percent};
use linkwatch::kernels::Device;
use linkwatch::lab::{Effort, Run, StageTimes, peak_mb};
use linkwatch::{CurveSet, Result};
use serde_json::json;
use std::path::Path;

/// Certifies curves `n` times with a new certifier, and again with the same one. Returns the last
/// run, and the medians of the first and of the later runs.
pub fn measure(set: &CurveSet, n: u32, device: &Device) -> Result<(Run, [StageTimes; 2])> {
    let runs = Effort::runs(n).repeat(|| Run::first_and_later(device, set, None));
    let runs = runs.collect::<Result<Vec<_>>>()?;
    let [last, _] = runs[0];
    let times = [0, 1].map(|k| {
        let times: Vec<StageTimes> = runs.iter().map(|run| run[k].times).collect();
        StageTimes::median(&times)
    });
    Ok((last, times))
}

/// Certifies the curves of a model or a scene `n` times and prints medians.
pub fn run(name: &Path, set: &CurveSet, n: u32, device: &Device, as_json: bool) -> Result<Outcome> {
    let (run, [first, later]) = measure(set, n, device)?;
    let (stats, threads) = (run.stats, rayon::current_num_threads());
    if as_json {
        output::json(&json!({
            "model": name,
            "repeat": n,
            "threads": threads,
            "first": first,
            "later": later,
            "links": run.links,
            "undefined": run.undefined,
            "stats": stats,
            "exact_share": stats.exact_share(),
            "peak_mb": peak_mb(),
        }));
    } else {
        output::line(format_args!(
            "{}, median of {n}, {threads} threads",
            name.display()
        ));
        output::line(format_args!("  first  {first}"));
        output::line(format_args!("  later  {later}"));
        let ratio = stats.tests as f64 / stats.crossings.max(1) as f64;
        output::line(format_args!(
            "  {} potential links ({} separated), {} tests, {} crossings ({ratio:.2} tests each), \
             {} exact ({})",
            count(stats.potential_links),
            count(stats.separated),
            count(stats.tests),
            count(stats.crossings),
            count(stats.exact),
            percent(stats.exact_share()),
        ));
    }
    Ok(match run.undefined == 0 {
        true => Outcome::Fine,
        false => Outcome::Undecided,
    })
}
