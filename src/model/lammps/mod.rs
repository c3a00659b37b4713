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
//! chain in the order of their ids: open, unless [`ReadOptions::closed`].
//!
//! # Periodic boxes
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
use super::Format;
use super::frames::{FrameSource, ReadOptions, Single};
use super::lines::Lines;
use crate::error::{Error, Result};
use crate::words::plural;
use std::ffi::OsStr;
use std::io::BufRead;
use std::path::{Path, PathBuf};

/// Extensions of data files.
const DATA: [&str; 3] = ["data", "lmp", "lammps"];

/// Opens a data file.
pub(super) fn open_data(path: &Path, options: &ReadOptions) -> Result<Box<dyn FrameSource>> {
    let (input, len) = super::open_text(path)?;
    let name = path.display().to_string();
    let read = || read_data(input, len, &name, options.wrapped);
    let source = read().map_err(|e| e.in_file(path))?;
    Ok(Box::new(source))
}

/// Reads the curves of a data file of `len` bytes. Torn curves are refused, unless `wrapped`.
pub(super) fn read_data(
    input: impl BufRead,
    len: u64,
    name: &str,
    wrapped: bool,
) -> Result<Single> {
    let data = data::read(Lines::new(data::FORMAT, input, len)?, Wanted::Everything)?;
    let mut curves = Curves::of_bonds(data.bonds, data::FORMAT)?;
    let mut left_out = std::mem::take(&mut curves.left_out);
    left_out.extend(data.left_out);
    curves.report_others(data.atoms.len() as u64, name);
    let cell = data.space.cell()?;
    let mut frame = curves.frame();
    for (id, at) in data.atoms {
        frame
            .put(id, at)
            .map_err(|what| Error::format(data::FORMAT, "Atoms", what))?;
    }
    let unwrapped = match data.flags {
        true => Unwrapped::ByFlags,
        false => Unwrapped::Unknown,
    };
    let closest = cell.as_ref().filter(|_| !wrapped);
    let frame = Single::new(frame.finish(closest, unwrapped)?);
    Ok(frame.in_cell(cell).leaving_out(left_out))
}

/// Opens a dump.
pub(super) fn open_dump(path: &Path, options: &ReadOptions) -> Result<Box<dyn FrameSource>> {
    let (input, len) = super::open_text(path)?;
    let lines = Lines::new(dump::FORMAT, input, len).map_err(|e| e.in_file(path))?;
    let name = path.display().to_string();
    let curves = match options.bonds.clone().or_else(|| beside(path)) {
        Some(bonds) => read_bonds(&bonds)?,
        None => chains(path, options.closed).map_err(|e| e.in_file(path))?,
    };
    Ok(Box::new(dump::Dump::new(
        lines,
        curves,
        name,
        options.wrapped,
    )))
}

/// Returns the curves of a dump without bonds, and says what is assumed.
fn chains(path: &Path, closed: Option<bool>) -> Result<Curves> {
    let (input, len) = super::open_text(path)?;
    let lines = Lines::new(dump::FORMAT, input, len)?;
    let Some(curves) = dump::chains(lines, closed == Some(true))? else {
        let what = "a dump has no bonds, which define the curves: give a data file with them \
                    (`--bonds FILE`; LAMMPS: `write_data FILE`), or write the column mol, whose \
                    molecules are then chains in the order of the ids";
        return Err(Error::unsupported(dump::FORMAT, what));
    };
    let (kind, other) = match closed {
        Some(true) => ("closed", ""),
        _ => ("open", ", or --closed if all are rings"),
    };
    tracing::warn!(
        "{}: a dump has no bonds, so the atoms of each molecule (column mol) are taken as {} in \
         the order of their ids, {kind}: give --bonds FILE if they are not{other}",
        path.display(),
        plural(curves.len() as u64, "chain"),
    );
    Ok(curves)
}

/// Reads a dump in memory with the curves of these bonds.
#[cfg(test)]
pub(super) fn read_dump<'a>(
    bytes: &'a [u8],
    bonds: &[[u64; 2]],
    wrapped: bool,
) -> Result<impl FrameSource + 'a> {
    let lines = Lines::new(dump::FORMAT, bytes, bytes.len() as u64)?;
    let curves = Curves::of_bonds(bonds.to_vec(), data::FORMAT)?;
    Ok(dump::Dump::new(lines, curves, "memory".into(), wrapped))
}

/// Reads the curves that the bonds of a data file define.
fn read_bonds(path: &Path) -> Result<Curves> {
    let read = || -> Result<Curves> {
        let (input, len) = super::open_text(path)?;
        let data = data::read(Lines::new(data::FORMAT, input, len)?, Wanted::Bonds)?;
        let mut curves = Curves::of_bonds(data.bonds, data::FORMAT)?;
        curves.left_out.extend(data.left_out);
        Ok(curves)
    };
    read().map_err(|e| e.in_file(path))
}

/// Returns the data file that belongs to a dump by its name, if there is one: `melt.data` (or
/// `.lmp`, `.lammps`) beside `melt.dump`, or `data.melt` beside `dump.melt`.
fn beside(dump: &Path) -> Option<PathBuf> {
    let named = DATA.map(|extension| dump.with_extension(extension));
    let prefixed = (dump.file_name().and_then(OsStr::to_str))
        .and_then(|name| name.strip_prefix("dump."))
        .map(|rest| dump.with_file_name(format!("data.{rest}")));
    (prefixed.into_iter().chain(named)).find(|path| path.is_file() && path != dump)
}

/// Returns the format of a file of LAMMPS by its first bytes.
pub(super) fn format_of(start: &[u8]) -> Option<Format> {
    let dumps = [b"ITEM: TIME".as_slice(), b"ITEM: UNITS"];
    match start {
        start if dumps.iter().any(|dump| start.starts_with(dump)) => Some(Format::LammpsDump),
        start if data::begins(start) => Some(Format::LammpsData),
        _ => None,
    }
}

#[cfg(test)]
mod tests;
