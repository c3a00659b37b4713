//! `linkwatch study`: measurements that alternate, in one run, what is measured with what it is compared to.

mod frames;

use super::Outcome;
use clap::Subcommand;
use linkwatch::scenes::Scene;
use linkwatch::{CurveSet, Result, model};
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

/// Reads the model, where there is such a file or the name is that of one; builds the scene otherwise.
fn model_or_scene(text: &str) -> Result<Input> {
    let path = Path::new(text);
    let extension = path.extension().unwrap_or_default();
    let named = ["bcc", "obj", "vect"].map(|known| extension.eq_ignore_ascii_case(known));
    if named.contains(&true) || path.exists() {
        return Ok(Input {
            curves: model::read(path)?,
            diameter: None,
        });
    }
    let scene: Scene = text.parse()?;
    Ok(Input {
        curves: scene.build()?.curves,
        diameter: scene.value("diameter"),
    })
}
