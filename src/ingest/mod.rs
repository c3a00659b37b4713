//! From the bytes of a frame to curves: the one door for live frames and recordings.
//!
//! Every value is read once: the pass that checks it is the pass that stores it. Nothing is assumed about the
//! input but that the slices are as long as they say.
//!
//! Cost: one read and one write of the positions; no allocation after the first frame.

use crate::curve::{Basis, CurveSet, Positions};
use crate::error::{Error, Result};

/// A frame as it came in: how many control points each curve has (negative: closed) and where they are.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RawFrame<'a> {
    pub basis: Basis,
    pub counts: &'a [i32],
    pub positions: Positions<'a>,
}

/// Moves `frame` into `set`: builds it from the first frame, updates it from every later one of equal layout.
///
/// On an error an existing set holds a mixture of both frames and must be updated again before use; it stays
/// there, because later frames are compared with its layout.
pub(crate) fn ingest(frame: RawFrame<'_>, set: &mut Option<CurveSet>) -> Result<()> {
    match set {
        None => {
            // Read once: in shared memory they could change between one look and the next.
            let counts = frame.counts.to_vec();
            *set = Some(CurveSet::from_counts(
                frame.basis,
                &counts,
                frame.positions,
            )?);
        }
        Some(set) => {
            same_layout(&frame, set)?;
            set.update(frame.positions)?;
        }
    }
    Ok(())
}

fn same_layout(frame: &RawFrame<'_>, set: &CurveSet) -> Result<()> {
    let changed = |what, before, now| Err(Error::LayoutChanged { what, before, now });
    if frame.basis != set.basis() {
        let code = |basis: Basis| u64::from(basis.code());
        return changed("basis code", code(set.basis()), code(frame.basis));
    }
    if frame.counts.len() != set.len() {
        return changed(
            "number of curves",
            set.len() as u64,
            frame.counts.len() as u64,
        );
    }
    for (before, &now) in set.counts().zip(frame.counts) {
        if before == now {
            continue;
        }
        let points = |count: i32| u64::from(count.unsigned_abs());
        return if points(before) == points(now) {
            changed(
                "closed (1) or open (0)",
                u64::from(before < 0),
                u64::from(now < 0),
            )
        } else {
            changed("control points of a curve", points(before), points(now))
        };
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const SQUARE: [f32; 12] = [0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.];

    fn frame<'a>(basis: Basis, counts: &'a [i32], positions: &'a [f32]) -> RawFrame<'a> {
        RawFrame {
            basis,
            counts,
            positions: Positions::F32(positions),
        }
    }

    #[test]
    fn the_first_frame_builds_and_the_next_one_updates() {
        let mut set = None;
        ingest(frame(Basis::Polyline, &[-4], &SQUARE), &mut set).unwrap();
        let moved = SQUARE.map(|x| x + 1.0);
        ingest(frame(Basis::Polyline, &[-4], &moved), &mut set).unwrap();
        assert_eq!(set.unwrap().point(0, 0), [1.0; 3]);
    }

    #[test]
    fn other_curves_are_refused_and_the_old_layout_stays() {
        let mut set = None;
        ingest(frame(Basis::Polyline, &[-4], &SQUARE), &mut set).unwrap();
        let mut refuse = |basis, counts: &[i32]| {
            let e = ingest(frame(basis, counts, &SQUARE), &mut set).unwrap_err();
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
        ingest(frame(Basis::Polyline, &[-4], &SQUARE), &mut set).unwrap();
    }
}
