//! `linkwatch certify --repeat`: what a certificate costs, stage by stage.
//!
//! From control points in memory to the sorted numbers. "First" is a verifier that meets the model for the first
//! time and makes its buffers; "later" is the same one again.

use super::Outcome;
use super::output::{self, count, percent};
use linkwatch::{AbortOn, Result, Timings, Verifier, model};
use rustix::time::{ClockId, clock_gettime};
use serde_json::{Value, json};
use std::path::Path;

/// Milliseconds of one run.
#[derive(Clone, Copy, Debug)]
struct Cost {
    stages: Timings,
    /// Time of all processors together.
    cpu_ms: f64,
}

/// Certifies a model `n` times and prints medians.
pub fn run(path: &Path, n: u32, as_json: bool) -> Result<Outcome> {
    let set = model::read(path)?;
    let (mut first, mut later) = (Vec::new(), Vec::new());
    let mut result = None;
    for _ in 0..n {
        let mut verifier = Verifier::new(AbortOn::Never);
        for costs in [&mut first, &mut later] {
            let start = cpu_ms();
            let (certificate, stats) = verifier.certify(&set);
            result = Some((certificate.links.len(), certificate.undefined.len(), stats));
            costs.push(Cost {
                stages: verifier.timings(),
                cpu_ms: cpu_ms() - start,
            });
        }
    }
    let Some((links, undefined, stats)) = result else {
        return Ok(Outcome::Fine);
    };
    let threads = rayon::current_num_threads();
    let (first, later) = (medians(&first), medians(&later));
    if as_json {
        output::json(&json!({
            "model": path,
            "repeat": n,
            "threads": threads,
            "first": first,
            "later": later,
            "links": links,
            "undefined": undefined,
            "stats": stats,
            "exact_share": stats.exact_share(),
            "peak_mb": peak_mb(),
        }))?;
    } else {
        let show = |name: &str, m: &Value| {
            let ms = |key: &str| m[key].as_f64().unwrap_or(f64::NAN);
            output::line(format_args!(
                "  {name:5}  boxes {:.3}  pairs {:.3}  links {:.3}  total {:.3} ms  (cpu {:.3} ms)",
                ms("boxes_ms"),
                ms("pairs_ms"),
                ms("links_ms"),
                ms("total_ms"),
                ms("cpu_ms"),
            ))
        };
        output::line(format_args!(
            "{}, median of {n}, {threads} threads",
            path.display()
        ))?;
        show("first", &first)?;
        show("later", &later)?;
        let ratio = stats.tests as f64 / stats.crossings.max(1) as f64;
        output::line(format_args!(
            "  {} potential links ({} separated), {} tests, {} crossings ({ratio:.2} tests each), {} exact ({})",
            count(stats.potential_links),
            count(stats.separated),
            count(stats.tests),
            count(stats.crossings),
            count(stats.exact),
            percent(stats.exact_share()),
        ))?;
    }
    Ok(match undefined == 0 {
        true => Outcome::Fine,
        false => Outcome::Undecided,
    })
}

fn medians(costs: &[Cost]) -> Value {
    let median = |f: &dyn Fn(&Cost) -> f64| {
        let mut values: Vec<f64> = costs.iter().map(f).collect();
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    let ms =
        |f: &dyn Fn(&Timings) -> std::time::Duration| median(&|c| f(&c.stages).as_secs_f64() * 1e3);
    json!({
        "boxes_ms": ms(&|t| t.boxes),
        "pairs_ms": ms(&|t| t.pairs),
        "links_ms": ms(&|t| t.links),
        "total_ms": ms(&|t| t.total),
        "cpu_ms": median(&|c| c.cpu_ms),
    })
}

/// Time that the processors spent on this process.
fn cpu_ms() -> f64 {
    let t = clock_gettime(ClockId::ProcessCPUTime);
    t.tv_sec as f64 * 1e3 + t.tv_nsec as f64 * 1e-6
}

/// Peak memory of this process so far, where the system tells.
fn peak_mb() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with("VmHWM:"))?;
    let kb: f64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kb / 1024.0)
}
