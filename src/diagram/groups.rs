//! Diagrams of all curves of a frame, and of their connected groups.

use super::Diagram;
use crate::curve::CurveSet;
use crate::pairs::{LinkSearch, Trees};
use crate::verdict::Defect;
use rayon::prelude::*;

/// Returns the reduced diagrams of all closed curves, each by itself, then those of connected
/// groups of curves if `groups` is set, all sorted by their curves. Instead of a diagram, returns
/// the reason why there is none, a contact for example. Other diagrams are not affected.
///
/// A group is connected if its reduced diagram is. Curves that are in no group are splittable from
/// all others: they can be pulled away from them.
///
/// ```
/// use linkwatch::{diagrams, scenes::Scene};
///
/// let chainmail = "chainmail:rows=2,columns=2".parse::<Scene>()?.build()?;
/// let found = diagrams(&chainmail.curves, true);
/// let (curves, diagram) = found.last().expect("a group");
/// assert_eq!(curves.len(), chainmail.curves.len());
/// assert_eq!(diagram.as_ref().expect("no contact").links(), chainmail.certificate.links());
/// # Ok::<(), linkwatch::Error>(())
/// ```
pub fn diagrams(set: &CurveSet, groups: bool) -> Vec<(Vec<u32>, Result<Diagram, Defect>)> {
    let closed = closed_curves(set);
    let of = |curves: &[u32]| Diagram::of(set, curves).map(Diagram::reduced);
    let singles = closed.par_iter().map(|&i| (vec![i], of(&[i])));
    let mut found: Vec<(Vec<u32>, Result<Diagram, Defect>)> = singles.collect();
    if groups {
        let near = near_groups(set, &closed).into_par_iter();
        let parts = near.map(|group| match of(&group) {
            Err(defect) => vec![(group, Err(defect))],
            Ok(whole) => {
                let parts = whole.parts().into_iter();
                let parts = parts.filter(|part| part.curves.len() > 1);
                let named = parts.map(|part| (part.curves.clone(), Ok(part)));
                named.collect()
            }
        });
        let mut parts = parts.collect::<Vec<_>>().concat();
        parts.sort_by(|a, b| a.0.cmp(&b.0));
        found.extend(parts);
    }
    found
}

/// Returns the indices of the closed curves.
pub(super) fn closed_curves(set: &CurveSet) -> Vec<u32> {
    let curves = (0..).zip(set.curves());
    let closed = curves.filter(|(_, curve)| curve.closed);
    closed.map(|(i, _)| i).collect()
}

/// Returns the groups of several curves that chains of overlapping boxes connect.
pub(super) fn near_groups(set: &CurveSet, closed: &[u32]) -> Vec<Vec<u32>> {
    let subset = set.subset(closed);
    let mut trees = Trees::default();
    trees.refit(&subset);
    let mut search = LinkSearch::default();
    let near = search.find(trees.roots()).iter().copied();
    let mut groups = connected(closed.len(), near);
    groups.retain(|group| group.len() > 1);
    let names = groups.iter_mut().flatten();
    names.for_each(|i| *i = closed[*i as usize]);
    groups
}

/// Returns the connected components of a graph of `n` vertices, each sorted, by their first vertex.
pub(super) fn connected(n: usize, edges: impl Iterator<Item = (u32, u32)>) -> Vec<Vec<u32>> {
    let mut of: Vec<usize> = (0..n).collect();
    let mut members: Vec<Vec<u32>> = (0..n as u32).map(|i| vec![i]).collect();
    for (a, b) in edges {
        // The smaller component joins the larger one.
        let mut both = [a, b].map(|i| of[i as usize]);
        both.sort_by_key(|&k| members[k].len());
        let [from, to] = both;
        if from != to {
            let moved = std::mem::take(&mut members[from]);
            moved.iter().for_each(|&i| of[i as usize] = to);
            members[to].extend(moved);
        }
    }
    members.retain(|members| !members.is_empty());
    members.iter_mut().for_each(|part| part.sort_unstable());
    members.sort_unstable();
    members
}
