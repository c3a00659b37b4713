//! Curves of the last frames, reused for later ones.

use crate::curve::CurveSet;
use std::sync::Arc;

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
    /// The errors of `receive`, and [`Error::Usage`](crate::Error::Usage) if it made no curves.
    pub fn receive(
        &mut self,
        receive: impl FnOnce(&mut Option<CurveSet>) -> crate::Result<()>,
    ) -> crate::Result<Arc<CurveSet>> {
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
        curves.ok_or_else(|| crate::Error::Usage("the frame holds no curves".into()))
    }
}
