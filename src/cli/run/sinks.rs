//! Destinations of verified frames: a recording (`--record`) and a viewer (`--show`).

use super::record::recording;
use super::viewer::{Show, show};
use super::{PATIENCE, PATIENT, Setup};
use crate::cli::files::{Content, Files, Overwrite, with_suffix};
use linkwatch::{ClearanceOptions, Overflow, RecordingOptions, Result, SinkQueue};
use std::path::Path;

/// Maximum number of frames that wait for a sink.
pub(super) const WAITING: usize = 8;

/// More than [`WAITING`] frames may wait for a file if they have at most this number of points:
/// about 50 MB.
pub(super) const WAITING_POINTS: usize = 1_000_000;

/// Destinations of verified frames.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = crate::cli::WRITE)]
pub struct Sinks {
    /// Record frames and verdicts: FILE,every=10,max=1GB,..
    ///
    /// To an MCAP file: every verified frame, unless settings follow the name.
    /// every=N: curves only of every N-th frame, of frames that are not intact, and of the frame
    /// before each of these; all verdicts.
    /// window=SECONDS: only the frames of this time before each new violation, and after it; until
    /// then they wait in memory (memory=SIZE, 1GiB unless given; the oldest ones are dropped beyond
    /// it, and the summary says so). Without a violation there is no file.
    /// max=SIZE: begin another file before the recording exceeds this size, at least 1MB
    /// (`run-part2.mcap`, ..). Each one can be replayed without the others
    #[arg(long, value_name = "FILE.mcap[,..]", value_parser = recording)]
    record: Option<RecordingOptions>,
    /// Show frames: live, web, FILE.rrd or an address
    ///
    /// `live` in the viewer (an installed `rerun`), `web` or `web:PORT` in a browser on this
    /// machine, FILE.rrd in a file for the viewer, HOST:PORT or a URL in a running viewer. Settings
    /// follow: `run.rrd,every=10` shows the curves of every 10th frame, and of each frame whose
    /// verdict is not intact or differs from the previous one (plots and log have all frames).
    /// `web` starts an installed `rerun` as a server, which stays when the run ends,
    /// and prints the address; port 9090 and the next one unless given
    #[arg(long, value_name = "WHERE[,..]", value_parser = show)]
    show: Option<Show>,
    #[command(flatten)]
    pub overwrite: Overwrite,
}

impl Sinks {
    /// Checks the output files, which must differ from all other files of the command.
    pub fn check_files(&self, files: &mut Files) -> Result<()> {
        let recorded = self.record.iter().map(|record| &record.path);
        files.writes("--record", recorded, Content::Recording)?;
        let shown = self.show.iter().filter_map(Show::path);
        files.writes("--show", shown, Content::Viewer)
    }

    /// Returns the sinks of a later run, and the number in their names: the next number whose files
    /// do not exist, or may be overwritten.
    ///
    /// A later run does not wait for its viewer to open, because a simulator is already running.
    pub fn numbered(&self, mut number: u64, files: &Files) -> (Sinks, u64) {
        loop {
            let (mut sinks, suffix) = (self.clone(), number.to_string());
            if let Some(record) = &mut sinks.record {
                record.path = with_suffix(&record.path, &suffix);
            }
            sinks.show = sinks.show.map(|show| show.later(&suffix));
            if sinks.paths().iter().all(|path| files.is_free(path)) {
                return (sinks, number);
            }
            number += 1;
        }
    }

    /// Returns the output files.
    pub fn paths(&self) -> Vec<&Path> {
        let recorded = self.record.iter().map(|record| record.path.as_path());
        let shown = self.show.iter().filter_map(Show::path);
        recorded.chain(shown).collect()
    }

    /// Opens the sinks of a run. Files are created at the first frame. The viewer shows the
    /// clearance if it is measured.
    pub fn open(&self, run: &Setup, clearance: Option<ClearanceOptions>) -> Result<Vec<SinkQueue>> {
        let overflow = match run.live {
            true => Overflow::Wait(PATIENCE),
            false => PATIENT,
        };
        let mut queues = Vec::new();
        if let Some(record) = &self.record {
            let mut options = record.clone();
            options.metadata = run.metadata.clone();
            options.overwrite = self.overwrite.force;
            let queue = SinkQueue::spawn("recording", WAITING, overflow, move || options.open())?;
            queues.push(queue.with_points(WAITING_POINTS));
        }
        if let Some(show) = &self.show {
            queues.push(show.open(&run.title, clearance, overflow, self.overwrite)?);
        }
        Ok(queues)
    }
}
