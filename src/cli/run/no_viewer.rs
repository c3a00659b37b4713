//! The option `--show` in a build without the feature `rerun`: it says how to get a viewer.

use crate::cli::files::{Files, Overwrite};
use linkwatch::{ClearanceOptions, Overflow, Result, SinkQueue};
use std::path::Path;
use std::str::FromStr;

/// A viewer, which this build does not have.
#[derive(Clone, Debug)]
pub enum Show {}

impl FromStr for Show {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Show, String> {
        Err(format!(
            "this build of linkwatch has no viewer, like that of the Python package; `cargo \
             install --path . --locked` in its source builds one that has it; --record FILE.mcap \
             records the run here, and `linkwatch replay FILE.mcap --show {text}` shows it there"
        ))
    }
}

impl Show {
    pub fn check_files(&self, _: &mut Files) -> Result<()> {
        match *self {}
    }

    pub fn path(&self) -> Option<&Path> {
        match *self {}
    }

    #[cfg(feature = "bus")]
    pub fn with_suffix(self, _: &str) -> Show {
        match self {}
    }

    #[cfg(feature = "bus")]
    pub fn later(self) -> Show {
        match self {}
    }

    pub fn open(
        &self,
        _: &str,
        _: Option<ClearanceOptions>,
        _: (Overflow, Overwrite),
    ) -> Result<SinkQueue> {
        match *self {}
    }
}
