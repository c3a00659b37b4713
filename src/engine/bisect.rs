//! Binary search for the first changed frame of a motion.

use crate::error::Result;
use std::ops::RangeInclusive;

/// Returns the first changed frame of a range, if the last one is changed. Calls `is_changed` for
/// about `log2` of the number of frames, each at most once, the last frame first.
///
/// The result `k` is proven to be changed, and `k - 1` (if it is in the range) is proven not to be.
/// `k` is the first changed frame if a change stays once it was made. This is an assumption: curves
/// can come apart and link again.
///
/// ```
/// let mut verified = 0;
/// let first = linkwatch::bisect(0..=999, |frame| {
///     verified += 1;
///     Ok(frame >= 417)
/// })?;
/// assert_eq!((first, verified), (Some(417), 12));
/// # Ok::<(), linkwatch::Error>(())
/// ```
pub fn bisect(
    frames: RangeInclusive<usize>,
    mut is_changed: impl FnMut(usize) -> Result<bool>,
) -> Result<Option<usize>> {
    let (mut unchanged, mut changed) = frames.into_inner();
    if !is_changed(changed)? {
        return Ok(None);
    }
    if unchanged == changed || is_changed(unchanged)? {
        return Ok(Some(unchanged));
    }
    while changed - unchanged > 1 {
        let middle = unchanged + (changed - unchanged) / 2;
        match is_changed(middle)? {
            true => changed = middle,
            false => unchanged = middle,
        }
    }
    Ok(Some(changed))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_the_first_changed_frame_of_every_range() {
        for frames in 1..40_usize {
            for first in 0..=frames {
                let mut verified = Vec::new();
                let found = bisect(0..=frames - 1, |frame| {
                    assert!(
                        !verified.contains(&frame),
                        "frame {frame} is verified twice"
                    );
                    verified.push(frame);
                    Ok(frame >= first)
                });
                assert_eq!(found.unwrap(), (first < frames).then_some(first));
                assert!(verified.len() <= 2 + frames.ilog2() as usize + 1);
                let neighbours = [first, first.wrapping_sub(1)];
                let proven = neighbours
                    .iter()
                    .all(|k| *k >= frames || verified.contains(k));
                assert!(
                    first == frames || proven,
                    "{first} of {frames}: {verified:?}"
                );
            }
        }
    }

    #[test]
    fn the_result_is_changed_and_its_predecessor_is_not_if_a_change_reverts() {
        let changed = |frame: usize| (3..5).contains(&frame) || frame >= 9;
        let found = bisect(0..=12, |frame| Ok(changed(frame))).unwrap().unwrap();
        assert!(changed(found) && !changed(found - 1));
        assert_eq!(bisect(0..=6, |frame| Ok(changed(frame))).unwrap(), None);
    }
}
