//! `--metrics`: figures of a long watch over HTTP, for Prometheus.

mod address;
mod figures;
mod http;

pub use self::figures::SessionMetrics;

use self::address::Address;
use self::figures::{Figures, Service};
use self::http::{LIMIT, PATH, Server};
use linkwatch::Result;
use std::sync::Arc;

/// The option `--metrics`.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = super::WRITE)]
pub struct MetricsArgs {
    /// Serve figures for Prometheus at http://ADDRESS/metrics
    ///
    /// Counters and latencies. A port alone is on the loopback interface (127.0.0.1); port 0 is a free one, which the log names.
    /// Without a password: at any other address (HOST:PORT) whoever reaches it can read them
    #[arg(long, value_name = "[HOST:]PORT")]
    metrics: Option<Address>,
}

impl MetricsArgs {
    /// Serves the figures of these services, if that is requested.
    pub fn serve(&self, services: &[String]) -> Result<Metrics> {
        let Some(address) = &self.metrics else {
            return Ok(Metrics::default());
        };
        let listener = address.listen()?;
        let local = listener.local_addr()?;
        let figures = Arc::new(Figures::new(services));
        let page = Arc::clone(&figures);
        let server = Server::start(listener, LIMIT, move || page.page())?;
        tracing::info!("metrics are at http://{local}{PATH}");
        if !local.ip().to_canonical().is_loopback() {
            tracing::warn!(
                "anybody on the network can read the metrics, because {} is not an address of the \
                 loopback interface",
                local.ip()
            );
        }
        Ok(Metrics {
            figures: Some(figures),
            _server: Some(server),
        })
    }
}

/// Figures of all services. They are served until this value is dropped.
#[derive(Default)]
pub struct Metrics {
    figures: Option<Arc<Figures>>,
    _server: Option<Server>,
}

impl Metrics {
    /// Returns the figures of a service.
    pub fn service(&self, name: &str) -> ServiceMetrics {
        let figures = self.figures.as_ref();
        ServiceMetrics(figures.and_then(|figures| figures.service(name)))
    }
}

/// Figures of a service, if they are served.
pub struct ServiceMetrics(Option<Arc<Service>>);

impl ServiceMetrics {
    /// Prepares a session. `events` is true if it searches for pull-throughs.
    pub fn session(&self, events: bool) -> SessionMetrics {
        let service = self.0.clone();
        service.map_or_else(SessionMetrics::default, |s| SessionMetrics::new(s, events))
    }

    /// Counts a simulator that connected.
    pub fn connected(&self) {
        if let Some(service) = &self.0 {
            service.connected();
        }
    }

    /// Adds the times that the watch was started again before this process began.
    pub fn restarted(&self, times: u64) {
        if let Some(service) = &self.0 {
            service.restarted(times);
        }
    }

    /// Records that the simulator is not watched any more.
    pub fn disconnected(&self) {
        if let Some(service) = &self.0 {
            service.disconnected();
        }
    }
}
