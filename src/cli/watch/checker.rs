//! Judges a frame in a thread, so that the thread of the bus can send heartbeats meanwhile.

use crate::cli::output::words_of;
use crate::cli::run::{Judged, Run};
use crate::cli::signals::TICK;
use linkwatch::{Received, Result};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::{Duration, Instant};

/// Interval of the heartbeats during a long check.
const HEARTBEAT: Duration = Duration::from_secs(1);

/// Judges a frame. A signal cancels the work, and so does an error of `heartbeat`, which is called
/// at intervals.
pub fn judge(
    run: &mut Run,
    frame: Received,
    mut heartbeat: impl FnMut() -> Result<()>,
    stop: &AtomicBool,
) -> Result<Judged> {
    let (progress, live, seq) = (run.session.progress(), run.live.clone(), frame.info().seq);
    let start = Instant::now();
    let mut beat = start;
    let mut failed = None;
    // Disconnected when the check ends.
    let (working, ended) = mpsc::channel::<()>();
    std::thread::scope(|scope| {
        let check = move || {
            let _working = working;
            run.judge(frame)
        };
        let thread = std::thread::Builder::new().name("linkwatch-check".into());
        let thread = thread.spawn_scoped(scope, check)?;
        while ended.recv_timeout(TICK) == Err(RecvTimeoutError::Timeout) {
            if stop.load(Ordering::Relaxed) {
                progress.cancel();
            }
            live.status(format_args!("frame {seq}: {}", words_of(&progress, start)));
            if beat.elapsed() >= HEARTBEAT {
                beat = Instant::now();
                // If the bus fails, the result cannot be sent, so cancel the check.
                if let Err(e) = heartbeat() {
                    progress.cancel();
                    failed.get_or_insert(e);
                }
            }
        }
        let judged = thread.join();
        let judged = judged.unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        failed.map_or(judged, Err)
    })
}
