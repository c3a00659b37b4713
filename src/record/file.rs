//! Files of recordings: none is replaced while another process reads or writes it.
//!
//! A writer holds an exclusive advisory lock on its file, and a reader a shared lock. (A file that
//! is still being written is read without a lock.) An existing file is replaced only if no process
//! holds a lock on it, and it is never truncated: a new file takes its name. So programs without
//! locks, a viewer for example, keep the old content until they close it.
//!
//! Limits: a file system without locks, and systems other than Unix, where a lock would exclude
//! readers. There, only the file's name is taken over.

use crate::error::{Error, Result};
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, ErrorKind};
use std::path::Path;

/// Creates a file that does not exist.
pub(super) fn create_new(path: &Path) -> Result<File> {
    let created = File::create_new(path).and_then(take);
    created.map_err(Error::file(path))
}

/// Creates a file, or replaces an existing one. It must be a regular file, because opening a pipe
/// without a reader would block without limit.
pub(super) fn create_or_replace(path: &Path) -> Result<File> {
    let replaced = match std::fs::metadata(path) {
        Ok(m) if !m.is_file() => Err(io::Error::other("not a regular file")),
        Ok(_) => replace(path),
        // A link to a file that does not exist is followed.
        Err(_) => {
            let mut options = OpenOptions::new();
            let opened = options.write(true).create(true).truncate(false).open(path);
            (opened.and_then(take)).and_then(|file| file.set_len(0).map(|()| file))
        }
    };
    replaced.map_err(Error::file(path))
}

/// Fails if another process reads or writes a file, as far as locks tell.
pub(super) fn check_unused(path: &Path) -> Result<()> {
    match File::open(path) {
        Ok(file) => take(file).map(drop).map_err(Error::file(path)),
        Err(e) if e.kind() == ErrorKind::NotFound => Ok(()),
        Err(e) => Err(Error::file(path)(e)),
    }
}

/// Sets a shared lock on a file until it is closed. Best effort: a file that is being written, or
/// that cannot be locked, is read without a lock.
pub(super) fn share(file: &File) {
    if cfg!(unix) {
        file.try_lock_shared().ok();
    }
}

/// Returns true if an error says that the file exists already, or that another process uses it.
pub(super) fn is_taken(error: &Error) -> bool {
    let Error::File { source, .. } = error else {
        return false;
    };
    let kind = source.kind();
    matches!(kind, ErrorKind::AlreadyExists | ErrorKind::ResourceBusy)
}

/// Replaces an existing file by a new, empty one. If `path` is a symbolic link, its target is
/// replaced and the link is kept.
fn replace(path: &Path) -> io::Result<File> {
    let path = path.canonicalize()?;
    let _old = take(File::open(&path)?)?;
    let part = path.with_added_extension(format!("{}.part", std::process::id()));
    let new = take(File::create(&part)?);
    let renamed = new.and_then(|new| std::fs::rename(&part, &path).map(|()| new));
    renamed.inspect_err(|_| drop(std::fs::remove_file(&part)))
}

/// Locks a file until it is closed. Fails if another process uses it.
fn take(file: File) -> io::Result<File> {
    if !cfg!(unix) {
        return Ok(file);
    }
    match file.try_lock() {
        // This file system has no locks.
        Ok(()) | Err(TryLockError::Error(_)) => Ok(file),
        Err(TryLockError::WouldBlock) => {
            let use_ = match file.try_lock_shared() {
                Ok(()) => "reads it",
                Err(_) => "writes it",
            };
            let what = format!("another linkwatch {use_} right now");
            Err(io::Error::new(ErrorKind::ResourceBusy, what))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::{Read, Write};

    #[test]
    #[cfg(unix)]
    fn a_file_that_is_read_or_written_is_not_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        let refused = |says: &str| {
            for error in [
                check_unused(&path).unwrap_err(),
                create_or_replace(&path).unwrap_err(),
            ] {
                let words = error.to_string();
                assert!(
                    words.contains("run.mcap") && words.contains(says),
                    "{words}"
                );
                assert!(is_taken(&error));
            }
            assert_eq!(std::fs::read(&path).unwrap(), b"mine");
        };
        let mut writer = create_new(&path).unwrap();
        writer.write_all(b"mine").unwrap();
        refused("another linkwatch writes it right now");
        drop(writer);
        let reader = File::open(&path).unwrap();
        share(&reader);
        refused("another linkwatch reads it right now");
        drop(reader);
        check_unused(&path).unwrap();
        assert!(is_taken(&create_new(&path).unwrap_err()));
        create_or_replace(&path).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"");
        let names = std::fs::read_dir(folder.path()).unwrap().count();
        assert_eq!(names, 1, "no other file is left");
    }

    /// A program that knows no locks.
    #[test]
    #[cfg(unix)]
    fn a_reader_without_a_lock_keeps_the_content_of_a_file_that_is_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let [path, link, free] =
            ["run.mcap", "link.mcap", "free.mcap"].map(|n| folder.path().join(n));
        std::fs::write(&path, "before").unwrap();
        std::os::unix::fs::symlink(&path, &link).unwrap();
        let mut reader = File::open(&path).unwrap();
        create_or_replace(&link)
            .unwrap()
            .write_all(b"after")
            .unwrap();
        let mut found = String::new();
        reader.read_to_string(&mut found).unwrap();
        assert_eq!(found, "before");
        assert_eq!(std::fs::read(&path).unwrap(), b"after");
        assert!(link.is_symlink());
        create_or_replace(&free).unwrap();
        assert!(free.exists());
        let folder = create_or_replace(folder.path()).unwrap_err().to_string();
        assert!(folder.ends_with("not a regular file"), "{folder}");
    }
}
