//! The installed program `rerun`: a viewer on the screen, or a server for browsers, which contains
//! the viewer for them and passes frames on to it. The library could serve them as well, but would
//! be compiled much longer.
//!
//! The program listens on the loopback interface only. It is a process of its own, and stays when
//! the run ends, so that its frames can still be looked at.

use super::stream::failed;
use crate::error::Result;
use std::io::ErrorKind;
use std::net::{Ipv4Addr, SocketAddr, TcpStream};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Default port of viewers.
pub(super) const PORT: u16 = 9876;

/// Time limit of a running program to accept a connection.
pub(super) const PROBE_LIMIT: Duration = Duration::from_secs(2);

/// Name of the program.
const PROGRAM: &str = "rerun";

/// Time limit of the program to listen, and interval of the attempts to connect.
const START_LIMIT: Duration = Duration::from_secs(60);
const INTERVAL: Duration = Duration::from_millis(50);

/// Memory in which a server keeps frames for browsers that open later. By default it keeps 1 GiB,
/// and drops the oldest frames without a word.
const SERVER_MEMORY: &str = "--server-memory-limit=50%";

/// Variables of the environment that name a screen on Linux.
const SCREENS: [&str; 3] = ["WAYLAND_DISPLAY", "WAYLAND_SOCKET", "DISPLAY"];

/// Starts a viewer on the screen, unless one listens. Returns its URL.
///
/// # Errors
///
/// There is no screen or no program, or the viewer does not start.
pub(super) fn show() -> Result<String> {
    let url = format!("rerun+http://127.0.0.1:{PORT}/proxy");
    if listens(PORT) {
        tracing::info!("frames are shown by the viewer that runs");
        return Ok(url);
    }
    let is_set = |name| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    if cfg!(target_os = "linux") && !SCREENS.into_iter().any(is_set) {
        let names = SCREENS.join(", ");
        let what = format!("no screen to show frames on: none of {names} is set");
        return Err(failed(what));
    }
    let mut command = program()?;
    command
        .args(["--bind", "127.0.0.1", "--hide-welcome-screen"])
        .args(["--expect-data-soon", "--port", &PORT.to_string()]);
    start(command, &[PORT], "")?;
    Ok(url)
}

/// Starts a server, unless one listens. Browsers connect to `port`, and this process to the next
/// one. Returns the URL for this process.
///
/// # Errors
///
/// One of the ports is in use, or the server does not start.
pub(super) fn serve(port: u16) -> Result<String> {
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
                 choose others"
            )));
        }
    }
    let mut command = program()?;
    command
        .args(["--serve-web", "--bind", "127.0.0.1", SERVER_MEMORY])
        .args(["--web-viewer-port", &port.to_string()])
        .args(["--port", &frames.to_string()]);
    let server = start(command, &[port, frames], " --serve-web")?;
    tracing::info!(
        "a browser shows the frames: {browsers_url} (the server stays when this run ends; \
         `kill -- -{server}` ends it)"
    );
    Ok(url)
}

/// Returns a command that starts the installed program. Warns if its version is another one than
/// that of this library.
fn program() -> Result<Command> {
    // Version of the viewer that frames are written for.
    let version = re_sdk::build_info().version.to_string();
    let mut command = Command::new(PROGRAM);
    let printed = command.arg("--version").stdin(Stdio::null()).output();
    let printed = printed.map_err(|e| match e.kind() {
        ErrorKind::NotFound => failed(format_args!(
            "no program `{PROGRAM}` in PATH to show frames; `pip install rerun-sdk=={version}` \
             installs it"
        )),
        _ => failed(format_args!("`{PROGRAM}`: {e}")),
    })?;
    // `rerun-cli 0.36.3 [..]`
    let text = String::from_utf8_lossy(&printed.stdout);
    if let Some(installed) = text.split_whitespace().nth(1)
        && installed != version
    {
        tracing::warn!(
            "`{PROGRAM}`: version {installed} may not show frames of version {version}; `pip \
             install rerun-sdk=={version}` installs that one"
        );
    }
    Ok(Command::new(PROGRAM))
}

/// Starts the program, waits until it listens on all ports, and returns its process id. `mode` is
/// an option for messages.
fn start(mut command: Command, ports: &[u16], mode: &str) -> Result<u32> {
    command
        .stdin(Stdio::null())
        // It writes to them as long as it runs, and would keep those of this process open.
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    // Ctrl-C at the terminal ends this process, but not the program.
    #[cfg(unix)]
    std::os::unix::process::CommandExt::process_group(&mut command, 0);
    let mut process = command.spawn().map_err(failed)?;
    let start = Instant::now();
    while !ports.iter().copied().all(listens) {
        if let Some(status) = process.try_wait().map_err(failed)? {
            return Err(failed(format_args!(
                "`{PROGRAM}{mode}` ended before it listened ({status}); run it alone to see why"
            )));
        }
        if start.elapsed() > START_LIMIT {
            process.kill().ok();
            return Err(failed(format_args!(
                "`{PROGRAM}{mode}` did not listen on port {} within {START_LIMIT:?}",
                ports[0]
            )));
        }
        std::thread::sleep(INTERVAL);
    }
    Ok(process.id())
}

/// Returns true if a process listens on a port of the loopback interface.
fn listens(port: u16) -> bool {
    let address = SocketAddr::from((Ipv4Addr::LOCALHOST, port));
    TcpStream::connect_timeout(&address, PROBE_LIMIT).is_ok()
}
