//! Files that are read.

use crate::error::{Error, Result};
use std::fs::File;
use std::io::{BufRead, BufReader, ErrorKind, Read};
use std::path::Path;

/// Bytes of a file that is to be read.
pub(super) struct Input<'a> {
    pub bytes: Box<dyn BufRead + Send + 'a>,
    pub len: u64,
    /// Name of the file, for the log.
    pub name: String,
}

/// Opens a regular file for reading. Returns its length, too.
pub(super) fn open_file(path: &Path) -> Result<(File, u64)> {
    // Read before opening the file, because opening a pipe would wait for its writer.
    let metadata = std::fs::metadata(path).map_err(Error::file(path))?;
    if !metadata.is_file() {
        let why = "not a regular file, so its length is unknown";
        let source = std::io::Error::new(ErrorKind::InvalidInput, why);
        return Err(Error::file(path)(source));
    }
    let file = File::open(path).map_err(Error::file(path))?;
    Ok((file, metadata.len()))
}

/// Opens a regular file for reading. The reader is limited to its length, so that checks against it
/// stay valid if the file grows meanwhile.
pub(super) fn open(path: &Path) -> Result<Input<'static>> {
    let (file, len) = open_file(path)?;
    let bytes = Box::new(BufReader::with_capacity(1 << 16, file.take(len)));
    let name = path.display().to_string();
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
pub(super) fn open_text(path: &Path) -> Result<Input<'static>> {
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
