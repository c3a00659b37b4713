//! Converts the bytes of a frame to curves. Both live frames and recordings enter here.
//!
//! Every value is read once: the pass that checks a value also stores it. The only assumption about
//! the input is that the slices have their stated lengths. Cost: one read and one write of the
//! positions.
//!
//! A session joins its comparison with the reference frame to this pass
//! ([`Session::receive`](crate::Session::receive)). Before that, it reads a sample of the points
//! for a guess of the motion; no result depends on the guess.

mod closing;
mod info;

pub(crate) use crate::curve::FramePool;
pub(crate) use closing::Decisions;
pub use closing::{Closing, ClosingKind, ClosingNote, CurveSource};
pub use info::FrameInfo;

use crate::curve::{Basis, CurveSet, Positions};
use crate::error::Result;

/// Frame as received, not yet checked. It may be in shared memory, and change while it is read.
#[derive(Clone, Copy, Debug)]
pub struct RawFrame<'a> {
    /// Basis of all curves.
    pub basis: Basis,
    /// Number of control points of each curve, negative if the curve is closed.
    pub counts: &'a [i32],
    /// The control points, curve after curve.
    pub positions: Positions<'a>,
}

/// Copies `frame` into `set`: the first frame creates the set, and `update` copies every later one
/// of equal layout.
///
/// After an error an existing set must be updated again before use. It is kept, because later
/// frames are compared with its layout.
pub(crate) fn ingest(
    frame: RawFrame<'_>,
    set: &mut Option<CurveSet>,
    update: impl FnOnce(&mut CurveSet, Positions<'_>) -> Result<()>,
) -> Result<()> {
    match set {
        None => {
            // Copied once, because the counts in shared memory could change between two reads.
            let counts = frame.counts.to_vec();
            let curves = CurveSet::from_counts(frame.basis, &counts, frame.positions)?;
            *set = Some(curves);
        }
        Some(set) => {
            same_layout(&frame, set)?;
            update(set, frame.positions)?;
        }
    }
    Ok(())
}

/// Fails if a frame has other curves than a set.
pub(crate) fn same_layout(frame: &RawFrame<'_>, set: &CurveSet) -> Result<()> {
    let counts = frame.counts.iter().copied();
    set.check_layout(frame.basis, frame.positions.precision(), counts)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Error;

    const SQUARE: [f32; 12] = [0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.];

    fn frame<'a>(basis: Basis, counts: &'a [i32], positions: &'a [f32]) -> RawFrame<'a> {
        RawFrame {
            basis,
            counts,
            positions: Positions::F32(positions),
        }
    }

    #[test]
    fn the_first_frame_creates_the_set_and_the_next_one_updates_it() {
        let mut set = None;
        ingest(
            frame(Basis::Polyline, &[-4], &SQUARE),
            &mut set,
            CurveSet::update,
        )
        .unwrap();
        let moved = SQUARE.map(|x| x + 1.0);
        ingest(
            frame(Basis::Polyline, &[-4], &moved),
            &mut set,
            CurveSet::update,
        )
        .unwrap();
        assert_eq!(set.unwrap().point(0, 0), [1.0; 3]);
    }

    #[test]
    fn rejects_other_curves_and_keeps_the_old_layout() {
        let mut set = None;
        ingest(
            frame(Basis::Polyline, &[-4], &SQUARE),
            &mut set,
            CurveSet::update,
        )
        .unwrap();
        let mut refuse = |basis, counts: &[i32]| {
            let e = ingest(frame(basis, counts, &SQUARE), &mut set, CurveSet::update).unwrap_err();
            assert!(matches!(e, Error::LayoutChanged { .. }), "{e}");
            e.to_string()
        };
        let head = "the curves changed between frames: ";
        assert_eq!(
            refuse(Basis::Polyline, &[4]),
            format!("{head}closed (1) or open (0) was 1, is 0")
        );
        assert_eq!(
            refuse(Basis::Polyline, &[-2, -2]),
            format!("{head}number of curves was 1, is 2")
        );
        assert_eq!(
            refuse(Basis::Polyline, &[-3]),
            format!("{head}control points of a curve was 4, is 3")
        );
        refuse(Basis::BSpline, &[-4]);
        ingest(
            frame(Basis::Polyline, &[-4], &SQUARE),
            &mut set,
            CurveSet::update,
        )
        .unwrap();
    }
}
