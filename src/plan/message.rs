//! `Display` form of a plan: one line per stage.

use super::{DevicePlan, DiscretizationChoice, Parallelism, Plan, Prediction, Search};
use crate::pairs::SMALL;
use std::fmt;

impl fmt::Display for Prediction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", millis(self.ms))?;
        if self.ms != self.one_thread_ms {
            write!(f, " ({} on one thread)", millis(self.one_thread_ms))?;
        }
        Ok(())
    }
}

impl fmt::Display for Plan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Plan {
            threads,
            discretization,
            boxes,
            potential_links: links,
            direction,
            kernel,
            bytes,
            predicted,
        } = self;
        let shared = match boxes.shared_curves {
            0 => String::new(),
            n => format!(", {} split among threads", plural(n, "curve")),
        };
        let leaves = match (
            discretization.choice,
            boxes.stored_leaves,
            boxes.computed_leaves,
        ) {
            (DiscretizationChoice::PairByPair, ..) => "stored (splines)".to_owned(),
            (DiscretizationChoice::None, _, 0) => "stored (small curves)".to_owned(),
            (DiscretizationChoice::None, 0, _) => "computed (polylines)".to_owned(),
            (DiscretizationChoice::None, stored, computed) => format!(
                "computed for {}, stored for {}",
                plural(computed, "curve"),
                plural(stored, "small one"),
            ),
        };
        writeln!(
            f,
            "boxes: trees of up to {} over {}, leaves {}{shared}, {}: {}",
            plural(usize::from(boxes.levels), "level"),
            plural(boxes.segments, "segment"),
            leaves,
            megabytes(boxes.bytes),
            boxes.predicted,
        )?;
        let search = match links.search {
            Search::Trivial => "no search (one pair at most)",
            Search::Sweep => "a sweep",
        };
        write!(
            f,
            "potential links: {search}, finds {} of {} of {}",
            count(links.links),
            plural(links.pairs as usize, "pair"),
            plural(links.curves, "curve"),
        )?;
        if links.open_curves > 0 {
            write!(f, ", {} skipped", plural(links.open_curves, "open curve"))?;
        }
        if links.degenerate_curves > 0 {
            let degenerate = plural(links.degenerate_curves, "degenerate curve");
            write!(f, ", {degenerate} skipped")?;
        }
        writeln!(f, ", {}: {}", megabytes(links.bytes), links.predicted)?;
        match (direction.by_formula, direction.best_of_six) {
            (0, 0) => write!(f, "direction: none (no potential link)")?,
            (0, n) => write!(f, "direction: the best of six for {}", plural(n, "link"))?,
            (n, 0) => write!(
                f,
                "direction: a formula (loops of at most {SMALL} segments) for {}",
                plural(n, "link")
            )?,
            (few, many) => write!(
                f,
                "direction: the best of six for {}, a formula (loops of at most {SMALL} segments) \
                 for {}",
                plural(many, "link"),
                count(few),
            )?,
        }
        let device = kernel.device.as_ref();
        let on_adapter = device.filter(|d| d.chosen);
        match on_adapter.and_then(|d| d.adapter_ms) {
            Some(_) => writeln!(f, ": included in the kernel")?,
            None => writeln!(f, ": {}", direction.predicted)?,
        }
        match discretization.choice {
            DiscretizationChoice::None => writeln!(f, "discretization: none (polylines)")?,
            DiscretizationChoice::PairByPair => writeln!(
                f,
                "discretization: pair by pair, where hulls overlap (splines), {} and {} \
                 expected: {}",
                plural(kernel.work.overlaps as usize, "hull test"),
                plural(kernel.work.refined as usize, "new point"),
                discretization.predicted,
            )?,
        }
        let parallelism = match kernel.parallelism {
            Parallelism::None => "one thread",
            Parallelism::OverLinks => "links split among threads",
            Parallelism::InsideLinks => "each link split among threads",
        };
        let first = match kernel.summed {
            0 => String::new(),
            n => format!(
                "fmm first on {} (unless strands are too close), then ",
                plural(n, "link")
            ),
        };
        let where_to = match on_adapter {
            Some(device) => format!(" on {}", device.adapter),
            None => format!(
                ", {parallelism}, {} of {} busy",
                kernel.busy_threads,
                plural(*threads, "thread")
            ),
        };
        write!(
            f,
            "kernel: {first}crossings (exact){where_to}; {} of {} sampled, {} and {} expected: ",
            count(kernel.sampled),
            plural(links.links, "link"),
            plural(
                (kernel.work.nodes + kernel.work.computed) as usize,
                "node pair"
            ),
            plural(kernel.work.tests as usize, "test"),
        )?;
        match on_adapter {
            None => writeln!(f, "{}", kernel.predicted)?,
            Some(DevicePlan {
                adapter_ms: Some(adapter),
                cpu_ms: Some(cpu),
                ..
            }) => writeln!(f, "{} (CPU: {})", millis(*adapter), millis(*cpu))?,
            Some(_) => writeln!(f, "not calibrated (CPU: {})", kernel.predicted)?,
        }
        if let Some(device) = device {
            writeln!(f, "device: {device}")?;
        }
        write!(
            f,
            "total: {} in addition to the curves: {predicted}",
            megabytes(*bytes)
        )
    }
}

impl fmt::Display for DevicePlan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let adapter = &self.adapter;
        match (self.chosen, self.adapter_ms.zip(self.cpu_ms)) {
            (true, _) => write!(f, "crossings on {adapter}")?,
            (false, Some((there, here))) => write!(
                f,
                "crossings on the CPU, in {} ({adapter}: {}, within a factor of {:.1})",
                millis(here),
                millis(there),
                self.adapter_error_factor.unwrap_or(1.0),
            )?,
            (false, None) => write!(f, "crossings on the CPU")?,
        }
        let from = |from: Option<u64>, noun: &str| match from {
            Some(0) => "all".to_owned(),
            Some(n) => format!("from {} on", plural(n as usize, noun)),
            None => "never".to_owned(),
        };
        write!(
            f,
            "; direct sums on the GPU: {}, Barnes-Hut: {}",
            from(self.direct_from, "segment pair"),
            from(self.barnes_hut_from, "segment"),
        )
    }
}

/// Formats a count with separators, `211,680`.
fn count(n: usize) -> String {
    let digits = n.to_string();
    let mut out = String::new();
    for (k, digit) in digits.chars().enumerate() {
        if k > 0 && (digits.len() - k).is_multiple_of(3) {
            out.push(',');
        }
        out.push(digit);
    }
    out
}

/// Formats a count with its noun, `1 link`, `2 links`.
fn plural(n: usize, noun: &str) -> String {
    let s = if n == 1 { "" } else { "s" };
    format!("{} {noun}{s}", count(n))
}

/// Formats milliseconds with two significant digits at most.
fn millis(ms: f64) -> String {
    let digits = if ms < 0.1 {
        3
    } else if ms < 10.0 {
        2
    } else {
        0
    };
    format!("{ms:.digits$} ms")
}

fn megabytes(bytes: usize) -> String {
    format!("{:.1} MB", bytes as f64 * 1e-6)
}
