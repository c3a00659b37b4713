//! Control points and the segments that depend on them.

use super::{Curve, CurveSet};
use std::ops::Range;

impl CurveSet {
    /// Returns the slots of the control points that segment `s` of curve `i` depends on. Copies are
    /// mapped to their originals.
    pub(crate) fn support(&self, i: usize, s: u32) -> impl Iterator<Item = usize> + use<> {
        let (c, basis, start) = (self.curves[i], self.basis, self.body(i).start);
        (0..basis.window()).map(move |k| start + c.control_point(basis, s as usize, k))
    }

    /// Returns the numbers of the control points of curve `i`, counted over all curves.
    pub(crate) fn points_of(&self, i: usize) -> Range<usize> {
        let c = &self.curves[i];
        c.first_point as usize..(c.first_point + c.points) as usize
    }

    /// Calls `segment` with the segments of closed curves, and of open curves if `open` is set,
    /// that depend on one of these points, counted over all curves.
    pub(crate) fn segments_at(
        &self,
        points: Range<usize>,
        open: bool,
        mut segment: impl FnMut(u32, u32),
    ) {
        let (stride, window) = (self.basis.stride(), self.basis.window());
        let starts_before = |c: &Curve| c.first_point as usize <= points.start;
        let first = self.curves.partition_point(starts_before);
        for i in first.saturating_sub(1)..self.curves.len() {
            let own = self.points_of(i);
            if own.start >= points.end {
                break;
            }
            let (c, lead) = (self.curves[i], self.basis.lead(self.curves[i].closed));
            let here = points.start.max(own.start)..points.end.min(own.end);
            if !c.closed && !open {
                continue;
            }
            let n = c.segments as usize;
            for at in here.map(|point| point - own.start + lead) {
                // Windows that contain the point. Windows of closed curves may wrap around the end.
                for back in 0..window.div_ceil(stride) {
                    let s = match c.closed {
                        true => Some((at / stride + n - back) % n),
                        false => (at / stride).checked_sub(back).filter(|&s| s < n),
                    };
                    let Some(s) = s else { continue };
                    let offset = match c.closed {
                        true => (at + (n - s) * stride) % (n * stride),
                        false => at - s * stride,
                    };
                    if offset < window {
                        segment(i as u32, s as u32);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::{Basis, Positions};

    #[test]
    fn finds_the_segments_that_depend_on_a_point() {
        for basis in Basis::ALL {
            let counts = [-3, -9, 10, -30, 4];
            let xyz = vec![0.5f32; 3 * 56];
            let set = CurveSet::from_counts(basis, &counts, Positions::F32(&xyz)).unwrap();
            for (from, open) in (0..set.points()).flat_map(|k| [(k, false), (k, true)]) {
                for to in from + 1..set.points().min(from + 9) {
                    let mut found = Vec::new();
                    set.segments_at(from..to, open, |i, s| found.push((i, s)));
                    found.sort_unstable();
                    found.dedup();
                    let some = (0..set.len()).filter(|&i| open || set.curve(i).closed);
                    let all = some.flat_map(|i| (0..set.curve(i).segments).map(move |s| (i, s)));
                    let want: Vec<(u32, u32)> = all
                        .filter(|&(i, s)| {
                            let first = set.points_of(i).start;
                            let point = |slot: usize| first + slot - set.body(i).start;
                            let mut points = set.support(i, s).map(point);
                            points.any(|k| (from..to).contains(&k))
                        })
                        .map(|(i, s)| (i as u32, s))
                        .collect();
                    assert_eq!(found, want, "{basis:?} {from}..{to}");
                }
            }
        }
    }
}
