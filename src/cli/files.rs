//! Files that a command reads and writes: an output replaces no input, no other output, and
//! (without `--force`) no existing file.

use linkwatch::{Error, Result};
use std::fs::{File, OpenOptions};
use std::path::{Path, PathBuf};

/// The `--force` option of every command that writes files.
#[derive(Clone, Copy, Debug, Default, clap::Args)]
#[command(next_help_heading = super::WRITE)]
pub struct Overwrite {
    /// Overwrite existing output files
    #[arg(long)]
    pub force: bool,
}

/// Content of an output file. The extension must not suggest other content.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Content {
    /// Lines of text. The output may also be a pipe or a device.
    Text,
    /// A generated scene.
    Scene,
    /// A model in any format that has a writer.
    Model,
    Recording,
    Viewer,
}

impl Content {
    /// Returns an error text if the extension does not fit the content.
    fn refuse_extension(self, extension: &str) -> Option<&'static str> {
        const OTHERS: [&str; 7] = ["bcc", "obj", "vect", "npy", "npz", "mcap", "rrd"];
        Some(match self {
            Content::Text if OTHERS.contains(&extension) => {
                "that is a model, a recording or a file of the viewer; the output is text"
            }
            Content::Scene if extension != "bcc" => "scenes are written as .bcc",
            Content::Recording if extension != "mcap" => {
                "a recording is an .mcap file; --show writes a file for the viewer (.rrd)"
            }
            Content::Viewer if extension != "rrd" => {
                "a file for the viewer is an .rrd file; --record writes a recording (.mcap)"
            }
            _ => return None,
        })
    }
}

/// All files of a command, checked one by one before its work starts.
#[derive(Clone)]
pub struct Files {
    overwrite: Overwrite,
    /// Inputs and outputs, with their names for messages.
    known: Vec<(PathBuf, String)>,
}

impl Files {
    pub fn new(overwrite: Overwrite) -> Files {
        let known = Vec::new();
        Files { overwrite, known }
    }

    /// Returns true if [`Files::writes`] would not find another file under this name.
    pub fn is_free(&self, path: &Path) -> bool {
        let identity = resolve(path);
        let known = self.known.iter().any(|(known, _)| *known == identity);
        !known && (self.overwrite.force || std::fs::symlink_metadata(path).is_err())
    }

    /// Registers inputs. They need not exist: a scene is not a file.
    pub fn reads<P: AsRef<Path>>(&mut self, paths: impl IntoIterator<Item = P>) {
        for path in paths {
            let path = path.as_ref();
            let Ok(metadata) = std::fs::metadata(path) else {
                continue;
            };
            if is_pipe(&metadata) {
                tracing::info!("{}: a pipe; waiting for its writer", path.display());
            }
            if metadata.is_file() {
                let name = format!("the input {}", path.display());
                self.known.push((resolve(path), name));
            }
        }
    }

    /// Checks that outputs can be written, and that none replaces an input, an output or a
    /// protected file.
    pub fn writes<P: AsRef<Path>>(
        &mut self,
        option: &str,
        paths: impl IntoIterator<Item = P>,
        content: Content,
    ) -> Result<()> {
        let mut paths = paths.into_iter();
        paths.try_for_each(|path| self.check(option, path.as_ref(), content))
    }

    fn check(&mut self, option: &str, path: &Path, content: Content) -> Result<()> {
        let name = format!("{option} {}", path.display());
        let refuse = |why: &str| Err(usage!("{name}: {why}"));
        let extension = path.extension().unwrap_or_default().to_string_lossy();
        if let Some(why) = content.refuse_extension(&extension.to_lowercase()) {
            return refuse(why);
        }
        let found = std::fs::metadata(path);
        match &found {
            _ if content == Content::Text && is_stream(path) => return Ok(()),
            Ok(m) if m.is_dir() => return refuse("that is a folder"),
            Ok(m) if !m.is_file() && content == Content::Text => return Ok(()),
            Ok(m) if !m.is_file() => return refuse("not a regular file"),
            _ => {}
        }
        let identity = resolve(path);
        if let Some((_, other)) = self.known.iter().find(|(known, _)| *known == identity) {
            return refuse(&format!("the same file as {other}"));
        }
        if found.is_ok() && !self.overwrite.force {
            return refuse("the file exists; --force overwrites it");
        }
        if content == Content::Recording
            && let Err(e) = linkwatch::RecordingSink::check_unused(path)
        {
            return Err(usage!("{option} {e}"));
        }
        if !folder_of(&resolve(path)).is_dir() {
            return refuse("its folder does not exist");
        }
        try_to_write(path)?;
        self.known.push((identity, name));
        Ok(())
    }
}

/// Returns a path with a suffix before its extension: `run.mcap` with `2` is `run-2.mcap`.
pub fn with_suffix(path: &Path, suffix: &str) -> PathBuf {
    crate::record::with_suffix(path, &file_name(suffix))
}

/// Replaces the characters of a text that the name of a file cannot have on some system.
pub fn file_name(text: &str) -> String {
    text.replace(|c: char| c.is_control() || "/\\:*?\"<>|".contains(c), "_")
}

/// Writes a file under a temporary name, then renames it, so that no partial file appears under its
/// own name. Pipes and devices are written directly.
pub fn write_whole(
    path: &Path,
    overwrite: Overwrite,
    write: impl FnOnce(&Path) -> Result<()>,
) -> Result<()> {
    let found = std::fs::metadata(path);
    if is_stream(path) || found.as_ref().is_ok_and(|m| !m.is_file()) {
        if found.is_ok_and(|m| is_pipe(&m)) {
            tracing::info!("{}: a pipe; waiting for its reader", path.display());
        }
        return write(path).map_err(|e| of_output(e, path, path));
    }
    // A symbolic link is kept; its target is replaced.
    let file = resolve(path);
    let part = part_of(&file);
    // Ignores the error, because the temporary file may be missing.
    let remove = |_: &Error| drop(std::fs::remove_file(&part));
    let written = write(&part).map_err(|e| of_output(e, &part, path));
    written.inspect_err(remove)?;
    if file.exists() && !overwrite.force {
        let kept = part.display();
        let why = format!("another process created the file meanwhile; the output is in {kept}");
        return Err(usage!("{}: {why}", path.display()));
    }
    let renamed = std::fs::rename(&part, &file).map_err(Error::file(path));
    renamed.inspect_err(remove)
}

/// Names the output in an error that names the temporary file.
fn of_output(e: Error, part: &Path, path: &Path) -> Error {
    match e {
        Error::Io(source) => Error::file(path)(source),
        other => other.renamed(part, path),
    }
}

/// [`write_whole`] for a text.
pub fn write_text(path: &Path, overwrite: Overwrite, text: &str) -> Result<()> {
    write_whole(path, overwrite, |part| {
        let file = match is_stream(part) {
            // Standard output may be a file: its content is kept.
            true => OpenOptions::new().append(true).open(part),
            false => File::create(part),
        };
        let mut file = file.map_err(Error::file(part))?;
        Ok(std::io::Write::write_all(&mut file, text.as_bytes())?)
    })
}

/// Creates the file and removes it again, or opens the existing one.
fn try_to_write(path: &Path) -> Result<()> {
    let file = resolve(path);
    if file.exists() {
        let opened = OpenOptions::new().append(true).open(&file);
        opened.map_err(Error::file(path))?;
    }
    let part = part_of(&file);
    File::create_new(&part).map_err(Error::file(path))?;
    std::fs::remove_file(&part).map_err(Error::file(path))
}

/// Returns the temporary name of a file: in the same folder, and used by no other process.
fn part_of(file: &Path) -> PathBuf {
    file.with_added_extension(format!("{}.part", std::process::id()))
}

/// Returns the canonical path of a file that need not exist, with links resolved: two names with
/// equal paths are names of the same file. (An output that is a hard link of an input does not
/// change it: another file gets its name.)
fn resolve(path: &Path) -> PathBuf {
    /// Maximum length of a chain of links, as on common systems.
    const LINKS: usize = 40;
    let mut path = path.to_owned();
    for _ in 0..LINKS {
        match std::fs::read_link(&path) {
            Ok(target) => path = folder_of(&path).join(target),
            Err(_) => break,
        }
    }
    match (folder_of(&path).canonicalize(), path.file_name()) {
        (Ok(folder), Some(name)) => folder.join(name),
        _ => path,
    }
}

fn folder_of(path: &Path) -> &Path {
    let folder = path
        .parent()
        .filter(|folder| !folder.as_os_str().is_empty());
    folder.unwrap_or(Path::new("."))
}

/// Returns true if a path names a stream of this process. The user opened its target, so linkwatch
/// neither rejects nor replaces it.
fn is_stream(path: &Path) -> bool {
    let folder = path.parent().and_then(Path::to_str);
    matches!(path.to_str(), Some("/dev/stdout" | "/dev/stderr"))
        || matches!(folder, Some("/dev/fd" | "/proc/self/fd"))
}

#[cfg(unix)]
fn is_pipe(metadata: &std::fs::Metadata) -> bool {
    std::os::unix::fs::FileTypeExt::is_fifo(&metadata.file_type())
}

#[cfg(not(unix))]
fn is_pipe(_: &std::fs::Metadata) -> bool {
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_suffix_comes_before_the_extension() {
        for (path, suffix, expected) in [
            ("run.mcap", "2", "run-2.mcap"),
            ("a.b/run.x.mcap", "2", "a.b/run.x-2.mcap"),
            ("a.b/run", "2", "a.b/run-2"),
            ("run.mcap", "arm/left", "run-arm_left.mcap"),
        ] {
            assert_eq!(with_suffix(Path::new(path), suffix), Path::new(expected));
        }
    }

    /// A file is recognised under each of its names, as input and output, whether it exists or not.
    #[test]
    #[cfg(unix)]
    fn recognises_a_file_under_all_its_names() {
        use std::os::unix::fs::symlink;
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir(at("inner")).unwrap();
        std::fs::write(at("there.txt"), "x").unwrap();
        symlink(at("there.txt"), at("soft.txt")).unwrap();
        symlink(folder.path(), at("inner/up")).unwrap();
        symlink("missing.txt", at("dangling.txt")).unwrap();
        let there = [
            "there.txt",
            "soft.txt",
            "./inner/../there.txt",
            "inner/up/there.txt",
        ];
        let missing = [
            "missing.txt",
            "dangling.txt",
            "inner/../missing.txt",
            "inner/up/missing.txt",
        ];
        for (names, other) in [(&there[..], "missing.txt"), (&missing[..], "there.txt")] {
            for a in names {
                assert_ne!(resolve(&at(a)), resolve(&at(other)), "{a}");
                for b in names {
                    assert_eq!(resolve(&at(a)), resolve(&at(b)), "{a}, {b}");
                }
            }
        }
        for a in there {
            let mut files = Files::new(Overwrite { force: true });
            files.reads([at("there.txt")]);
            let e = files
                .writes("-o", [at(a)], Content::Text)
                .unwrap_err()
                .to_string();
            assert!(
                e.contains(a) && e.contains("the same file as the input"),
                "{e}"
            );
            assert!(e.contains("there.txt"), "{e}");
        }
        for a in missing {
            let mut files = Files::new(Overwrite::default());
            files
                .writes("-o", [at("missing.txt")], Content::Text)
                .unwrap();
            let e = files
                .writes("--csv", [at(a)], Content::Text)
                .unwrap_err()
                .to_string();
            assert!(e.contains("the same file as -o"), "{e}");
        }
        assert!(!at("missing.txt").exists(), "a check leaves no file");
        assert_eq!(std::fs::read(at("there.txt")).unwrap(), b"x");
        // A dangling symbolic link is kept, and the file that it names is written.
        write_text(&at("dangling.txt"), Overwrite::default(), "y").unwrap();
        assert_eq!(std::fs::read(at("missing.txt")).unwrap(), b"y");
        let e = write_text(&at("soft.txt"), Overwrite::default(), "y").unwrap_err();
        assert!(
            e.to_string().contains("another process created the file"),
            "{e}"
        );
        assert_eq!(std::fs::read(at("there.txt")).unwrap(), b"x");
    }
}
