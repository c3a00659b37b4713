//! Writes data files and dumps of polylines.
//!
//! Atoms have the ids 1, 2, .. in the order of the curves, and the number of their curve as
//! molecule, so that reading gives the same curves. Numbers are the shortest decimals that are read
//! back as the same double.
//!
//! The box is the cell of the frame, and reaches around all points along the other directions. In
//! the bounds of a dump, the edges of a tilted box are rounded.

use super::cell::overhang;
use super::{DUMP, data, dump};
use crate::curve::{Cell, CurveSet};
use crate::error::{Error, Result};
use crate::model::frames::ModelFrame;
use crate::model::write::{FrameSink, check_polylines, curves_of, same_curves, text_file};
use std::ffi::OsStr;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// Returns the name of the data file with the bonds of a dump, which is written beside it.
pub(in crate::model) fn bonds_of(dump: &Path) -> PathBuf {
    let rest = (dump.file_name().and_then(OsStr::to_str)).and_then(|n| n.strip_prefix("dump."));
    match rest {
        Some(rest) if !super::has_extension(dump, &DUMP) => {
            dump.with_file_name(format!("data.{rest}"))
        }
        _ => dump.with_extension("data"),
    }
}

/// Rejects curves that bonds cannot express.
fn check(format: &'static str, set: &CurveSet) -> Result<()> {
    check_polylines(format, set)?;
    match set.curves().iter().position(|c| c.closed && c.points < 3) {
        Some(i) => Err(Error::unsupported(
            format,
            format_args!(
                "curve {i}, a closed curve of {} points: bonds need at least three",
                set.curve(i).points
            ),
        )),
        None => Ok(()),
    }
}

/// Writes a data file of atom style `bond`.
pub(in crate::model) fn write_data(path: &Path, set: &CurveSet, cell: Option<&Cell>) -> Result<()> {
    check(data::FORMAT, set)?;
    let space = Space::new(data::FORMAT, cell, roomy(set))?;
    if space.bounds.as_flattened().iter().any(|x| !x.is_finite()) {
        let what = "coordinates too large for the bounds of a box";
        return Err(Error::unsupported(data::FORMAT, what));
    }
    text_file(path, |out| data_file(out, set, &space))
}

/// The box of a file.
struct Space {
    /// Lower and upper corner, before tilting.
    bounds: [[f64; 3]; 2],
    /// Tilt factors xy, xz, yz.
    tilt: [f64; 3],
    periodic: [bool; 3],
}

impl Space {
    /// Returns the box of a cell, with the given bounds along the directions without repetition.
    ///
    /// Errors: the vectors of the cell are not `(lx, 0, 0)`, `(xy, ly, 0)` and `(xz, yz, lz)`.
    fn new(format: &'static str, cell: Option<&Cell>, mut bounds: [[f64; 3]; 2]) -> Result<Space> {
        let (mut tilt, mut periodic) = ([0.0; 3], [false; 3]);
        if let Some(cell) = cell {
            let [a, b, c] = cell.vectors;
            tilt = [b[0], c[0], c[1]];
            periodic = cell.periodic();
            let lengths = [a[0], b[1], c[2]];
            let triangular = [a[1], a[2], b[2]] == [0.0; 3];
            let positive = lengths.map(|length| length > 0.0);
            if !triangular || positive != periodic {
                return Err(Error::unsupported(
                    format,
                    format_args!(
                        "the cell {cell}: a box has the vectors lx,0,0 and xy,ly,0 and xz,yz,lz \
                         with positive lengths; turn the coordinates, or write .npz or .xyz"
                    ),
                ));
            }
            for x in (0..3).filter(|&x| periodic[x]) {
                let (low, length) = (cell.origin[x], lengths[x]);
                // The corner is of no importance, but the length is.
                let kept = (low + length) - low == length;
                let low = if kept { low } else { 0.0 };
                (bounds[0][x], bounds[1][x]) = (low, low + length);
            }
        }
        Ok(Space {
            bounds,
            tilt,
            periodic,
        })
    }

    /// Returns a word for each direction.
    fn boundary(&self, [periodic, free]: [&str; 2]) -> String {
        let words = self.periodic.map(|p| if p { periodic } else { free });
        words.join(" ")
    }

    fn is_tilted(&self) -> bool {
        self.tilt != [0.0; 3]
    }
}

/// Returns the longest bond, the lower and the upper bounds of the points in each direction.
fn extent(set: &CurveSet) -> [[f64; 3]; 3] {
    let mut longest = [0.0_f64; 3];
    let (mut low, mut high) = ([0.0_f64; 3], [0.0_f64; 3]);
    let mut first = true;
    for (i, curve) in set.curves().iter().enumerate() {
        let n = curve.points as usize;
        for k in 0..n {
            let (p, q) = (set.point(i, k), set.point(i, (k + 1) % n));
            for x in 0..3 {
                if k + 1 < n || curve.closed {
                    longest[x] = longest[x].max((q[x] - p[x]).abs());
                }
                low[x] = if first { p[x] } else { low[x].min(p[x]) };
                high[x] = if first { p[x] } else { high[x].max(p[x]) };
            }
            first = false;
        }
    }
    [longest, low, high]
}

/// Returns the bounds of a box in which no bond is longer than a quarter, so that a reader that
/// takes it as periodic finds nothing torn.
fn roomy(set: &CurveSet) -> [[f64; 3]; 2] {
    let [longest, low, high] = extent(set);
    let margin = |x: usize| {
        // Relative to the coordinates, so that it is not lost in their rounding.
        let size = low[x].abs().max(high[x].abs()).max(1.0);
        2.0 * longest[x] + 1e-3 * size
    };
    [
        [0, 1, 2].map(|x| low[x] - margin(x)),
        [0, 1, 2].map(|x| high[x] + margin(x)),
    ]
}

fn data_file(out: &mut dyn Write, set: &CurveSet, space: &Space) -> std::io::Result<()> {
    let bonds = set.segments();
    let boundary = space.boundary(["p", "f"]);
    writeln!(out, "LAMMPS data file of linkwatch, boundary {boundary}\n")?;
    writeln!(out, "{} atoms\n1 atom types", set.points())?;
    writeln!(out, "{bonds} bonds\n1 bond types\n")?;
    let [low, high] = space.bounds;
    for (x, axis) in ['x', 'y', 'z'].into_iter().enumerate() {
        writeln!(out, "{:?} {:?} {axis}lo {axis}hi", low[x], high[x])?;
    }
    if space.is_tilted() {
        let [xy, xz, yz] = space.tilt;
        writeln!(out, "{xy:?} {xz:?} {yz:?} xy xz yz")?;
    }
    writeln!(out, "\nMasses\n\n1 1\n\nAtoms # bond\n")?;
    let mut id = 0;
    for i in 0..set.len() {
        for k in 0..set.curve(i).points as usize {
            id += 1;
            let [x, y, z] = set.point(i, k);
            writeln!(out, "{id} {} 1 {x:?} {y:?} {z:?}", i + 1)?;
        }
    }
    writeln!(out, "\nBonds\n")?;
    let (mut first, mut bond) = (1, 0);
    for curve in set.curves() {
        for k in 0..curve.segments {
            bond += 1;
            let next = (k + 1) % curve.points;
            writeln!(out, "{bond} 1 {} {}", first + k, first + next)?;
        }
        first += curve.points;
    }
    Ok(())
}

/// A dump, and the data file with its bonds.
pub(in crate::model) struct DumpFile {
    path: PathBuf,
    out: Option<BufWriter<File>>,
    counts: Vec<i32>,
    last: Option<u64>,
}

impl DumpFile {
    pub fn new(path: &Path) -> DumpFile {
        DumpFile {
            path: path.into(),
            out: None,
            counts: Vec::new(),
            last: None,
        }
    }
}

impl FrameSink for DumpFile {
    fn frame(&mut self, frame: &ModelFrame) -> Result<()> {
        let set = curves_of(dump::FORMAT, frame)?;
        check(dump::FORMAT, set)?;
        let [_, low, high] = extent(set);
        let space = Space::new(dump::FORMAT, frame.cell.as_ref(), [low, high])?;
        let out = match &mut self.out {
            Some(out) => {
                same_curves(dump::FORMAT, &self.counts, set)?;
                out
            }
            none => {
                write_data(&bonds_of(&self.path), set, frame.cell.as_ref())?;
                self.counts = set.counts().collect();
                let file = File::create(&self.path).map_err(Error::file(&self.path))?;
                none.insert(BufWriter::with_capacity(1 << 16, file))
            }
        };
        if let Some(last) = self
            .last
            .replace(frame.seq)
            .filter(|last| frame.seq <= *last)
        {
            let what = format!("frame {} after frame {last}", frame.seq);
            return Err(Error::unsupported(dump::FORMAT, what));
        }
        snapshot(out, frame, set, &space).map_err(Error::file(&self.path))
    }

    fn finish(self: Box<Self>) -> Result<()> {
        match self.out {
            Some(mut out) => out.flush().map_err(Error::file(self.path)),
            None => Err(Error::unsupported(dump::FORMAT, "a file without frames")),
        }
    }
}

fn snapshot(
    out: &mut impl Write,
    frame: &ModelFrame,
    set: &CurveSet,
    space: &Space,
) -> std::io::Result<()> {
    if frame.time != 0.0 {
        writeln!(out, "ITEM: TIME\n{:?}", frame.time)?;
    }
    writeln!(out, "ITEM: TIMESTEP\n{}", frame.seq)?;
    writeln!(out, "ITEM: NUMBER OF ATOMS\n{}", set.points())?;
    let boundary = space.boundary(["pp", "ff"]);
    let [mut low, mut high] = space.bounds;
    if space.is_tilted() {
        writeln!(out, "ITEM: BOX BOUNDS xy xz yz {boundary}")?;
        for (x, [below, above]) in overhang(space.tilt).into_iter().enumerate() {
            low[x] += below;
            high[x] += above;
        }
    } else {
        writeln!(out, "ITEM: BOX BOUNDS {boundary}")?;
    }
    for x in 0..3 {
        write!(out, "{:?} {:?}", low[x], high[x])?;
        match space.is_tilted() {
            true => writeln!(out, " {:?}", space.tilt[x])?,
            false => writeln!(out)?,
        }
    }
    writeln!(out, "ITEM: ATOMS id mol type xu yu zu")?;
    let mut id = 0;
    for i in 0..set.len() {
        for k in 0..set.curve(i).points as usize {
            id += 1;
            let [x, y, z] = set.point(i, k);
            writeln!(out, "{id} {} 1 {x:?} {y:?} {z:?}", i + 1)?;
        }
    }
    Ok(())
}
