//! Motions: sequences of kinds of motion, written as words.

use super::{clip, hint};
use crate::error::{Error, Result};
use std::fmt;
use std::str::FromStr;

vocabulary! {
    /// Kind of a motion. "Lengths" are multiples of the length given to
    /// [`Frames::new`](super::Frames::new), a yarn's diameter for example.
    #[non_exhaustive]
    pub enum MotionKind {
        /// Nothing moves.
        Still = "still",
        /// Waves of 40 lengths that move each coordinate by at most the amplitude; other waves in
        /// every frame.
        ///
        /// An isotopy of space if the amplitude is below `40 / (4 pi)`, about 3 lengths. Only
        /// points are moved, and the segments between them stay straight (or splines). Therefore
        /// topology is kept if segments are short compared with the waves, or the amplitude is
        /// small compared with the distances of the curves.
        Smooth = "smooth",
        /// Uniform noise that moves each coordinate of each control point by at most the amplitude,
        /// independently in every frame. Keeps the topology only if the amplitude is small compared
        /// with the distances of the curves.
        Iid = "iid",
        /// Rigid: 5 lengths further in every frame, for any amplitude.
        ///
        /// Coordinates grow and are rounded to the precision of the set, which is visible as a
        /// motion after very many frames.
        Translate = "translate",
        /// Rigid: 3 degrees further in every frame about the centre of the set, for any amplitude.
        Rotate = "rotate",
        /// Stretching along x about the centre, by factors between 0.8 and 1.25 with a period of 40
        /// frames, for any amplitude.
        Stretch = "stretch",
        /// Stretching along all axes likewise.
        Scale = "scale",
    }
}

impl MotionKind {
    /// Returns true if the amplitude has an effect. If not, the motion is affine and changes no
    /// linking number.
    pub fn has_amplitude(self) -> bool {
        matches!(self, MotionKind::Smooth | MotionKind::Iid)
    }
}

/// Sequence of kinds of motion.
///
/// Parsed from and displayed as words joined by `+`, `smooth+translate`. Each kind moves the result
/// of the one before it, from left to right.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Motion(Vec<MotionKind>);

impl Motion {
    /// Creates a motion of these kinds in this order. An empty list is [`MotionKind::Still`].
    pub fn new(kinds: impl Into<Vec<MotionKind>>) -> Motion {
        let mut kinds = kinds.into();
        if kinds.is_empty() {
            kinds.push(MotionKind::Still);
        }
        Motion(kinds)
    }

    /// Returns the kinds in order, at least one.
    pub fn kinds(&self) -> &[MotionKind] {
        &self.0
    }

    /// Returns true if the amplitude has an effect. If not, the motion is affine and changes no
    /// linking number.
    pub fn has_amplitude(&self) -> bool {
        self.0.iter().any(|k| k.has_amplitude())
    }
}

impl From<MotionKind> for Motion {
    fn from(kind: MotionKind) -> Motion {
        Motion(vec![kind])
    }
}

impl FromStr for Motion {
    type Err = Error;

    fn from_str(text: &str) -> Result<Motion> {
        let kind = |word: &str| {
            word.parse().map_err(|_| {
                let hint = hint(word, &MotionKind::ALL.map(MotionKind::word));
                let word = clip(word);
                Error::Usage(format!("unknown motion '{word}' {hint}"))
            })
        };
        text.split('+').map(kind).collect::<Result<_>>().map(Motion)
    }
}

impl fmt::Display for Motion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let words: Vec<&str> = self.0.iter().map(|kind| kind.word()).collect();
        f.write_str(&words.join("+"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn motion(text: &str) -> Motion {
        text.parse().unwrap()
    }

    #[test]
    fn motions_round_trip() {
        for kind in MotionKind::ALL {
            let motion = Motion::from(kind);
            assert_eq!(motion.to_string().parse::<Motion>().unwrap(), motion);
        }
        assert_eq!(
            motion("translate+smooth").kinds(),
            [MotionKind::Translate, MotionKind::Smooth]
        );
        assert_eq!(motion("rotate+iid").to_string(), "rotate+iid");
        assert_eq!(Motion::new([]), motion("still"));
        assert!(motion("rotate+iid").has_amplitude());
        assert!(!motion("rotate+scale+still").has_amplitude());
        for text in ["", "smooth+", "jump", "Smooth"] {
            let e = text.parse::<Motion>().unwrap_err().to_string();
            assert!(e.contains("(known: still, smooth, iid, translate"), "{e}");
        }
    }
}
