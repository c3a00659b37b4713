//! Thread that judges frames, so that the thread of the bus can send heartbeats meanwhile.

use crate::cli::output::{count, plural};
use crate::cli::run::{Judged, Run};
use crate::cli::signals::TICK;
use linkwatch::{Received, Result};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::{Duration, Instant};

/// Interval of the heartbeats during a long check.
const HEARTBEAT: Duration = Duration::from_secs(1);

/// A frame to judge, and the session that judges it.
pub struct Work {
    pub session: Box<Run>,
    pub seq: u64,
    pub frame: Received,
}

impl Work {
    /// Judges the frame on this thread.
    pub fn judge(self) -> (Box<Run>, Result<Judged>) {
        let Work {
            mut session, frame, ..
        } = self;
        let judged = session.judge(frame);
        (session, judged)
    }
}

/// Judges frames in a thread, while the caller checks the signals and sends heartbeats.
pub struct Checker {
    to: mpsc::Sender<Work>,
    from: mpsc::Receiver<(Box<Run>, Result<Judged>)>,
}

impl Checker {
    /// Starts the thread. It ends when this value is dropped.
    pub fn start() -> Result<Checker> {
        let (to, frames) = mpsc::channel::<Work>();
        let (verdicts, from) = mpsc::channel();
        let judge = move || {
            for work in frames {
                // The receiver has ended if the watch has failed.
                let _ = verdicts.send(work.judge());
            }
        };
        let thread = std::thread::Builder::new().name("linkwatch-check".into());
        thread.spawn(judge)?;
        Ok(Checker { to, from })
    }

    /// Judges a frame. A signal cancels the work, and so does an error of `heartbeat`, which is
    /// called at intervals.
    pub fn judge(
        &self,
        work: Work,
        mut heartbeat: impl FnMut() -> Result<()>,
        stop: &AtomicBool,
    ) -> (Box<Run>, Result<Judged>) {
        let Work { session, seq, .. } = &work;
        let (progress, live, seq) = (session.progress(), session.live().clone(), *seq);
        let start = Instant::now();
        let mut beat = start;
        let mut failed = None;
        self.to
            .send(work)
            .expect("the thread lives as long as this sender");
        loop {
            match self.from.recv_timeout(TICK) {
                Ok((session, judged)) => return (session, failed.map_or(judged, Err)),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => panic!("the check panicked"),
            }
            if stop.load(Ordering::Relaxed) {
                progress.cancel();
            }
            let (done, total) = progress.pairs();
            let work = match total {
                0 => "finding pairs that come close".to_owned(),
                _ => format!("{} of {}", count(done), plural(total, "pair")),
            };
            let seconds = start.elapsed().as_secs_f64();
            live.status(format_args!("frame {seq}: {work} in {seconds:.0} s"));
            if beat.elapsed() >= HEARTBEAT {
                beat = Instant::now();
                // If the bus fails, the result cannot be sent, so cancel the check.
                if let Err(e) = heartbeat() {
                    progress.cancel();
                    failed.get_or_insert(e);
                }
            }
        }
    }
}
