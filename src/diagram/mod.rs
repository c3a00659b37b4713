//! Planar diagrams of closed curves, and invariants that linking numbers of pairs do not see.

mod codes;
mod determinant;
mod groups;
mod higher;
mod milnor;
mod moves;
mod names;
mod project;
mod smoothing;
mod vassiliev;
mod words;

pub use groups::diagrams;
pub use higher::InvariantKind;
pub(crate) use higher::{HigherInvariants, UNCOMPUTED};
pub use names::KnotName;
pub(crate) use smoothing::change_of_v2;

use self::project::Crossings;
use crate::curve::CurveSet;
use crate::discretize::{homotopic_polylines, isotopic_polylines};
use crate::verdict::Defect;
use std::borrow::Cow;
use std::collections::BTreeMap;

/// The planar diagram of some closed polylines: their crossings in a projection, in their order
/// along each curve.
///
/// Every crossing, its order and its upper strand are decided exactly on the input floats, in a
/// direction without ties. So the diagram is that of the link, not of one nearby. Diagrams of one
/// link differ by Reidemeister moves.
///
/// ```
/// use linkwatch::{Basis, CurveSet, Diagram, Positions};
///
/// // A trefoil of 60 points on a torus.
/// let points: Vec<f64> = (0..60)
///     .flat_map(|k| {
///         let t = f64::from(k) * std::f64::consts::TAU / 60.0;
///         let r = 2.0 + (3.0 * t).cos();
///         [r * (2.0 * t).cos(), r * (2.0 * t).sin(), (3.0 * t).sin()]
///     })
///     .collect();
/// let set = CurveSet::from_counts(Basis::Polyline, &[-60], Positions::F64(&points))?;
/// let diagram = Diagram::of(&set, &[0]).expect("the curve does not touch itself").reduced();
/// let invariants = &diagram.invariants()[0];
/// assert_eq!((invariants.v2, invariants.determinant.as_deref()), (1, Some("3")));
/// assert!(invariants.name.as_ref().is_some_and(|name| name.symbol == "3_1"));
/// println!("{}", diagram.pd_text()); // PD[X[1, 5, 2, 4], ..]
/// # Ok::<(), linkwatch::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
#[must_use]
pub struct Diagram {
    /// Curves of the components.
    curves: Vec<u32>,
    /// Passages of each component: twice the index of the crossing, plus 1 if it is above.
    components: Vec<Vec<u32>>,
    /// Signs of the crossings: 1 if the upper strand turns counterclockwise to the lower one.
    signs: Vec<i8>,
    /// Numbers of Reidemeister moves I and II that reduced it.
    moves: [u64; 2],
}

/// Invariants of one curve as a knot, without regard to the other curves. They are exact.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
#[non_exhaustive]
pub struct Invariants {
    /// The curve, from 0.
    pub curve: u32,
    /// Number of crossings of the curve with itself, after Reidemeister moves I and II.
    pub crossings: usize,
    /// Second Vassiliev invariant: the coefficient of `z^2` in the Conway polynomial.
    pub v2: i64,
    /// Third Vassiliev invariant, 1 for the right-handed trefoil and -1 for the left-handed one:
    /// `-V'''(1) / 36 - V''(1) / 12` with the Jones polynomial `V`. `None`: not computed, because
    /// there are more crossings than [`Diagram::MOST_FOR_V3`].
    pub v3: Option<i64>,
    /// The determinant `|Delta(-1)|`, in decimal digits. `None`: not computed, because there are
    /// more crossings than [`Diagram::MOST_FOR_DETERMINANT`].
    pub determinant: Option<String>,
    /// The simplest knot with these invariants, if it has at most 5 crossings.
    pub name: Option<KnotName>,
}

/// Milnor's triple linking number of three curves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub struct TripleLink {
    /// The curves, sorted. The number changes its sign if two of them are exchanged.
    pub curves: [u32; 3],
    /// The number: from 0 to `modulus - 1`, or any integer if `modulus` is 0.
    pub mu: i64,
    /// Greatest common divisor of the linking numbers of the three pairs. `mu` is defined modulo
    /// this number.
    pub modulus: i64,
}

impl Diagram {
    /// Largest number of crossings of a curve for which [`Invariants::v3`] is computed: its cost
    /// grows with their square.
    pub const MOST_FOR_V3: usize = 20_000;

    /// Largest number of crossings for which determinants are computed. That takes about a minute
    /// for a dense diagram of so many.
    pub const MOST_FOR_DETERMINANT: usize = 20_000;

    /// Projects closed curves. `curves` are indices of different curves of the set. The direction
    /// of the projection depends on the curves alone. Splines are replaced by polylines that are
    /// isotopic to them.
    ///
    /// Cost: one predicate per pair of edges with overlapping boxes in the projection, which a
    /// sweep finds.
    ///
    /// # Errors
    ///
    /// The [`Defect`] of the first two segments that share a point, or of a curve with fewer than
    /// three distinct vertices. Repeated vertices in a row are merged. Splines may be too close to
    /// be replaced.
    ///
    /// # Panics
    ///
    /// If there are no curves, or one of them is open.
    pub fn of(set: &CurveSet, curves: &[u32]) -> Result<Diagram, Defect> {
        assert!(!curves.is_empty(), "a diagram has at least one curve");
        let closed = curves.iter().all(|&i| set.curve(i as usize).closed);
        assert!(closed, "a diagram is one of closed curves");
        let code = match set.basis().is_polyline() {
            true => project::project(set, curves, Crossings::All)?,
            false => of_splines(&set.subset(curves), curves)?,
        };
        Ok(Diagram::new(curves, code))
    }

    fn new(curves: &[u32], (components, signs): project::GaussCode) -> Diagram {
        let diagram = Diagram {
            curves: curves.to_vec(),
            components,
            signs,
            moves: [0, 0],
        };
        diagram.renumbered()
    }

    /// Returns the curves of the components.
    pub fn curves(&self) -> &[u32] {
        &self.curves
    }

    /// Returns the number of crossings.
    pub fn crossings(&self) -> usize {
        self.signs.len()
    }

    /// Returns the signs of the crossings: 1 if the upper strand turns counterclockwise to the
    /// lower one (right-handed), or -1.
    pub fn signs(&self) -> &[i8] {
        &self.signs
    }

    /// Returns the numbers of Reidemeister moves I and II that reduced the diagram.
    pub fn moves(&self) -> [u64; 2] {
        self.moves
    }

    /// Returns the diagram after all possible Reidemeister moves I and II that remove crossings.
    /// Moves III are not tried, so it may have more crossings than necessary.
    pub fn reduced(mut self) -> Diagram {
        let [one, two] = moves::reduce(&mut self.components, &self.signs);
        self.moves = [self.moves[0] + one, self.moves[1] + two];
        self.renumbered()
    }

    /// Returns the diagram of some components, given by their positions, without the crossings with
    /// others.
    pub fn of_components(&self, positions: &[u32]) -> Diagram {
        let mut passed = vec![0; self.signs.len()];
        for &k in positions {
            for &passage in &self.components[k as usize] {
                passed[passage as usize / 2] += 1;
            }
        }
        let kept = |k: &u32| {
            let passages = self.components[*k as usize].iter().copied();
            passages.filter(|&p| passed[p as usize / 2] == 2).collect()
        };
        let diagram = Diagram {
            curves: positions.iter().map(|&k| self.curves[k as usize]).collect(),
            components: positions.iter().map(kept).collect(),
            signs: self.signs.clone(),
            moves: [0, 0],
        };
        diagram.renumbered()
    }

    /// Returns the connected parts: components without a chain of crossings between them are
    /// splittable, they can be pulled apart.
    pub fn parts(&self) -> Vec<Diagram> {
        let parts = self.connected_components();
        let parts = parts.iter().map(|part| self.of_components(part));
        parts.collect()
    }

    /// Returns the invariants of each component.
    pub fn invariants(&self) -> Vec<Invariants> {
        let knot = |k| self.of_components(&[k]).reduced().as_knot();
        (0..self.curves.len() as u32).map(knot).collect()
    }

    /// Returns the determinant of the link, `|Delta(-1)|`, in decimal digits. It is 0 if the link
    /// is splittable. `None` if there are more crossings than [`Diagram::MOST_FOR_DETERMINANT`].
    pub fn link_determinant(&self) -> Option<String> {
        let few = self.crossings() <= Self::MOST_FOR_DETERMINANT;
        few.then(|| self.determinant().to_string())
    }

    /// Returns the nonzero linking numbers of two components, with the sign of a
    /// [`Certificate`](crate::Certificate).
    pub fn links(&self) -> Vec<crate::Link> {
        let sums = self.pair_sums();
        let links = sums.iter().filter(|(_, sum)| **sum != 0);
        let links = links.map(|(&(a, b), sum)| {
            let (i, j) = (self.curves[a as usize], self.curves[b as usize]);
            let (i, j, lambda) = (i.min(j), i.max(j), sum / 2);
            crate::Link { i, j, lambda }
        });
        links.collect()
    }

    /// Returns the triple linking numbers that are not 0, sorted. Triples with a linking number of
    /// 1 or -1 have no other.
    pub fn triples(&self) -> Vec<TripleLink> {
        let sums = self.pair_sums();
        let mut neighbours = vec![Vec::new(); self.curves.len()];
        for &(a, b) in sums.keys() {
            neighbours[a as usize].push(b);
            neighbours[b as usize].push(a);
        }
        // Each term of the formula has crossings of two pairs: three curves in a row.
        let mut found = BTreeMap::new();
        let below = self.all_below();
        for (middle, others) in (0_u32..).zip(&neighbours) {
            for (k, &a) in others.iter().enumerate() {
                for &b in &others[k + 1..] {
                    let mut triple = [middle, a, b];
                    triple.sort_by_key(|&k| self.curves[k as usize]);
                    let curves = triple.map(|k| self.curves[k as usize]);
                    let [a, b, c] = triple;
                    let pairs = [(a, b), (a, c), (b, c)].map(|(a, b)| (a.min(b), a.max(b)));
                    let links = pairs.iter().filter_map(|pair| sums.get(pair));
                    let modulus = links.fold(0, |n, sum| greatest_common_divisor(n, sum / 2));
                    // Modulo 1 there is nothing to compute.
                    if modulus != 1 && !found.contains_key(&curves) {
                        found.insert(curves, (milnor::triple(&below, triple), modulus));
                    }
                }
            }
        }
        let found = found.into_iter().map(|(curves, (mu, modulus))| {
            // Any integer if the modulus is 0.
            let mu = mu.checked_rem_euclid(modulus).unwrap_or(mu);
            TripleLink {
                curves,
                mu,
                modulus,
            }
        });
        found.filter(|triple| triple.mu != 0).collect()
    }

    /// Returns the component and the position of each passage.
    fn positions(&self) -> Vec<(u32, u32)> {
        let mut positions = vec![(0, 0); 2 * self.signs.len()];
        for (component, passages) in (0..).zip(&self.components) {
            for (at, &passage) in (0..).zip(passages) {
                positions[passage as usize] = (component, at);
            }
        }
        positions
    }

    /// Returns the sum of the signs of the crossings of each pair of components that has any: twice
    /// its linking number.
    fn pair_sums(&self) -> BTreeMap<(u32, u32), i64> {
        let positions = self.positions();
        let mut sums = BTreeMap::new();
        for (crossing, sign) in self.signs.iter().enumerate() {
            let [a, b] = [0, 1].map(|side| positions[2 * crossing + side].0);
            if a != b {
                *sums.entry((a.min(b), a.max(b))).or_default() += i64::from(*sign);
            }
        }
        sums
    }

    /// Returns `v2` of a diagram of one component.
    fn v2(&self) -> i64 {
        vassiliev::v2(&self.components[0], &self.signs)
    }

    /// Returns the invariants of a diagram of one component.
    fn as_knot(&self) -> Invariants {
        let v2 = self.v2();
        let v3 = self.crossings() <= Self::MOST_FOR_V3;
        let v3 = v3.then(|| vassiliev::v3(&self.components[0], &self.signs));
        let determinant = self.link_determinant();
        Invariants {
            curve: self.curves[0],
            crossings: self.crossings(),
            v2,
            v3,
            name: KnotName::new(v2, v3, determinant.as_deref(), self.crossings()),
            determinant,
        }
    }

    /// Returns the positions of the components of each connected part, sorted.
    fn connected_components(&self) -> Vec<Vec<u32>> {
        let positions = self.positions();
        let crossings = positions.as_chunks::<2>().0.iter();
        let edges = crossings.map(|[under, over]| (under.0, over.0));
        groups::connected(self.curves.len(), edges)
    }

    /// Numbers the crossings that are there in the order in which they are first met.
    fn renumbered(mut self) -> Diagram {
        let mut numbers = vec![u32::MAX; self.signs.len()];
        let mut signs = Vec::with_capacity(numbers.len());
        for passage in self.components.iter_mut().flatten() {
            let old = *passage as usize / 2;
            if numbers[old] == u32::MAX {
                numbers[old] = signs.len() as u32;
                signs.push(self.signs[old]);
            }
            *passage = 2 * numbers[old] + *passage % 2;
        }
        self.signs = signs;
        self
    }
}

/// Polylines for diagrams without the crossings of a curve with itself. Linking numbers and triple
/// linking numbers do not need these: neither changes if a curve passes through itself (Milnor
/// 1954, *Link groups*).
struct LinkHomotopic<'a> {
    /// Polylines that are link homotopic to the curves.
    polylines: Cow<'a, CurveSet>,
    /// Pairs of splines that are too close for that.
    too_close: Vec<Defect>,
}

impl<'a> LinkHomotopic<'a> {
    fn new(set: &'a CurveSet) -> LinkHomotopic<'a> {
        if set.basis().is_polyline() {
            return LinkHomotopic {
                polylines: Cow::Borrowed(set),
                too_close: Vec::new(),
            };
        }
        let made = homotopic_polylines(set).expect("fewer points than u32 can count");
        LinkHomotopic {
            polylines: Cow::Owned(made.curves),
            too_close: made.too_close,
        }
    }

    /// Returns the diagram of some curves without the crossings of a curve with itself.
    ///
    /// # Errors
    ///
    /// The [`Defect`] of two segments of different curves that share a point, of two splines that
    /// are too close, or of a curve with fewer than three distinct vertices.
    fn diagram(&self, curves: &[u32]) -> Result<Diagram, Defect> {
        let has = |i: u32| curves.contains(&i);
        let mut too_close = self.too_close.iter();
        if let Some(defect) = too_close.find(|d| has(d.i) && d.j.is_some_and(has)) {
            return Err(*defect);
        }
        let code = project::project(&self.polylines, curves, Crossings::OfDifferentCurves)?;
        Ok(Diagram::new(curves, code))
    }
}

/// Projects splines by polylines that are isotopic to them. `names` has the curves of the set in
/// the input.
fn of_splines(set: &CurveSet, names: &[u32]) -> Result<project::GaussCode, Defect> {
    let curves: Vec<u32> = (0..set.len() as u32).collect();
    let found = isotopic_polylines(set).and_then(|(polylines, segments)| {
        project::project(&polylines, &curves, Crossings::All).map_err(|mut defect| {
            let of = [defect.i, defect.j.unwrap_or(defect.i)];
            for (edge, curve) in defect.place.segments.iter_mut().zip(of) {
                *edge = segments[curve as usize][*edge as usize];
            }
            defect
        })
    });
    found.map_err(|defect| {
        let name = |i: u32| names[i as usize];
        let (i, j) = (name(defect.i), defect.j.map(name));
        let mut named = Defect { i, j, ..defect };
        if let Some(j) = j.filter(|j| *j < i) {
            (named.i, named.j) = (j, Some(i));
            named.place.segments.reverse();
        }
        named
    })
}

fn greatest_common_divisor(a: i64, b: i64) -> i64 {
    match b {
        0 => a.abs(),
        b => greatest_common_divisor(b, a % b),
    }
}

#[cfg(test)]
mod tests;
