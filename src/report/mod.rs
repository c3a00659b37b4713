//! Report of a recorded run for people without a viewer: what happened in one sentence, a timeline,
//! tables of the findings, plots, and pictures of the worst violations and of the lowest clearance.
//!
//! ```text
//! first pass: verdicts ─▶ facts ─┬─▶ sentence, notes ─┐
//!                                ├─▶ bins ─▶ timeline, plots ─┬▶ HTML, text, JSON
//!                                └─▶ violations ─▶ choice     │
//! second pass: frames of the chosen ones ─▶ strands in a window ─▶ two views ─▶ pictures
//! ```
//!
//! The report is about the recorded verdicts. It verifies nothing; a replay does.
//!
//! Cost: two passes over the file, the second up to the last frame that a picture needs. Memory: a
//! few frames, however long the recording is. Bins are merged when there are too many, and tables
//! and pictures are limited.

mod axis;
mod facts;
mod figures;
mod html;
mod plots;
mod rows;
mod run;
mod sentence;
mod series;
#[cfg(test)]
mod tests;
mod text;
mod timeline;
mod violations;

pub use sentence::Conclusion;

use self::facts::Facts;
use self::figures::Figure;
use crate::error::{Error, Result};
use crate::record::RecordingReader;
use std::path::{Path, PathBuf};

/// Report of a recorded run: what happened, for people without a viewer.
pub struct RunReport {
    recording: PathBuf,
    facts: Facts,
    figures: Vec<Figure>,
    /// Pictures of the lowest clearance, if it is below the limit.
    low_clearance: Option<Figure>,
}

impl RunReport {
    /// Reads a recording, also one that was cut off. Damage after the first verdict is a part of
    /// the report.
    ///
    /// # Errors
    ///
    /// The file cannot be read, is not a recording, or is damaged before its first verdict.
    pub fn read(path: &Path) -> Result<RunReport> {
        let in_file = |e: Error| e.in_file(path);
        let mut reader = RecordingReader::open(path).map_err(in_file)?;
        let facts = Facts::collect(&mut reader).map_err(in_file)?;
        let reader = RecordingReader::open(path).map_err(in_file)?;
        let (figures, low_clearance) = figures::draw(reader, &facts);
        Ok(RunReport {
            recording: path.to_owned(),
            figures,
            low_clearance,
            facts,
        })
    }

    /// Returns the conclusion.
    pub fn conclusion(&self) -> Conclusion {
        self.facts.conclusion()
    }

    /// Returns what happened, in one sentence.
    pub fn sentence(&self) -> String {
        self.facts.sentence()
    }

    /// Returns the pictures of each violation as an SVG file: before, at and after its frame.
    pub fn pictures(&self) -> impl Iterator<Item = String> + '_ {
        self.figures.iter().map(Figure::sheet)
    }

    /// Returns the number of violations with pictures.
    pub fn figures(&self) -> usize {
        self.figures.len()
    }
}
