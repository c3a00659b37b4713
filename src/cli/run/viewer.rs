//! The options `--view`, `--rrd`, `--connect` and `--serve`: viewers of verified frames.

#[cfg(feature = "rerun")]
mod open;

#[cfg(feature = "bus")]
use crate::cli::files::with_suffix;
use crate::cli::files::{Content, Files};
use crate::cli::number::at_least_one;
use linkwatch::{Error, Result};
use std::num::NonZeroU64;
#[cfg(any(feature = "bus", feature = "mcap"))]
use std::path::Path;
use std::path::PathBuf;

/// True in a build without the viewer: its options say how to get one.
const NONE: bool = cfg!(not(feature = "rerun"));

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
}
