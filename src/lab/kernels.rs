//! Measurement of a kernel on a subject: its time and the error of its sums.

use super::certify::Run;
use super::setting::Setting;
use super::statistics::Effort;
use super::subject::Subject;
use crate::engine::{Certifier, SessionOptions};
use crate::error::Result;
use crate::kernels::{Device, Method};
use std::time::Duration;

/// Limits of the measurement of a kernel.
#[derive(Clone, Debug)]
pub struct KernelEffort {
    /// Device that runs the kernels.
    pub device: Device,
    /// True if the device is a GPU, and not a software renderer.
    pub fast_device: bool,
    /// Number of runs, for a median.
    pub repeat: u32,
    /// Seconds beyond which a sum over all pairs of segments is skipped, and other runs are not
    /// repeated.
    pub limit_s: f64,
}

/// Measurement of a kernel on a subject.
#[derive(Clone, Debug)]
pub struct KernelRow {
    /// Kernel and accuracy.
    pub setting: Setting,
    /// Number of segments of the subject.
    pub segments: usize,
    /// Number of segment pairs in its potential links.
    pub segment_pairs: u64,
    /// The measurement, or the predicted seconds if it was skipped.
    pub measured: Result<Run, f64>,
}

impl KernelRow {
    /// Runs a kernel, unless that would take too long.
    ///
    /// Errors: the device cannot be used.
    pub fn measure(setting: Setting, subject: &Subject, effort: &KernelEffort) -> Result<Self> {
        let threads = rayon::current_num_threads() as f64;
        let ns = setting.ns_a_pair(effort.fast_device).unwrap_or(0.0);
        let expected_s = ns * 1e-9 * subject.segment_pairs as f64 / threads;
        let measured = match expected_s > effort.limit_s {
            true => None,
            false => run(setting, subject, effort)?,
        };
        Ok(KernelRow {
            setting,
            segments: subject.curves.segments(),
            segment_pairs: subject.segment_pairs,
            measured: measured.ok_or(expected_s),
        })
    }

    /// Returns the measurement, unless it was skipped.
    pub fn run(&self) -> Option<&Run> {
        self.measured.as_ref().ok()
    }

    /// Returns the milliseconds of the sums alone, discretization included; for crossings those of
    /// all stages.
    pub fn ms(&self) -> Option<f64> {
        self.run().map(|run| match self.counts() {
            true => run.times.total_ms,
            false => run.times.summing_ms,
        })
    }

    /// Returns the milliseconds of the linking numbers: the sums, or the counting, which
    /// discretizes pair by pair.
    pub fn linking_ms(&self) -> Option<f64> {
        self.run().map(|Run { times, .. }| match self.counts() {
            true => times.links_ms,
            false => times.summing_ms - times.discretizing_ms,
        })
    }

    fn counts(&self) -> bool {
        matches!(self.setting.method, Method::Auto | Method::Crossings)
    }

    /// Returns the largest error of the sums, if there are any.
    pub fn largest_error(&self) -> Option<f64> {
        let ladder = self.run()?.ladder;
        (ladder.known > 0).then_some(ladder.largest_error)
    }

    /// Returns the mean error of the sums, if there are any.
    pub fn mean_error(&self) -> Option<f64> {
        let ladder = self.run()?.ladder;
        (ladder.known > 0).then_some(ladder.mean_error)
    }

    /// Returns the largest bound of the sums that decided a pair, if any did.
    pub fn largest_bound(&self) -> Option<f64> {
        let ladder = self.run()?.ladder;
        (ladder.summed > 0).then_some(ladder.largest_bound)
    }

    /// Returns true if the certificate differs from the exact one.
    pub fn differs(&self) -> bool {
        self.run().is_some_and(|run| !run.equal)
    }
}

/// Runs a kernel several times, each time with a new certifier.
fn run(setting: Setting, subject: &Subject, effort: &KernelEffort) -> Result<Option<Run>> {
    let run = || {
        let mut certifier = Certifier::new(&SessionOptions {
            kernel: setting.method,
            accuracy: setting.accuracy,
            device: effort.device.clone(),
            ..SessionOptions::default()
        })?;
        Ok(Run::of(
            &mut certifier,
            &subject.curves,
            Some(&subject.exact),
        ))
    };
    if effort.device != Device::Cpu {
        // An adapter compiles its shaders once, so the first run is not measured.
        run()?;
    }
    let runs = Effort {
        runs: effort.repeat,
        limit: Duration::try_from_secs_f64(effort.limit_s).unwrap_or(Duration::MAX),
    };
    let runs: Result<Vec<Run>> = runs.repeat(run).collect();
    Ok(Run::median(runs?))
}
