//! Convex pieces of end volumes: boxes in the local coordinates of an end. Tests are conservative:
//! they may report an overlap that is smaller than the rounding error, and miss none.

use super::pose::Pose;
use crate::curve::{Bezier, bounds, sub_segment};
use nalgebra::Vector3;

/// Number of halvings of a segment after which a part that still meets the box counts as inside: a
/// thousandth of a segment.
const HALVINGS: u32 = 10;

/// A box in local coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Piece {
    pub lo: Vector3<f64>,
    pub hi: Vector3<f64>,
}

impl Piece {
    /// Returns the point of a segment, given in world coordinates, at which it enters the box, or
    /// `None` if it does not. `slack` bounds the rounding errors.
    pub fn entered_by(&self, pose: Pose, bezier: &Bezier, slack: f64) -> Option<[f64; 3]> {
        let local = bezier.map(|p| pose.to_local(p.into()).into());
        let place = self.meets(&local, slack, HALVINGS)?;
        Some(pose.to_world(place).into())
    }

    fn meets(&self, b: &Bezier, slack: f64, halvings: u32) -> Option<Vector3<f64>> {
        let [lo, hi] = bounds(*b);
        let apart = |x: usize| hi[x] < self.lo[x] - slack || lo[x] > self.hi[x] + slack;
        if (0..3).any(apart) {
            return None;
        }
        let inside = |p: &[f64; 3]| (0..3).all(|x| self.lo[x] <= p[x] && p[x] <= self.hi[x]);
        if inside(&b[0]) || halvings == 0 {
            return Some(b[0].into());
        }
        let halves = [(0.0, 0.5), (0.5, 1.0)].into_iter();
        let mut halves = halves.map(|(from, to)| sub_segment(b, from, to));
        halves.find_map(|half| self.meets(&half, slack, halvings - 1))
    }

    /// Returns the bounds of the box in world coordinates.
    pub fn bounds(&self, pose: Pose, slack: f64) -> Piece {
        let (center, half) = (0.5 * (self.lo + self.hi), 0.5 * (self.hi - self.lo));
        let center = pose.to_world(center);
        let reach = pose.rotation.abs() * half + Vector3::repeat(slack);
        Piece {
            lo: center - reach,
            hi: center + reach,
        }
    }

    /// Returns true if boxes in the same coordinates overlap.
    pub fn overlaps(&self, other: &Piece) -> bool {
        (0..3).all(|x| self.lo[x] <= other.hi[x] && other.lo[x] <= self.hi[x])
    }

    /// Returns true unless a plane separates two boxes in different poses (separating axes).
    pub fn meets_piece(&self, pose: Pose, other: &Piece, at: Pose, slack: f64) -> bool {
        let half = |p: &Piece| 0.5 * (p.hi - p.lo);
        let center = |p: &Piece, pose: Pose| pose.to_world(0.5 * (p.lo + p.hi));
        let between = center(other, at) - center(self, pose);
        let axis = |m: &nalgebra::Matrix3<f64>, k: usize| Vector3::from(m.column(k));
        let (m, n) = (&pose.rotation, &at.rotation);
        let own = (0..3).map(|k| axis(m, k));
        let others = (0..3).map(|k| axis(n, k));
        let crossed = (0..9).map(|k| axis(m, k / 3).cross(&axis(n, k % 3)));
        let mut axes = own.chain(others).chain(crossed);
        !axes.any(|a| {
            // Almost parallel edges: their common normal is one of the other axes.
            if a.norm_squared() < 1e-6 {
                return false;
            }
            let reach = |m: &nalgebra::Matrix3<f64>, h: Vector3<f64>| m.tr_mul(&a).abs().dot(&h);
            between.dot(&a).abs() > reach(m, half(self)) + reach(n, half(other)) + 2.0 * slack
        })
    }
}
