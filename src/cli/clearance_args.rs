//! The options `--radius` and `--min-clearance` of commands that verify successive frames.

use super::number::{positive, share};
use linkwatch::{ClearanceOptions, Error, Result};
use std::collections::BTreeMap;
use std::str::FromStr;

/// Names in the metadata of a recording.
const THICKNESS: &str = "thickness";
const MIN_CLEARANCE: &str = "min_clearance";

/// Thickness of the strands, to warn before one is pulled through another.
#[derive(Clone, Copy, Debug, Default, clap::Args)]
#[command(next_help_heading = super::COMPARE)]
pub struct ClearanceArgs {
    /// Measure how close the strands come in each frame, and warn when they come too close: strands
    /// of this radius, in the units of the simulation, or `published`: of the radii that the
    /// simulator publishes [default: not measured; replay: as recorded]
    #[arg(long, value_name = "R|published")]
    radius: Option<StrandRadius>,
    /// Distance between center lines, as a share of the diameter of the strands, below which a
    /// warning is printed (and `--abort-on clearance` stops the simulator): 0 to 1, or a percentage
    /// [default: 50%; replay: as recorded]
    #[arg(long, value_name = "SHARE", value_parser = share)]
    min_clearance: Option<f64>,
}

/// Radius of strands: that of all, or those that a simulator publishes.
#[derive(Clone, Copy, Debug)]
pub enum StrandRadius {
    Of(f64),
    Published,
}

impl FromStr for StrandRadius {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        match text {
            "published" => Ok(StrandRadius::Published),
            radius => positive(radius)
                .map(StrandRadius::Of)
                .map_err(|e| format!("{e}, or `published`")),
        }
    }
}

impl ClearanceArgs {
    /// Returns the options of the user, or of a recording where they give none. `None` if clearance
    /// is not measured.
    ///
    /// Errors: [`Error::Usage`] for a level without a thickness.
    pub fn options(&self, recorded: Option<ClearanceOptions>) -> Result<Option<ClearanceOptions>> {
        let options = match self.radius {
            Some(StrandRadius::Of(radius)) => Some(ClearanceOptions::new(Some(radius))),
            Some(StrandRadius::Published) => Some(ClearanceOptions::new(None)),
            None => recorded,
        };
        let Some(mut options) = options else {
            return match self.min_clearance {
                Some(_) => Err(Error::Usage("--min-clearance needs --radius".into())),
                None => Ok(None),
            };
        };
        let recorded = recorded.map(|recorded| recorded.low);
        if let Some(low) = self.min_clearance.or(recorded) {
            options.low = low;
        }
        Ok(Some(options))
    }
}

/// Writes the options to the metadata of a recording.
pub fn write(options: &ClearanceOptions, metadata: &mut BTreeMap<String, String>) {
    let thickness = match options.radius {
        Some(radius) => radius.to_string(),
        None => "published".into(),
    };
    metadata.insert(THICKNESS.into(), thickness);
    metadata.insert(MIN_CLEARANCE.into(), options.low.to_string());
}

/// Reads the options from the metadata of a recording, if it has some.
#[cfg(feature = "mcap")]
pub fn read(metadata: &BTreeMap<String, String>) -> Option<ClearanceOptions> {
    let args = ClearanceArgs {
        radius: metadata.get(THICKNESS)?.parse().ok(),
        min_clearance: metadata.get(MIN_CLEARANCE).and_then(|low| low.parse().ok()),
    };
    args.options(None).ok().flatten()
}
