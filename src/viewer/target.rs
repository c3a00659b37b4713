//! Destinations of the viewer sink: a file for later, a running viewer, or one to start, on the
//! screen or for browsers.

use super::names::APPLICATION;
use super::program::{self, PORT, PROBE_LIMIT};
use super::stream::failed;
use crate::error::{Error, Result};
use re_sdk::sink::{FileSink, FileSinkOptions};
use re_sdk::{RecordingStream, RecordingStreamBuilder};
use std::net::{TcpStream, ToSocketAddrs};
use std::path::PathBuf;

/// Destination of frames to show.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ViewerTarget {
    /// A file (`.rrd`) to open later.
    File(PathBuf),
    /// A running viewer: `rerun+http://host:port/proxy`, or `host:port`, or `host`.
    Connect(String),
    /// A new viewer on this machine, or the one that already runs here.
    Spawn,
    /// Browsers on this machine, which open `http://127.0.0.1:PORT`: a new server on this port, or
    /// the one that already runs. It uses the next port as well.
    Serve(u16),
}

impl ViewerTarget {
    pub(super) fn open(&self, title: &str) -> Result<RecordingStream> {
        let builder = RecordingStreamBuilder::new(APPLICATION).recording_name(title);
        let url = match self {
            ViewerTarget::File(path) => {
                // Created here first, so that our error names the file. A pipe without a reader
                // would block without limit.
                if std::fs::metadata(path).is_ok_and(|m| !m.is_file()) {
                    let source = std::io::Error::other("not a regular file");
                    return Err(Error::file(path)(source));
                }
                std::fs::File::create(path).map_err(Error::file(path))?;
                // Its index of all chunks would be in memory until the end of the run.
                let write_footer = false;
                let sink = FileSink::with_options(path, FileSinkOptions { write_footer });
                return builder.set_sinks((sink.map_err(failed)?,)).map_err(failed);
            }
            ViewerTarget::Connect(address) => {
                let (host, url) = address_of(address);
                probe(&host)?;
                url
            }
            ViewerTarget::Spawn => program::show()?,
            ViewerTarget::Serve(port) => program::serve(*port)?,
        };
        builder.connect_grpc_opts(url).map_err(failed)
    }
}

/// Returns the `host:port` to probe, and the URL to connect to.
fn address_of(address: &str) -> (String, String) {
    let (scheme, rest) = address.split_once("://").unwrap_or(("rerun+http", address));
    let (host, path) = rest.split_once('/').unwrap_or((rest, "proxy"));
    // An IPv6 address contains colons, within brackets.
    let host = match host.rsplit_once(':') {
        Some((_, port)) if !port.contains(']') => host.to_owned(),
        _ => format!("{host}:{PORT}"),
    };
    let url = format!("{scheme}://{host}/{path}");
    (host, url)
}

/// Fails unless a viewer listens. Without this check, rerun would buffer frames in memory, and
/// block when the buffer is full.
fn probe(host: &str) -> Result<()> {
    let unreachable = |e: std::io::Error| failed(format_args!("no viewer at {host}: {e}"));
    let mut last = std::io::Error::other("the name has no address");
    for address in host.to_socket_addrs().map_err(unreachable)? {
        match TcpStream::connect_timeout(&address, PROBE_LIMIT) {
            Ok(_) => return Ok(()),
            Err(e) => last = e,
        }
    }
    Err(unreachable(last))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_completed() {
        for (given, host, url) in [
            ("box", "box:9876", "rerun+http://box:9876/proxy"),
            ("box:1", "box:1", "rerun+http://box:1/proxy"),
            ("[::1]", "[::1]:9876", "rerun+http://[::1]:9876/proxy"),
            (
                "rerun+https://a.b:7/proxy",
                "a.b:7",
                "rerun+https://a.b:7/proxy",
            ),
        ] {
            assert_eq!(address_of(given), (host.into(), url.into()), "{given}");
        }
    }

    #[test]
    fn a_missing_viewer_is_an_error_and_does_not_block() {
        // Bound, then closed: the port is free and refuses connections.
        let port = std::net::TcpListener::bind("127.0.0.1:0")
            .and_then(|l| l.local_addr())
            .map(|a| a.port())
            .unwrap();
        let target = ViewerTarget::Connect(format!("127.0.0.1:{port}"));
        let e = target.open("test").err().unwrap().to_string();
        assert!(e.starts_with("viewer: no viewer at 127.0.0.1:"), "{e}");
    }

    #[test]
    fn a_server_needs_two_free_ports() {
        let listener = || std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        let port = |l: &std::net::TcpListener| l.local_addr().unwrap().port();
        // The port before it is free.
        let is_second = |l: &std::net::TcpListener| {
            std::net::TcpListener::bind(("127.0.0.1", port(l) - 1)).is_ok()
        };
        let used = std::iter::repeat_with(listener).find(is_second).unwrap();
        let e = ViewerTarget::Serve(port(&used) - 1)
            .open("test")
            .err()
            .unwrap();
        let why = format!("viewer: port {} is in use", port(&used));
        assert!(e.to_string().starts_with(&why), "{e}");
        for port in [0, u16::MAX] {
            let e = ViewerTarget::Serve(port).open("test").err().unwrap();
            assert!(e.to_string().contains("expected 1 to 65534"), "{e}");
        }
    }

    /// Regression test: the index of all chunks, which is written last, grew in memory during the
    /// run.
    #[test]
    fn a_file_has_no_index() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.rrd");
        let rec = ViewerTarget::File(path.clone()).open("test").unwrap();
        super::super::log(
            &rec,
            "text",
            &re_sdk_types::archetypes::TextDocument::new("a"),
        )
        .unwrap();
        drop(rec);
        let bytes = std::fs::read(path).unwrap();
        assert!(bytes.starts_with(b"RRF2"));
        // An index is followed by its place.
        assert!(!bytes.windows(4).any(|bytes| bytes == b"FOOT"));
    }

    #[test]
    fn the_error_of_a_file_that_cannot_be_created_names_it() {
        let target = ViewerTarget::File("/no/such/folder/a.rrd".into());
        let e = target.open("test").err().unwrap().to_string();
        assert!(e.starts_with("/no/such/folder/a.rrd: "), "{e}");
    }
}
