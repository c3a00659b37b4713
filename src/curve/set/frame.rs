//! Frames on their way through the verification: curves as they are given, and with their periodic
//! images.

use super::{Cell, CurveSet, FramePool, Translated};
use crate::error::Result;
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

    /// Returns the curves as they are given.
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
