//! Curves that jump by a lattice vector from one frame to the next.
//!
//! Simulations move a whole molecule back into the cell once its centre has left it. Such a curve
//! is translated back by the lattice vector, in this frame and in all later ones, so that its
//! motion is continuous.
//!
//! # What is a jump, and what is a motion
//!
//! The motion of a curve in a step is known up to a lattice vector. A curve jumped if its first
//! point moved by more than half of the cell along a vector, and if all its points, translated
//! back, moved by at most [a third](LONGEST). Other curves are used as they are given. So a motion
//! is mistaken for a jump only if it ends within a third of the cell of an image of the curve,
//! where the structure is the same in both cases.
//!
//! Cost: a few operations per curve. A frame in which a curve is translated is copied.

use super::unwrap::{LONGEST, fractional};
use crate::curve::vector::{add, per_axis, sub};
use crate::curve::{Cell, CurveSet, Image, Point, Positions, is_home, plus};
use crate::error::Result;

/// Detects jumps in successive frames, and translates the curves back.
#[derive(Clone, Debug, Default, serde::Serialize, serde::Deserialize)]
pub(crate) struct Jumps {
    /// First point of each curve in the previous frame as given, in fractional coordinates of the
    /// cell of that frame, and the translation of the curve.
    before: Vec<(Point, Image)>,
    /// First points and translations of the current frame, until it is verified.
    #[serde(skip)]
    current: Vec<(Point, Image)>,
    /// Number of jumps so far, and number of jumps in the step to the current frame.
    count: [u64; 2],
}

impl Jumps {
    /// Returns the number of jumps so far.
    pub fn count(&self) -> u64 {
        self.count[0]
    }

    /// Returns the translated curves of the last verified frame, with their translations.
    pub fn translated(&self) -> Vec<(u32, Image)> {
        let all = (0..).zip(&self.before).map(|(i, (_, image))| (i, *image));
        all.filter(|(_, image)| !is_home(image)).collect()
    }

    /// Makes the current frame the previous one, because it was verified.
    pub fn commit(&mut self) {
        std::mem::swap(&mut self.before, &mut self.current);
        self.count[0] += std::mem::take(&mut self.count[1]);
    }

    /// Returns the curves of a frame, translated so that they continue those of the previous frame;
    /// `None` if none is translated. `previous` is the previous frame, translated, with its cell.
    /// In a first frame, the curves of `translated` get these translations.
    ///
    /// The returned curves have double precision.
    ///
    /// # Errors
    ///
    /// The errors of [`CurveSet::from_counts`].
    pub fn follow(
        &mut self,
        given: &CurveSet,
        cell: &Cell,
        previous: Option<(&CurveSet, Cell)>,
        translated: &[(u32, Image)],
    ) -> Result<Option<CurveSet>> {
        let fractional_now = fractional(cell);
        let firsts = (0..given.len()).map(|i| fractional_now(given.point(i, 0)));
        self.current.clear();
        self.count[1] = 0;
        let mut first = Vec::new();
        let mut before = &self.before;
        if before.len() != given.len() {
            first.extend(firsts.clone().map(|u| (u, Image::default())));
            for (i, image) in translated {
                if let Some(curve) = first.get_mut(*i as usize) {
                    curve.1 = *image;
                }
            }
            before = &first;
        }
        let periodic = cell.periodic();
        for (i, (u, before)) in firsts.zip(before).enumerate() {
            let step = sub(u, before.0);
            self.current.push((u, before.1));
            // Most curves do not jump.
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
            let same =
                |(known, _): &(&CurveSet, Cell)| known.curve(i).points == given.curve(i).points;
            let is_near = |(known, cell): (&CurveSet, Cell)| {
                let fractional_then = fractional(&cell);
                (0..given.curve(i).points as usize).all(|k| {
                    let now = fractional_now(given.point(i, k));
                    let step = sub(add(now, by), fractional_then(known.point(i, k)));
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::Basis;

    /// Regression test: steps were measured from the origin in the cell of the later frame, so that
    /// jumps after some earlier ones were not found.
    #[test]
    fn a_jump_is_followed_in_the_frame_in_which_the_cell_changes() {
        for corner in [0.0, -5.0, 1000.0] {
            let mut jumps = Jumps::default();
            let mut last: Option<(CurveSet, Cell)> = None;
            for frame in 0..80 {
                let size = if frame < 60 { 10.0 } else { 10.3 };
                let cell = Cell::orthogonal([corner; 3], [size; 3]);
                // The whole curve is moved back into the cell.
                let x = 0.3 + 0.27 * f64::from(frame);
                let at = |x: f64, dx: f64| [corner + size * (x + dx), corner + 1.0, corner + 2.0];
                let home = x.rem_euclid(1.0);
                let xyz = [at(home, 0.0), at(home, 0.1), at(home, 0.2)];
                let positions = Positions::F64(xyz.as_flattened());
                let given = CurveSet::from_counts(Basis::Polyline, &[3], positions).unwrap();
                let previous = last.as_ref().map(|(set, cell)| (set, *cell));
                let followed = jumps.follow(&given, &cell, previous, &[]).unwrap();
                let set = followed.unwrap_or(given);
                jumps.commit();
                let found = set.point(0, 0)[0];
                assert!((found - at(x, 0.0)[0]).abs() < 1e-9, "{corner}, {frame}");
                last = Some((set, cell));
            }
            assert_eq!(jumps.count(), 21);
        }
    }
}
