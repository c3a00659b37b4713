//! The options `--view`, `--rrd`, `--connect` and `--serve`: viewers of verified frames.

#[cfg(feature = "rerun")]
use super::sinks::{WAITING, WAITING_POINTS};
#[cfg(feature = "rerun")]
use crate::cli::files::claim;
#[cfg(feature = "bus")]
use crate::cli::files::with_suffix;
use crate::cli::files::{Content, Files, Overwrite};
use crate::cli::number::at_least_one;
use linkwatch::{ClearanceOptions, Error, Overflow, Result, SinkQueue};
#[cfg(feature = "rerun")]
use linkwatch::{Sink, ViewerOptions, ViewerSink, ViewerTarget};
use std::num::NonZeroU64;
#[cfg(any(feature = "bus", feature = "mcap"))]
use std::path::Path;
use std::path::PathBuf;
#[cfg(feature = "rerun")]
use std::time::Duration;

/// True in a build without the viewer: its options say how to get one.
const NONE: bool = cfg!(not(feature = "rerun"));

/// Time limit for a viewer of a live simulation to open before the run begins. After that it opens
/// in the background.
#[cfg(feature = "rerun")]
const OPEN: Duration = Duration::from_secs(10);

/// Port of `--serve` alone: that of the viewer for browsers.
const SERVE: &str = "9090";

/// Curves that are shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Shown {
    /// All curves
    All,
    /// Curves that took part in a finding so far, and their neighbours
    Violated,
}

/// Where frames are shown, and which ones.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = crate::cli::WRITE)]
#[cfg_attr(
    not(feature = "rerun"),
    allow(dead_code, reason = "none of them reaches a viewer")
)]
pub struct ViewerArgs {
    /// Show every frame in the viewer (opens an installed `rerun`)
    #[arg(long, group = "shown", hide = NONE)]
    view: bool,
    /// Write every frame to a file for the viewer (`rerun FILE.rrd` opens it)
    #[arg(long, value_name = "FILE.rrd", group = "shown", hide = NONE)]
    rrd: Option<PathBuf>,
    /// Show every frame in a running viewer
    #[arg(long, value_name = "URL", group = "shown", hide = NONE)]
    connect: Option<String>,
    /// Show every frame in a browser on this machine: starts an installed `rerun` as a server,
    /// which stays when the run ends, and prints the address. PORT + 1 is
    /// used, too [default PORT: 9090]
    #[arg(
        long, value_name = "PORT", group = "shown", num_args = 0..=1, hide = NONE,
        default_missing_value = SERVE, value_parser = clap::value_parser!(u16).range(1..65535)
    )]
    serve: Option<u16>,
    /// Show the curves of every N-th frame only, and those of each frame whose verdict is not
    /// intact or differs from the previous one; plots and log have all frames
    #[arg(
        long,
        value_name = "N",
        requires = "shown",
        value_parser = at_least_one,
        hide_short_help = true,
        hide = NONE
    )]
    view_every: Option<NonZeroU64>,
    /// Curves to show [default: all]
    #[arg(
        long,
        value_name = "CURVES",
        requires = "shown",
        hide_short_help = true,
        hide = NONE
    )]
    view_only: Option<Shown>,
    /// True if the run does not wait until the viewer is open, and continues without it if it
    /// fails.
    #[arg(skip)]
    later: bool,
}

impl ViewerArgs {
    /// Checks the output file, which must differ from all other files of the command.
    ///
    /// Errors: the build has no viewer.
    pub fn check_files(&self, files: &mut Files) -> Result<()> {
        let options = [
            ("--view", self.view),
            ("--rrd", self.rrd.is_some()),
            ("--connect", self.connect.is_some()),
            ("--serve", self.serve.is_some()),
        ];
        if let Some((option, _)) = options.iter().find(|(_, given)| NONE && *given) {
            return Err(Error::Usage(format!(
                "{option}: this build of linkwatch has no viewer, like that of the Python package; \
                 `cargo install --path . --locked` in its source builds one that has it; --record \
                 FILE.mcap records the run here, and `linkwatch replay FILE.mcap {option}` shows \
                 it there"
            )));
        }
        match &self.rrd {
            Some(path) => files.writes("--rrd", path, Content::Viewer),
            None => Ok(()),
        }
    }

    /// Returns true if frames are shown, and not written to a file.
    #[cfg(feature = "mcap")]
    pub fn is_live(&self) -> bool {
        self.view || self.connect.is_some() || self.serve.is_some()
    }

    /// Returns the output file.
    #[cfg(any(feature = "bus", feature = "mcap"))]
    pub fn path(&self) -> Option<&Path> {
        self.rrd.as_deref()
    }

    /// Returns these arguments with a suffix in the name of the file.
    #[cfg(feature = "bus")]
    pub fn with_suffix(&self, suffix: &str) -> ViewerArgs {
        ViewerArgs {
            rrd: self.rrd.as_deref().map(|path| with_suffix(path, suffix)),
            ..self.clone()
        }
    }

    /// Returns these arguments for a run that does not wait for its viewer.
    #[cfg(feature = "bus")]
    pub fn later(self) -> ViewerArgs {
        ViewerArgs {
            later: true,
            ..self
        }
    }

    #[cfg(not(feature = "rerun"))]
    pub fn open(
        &self,
        _: &str,
        _: Option<ClearanceOptions>,
        _: (Overflow, Overwrite),
    ) -> Result<Option<SinkQueue>> {
        Ok(None)
    }

    /// Opens the viewer, or the file at the first frame. `title` names the run. The viewer shows
    /// the clearance if it is measured.
    ///
    /// Errors: a viewer cannot be reached or started.
    #[cfg(feature = "rerun")]
    pub fn open(
        &self,
        title: &str,
        clearance: Option<ClearanceOptions>,
        (overflow, overwrite): (Overflow, Overwrite),
    ) -> Result<Option<SinkQueue>> {
        let title = title.to_owned();
        let options = ViewerOptions {
            every: self.view_every.unwrap_or(NonZeroU64::MIN),
            only_violated: self.view_only == Some(Shown::Violated),
        };
        let open = move |target: &ViewerTarget| {
            let sink = ViewerSink::open(target, &title)?.with_options(options);
            let sink = match clearance {
                Some(clearance) => sink.with_clearance(clearance)?,
                None => sink,
            };
            Ok(Box::new(sink) as Box<dyn Sink>)
        };
        if let Some(path) = self.rrd.clone() {
            let queue = SinkQueue::spawn("viewer", WAITING, overflow, move || {
                claim(&path, overwrite)?;
                open(&ViewerTarget::File(path))
            });
            return Ok(Some(queue?.with_points(WAITING_POINTS)));
        }
        let target = match (&self.connect, self.serve) {
            (Some(url), _) => ViewerTarget::Connect(url.clone()),
            (None, Some(port)) => ViewerTarget::Serve(port),
            (None, None) if self.view => ViewerTarget::Spawn,
            (None, None) => return Ok(None),
        };
        let others = match target {
            ViewerTarget::Spawn => ", and --serve shows the frames in a browser",
            _ => "",
        };
        let (overflow, limit) = of_viewer(overflow);
        let queue = SinkQueue::spawn("viewer", WAITING, overflow, move || open(&target))?;
        if !self.later {
            // If the viewer cannot be reached, the command fails at once, not at its first frame.
            queue.open(limit).map_err(|e| {
                let file = "--rrd FILE.rrd writes a file for a viewer on any machine";
                Error::Usage(format!("{e}; {file}{others}"))
            })?;
        }
        Ok(Some(queue))
    }
}

/// Returns the policy of a viewer if it is slower than the frames, and the time limit for it to
/// open, from the policy of a file.
///
/// No simulator waits for a replay, so that its viewer gets all frames. A file must be complete,
/// because a gap would mislead, but the viewer of a live simulation may miss a frame.
#[cfg(feature = "rerun")]
fn of_viewer(overflow: Overflow) -> (Overflow, Duration) {
    match overflow {
        Overflow::WaitForProgress(limit) => (overflow, limit),
        Overflow::Wait(_) | Overflow::DropOldest => (Overflow::DropOldest, OPEN),
    }
}

#[cfg(all(test, feature = "rerun"))]
mod tests {
    use super::*;

    #[test]
    fn a_viewer_gets_all_frames_of_a_replay_and_delays_no_live_run() {
        let second = Duration::from_secs(1);
        let replay = Overflow::WaitForProgress(second);
        assert_eq!(of_viewer(replay), (replay, second));
        let live = Overflow::Wait(second);
        assert_eq!(of_viewer(live), (Overflow::DropOldest, OPEN));
    }
}
