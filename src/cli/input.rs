//! Reads the curves of an argument: a model file or a generated scene.

use linkwatch::scenes::Scene;
use linkwatch::{CurveSet, Error, Result, model};
use std::path::Path;

/// Reads a model file if the argument has the extension of one or names an existing file. Otherwise
/// builds the scene that the argument describes.
pub fn read(argument: &Path) -> Result<CurveSet> {
    match model::read(argument) {
        Err(Error::UnknownModel { .. }) if !argument.exists() => {}
        other => return other,
    }
    let text = argument.to_string_lossy();
    let scene: Scene = text.parse().map_err(|e| match e {
        Error::Scene { scene, what } => Error::Scene {
            scene,
            what: format!("{what}; and no file has this name (known: .bcc, .obj, .vect, .usd)"),
        },
        other => other,
    })?;
    Ok(scene.build()?.curves)
}
