//! `linkwatch plan`: what a scene needs, why, and what it will cost.

use super::measure::{self, Measured};
use super::output::plural_of;
use super::{Outcome, input, output};
use linkwatch::{Plan, Result};
use serde_json::json;
use std::path::PathBuf;

/// Say what a scene needs, stage by stage, why, and what it will cost
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Models (.bcc, .obj or .vect), or scenes as `linkwatch generate` takes them
    #[arg(required = true, value_name = "MODEL|SCENE")]
    inputs: Vec<PathBuf>,
    /// Compare with what it does cost: the medians of so many runs
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    repeat: Option<u32>,
}

/// Runs the command.
pub fn run(args: &Args, as_json: bool) -> Result<Outcome> {
    for name in &args.inputs {
        let set = input::read(name)?;
        let plan = Plan::of(&set);
        let measured = args.repeat.map(|n| measure::measure(&set, n));
        if as_json {
            let measured = measured.map(|m| m.later.to_json());
            let (adapter, from) = device().unzip();
            output::json(&json!({
                "model": name,
                "plan": plan,
                "device": adapter,
                "device_from_pairs": from,
                "measured": measured,
            }))?;
            continue;
        }
        output::line(name.display())?;
        for line in plan.to_string().lines() {
            output::line(format_args!("  {line}"))?;
        }
        if let Some((adapter, from)) = device() {
            output::line(format_args!(
                "  device: the processor, but for direct sums over {} and more: {adapter}",
                plural_of(from, "pair of segments", "pairs of segments"),
            ))?;
        }
        if let Some(Measured { later, .. }) = measured {
            output::line(format_args!("  measured: {later}"))?;
        }
    }
    Ok(Outcome::Fine)
}

/// The adapter that `--device auto` takes, and from how many pairs of segments on.
#[cfg(feature = "gpu")]
fn device() -> Option<(String, u64)> {
    let measured = linkwatch::kernels::Calibration::fastest()?;
    let from = measured.break_even()?;
    Some((measured.adapter, from))
}

/// This build knows none.
#[cfg(not(feature = "gpu"))]
fn device() -> Option<(String, u64)> {
    None
}
