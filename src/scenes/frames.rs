//! Frames of a motion: the positions of a moving set of curves.
//!
//! They replace a simulator in measurements of the cost or the verdict of moving frames. A frame
//! depends only on the set, the motion, its amplitude and the number of the frame, so frames may be
//! computed in any order:
//!
//! ```
//! use linkwatch::scenes::{Frames, Motion, Scene};
//!
//! let mut curves = "knit:rows=3,stitches=16,segments=576".parse::<Scene>()?.build()?.curves;
//! let motion: Motion = "smooth+translate".parse()?;
//! let mut frames = Frames::new(&curves, 1.0);
//! for frame in 0..10 {
//!     curves.update(frames.at(&motion, 0.05, frame))?;
//! }
//! # Ok::<(), linkwatch::Error>(())
//! ```

use super::motion::{Motion, MotionKind};
use super::pull_through::Pull;
use crate::curve::vector::{dot, per_axis};
use crate::curve::{CurveSet, Point, Positions, Received};
use crate::random::Random;
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Wavelength of [`MotionKind::Smooth`], in lengths.
const WAVELENGTH: f64 = 40.0;

/// Displacement of [`MotionKind::Translate`] per frame, in lengths: 5 in all.
const VELOCITY: Point = [4.0, -2.4, 1.8];

/// Axis of [`MotionKind::Rotate`], a unit vector.
const AXIS: Point = [2.0 / 7.0, 3.0 / 7.0, 6.0 / 7.0];

/// Angle of [`MotionKind::Rotate`] per frame, in degrees.
const TURN: f64 = 3.0;

/// Largest factor of [`MotionKind::Stretch`] and [`MotionKind::Scale`]; the smallest is its
/// inverse.
const STRETCH: f64 = 1.25;

/// Number of frames after which [`MotionKind::Stretch`] and [`MotionKind::Scale`] repeat.
const PERIOD: f64 = 40.0;

/// Number of points that one task moves.
const CHUNK: usize = 4096;

/// Frames of a moving set of curves.
#[derive(Clone, Debug)]
pub struct Frames {
    /// Control points of the set, curve after curve.
    base: Vec<Point>,
    /// Indices and original positions of points of `base` that a pull-through replaced.
    replaced: Vec<(usize, Point)>,
    centre: Point,
    length: f64,
    seed: u64,
    /// Control points in the precision of the set.
    frame: Received,
}

impl Frames {
    /// Creates the frames of a set. `length` (in units of the set) is the unit of motions, for
    /// example the diameter of a yarn.
    pub fn new(set: &CurveSet, length: f64) -> Frames {
        let [lo, hi] = set.corners();
        Frames {
            base: (0..set.len()).flat_map(|i| set.points_in(i)).collect(),
            replaced: Vec::new(),
            centre: per_axis(|x| lo[x] + (hi[x] - lo[x]) / 2.0),
            length,
            seed: 0,
            frame: set.positions().into(),
        }
    }

    /// Sets the seed of all random numbers; the default is 0.
    pub fn with_seed(self, seed: u64) -> Frames {
        Frames { seed, ..self }
    }

    /// Returns the positions of a frame, for [`CurveSet::update`]: all control points, curve after
    /// curve, in the precision of the set. `amplitude` is in units of the set. Frame 0 is the
    /// original set, bit for bit.
    pub fn at(&mut self, motion: &Motion, amplitude: f64, frame: u64) -> Positions<'_> {
        let kinds = (0..).zip(motion.kinds()).filter(|_| frame > 0);
        let steps = kinds.filter_map(|(k, &kind)| self.step(k, kind, amplitude, frame));
        let steps: Vec<Step> = steps.collect();
        match &mut self.frame {
            Received::F32(to) => {
                fill(to, &self.base, &steps, |x| x as f32);
                Positions::F32(to)
            }
            Received::F64(to) => {
                fill(to, &self.base, &steps, |x| x);
                Positions::F64(to)
            }
        }
    }

    /// Applies a pull-through: in every later frame, until [`Frames::release`], its curve lies on
    /// the other side. Between the previous and the next frame it passes through the other curve.
    ///
    /// # Panics
    /// If the pull-through belongs to a larger set.
    pub fn pull(&mut self, pull: &Pull) {
        for &k in &pull.points {
            self.replaced.push((k, self.base[k]));
            for (x, by) in self.base[k].iter_mut().zip(pull.by) {
                *x += by;
            }
        }
    }

    /// Reverts every [`Frames::pull`], bit for bit.
    pub fn release(&mut self) {
        // If a point was pulled twice, its first value is the original.
        for (k, point) in self.replaced.drain(..).rev() {
            self.base[k] = point;
        }
    }

    /// Returns the step of the `k`-th kind of a motion in a frame.
    fn step(&self, k: u64, kind: MotionKind, amplitude: f64, frame: u64) -> Option<Step> {
        let turns = frame as f64 / PERIOD;
        let factor = STRETCH.powf((TAU * turns).sin());
        let about_centre = |m: [Point; 3]| {
            let c = self.centre;
            affine(m, per_axis(|x| c[x] - dot(m[x], c)))
        };
        let random = || Random::from_key([self.seed, frame, k]);
        let transform: Transform = match kind {
            MotionKind::Still => return None,
            MotionKind::Smooth => {
                let mut random = random();
                let phases = [(); 3].map(|()| TAU * random.unit());
                let wave_number = TAU / (WAVELENGTH * self.length);
                Box::new(move |p, _| {
                    per_axis(|x| {
                        let along = p[(x + 1) % 3] + p[(x + 2) % 3];
                        p[x] + amplitude * (wave_number * along + phases[x]).sin()
                    })
                })
            }
            MotionKind::Iid => {
                Box::new(move |p, random| p.map(|x| x + amplitude * (2.0 * random.unit() - 1.0)))
            }
            MotionKind::Translate => {
                let way = VELOCITY.map(|v| v * self.length * frame as f64);
                affine(diagonal_matrix([1.0; 3]), way)
            }
            MotionKind::Rotate => about_centre(rotation(TURN.to_radians() * frame as f64)),
            MotionKind::Stretch => about_centre(diagonal_matrix([factor, 1.0, 1.0])),
            MotionKind::Scale => about_centre(diagonal_matrix([factor; 3])),
        };
        Some((random().next(), transform))
    }
}

/// Function that moves a point, with random numbers of its own.
type Transform = Box<dyn Fn(Point, &mut Random) -> Point + Sync>;

/// Transformation of every point of a frame, and the key of its random numbers.
type Step = (u64, Transform);

/// Returns an affine map, given by the rows of a matrix and a translation.
fn affine(m: [Point; 3], by: Point) -> Transform {
    Box::new(move |p, _| per_axis(|x| dot(m[x], p) + by[x]))
}

/// Moves all points. Every chunk has its own random numbers, so that threads share the work.
fn fill<T: Copy + Send + Sync>(
    to: &mut [T],
    base: &[Point],
    steps: &[Step],
    round: impl Fn(f64) -> T + Sync,
) {
    let chunks = to.par_chunks_mut(3 * CHUNK).zip(base.par_chunks(CHUNK));
    chunks.enumerate().for_each(|(chunk, (to, base))| {
        let random = |(key, _): &Step| Random::from_key([*key, chunk as u64]);
        let mut randoms: Vec<Random> = steps.iter().map(random).collect();
        for (to, &p) in to.chunks_exact_mut(3).zip(base) {
            let steps = steps.iter().zip(&mut randoms);
            let p = steps.fold(p, |p, ((_, transform), random)| transform(p, random));
            to.copy_from_slice(&p.map(&round));
        }
    });
}

fn diagonal_matrix([x, y, z]: Point) -> [Point; 3] {
    [[x, 0.0, 0.0], [0.0, y, 0.0], [0.0, 0.0, z]]
}

/// Returns the rotation about [`AXIS`] by an angle (Rodrigues).
fn rotation(angle: f64) -> [Point; 3] {
    let (s, c) = angle.sin_cos();
    let [x, y, z] = AXIS;
    let across = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]];
    let one = diagonal_matrix([c; 3]);
    per_axis(|i| per_axis(|j| one[i][j] + s * across[i][j] + (1.0 - c) * AXIS[i] * AXIS[j]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::Basis;
    use crate::ingest::FrameInfo;
    use crate::scenes::{Scene, pull_throughs};
    use crate::session::Session;
    use crate::verdict::Verdict;

    fn curves(text: &str) -> CurveSet {
        text.parse::<Scene>().unwrap().build().unwrap().curves
    }

    fn values(positions: Positions<'_>) -> Vec<f64> {
        match positions {
            Positions::F32(v) => v.iter().map(|&x| x.into()).collect(),
            Positions::F64(v) => v.to_vec(),
        }
    }

    fn motion(text: &str) -> Motion {
        text.parse().unwrap()
    }

    #[test]
    fn frames_depend_on_their_number_and_keep_their_amplitude() {
        let set = curves("chainmail:rows=20,columns=20");
        let mut frames = Frames::new(&set, 0.5);
        let base = values(frames.at(&motion("iid"), 0.25, 0));
        let mut bytes = Vec::new();
        set.write_positions(&mut bytes);
        let stored = bytes
            .chunks_exact(4)
            .map(|b| f64::from(f32::from_le_bytes(b.try_into().unwrap())));
        assert!(base.iter().copied().eq(stored));
        for (text, least, most) in [
            ("still", 0.0, 0.0),
            ("smooth", 0.2, 0.25001),
            ("iid", 0.24, 0.25001),
            ("translate", 2.0 * 7.0, 2.0 * 7.0001),
        ] {
            let m = motion(text);
            let seventh = values(frames.at(&m, 0.25, 7));
            let eighth = values(frames.at(&m, 0.25, 8));
            assert_eq!(seventh, values(frames.at(&m, 0.25, 7)), "{text}");
            assert_eq!(seventh == eighth, text == "still", "{text}");
            let way = base.iter().zip(&seventh).map(|(a, b)| (a - b).abs());
            let way = way.fold(0.0, f64::max);
            assert!((least..=most).contains(&way), "{text}: {way}");
        }
        let other = Frames::new(&set, 0.5).with_seed(1);
        for text in ["smooth", "iid"] {
            let m = motion(text);
            let before = values(frames.at(&m, 0.25, 3));
            assert_ne!(before, values(other.clone().at(&m, 0.25, 3)), "{text}");
        }
    }

    #[test]
    fn rigid_motions_keep_distances() {
        let set = curves("rubber_bands:bands=9");
        let mut frames = Frames::new(&set, 0.1);
        let distance = |v: &[f64]| (v[0] - v[300]).hypot(v[1] - v[301]).hypot(v[2] - v[302]);
        let base = distance(&values(frames.at(&motion("still"), 0.0, 1)));
        let rigid = values(frames.at(&motion("rotate+translate"), 0.0, 31));
        assert!((distance(&rigid) - base).abs() < 1e-5 * base);
        let scaled = values(frames.at(&motion("scale"), 0.0, 10));
        assert!((distance(&scaled) - STRETCH * base).abs() < 1e-5 * base);
    }

    #[test]
    fn affine_motions_and_small_ones_keep_the_topology() {
        for text in [
            "knit:rows=4,stitches=16,segments=512",
            "chainmail:rows=5,columns=5",
        ] {
            let mut set = curves(text);
            let mut frames = Frames::new(&set, 0.2);
            for name in [
                "translate",
                "rotate+stretch",
                "scale+smooth",
                "iid+translate",
            ] {
                let mut session = Session::new(Default::default()).unwrap();
                for frame in 0..12 {
                    set.update(frames.at(&motion(name), 0.05, frame)).unwrap();
                    let report = session.feed(FrameInfo::at(frame, 0.0), &set).unwrap();
                    assert_eq!(report.verdict, Verdict::Intact, "{text} {name} {frame}");
                }
            }
        }
    }

    #[test]
    fn a_pull_through_changes_its_pair_by_one_and_a_release_reverts_it() {
        for (text, all) in [
            ("knit:rows=4,stitches=16,segments=512", true),
            ("chainmail:rows=4,columns=4", true),
            ("chainmail:rows=4,columns=4,crumple=1", false),
            ("rubber_bands:bands=60", false),
            ("ribbon:segments=3000,lambda=30", false),
        ] {
            let mut set = curves(text);
            let pulls = pull_throughs(&set);
            assert!(!pulls.is_empty(), "{text}");
            let mut frames = Frames::new(&set, 0.1);
            let mut session = Session::new(Default::default()).unwrap();
            let mut seq = 0;
            let mut feed = |set: &CurveSet| {
                let info = FrameInfo::at(seq, 0.0);
                seq += 1;
                session.feed(info, set).unwrap()
            };
            let _ = feed(&set);
            let mut alone = 0;
            for pull in &pulls {
                frames.pull(pull);
                set.update(frames.at(&motion("smooth"), 1e-4, 1)).unwrap();
                let changes = feed(&set).changes;
                if let [c] = changes[..] {
                    let by_one = (c.expected - c.found).abs() == 1;
                    alone += usize::from((c.i, c.j) == pull.pair && by_one);
                }
                frames.release();
                set.update(frames.at(&motion("still"), 0.0, 1)).unwrap();
                assert_eq!(feed(&set).verdict, Verdict::Intact);
            }
            println!("{text}: {alone} of {}", pulls.len());
            assert!(
                alone == pulls.len() || (!all && 2 * alone > pulls.len()),
                "{text}: {alone} of {}",
                pulls.len()
            );
        }
    }

    #[test]
    fn a_set_that_allows_no_pull_through_has_none() {
        let point = CurveSet::from_counts(Basis::Polyline, &[-1, -1], Positions::F32(&[0.0; 6]));
        assert!(pull_throughs(&point.unwrap()).is_empty());
        let far = "rubber_bands:bands=1".parse::<Scene>().unwrap();
        assert!(pull_throughs(&far.build().unwrap().curves).is_empty());
    }
}
