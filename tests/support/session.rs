//! Sessions of valid frames.

use linkwatch::{FrameInfo, Given, Received, Session, VerifiedFrame};

/// Verification of frames that must be valid.
pub trait Step {
    /// Verifies a frame. Panics if it is rejected.
    fn step_at<'a>(&mut self, info: FrameInfo, frame: impl Into<Given<'a>>) -> VerifiedFrame;

    /// Same as [`Step::step_at`], at the time 0.
    fn step<'a>(&mut self, seq: u64, frame: impl Into<Given<'a>>) -> VerifiedFrame {
        self.step_at(FrameInfo::at(seq, 0.0), frame)
    }
}

impl Step for Session {
    fn step_at<'a>(&mut self, info: FrameInfo, frame: impl Into<Given<'a>>) -> VerifiedFrame {
        let received = match frame.into() {
            Given::Raw(raw) => self.receive(info, |copy| copy(raw)),
            Given::Curves(curves) => Received::new(info, Ok(curves)),
        };
        let verified = self.verify(received).unwrap();
        assert_eq!(verified.report.rejected, None);
        verified
    }
}
