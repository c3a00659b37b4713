//! Frames of a scene that moves, one after the other, for files that hold several.

use super::frames::Frames;
use super::motion::Motion;
use super::pull_through::pull_throughs;
use crate::curve::CurveSet;
use crate::error::{Error, Result};

/// A motion with its number of frames.
///
/// One frame is in memory at a time, and the points of the first one in double precision.
#[derive(Clone, Debug)]
pub struct MovingScene {
    /// Motion of the points.
    pub motion: Motion,
    /// Unit of the motion, in units of the scene: see [`Frames::new`].
    pub length: f64,
    /// Amplitude of the motion, in units of the scene.
    pub amplitude: f64,
    /// Number of frames. The first one is the scene itself.
    pub frames: u64,
    /// Frame from which on the two nearest curves that pass crosswise are pulled through one
    /// another ([`pull_throughs`]); `None`: never.
    pub pull: Option<u64>,
}

impl MovingScene {
    /// Moves the curves, and passes each frame with its number to `take`, which returns the curves
    /// so that their memory is used for the next frame.
    ///
    /// # Errors
    ///
    /// The errors of `take`; [`Error::Usage`] if no two curves are near enough to be pulled
    /// through one another; those of coordinates that overflow.
    pub fn play(
        &self,
        mut curves: CurveSet,
        mut take: impl FnMut(u64, CurveSet) -> Result<CurveSet>,
    ) -> Result<()> {
        let first = |_| pull_throughs(&curves).into_iter().next();
        let pull = self.pull.and_then(first);
        if self.pull.is_some() && pull.is_none() {
            let what = "no two curves are near enough to be pulled through one another";
            return Err(Error::Usage(what.into()));
        }
        let mut frames = Frames::new(&curves, self.length);
        for frame in 0..self.frames {
            if let Some(pull) = pull.as_ref().filter(|_| self.pull == Some(frame)) {
                frames.pull(pull);
            }
            curves.update(frames.at(&self.motion, self.amplitude, frame))?;
            curves = take(frame, curves)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ingest::FrameInfo;
    use crate::scenes::Scene;
    use crate::session::Session;
    use crate::verdict::Verdict;

    #[test]
    fn a_moving_scene_is_intact_until_its_pull_through() {
        let scene: Scene = "chainmail:rows=5,columns=6".parse().unwrap();
        let built = scene.build().unwrap();
        let moving = MovingScene {
            motion: "smooth".parse().unwrap(),
            length: 0.2,
            amplitude: 0.01,
            frames: 5,
            pull: Some(3),
        };
        let mut session = Session::new(Default::default()).unwrap();
        let mut verdicts = Vec::new();
        let frame = |seq, curves| {
            verdicts.push(session.feed(FrameInfo::at(seq, 0.0), &curves)?.verdict);
            Ok(curves)
        };
        moving.play(built.curves.clone(), frame).unwrap();
        let (intact, changed) = (Verdict::Intact, Verdict::Changed);
        assert_eq!(verdicts, [intact, intact, intact, changed, changed]);
        assert_eq!(session.baseline(), Some(&built.certificate));

        let alone: Scene = "rubber_bands:bands=1".parse().unwrap();
        let e = moving.play(alone.build().unwrap().curves, |_, curves| Ok(curves));
        assert!(e.unwrap_err().to_string().contains("no two curves"));
    }
}
