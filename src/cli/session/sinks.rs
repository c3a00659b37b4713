//! The options `--record`, `--view`, `--rrd`, `--connect` and `--serve`: destinations of verified
//! frames.

#[cfg(feature = "mcap")]
use super::keep::KeepArgs;
#[cfg(any(feature = "mcap", feature = "rerun"))]
use crate::cli::files::Content;
#[cfg(feature = "rerun")]
use crate::cli::files::claim;
#[cfg(all(feature = "bus", any(feature = "mcap", feature = "rerun")))]
use crate::cli::files::with_suffix;
use crate::cli::files::{Files, Overwrite};
#[cfg(feature = "rerun")]
use crate::cli::number::at_least_one;
#[cfg(feature = "mcap")]
use linkwatch::RecordingTool;
use linkwatch::{ClearanceOptions, Overflow, Result, SinkQueue};
#[cfg(feature = "rerun")]
use linkwatch::{Sink, ViewerOptions, ViewerSink, ViewerTarget};
use std::collections::BTreeMap;
#[cfg(feature = "rerun")]
use std::num::NonZeroU64;
#[cfg(feature = "bus")]
use std::path::Path;
#[cfg(any(feature = "mcap", feature = "rerun"))]
use std::path::PathBuf;
#[cfg(feature = "rerun")]
use std::time::Duration;

/// Maximum number of frames that wait for a sink.
#[cfg(any(feature = "mcap", feature = "rerun"))]
const WAITING: usize = 8;

/// Number of points of the frames that may wait for a file in addition: about 50 MB.
#[cfg(any(feature = "mcap", feature = "rerun"))]
const WAITING_POINTS: usize = 1_000_000;

/// Time limit for a viewer to open before the run begins. After that it opens in the background.
#[cfg(feature = "rerun")]
const OPEN: Duration = Duration::from_secs(10);

/// Tools that show a recording by themselves.
#[cfg(feature = "mcap")]
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Tool {
    /// The curves as lines (foxglove.SceneUpdate): thinned, those with findings in full
    Foxglove,
    /// The curves as points (foxglove.PointCloud)
    Rerun,
}

#[cfg(feature = "mcap")]
impl From<Tool> for RecordingTool {
    fn from(tool: Tool) -> RecordingTool {
        match tool {
            Tool::Foxglove => RecordingTool::Foxglove,
            Tool::Rerun => RecordingTool::Rerun,
        }
    }
}

/// Port of `--serve` alone: that of the viewer for browsers.
#[cfg(feature = "rerun")]
const SERVE: &str = "9090";

/// Curves that are shown.
#[cfg(feature = "rerun")]
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Shown {
    /// All curves
    All,
    /// Curves that took part in a finding so far, and their neighbours
    Violated,
}

/// Destinations of verified frames.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = crate::cli::WRITE)]
pub struct Sinks {
    /// Record every verified frame and verdict to an MCAP file
    #[cfg(feature = "mcap")]
    #[arg(long, value_name = "FILE.mcap")]
    record: Option<PathBuf>,
    /// Add messages to the recording that other tools draw, so that they show it by themselves
    #[cfg(feature = "mcap")]
    #[arg(
        long,
        value_name = "TOOL,..",
        value_delimiter = ',',
        requires = "record"
    )]
    record_for: Vec<Tool>,
    #[cfg(feature = "mcap")]
    #[command(flatten)]
    keep: KeepArgs,
    /// Show every frame in the viewer (opens an installed `rerun`)
    #[cfg(feature = "rerun")]
    #[arg(long, group = "shown")]
    view: bool,
    /// Write every frame to a file for the viewer (`rerun FILE.rrd` opens it)
    #[cfg(feature = "rerun")]
    #[arg(long, value_name = "FILE.rrd", group = "shown")]
    rrd: Option<PathBuf>,
    /// Show every frame in a running viewer
    #[cfg(feature = "rerun")]
    #[arg(long, value_name = "URL", group = "shown")]
    connect: Option<String>,
    /// Show every frame in a browser on this machine: starts an installed `rerun` as a server,
    /// which stays when the run ends, and prints the address. PORT + 1 is
    /// used, too [default PORT: 9090]
    #[cfg(feature = "rerun")]
    #[arg(
        long, value_name = "PORT", group = "shown", num_args = 0..=1,
        default_missing_value = SERVE, value_parser = clap::value_parser!(u16).range(1..65535)
    )]
    serve: Option<u16>,
    /// Show the curves of every N-th frame only, and those of each frame whose verdict is not
    /// intact or differs from the previous one; plots and log have all frames
    #[cfg(feature = "rerun")]
    #[arg(
        long,
        value_name = "N",
        requires = "shown",
        value_parser = at_least_one,
        hide_short_help = true
    )]
    view_every: Option<NonZeroU64>,
    /// Curves to show [default: all]
    #[cfg(feature = "rerun")]
    #[arg(
        long,
        value_name = "CURVES",
        requires = "shown",
        hide_short_help = true
    )]
    view_only: Option<Shown>,
    #[command(flatten)]
    pub overwrite: Overwrite,
    /// True if the run does not wait until the viewer is open, and continues without it if it
    /// fails.
    #[cfg(feature = "rerun")]
    #[arg(skip)]
    view_later: bool,
}

impl Sinks {
    /// Checks the output files, which must differ from all other files of the command.
    #[cfg_attr(
        not(any(feature = "mcap", feature = "rerun")),
        expect(unused_variables, reason = "no sink writes a file")
    )]
    pub fn check_files(&self, files: &mut Files) -> Result<()> {
        #[cfg(feature = "mcap")]
        if let Some(path) = &self.record {
            files.writes("--record", path, Content::Recording)?;
        }
        #[cfg(feature = "rerun")]
        if let Some(path) = &self.rrd {
            files.writes("--rrd", path, Content::Viewer)?;
        }
        Ok(())
    }

    /// Returns true if there is an output.
    #[cfg(feature = "bus")]
    pub fn are_used(&self) -> bool {
        #[cfg(feature = "rerun")]
        if self.view || self.connect.is_some() || self.serve.is_some() {
            return true;
        }
        !self.paths().is_empty()
    }

    /// Returns these sinks with a suffix in the names of their files.
    #[cfg(feature = "bus")]
    #[cfg_attr(
        not(any(feature = "mcap", feature = "rerun")),
        expect(unused_variables, reason = "no sink writes a file")
    )]
    pub fn with_suffix(&self, suffix: &str) -> Sinks {
        Sinks {
            #[cfg(feature = "mcap")]
            record: self.record.as_deref().map(|p| with_suffix(p, suffix)),
            #[cfg(feature = "rerun")]
            rrd: self.rrd.as_deref().map(|p| with_suffix(p, suffix)),
            ..self.clone()
        }
    }

    /// Returns the sinks of a later run, and their number: the next one for which no file exists
    /// that may not be overwritten.
    ///
    /// A later run does not wait for its viewer, because a simulator is there already.
    #[cfg(feature = "bus")]
    pub fn numbered(&self, mut number: u64, files: &Files) -> (Sinks, u64) {
        loop {
            let sinks = Sinks {
                #[cfg(feature = "rerun")]
                view_later: true,
                ..self.with_suffix(&number.to_string())
            };
            if sinks.paths().iter().all(|path| files.is_free(path)) {
                return (sinks, number);
            }
            number += 1;
        }
    }

    /// Returns the output files.
    #[cfg(feature = "bus")]
    pub fn paths(&self) -> Vec<&Path> {
        let files: &[Option<&Path>] = &[
            #[cfg(feature = "mcap")]
            self.record.as_deref(),
            #[cfg(feature = "rerun")]
            self.rrd.as_deref(),
        ];
        files.iter().flatten().copied().collect()
    }

    /// Opens the sinks. Files are created at the first frame. `title` names the run in the viewer,
    /// which shows the clearance if it is measured.
    pub fn open(
        &self,
        title: &str,
        metadata: &BTreeMap<String, String>,
        (clearance, overflow): (Option<ClearanceOptions>, Overflow),
    ) -> Result<Vec<SinkQueue>> {
        let queues = [
            self.open_recording(metadata, overflow)?,
            self.open_viewer(title, clearance, overflow)?,
        ];
        Ok(queues.into_iter().flatten().collect())
    }

    #[cfg(feature = "mcap")]
    fn open_recording(
        &self,
        metadata: &BTreeMap<String, String>,
        overflow: Overflow,
    ) -> Result<Option<SinkQueue>> {
        let Some(path) = self.record.clone() else {
            return Ok(None);
        };
        let mut options = linkwatch::RecordingOptions::new(path);
        options.metadata = metadata.clone();
        options.overwrite = self.overwrite.force;
        options.tools = self.record_for.iter().map(|t| (*t).into()).collect();
        self.keep.apply(&mut options);
        let queue = SinkQueue::spawn("recording", WAITING, overflow, move || options.open())?;
        Ok(Some(queue.with_points(WAITING_POINTS)))
    }

    #[cfg(not(feature = "mcap"))]
    fn open_recording(
        &self,
        _: &BTreeMap<String, String>,
        _: Overflow,
    ) -> Result<Option<SinkQueue>> {
        Ok(None)
    }

    #[cfg(feature = "rerun")]
    fn open_viewer(
        &self,
        title: &str,
        clearance: Option<ClearanceOptions>,
        overflow: Overflow,
    ) -> Result<Option<SinkQueue>> {
        let (title, overwrite) = (title.to_owned(), self.overwrite);
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
        // A file must be complete, because a gap would mislead; a live viewer may miss a frame.
        let queue = SinkQueue::spawn("viewer", WAITING, Overflow::DropOldest, move || {
            open(&target)
        })?;
        if !self.view_later {
            // If the viewer cannot be reached, the command fails at once, not at its first frame.
            queue.open(OPEN)?;
        }
        Ok(Some(queue))
    }

    #[cfg(not(feature = "rerun"))]
    fn open_viewer(
        &self,
        _: &str,
        _: Option<ClearanceOptions>,
        _: Overflow,
    ) -> Result<Option<SinkQueue>> {
        Ok(None)
    }
}
