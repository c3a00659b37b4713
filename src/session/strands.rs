//! Clearance of the strands, frame by frame.

use crate::curve::CurveSet;
use crate::engine::SessionOptions;
use crate::error::Result;
use crate::ingest::FrameInfo;
use crate::thickness::{ClearanceMonitor, ClearanceOptions};
use crate::verdict::Clearance;
use std::time::{Duration, Instant};

/// Measures the clearance of verified frames, if the options ask for it. After a failure, no later
/// frame of the same layout is measured.
#[derive(Debug)]
pub(super) struct Strands {
    options: Option<ClearanceOptions>,
    monitor: Option<ClearanceMonitor>,
    /// Layout of the frame whose radii apply.
    radii_of: Option<u32>,
    /// Reason why the clearance is no longer measured.
    unmeasured: Option<String>,
    took: Duration,
}

impl Strands {
    pub fn new(options: &SessionOptions) -> Strands {
        Strands {
            options: options.clearance,
            monitor: options.clearance.map(ClearanceMonitor::new),
            radii_of: None,
            unmeasured: None,
            took: Duration::ZERO,
        }
    }

    /// Continues after a frame, with the trend of the clearance.
    pub fn resumed(options: &SessionOptions, info: &FrameInfo, trend: Vec<(u64, f64)>) -> Strands {
        let mut strands = Strands::new(options);
        if let Some(monitor) = &mut strands.monitor {
            strands.radii_of = Some(info.layout);
            let known = monitor.set_radii(&info.labels.radii);
            monitor.set_trend(trend);
            strands.check(info.seq, known);
        }
        strands
    }

    /// Returns the clearance of the last frames, by their number.
    pub fn trend(&self) -> Vec<(u64, f64)> {
        let monitor = self.monitor.as_ref();
        monitor.map_or_else(Vec::new, ClearanceMonitor::trend)
    }

    /// Returns the reason why clearance is not measured, although the options ask for it.
    pub fn unmeasured(&self) -> Option<&str> {
        self.unmeasured.as_deref()
    }

    /// Returns the time that the last frame took.
    pub fn took(&self) -> Duration {
        self.took
    }

    /// The next frame does not continue the last one.
    pub fn cut(&mut self) {
        if let Some(monitor) = &mut self.monitor {
            monitor.forget();
        }
    }

    /// Measures a verified frame.
    pub fn measure(&mut self, info: &FrameInfo, set: &CurveSet) -> Option<Clearance> {
        let start = Instant::now();
        let is_new = self.radii_of.replace(info.layout) != Some(info.layout);
        if is_new {
            // The curves may be others.
            self.monitor = self.options.map(ClearanceMonitor::new);
            self.unmeasured = None;
        }
        let monitor = self.monitor.as_mut()?;
        let known = match is_new {
            true => monitor.set_radii(&info.labels.radii),
            false => Ok(()),
        };
        let measured = known.and_then(|()| monitor.measure(set, info.cell.as_ref(), info.seq));
        self.took = start.elapsed();
        self.check(info.seq, measured)
    }

    /// Takes note of a failure.
    fn check<T>(&mut self, seq: u64, measured: Result<T>) -> Option<T> {
        let noted = measured.inspect_err(|e| {
            tracing::warn!("clearance is not measured from frame {seq} on: {e}");
            self.unmeasured = Some(e.to_string());
            self.monitor = None;
        });
        noted.ok()
    }
}
