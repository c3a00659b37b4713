//! Arguments of the command, and words for its output.

use linkwatch::formats::{Frames, MODEL_FILES, ReadOptions};
use linkwatch::scenes::Scene;
use linkwatch::{Closing, CurveSet, CurveSource, Error, Result};
use std::path::Path;

/// Reads the first frame of a model, or builds a scene: an argument that no file has as its name.
/// Curves that end where they start are closed.
pub fn read(argument: &str) -> Result<CurveSet> {
    let path = Path::new(argument);
    let mut options = ReadOptions::default();
    // Torn curves are refused for their cell.
    options.wrapped = Some(true);
    let mut frames = match Frames::open(path, &options) {
        Err(Error::UnknownModel { .. }) if !path.exists() => return scene(argument),
        frames => frames?,
    };
    let frame = frames.next().transpose()?;
    let frame = frame.ok_or_else(|| usage(format!("{argument}: a file without frames")))?;
    if let Some(cell) = frame.info.cell {
        return Err(usage(format!(
            "{argument}: the frame has a periodic cell ({cell}), but studies consider the curves \
             alone: `linkwatch convert` writes them to a format without a cell, .bcc for example"
        )));
    }
    let source = CurveSource {
        closed_by_default: frame.info.closed_by_default,
        ..CurveSource::default()
    };
    let set = frame.curves.map_err(|e| e.in_file(path))?;
    let closed = Closing::default().of_set(&set, source);
    Ok(closed.map_err(|e| e.in_file(path))?.unwrap_or(set))
}

fn scene(argument: &str) -> Result<CurveSet> {
    let scene = argument.parse::<Scene>().map_err(|e| match e {
        Error::Scene { scene, what } => usage(format!(
            "scene {scene}: {what}; and no file has this name (kinds of files: {MODEL_FILES})"
        )),
        other => other,
    })?;
    Ok(scene.build()?.curves)
}

/// Returns the scene that an argument describes, unless it is a file.
pub fn as_scene(argument: &str) -> Option<Scene> {
    argument.parse().ok()
}

/// Returns the error of arguments that cannot be used.
pub fn usage(what: String) -> Error {
    Error::Usage(what)
}

/// Returns the diameter of the strands: the given one, or that of the scene.
pub fn diameter(given: Option<f64>, scene: Option<&Scene>, name: &str) -> Result<f64> {
    let own = || scene?.value("diameter");
    given.or_else(own).ok_or_else(|| {
        usage(format!(
            "{name} has no diameter, the unit of the motion: give --diameter"
        ))
    })
}

/// Parses a number above 0.
pub fn positive(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(x) if f64::is_finite(x) && x > 0.0 => Ok(x),
        _ => Err("expected a number above 0".into()),
    }
}

/// Parses a number of at least `least`.
pub fn at_least(least: f64, text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(x) if f64::is_finite(x) && x >= least => Ok(x),
        _ => Err(format!("expected numbers of at least {least}")),
    }
}

/// Parses a number of segments, possibly written as `2e5`.
pub fn segments(text: &str) -> Result<u64, String> {
    match text.parse::<f64>() {
        Ok(x) if (1.0..=f64::from(i32::MAX)).contains(&x) && x.fract() == 0.0 => Ok(x as u64),
        _ => Err(format!(
            "expected numbers of segments, from 1 to {}",
            i32::MAX
        )),
    }
}

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
    let parameters = scene.kind().parameters.iter().map(|p| {
        let changed = changes.iter().find(|(name, _)| *name == p.name);
        let changed = changed.map(|(_, value)| value.round().max(1.0));
        format!("{}={}", p.name, changed.unwrap_or_else(|| value(p.name)))
    });
    let parameters: Vec<String> = parameters.collect();
    format!("{}:{}", scene.kind().name, parameters.join(",")).parse()
}

/// Creates the folder of plots.
pub fn create_folder(folder: &Path) -> Result<()> {
    std::fs::create_dir_all(folder).map_err(|source| Error::File {
        path: folder.to_owned(),
        source,
    })
}

/// Returns the number of threads that compute.
pub fn threads() -> usize {
    rayon::current_num_threads()
}

/// Formats a count with separators, `211,680`.
pub fn count(n: u64) -> String {
    match n {
        0..1000 => n.to_string(),
        _ => format!("{},{:03}", count(n / 1000), n % 1000),
    }
}

/// Formats a count with its noun, `1 link`, `2 links`.
pub fn plural(n: usize, noun: &str) -> String {
    match n {
        1 => format!("1 {noun}"),
        _ => format!("{} {noun}s", count(n as u64)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenes_get_the_requested_size() {
        for (name, size, near) in [
            ("ribbon", 1000, 0),
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
        assert!(resized(&"ribbon".parse().unwrap(), 3).is_err());
    }

    #[test]
    fn counts_have_separators() {
        assert_eq!([7, 1000, 1_045_007].map(count), ["7", "1,000", "1,045,007"]);
        assert_eq!(plural(1, "link"), "1 link");
    }
}
