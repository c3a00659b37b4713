//! Curves from what an argument names: a model file or a generated scene.

use linkwatch::scenes::Scene;
use linkwatch::{CurveSet, Error, Result, model};
use std::path::Path;

/// Reads a model file, or builds the scene that the argument describes where it is no file: what has the extension of
/// a model, or exists, is a file.
pub fn read(argument: &Path) -> Result<CurveSet> {
    match model::read(argument) {
        Err(Error::UnknownModel { .. }) if !argument.exists() => {}
        other => return other,
    }
    let text = argument.to_string_lossy();
    let scene: Scene = text.parse().map_err(|e| match e {
        Error::Scene { scene, what } => Error::Scene {
            scene,
            what: format!("{what}; nor is there a file of this name (known: .bcc, .obj, .vect)"),
        },
        other => other,
    })?;
    Ok(scene.build()?.curves)
}
