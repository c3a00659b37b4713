//! The same scene at other sizes.

use crate::error::Result;
use crate::scenes::Scene;

/// Returns a similar scene with about this number of segments. Garments and chainmail keep their
/// stitches and rings and have fewer or more of them; other curves get shorter or longer segments.
///
/// Errors: the scene cannot have this size.
pub fn resized(scene: &Scene, segments: u64) -> Result<Scene> {
    let value = |name| scene.value(name).unwrap_or(0.0);
    let segments = segments as f64;
    let changes = match scene.kind().name {
        "chainmail" => {
            let (rows, columns) = (value("rows"), value("columns"));
            // Three rings of 15 segments each per row and column.
            let factor = (segments / (45.0 * rows * columns)).sqrt();
            vec![("rows", rows * factor), ("columns", columns * factor)]
        }
        "rubber_bands" => vec![("bands", segments / 50.0)],
        "knit" => {
            let a_row = value("segments") / value("rows");
            let rows = (segments / a_row).round().max(1.0);
            vec![("rows", rows), ("segments", rows * a_row)]
        }
        _ => vec![("segments", segments)],
    };
    let parameters: Vec<String> = scene
        .kind()
        .parameters
        .iter()
        .map(|p| {
            let changed = changes.iter().find(|(name, _)| *name == p.name);
            let changed = changed.map(|(_, value)| value.round().max(1.0));
            format!("{}={}", p.name, changed.unwrap_or_else(|| value(p.name)))
        })
        .collect();
    format!("{}:{}", scene.kind().name, parameters.join(",")).parse()
}

/// Returns scenes of these sizes, without its own size. If none are given: a 64th, a 16th and a 4th
/// of its own, as far as the scene can have them.
///
/// Errors: the scene cannot have a given size.
pub fn at_sizes(scene: &Scene, own: u64, sizes: &[u64]) -> Result<Vec<Scene>> {
    // Some sizes are rejected only when the scene is built.
    let built = |segments| {
        let resized = resized(scene, segments)?;
        resized.build().map(|_| resized)
    };
    let mut scenes: Vec<Scene> = match sizes {
        [] => [64, 16, 4]
            .into_iter()
            .flat_map(|part| built(own / part))
            .collect(),
        _ => sizes
            .iter()
            .map(|&size| built(size))
            .collect::<Result<_>>()?,
    };
    scenes.dedup();
    scenes.retain(|s| s != scene);
    Ok(scenes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenes_get_the_requested_size() {
        for (name, size, near) in [
            ("ribbon", 1000, 0),
            ("woundball", 50_000, 0),
            ("rubber_bands", 1000, 0),
            ("square_link", 20_000, 0),
            ("knit:rows=8,stitches=16,segments=2048", 1024, 0),
            ("chainmail", 10_000, 500),
        ] {
            let scene: Scene = name.parse().unwrap();
            let built = resized(&scene, size).unwrap().build().unwrap();
            let found = built.curves.segments() as u64;
            assert!(found.abs_diff(size) <= near, "{name}: {found}");
        }
        let ribbon: Scene = "ribbon".parse().unwrap();
        assert!(resized(&ribbon, 3).is_err());
        assert_eq!(at_sizes(&ribbon, 200_000, &[]).unwrap().len(), 3);
    }
}
