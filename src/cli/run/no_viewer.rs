//! The options of the viewer in a build without the feature `rerun`: they say how to get it.

use crate::cli::files::{Files, Overwrite};
use linkwatch::{ClearanceOptions, Error, Overflow, Result, SinkQueue};
#[cfg(any(feature = "bus", feature = "mcap"))]
use std::path::Path;

/// Options of the viewer, which none of them reaches.
#[derive(Clone, Debug, clap::Args)]
pub struct ViewerArgs {
    #[arg(long, hide = true, group = "shown")]
    view: bool,
    #[arg(long, hide = true, group = "shown", num_args = 0..=1, default_missing_value = "")]
    rrd: Option<String>,
    #[arg(long, hide = true, group = "shown", num_args = 0..=1, default_missing_value = "")]
    connect: Option<String>,
    #[arg(long, hide = true, group = "shown", num_args = 0..=1, default_missing_value = "")]
    serve: Option<String>,
    #[arg(long, hide = true, num_args = 0..=1, default_missing_value = "")]
    view_every: Option<String>,
    #[arg(long, hide = true, num_args = 0..=1, default_missing_value = "")]
    view_only: Option<String>,
}

impl ViewerArgs {
    /// Returns an error if one of the options is given.
    pub fn check_files(&self, _: &mut Files) -> Result<()> {
        let options = [
            ("--view", self.view),
            ("--rrd", self.rrd.is_some()),
            ("--connect", self.connect.is_some()),
            ("--serve", self.serve.is_some()),
            ("--view-every", self.view_every.is_some()),
            ("--view-only", self.view_only.is_some()),
        ];
        let Some((option, _)) = options.into_iter().find(|(_, given)| *given) else {
            return Ok(());
        };
        Err(Error::Usage(format!(
            "{option}: this build of linkwatch has no viewer, like that of the Python package; \
             `cargo install --path . --locked` in its source builds one that has it; --record \
             FILE.mcap records the run here, and `linkwatch replay FILE.mcap {option}` shows it \
             there"
        )))
    }

    #[cfg(feature = "mcap")]
    pub fn is_live(&self) -> bool {
        false
    }

    #[cfg(any(feature = "bus", feature = "mcap"))]
    pub fn path(&self) -> Option<&Path> {
        None
    }

    #[cfg(feature = "bus")]
    pub fn with_suffix(&self, _: &str) -> ViewerArgs {
        self.clone()
    }

    #[cfg(feature = "bus")]
    pub fn later(self) -> ViewerArgs {
        self
    }

    pub fn open(
        &self,
        _: &str,
        _: Option<ClearanceOptions>,
        _: (Overflow, Overwrite),
    ) -> Result<Option<SinkQueue>> {
        Ok(None)
    }
}
