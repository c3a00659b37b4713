//! Frames whose vertices are uploaded to an adapter.

use crate::curve::CurveSet;
use crate::kernels::gpu::Frame;
use std::sync::Arc;

/// Vertices of the current frame and of the next one.
#[derive(Debug, Default)]
pub(super) struct Uploads {
    /// Vertices of the current frame, once they are uploaded.
    pub current: Option<Arc<Frame>>,
    /// The next frame, if it is known, so that its vertices can be uploaded in advance.
    pub announced: Option<Arc<CurveSet>>,
    /// The next frame and its vertices, once they are uploaded.
    pub next: Option<(Arc<CurveSet>, Arc<Frame>)>,
}

impl Uploads {
    /// Returns the vertices of the current frame, which may be uploaded already.
    pub fn frame(&mut self, set: &CurveSet) -> Arc<Frame> {
        let frame = match (self.current.take(), self.next.take()) {
            (Some(frame), next) => {
                self.next = next;
                frame
            }
            (None, Some((of, frame))) if std::ptr::eq(&*of, set) => frame,
            _ => Arc::new(Frame::new(set)),
        };
        self.current = Some(Arc::clone(&frame));
        frame
    }

    /// Ends a frame, verified or rejected: clears the announcement, and releases the vertices of
    /// `set` if they were uploaded in advance but not used.
    pub fn end_frame(&mut self, set: &CurveSet) {
        self.announced = None;
        self.next.take_if(|(of, _)| std::ptr::eq(&**of, set));
    }

    /// Returns true if the vertices of a frame were uploaded before its turn.
    #[cfg(all(test, feature = "gpu"))]
    pub fn has_sent(&self, set: &CurveSet) -> bool {
        let next = self.next.as_ref();
        next.is_some_and(|(of, _)| std::ptr::eq(&**of, set))
    }
}
