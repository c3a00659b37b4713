//! Draws the place where a scene broke, from the recording, as an SVG file.

use linkwatch::picture::{self, Marked};
use linkwatch::{CurveSet, Place, RecordedItem, RecordingReader, Report, Result, Verdict};
use std::path::Path;

/// Draws the first frame in which the topology changed, and the place of its first finding. If
/// there is none, removes the picture of an earlier run, which would contradict this run, and
/// returns false.
pub fn draw(recording: &Path, picture: &Path) -> Result<bool> {
    let drawn = first_change(recording)?;
    match &drawn {
        Some(text) => std::fs::write(picture, text)?,
        None if picture.exists() => std::fs::remove_file(picture)?,
        None => {}
    }
    Ok(drawn.is_some())
}

/// Returns the picture of the first frame in which the topology changed.
fn first_change(recording: &Path) -> Result<Option<String>> {
    let mut reader = RecordingReader::open(recording)?;
    let mut curves = None;
    while let Some(item) = reader.next_item()? {
        match item {
            RecordedItem::Frame(frame) => frame.ingest(&mut curves)?,
            RecordedItem::Verdict(v) if v.report.verdict == Verdict::Changed => {
                return Ok(curves.and_then(|set| svg(&set, &v.report)));
            }
            _ => {}
        }
    }
    Ok(None)
}

/// Draws the first pull-through or changed linking number of a report.
fn svg(set: &CurveSet, report: &Report) -> Option<String> {
    let pulled = report.events.first().map(|e| Marked {
        curves: [e.i, e.j],
        place: Some(Place {
            segments: e.segments,
            point: e.point,
            distance: 0.0,
        }),
    });
    let changed = report.changes.first().map(|c| Marked {
        curves: [c.i, c.j],
        place: c.place,
    });
    let finding = report.findings().next()?;
    let marked = pulled.or(changed)?;
    Some(picture::draw(set, &report.frame(), &finding, &[marked]))
}
