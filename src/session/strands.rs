//! Clearance of the strands in each frame of a session.

use crate::curve::CurveSet;
use crate::engine::SessionOptions;
use crate::error::Result;
use crate::ingest::FrameInfo;
use crate::measure::ClearanceMonitor;
use crate::verdict::Clearance;
use std::time::{Duration, Instant};

/// Measures the clearance of verified frames, if the options ask for it. After a failure, no later
/// frame of the same layout is measured.
#[derive(Debug, Default)]
pub(super) struct Strands {
    monitor: Option<ClearanceMonitor>,
    /// Layout of the curves that are measured.
    layout: Option<u32>,
    /// Reason why the clearance is not measured, although the options ask for it.
    pub unmeasured: Option<String>,
    /// Time that the last frame took.
    pub took: Duration,
}

impl Strands {
    /// Continues after a frame, with the trend of the clearance.
    pub fn resumed(options: &SessionOptions, info: &FrameInfo, trend: Vec<(u64, f64)>) -> Strands {
        let mut strands = Strands::default();
        strands.begin_layout(options, info);
        if let Some(monitor) = &mut strands.monitor {
            monitor.set_trend(trend);
        }
        strands
    }

    /// Begins with the curves of a frame, which may be others than before.
    fn begin_layout(&mut self, options: &SessionOptions, info: &FrameInfo) {
        self.layout = Some(info.layout);
        self.unmeasured = None;
        self.monitor = options.clearance.map(ClearanceMonitor::new);
        if let Some(monitor) = &mut self.monitor {
            let known = monitor.set_radii(&info.labels.radii);
            self.check(info.seq, known);
        }
    }

    /// Returns the clearance of the last frames, by their number.
    pub fn trend(&self) -> Vec<(u64, f64)> {
        let monitor = self.monitor.as_ref();
        monitor.map_or_else(Vec::new, ClearanceMonitor::trend)
    }

    /// Forgets the previous frames, because the next one does not continue them.
    pub fn cut(&mut self) {
        if let Some(monitor) = &mut self.monitor {
            monitor.forget();
        }
    }

    /// Measures a verified frame.
    pub fn measure(
        &mut self,
        options: &SessionOptions,
        info: &FrameInfo,
        set: &CurveSet,
    ) -> Option<Clearance> {
        let start = Instant::now();
        if self.layout != Some(info.layout) {
            self.begin_layout(options, info);
        }
        let monitor = self.monitor.as_mut()?;
        let measured = monitor.measure(set, info.cell.as_ref(), info.seq);
        self.took = start.elapsed();
        self.check(info.seq, measured)
    }

    /// Records a failure, and logs a warning.
    fn check<T>(&mut self, seq: u64, measured: Result<T>) -> Option<T> {
        let noted = measured.inspect_err(|e| {
            tracing::warn!("clearance is not measured from frame {seq} on: {e}");
            self.unmeasured = Some(e.to_string());
            self.monitor = None;
        });
        noted.ok()
    }
}
