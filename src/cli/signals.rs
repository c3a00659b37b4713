//! Ends a long run properly on the first SIGINT or SIGTERM.

use linkwatch::Result;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

/// Interval at which the signal flag is checked.
pub const TICK: Duration = Duration::from_millis(200);

/// Returns a flag that the first SIGINT or SIGTERM sets. The second one ends the process at once.
pub fn stop_on_signals() -> Result<Arc<AtomicBool>> {
    use signal_hook::consts::{SIGINT, SIGTERM};
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        signal_hook::flag::register_conditional_shutdown(signal, 130, Arc::clone(&stop))?;
        signal_hook::flag::register(signal, Arc::clone(&stop))?;
    }
    Ok(stop)
}

/// Cancels the verification on the first SIGINT or SIGTERM, from a thread that runs as long as the
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
