//! `--metrics`: figures of a long watch over HTTP, for Prometheus.

mod figures;
mod http;

pub use self::figures::{ServiceMetrics, SessionMetrics};

use self::http::{LIMIT, PATH, Server};
use linkwatch::Result;
use std::io::ErrorKind;
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;

/// Serves the figures at an address until the result is dropped.
pub fn serve(address: &str, figures: &ServiceMetrics) -> Result<Server> {
    let listener = TcpListener::bind(address).map_err(|e| {
        let advice = match e.kind() {
            ErrorKind::AddrInUse => "; give another port, or port 0 for a free one",
            ErrorKind::AddrNotAvailable => "; give an address of this machine",
            ErrorKind::PermissionDenied => "; give a port from 1024 on",
            _ => "",
        };
        usage!("--metrics {address}: {e}{advice}")
    })?;
    let local = listener.local_addr()?;
    let figures = figures.clone();
    let server = Server::start(listener, LIMIT, Arc::new(move || figures.page()))?;
    tracing::info!("metrics are at http://{local}{PATH}");
    let ip = local.ip();
    if !ip.to_canonical().is_loopback() {
        tracing::warn!(
            "anybody on the network can read the metrics, because {ip} is not an address of the \
             loopback interface"
        );
    }
    Ok(server)
}

/// Parses a host and a port. A port alone means the loopback interface of this machine.
pub fn address(text: &str) -> Result<String, &'static str> {
    let (host, port) = text.rsplit_once(':').unwrap_or(("127.0.0.1", text));
    let address = format!("{host}:{port}");
    // Not `+80`.
    let is_port = port.parse::<u16>().is_ok() && port.bytes().all(|b| b.is_ascii_digit());
    // A name has a letter. The system would take "0" for 0.0.0.0: all interfaces.
    let is_name = host.contains(|c: char| c.is_alphabetic())
        && !host.contains(|c: char| c.is_whitespace() || ":[]/*".contains(c));
    let is_valid = is_port && (is_name || address.parse::<SocketAddr>().is_ok());
    let expected = "expected PORT or HOST:PORT, as in 9464, 192.0.2.1:9464 or [2001:db8::1]:9464";
    is_valid.then_some(address).ok_or(expected)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_port_alone_is_on_the_loopback_interface() {
        for (text, full) in [
            ("9464", "127.0.0.1:9464"),
            ("0", "127.0.0.1:0"),
            ("0.0.0.0:80", "0.0.0.0:80"),
            ("[::1]:65535", "[::1]:65535"),
            ("localhost:1", "localhost:1"),
        ] {
            assert_eq!(address(text).unwrap(), full);
        }
    }

    #[test]
    fn malformed_and_abbreviated_addresses_are_refused() {
        for text in [
            "",
            ":9464",
            "0:9464",
            "127.1:9464",
            "*:9464",
            "host",
            "host:",
            "host:65536",
            "+80",
            "host:+80",
            "::1:9464",
            "[::1]",
            "[host]:80",
            "::",
            "http://host:80",
            "a b:80",
            "-1",
        ] {
            assert!(address(text).is_err(), "{text:?}");
        }
    }
}
