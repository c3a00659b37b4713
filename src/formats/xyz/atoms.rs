//! The atoms of a frame, and their curves.

use super::comment::{Columns, flag};
use super::{FORMAT, GROUPS, XyzFrames};
use crate::curve::{CurveSet, Point, count_of};
use crate::error::{Error, Result};
use crate::formats::lines::{integer, words};
use crate::formats::{divided, number};

struct Atom {
    at: Point,
    /// Number by which the atoms are sorted; 0 if there is none.
    id: i64,
    group: i64,
    closed: bool,
}

impl XyzFrames<'_> {
    /// Reads the atoms of a frame: the curves, and their numbers if a column has them. The inner
    /// result is that of this frame alone.
    ///
    /// # Errors
    ///
    /// The file ends, or does not say which atoms belong to one curve.
    pub fn atoms(&mut self, count: u64, columns: &Columns) -> Result<Result<(CurveSet, Vec<i64>)>> {
        let lines = &mut self.lines;
        if columns.group.is_none() && self.options.counts.is_none() {
            return Err(lines.bad(format_args!(
                "nothing says which atoms belong to one curve: write a column of integers \
             (`Properties=species:S:1:pos:R:3:molecule:I:1`; also {}), or give the numbers of \
             points of the curves, negative if closed (option `counts`)",
                GROUPS[1..].join(", ")
            )));
        }
        // Each column takes a character, and a space or line break after it.
        lines.check_room(count, 2 * columns.all as u64, "atoms")?;
        let mut atoms = Vec::with_capacity(count as usize);
        let mut read = Ok(());
        for k in 0..count {
            lines.expect(format_args!("{count} atoms, found {k}"))?;
            if read.is_ok() {
                let atom = columns.atom(&lines.line);
                let atom = atom.map_err(|what| lines.bad(format_args!("atom {k}: {what}")));
                read = atom.map(|atom| atoms.push(atom));
            }
        }
        Ok(read.and_then(|()| self.curves(atoms, columns)))
    }

    /// Puts the atoms of a frame in the order of the curves.
    fn curves(&mut self, mut atoms: Vec<Atom>, columns: &Columns) -> Result<(CurveSet, Vec<i64>)> {
        let bad = |what: String| Err(Error::format(FORMAT, "atoms", what));
        if columns.id.is_some() {
            atoms.sort_by_key(|atom| atom.id);
            if let Some(pair) = atoms.windows(2).find(|pair| pair[0].id == pair[1].id) {
                return bad(format!("the id {} is there twice", pair[0].id));
            }
        }
        let mut numbers = Vec::new();
        let known = &mut self.known;
        let counts = match &self.options.counts {
            Some(counts) => counts.clone(),
            None => {
                for atom in &atoms {
                    let new = known.len();
                    known.entry(atom.group).or_insert(new);
                }
                atoms.sort_by_cached_key(|atom| known[&atom.group]);
                let mut counts = Vec::new();
                for curve in atoms.chunk_by(|a, b| a.group == b.group) {
                    let Atom { group, closed, .. } = curve[0];
                    if curve.iter().any(|atom| atom.closed != closed) {
                        return bad(format!(
                            "curve {group} is closed by some atoms, but not by others"
                        ));
                    }
                    counts.push(count_of(curve.len(), closed)?);
                    numbers.push(group);
                }
                counts
            }
        };
        let points: Vec<Point> = atoms.iter().map(|atom| atom.at).collect();
        Ok((divided(FORMAT, "atoms", &points, &counts)?, numbers))
    }
}

impl Columns {
    /// Parses the line of an atom.
    fn atom(&self, line: &[u8]) -> Result<Atom, String> {
        let words: Vec<&[u8]> = words(line).take(self.all + 1).collect();
        if words.len() < self.all || words.len() > self.all && !self.more {
            let found = if words.len() > self.all {
                "more"
            } else {
                "fewer"
            };
            let all = self.all;
            return Err(format!("{found} columns than the {all} of Properties"));
        }
        let [x, y, z] = [0, 1, 2].map(|axis| number(words[self.at + axis]));
        let number_in = |column: Option<usize>, what| match column {
            Some(column) => integer(words[column], what),
            None => Ok(0),
        };
        Ok(Atom {
            at: [x?, y?, z?],
            id: number_in(self.id, "the id of an atom")?,
            group: number_in(self.group, "the number of a curve")?,
            closed: self.closed.map_or(Ok(true), |column| flag(words[column]))?,
        })
    }
}
