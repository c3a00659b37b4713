//! Joins bonds to curves, and puts the atoms of a frame in the order of the curves.
//!
//! Cost: sorting the bonds, once per file; a search per atom and frame, which is a single look-up
//! if the ids have no gaps.

use super::cell::Unwrapped;
use super::dump;
use crate::curve::{Basis, Cell, CurveSet, Positions, count_of};
use crate::error::{Error, Result};
use crate::formats::chains::{Chains, Edge};
use crate::periodic::{Torn, find_torn};
use crate::verdict::LeftOut;
use std::collections::BTreeMap;

/// Marks an atom that belongs to no curve.
const NONE: u32 = u32::MAX;

/// The curves that bonds define.
#[derive(Debug)]
pub(super) struct Curves {
    format: &'static str,
    /// Ids of the atoms with bonds, ascending.
    ids: Vec<u64>,
    /// Place of each of these atoms among the points of all curves.
    places: Vec<u32>,
    /// Points of each curve, negative if it is closed.
    pub counts: Vec<i32>,
    points: usize,
    /// Molecules that are no curves.
    pub left_out: Vec<LeftOut>,
}

/// Returns the index of an id.
fn find(ids: &[u64], id: u64) -> Option<usize> {
    // Ids without gaps need no search.
    let guess = id.checked_sub(*ids.first()?)?;
    match ids.get(usize::try_from(guess).ok()?) {
        Some(&found) if found == id => Some(guess as usize),
        _ => ids.binary_search(&id).ok(),
    }
}

/// Returns the first atom of the molecule of each atom.
fn molecules(edges: &[[u32; 2]], atoms: usize) -> Vec<u32> {
    let mut before: Vec<u32> = (0..atoms as u32).collect();
    let first = |before: &mut [u32], mut atom: u32| {
        while before[atom as usize] != atom {
            // Halves the way for later searches.
            before[atom as usize] = before[before[atom as usize] as usize];
            atom = before[atom as usize];
        }
        atom
    };
    for edge in edges {
        let [a, b] = edge.map(|atom| first(&mut before, atom));
        before[a.max(b) as usize] = a.min(b);
    }
    let all = 0..atoms as u32;
    all.map(|atom| first(&mut before, atom)).collect()
}

/// Fails if there are more atoms than indices.
fn check_number(what: &'static str, found: usize) -> Result<()> {
    let checked = u32::try_from(found).map_err(|_| Error::count(what, found, u32::MAX));
    checked.map(|_| ())
}

impl Curves {
    /// Joins bonds.
    ///
    /// # Errors
    ///
    /// No molecule is a curve.
    pub fn of_bonds(bonds: Vec<[u64; 2]>, format: &'static str) -> Result<Curves> {
        let mut ids: Vec<u64> = bonds.as_flattened().to_vec();
        ids.sort_unstable();
        ids.dedup();
        check_number("atoms with bonds", ids.len())?;
        let index = |id| find(&ids, id).expect("an id of a bond") as u32;
        let mut edges: Vec<[u32; 2]> = bonds.iter().map(|bond| bond.map(index)).collect();
        drop(bonds);
        edges.iter_mut().for_each(|edge| edge.sort_unstable());
        edges.sort_unstable();
        // Two bonds of the same atoms are one edge of a curve.
        edges.dedup();
        let mut degrees = vec![0; ids.len()];
        for &atom in edges.as_flattened() {
            degrees[atom as usize] += 1;
        }
        let molecules = molecules(&edges, ids.len());
        // The first atom with branches of each molecule: the last one that is collected stays.
        let branching = (0..ids.len()).rev().filter(|&atom| degrees[atom] > 2);
        let branches: BTreeMap<u32, usize> = branching.map(|a| (molecules[a], a)).collect();
        let is_branched = |atom: u32| branches.contains_key(&molecules[atom as usize]);
        let branched_atoms = (0..ids.len() as u32).filter(|&a| is_branched(a)).count();
        let edges = edges.into_iter().filter(|edge| !is_branched(edge[0]));
        let edges: Vec<Edge> = edges.map(|ends| Edge { ends, line: 0 }).collect();
        let chains = Chains::new(&edges, ids.len()).expect("no molecule has branches");
        let mut places = vec![NONE; ids.len()];
        let (mut counts, mut points) = (Vec::new(), 0);
        for mut chain in chains.curves() {
            if !chain.closed && chain.vertices[0] > chain.vertices[chain.vertices.len() - 1] {
                chain.vertices.reverse();
            }
            for &atom in &chain.vertices {
                places[atom as usize] = points;
                points += 1;
            }
            counts.push(count_of(chain.vertices.len(), chain.closed)?);
        }
        if ids.is_empty() {
            let what = "no bonds, which define the curves";
            return Err(Error::unsupported(format, what));
        }
        let mut left_out = Vec::new();
        if let Some(&atom) = branches.values().next() {
            let (branched, bonds) = (branches.len(), degrees[atom]);
            let first = format!("atom {} has {bonds} bonds", ids[atom]);
            if counts.is_empty() {
                let what = format!(
                    "{branched} of {branched} molecules ({branched_atoms} atoms) have branches, so \
                     that they are no curves: {first}"
                );
                return Err(Error::unsupported(format, what));
            }
            let kind = ["molecule with branches", "molecules with branches"];
            left_out.push(LeftOut::new(branched as u64, kind, first));
        }
        Ok(Curves {
            format,
            ids,
            places,
            counts,
            points: points as usize,
            left_out,
        })
    }

    /// Returns the curves of atoms, given by molecule and id: the atoms of a molecule in the order
    /// of their ids. Molecule 0 and those of one atom are no curves.
    ///
    /// # Errors
    ///
    /// No molecule is a curve.
    pub fn of_molecules(mut members: Vec<(i64, u64)>, closed: bool) -> Result<Curves> {
        let format = dump::FORMAT;
        members.retain(|member| member.0 != 0);
        members.sort_unstable();
        members.dedup();
        check_number("atoms of molecules", members.len())?;
        let mut chains: Vec<&[(i64, u64)]> = members.chunk_by(|a, b| a.0 == b.0).collect();
        chains.retain(|chain| chain.len() > 1);
        chains.sort_unstable_by_key(|chain| chain[0].1);
        if chains.is_empty() {
            let what = "no molecule (column mol) of two or more atoms";
            return Err(Error::unsupported(format, what));
        }
        let counts = chains.iter().map(|chain| count_of(chain.len(), closed));
        let counts = counts.collect::<Result<_>>()?;
        let ids = chains.iter().flat_map(|chain| chain.iter().map(|m| m.1));
        let mut places: Vec<(u64, u32)> = ids.zip(0..).collect();
        places.sort_unstable();
        if let Some(pair) = places.windows(2).find(|pair| pair[0].0 == pair[1].0) {
            let what = format!("atom {} is in two molecules", pair[0].0);
            return Err(Error::format(format, "atoms", what));
        }
        let (ids, places): (Vec<_>, Vec<_>) = places.into_iter().unzip();
        Ok(Curves {
            format,
            points: ids.len(),
            ids,
            places,
            counts,
            left_out: Vec::new(),
        })
    }

    /// Reports how many of all atoms are ignored.
    pub fn report_others(&self, atoms: u64, name: &str) {
        let others = atoms.saturating_sub(self.points as u64);
        if others > 0 {
            tracing::info!("{name}: {others} of {atoms} atoms are not on curves, and ignored");
        }
    }

    /// Starts a frame.
    pub fn frame(&self) -> Frame<'_> {
        Frame {
            curves: self,
            xyz: vec![0.0; 3 * self.points],
            seen: vec![false; self.points],
        }
    }

    /// Returns the id of the atom at a place.
    fn id_at(&self, place: usize) -> u64 {
        let at = self.places.iter().position(|&p| p as usize == place);
        self.ids[at.expect("every place has an atom")]
    }
}

/// Atoms of a frame, in the order of the curves.
pub(super) struct Frame<'a> {
    curves: &'a Curves,
    xyz: Vec<f64>,
    seen: Vec<bool>,
}

impl Frame<'_> {
    /// Adds an atom. One that is on no curve is ignored.
    ///
    /// # Errors
    ///
    /// The atom is there already.
    pub fn put(&mut self, id: u64, at: [f64; 3]) -> Result<(), String> {
        let index = find(&self.curves.ids, id);
        let place = index.map_or(NONE, |k| self.curves.places[k]);
        if place == NONE {
            return Ok(());
        }
        let place = place as usize;
        if std::mem::replace(&mut self.seen[place], true) {
            return Err(format!("atom {id} is there twice"));
        }
        self.xyz[3 * place..3 * place + 3].copy_from_slice(&at);
        Ok(())
    }

    /// Returns the curves.
    ///
    /// # Errors
    ///
    /// An atom is missing, a coordinate is not finite, or a bond is torn by the boundary of
    /// a periodic cell (`None` if that is no matter).
    pub fn finish(self, cell: Option<&Cell>, unwrapped: Unwrapped) -> Result<CurveSet> {
        let curves = self.curves;
        if let Some(first) = self.seen.iter().position(|seen| !seen) {
            let missing = self.seen.iter().filter(|seen| !**seen).count();
            let what = format!(
                "{missing} of the {} atoms on curves are missing, atom {} for example",
                curves.points,
                curves.id_at(first),
            );
            return Err(Error::format(curves.format, "atoms", what));
        }
        let positions = Positions::F64(&self.xyz);
        let set = CurveSet::from_counts(Basis::Polyline, &curves.counts, positions)?;
        let found = cell.map_or(Ok(None), |cell| find_torn(&set, cell, 0..set.len()))?;
        if let Some(found) = found {
            let first = set.points_of(found.curve).start;
            let atoms = found.ends.map(|k| curves.id_at(first + k));
            let what = torn(atoms, &found, unwrapped);
            return Err(Error::unsupported(curves.format, what));
        }
        Ok(set)
    }
}

/// Returns the message for a bond that is too long for the periodic cell.
fn torn([p, q]: [u64; 2], found: &Torn, unwrapped: Unwrapped) -> String {
    let axis = ["x", "y", "z"][found.direction];
    let bond = format!(
        "the bond of atoms {p} and {q} is {:.3} of the periodic cell long in {axis}, which is more \
         than half",
        found.share
    );
    let through = "or the curve closes only through the boundary: pass the option `wrapped`, which \
                   follows each curve from atom to atom";
    match unwrapped {
        Unwrapped::Unknown => format!(
            "{bond}: the curve is wrapped at the boundary; write unwrapped coordinates (`dump .. \
             custom .. id xu yu zu`) or image flags (`id x y z ix iy iz`, or `write_data`), or \
             pass the option `wrapped`"
        ),
        Unwrapped::ByFlags => {
            format!("{bond}, in spite of image flags: they are inconsistent, {through}")
        }
        Unwrapped::Coordinates => format!(
            "{bond}, although the coordinates are unwrapped: the image flags of the simulation are \
             inconsistent, {through}"
        ),
    }
}
