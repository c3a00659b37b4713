//! `--metrics`: figures of a long watch over HTTP, for Prometheus.

mod address;
mod figures;
mod http;

pub use self::figures::{ServiceMetrics, SessionMetrics};

use self::address::Address;
use self::figures::Figures;
use self::http::{LIMIT, PATH, Server};
use linkwatch::Result;
use std::sync::Arc;

/// The option `--metrics`.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = super::WRITE)]
pub struct MetricsArgs {
    /// Serve figures for Prometheus at http://ADDRESS/metrics
    ///
    /// Counters and latencies. A port alone is on the loopback interface (127.0.0.1); port 0 is a
    /// free one, which the log names. Without a password: at any other address (HOST:PORT) whoever
    /// reaches it can read them
    #[arg(long, value_name = "[HOST:]PORT")]
    metrics: Option<Address>,
}

impl MetricsArgs {
    /// Prepares the figures of these services, and serves them if that is requested.
    pub fn serve(&self, services: &[String]) -> Result<Metrics> {
        let figures = Arc::new(Figures::new(services));
        let mut server = None;
        if let Some(address) = &self.metrics {
            let listener = address.listen()?;
            let local = listener.local_addr()?;
            let page = Arc::clone(&figures);
            server = Some(Server::start(listener, LIMIT, move || page.page())?);
            tracing::info!("metrics are at http://{local}{PATH}");
            if !local.ip().to_canonical().is_loopback() {
                tracing::warn!(
                    "anybody on the network can read the metrics, because {} is not an address of \
                     the loopback interface",
                    local.ip()
                );
            }
        }
        Ok(Metrics {
            figures,
            _server: server,
        })
    }
}

/// Figures of all services. They are served until this value is dropped.
pub struct Metrics {
    figures: Arc<Figures>,
    _server: Option<Server>,
}

impl Metrics {
    /// Returns the figures of a service.
    pub fn service(&self, name: &str) -> ServiceMetrics {
        self.figures.service(name)
    }
}
