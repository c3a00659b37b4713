//! Decisions about which curves are closed: one for each layout of the curves. The first verified
//! frame makes it.

use crate::ingest::{Closing, ClosingNote, Decisions};

/// Decisions about the last layout of which a frame was verified, and about another one.
#[derive(Debug)]
pub(super) struct Closings {
    keep_open: bool,
    /// Layouts and their decisions; the verified one is first, if there is one.
    of: Vec<(u32, Closing)>,
    verified: bool,
}

impl Closings {
    pub fn new(keep_open: bool) -> Closings {
        Closings {
            keep_open,
            of: Vec::new(),
            verified: false,
        }
    }

    /// Continues with decisions about a layout.
    pub fn decided(keep_open: bool, layout: u32, decisions: Decisions) -> Closings {
        Closings {
            keep_open,
            of: vec![(layout, Closing::decided(keep_open, decisions))],
            verified: true,
        }
    }

    /// Returns the decisions about the layout of the last verified frame.
    pub fn decisions(&self) -> Decisions {
        let of = self.of.first().filter(|_| self.verified);
        of.map_or_else(Decisions::default, |of| of.1.decisions())
    }

    /// Returns the decisions about a layout, which may be made later.
    pub fn of(&mut self, layout: u32) -> &mut Closing {
        let known = self.of.iter().position(|of| of.0 == layout);
        let k = known.unwrap_or_else(|| {
            self.of.truncate(usize::from(self.verified));
            self.of.push((layout, Closing::new(self.keep_open)));
            self.of.len() - 1
        });
        &mut self.of[k].1
    }

    /// Tells the result of a frame.
    pub fn end_frame(&mut self, layout: u32, verified: bool) {
        self.of(layout).end_frame(verified);
        if verified {
            // Frames of the next layout may be received already.
            self.of.sort_by_key(|of| of.0 != layout);
            self.verified = true;
        }
    }

    /// Forgets all decisions, so that the next frame makes others.
    pub fn forget(&mut self) {
        self.of.clear();
        self.verified = false;
    }

    /// Returns the decisions that were made since the last call.
    pub fn take_notes(&mut self) -> Vec<ClosingNote> {
        let all = self.of.iter_mut();
        all.flat_map(|of| of.1.take_notes()).collect()
    }

    /// Returns the number of curves that are closed because they end where they start.
    pub fn joined(&self) -> usize {
        self.of.first().map_or(0, |of| of.1.joined())
    }
}
