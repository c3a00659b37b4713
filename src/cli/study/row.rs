//! A kernel on a model: what it took, and how well it summed.

use super::frames::median_of;
use super::setting::Setting;
use crate::cli::measure::cpu_ms;
use linkwatch::kernels::{Accuracy, Device, Method};
use linkwatch::{AbortOn, Certificate, CurveSet, Ladder, Result, Verifier, homotopic_polylines};
use serde_json::{Value, json};
use std::time::Instant;

/// What kernels are measured on, with the exact certificate that they are compared with.
pub struct Subject {
    pub set: CurveSet,
    pub exact: Certificate,
    pub potential_links: u64,
    /// Pairs of segments in the potential links, of the polylines: what sums without trees go through.
    pub segment_pairs: u64,
}

impl Subject {
    /// Certifies curves.
    pub fn new(set: CurveSet) -> Result<Subject> {
        let mut verifier = Verifier::new(AbortOn::Never);
        let (certificate, stats) = verifier.certify(&set);
        let exact = certificate.clone();
        let segment_pairs = match set.basis().is_polyline() {
            true => verifier.segment_pairs(&set),
            false => verifier.segment_pairs(&homotopic_polylines(&set)?.curves),
        };
        Ok(Subject {
            set,
            exact,
            potential_links: stats.potential_links,
            segment_pairs,
        })
    }

    /// Seconds that a sum over all pairs of segments would take, about; 0 for other kernels.
    fn expected_s(&self, setting: Setting, effort: &Effort) -> f64 {
        let threads = rayon::current_num_threads() as f64;
        let ns = setting.ns_a_pair(effort.fast_device).unwrap_or(0.0);
        ns * 1e-9 * self.segment_pairs as f64 / threads
    }
}

/// How long to measure.
#[derive(Clone, Debug)]
pub struct Effort {
    /// Where kernels run.
    pub device: Device,
    /// Whether that is a graphics processor, a fast one.
    pub fast_device: bool,
    /// Runs, for a median.
    pub repeat: u32,
    /// Seconds beyond which a sum over all pairs of segments is skipped, and nothing is run once more.
    pub limit: f64,
}

/// What a kernel took, and how well it summed.
pub struct Row {
    pub setting: Setting,
    /// Of the model.
    pub segments: usize,
    segment_pairs: u64,
    /// Or the seconds that it would take.
    pub measured: Result<Measured, f64>,
}

/// Times are medians, in milliseconds.
pub struct Measured {
    /// The sums alone, discretization included; for crossings all.
    pub ms: f64,
    /// Boxes, potential links and counting included.
    pub total_ms: f64,
    /// Of all processors, for all of it.
    pub cpu_ms: f64,
    /// Boxes and the search for potential links.
    pub search_ms: f64,
    /// Splines to polylines, for all pairs at once; 0 for crossings, which do so on the way.
    pub discretizing_ms: f64,
    /// What follows: the sums, or the counting.
    pub linking_ms: f64,
    pub ladder: Ladder,
    /// Whether the certificate was the exact one.
    pub equal: bool,
}

/// Of the table that [`Row::line`] prints.
pub const HEADER: &str = "kernel                              sums ms   total ms     cpu ms    \
                          mean error largest error  proven bound   decided   counted  certificate";

/// Of the file: names of [`Row::json`].
pub const FIELDS: &[&str] = &[
    "segments",
    "segment_pairs",
    "kernel",
    "order",
    "beta",
    "target",
    "ms",
    "total_ms",
    "cpu_ms",
    "mean_error",
    "largest_error",
    "largest_bound",
    "summed",
    "counted",
    "equal",
    "skipped_s",
];

impl Row {
    /// Runs a kernel, unless that would take too long.
    pub fn measure(setting: Setting, subject: &Subject, effort: &Effort) -> Result<Row> {
        let measured = match subject.expected_s(setting, effort) {
            s if s > effort.limit => Err(s),
            _ => Ok(Measured::run(setting, subject, effort)?),
        };
        Ok(Row {
            setting,
            segments: subject.set.segments(),
            segment_pairs: subject.segment_pairs,
            measured,
        })
    }

    /// What was measured, of a kernel that sums some pair.
    fn sums(&self) -> Option<&Measured> {
        let measured = self.measured.as_ref().ok();
        measured.filter(|m| m.ladder.known > 0)
    }

    /// The largest error of the sums, where there are any.
    pub fn largest_error(&self) -> Option<f64> {
        self.sums().map(|m| m.ladder.largest_error)
    }

    /// The mean error of the sums, where there are any.
    pub fn mean_error(&self) -> Option<f64> {
        self.sums().map(|m| m.ladder.mean_error)
    }

    /// The largest bound of the sums that decided, where some did.
    pub fn bound(&self) -> Option<f64> {
        let measured = self.measured.as_ref().ok();
        measured
            .filter(|m| m.ladder.summed > 0)
            .map(|m| m.ladder.largest_bound)
    }

    /// Whether it made a certificate that is not the exact one.
    pub fn differs(&self) -> bool {
        self.measured.as_ref().is_ok_and(|m| !m.equal)
    }

    pub fn line(&self) -> String {
        let m = match &self.measured {
            Ok(m) => m,
            Err(s) => return format!("{:33} skipped: about {s:.0} s", self.setting),
        };
        format!(
            "{:33} {:>9.2} {:>10.2} {:>10.2}  {:>12} {:>13}  {:>12} {:>9} {:>9}  {}",
            self.setting,
            m.ms,
            m.total_ms,
            m.cpu_ms,
            brief(self.mean_error()),
            brief(self.largest_error()),
            brief(self.bound()),
            m.ladder.summed,
            m.ladder.counted,
            if m.equal { "equal" } else { "DIFFERS" },
        )
    }

    pub fn json(&self) -> Value {
        let m = self.measured.as_ref().ok();
        let Accuracy { beta, target, .. } = self.setting.accuracy;
        json!({
            "segments": self.segments,
            "segment_pairs": self.segment_pairs,
            "kernel": self.setting.method,
            "order": self.setting.order(),
            "beta": beta,
            "target": target,
            "ms": m.map(|m| m.ms),
            "total_ms": m.map(|m| m.total_ms),
            "cpu_ms": m.map(|m| m.cpu_ms),
            "mean_error": self.mean_error(),
            "largest_error": self.largest_error(),
            "largest_bound": self.bound(),
            "summed": m.map(|m| m.ladder.summed),
            "counted": m.map(|m| m.ladder.counted),
            "equal": m.map(|m| m.equal),
            "skipped_s": self.measured.as_ref().err(),
        })
    }
}

impl Measured {
    fn run(setting: Setting, subject: &Subject, effort: &Effort) -> Result<Measured> {
        let Setting { method, accuracy } = setting;
        let began = Instant::now();
        let mut runs: Vec<Measured> = Vec::new();
        // An adapter compiles its programs once.
        let mut warm = effort.device == Device::Cpu;
        loop {
            // Each run meets the model for the first time.
            let mut verifier = Verifier::new(AbortOn::Never);
            verifier.set_device(&effort.device)?;
            let (start, cpu) = (Instant::now(), cpu_ms());
            verifier.set_kernel(method, accuracy);
            let (certificate, _) = verifier.certify(&subject.set);
            if !std::mem::replace(&mut warm, true) {
                continue;
            }
            let total_ms = start.elapsed().as_secs_f64() * 1e3;
            let cpu_ms = cpu_ms() - cpu;
            let equal = *certificate == subject.exact;
            let (timings, ladder) = (verifier.timings(), verifier.ladder());
            let ms = |d: std::time::Duration| d.as_secs_f64() * 1e3;
            let discretizing_ms = ms(ladder.discretizing);
            let (sum_ms, linking_ms) = match method {
                Method::Auto | Method::Crossings => (total_ms, ms(timings.links)),
                _ => (ms(ladder.summing), ms(ladder.summing) - discretizing_ms),
            };
            runs.push(Measured {
                ms: sum_ms,
                total_ms,
                cpu_ms,
                search_ms: ms(timings.boxes + timings.pairs),
                discretizing_ms,
                linking_ms,
                ladder,
                equal,
            });
            let enough = runs.len() >= effort.repeat as usize;
            if enough || began.elapsed().as_secs_f64() > effort.limit {
                break;
            }
        }
        let median = |f: fn(&Measured) -> f64| median_of(&runs.iter().map(f).collect::<Vec<_>>());
        Ok(Measured {
            ms: median(|m| m.ms),
            total_ms: median(|m| m.total_ms),
            cpu_ms: median(|m| m.cpu_ms),
            search_ms: median(|m| m.search_ms),
            discretizing_ms: median(|m| m.discretizing_ms),
            linking_ms: median(|m| m.linking_ms),
            // Sums do not depend on the run.
            ladder: runs.last().map_or_else(Ladder::default, |m| m.ladder),
            equal: runs.iter().all(|m| m.equal),
        })
    }
}

/// Two digits, or a dash.
pub fn brief(x: Option<f64>) -> String {
    x.map_or("-".into(), |x| format!("{x:.1e}"))
}
