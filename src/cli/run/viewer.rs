//! The option `--show`: viewers of verified frames.

use crate::cli::files::{Content, Files, Overwrite};
use crate::cli::number::at_least_one;
use crate::cli::settings::{named, split};
use linkwatch::{ClearanceOptions, Overflow, Result, SinkQueue};
use std::num::NonZeroU64;
use std::path::Path;
use std::str::FromStr;

/// Where frames are shown, and which ones.
#[derive(Clone, Debug, PartialEq)]
pub struct Show {
    target: String,
    /// Curves are shown of every n-th frame.
    every: NonZeroU64,
    /// True if the run does not wait until the viewer is open, and continues without it if it
    /// fails.
    later: bool,
}

impl FromStr for Show {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Show, String> {
        let (target, settings) = split(text, &["every"])?;
        live::check(target)?;
        let mut every = NonZeroU64::MIN;
        for (key, value) in settings {
            every = named(key, at_least_one(value))?;
        }
        Ok(Show {
            target: target.to_owned(),
            every,
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
        let path = Path::new(&self.target);
        path.extension().is_some_and(|e| e == "rrd").then_some(path)
    }

    /// Returns the same with a suffix in the name of the file.
    #[cfg(feature = "bus")]
    pub fn with_suffix(mut self, suffix: &str) -> Show {
        if let Some(path) = self.path() {
            let path = crate::cli::files::with_suffix(path, suffix);
            self.target = path.to_string_lossy().into_owned();
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
    /// # Errors
    ///
    /// A viewer cannot be reached or started.
    pub fn open(
        &self,
        title: &str,
        clearance: Option<ClearanceOptions>,
        (overflow, overwrite): (Overflow, Overwrite),
    ) -> Result<SinkQueue> {
        live::open(self, title, clearance, (overflow, overwrite))
    }
}

/// A build without a viewer says how to get one.
#[cfg(not(feature = "rerun"))]
mod live {
    use super::*;

    pub fn check(target: &str) -> std::result::Result<(), String> {
        Err(format!(
            "this build of linkwatch has no viewer, like that of the Python package; `cargo \
             install --path . --locked` in its source builds one that has it; --record FILE.mcap \
             records the run here, and `linkwatch replay FILE.mcap --show {target}` shows it there"
        ))
    }

    pub fn open(
        show: &Show,
        _: &str,
        _: Option<ClearanceOptions>,
        _: (Overflow, Overwrite),
    ) -> Result<SinkQueue> {
        Err(linkwatch::Error::Usage(show.target.clone()))
    }
}

#[cfg(feature = "rerun")]
mod live {
    use super::*;
    use crate::cli::run::sinks::{WAITING, WAITING_POINTS};
    use linkwatch::{Error, Sink, ViewerSink, ViewerTarget};
    use std::time::Duration;

    /// Time limit for a viewer of a live simulation to open before the run begins. After that it
    /// opens in the background.
    pub const OPEN: Duration = Duration::from_secs(10);

    /// Port of `--show web`: that of the viewer for browsers.
    const PORT: u16 = 9090;

    pub fn check(text: &str) -> std::result::Result<(), String> {
        target(text).map(drop)
    }

    pub fn target(what: &str) -> std::result::Result<ViewerTarget, String> {
        Ok(match (what, what.strip_prefix("web:").map(str::parse)) {
            ("live", _) => ViewerTarget::Spawn,
            ("web", _) => ViewerTarget::Serve(PORT),
            (_, Some(Ok(port @ 1..=65534))) => ViewerTarget::Serve(port),
            (_, Some(_)) => return Err("expected a port from 1 to 65534 after `web:`".into()),
            _ if Path::new(what).extension().is_some_and(|e| e == "rrd") => {
                ViewerTarget::File(what.into())
            }
            _ if what.contains(':') => ViewerTarget::Connect(what.into()),
            _ if what.ends_with(".mcap") => return Err("--record writes a recording".into()),
            _ => return Err("expected live, web, web:PORT, a file FILE.rrd or HOST:PORT".into()),
        })
    }

    pub fn open(
        show: &Show,
        title: &str,
        clearance: Option<ClearanceOptions>,
        (overflow, overwrite): (Overflow, Overwrite),
    ) -> Result<SinkQueue> {
        let (title, every) = (title.to_owned(), show.every);
        let target = target(&show.target).map_err(Error::Usage)?;
        let others = match target {
            ViewerTarget::Spawn => ", and --show web shows the frames in a browser",
            _ => "",
        };
        let is_file = show.path().is_some();
        let open = move || {
            if let ViewerTarget::File(path) = &target
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
        if is_file {
            let queue = SinkQueue::spawn("viewer", WAITING, overflow, open)?;
            return Ok(queue.with_points(WAITING_POINTS));
        }
        let (overflow, limit) = of_viewer(overflow);
        let queue = SinkQueue::spawn("viewer", WAITING, overflow, open)?;
        if !show.later {
            // If the viewer cannot be reached, the command fails at once, not at its first frame.
            queue.open(limit).map_err(|e| {
                let file = "--show FILE.rrd writes a file for a viewer on any machine";
                Error::Usage(format!("{e}; {file}{others}"))
            })?;
        }
        Ok(queue)
    }

    /// Returns the policy of a viewer if it is slower than the frames, and the time limit for it to
    /// open, from the policy of a file.
    ///
    /// No simulator waits for a replay, so that its viewer gets all frames. A file must be
    /// complete, because a gap would mislead, but the viewer of a live simulation may miss a frame.
    pub fn of_viewer(overflow: Overflow) -> (Overflow, Duration) {
        match overflow {
            Overflow::WaitForProgress(limit) => (overflow, limit),
            Overflow::Wait(_) | Overflow::DropOldest => (Overflow::DropOldest, OPEN),
        }
    }
}

#[cfg(all(test, feature = "rerun"))]
mod tests {
    use super::live::{OPEN, of_viewer, target};
    use super::*;
    use linkwatch::ViewerTarget;
    use std::time::Duration;

    #[test]
    fn frames_are_shown_live_in_a_browser_in_a_file_or_at_an_address() {
        assert_eq!(target("live"), Ok(ViewerTarget::Spawn));
        assert_eq!(target("web"), Ok(ViewerTarget::Serve(9090)));
        assert_eq!(target("web:80"), Ok(ViewerTarget::Serve(80)));
        assert_eq!(target("a,b.rrd"), Ok(ViewerTarget::File("a,b.rrd".into())));
        let url = "rerun+http://host:9876/proxy";
        assert_eq!(target(url), Ok(ViewerTarget::Connect(url.into())));
        let show: Show = "run.rrd,every=5".parse().unwrap();
        assert!(show.every.get() == 5 && show.path() == Some(Path::new("run.rrd")));
        for bad in [
            "",
            "run.mcap",
            "host",
            "web:0",
            "web:x",
            "live,every=0",
            "live,only=violated",
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
