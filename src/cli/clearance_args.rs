//! The options `--radius` and `--min-clearance` of commands that verify successive frames.

use super::number::{positive, share};
use super::run::recorded;
use linkwatch::{ClearanceOptions, Result};
use std::collections::BTreeMap;

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
    #[arg(long, value_name = "R|published", value_parser = strand_radius)]
    radius: Option<StrandRadius>,
    /// Distance in diameters below which strands are too close
    ///
    /// Distance of centre lines, as a share of the diameter of the strands: 0 to 1, or a
    /// percentage. Below it, a warning is printed, and `--abort-on clearance` stops the simulator
    /// [default: 50%; replay: as recorded]
    #[arg(long, value_name = "SHARE", value_parser = share)]
    min_clearance: Option<f64>,
}

/// Radius of all strands; `None` for those that the simulator publishes.
pub type StrandRadius = Option<f64>;

/// Word for the radii that the simulator publishes.
const PUBLISHED: &str = "published";

/// Parses a radius, or `published`.
pub fn strand_radius(text: &str) -> Result<StrandRadius, String> {
    let given = (text != PUBLISHED).then(|| positive(text)).transpose();
    given.map_err(|e| format!("{e}, or `{PUBLISHED}`"))
}

impl ClearanceArgs {
    /// Returns the options; `None` if clearance is not measured.
    ///
    /// # Errors
    ///
    /// [`Error::Usage`] for a level without a radius.
    pub fn options(&self) -> Result<Option<ClearanceOptions>> {
        if self.radius.is_none() && self.min_clearance.is_some() {
            return Err(usage!("--min-clearance needs --radius"));
        }
        Ok(self.radius.map(|radius| {
            let mut options = ClearanceOptions::new(radius);
            options.low = self.min_clearance.unwrap_or(options.low);
            options
        }))
    }

    /// Adds the options of a recorded run.
    pub fn or_recorded(self, metadata: &BTreeMap<String, String>) -> ClearanceArgs {
        let radius = metadata.get(THICKNESS);
        let radius = radius.and_then(|text| strand_radius(text).ok());
        ClearanceArgs {
            radius: self.radius.or(radius),
            min_clearance: self.min_clearance.or(recorded(metadata, MIN_CLEARANCE)),
        }
    }
}

/// Writes the options to the metadata of a recording.
pub fn write(options: &ClearanceOptions, metadata: &mut BTreeMap<String, String>) {
    let radius = options.radius.map(|radius| radius.to_string());
    let thickness = radius.unwrap_or_else(|| PUBLISHED.into());
    metadata.insert(THICKNESS.into(), thickness);
    metadata.insert(MIN_CLEARANCE.into(), options.low.to_string());
}
