//! The option `--show`: viewers of verified frames.

use super::sinks::{WAITING, WAITING_POINTS};
#[cfg(feature = "bus")]
use crate::cli::files::with_suffix;
use crate::cli::files::{Content, Files, Overwrite, claim};
use crate::cli::number::at_least_one;
use crate::cli::settings::{named, split};
use linkwatch::{
    ClearanceOptions, Error, Overflow, Result, Sink, SinkQueue, ViewerOptions, ViewerSink,
    ViewerTarget,
};
use std::path::Path;
use std::str::FromStr;
use std::time::Duration;

/// Time limit for a viewer of a live simulation to open before the run begins. After that it opens
/// in the background.
const OPEN: Duration = Duration::from_secs(10);

/// Port of `--show web`: that of the viewer for browsers.
const PORT: u16 = 9090;

/// Settings of a viewer.
const SETTINGS: [&str; 2] = ["every", "only"];

/// Where frames are shown, and which ones.
#[derive(Clone, Debug, PartialEq)]
pub struct Show {
    target: ViewerTarget,
    options: ViewerOptions,
    /// True if the run does not wait until the viewer is open, and continues without it if it
    /// fails.
    later: bool,
}

impl FromStr for Show {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Show, String> {
        let (what, settings) = split(text, &SETTINGS)?;
        let mut options = ViewerOptions::default();
        for (key, value) in settings {
            match (key, value) {
                ("every", n) => options.every = named(key, at_least_one(n))?,
                (_, "violated") => options.only_violated = true,
                _ => return Err("only: expected violated".into()),
            }
        }
        let target = match (what, what.strip_prefix("web:").map(str::parse)) {
            ("live", _) => ViewerTarget::Spawn,
            ("web", _) => ViewerTarget::Serve(PORT),
            (_, Some(Ok(port @ 1..=65534))) => ViewerTarget::Serve(port),
            (_, Some(_)) => return Err("expected a port from 1 to 65534 after `web:`".into()),
            _ if Path::new(what).extension().is_some_and(|e| e == "rrd") => {
                ViewerTarget::File(what.into())
            }
            _ if what.contains(':') => ViewerTarget::Connect(what.into()),
            _ => {
                return Err("expected live, web, web:PORT, a file FILE.rrd or HOST:PORT".into());
            }
        };
        Ok(Show {
            target,
            options,
            later: false,
        })
    }
}

impl Show {
    /// Checks the output file, which must differ from all other files of the command.
    pub fn check_files(&self, files: &mut Files) -> Result<()> {
        match self.path() {
            Some(path) => files.writes("--show", path, Content::Viewer),
            None => Ok(()),
        }
    }

    /// Returns the output file.
    pub fn path(&self) -> Option<&Path> {
        match &self.target {
            ViewerTarget::File(path) => Some(path),
            _ => None,
        }
    }

    /// Returns the same with a suffix in the name of the file.
    #[cfg(feature = "bus")]
    pub fn with_suffix(mut self, suffix: &str) -> Show {
        if let ViewerTarget::File(path) = &mut self.target {
            *path = with_suffix(path, suffix);
        }
        self
    }

    /// Returns the same for a run that does not wait for its viewer.
    #[cfg(feature = "bus")]
    pub fn later(self) -> Show {
        Show {
            later: true,
            ..self
        }
    }

    /// Opens the viewer, or the file at the first frame. `title` names the run. The viewer shows
    /// the clearance if it is measured.
    ///
    /// Errors: a viewer cannot be reached or started.
    pub fn open(
        &self,
        title: &str,
        clearance: Option<ClearanceOptions>,
        (overflow, overwrite): (Overflow, Overwrite),
    ) -> Result<SinkQueue> {
        let title = title.to_owned();
        let options = self.options;
        let open = move |target: &ViewerTarget| {
            let sink = ViewerSink::open(target, &title)?.with_options(options);
            let sink = match clearance {
                Some(clearance) => sink.with_clearance(clearance)?,
                None => sink,
            };
            Ok(Box::new(sink) as Box<dyn Sink>)
        };
        let target = self.target.clone();
        if let ViewerTarget::File(path) = &target {
            let path = path.clone();
            let queue = SinkQueue::spawn("viewer", WAITING, overflow, move || {
                claim(&path, overwrite)?;
                open(&target)
            });
            return Ok(queue?.with_points(WAITING_POINTS));
        }
        let others = match target {
            ViewerTarget::Spawn => ", and --show web shows the frames in a browser",
            _ => "",
        };
        let (overflow, limit) = of_viewer(overflow);
        let queue = SinkQueue::spawn("viewer", WAITING, overflow, move || open(&target))?;
        if !self.later {
            // If the viewer cannot be reached, the command fails at once, not at its first frame.
            queue.open(limit).map_err(|e| {
                let file = "--show FILE.rrd writes a file for a viewer on any machine";
                Error::Usage(format!("{e}; {file}{others}"))
            })?;
        }
        Ok(queue)
    }
}

/// Returns the policy of a viewer if it is slower than the frames, and the time limit for it to
/// open, from the policy of a file.
///
/// No simulator waits for a replay, so that its viewer gets all frames. A file must be complete,
/// because a gap would mislead, but the viewer of a live simulation may miss a frame.
fn of_viewer(overflow: Overflow) -> (Overflow, Duration) {
    match overflow {
        Overflow::WaitForProgress(limit) => (overflow, limit),
        Overflow::Wait(_) | Overflow::DropOldest => (Overflow::DropOldest, OPEN),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_shown_live_in_a_browser_in_a_file_or_at_an_address() {
        let target = |text: &str| text.parse::<Show>().map(|show| show.target);
        assert_eq!(target("live"), Ok(ViewerTarget::Spawn));
        assert_eq!(target("web"), Ok(ViewerTarget::Serve(9090)));
        assert_eq!(target("web:80"), Ok(ViewerTarget::Serve(80)));
        assert_eq!(target("a,b.rrd"), Ok(ViewerTarget::File("a,b.rrd".into())));
        let url = "rerun+http://host:9876/proxy";
        assert_eq!(target(url), Ok(ViewerTarget::Connect(url.into())));
        let show: Show = "run.rrd,every=5,only=violated".parse().unwrap();
        assert!(show.options.every.get() == 5 && show.options.only_violated);
        for bad in [
            "",
            "run.mcap",
            "host",
            "web:0",
            "web:x",
            "live,every=0",
            "live,only=all",
            "live,n=1",
        ] {
            assert!(bad.parse::<Show>().is_err(), "{bad}");
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
