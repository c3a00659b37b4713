//! A server for browsers: the installed program `rerun`, which contains the viewer for browsers and
//! passes frames on to it. The library could serve them as well, but would be compiled much longer.
//!
//! The server listens on the loopback interface only. It is a process of its own, and stays when
//! the run ends, so that its frames can still be looked at.

use super::stream::failed;
use super::target::{PROBE_LIMIT, PROGRAM, find_program, no_program};
use crate::error::Result;
use std::net::{Ipv4Addr, SocketAddr, TcpStream};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Time limit of the server to listen, and interval of the attempts to connect.
const START_LIMIT: Duration = Duration::from_secs(30);
const INTERVAL: Duration = Duration::from_millis(50);

/// Starts a server, unless one listens. Browsers connect to `port`, and this process to the next
/// one. Returns the URL for this process.
///
/// Errors: one of the ports is in use, or the server does not start.
pub(super) fn start(port: u16) -> Result<String> {
    let Some(frames) = port.checked_add(1).filter(|_| port > 0) else {
        return Err(failed(format_args!("port {port}, expected 1 to 65534")));
    };
    let browsers_url =
        format!("http://127.0.0.1:{port}/?url=rerun%2Bhttp%3A%2F%2F127.0.0.1%3A{frames}%2Fproxy");
    let url = format!("rerun+http://127.0.0.1:{frames}/proxy");
    match [port, frames].map(listens) {
        [true, true] => {
            tracing::info!("frames are shown by the server that runs: {browsers_url}");
            return Ok(url);
        }
        [false, false] => {}
        [used, _] => {
            let used = if used { port } else { frames };
            return Err(failed(format_args!(
                "port {used} is in use; a server for browsers needs ports {port} and {frames}: \
                 choose others (--serve PORT)"
            )));
        }
    }
    let program = find_program().ok_or_else(no_program)?;
    let mut command = Command::new(program);
    command
        .args(["--serve-web", "--bind", "127.0.0.1"])
        .args(["--web-viewer-port".to_owned(), port.to_string()])
        .args(["--port".to_owned(), frames.to_string()])
        .stdin(Stdio::null())
        // It writes to them as long as it runs, and would keep those of this process open.
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    // Ctrl-C at the terminal ends this process, but not the server.
    #[cfg(unix)]
    std::os::unix::process::CommandExt::process_group(&mut command, 0);
    let mut server = command.spawn().map_err(failed)?;
    wait(&mut server, [port, frames])?;
    tracing::info!(
        "a browser shows the frames: {browsers_url} (the server stays when this run ends; \
         `kill -- -{}` ends it)",
        server.id()
    );
    Ok(url)
}

/// Waits until a server listens on all ports.
fn wait(server: &mut Child, ports: [u16; 2]) -> Result<()> {
    let start = Instant::now();
    while !ports.into_iter().all(listens) {
        if let Some(status) = server.try_wait().map_err(failed)? {
            return Err(failed(format_args!(
                "`{PROGRAM} --serve-web` ended before it served ({status}); run it alone to see why"
            )));
        }
        if start.elapsed() > START_LIMIT {
            server.kill().ok();
            return Err(failed(format_args!(
                "`{PROGRAM} --serve-web` did not listen on port {} within {START_LIMIT:?}",
                ports[0]
            )));
        }
        std::thread::sleep(INTERVAL);
    }
    Ok(())
}

/// Returns true if a process listens on a port of the loopback interface.
fn listens(port: u16) -> bool {
    let address = SocketAddr::from((Ipv4Addr::LOCALHOST, port));
    TcpStream::connect_timeout(&address, PROBE_LIMIT).is_ok()
}
