//! Measurement of a kernel on a model: its time and the error of its sums.

use super::frames::median_of;
use super::setting::Setting;
use crate::cli::measure::cpu_ms;
use linkwatch::kernels::{Accuracy, Device, Method};
use linkwatch::{
    Certificate, CurveSet, Ladder, Result, Verifier, VerifierOptions, homotopic_polylines,
};
use serde_json::{Value, json};
use std::time::Instant;

/// A model to measure, with the exact certificate as the reference.
pub struct StudyModel {
    pub set: CurveSet,
    pub exact: Certificate,
    pub potential_links: u64,
    /// Number of segment pairs in the potential links, of the polylines: the work of sums without
    /// trees.
    pub segment_pairs: u64,
}

impl StudyModel {
    /// Certifies curves as a reference.
    pub fn new(set: CurveSet) -> Result<StudyModel> {
        let mut verifier = Verifier::default();
        let (certificate, stats) = verifier.certify(&set);
        let exact = certificate.clone();
        let segment_pairs = match set.basis().is_polyline() {
            true => verifier.segment_pairs(&set),
            false => verifier.segment_pairs(&homotopic_polylines(&set)?.curves),
        };
        Ok(StudyModel {
            set,
            exact,
            potential_links: stats.potential_links,
            segment_pairs,
        })
    }

    /// Returns the predicted seconds of a sum over all pairs of segments; 0 for other kernels.
    fn expected_s(&self, setting: Setting, effort: &Effort) -> f64 {
        let threads = rayon::current_num_threads() as f64;
        let ns = setting.ns_a_pair(effort.fast_device).unwrap_or(0.0);
        ns * 1e-9 * self.segment_pairs as f64 / threads
    }
}

/// Limits of a measurement.
#[derive(Clone, Debug)]
pub struct Effort {
    /// Device that runs the kernels.
    pub device: Device,
    /// True if the device is a GPU, and not a software renderer.
    pub fast_device: bool,
    /// Number of runs, for a median.
    pub repeat: u32,
    /// Seconds beyond which a sum over all pairs of segments is skipped, and other runs are not
    /// repeated.
    pub limit: f64,
}

/// Measurement of a kernel on a model.
pub struct Row {
    pub setting: Setting,
    /// Number of segments of the model.
    pub segments: usize,
    segment_pairs: u64,
    /// The measurement, or the predicted seconds if it was skipped.
    pub measured: Result<Measured, f64>,
}

/// Times are medians, in milliseconds.
pub struct Measured {
    /// Time of the sums alone, discretization included; for crossings the total time.
    pub ms: f64,
    /// Total time, with boxes, potential links and counting.
    pub total_ms: f64,
    /// CPU time of all threads, for all stages.
    pub cpu_ms: f64,
    /// Time of boxes and of the search for potential links.
    pub search_ms: f64,
    /// Time to convert splines to polylines, for all pairs at once; 0 for crossings, which include
    /// it.
    pub discretizing_ms: f64,
    /// Time of the linking numbers: the sums, or the counting.
    pub linking_ms: f64,
    pub ladder: Ladder,
    /// True if the certificate was the exact one.
    pub equal: bool,
}

/// Header of the table that [`Row::line`] prints.
pub const HEADER: &str = "kernel                              sums ms   total ms     cpu ms    \
                          mean error largest error  proven bound   decided   counted  certificate";

/// Fields of the file: names of [`Row::json`].
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
    pub fn measure(setting: Setting, subject: &StudyModel, effort: &Effort) -> Result<Row> {
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

    /// Returns the measurement if the kernel summed some pair.
    fn sums(&self) -> Option<&Measured> {
        let measured = self.measured.as_ref().ok();
        measured.filter(|m| m.ladder.known > 0)
    }

    /// Returns the largest error of the sums, if there are any.
    pub fn largest_error(&self) -> Option<f64> {
        self.sums().map(|m| m.ladder.largest_error)
    }

    /// Returns the mean error of the sums, if there are any.
    pub fn mean_error(&self) -> Option<f64> {
        self.sums().map(|m| m.ladder.mean_error)
    }

    /// Returns the largest bound of the sums that decided a pair, if any did.
    pub fn bound(&self) -> Option<f64> {
        let measured = self.measured.as_ref().ok();
        measured
            .filter(|m| m.ladder.summed > 0)
            .map(|m| m.ladder.largest_bound)
    }

    /// Returns true if the certificate differs from the exact one.
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
    fn run(setting: Setting, subject: &StudyModel, effort: &Effort) -> Result<Measured> {
        let Setting { method, accuracy } = setting;
        let began = Instant::now();
        let mut runs: Vec<Measured> = Vec::new();
        // An adapter compiles its shaders once, so the first run is not measured.
        let mut warm = effort.device == Device::Cpu;
        loop {
            // Each run starts with a new verifier.
            let mut verifier = Verifier::new(VerifierOptions {
                kernel: method,
                accuracy,
                device: effort.device.clone(),
                ..VerifierOptions::default()
            })?;
            let (start, cpu) = (Instant::now(), cpu_ms());
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

/// Formats a number with two digits, or a dash.
pub fn brief(x: Option<f64>) -> String {
    x.map_or("-".into(), |x| format!("{x:.1e}"))
}
