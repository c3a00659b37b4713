//! Frames during the verification: the given curves, the same with their periodic images, and their
//! memory, which is reused for later frames.

use super::{Cell, CurveSet, Translated};
use crate::error::{Error, Result};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// Curves of frames and their images: those that are not translated come first, in order.
#[derive(Debug)]
pub(crate) struct Images {
    pub curves: Translated,
    pool: Mutex<FramePool>,
}

impl Images {
    pub fn new(curves: Translated) -> Images {
        Images {
            curves,
            pool: Mutex::default(),
        }
    }
}

/// Curves of a frame, and the set of curves that is verified: the same, or also their images.
///
/// A frame that is quiet needs no images, so that they are written when they are needed.
#[derive(Clone, Debug)]
pub(crate) struct Frame {
    given: Arc<CurveSet>,
    cell: Option<Cell>,
    /// `None` if the scene does not repeat, or no image comes near.
    images: Option<Arc<Images>>,
    set: OnceLock<Arc<CurveSet>>,
}

#[cfg(test)]
impl From<CurveSet> for Frame {
    fn from(set: CurveSet) -> Frame {
        Frame::new(&Arc::new(set), None, None)
    }
}

impl Frame {
    pub fn new(given: &Arc<CurveSet>, cell: Option<Cell>, images: Option<Arc<Images>>) -> Frame {
        Frame {
            given: Arc::clone(given),
            cell,
            images,
            set: OnceLock::new(),
        }
    }

    /// Returns the given curves, without images.
    pub fn given(&self) -> &Arc<CurveSet> {
        &self.given
    }

    pub fn cell(&self) -> Option<&Cell> {
        self.cell.as_ref()
    }

    /// Returns the translated curves, if there are any.
    pub fn translated(&self) -> Option<&Translated> {
        self.images.as_ref().map(|images| &images.curves)
    }

    /// Returns the set of curves that is verified.
    ///
    /// # Errors
    ///
    /// The errors of [`CurveSet::translate`].
    pub fn set(&self) -> Result<&Arc<CurveSet>> {
        let (Some(images), Some(cell)) = (&self.images, &self.cell) else {
            return Ok(&self.given);
        };
        if let Some(set) = self.set.get() {
            return Ok(set);
        }
        let mut pool = images.pool.lock().unwrap_or_else(PoisonError::into_inner);
        let set =
            pool.receive(|out| CurveSet::translate(&self.given, &images.curves, cell, out))?;
        Ok(self.set.get_or_init(|| set))
    }

    /// Returns this frame in double precision.
    pub fn widened(&self) -> Result<Frame> {
        let given = Arc::new(self.given.widened()?);
        Ok(Frame::new(&given, self.cell, self.images.clone()))
    }
}

/// Curves of the last frames. A session holds one of them until it has verified the next one, and
/// may share them with a thread that builds a reference frame. Curves that nobody else holds are
/// reused, so that a stream of frames allocates nothing.
#[derive(Debug, Default)]
pub(crate) struct FramePool {
    frames: Vec<Arc<CurveSet>>,
}

impl FramePool {
    /// Receives a frame into free curves. `receive` gets the curves of an earlier frame, with their
    /// layout, or `None` if there is no earlier frame.
    ///
    /// # Errors
    ///
    /// The errors of `receive`, and [`Error::Usage`] if it made no curves.
    pub fn receive(
        &mut self,
        receive: impl FnOnce(&mut Option<CurveSet>) -> Result<()>,
    ) -> Result<Arc<CurveSet>> {
        let free = |frame: &Arc<CurveSet>| Arc::strong_count(frame) == 1;
        let free = self.frames.iter().position(free);
        let free = free.and_then(|k| Arc::into_inner(self.frames.swap_remove(k)));
        // Later frames must have the layout of the first one.
        let copy = || self.frames.first().map(|frame| CurveSet::clone(frame));
        let mut curves = free.or_else(copy);
        let received = receive(&mut curves);
        let curves = curves.map(Arc::new);
        self.frames.extend(curves.clone());
        received?;
        curves.ok_or_else(|| Error::Usage("the frame holds no curves".into()))
    }
}
