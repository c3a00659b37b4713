//! Decisions about which curves are closed: one for each layout of the curves, made by the first
//! verified frame of the layout.

use crate::ingest::{Closing, ClosingNote, Decisions};

/// Decisions about the layout of the last verified frame, and about the current frame.
#[derive(Debug, Default)]
pub(super) struct Closings {
    /// Layout of the last verified frame.
    known: Option<(u32, Closing)>,
    /// Decisions of a frame of another layout, until it is verified.
    pub new: Closing,
}

impl Closings {
    /// Continues with decisions about a layout.
    pub fn decided(keep_open: bool, layout: u32, decisions: Decisions) -> Closings {
        Closings {
            known: Some((layout, Closing::decided(keep_open, decisions))),
            new: Closing::default(),
        }
    }

    /// Returns the decisions about the layout of the last verified frame.
    pub fn decisions(&self) -> Decisions {
        let known = self.known.as_ref();
        known.map_or_else(Decisions::default, |known| known.1.decisions())
    }

    /// Returns the decisions about a layout, if the last verified frame has it.
    pub fn known(&mut self, layout: u32) -> Option<&mut Closing> {
        let known = self.known.as_mut().filter(|known| known.0 == layout);
        known.map(|known| &mut known.1)
    }

    /// Returns the decisions about the layout of the current frame.
    pub fn of(&mut self, layout: u32) -> &mut Closing {
        match &mut self.known {
            Some((known, closing)) if *known == layout => closing,
            _ => &mut self.new,
        }
    }

    /// Keeps or discards the decisions of a frame, after it was verified or rejected. Returns those
    /// kept.
    pub fn end_frame(&mut self, layout: u32, verified: bool) -> Vec<ClosingNote> {
        let mut new = std::mem::take(&mut self.new);
        let notes = new.take_notes();
        if verified && self.known(layout).is_none() {
            self.known = Some((layout, new));
        }
        notes
    }

    /// Returns the number of curves that are closed because they end where they start.
    pub fn joined(&self) -> usize {
        self.known.as_ref().map_or(0, |known| known.1.joined())
    }
}
