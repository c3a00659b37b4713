//! Random periodic scenes.

use crate::support::random::Random;
use crate::support::session::Step;
use linkwatch::{
    Basis, Cell, Certificate, CurveSet, Events, Image, Positions, Session, SessionOptions, Strategy,
};

pub type Point = [f64; 3];

/// A periodic scene of closed or open polylines.
#[derive(Clone, Debug)]
pub struct Scene {
    pub cell: Cell,
    pub curves: Vec<Vec<Point>>,
    /// True if the curves are closed.
    pub closed: bool,
    /// Images that may matter, in each direction.
    pub reach: i32,
}

/// Cells of all kinds: with three, two and one directions of repetition, orthogonal and sheared.
const CELLS: [&str; 8] = [
    "4,4,4",
    "4,4,0",
    "0,0,4",
    "4,3,5",
    "4,0,0,1.25,4,0,-1,0.75,4",
    "4,0,0,1.5,3.5,0,0,0,0",
    "0,0,0,3,1,2,0,0,0",
    "3.7,0,0,1.1,3.9,0,-0.3,0.9,4.1",
];

impl Scene {
    /// Returns a scene of a few rings. Some are larger than the cell. Every second one has vertices
    /// on a grid, so that curves touch and projections coincide.
    pub fn random(seed: u64) -> Scene {
        let mut random = Random::from_key([seed, 22]);
        let cell: Cell = CELLS[seed as usize % CELLS.len()].parse().unwrap();
        let grid = seed.is_multiple_of(2);
        let count = 1 + random.below(4);
        let largest = random.pick(&[1.6, 2.6, 3.4]);
        let mut curves = Vec::new();
        for _ in 0..count {
            let center = [0; 3].map(|_| 4.0 * random.unit());
            let n = 4 + random.below(5);
            let size = largest * (0.6 + 0.4 * random.unit());
            curves.push(ring(&mut random, center, size, n, grid));
        }
        Scene {
            cell,
            curves,
            closed: true,
            reach: 3,
        }
    }

    /// Returns the curves.
    pub fn set(&self) -> CurveSet {
        let count = |c: &Vec<Point>| match self.closed {
            true => -(c.len() as i32),
            false => c.len() as i32,
        };
        let counts: Vec<i32> = self.curves.iter().map(count).collect();
        let xyz = self.curves.concat().concat();
        CurveSet::from_counts(Basis::Polyline, &counts, Positions::F64(&xyz)).unwrap()
    }

    /// Returns the translation of an image.
    pub fn translation(&self, image: Image) -> Point {
        translation(&self.cell, image)
    }

    /// Returns all images within reach, the curve itself first.
    pub fn images(&self) -> Vec<Image> {
        let range = |k: usize| match self.cell.periodic()[k] {
            true => -self.reach..=self.reach,
            false => 0..=0,
        };
        let mut all = vec![Image::default()];
        for a in range(0) {
            for b in range(1) {
                all.extend(range(2).map(|c| [a, b, c]).filter(|n| *n != [0; 3]));
            }
        }
        all
    }

    /// Returns a scene in which every image within reach is a curve of its own: image by image.
    pub fn supercell(&self) -> Scene {
        let mut curves = Vec::new();
        for image in self.images() {
            let by = self.translation(image);
            let moved = |p: &Point| [0, 1, 2].map(|x| p[x] + by[x]);
            curves.extend(
                self.curves
                    .iter()
                    .map(|c| c.iter().map(moved).collect::<Vec<_>>()),
            );
        }
        Scene {
            curves,
            ..self.clone()
        }
    }

    /// Returns the scene after random motions of all vertices, and of whole curves.
    pub fn moved(&self, seed: u64, amplitude: f64) -> Scene {
        let mut random = Random::from_key([seed, 23]);
        let mut next = self.clone();
        for curve in &mut next.curves {
            let drift = [0; 3].map(|_| amplitude * (2.0 * random.unit() - 1.0));
            for p in curve {
                for x in 0..3 {
                    p[x] += drift[x] + 0.2 * amplitude * (2.0 * random.unit() - 1.0);
                }
            }
        }
        next
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

    /// Returns the linking numbers of the scene.
    pub fn certificate(&self) -> Certificate {
        let mut session = Session::new(self.options(Strategy::Full, Events::Off)).unwrap();
        session.step(0, self.set());
        session.baseline().unwrap().clone()
    }
}

/// Returns a crooked ring around a point.
fn ring(random: &mut Random, center: Point, size: f64, n: i32, grid: bool) -> Vec<Point> {
    let mut axes = [[0.0; 3]; 2];
    for axis in &mut axes {
        let direction = [0; 3].map(|_| 2.0 * random.unit() - 1.0);
        let length = direction.iter().map(|x| x * x).sum::<f64>().sqrt();
        *axis = direction.map(|x| x * size / length);
    }
    let point = |k: i32, random: &mut Random| {
        let (s, c) = (std::f64::consts::TAU * f64::from(k) / f64::from(n)).sin_cos();
        [0, 1, 2].map(|x| {
            let noise = 0.25 * size * (2.0 * random.unit() - 1.0);
            let exact = center[x] + c * axes[0][x] + s * axes[1][x] + noise;
            if grid {
                (2.0 * exact).round() / 2.0
            } else {
                exact
            }
        })
    };
    (0..n).map(|k| point(k, random)).collect()
}

/// Returns the translation of an image.
pub fn translation(cell: &Cell, image: Image) -> Point {
    [0, 1, 2].map(|x| {
        let part = |k: usize| f64::from(image[k]) * cell.vectors[k][x];
        part(0) + part(1) + part(2)
    })
}
