//! Tables as files of comma-separated values. A row is written as soon as it is measured.

use crate::cli::files::{Content, Files};
use linkwatch::{Error, Result};
use serde_json::Value;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

/// File of rows with these fields; writes nothing if no file was requested.
pub struct Csv {
    file: Option<(PathBuf, File)>,
    fields: &'static [&'static str],
}

impl Csv {
    /// Creates the file and writes its header. Call this before the measurements, so that an
    /// invalid path fails at once.
    pub fn create(path: Option<&Path>, fields: &'static [&'static str]) -> Result<Csv> {
        let file = match path {
            Some(path) => {
                let file = File::create(path).map_err(|e| failed(path, e))?;
                Some((path.to_owned(), file))
            }
            None => None,
        };
        let mut csv = Csv { file, fields };
        csv.line(fields.join(","))?;
        Ok(csv)
    }

    /// Writes the fields of an object. Missing or null fields are empty.
    pub fn row(&mut self, object: &Value) -> Result<()> {
        let fields: Vec<String> = self.fields.iter().map(|f| field(&object[*f])).collect();
        self.line(fields.join(","))
    }

    fn line(&mut self, line: String) -> Result<()> {
        let Some((path, file)) = &mut self.file else {
            return Ok(());
        };
        let line = line + "\n";
        file.write_all(line.as_bytes()).map_err(|e| failed(path, e))
    }
}

/// Checks the outputs of a study: a table, and plots of these names in a folder, each as PNG and
/// SVG. Creates the folder unless it exists.
pub fn check_outputs(
    files: &mut Files,
    csv: Option<&Path>,
    plot: Option<&Path>,
    plots: &[&str],
) -> Result<()> {
    if let Some(file) = csv {
        files.writes("--csv", file, Content::Text)?;
    }
    let Some(folder) = plot else {
        return Ok(());
    };
    std::fs::create_dir_all(folder).map_err(|e| failed(folder, e))?;
    for name in plots {
        for extension in ["png", "svg"] {
            let file = folder.join(name).with_extension(extension);
            files.writes("--plot", &file, Content::Plot)?;
        }
    }
    Ok(())
}

fn failed(path: &Path, source: std::io::Error) -> Error {
    let path = path.to_owned();
    Error::File { path, source }
}

/// Formats a value, in quotes if it has a comma, as scenes do.
fn field(value: &Value) -> String {
    match value {
        Value::Null => String::new(),
        Value::String(s) if s.contains([',', '"', '\n']) => {
            format!("\"{}\"", s.replace('"', "\"\""))
        }
        Value::String(s) => s.clone(),
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quotes_texts_with_commas() {
        assert_eq!(field(&"ribbon".into()), "ribbon");
        assert_eq!(field(&"a:b=1,c=2".into()), "\"a:b=1,c=2\"");
        assert_eq!(field(&"a \"b\"".into()), "\"a \"\"b\"\"\"");
        assert_eq!(field(&Value::Null), "");
        assert_eq!(field(&2.5.into()), "2.5");
    }
}
