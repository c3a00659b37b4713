//! `linkwatch study`: measurements that alternate, in one run, what is measured with what it is compared to.

mod frames;

use super::{Outcome, input};
use clap::Subcommand;
use linkwatch::scenes::Scene;
use linkwatch::{CurveSet, Result};
use std::path::Path;

/// Measure what verification costs, beside what it is compared with
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(subcommand)]
    study: Study,
}

#[derive(Debug, Subcommand)]
enum Study {
    Frames(frames::Args),
}

/// Runs the command.
pub fn run(args: &Args, as_json: bool) -> Result<Outcome> {
    match &args.study {
        Study::Frames(args) => frames::run(args, as_json),
    }
}

/// Curves from a file or a scene.
struct Input {
    curves: CurveSet,
    /// Diameter of the yarn, where the scene has one.
    diameter: Option<f64>,
}

/// Reads the model or builds the scene that an argument names.
fn model_or_scene(text: &str) -> Result<Input> {
    Ok(Input {
        curves: input::read(Path::new(text))?,
        diameter: text.parse().ok().and_then(|s: Scene| s.value("diameter")),
    })
}
