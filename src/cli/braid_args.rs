//! The option `--braid` of every command that verifies frames.

use linkwatch::formats::unpacked;
use linkwatch::{Braids, Error, Result};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Name of the braids in the metadata of a recording: `auto`, or JSON.
pub const BRAID: &str = "braid";

/// Word for braids that are found in the first frame.
const AUTO: &str = "auto";

/// Open curves between rigid ends.
#[derive(Clone, Debug, Default, clap::Args)]
#[command(next_help_heading = super::COMPARE)]
pub struct BraidArgs {
    /// Verify open curves between two rigid ends
    ///
    /// As virtual closed loops, of at least 4 curves each: `auto` finds the ends in the first
    /// frame, a JSON file names the curves [replay: as recorded]
    #[arg(long, value_name = "auto|FILE")]
    braid: Option<PathBuf>,
    /// Braids of a recording.
    #[arg(skip)]
    recorded: Option<Braids>,
}

impl BraidArgs {
    /// Returns the file of braids, if one is given.
    pub fn file(&self) -> Option<&Path> {
        let path = self.braid.as_deref();
        path.filter(|path| *path != Path::new(AUTO))
    }

    /// Returns the braids, if there are some.
    pub fn braids(&self) -> Result<Option<Braids>> {
        match self.file() {
            Some(path) => unpacked(path, Braids::read).map(Some),
            None if self.braid.is_some() => Ok(Some(Braids::Auto)),
            None => Ok(self.recorded.clone()),
        }
    }

    /// Adds the braids of a recorded run.
    pub fn or_recorded(mut self, metadata: &BTreeMap<String, String>) -> Result<BraidArgs> {
        self.recorded = match metadata.get(BRAID).map(String::as_str) {
            None => None,
            Some(AUTO) => Some(Braids::Auto),
            Some(text) => Some(Braids::from_json(text)?),
        };
        Ok(self)
    }
}

/// Adds braids to the metadata of a recording.
pub fn write(braids: &Braids, metadata: &mut BTreeMap<String, String>) {
    let text = match braids {
        Braids::Auto => AUTO.to_owned(),
        given => given.to_json(),
    };
    metadata.insert(BRAID.to_owned(), text);
}

/// Returns the error of ends that would be found in another frame than those of the baseline.
pub fn other_first_frame(what: &str) -> Error {
    usage!(
        "--braid auto finds the ends of braids in the first frame, but {what}: give the ends of \
         that frame (`linkwatch certify MODEL --braid auto --write-braid ends.json`, then --braid \
         ends.json)"
    )
}
