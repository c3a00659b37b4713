//! Recordings with changed bytes.

use super::bytes::changed;
use super::memory::peak;
use super::units;
use linkwatch::{RecordedItem, RecordingReader};
use std::io::Cursor;
use std::path::Path;

/// Maximum number of bytes that a reader may allocate for a recording of some kilobytes.
const MEMORY: usize = 16 << 20;

/// Reads a recording to its end or its first error. Returns the number of frames.
fn read(bytes: &[u8]) -> (usize, Option<String>) {
    let mut reader = match RecordingReader::new(Cursor::new(bytes)) {
        Ok(reader) => reader,
        Err(e) => return (0, Some(e.to_string())),
    };
    let (mut frames, mut set) = (0, None);
    loop {
        match reader.next_item() {
            Ok(None) => return (frames, None),
            Ok(Some(RecordedItem::Frame(frame))) => {
                frames += 1;
                if frame.ingest(&mut set).is_err() {
                    set = None;
                }
            }
            Ok(Some(_)) => {}
            Err(e) => return (frames, Some(e.to_string())),
        }
    }
}

/// Goes to every frame of the outline of a recording, to the end or the first error.
fn go_to_all(bytes: &[u8]) -> Result<(), linkwatch::Error> {
    let mut reader = RecordingReader::new(Cursor::new(bytes))?;
    let outline = reader.outline()?;
    for frame in &outline.frames {
        reader.go_to(frame)?;
        reader.next_item()?;
    }
    Ok(())
}

#[test]
fn recordings() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("recordings");
    let files = ["squares.mcap", "flight.mcap"];
    let files = files.map(|name| std::fs::read(folder.join(name)).expect("a recording"));
    let frames = files.each_ref().map(|bytes| {
        let (frames, error) = read(bytes);
        assert_eq!(error, None);
        frames
    });
    assert!(frames.iter().all(|&n| n > 0), "{frames:?}");
    let (mut failed, mut whole) = (0, 0);
    units("recordings::recordings", 2000, |random| {
        let k = random.below(files.len());
        let bytes = changed(&files[k], random);
        let ((found, error), most) = peak(|| read(&bytes));
        assert!(most <= MEMORY, "{most} bytes");
        let (_, most) = peak(|| go_to_all(&bytes));
        assert!(most <= MEMORY, "{most} bytes for the outline");
        match error {
            Some(why) => {
                assert!(!why.is_empty());
                failed += 1;
            }
            None => whole += u32::from(found == frames[k]),
        }
    });
    println!("recordings: {failed} damaged, {whole} with all frames");
}
