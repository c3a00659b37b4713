//! Text dumps (`dump .. atom`, `dump .. custom`), one frame at a time.
//!
//! The atoms of a frame may be in any order. A frame with a wrong value, a missing atom or a torn
//! curve is invalid, but those after it can be read; a frame of another shape ends the file.

use super::bonds::{Curves, Frame};
use super::cell::{SimulationBox, Unwrapped, atom};
use crate::curve::vector::add;
use crate::error::Result;
use crate::formats::frames::{FrameSource, ModelFrame};
use crate::formats::lines::{Lines, integer, words};
use crate::formats::{number, quote};
use crate::ingest::FrameInfo;

pub(super) const FORMAT: &str = "LAMMPS dump";
/// Shortest line of an atom, `1 0 0 0`, with the line break.
const ATOM_BYTES: u64 = 8;

/// Chains of the first frame: the atoms of each molecule (column `mol`) in the order of their ids.
/// `None` if there is no such column, or no frame.
pub(super) fn chains(mut lines: Lines<'_>, closed: bool) -> Result<Option<Curves>> {
    let Some((head, columns)) = header(&mut lines)? else {
        return Ok(None);
    };
    let (Some(mol), Some(atoms)) = (columns.mol, head.atoms) else {
        return Ok(None);
    };
    lines.check_room(atoms, ATOM_BYTES, "atoms")?;
    let mut members = Vec::with_capacity(atoms as usize);
    for k in 0..atoms {
        lines.expect(format_args!("{atoms} atoms, found {k}"))?;
        members.push(lines.parse(|line| member(line, mol, columns.used[0]))?);
    }
    Curves::of_molecules(members, closed).map(Some)
}

/// Parses the molecule and the id of an atom.
fn member(line: &[u8], mol: usize, id: usize) -> Result<(i64, u64), String> {
    let word = |column: usize, expected| {
        let word = words(line).nth(column);
        word.ok_or_else(|| format!("too few columns, expected {expected}"))
    };
    let molecule = integer(word(mol, "a molecule")?, "the number of a molecule")?;
    Ok((molecule, integer(word(id, "an id")?, "the id of an atom")?))
}

/// Reader of a dump.
pub(super) struct Dump<'a> {
    pub lines: Lines<'a>,
    pub curves: Curves,
    /// True if torn curves are not refused.
    pub wrapped: bool,
    /// Time step of the previous frame.
    pub last: Option<u64>,
}

/// Header of a frame, before its atoms.
#[derive(Default)]
struct Header {
    step: Option<u64>,
    time: f64,
    atoms: Option<u64>,
    space: Option<SimulationBox>,
}

impl Header {
    /// Sets the value of an item of one line.
    fn set(&mut self, item: &[u8], value: &[u8]) -> Result<(), String> {
        match item {
            b"TIMESTEP" => self.step = Some(integer(value, "a time step")?),
            b"NUMBER OF ATOMS" => self.atoms = Some(integer(value, "the number of atoms")?),
            b"TIME" => self.time = number(value)?,
            b"UNITS" => {}
            other => return Err(format!("item {}, which is not known", quote(other))),
        }
        Ok(())
    }
}

/// Reads up to the atoms of a frame. `None` at the end of the file.
fn header(lines: &mut Lines<'_>) -> Result<Option<(Header, Columns)>> {
    if !lines.advance_to_text()? {
        return Ok(None);
    }
    let mut header = Header::default();
    loop {
        let Some(item) = lines.line.strip_prefix(b"ITEM: ") else {
            let what = format!("{}, expected an ITEM", quote(&lines.line));
            return Err(lines.bad(what));
        };
        let item = item.trim_ascii().to_vec();
        if let Some(columns) = item.strip_prefix(b"ATOMS") {
            let columns = Columns::new(columns).map_err(|what| lines.bad(what))?;
            return Ok(Some((header, columns)));
        }
        if let Some(kind) = item.strip_prefix(b"BOX BOUNDS") {
            header.space = Some(bounds(lines, kind)?);
        } else {
            lines.expect(format_args!("the value of {}", quote(&item)))?;
            lines.parse(|line| header.set(&item, line.trim_ascii()))?;
        }
        lines.expect("an ITEM of the frame")?;
    }
}

impl FrameSource for Dump<'_> {
    fn next_frame(&mut self) -> Result<Option<ModelFrame>> {
        let lines = &mut self.lines;
        let Some((header, columns)) = header(lines)? else {
            return Ok(None);
        };
        let lacks = |item| lines.bad(format_args!("atoms without ITEM: {item}"));
        let step = header.step.ok_or_else(|| lacks("TIMESTEP"))?;
        let atoms = header.atoms.ok_or_else(|| lacks("NUMBER OF ATOMS"))?;
        let space = header.space.ok_or_else(|| lacks("BOX BOUNDS"))?;
        match self.last {
            Some(last) if step <= last => {
                return Err(lines.bad(format_args!(
                    "time step {step} after time step {last}: remove frames that a restart wrote \
                     again"
                )));
            }
            Some(_) => {}
            None => self.curves.report_others(atoms, &lines.name),
        }
        self.last = Some(step);
        lines.check_room(atoms, ATOM_BYTES, "atoms")?;
        let mut frame = self.curves.frame();
        // After a wrong line, the others of the frame are skipped.
        let mut read = Ok(());
        for k in 0..atoms {
            lines.expect(format_args!("{atoms} atoms, found {k}"))?;
            if lines.line.starts_with(b"ITEM:") {
                return Err(lines.bad(format_args!("an ITEM after {k} of {atoms} atoms")));
            }
            if read.is_ok() {
                read = lines.parse(|line| columns.put(line, &space, &mut frame));
            }
        }
        let mut info = FrameInfo::at(step, header.time);
        info.left_out.clone_from(&self.curves.left_out);
        let curves = space.cell().and_then(|cell| {
            info.cell = cell;
            read?;
            frame.finish(cell.filter(|_| !self.wrapped).as_ref(), columns.unwrapped)
        });
        Ok(Some(ModelFrame::of(info, curves)))
    }
}

/// Forms of a box.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Form {
    /// Two bounds along each axis.
    Orthogonal,
    /// Two bounds and a tilt factor.
    Tilted,
    /// The three coordinates of an edge and one of the corner.
    General,
}

/// Parses what follows `ITEM: BOX BOUNDS`: the form of the box, and the periodic directions.
fn boundaries(kind: &[u8]) -> Result<(Form, [bool; 3]), String> {
    let kind: Vec<&[u8]> = words(kind).take(8).collect();
    let (form, kinds) = match kind[..] {
        [b"xy", b"xz", b"yz", ref kinds @ ..] => (Form::Tilted, kinds),
        [b"abc", b"origin", ref kinds @ ..] => (Form::General, kinds),
        ref kinds => (Form::Orthogonal, kinds),
    };
    match *kinds {
        // Dumps of old versions do not say it.
        [] => Ok((form, [true; 3])),
        [x, y, z] => Ok((form, [x, y, z].map(|kind| kind.starts_with(b"p")))),
        _ => Err("expected three kinds of boundaries (`pp pp pp`)".into()),
    }
}

/// Reads the three lines of a box of a kind.
fn bounds(lines: &mut Lines<'_>, kind: &[u8]) -> Result<SimulationBox> {
    let (form, periodic) = boundaries(kind).map_err(|what| lines.bad(what))?;
    let (mut bounds, mut tilt, mut edges) = ([[0.0; 3]; 2], [0.0; 3], [[0.0; 3]; 3]);
    for x in 0..3 {
        lines.expect("the bounds of the box")?;
        let values: Vec<f64> = lines.parse(|line| words(line).map(number).collect())?;
        match (&values[..], form) {
            (&[low, high], Form::Orthogonal) => (bounds[0][x], bounds[1][x]) = (low, high),
            (&[low, high, factor], Form::Tilted) => {
                (bounds[0][x], bounds[1][x], tilt[x]) = (low, high, factor);
            }
            (&[a, b, c, low], Form::General) => (edges[x], bounds[0][x]) = ([a, b, c], low),
            (other, form) => {
                let (found, expected) = (other.len(), 2 + form as usize);
                let what = format!("{found} bounds of the box, expected {expected}");
                return Err(lines.bad(what));
            }
        }
    }
    Ok(match form {
        Form::General => SimulationBox {
            low: bounds[0],
            edges,
            periodic,
        },
        _ => SimulationBox::of_dump(bounds, tilt, periodic),
    })
}

/// Columns of the atoms.
#[derive(Debug, PartialEq, Eq)]
struct Columns {
    /// Number of columns.
    all: usize,
    /// Columns of the id, of the coordinates, and of the image flags (those of the coordinates
    /// again if there are none).
    used: [usize; 7],
    /// Column of the molecule.
    mol: Option<usize>,
    /// True if the coordinates are multiples of the edges of the box.
    scaled: bool,
    unwrapped: Unwrapped,
}

impl Columns {
    /// Parses the names of the columns. Coordinates that are not wrapped are preferred.
    fn new(names: &[u8]) -> Result<Columns, String> {
        let names: Vec<&[u8]> = words(names).collect();
        let column = |name: &str| names.iter().position(|n| *n == name.as_bytes());
        let three = |names: [&str; 3]| {
            let [x, y, z] = names.map(column);
            Some([x?, y?, z?])
        };
        let id = column("id").ok_or(
            "no column id, so that atoms cannot be told apart: write `dump .. custom .. id xu yu \
             zu`",
        )?;
        let flags = three(["ix", "iy", "iz"]);
        let flagged = match flags {
            Some(_) => Unwrapped::ByFlags,
            None => Unwrapped::Unknown,
        };
        let (at, scaled, unwrapped) = [
            (["xu", "yu", "zu"], false, Unwrapped::Coordinates),
            (["xsu", "ysu", "zsu"], true, Unwrapped::Coordinates),
            (["x", "y", "z"], false, flagged),
            (["xs", "ys", "zs"], true, flagged),
        ]
        .into_iter()
        .find_map(|(names, scaled, unwrapped)| Some((three(names)?, scaled, unwrapped)))
        .ok_or("no columns of coordinates: write `dump .. custom .. id xu yu zu`")?;
        let [x, y, z] = at;
        let [ix, iy, iz] = flags.unwrap_or(at);
        Ok(Columns {
            all: names.len(),
            used: [id, x, y, z, ix, iy, iz],
            mol: column("mol"),
            scaled,
            unwrapped,
        })
    }

    /// Adds the atom of a line to a frame.
    fn put(&self, line: &[u8], space: &SimulationBox, frame: &mut Frame<'_>) -> Result<(), String> {
        let words: Vec<&[u8]> = words(line).collect();
        if words.len() != self.all {
            return Err(format!("{} columns, expected {}", words.len(), self.all));
        }
        let found = self.used.map(|column| words[column]);
        let flags = (self.unwrapped == Unwrapped::ByFlags).then_some(&found[4..]);
        let (id, at, flags) = atom(found[0], &found[1..4], flags)?;
        let at = match self.scaled {
            true => add(space.low, space.shift(add(at, flags))),
            false => add(at, space.shift(flags)),
        };
        frame.put(id, at)
    }
}
