//! Ends a long run properly on the first SIGINT, SIGTERM or SIGHUP.

use linkwatch::Result;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

/// Interval at which the signal flag is checked.
pub const TICK: Duration = Duration::from_millis(200);

/// Returns a flag that the first of these signals sets. The second one ends the process at once.
pub fn stop_on_signals() -> Result<Arc<AtomicBool>> {
    use signal_hook::consts::{SIGINT, SIGTERM};
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM].into_iter().chain(hangup()) {
        signal_hook::flag::register_conditional_shutdown(signal, 130, Arc::clone(&stop))?;
        signal_hook::flag::register(signal, Arc::clone(&stop))?;
    }
    Ok(stop)
}

/// Returns the signal of a terminal that was closed, unless it is ignored, as under `nohup`.
#[cfg(target_os = "linux")]
fn hangup() -> Option<i32> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let mut lines = status.lines();
    let ignored = lines.find_map(|line| line.strip_prefix("SigIgn:"))?;
    let ignored = u64::from_str_radix(ignored.trim(), 16).ok()?;
    let hangup = signal_hook::consts::SIGHUP;
    (ignored >> (hangup - 1) & 1 == 0).then_some(hangup)
}

#[cfg(not(target_os = "linux"))]
fn hangup() -> Option<i32> {
    None
}

/// Cancels the verification on the first of these signals, from a thread that runs as long as the
/// process.
pub fn cancel_on_signals(progress: Arc<linkwatch::Progress>) -> Result<()> {
    use std::sync::atomic::Ordering;
    let stop = stop_on_signals()?;
    let look = move || {
        while !stop.load(Ordering::Relaxed) {
            std::thread::sleep(TICK);
        }
        progress.cancel();
    };
    let thread = std::thread::Builder::new().name("linkwatch-signals".into());
    thread.spawn(look)?;
    Ok(())
}
