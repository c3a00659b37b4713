//! Metrics in a build without the feature `metrics`: none.

use super::run::FrameCounts;
use linkwatch::{Report, SinkSummary};
use std::time::Duration;

/// Ignores the figures of a session.
pub struct SessionMetrics;

impl SessionMetrics {
    pub fn add(&self, _: &Report, _: Option<Duration>) {}
    pub fn count(&mut self, _: FrameCounts, _: impl Iterator<Item = SinkSummary>) {}
}

#[cfg(feature = "bus")]
pub use watch::*;

#[cfg(feature = "bus")]
mod watch {
    use super::SessionMetrics;
    use linkwatch::Result;

    /// No options.
    #[derive(Clone, Debug, clap::Args)]
    pub struct MetricsArgs {}

    impl MetricsArgs {
        pub fn serve(&self, _: &[String]) -> Result<Metrics> {
            Ok(Metrics)
        }
    }

    pub struct Metrics;

    impl Metrics {
        pub fn service(&self, _: &str) -> ServiceMetrics {
            ServiceMetrics
        }
    }

    pub struct ServiceMetrics;

    impl ServiceMetrics {
        pub fn session(&self, _: bool) -> SessionMetrics {
            SessionMetrics
        }
        pub fn connected(&self) {}
        pub fn restarted(&self, _: u64) {}
        pub fn disconnected(&self) {}
    }
}
