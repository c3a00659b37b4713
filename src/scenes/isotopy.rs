//! Deformations of space that change no linking number: shears along waves.
//!
//! # Bounds of a sequence of shears
//!
//! A shear moves a point `p` by `a sin(k n.p + phase)` along `d`, where the unit vectors `d` and
//! `n` are orthogonal. It is a homeomorphism of space (its inverse is the same shear with `-a`),
//! and it is homotopic to the identity through its amplitude. Therefore a sequence of shears moves
//! curves without any of them passing through another.
//!
//! Curves are stored as polygons, whose edges stay straight when their vertices move. The error of
//! this follows from two bounds. A shear of slope `s = a k` has the derivative `1 + g d n'` with
//! `|g| <= s`, whose singular values lie between `1 / q` and `q` for `q = (s + sqrt(s^2 + 4)) / 2`;
//! its second derivative along a unit vector is at most `a k^2`. For the sequence, with `q` the
//! product of all: no distance shrinks by more than `q`, and the second derivative `b` of a
//! sequence followed by another shear is at most `a k^2 q^2 + q_shear b`.

use super::sagitta;
use crate::curve::Point;
use crate::curve::vector::{add_scaled, dot};
use std::f64::consts::TAU;

/// A shear along one wave.
pub(super) struct Shear {
    /// Direction in which points move; a unit vector.
    pub direction: Point,
    /// Direction of the wave; a unit vector orthogonal to `direction`.
    pub normal: Point,
    pub wavelength: f64,
    /// Amplitude multiplied by the wave number.
    pub slope: f64,
    pub phase: f64,
}

impl Shear {
    fn wave_number(&self) -> f64 {
        TAU / self.wavelength
    }

    fn amplitude(&self) -> f64 {
        self.slope / self.wave_number()
    }

    fn stretch(&self) -> f64 {
        (self.slope + (self.slope * self.slope + 4.0).sqrt()) / 2.0
    }

    fn apply(&self, p: Point) -> Point {
        let along = dot(self.normal, p);
        let by = self.amplitude() * (self.wave_number() * along + self.phase).sin();
        add_scaled(p, by, self.direction)
    }
}

/// Sequence of shears.
pub(super) struct Isotopy(pub Vec<Shear>);

impl Isotopy {
    /// Returns waves along the diagonal of the xy plane that move points up and down, followed by
    /// waves along z that move them along the diagonal, with the wavelength, the slope and the
    /// phase of each.
    pub fn crossed(waves: [[f64; 3]; 2]) -> Isotopy {
        let diagonal = [0.5f64.sqrt(), 0.5f64.sqrt(), 0.0];
        let up = [0.0, 0.0, 1.0];
        let axes = [(up, diagonal), (diagonal, up)].into_iter().zip(waves);
        let shears = axes.map(|((direction, normal), [wavelength, slope, phase])| Shear {
            direction,
            normal,
            wavelength,
            slope,
            phase,
        });
        Isotopy(shears.collect())
    }

    pub fn apply(&self, p: Point) -> Point {
        self.0.iter().fold(p, |p, shear| shear.apply(p))
    }

    /// Returns the factor that bounds the change of all distances, up and down.
    pub fn stretch(&self) -> f64 {
        self.0.iter().map(Shear::stretch).product()
    }

    /// Returns the largest distance that a point moves.
    pub fn reach(&self) -> f64 {
        self.0.iter().map(Shear::amplitude).sum()
    }

    /// Returns a bound of the distance between the straight edge of two moved points and the moved
    /// edge, for an original length `edge`.
    pub fn sagitta(&self, edge: f64) -> f64 {
        let (_, bend) = self.0.iter().fold((1.0, 0.0), |(stretch, bend), shear| {
            let own = shear.slope * shear.wave_number();
            (
                stretch * shear.stretch(),
                own * stretch * stretch + shear.stretch() * bend,
            )
        });
        sagitta(edge, bend)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::vector::distance;
    use crate::curve::vector::per_axis;

    fn sample() -> Isotopy {
        let shear = |direction, normal, wavelength, slope, phase| Shear {
            direction,
            normal,
            wavelength,
            slope,
            phase,
        };
        Isotopy(vec![
            shear([0., 0., 1.], [0.6, 0.8, 0.], 30., 1., 0.3),
            shear([1., 0., 0.], [0., -0.6, 0.8], 20., 1.5, 1.),
            shear([0., 1., 0.], [0.8, 0., 0.6], 25., 0.7, 2.),
        ])
    }

    #[test]
    fn distances_and_chords_stay_within_their_bounds() {
        let isotopy = sample();
        let mut random = crate::random::Random::new(7);
        let (mut nearest, mut farthest, mut highest) = (f64::MAX, 0f64, 0f64);
        for _ in 0..20_000 {
            let p = [0; 3].map(|_: i32| 60.0 * random.unit());
            let step = [0; 3].map(|_: i32| random.unit() - 0.5);
            let q = per_axis(|k| p[k] + step[k]);
            let middle = per_axis(|k| p[k] + step[k] / 2.0);
            let (edge, moved) = (distance(p, q), [p, q, middle].map(|p| isotopy.apply(p)));
            let ratio = distance(moved[0], moved[1]) / edge;
            (nearest, farthest) = (nearest.min(ratio), farthest.max(ratio));
            let chord = per_axis(|k| (moved[0][k] + moved[1][k]) / 2.0);
            highest = highest.max(distance(chord, moved[2]) / isotopy.sagitta(edge));
            assert!(distance(p, moved[0]) <= isotopy.reach());
        }
        let q = isotopy.stretch();
        assert!(
            1.0 / q <= nearest && farthest <= q,
            "{nearest} {farthest} {q}"
        );
        assert!(highest <= 1.0, "{highest}");
        // The bounds are of the right magnitude.
        assert!(farthest > q / 3.0 && highest > 0.05, "{farthest} {highest}");
    }

    #[test]
    fn the_reversed_shears_are_the_inverse() {
        let isotopy = sample();
        let p = [1.5, -7.0, 3.25];
        let there = isotopy.apply(p);
        let back = isotopy.0.iter().rev().fold(there, |p, s| {
            let back = Shear {
                slope: -s.slope,
                ..*s
            };
            back.apply(p)
        });
        assert!(distance(p, there) > 1.0 && distance(p, back) < 1e-12);
    }
}
