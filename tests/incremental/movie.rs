//! Random motions of a set, and events: contacts, collapsing curves, sudden displacements.

use crate::sets::{MOST, update, values};
use crate::support::random::Random;
use linkwatch::scenes::{Frames, Motion, MotionKind, pull_throughs};
use linkwatch::{Basis, CurveSet, Point};

/// Event that changes a frame after its motion, for a few frames.
#[derive(Clone, Copy, Debug)]
enum Event {
    /// Points of the second curve coincide with points of the first one.
    Contact([usize; 2], [usize; 2]),
    /// The curve shrinks: this number of its first points remain apart.
    Collapse(usize, usize),
    /// The curve is scaled down by this factor about its first point.
    Shrink(usize, i32),
    /// Two neighbouring points of a curve coincide.
    Repeat(usize, usize),
    /// One coordinate is the same in the whole frame.
    Flatten(usize),
    /// One point moves far away.
    Spike(usize, usize),
}

/// Frames of one sequence.
pub struct Movie {
    random: Random,
    pub set: CurveSet,
    frames: Frames,
    pulls: Vec<linkwatch::scenes::Pull>,
    motion: Motion,
    amplitude: f64,
    /// True if events happen to few curves only.
    calm: bool,
    /// True if the waves persist and grow. False if they change in every frame.
    steady: bool,
    /// Number of frames since the motion began.
    age: u64,
    /// Width of the lattice to which all points are rounded, so that curves touch exactly in many
    /// frames.
    pub lattice: Option<f64>,
    /// Displacement of each curve, and its displacement per frame.
    ways: Vec<[Point; 2]>,
    events: Vec<(Event, u64)>,
}

impl Movie {
    pub fn new(mut random: Random, set: CurveSet) -> Movie {
        let mut movie = Movie {
            frames: Frames::new(&set, 0.2).with_seed(random.next()),
            pulls: pull_throughs(&set),
            motion: MotionKind::Still.into(),
            amplitude: 0.0,
            calm: set.len() > MOST,
            steady: false,
            age: 0,
            lattice: None,
            ways: vec![[[0.0; 3]; 2]; set.len()],
            events: Vec::new(),
            random,
            set,
        };
        movie.change_motion();
        movie
    }

    fn change_motion(&mut self) {
        let random = &mut self.random;
        let kinds = 1 + random.below(2);
        let kinds: Vec<_> = (0..kinds).map(|_| random.pick(&MotionKind::ALL)).collect();
        self.motion = Motion::new(kinds);
        let largest = if self.calm { -3.0 } else { 0.0 };
        self.amplitude = 0.3 * 10f64.powf(random.between(-6.0, largest));
        self.steady = random.one_in(2);
        self.age = 0;
    }

    /// Returns the index of the first point of a curve among all points.
    fn first(&self, curve: usize) -> usize {
        self.set.curves()[..curve]
            .iter()
            .map(|c| c.points as usize)
            .sum()
    }

    /// Returns a random curve and one of its points.
    fn somewhere(&mut self) -> (usize, usize) {
        let i = self.random.below(self.set.len());
        let n = self.set.curve(i).points as usize;
        (i, self.random.below(n))
    }

    fn random_event(&mut self) -> Event {
        let ((i, a), (j, b)) = (self.somewhere(), self.somewhere());
        match self.random.below(7) {
            6 => Event::Shrink(i, 1 << self.random.below(31)),
            0 => Event::Collapse(i, 1 + self.random.below(3)),
            1 => Event::Repeat(i, a),
            // Splines in a plane cross everywhere, and each crossing is refined up to the limit.
            2 if !self.calm && (self.set.basis().is_polyline() || self.set.points() < 40) => {
                Event::Flatten(self.random.below(3))
            }
            3 => Event::Spike(i, a),
            // B-splines with a common knot have a common tangent and curvature there, which takes
            // 0.1 s until the limit.
            _ if i == j || (self.set.basis() == Basis::BSpline && !self.random.one_in(12)) => {
                Event::Repeat(j, b)
            }
            _ => Event::Contact([i, a], [j, b]),
        }
    }

    /// Moves the set to the next frame.
    pub fn advance(&mut self, frame: u64) {
        self.age += 1;
        if self.random.one_in(if self.calm { 25 } else { 9 }) {
            self.change_motion();
        }
        if self.random.one_in(10) && !self.pulls.is_empty() {
            let at = self.random.below(self.pulls.len());
            self.frames.pull(&self.pulls[at]);
        }
        if self.random.one_in(12) {
            self.frames.release();
        }
        let curve = self.random.below(self.ways.len());
        match self.random.below(30) {
            // A sudden displacement.
            0 => self.ways[curve][0] = self.random.point(2.0),
            // The curve moves on its own from now on.
            1 => {
                let step = 0.3 * 10f64.powf(self.random.between(-3.0, 0.0));
                self.ways[curve][1] = self.random.point(step);
            }
            2 => self.ways[curve][1] = [0.0; 3],
            3 => self.ways.fill([[0.0; 3]; 2]),
            _ => {}
        }
        if self.random.one_in(9) {
            let event = self.random_event();
            let last = frame + self.random.below(4) as u64;
            self.events.push((event, last));
        }
        self.events.retain(|&(_, last)| frame <= last);

        let mut xyz = match self.steady {
            true => values(
                self.frames
                    .at(&self.motion, self.amplitude * self.age as f64, 1),
            ),
            false => values(self.frames.at(&self.motion, self.amplitude, frame)),
        };
        let mut at = 0;
        for (c, [gone, step]) in self.set.curves().iter().zip(&mut self.ways) {
            let end = at + 3 * c.points as usize;
            for x in 0..3 {
                gone[x] += step[x];
                xyz[at..end]
                    .iter_mut()
                    .skip(x)
                    .step_by(3)
                    .for_each(|v| *v += gone[x]);
            }
            at = end;
        }
        for &(event, _) in &self.events {
            self.apply(event, &mut xyz);
        }
        if let Some(width) = self.lattice {
            xyz.iter_mut()
                .for_each(|x| *x = (*x / width).round() * width);
        }
        if self.random.one_in(40) {
            // The frame is rejected after half of it was written.
            let at = self.random.below(xyz.len());
            let mut broken = xyz.clone();
            broken[at] = f64::NAN;
            update(&mut self.set, &broken).unwrap_err();
        }
        update(&mut self.set, &xyz).unwrap();
    }

    fn apply(&self, event: Event, xyz: &mut [f64]) {
        let points = |i: usize| self.set.curve(i).points as usize;
        let slot = |i: usize, k: usize| 3 * (self.first(i) + k % points(i));
        let mut copy = |from: usize, to: usize| xyz.copy_within(from..from + 3, to);
        match event {
            Event::Shrink(i, by) => {
                let first = slot(i, 0);
                for at in first..first + 3 * points(i) {
                    let centre = xyz[first + at % 3];
                    xyz[at] = centre + (xyz[at] - centre) / f64::from(by);
                }
            }
            Event::Contact([i, a], [j, b]) => match self.set.basis() {
                // A knot depends on three control points.
                Basis::BSpline => (0..3).for_each(|k| copy(slot(i, a + k), slot(j, b + k))),
                // At the joint of two segments.
                Basis::Bezier => copy(slot(i, a - a % 3), slot(j, b - b % 3)),
                Basis::Polyline | Basis::CatmullRom => copy(slot(i, a), slot(j, b)),
            },
            Event::Collapse(i, n) => (0..points(i)).for_each(|k| copy(slot(i, k % n), slot(i, k))),
            Event::Repeat(i, a) => copy(slot(i, a), slot(i, a + 1)),
            Event::Flatten(x) => {
                let value = xyz[x];
                xyz.iter_mut().skip(x).step_by(3).for_each(|v| *v = value);
            }
            Event::Spike(i, a) => xyz[slot(i, a)] += 5.0,
        }
    }
}
