//! The options `--radius` and `--min-clearance` of commands that verify successive frames.

use super::number::{positive, share};
use super::run::recorded;
use linkwatch::{ClearanceOptions, Result};
use std::collections::BTreeMap;
use std::str::FromStr;

/// Names in the metadata of a recording.
const THICKNESS: &str = "thickness";
const MIN_CLEARANCE: &str = "min_clearance";

/// Thickness of the strands, to warn before one is pulled through another.
#[derive(Clone, Copy, Debug, Default, PartialEq, clap::Args)]
#[command(next_help_heading = super::COMPARE)]
pub struct ClearanceArgs {
    /// Measure how close strands of this radius come, and warn
    ///
    /// In the units of the simulation, or `published`: the radii that the simulator publishes
    /// [default: not measured; replay: as recorded]
    #[arg(long, value_name = "R|published")]
    radius: Option<StrandRadius>,
    /// Distance in diameters below which strands are too close
    ///
    /// Of center lines, as a share of the diameter of the strands: 0 to 1, or a percentage. Below
    /// it a warning is printed, and `--abort-on clearance` stops the simulator [default: 50%;
    /// replay: as recorded]
    #[arg(long, value_name = "SHARE", value_parser = share)]
    min_clearance: Option<f64>,
}

/// Radius of strands: that of all, or those that a simulator publishes.
#[derive(Clone, Copy, Debug, PartialEq)]
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
    /// Returns the options; `None` if clearance is not measured.
    ///
    /// # Errors
    ///
    /// [`Error::Usage`] for a level without a radius.
    pub fn options(&self) -> Result<Option<ClearanceOptions>> {
        let mut options = match (self.radius, self.min_clearance) {
            (Some(StrandRadius::Of(radius)), _) => ClearanceOptions::new(Some(radius)),
            (Some(StrandRadius::Published), _) => ClearanceOptions::new(None),
            (None, Some(_)) => return Err(usage!("--min-clearance needs --radius")),
            (None, None) => return Ok(None),
        };
        options.low = self.min_clearance.unwrap_or(options.low);
        Ok(Some(options))
    }

    /// Adds the options of a recorded run.
    pub fn or_recorded(self, metadata: &BTreeMap<String, String>) -> ClearanceArgs {
        ClearanceArgs {
            radius: self.radius.or(recorded(metadata, THICKNESS)),
            min_clearance: self.min_clearance.or(recorded(metadata, MIN_CLEARANCE)),
        }
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
