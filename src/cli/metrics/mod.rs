//! `--metrics`: figures of a long watch over HTTP, for Prometheus.

mod address;
mod figures;
mod http;

pub use self::figures::{ServiceMetrics, SessionMetrics};

use self::address::Address;
use self::http::{LIMIT, PATH, Server};
use linkwatch::Result;

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
    /// Serves the figures until the result is dropped, if that is requested.
    pub fn serve(&self, figures: &ServiceMetrics) -> Result<Option<Server>> {
        let Some(address) = &self.metrics else {
            return Ok(None);
        };
        let listener = address.listen()?;
        let local = listener.local_addr()?;
        let figures = figures.clone();
        let server = Server::start(listener, LIMIT, move || figures.page())?;
        tracing::info!("metrics are at http://{local}{PATH}");
        if !local.ip().to_canonical().is_loopback() {
            tracing::warn!(
                "anybody on the network can read the metrics, because {} is not an address of the \
                 loopback interface",
                local.ip()
            );
        }
        Ok(Some(server))
    }
}
