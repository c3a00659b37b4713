//! Curves that jump by a lattice vector from one frame to the next.
//!
//! Simulations move a whole molecule back into the cell once its centre has left it. Such a curve
//! is followed: it is translated by the lattice vector back to where it came from, in this frame
//! and in all later ones.
//!
//! # What is a jump, and what is a motion
//!
//! The motion of a curve in a step is known up to a lattice vector. A curve jumped if its first
//! point moved by more than half of the cell along a vector, and all its points would move by at
//! most [a third](LONGEST) if it was translated back. Other curves are taken as they are given. So
//! a motion is taken for a jump only if it leads to within a third of the cell of an image of the
//! curve, where the structure is the same in both cases.
//!
//! Cost: a few operations per curve. A frame in which a curve is not at its first image is copied.

use super::unwrap::LONGEST;
use crate::curve::vector::{add, dot, per_axis, sub};
use crate::curve::{Cell, CurveSet, Image, Point, Positions, is_home, plus};
use crate::error::Result;

/// Follows the curves of successive frames.
#[derive(Clone, Debug, Default, serde::Serialize, serde::Deserialize)]
pub(crate) struct Jumps {
    /// First point of each curve in the previous frame as given, in fractional coordinates, and the
    /// translation by which the curve is followed.
    before: Vec<(Point, Image)>,
    /// First points and translations of the current frame, until it is verified.
    #[serde(skip)]
    current: Vec<(Point, Image)>,
    /// Number of jumps so far, and of those to the current frame.
    count: [u64; 2],
}

impl Jumps {
    /// Returns the number of jumps so far.
    pub fn count(&self) -> u64 {
        self.count[0]
    }

    /// Continues from the current frame: it was verified.
    pub fn commit(&mut self) {
        std::mem::swap(&mut self.before, &mut self.current);
        self.count[0] += std::mem::take(&mut self.count[1]);
    }

    /// Returns the curves of a frame where they are followed; `None`: they are as given. `previous`
    /// is the previous frame where its curves are followed.
    ///
    /// Curves that are followed have double precision.
    ///
    /// # Errors
    ///
    /// The errors of [`CurveSet::from_counts`].
    pub fn follow(
        &mut self,
        given: &CurveSet,
        cell: &Cell,
        previous: Option<&CurveSet>,
    ) -> Result<Option<CurveSet>> {
        let inverse = cell.inverse().unwrap_or_default();
        let fractional = |p: Point| inverse.map(|b| dot(b, p));
        let firsts = (0..given.len()).map(|i| fractional(given.point(i, 0)));
        self.current.clear();
        self.count[1] = 0;
        if self.before.len() != given.len() {
            self.current.extend(firsts.map(|u| (u, Image::default())));
            return Ok(None);
        }
        let periodic = cell.periodic();
        for (i, (u, before)) in firsts.zip(&self.before).enumerate() {
            let step = sub(u, before.0);
            self.current.push((u, before.1));
            // Most curves.
            if step.iter().all(|x| x.abs() <= 0.5) {
                continue;
            }
            let back = per_axis(|x| match periodic[x] {
                true => -step[x].round().clamp(-1e9, 1e9) as i32,
                false => 0,
            });
            if is_home(&back) {
                continue;
            }
            let image = plus(before.1, back);
            let by = image.map(f64::from);
            let same = |set: &&CurveSet| set.curve(i).points == given.curve(i).points;
            let is_near = |known: &CurveSet| {
                (0..given.curve(i).points as usize).all(|k| {
                    let [now, then] = [given, known].map(|set| fractional(set.point(i, k)));
                    let step = sub(add(now, by), then);
                    (0..3).all(|x| !periodic[x] || step[x].abs() <= LONGEST)
                })
            };
            if previous.filter(same).is_some_and(is_near) {
                self.current[i].1 = image;
                self.count[1] += 1;
            }
        }
        if self.current.iter().all(|(_, image)| is_home(image)) {
            return Ok(None);
        }
        let positions = given.positions();
        let mut xyz = Vec::with_capacity(3 * given.points());
        for (i, (_, image)) in self.current.iter().enumerate() {
            let by = cell.translation(*image);
            xyz.extend(given.points_of(i).flat_map(|k| add(positions.point(k), by)));
        }
        let counts: Vec<i32> = given.counts().collect();
        CurveSet::from_counts(given.basis(), &counts, Positions::F64(&xyz)).map(Some)
    }
}
