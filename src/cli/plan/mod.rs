//! `linkwatch plan`: the methods and the predicted cost of every stage, with reasons.

mod report;

use super::cell_args::CellArgs;
use super::frames::{Selected, Selection};
use super::input::FormatArgs;
#[cfg(feature = "lab")]
use super::repeat;
use super::{Outcome, output};
use linkwatch::kernels::Device;
use linkwatch::model::MODEL_FILES;
use linkwatch::{Error, Plan, Result};
use serde_json::json;
use std::path::PathBuf;

/// Print which method each stage would use for a scene, why, and the predicted cost
#[derive(Debug, clap::Args)]
pub struct Args {
    #[arg(
        required = true, value_name = "MODEL|SCENE",
        help = format!("Models ({MODEL_FILES}), or scenes as `linkwatch generate` takes them")
    )]
    inputs: Vec<PathBuf>,
    #[cfg(feature = "lab")]
    /// Also run it N times, and print the measured medians beside the plan
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    repeat: Option<u32>,
    /// Device that would run the kernels: auto, cpu, gpu, or the index or name of an adapter
    /// (`linkwatch devices`)
    #[arg(long, value_name = "DEVICE", default_value_t, help_heading = super::KERNELS)]
    device: Device,
    #[command(flatten)]
    format: FormatArgs,
    #[command(flatten)]
    cell_args: CellArgs,
}

/// Runs the command.
pub fn run(args: &Args, as_json: bool) -> Result<Outcome> {
    let mut outcome = Outcome::Fine;
    for name in &args.inputs {
        let frames = Selected::open(name, &args.format, args.cell_args, Selection::First)?;
        let picked = frames.one()?;
        outcome = outcome.max(picked.outcome());
        let (set, cell) = (picked.curves, picked.cell);
        let plan = match &cell {
            None => Plan::on(&set, &args.device)?,
            Some(_) if !matches!(args.device, Device::Auto | Device::Cpu) => {
                let what = "a periodic cell excludes a GPU: give --device cpu, or --cell none";
                return Err(Error::Usage(what.into()));
            }
            Some(cell) => Plan::in_cell(&set, cell)?,
        };
        #[cfg(feature = "lab")]
        let measured = match args.repeat {
            Some(_) if cell.is_some() => {
                let what = "--repeat measures the curves alone, without periodic images: give \
                            --cell none";
                return Err(Error::Usage(what.into()));
            }
            Some(n) => Some(repeat::measure(&set, n, &args.device)?.1[1]),
            None => None,
        };
        #[cfg(not(feature = "lab"))]
        let measured: Option<&str> = None;
        if as_json {
            output::json(&json!({ "model": name, "plan": plan, "measured": measured }));
            continue;
        }
        output::line(name.display());
        for line in report::lines(&plan) {
            output::line(format_args!("  {line}"));
        }
        if let Some(later) = measured {
            output::line(format_args!("  measured: {later}"));
        }
    }
    Ok(outcome)
}
