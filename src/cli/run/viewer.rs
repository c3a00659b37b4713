//! The option `--show`: viewers of verified frames.

use crate::cli::files::Overwrite;
use crate::cli::number::at_least_one;
#[cfg(feature = "rerun")]
use crate::cli::run::sinks::{WAITING, WAITING_POINTS};
use crate::cli::settings::{parsed, split};
use linkwatch::{ClearanceOptions, Overflow, Result, SinkQueue};
#[cfg(feature = "rerun")]
use linkwatch::{Error, Sink, ViewerSink, ViewerTarget as Target};
#[cfg(not(feature = "rerun"))]
use std::convert::Infallible as Target;
use std::num::NonZeroU64;
use std::path::Path;
#[cfg(feature = "rerun")]
use std::time::Duration;

/// Time limit for a viewer to open before the run of a live simulation begins. After that, it opens
/// in the background.
#[cfg(feature = "rerun")]
const OPEN: Duration = Duration::from_secs(10);

/// Port of `--show web`: that of the viewer for browsers.
#[cfg(feature = "rerun")]
const PORT: u16 = 9090;

/// Viewer or file that shows frames, and the frames to show.
#[derive(Clone, Debug, PartialEq)]
pub struct Show {
    target: Target,
    /// Curves are shown of every n-th frame.
    every: NonZeroU64,
    /// True if the run does not wait until the viewer is open, and continues if it cannot be
    /// opened.
    later: bool,
}

/// Parses the target of `--show` and the settings that follow it.
pub fn show(text: &str) -> Result<Show, String> {
    let (what, settings) = split(text, &["every"])?;
    let target = target(what)?;
    let every = parsed(&settings, "every", at_least_one)?;
    Ok(Show {
        target,
        every: every.unwrap_or(NonZeroU64::MIN),
        later: false,
    })
}

/// Without the feature, explains how to get a viewer.
#[cfg(not(feature = "rerun"))]
fn target(what: &str) -> Result<Target, String> {
    Err(format!(
        "this build of linkwatch has no viewer, like that of the Python package; `cargo install \
         --path . --locked` in its source builds one that has it; --record FILE.mcap records the \
         run here, and `linkwatch replay FILE.mcap --show {what}` shows it there"
    ))
}

#[cfg(feature = "rerun")]
fn target(what: &str) -> Result<Target, String> {
    Ok(match (what, what.strip_prefix("web:").map(str::parse)) {
        ("live", _) => Target::Spawn,
        ("web", _) => Target::Serve(PORT),
        (_, Some(Ok(port @ 1..=65534))) => Target::Serve(port),
        (_, Some(_)) => return Err("expected a port from 1 to 65534 after `web:`".into()),
        _ if Path::new(what).extension().is_some_and(|e| e == "rrd") => Target::File(what.into()),
        _ if what.contains(':') => Target::Connect(what.into()),
        _ if what.ends_with(".mcap") => return Err("--record writes a recording".into()),
        _ => return Err("expected live, web, web:PORT, a file FILE.rrd or HOST:PORT".into()),
    })
}

impl Show {
    /// Returns the output file.
    pub fn path(&self) -> Option<&Path> {
        match &self.target {
            #[cfg(feature = "rerun")]
            Target::File(path) => Some(path),
            _ => None,
        }
    }

    /// Returns the viewer of a later run: with a suffix in the name of the file, and without
    /// waiting until it is open.
    pub fn later(mut self, suffix: &str) -> Show {
        #[cfg(feature = "rerun")]
        if let Target::File(path) = &mut self.target {
            *path = crate::cli::files::with_suffix(path, suffix);
        }
        let _ = suffix;
        self.later = true;
        self
    }

    #[cfg(not(feature = "rerun"))]
    pub fn open(
        &self,
        _: &str,
        _: Option<ClearanceOptions>,
        _: Overflow,
        _: Overwrite,
    ) -> Result<SinkQueue> {
        match self.target {}
    }

    /// Opens the viewer, or the file at the first frame. `title` names the run. The viewer shows
    /// the clearance if it is measured.
    ///
    /// # Errors
    ///
    /// A viewer cannot be reached or started.
    #[cfg(feature = "rerun")]
    pub fn open(
        &self,
        title: &str,
        clearance: Option<ClearanceOptions>,
        overflow: Overflow,
        overwrite: Overwrite,
    ) -> Result<SinkQueue> {
        let (title, every, target) = (title.to_owned(), self.every, self.target.clone());
        let open = move || {
            if let Target::File(path) = &target
                && !overwrite.force
            {
                std::fs::File::create_new(path).map_err(Error::file(path))?;
            }
            let mut sink = ViewerSink::open(&target, &title)?.with_every(every);
            if let Some(clearance) = clearance {
                sink = sink.with_clearance(clearance)?;
            }
            Ok(Box::new(sink) as Box<dyn Sink>)
        };
        if self.path().is_some() {
            let queue = SinkQueue::spawn("viewer", WAITING, overflow, open)?;
            return Ok(queue.with_points(WAITING_POINTS));
        }
        let (overflow, limit) = of_viewer(overflow);
        let queue = SinkQueue::spawn("viewer", WAITING, overflow, open)?;
        if !self.later {
            // Opened here, so that the command fails immediately if the viewer cannot be reached.
            queue.open(limit).map_err(|e| {
                let others = match self.target {
                    Target::Spawn => ", and --show web shows the frames in a browser",
                    _ => "",
                };
                let file = "--show FILE.rrd writes a file for a viewer on any machine";
                usage!("{e}; {file}{others}")
            })?;
        }
        Ok(queue)
    }
}

/// Returns what happens if a viewer is slower than the frames, and the time limit for opening it.
/// `overflow` is the policy for files.
///
/// In a replay, no simulator waits, so the viewer gets all frames. A file must be complete, because
/// a gap would mislead. A viewer of a live simulation may miss frames.
#[cfg(feature = "rerun")]
fn of_viewer(overflow: Overflow) -> (Overflow, Duration) {
    match overflow {
        Overflow::WaitForProgress(limit) => (overflow, limit),
        Overflow::Wait(_) | Overflow::DropOldest => (Overflow::DropOldest, OPEN),
    }
}

#[cfg(test)]
#[cfg(feature = "rerun")]
mod tests {
    use super::*;

    #[test]
    fn frames_are_shown_live_in_a_browser_in_a_file_or_at_an_address() {
        assert_eq!(target("live"), Ok(Target::Spawn));
        assert_eq!(target("web"), Ok(Target::Serve(9090)));
        assert_eq!(target("web:80"), Ok(Target::Serve(80)));
        assert_eq!(target("a,b.rrd"), Ok(Target::File("a,b.rrd".into())));
        let url = "rerun+http://host:9876/proxy";
        assert_eq!(target(url), Ok(Target::Connect(url.into())));
        let found = show("run.rrd,every=5").unwrap();
        assert!(found.every.get() == 5 && found.path() == Some(Path::new("run.rrd")));
        for bad in [
            "",
            "run.mcap",
            "host",
            "web:0",
            "web:x",
            "live,every=0",
            "live,only=violated",
        ] {
            assert!(show(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn a_viewer_gets_all_frames_of_a_replay_and_delays_no_live_run() {
        let second = Duration::from_secs(1);
        let replay = Overflow::WaitForProgress(second);
        assert_eq!(of_viewer(replay), (replay, second));
        let live = Overflow::Wait(second);
        assert_eq!(of_viewer(live), (Overflow::DropOldest, OPEN));
    }
}
