//! Options of a scene that moves.

use super::number::{not_negative, positive};
use linkwatch::scenes::{Motion, MotionKind, MovingScene, Scene};
use linkwatch::{Error, Result};

/// Motion of the frames of a scene.
#[derive(Clone, Debug, clap::Args)]
pub struct MotionArgs {
    /// Motion of the frames, words joined by `+`: still, smooth (waves of 40 diameters), iid
    /// (independent noise of each point), translate (5 diameters a frame), rotate (3 degrees a
    /// frame), stretch and scale (0.8 to 1.25) [default: smooth]
    #[arg(long, value_name = "MOTION")]
    motion: Option<Motion>,
    /// Amplitude of the motion, in diameters [default: 0.05]
    #[arg(long, value_name = "A", value_parser = not_negative)]
    amplitude: Option<f64>,
    /// Diameter of the yarn, in units of the scene [default: that of the scene, if it has one]
    #[arg(long, value_name = "D", value_parser = positive)]
    diameter: Option<f64>,
}

impl MotionArgs {
    /// Returns true if the user gave any of these options.
    pub fn are_given(&self) -> bool {
        self.motion.is_some() || self.amplitude.is_some() || self.diameter.is_some()
    }

    /// Returns the motion of a scene, for a number of frames.
    pub fn moving(&self, scene: &Scene, frames: u64) -> Result<MovingScene> {
        let own = scene.value("diameter");
        let length = self.diameter.or(own).ok_or_else(|| {
            let name = scene.kind().name;
            let what = "has no diameter, the unit of the motion: give --diameter";
            Error::Usage(format!("{name} {what}"))
        })?;
        Ok(MovingScene {
            motion: self.motion.clone().unwrap_or(MotionKind::Smooth.into()),
            length,
            amplitude: self.amplitude.unwrap_or(0.05) * length,
            frames,
            pull: None,
        })
    }
}
