//! Text files of LAMMPS: data files, which have bonds, and dumps, which have frames.
//!
//! The bonds define the curves. A molecule in which every atom has two bonds is a closed curve; a
//! chain with two ends is an open one. Molecules with branches are skipped with a warning, as are
//! atoms without bonds. Curves have the order of their smallest atom ids. A closed curve starts
//! with its smallest atom and goes on to the smaller neighbour of that atom, an open one starts at
//! its end with the smaller id.
//!
//! A dump has no bonds: they come from [`ReadOptions::bonds`], or from a data file of the same stem
//! in the same folder ([`beside`]).
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
mod write;

pub(super) use self::write::{DumpFile, bonds_of, write_data};

use self::bonds::Curves;
use self::cell::Unwrapped;
use self::data::Wanted;
use super::frames::{FrameSource, ReadOptions, Single};
use super::lines::Lines;
use crate::error::{Error, Result};
use std::ffi::OsStr;
use std::io::BufRead;
use std::path::{Path, PathBuf};

/// Extensions of data files and of dumps.
const DATA: [&str; 3] = ["data", "lmp", "lammps"];
const DUMP: [&str; 2] = ["dump", "lammpstrj"];

fn has_extension(path: &Path, extensions: &[&str]) -> bool {
    let extension = path.extension().unwrap_or_default();
    extensions.iter().any(|e| extension.eq_ignore_ascii_case(e))
}

/// Opens a data file.
pub(super) fn open_data(path: &Path, options: &ReadOptions) -> Result<Box<dyn FrameSource>> {
    let (input, len) = super::open(path)?;
    let read = || read_data(input, len, &path.display().to_string(), options.wrapped);
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
    let curves = Curves::of_bonds(data.bonds, data::FORMAT, name)?;
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
    Ok(Single::new(frame.finish(closest, unwrapped)?).in_cell(cell))
}

/// Opens a dump.
pub(super) fn open_dump(path: &Path, options: &ReadOptions) -> Result<Box<dyn FrameSource>> {
    let (input, len) = super::open(path)?;
    let lines = Lines::new(dump::FORMAT, input, len).map_err(|e| e.in_file(path))?;
    let Some(bonds) = options.bonds.clone().or_else(|| beside(path)) else {
        let what = "a dump has no bonds, which define the curves: give a data file with them \
                    (`--bonds FILE`; LAMMPS: `write_data FILE`)";
        return Err(Error::unsupported(dump::FORMAT, what).in_file(path));
    };
    let name = path.display().to_string();
    let curves = read_bonds(&bonds)?;
    Ok(Box::new(dump::Dump::new(
        lines,
        curves,
        name,
        options.wrapped,
    )))
}

/// Reads a dump in memory with the curves of these bonds.
#[cfg(test)]
pub(super) fn read_dump<'a>(
    bytes: &'a [u8],
    bonds: &[[u64; 2]],
    wrapped: bool,
) -> Result<impl FrameSource + 'a> {
    let lines = Lines::new(dump::FORMAT, bytes, bytes.len() as u64)?;
    let curves = Curves::of_bonds(bonds.to_vec(), data::FORMAT, "memory")?;
    Ok(dump::Dump::new(lines, curves, "memory".into(), wrapped))
}

/// Reads the curves that the bonds of a data file define.
fn read_bonds(path: &Path) -> Result<Curves> {
    let read = || {
        let (input, len) = super::open(path)?;
        let data = data::read(Lines::new(data::FORMAT, input, len)?, Wanted::Bonds)?;
        Curves::of_bonds(data.bonds, data::FORMAT, &path.display().to_string())
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

/// Returns true if a file begins as a dump does.
pub(super) fn begins_as_dump(path: &Path) -> bool {
    let Ok((mut input, _)) = super::open(path) else {
        return false;
    };
    let starts = [b"ITEM: TIME".as_slice(), b"ITEM: UNITS"];
    (input.fill_buf()).is_ok_and(|bytes| starts.iter().any(|start| bytes.starts_with(start)))
}

#[cfg(test)]
mod tests;
