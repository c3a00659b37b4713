//! `--repeat` of `linkwatch certify` and `plan`: time of a certificate, stage by stage.
//!
//! Measures the work from control points in memory to the sorted linking numbers. "First" is a new
//! verifier, which allocates its buffers. "Later" is the same verifier again.

use super::output::{self, count, percent};
use super::{Outcome, input};
use linkwatch::kernels::Device;
use linkwatch::{CurveSet, Result, Stats, Timings, Verifier, VerifierOptions};
use rustix::time::{ClockId, clock_gettime};
use serde_json::{Value, json};
use std::fmt;
use std::path::Path;
use std::time::Duration;

/// Cost of certifying a model.
#[derive(Clone, Copy, Debug)]
pub struct Measured {
    /// Cost of a new verifier, medians.
    pub first: StageTimes,
    /// Cost of a verifier that has certified the model before, medians.
    pub later: StageTimes,
    links: usize,
    undefined: usize,
    stats: Stats,
}

/// Cost of one run.
#[derive(Clone, Copy, Debug, Default)]
pub struct StageTimes {
    stages: Timings,
    /// CPU time of all threads, in milliseconds.
    cpu_ms: f64,
}

/// Certifies curves `n` times, at least once.
pub fn measure(set: &CurveSet, n: u32, device: &Device) -> Result<Measured> {
    let (mut first, mut later) = (Vec::new(), Vec::new());
    let (mut links, mut undefined, mut stats) = (0, 0, Stats::default());
    for _ in 0..n.max(1) {
        let mut verifier = Verifier::new(VerifierOptions {
            device: device.clone(),
            ..VerifierOptions::default()
        })?;
        for costs in [&mut first, &mut later] {
            let start = cpu_ms();
            let (certificate, counts) = verifier.certify(set);
            (links, undefined) = (certificate.links.len(), certificate.undefined.len());
            stats = counts;
            costs.push(StageTimes {
                stages: verifier.timings(),
                cpu_ms: cpu_ms() - start,
            });
        }
    }
    Ok(Measured {
        first: StageTimes::median(&first),
        later: StageTimes::median(&later),
        links,
        undefined,
        stats,
    })
}

/// Certifies a model or a scene `n` times and prints medians.
pub fn run(name: &Path, n: u32, device: &Device, as_json: bool) -> Result<Outcome> {
    let set = input::read(name)?;
    let Measured {
        first,
        later,
        links,
        undefined,
        stats,
    } = measure(&set, n, device)?;
    let threads = rayon::current_num_threads();
    if as_json {
        output::json(&json!({
            "model": name,
            "repeat": n,
            "threads": threads,
            "first": first.to_json(),
            "later": later.to_json(),
            "links": links,
            "undefined": undefined,
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
    Ok(match undefined == 0 {
        true => Outcome::Fine,
        false => Outcome::Undecided,
    })
}

impl StageTimes {
    /// Returns the median of each number separately.
    fn median(costs: &[StageTimes]) -> StageTimes {
        let median = |f: &dyn Fn(&StageTimes) -> f64| {
            let mut values: Vec<f64> = costs.iter().map(f).collect();
            values.sort_by(f64::total_cmp);
            values[values.len() / 2]
        };
        let time = |f: &dyn Fn(&Timings) -> Duration| {
            Duration::from_secs_f64(median(&|c| f(&c.stages).as_secs_f64()))
        };
        StageTimes {
            stages: Timings {
                boxes: time(&|t| t.boxes),
                pairs: time(&|t| t.pairs),
                links: time(&|t| t.links),
                total: time(&|t| t.total),
            },
            cpu_ms: median(&|c| c.cpu_ms),
        }
    }

    /// Returns the milliseconds of every stage.
    pub fn to_json(self) -> Value {
        json!({
            "boxes_ms": ms(self.stages.boxes),
            "pairs_ms": ms(self.stages.pairs),
            "links_ms": ms(self.stages.links),
            "total_ms": ms(self.stages.total),
            "cpu_ms": self.cpu_ms,
        })
    }
}

impl fmt::Display for StageTimes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Timings {
            boxes,
            pairs,
            links,
            total,
        } = self.stages;
        write!(
            f,
            "boxes {:.3}  pairs {:.3}  links {:.3}  total {:.3} ms  (cpu {:.3} ms)",
            ms(boxes),
            ms(pairs),
            ms(links),
            ms(total),
            self.cpu_ms,
        )
    }
}

fn ms(d: Duration) -> f64 {
    d.as_secs_f64() * 1e3
}

/// Returns the CPU time of this process so far, in milliseconds.
pub fn cpu_ms() -> f64 {
    let t = clock_gettime(ClockId::ProcessCPUTime);
    t.tv_sec as f64 * 1e3 + t.tv_nsec as f64 * 1e-6
}

/// Returns the peak memory of this process in MB, if the system reports it.
fn peak_mb() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with("VmHWM:"))?;
    let kb: f64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kb / 1024.0)
}
