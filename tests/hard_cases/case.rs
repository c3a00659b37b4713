//! Type of a hard case, and transformations that give other views of it.

use crate::support::oracle;
use crate::support::random::Random;
use linkwatch::{Basis, CurveSet, Point, Positions, Precision};
use std::collections::{BTreeMap, BTreeSet};

/// A closed integer polygon, the input of the oracle.
pub type Polygon = Vec<[i64; 3]>;

/// A closed curve, by its control points.
pub type Loop = Vec<Point>;

/// A small scene and its exact answer.
#[derive(Clone)]
pub struct Case {
    pub name: String,
    pub curves: CurveSet,
    pub expected: Expected,
}

/// Exact answer of a case.
#[derive(Clone, Default)]
pub struct Expected {
    /// Answers of pairs `(i, j)` with `i < j`; all others have the linking number 0.
    pub answers: BTreeMap<(usize, usize), Answer>,
    /// Loops of fewer than three distinct points, whose pairs have no answer.
    pub degenerate: BTreeSet<usize>,
}

/// Exact answer of one pair.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Answer {
    /// A linking number, which every complete kernel must find.
    Number(i64),
    /// A linking number of splines so close that "too close" is a valid answer, too.
    Near(i64),
    /// Polylines that share a point.
    Contact,
    /// Splines that share a point: contact or too close, no number.
    Touching,
}

impl Expected {
    /// Nothing is linked or touches.
    pub fn unlinked() -> Expected {
        Expected::default()
    }

    /// Returns the answer of one pair, of curves 0 and 1.
    pub fn pair(answer: Answer) -> Expected {
        Expected {
            answers: [((0, 1), answer)].into(),
            ..Expected::default()
        }
    }

    /// Returns the oracle's answers for all pairs.
    pub fn of_integers(polygons: &[Polygon]) -> Expected {
        let mut expected = Expected::unlinked();
        let distinct = |p: &Polygon| p.iter().collect::<BTreeSet<_>>().len();
        expected.degenerate = (0..polygons.len())
            .filter(|&i| distinct(&polygons[i]) < 3)
            .collect();
        for j in 0..polygons.len() {
            for i in 0..j {
                if [i, j].iter().any(|k| expected.degenerate.contains(k)) {
                    continue;
                }
                let answer = match oracle::linking_number(&polygons[i], &polygons[j]) {
                    Some(0) => continue,
                    Some(lambda) => Answer::Number(lambda),
                    None => Answer::Contact,
                };
                expected.answers.insert((i, j), answer);
            }
        }
        expected
    }

    /// Returns the answer for a pair that is not degenerate.
    pub fn of(&self, i: usize, j: usize) -> Answer {
        let answer = self.answers.get(&(i, j));
        answer.copied().unwrap_or(Answer::Number(0))
    }
}

impl Answer {
    fn reversed(self) -> Answer {
        match self {
            Answer::Number(lambda) => Answer::Number(-lambda),
            Answer::Near(lambda) => Answer::Near(-lambda),
            other => other,
        }
    }
}

impl Case {
    /// Creates a case of closed curves of any basis, in double precision.
    pub fn new(name: impl Into<String>, basis: Basis, loops: &[Loop], expected: Expected) -> Case {
        Case {
            name: name.into(),
            curves: curve_set(basis, Precision::F64, loops),
            expected,
        }
    }

    /// Creates a case of polylines whose answer follows from their construction.
    pub fn built(name: impl Into<String>, loops: &[Loop], expected: Expected) -> Case {
        Case::new(name, Basis::Polyline, loops, expected)
    }

    /// Creates a case of integer polygons with the oracle's answer.
    pub fn integers(name: impl Into<String>, polygons: &[Polygon]) -> Case {
        Case::mapped(name, polygons, |p| p.map(|x| x as f64))
    }

    /// Creates a case of integer polygons with the oracle's answer, transformed by `map`, which
    /// must keep linking numbers: a linear map of positive determinant that is exact in floating
    /// point, or for polygons along the axes, any strictly increasing function of each coordinate.
    pub fn mapped(
        name: impl Into<String>,
        polygons: &[Polygon],
        map: impl Fn([i64; 3]) -> Point,
    ) -> Case {
        let loops: Vec<Loop> = polygons
            .iter()
            .map(|p| p.iter().map(|&v| map(v)).collect())
            .collect();
        Case::built(name, &loops, Expected::of_integers(polygons))
    }

    /// Returns the control points of every curve.
    pub fn loops(&self) -> Vec<Loop> {
        let set = &self.curves;
        (0..set.len())
            .map(|i| (0..set.curve(i).points as usize).map(move |k| set.point(i, k)))
            .map(Iterator::collect)
            .collect()
    }

    /// Returns true if single precision represents every coordinate.
    fn is_single(&self) -> bool {
        let mut coordinates = self.loops().into_iter().flatten().flatten();
        coordinates.all(|x| f64::from(x as f32) == x)
    }

    /// Returns the case in both precisions, or only in double precision if single precision changes
    /// it.
    pub fn precisions(&self) -> Vec<Case> {
        let loops = self.loops();
        let singles = self.is_single().then_some(Precision::F32);
        let precisions = [Precision::F64].into_iter().chain(singles);
        precisions
            .map(|precision| Case {
                name: format!("{} ({precision:?})", self.name),
                curves: curve_set(self.curves.basis(), precision, &loops),
                expected: self.expected.clone(),
            })
            .collect()
    }

    /// Returns the case and other views of it: the properties 1 to 3 of `src/kernels/mod.rs`.
    pub fn variants(&self) -> Vec<Case> {
        let mut variants = vec![self.clone(), self.in_reversed_order()];
        variants.push(self.reversed(|_| true));
        variants.push(self.reversed(|i| i % 2 == 0));
        variants.push(self.shifted(|_| 1));
        variants.push(self.shifted(|n| n / 2));
        variants
    }

    fn with(&self, what: &str, loops: &[Loop], expected: Expected) -> Case {
        Case {
            name: format!("{}, {what}", self.name),
            curves: curve_set(self.curves.basis(), self.curves.precision(), loops),
            expected,
        }
    }

    fn in_reversed_order(&self) -> Case {
        let mut loops = self.loops();
        loops.reverse();
        let last = loops.len() - 1;
        let Expected {
            answers,
            degenerate,
        } = &self.expected;
        let expected = Expected {
            answers: answers
                .iter()
                .map(|(&(i, j), &a)| ((last - j, last - i), a))
                .collect(),
            degenerate: degenerate.iter().map(|&i| last - i).collect(),
        };
        self.with("last curve first", &loops, expected)
    }

    fn reversed(&self, which: impl Fn(usize) -> bool) -> Case {
        let mut loops = self.loops();
        for (i, points) in loops.iter_mut().enumerate() {
            if which(i) {
                // The first point stays, because Bezier curves start at a joint.
                points[1..].reverse();
            }
        }
        let mut expected = self.expected.clone();
        for (&(i, j), answer) in &mut expected.answers {
            if which(i) != which(j) {
                *answer = answer.reversed();
            }
        }
        self.with("reversed", &loops, expected)
    }

    /// Curves start this number of segments later.
    fn shifted(&self, by: impl Fn(usize) -> usize) -> Case {
        let mut loops = self.loops();
        let stride = match self.curves.basis() {
            Basis::Bezier => 3,
            _ => 1,
        };
        for points in &mut loops {
            let shift = stride * by(points.len() / stride) % points.len();
            points.rotate_left(shift);
        }
        self.with("shifted", &loops, self.expected.clone())
    }

    /// Returns the coordinates as integers, if a power of two scales them to integers in the range
    /// of the oracle.
    pub fn as_integers(&self) -> Option<Vec<Polygon>> {
        let loops = self.loops();
        let top = loops
            .iter()
            .flatten()
            .flatten()
            .fold(0.0, |m: f64, x| m.max(x.abs()));
        if !self.curves.basis().is_polyline() || !(1e-290..1e290).contains(&top) {
            return None;
        }
        let scale = (39.0 - top.log2().floor()).exp2();
        let integer = |x: f64| {
            Some(x * scale)
                .filter(|y| y.fract() == 0.0)
                .map(|y| y as i64)
        };
        let point = |&[x, y, z]: &Point| Some([integer(x)?, integer(y)?, integer(z)?]);
        let polygon = |l: &Loop| l.iter().map(point).collect();
        loops.iter().map(polygon).collect()
    }
}

fn curve_set(basis: Basis, precision: Precision, loops: &[Loop]) -> CurveSet {
    let counts: Vec<i32> = loops.iter().map(|l| -(l.len() as i32)).collect();
    let xyz: Vec<f64> = loops.iter().flatten().flatten().copied().collect();
    let set = match precision {
        Precision::F64 => CurveSet::from_counts(basis, &counts, Positions::F64(&xyz)),
        Precision::F32 => {
            let xyz: Vec<f32> = xyz.iter().map(|&x| x as f32).collect();
            CurveSet::from_counts(basis, &counts, Positions::F32(&xyz))
        }
    };
    set.expect("a case is a valid set of curves")
}

impl Random {
    /// Returns a point of the grid of `n^3`.
    pub fn grid(&mut self, n: i64) -> [i64; 3] {
        [(); 3].map(|()| self.below(n))
    }

    /// Returns a polygon on the grid of `size^3`.
    pub fn polygon(&mut self, vertices: usize, size: i64) -> Polygon {
        (0..vertices).map(|_| self.grid(size)).collect()
    }

    /// Returns a closed polygon along the axes, on the grid of `size^3`.
    pub fn along_axes(&mut self, corners: usize, size: i64) -> Polygon {
        let first = self.grid(size);
        let mut at = first;
        let mut out = vec![at];
        for _ in 0..corners {
            at[self.below(3usize)] = self.below(size);
            out.push(at);
        }
        for x in 0..2 {
            at[x] = first[x];
            out.push(at);
        }
        out
    }
}
