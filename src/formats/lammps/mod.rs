//! Text files of LAMMPS: data files, which have bonds, and dumps, which have frames.
//!
//! The bonds define the curves. A molecule in which every atom has two bonds is a closed curve; a
//! chain with two ends is an open one. Molecules with branches are counted as left out
//! ([`crate::LeftOut`]); atoms without bonds are no curves. Curves have the order of their smallest
//! atom ids. A closed curve starts with its smallest atom and goes on to the smaller neighbour of
//! that atom, an open one starts at its end with the smaller id.
//!
//! A dump has no bonds: they come from [`ReadOptions::bonds`], or from a data file of the same stem
//! in the same folder ([`beside`]). Without both, the atoms of each molecule (column `mol`) are a
//! chain in the order of their ids: open, unless [`ReadOptions::closed`]. If that is not given, the
//! bonds that may close them count as left out.
//!
//! # Periodic cells
//!
//! The cell of a frame is its box, along the directions that are periodic. Simulations wrap atoms
//! that leave such a box to its other side. A curve that crosses the boundary is then torn, and
//! must be unwrapped before its topology can be computed: by coordinates that are not wrapped
//! (`xu yu zu`), by image flags, or by the caller ([`ReadOptions::wrapped`]). Otherwise some bond
//! of the curve is longer than half of the box, which no simulation allows, because the image of
//! the atom on the other side is closer. Such frames are refused.
//!
//! Cost: one pass over the file, with the memory of the bonds and of one frame.

mod bonds;
mod cell;
mod data;
mod dump;

use self::bonds::Curves;
use self::cell::Unwrapped;
use self::data::Wanted;
use super::frames::{ModelFrame, ReadOptions, Source};
use super::lines::Lines;
use super::{Format, Input};
use crate::error::{Error, Result};
use crate::verdict::LeftOut;
use crate::words::plural;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

/// Extensions of data files.
const DATA: [&str; 3] = ["data", "lmp", "lammps"];

/// Reads the curves of a data file. Torn curves are refused, unless the caller unwraps them.
pub(super) fn read_data(input: Input<'_>, options: &ReadOptions) -> Result<Source<'static>> {
    let name = input.name.clone();
    let data = data::read(Lines::new(data::FORMAT, input)?, Wanted::Everything)?;
    let mut curves = Curves::of_bonds(data.bonds, data::FORMAT)?;
    let mut left_out = std::mem::take(&mut curves.left_out);
    left_out.extend(data.left_out);
    curves.report_others(data.atoms.len() as u64, &name);
    let cell = data.space.cell()?;
    let mut frame = curves.frame();
    for (id, at) in data.atoms {
        let put = frame.put(id, at);
        put.map_err(|what| Error::format(data::FORMAT, "Atoms", what))?;
    }
    let unwrapped = match data.flags {
        true => Unwrapped::ByFlags,
        false => Unwrapped::Unknown,
    };
    let closest = cell.as_ref().filter(|_| options.wrapped.is_none());
    let mut frame = ModelFrame::new(0, Ok(frame.finish(closest, unwrapped)?));
    (frame.info.cell, frame.info.left_out) = (cell, left_out);
    Ok(Box::new(Some(frame)))
}

/// Opens a dump.
pub(super) fn open_dump(path: &Path, options: &ReadOptions) -> Result<Source<'static>> {
    let lines = Lines::new(dump::FORMAT, super::open_text(path)?)?;
    let curves = match options.bonds_of(path) {
        Some(bonds) => {
            super::external::unpacked(&bonds, read_bonds).map_err(|e| e.in_file(bonds))?
        }
        None => chains(path, options.closed)?,
    };
    let (wrapped, last) = (options.wrapped.is_some(), None);
    Ok(Box::new(dump::Dump {
        lines,
        curves,
        wrapped,
        last,
    }))
}

/// Returns the curves of a dump without bonds, and says what is assumed.
fn chains(path: &Path, closed: Option<bool>) -> Result<Curves> {
    let lines = Lines::new(dump::FORMAT, super::open_text(path)?)?;
    let Some(mut curves) = dump::chains(lines, closed == Some(true))? else {
        let what = "a dump has no bonds, which define the curves: give a data file with them \
                    (option `bonds`; LAMMPS: `write_data FILE`), or write the column mol, whose \
                    molecules are then chains in the order of the ids";
        return Err(Error::unsupported(dump::FORMAT, what));
    };
    let (kind, other) = match closed {
        Some(true) => ("closed", ""),
        _ => ("open", ", or pass the option `closed` if all are rings"),
    };
    let chains = curves.counts.len() as u64;
    tracing::warn!(
        "{}: a dump has no bonds, so the atoms of each molecule (column mol) are taken as {} in \
         the order of their ids, {kind}: give a data file with bonds (option `bonds`) if they \
         are not{other}",
        path.display(),
        plural(chains, "chain"),
    );
    if closed.is_none() {
        // Rings would be verified without the bonds that close them.
        let kind = ["possible closing bond", "possible closing bonds"];
        let advice = "the option `closed` or the option `closed=false` decides";
        curves.left_out.push(LeftOut::new(chains, kind, advice));
    }
    Ok(curves)
}

/// Reads a dump in memory with the curves of these bonds.
#[cfg(test)]
pub(super) fn read_dump<'a>(
    bytes: &'a [u8],
    bonds: &[[u64; 2]],
    wrapped: bool,
) -> Result<Source<'a>> {
    let lines = Lines::new(dump::FORMAT, bytes.into())?;
    let curves = Curves::of_bonds(bonds.to_vec(), data::FORMAT)?;
    let last = None;
    Ok(Box::new(dump::Dump {
        lines,
        curves,
        wrapped,
        last,
    }))
}

/// Reads the curves that the bonds of a data file define.
fn read_bonds(path: &Path) -> Result<Curves> {
    let lines = Lines::new(data::FORMAT, super::open_text(path)?)?;
    let data = data::read(lines, Wanted::Bonds)?;
    let mut curves = Curves::of_bonds(data.bonds, data::FORMAT)?;
    curves.left_out.extend(data.left_out);
    Ok(curves)
}

/// Returns the data file that belongs to a dump by its name, if there is one: `melt.data` (or
/// `.lmp`, `.lammps`) beside `melt.dump`, or `data.melt` beside `dump.melt`. A script of LAMMPS
/// with such a name is none.
pub(super) fn beside(dump: &Path) -> Option<PathBuf> {
    let named = DATA.map(|extension| dump.with_extension(extension));
    let prefixed = (dump.file_name().and_then(OsStr::to_str))
        .and_then(|name| name.strip_prefix("dump."))
        .map(|rest| dump.with_file_name(format!("data.{rest}")));
    let is_data = |path: &PathBuf| {
        let known = Format::of_content(path) == Some(Format::LammpsData);
        if !known && path.is_file() && path != dump {
            let path = path.display();
            tracing::warn!("{path} is no data file of LAMMPS: the bonds are not read from it");
        }
        known
    };
    prefixed.into_iter().chain(named).find(is_data)
}

/// Returns the format of a file of LAMMPS by its first bytes.
pub(super) fn format_of(start: &[u8]) -> Option<Format> {
    let mut dumps = [b"ITEM: TIME".as_slice(), b"ITEM: UNITS"].into_iter();
    match dumps.any(|dump| start.starts_with(dump)) {
        true => Some(Format::LammpsDump),
        false => data::begins(start).then_some(Format::LammpsData),
    }
}

#[cfg(test)]
mod tests;
