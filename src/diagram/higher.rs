//! Invariants of the curves of a frame beyond the linking numbers of pairs: of knots, and of
//! triples of curves. They are part of a certificate, and are compared as linking numbers are.

use super::groups::{closed_curves, near_groups};
use super::{Diagram, LinkHomotopic};
use crate::curve::CurveSet;
use crate::pairs::Pair;
use crate::verdict::{Defect, InvariantChange};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};

vocabulary! {
    /// Invariants beyond the linking numbers of pairs.
    pub enum InvariantKind {
        /// `v2`, `v3` and the determinant of each closed curve ([`Invariants`](crate::Invariants)).
        Curve = "self",
        /// Triple linking numbers ([`TripleLink`](crate::TripleLink)).
        Triple = "triple",
    }
}

impl InvariantKind {
    /// Returns the numbers of unknots, or of curves that are not linked.
    fn trivial(self) -> HigherNumbers {
        let numbers: &[&str] = match self {
            InvariantKind::Curve => &["0", "0", "1"],
            InvariantKind::Triple => &["0", "0"],
        };
        numbers.iter().map(|&n| n.to_owned()).collect()
    }
}

/// Numbers in decimal digits: `v2`, `v3` and the determinant, or `mu` and its modulus, or
/// [`UNCOMPUTED`].
pub(crate) type HigherNumbers = Vec<String>;

/// Placeholder for a number that was not computed, because there are too many crossings.
pub(crate) const UNCOMPUTED: &str = "-";

/// Invariants of one kind of a frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct HigherInvariants {
    pub kind: InvariantKind,
    /// One curve or three, sorted, and their numbers, if they are not trivial.
    pub numbers: Vec<(Vec<u32>, HigherNumbers)>,
    /// Curves whose numbers are not known, because they touch a curve or are too close to one. For
    /// triples, only contacts with other curves count.
    pub unknown: BTreeSet<u32>,
}

impl HigherInvariants {
    /// Computes the invariants of all closed curves. Returns them, and the reasons why curves have
    /// none.
    pub fn of(set: &CurveSet, kind: InvariantKind) -> (HigherInvariants, Vec<Defect>) {
        let closed = closed_curves(set);
        let mut defects = Vec::new();
        let mut out = HigherInvariants {
            kind,
            numbers: Vec::new(),
            unknown: BTreeSet::new(),
        };
        match kind {
            InvariantKind::Curve => {
                let numbers = |&i: &u32| {
                    let knot = Diagram::of(set, &[i])?.reduced().invariants().remove(0);
                    let unknown = || UNCOMPUTED.to_owned();
                    let v3 = knot.v3.map_or_else(unknown, |v3| v3.to_string());
                    let determinant = knot.determinant.unwrap_or_else(unknown);
                    Ok((vec![i], vec![knot.v2.to_string(), v3, determinant]))
                };
                for found in closed.par_iter().map(numbers).collect::<Vec<_>>() {
                    match found {
                        Ok(numbers) => out.numbers.push(numbers),
                        Err(defect) => defects.push(defect),
                    }
                }
                out.unknown
                    .extend(defects.iter().map(|defect: &Defect| defect.i));
            }
            InvariantKind::Triple => {
                let polylines = LinkHomotopic::new(set);
                let groups = near_groups(set, &closed).into_par_iter();
                let found: Vec<_> = groups.map(|group| triples(&polylines, group)).collect();
                for (triples, of_group) in found {
                    out.numbers.extend(triples);
                    defects.extend(of_group);
                }
                out.numbers.sort();
                let curves = |defect: &Defect| [Some(defect.i), defect.j].into_iter().flatten();
                out.unknown.extend(defects.iter().flat_map(curves));
            }
        }
        out.numbers
            .retain(|(_, numbers)| *numbers != kind.trivial());
        (out, defects)
    }

    /// Returns the number of curves or triples with a number that was not computed.
    pub fn uncomputed(&self) -> usize {
        let numbers = self.numbers.iter();
        let not = |(_, numbers): &&(_, HigherNumbers)| numbers.iter().any(|n| n == UNCOMPUTED);
        numbers.filter(not).count()
    }

    /// Compares these invariants with the expected ones. Invariants that were unknown become the
    /// expected ones. `changed` has the pairs whose linking numbers changed; their triples are not
    /// compared. Also returns the number of curves or triples that could not be compared, if no
    /// defect of this frame is the reason.
    pub fn compare(
        &self,
        expected: &mut HigherInvariants,
        changed: &[Pair],
    ) -> (Vec<InvariantChange>, usize) {
        let mut changes = Vec::new();
        let mut skipped = 0;
        let tables = [&expected.numbers, &self.numbers].map(|numbers| {
            let numbers = numbers.iter().map(|(curves, numbers)| (curves, numbers));
            numbers.collect::<BTreeMap<&Vec<u32>, &HigherNumbers>>()
        });
        let all = tables.iter().flat_map(|table| table.keys().copied());
        let all: BTreeSet<&Vec<u32>> = all.collect();
        let trivial = self.kind.trivial();
        for curves in all {
            let has = |unknown: &BTreeSet<u32>| curves.iter().any(|i| unknown.contains(i));
            let is_changed = |(i, j): &Pair| curves.contains(i) && curves.contains(j);
            if has(&self.unknown) || has(&expected.unknown) || changed.iter().any(is_changed) {
                continue;
            }
            let numbers = |k: usize| *tables[k].get(curves).unwrap_or(&&trivial);
            let [before, now] = [0, 1].map(numbers);
            let known = |n: &&String| *n != UNCOMPUTED;
            skipped += usize::from(!before.iter().chain(now).all(|n| known(&n)));
            let differ = |(a, b): (&String, &String)| a != b && known(&a) && known(&b);
            if before.iter().zip(now).any(differ) {
                changes.push(InvariantChange {
                    curves: curves.clone(),
                    expected: self.words(before),
                    found: self.words(now),
                });
            }
        }
        let is_known = |i: &u32| !self.unknown.contains(i);
        let fresh: BTreeSet<u32> = expected.unknown.iter().copied().filter(is_known).collect();
        skipped += fresh.len();
        if !fresh.is_empty() {
            expected.unknown.retain(|i| !fresh.contains(i));
            let is_fresh = |curves: &[u32]| curves.iter().any(|i| fresh.contains(i));
            let adopted = self.numbers.iter().filter(|(curves, _)| is_fresh(curves));
            expected.numbers.extend(adopted.cloned());
            expected.numbers.sort();
            expected.numbers.dedup_by(|a, b| a.0 == b.0);
        }
        (changes, skipped)
    }

    fn words(&self, numbers: &[String]) -> String {
        match (self.kind, numbers) {
            (InvariantKind::Curve, [v2, v3, determinant]) => {
                format!("v2 {v2}, v3 {v3}, determinant {determinant}")
            }
            (_, [mu, modulus, ..]) if modulus != "0" => format!("mu {mu} mod {modulus}"),
            (_, numbers) => format!("mu {}", numbers[0]),
        }
    }

    /// Returns these invariants for other curves. `origins` has the index of each one in this
    /// frame, or `None` for a new curve, whose invariants are unknown. If the order of the curves
    /// differs, triples are unknown as well.
    pub fn with_curves(&self, origins: &[Option<u32>]) -> HigherInvariants {
        let mut index = BTreeMap::new();
        let mut unknown = BTreeSet::new();
        for (i, origin) in (0..).zip(origins) {
            match origin {
                Some(origin) if !self.unknown.contains(origin) => drop(index.insert(*origin, i)),
                _ => drop(unknown.insert(i)),
            }
        }
        if self.kind == InvariantKind::Triple && !index.values().is_sorted() {
            unknown.extend(index.into_values());
            index = BTreeMap::new();
        }
        let numbers = self.numbers.iter().filter_map(|(curves, numbers)| {
            let curves = curves.iter().map(|i| index.get(i).copied());
            Some((curves.collect::<Option<Vec<u32>>>()?, numbers.clone()))
        });
        let mut numbers: Vec<_> = numbers.collect();
        numbers.sort();
        HigherInvariants {
            kind: self.kind,
            numbers,
            unknown,
        }
    }
}

/// Returns the triple linking numbers of a group of curves, without curves that touch another one,
/// and the defects of these curves.
fn triples(
    polylines: &LinkHomotopic,
    mut group: Vec<u32>,
) -> (Vec<(Vec<u32>, HigherNumbers)>, Vec<Defect>) {
    let mut defects = Vec::new();
    while group.len() > 2 {
        match polylines.diagram(&group) {
            Ok(diagram) => {
                let found = diagram.reduced().triples().into_iter();
                let numbers = found.map(|t| {
                    let numbers = vec![t.mu.to_string(), t.modulus.to_string()];
                    (t.curves.to_vec(), numbers)
                });
                return (numbers.collect(), defects);
            }
            Err(defect) => {
                group.retain(|i| *i != defect.i && Some(*i) != defect.j);
                defects.push(defect);
            }
        }
    }
    (Vec::new(), defects)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_that_are_not_known_are_not_compared_and_counted() {
        let of = |numbers: [&str; 3]| HigherInvariants {
            kind: InvariantKind::Curve,
            numbers: vec![(vec![2], numbers.map(str::to_owned).into())],
            unknown: BTreeSet::new(),
        };
        let compare = |mut expected: HigherInvariants, found: HigherInvariants| {
            let (changes, skipped) = found.compare(&mut expected, &[]);
            (changes.len(), skipped)
        };
        let knot = || of(["1", "1", "3"]);
        assert_eq!(compare(knot(), knot()), (0, 0));
        assert_eq!(compare(knot(), of(["1", "-1", "3"])), (1, 0));
        assert_eq!(compare(knot(), of(["1", UNCOMPUTED, "3"])), (0, 1));
        assert_eq!(compare(of(["1", UNCOMPUTED, "3"]), knot()), (0, 1));
        assert_eq!(compare(knot(), of(["2", UNCOMPUTED, "3"])), (1, 1));
        assert_eq!(of(["1", UNCOMPUTED, "3"]).uncomputed(), 1);
        // A curve that touched itself has known invariants for the first time.
        let mut touched = knot();
        touched.unknown.insert(5);
        assert_eq!(compare(touched, knot()), (0, 1));
    }
}
