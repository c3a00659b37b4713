//! The options of `--record`: which frames are recorded, and in how many files.

use crate::cli::number::{at_least_one, bytes, seconds};
use linkwatch::{RecordingOptions, Retention};
use std::num::NonZeroU64;
use std::time::Duration;

/// Frames that a recording keeps.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = crate::cli::WRITE)]
pub struct KeepArgs {
    /// Record all verdicts, but the curves only of every N-th frame, of frames that are not intact,
    /// and of the frame before each of these
    #[arg(
        long,
        value_name = "N",
        requires = "record",
        conflicts_with = "record_window",
        value_parser = at_least_one,
        hide_short_help = true
    )]
    record_every: Option<NonZeroU64>,
    /// Record only violations: the frames of this time before each new one, and after it. Until
    /// then frames wait in memory. Without a violation there is no file
    #[arg(long, value_name = "SECONDS", requires = "record", value_parser = seconds)]
    record_window: Option<Duration>,
    /// Memory for the frames of --record-window that wait. If it is too small for the time, the
    /// oldest ones are dropped, and the summary says so [default: 1GiB]
    #[arg(
        long,
        value_name = "SIZE",
        requires = "record_window",
        value_parser = bytes,
        hide_short_help = true
    )]
    record_window_memory: Option<u64>,
    /// Begin another file before the recording exceeds a size, at least 1MB (`500MB`, `2GiB`):
    /// `run.mcap`, `run-part2.mcap`, .. Each one can be replayed without the others
    #[arg(long, value_name = "SIZE", requires = "record", value_parser = file_bytes)]
    record_max: Option<u64>,
    /// Keep only the last K files of --record-max, and the one with the first violation [default:
    /// all]
    #[arg(
        long,
        value_name = "K",
        requires = "record_max",
        value_parser = at_least_one,
        hide_short_help = true
    )]
    record_keep: Option<NonZeroU64>,
}

impl KeepArgs {
    /// Applies these options to a recording.
    pub fn apply(&self, options: &mut RecordingOptions) {
        options.retention = match (self.record_every, self.record_window) {
            (Some(n), _) => Retention::Every(n),
            (None, Some(span)) => Retention::Window {
                span,
                memory: self
                    .record_window_memory
                    .unwrap_or(Retention::WINDOW_MEMORY),
            },
            (None, None) => Retention::All,
        };
        options.max_bytes = self.record_max;
        options.keep_files = self.record_keep;
    }
}

/// Parses the maximum size of a file.
fn file_bytes(text: &str) -> Result<u64, String> {
    match bytes(text)? {
        size if size < RecordingOptions::LEAST_MAX_BYTES => Err("expected at least 1MB".into()),
        size => Ok(size),
    }
}
