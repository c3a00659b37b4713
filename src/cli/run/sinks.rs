//! Destinations of verified frames: a recording (`--record`), and viewers.

#[cfg(feature = "mcap")]
use super::keep::KeepArgs;
use super::viewer::ViewerArgs;
#[cfg(feature = "mcap")]
use crate::cli::files::Content;
#[cfg(all(feature = "bus", feature = "mcap"))]
use crate::cli::files::with_suffix;
use crate::cli::files::{Files, Overwrite};
#[cfg(feature = "mcap")]
use linkwatch::RecordingTool;
use linkwatch::{ClearanceOptions, Overflow, Result, SinkQueue};
use std::collections::BTreeMap;
#[cfg(any(feature = "bus", feature = "mcap"))]
use std::path::Path;
#[cfg(feature = "mcap")]
use std::path::PathBuf;

/// Maximum number of frames that wait for a sink.
#[cfg(any(feature = "mcap", feature = "rerun"))]
pub(super) const WAITING: usize = 8;

/// Number of points of the frames that may wait for a file in addition: about 50 MB.
#[cfg(any(feature = "mcap", feature = "rerun"))]
pub(super) const WAITING_POINTS: usize = 1_000_000;

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
    #[command(flatten)]
    viewer: ViewerArgs,
    #[command(flatten)]
    pub overwrite: Overwrite,
}

impl Sinks {
    /// Checks the output files, which must differ from all other files of the command.
    pub fn check_files(&self, files: &mut Files) -> Result<()> {
        #[cfg(feature = "mcap")]
        if let Some(path) = &self.record {
            files.writes("--record", path, Content::Recording)?;
        }
        self.viewer.check_files(files)
    }

    /// Returns true if there is an output.
    #[cfg(feature = "mcap")]
    pub fn are_used(&self) -> bool {
        self.viewer.is_live() || !self.paths().is_empty()
    }

    /// Returns these sinks with a suffix in the names of their files.
    #[cfg(feature = "bus")]
    pub fn with_suffix(&self, suffix: &str) -> Sinks {
        Sinks {
            #[cfg(feature = "mcap")]
            record: self.record.as_deref().map(|p| with_suffix(p, suffix)),
            viewer: self.viewer.with_suffix(suffix),
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
            let mut sinks = self.with_suffix(&number.to_string());
            sinks.viewer = sinks.viewer.later();
            if sinks.paths().iter().all(|path| files.is_free(path)) {
                return (sinks, number);
            }
            number += 1;
        }
    }

    /// Returns the output files.
    #[cfg(any(feature = "bus", feature = "mcap"))]
    pub fn paths(&self) -> Vec<&Path> {
        let files: &[Option<&Path>] = &[
            #[cfg(feature = "mcap")]
            self.record.as_deref(),
            self.viewer.path(),
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
        let queues: [Option<SinkQueue>; _] = [
            #[cfg(feature = "mcap")]
            self.open_recording(metadata, overflow)?,
            #[cfg(feature = "rerun")]
            self.viewer
                .open(title, clearance, (overflow, self.overwrite))?,
        ];
        // Not all builds have all sinks.
        let _ = (title, metadata, clearance, overflow);
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
}
