//! Files that are read.

use crate::error::{Error, Result};
use std::fs::File;
use std::io::{BufRead, BufReader, ErrorKind, Read, Take};
use std::path::Path;

/// Bytes of a file that is to be read.
pub(super) struct Input<R> {
    pub bytes: R,
    pub len: u64,
    /// Name of the file, for the log.
    pub name: String,
}

/// Opens a regular file for reading.
pub(super) fn open_file(path: &Path) -> Result<Input<File>> {
    // Read before opening the file, because opening a pipe would wait for its writer.
    let metadata = std::fs::metadata(path).map_err(Error::file(path))?;
    if !metadata.is_file() {
        let why = "not a regular file, so its length is unknown";
        let source = std::io::Error::new(ErrorKind::InvalidInput, why);
        return Err(Error::file(path)(source));
    }
    Ok(Input {
        bytes: File::open(path).map_err(Error::file(path))?,
        len: metadata.len(),
        name: path.display().to_string(),
    })
}

/// Opens a regular file for reading. The reader is limited to its length, so that checks against it
/// stay valid if the file grows meanwhile.
pub(super) fn open(path: &Path) -> Result<Input<BufReader<Take<File>>>> {
    let Input { bytes, len, name } = open_file(path)?;
    let bytes = BufReader::with_capacity(1 << 16, bytes.take(len));
    Ok(Input { bytes, len, name })
}

/// Mark at the start of a text file, which some programs write.
pub(super) const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// Marks at the start of text in UTF-16, as PowerShell and spreadsheets write it.
pub(super) fn is_utf16(start: &[u8]) -> bool {
    start.starts_with(b"\xff\xfe") || start.starts_with(b"\xfe\xff")
}

/// Opens a text file after its byte order mark.
///
/// # Errors
///
/// The text is not in UTF-8.
pub(super) fn open_text(path: &Path) -> Result<Input<BufReader<Take<File>>>> {
    let mut input = open(path)?;
    let start = input.bytes.fill_buf()?;
    if is_utf16(start) {
        let what = "the file is in UTF-16: save it as UTF-8 (`iconv -f UTF-16 -t UTF-8`)";
        return Err(Error::unsupported("text", what));
    }
    if start.starts_with(BYTE_ORDER_MARK) {
        input.bytes.consume(BYTE_ORDER_MARK.len());
        input.len -= BYTE_ORDER_MARK.len() as u64;
    }
    Ok(input)
}
