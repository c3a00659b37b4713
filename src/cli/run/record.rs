//! The option `--record`: the file of a recording, and the frames that it keeps.

use crate::cli::number::{at_least_one, bytes, seconds};
use crate::cli::settings::{parsed, split};
use linkwatch::{RecordingOptions, Retention};

/// Parses `FILE.mcap,every=10,..`.
pub fn recording(text: &str) -> Result<RecordingOptions, String> {
    let (path, settings) = split(text, &["every", "window", "memory", "max"])?;
    let mut options = RecordingOptions::new(path);
    let every = parsed(&settings, "every", at_least_one)?;
    let window = parsed(&settings, "window", seconds)?;
    let memory = parsed(&settings, "memory", bytes)?;
    options.max_bytes = parsed(&settings, "max", file_bytes)?;
    options.retention = match (every, window) {
        (Some(_), Some(_)) => return Err("every and window exclude each other".into()),
        (Some(n), None) => Retention::Every(n),
        (None, Some(span)) => Retention::Window {
            span,
            memory: memory.unwrap_or(Retention::WINDOW_MEMORY),
        },
        (None, None) => Retention::All,
    };
    if memory.is_some() && window.is_none() {
        return Err("memory needs window".into());
    }
    Ok(options)
}

/// Parses the maximum size of a file.
fn file_bytes(text: &str) -> Result<u64, String> {
    match bytes(text)? {
        size if size < RecordingOptions::LEAST_MAX_BYTES => Err("expected at least 1MB".into()),
        size => Ok(size),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn a_recording_has_the_settings_that_follow_its_file() {
        let text = "a,b.mcap,window=2,memory=1MiB,max=5MB";
        let options = recording(text).unwrap();
        assert_eq!(options.path.to_str(), Some("a,b.mcap"));
        let window = Retention::Window {
            span: Duration::from_secs(2),
            memory: 1 << 20,
        };
        assert_eq!(options.retention, window);
        assert_eq!(options.max_bytes, Some(5_000_000));
        for (bad, word) in [
            ("run.mcap,every=0", "every: expected an integer"),
            ("run.mcap,every=2,window=1", "exclude each other"),
            ("run.mcap,memory=1GB", "memory needs window"),
            ("run.mcap,keep=2", "no setting 'keep'"),
            ("run.mcap,max=1kB", "at least 1MB"),
            ("run.mcap,for=rerun", "no setting 'for'"),
        ] {
            let error = recording(bad).unwrap_err();
            assert!(error.contains(word), "{bad}: {error}");
        }
    }
}
