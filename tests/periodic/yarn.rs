//! Yarns that run through the cell.

use crate::scene::{Point, translation};
use crate::support::random::Random;
use linkwatch::{Basis, Cell, CurveSet, Events, Image, Positions, SessionOptions, Strategy};

/// A yarn that runs through the cell.
#[derive(Clone, Debug)]
pub struct Yarn {
    pub cell: Cell,
    pub period: Image,
    pub basis: Basis,
    /// Control points of one period.
    pub points: Vec<Point>,
}

impl Yarn {
    /// Returns a crooked yarn whose periods reach far into one another, in a cell with one to three
    /// directions of repetition. On a grid, no sum is rounded.
    pub fn random(seed: u64, basis: Basis) -> Yarn {
        let mut random = Random::from_key([seed, 51]);
        let cells = [
            ("4,0,0", [1, 0, 0]),
            ("0,3,0", [0, -1, 0]),
            ("3,4,0", [1, -1, 0]),
            ("0,0,0,3,1,2,0,0,0", [0, 1, 0]),
            ("4,0,0,1.5,3.5,0,0,0,0", [0, 1, 0]),
            ("9,8,2", [0, 0, -1]),
            ("4,0,0,1.25,9,0,-1,0.75,9", [1, 0, 0]),
            ("3.7,0,0,1.1,8.9,0,-0.3,0.9,9.1", [-1, 0, 0]),
            ("2,3,9", [2, 1, 0]),
        ];
        let (cell, period) = random.pick(&cells);
        let cell: Cell = cell.parse().unwrap();
        let along = translation(&cell, period);
        let segments = 1 + random.below(12);
        let n = match basis {
            Basis::Bezier => 3 * segments,
            _ => segments,
        };
        let size = random.pick(&[2.0, 3.5, 5.0]);
        let points = (0..n).map(|k| {
            let t = f64::from(k) / f64::from(n);
            [0, 1, 2].map(|x| t * along[x] + size * (2.0 * random.unit() - 1.0))
        });
        Yarn {
            cell,
            period,
            basis,
            points: points.collect(),
        }
    }

    pub fn snapped(&self, steps: f64) -> Yarn {
        let mut snapped = self.clone();
        let snap = |x: &mut f64| *x = (steps * *x).round() / steps;
        snapped.points.iter_mut().flatten().for_each(snap);
        snapped.cell.vectors.iter_mut().flatten().for_each(snap);
        snapped
    }

    /// Returns the yarn after a motion of each control point.
    pub fn moved(&self, random: &mut Random, amplitude: f64) -> Yarn {
        let mut moved = self.clone();
        for x in moved.points.iter_mut().flatten() {
            *x += amplitude * (2.0 * random.unit() - 1.0);
        }
        moved
    }

    pub fn segments(&self) -> u32 {
        let n = self.points.len() as u32;
        if self.basis == Basis::Bezier {
            n / 3
        } else {
            n
        }
    }

    /// Returns a control point of the infinite curve.
    pub fn point(&self, k: i32) -> Point {
        let n = self.points.len() as i32;
        let along = translation(&self.cell, self.period);
        let p = self.points[k.rem_euclid(n) as usize];
        [0, 1, 2].map(|x| p[x] + f64::from(k.div_euclid(n)) * along[x])
    }

    /// Returns the control points of some periods in a row as one open curve.
    pub fn in_a_row(&self, periods: i32) -> Vec<Point> {
        let last = periods * self.points.len() as i32;
        let ends = match self.basis {
            Basis::Polyline | Basis::Bezier => 0..=last,
            Basis::CatmullRom | Basis::BSpline => -1..=last + 1,
        };
        ends.map(|k| self.point(k)).collect()
    }

    /// Returns some periods in a row as one open curve.
    pub fn unrolled(&self, periods: i32) -> CurveSet {
        let points = self.in_a_row(periods);
        let positions = Positions::F64(points.as_flattened());
        CurveSet::from_counts(self.basis, &[points.len() as i32], positions).unwrap()
    }

    pub fn options(&self, strategy: Strategy, events: Events) -> SessionOptions {
        let mut options = SessionOptions::default();
        (options.strategy, options.events) = (strategy, events);
        options.cell = Some(self.cell);
        // Segments may be longer than half of the cell.
        options.wrapped = Some(false);
        // On a grid, curves may end where they start.
        options.keep_open = true;
        options
    }

    /// Returns an upper bound of the number of periods that reach one another.
    pub fn reach(&self) -> i32 {
        let along = translation(&self.cell, self.period);
        let square: f64 = along.iter().map(|x| x * x).sum();
        let at = |p: &Point| (0..3).map(|x| p[x] * along[x]).sum::<f64>() / square;
        let all = self.points.iter().map(at);
        let (lo, hi) = all.fold((0.0, 1.0), |(lo, hi), u| (f64::min(lo, u), f64::max(hi, u)));
        (1.5 * (hi - lo)).ceil() as i32 + 1
    }
}
