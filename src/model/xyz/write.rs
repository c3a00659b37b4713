//! Writes extended XYZ: each curve is a molecule.

use super::FORMAT;
use crate::curve::CurveSet;
use crate::error::{Error, Result};
use crate::model::frames::ModelFrame;
use crate::model::write::{FrameSink, check_polylines, curves_of};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// A file, which its first frame creates.
pub(in crate::model) struct XyzFile {
    path: PathBuf,
    out: Option<BufWriter<File>>,
    last: Option<u64>,
}

impl XyzFile {
    pub fn new(path: &Path) -> XyzFile {
        XyzFile {
            path: path.into(),
            out: None,
            last: None,
        }
    }
}

impl FrameSink for XyzFile {
    fn frame(&mut self, frame: &ModelFrame) -> Result<()> {
        let set = curves_of(FORMAT, frame)?;
        check_polylines(FORMAT, set)?;
        if let Some(last) = self.last.filter(|last| frame.seq <= *last) {
            let what = format!("frame {} after frame {last}", frame.seq);
            return Err(Error::unsupported(FORMAT, what));
        }
        self.last = Some(frame.seq);
        let out = match &mut self.out {
            Some(out) => out,
            none => {
                let file = File::create(&self.path).map_err(Error::file(&self.path))?;
                none.insert(BufWriter::with_capacity(1 << 16, file))
            }
        };
        write(out, frame, set).map_err(Error::file(&self.path))
    }

    fn finish(self: Box<Self>) -> Result<()> {
        match self.out {
            Some(mut out) => out.flush().map_err(Error::file(self.path)),
            None => Err(Error::unsupported(FORMAT, "a file without frames")),
        }
    }
}

/// Returns numbers with spaces between, the shortest decimals that are read back as the same ones.
fn joined(numbers: &[f64]) -> String {
    let numbers: Vec<String> = numbers.iter().map(|x| format!("{x:?}")).collect();
    numbers.join(" ")
}

fn letter(flag: bool) -> &'static str {
    if flag { "T" } else { "F" }
}

fn write(out: &mut impl Write, frame: &ModelFrame, set: &CurveSet) -> std::io::Result<()> {
    writeln!(out, "{}", set.points())?;
    if let Some(cell) = &frame.cell {
        write!(out, "Lattice=\"{}\" ", joined(cell.vectors.as_flattened()))?;
        write!(out, "Origin=\"{}\" ", joined(&cell.origin))?;
    }
    let periodic = frame.cell.map_or([false; 3], |cell| cell.periodic());
    write!(out, "pbc=\"{}\" ", periodic.map(letter).join(" "))?;
    // Without the last column, curves with a long closing segment would be taken as open.
    let columns = "species:S:1:pos:R:3:molecule:I:1:closed:L:1";
    write!(out, "Properties={columns} Timestep={}", frame.seq)?;
    if frame.time != 0.0 {
        write!(out, " Time={:?}", frame.time)?;
    }
    writeln!(out)?;
    for (i, curve) in set.curves().iter().enumerate() {
        for k in 0..curve.points as usize {
            let [x, y, z] = set.point(i, k);
            let closed = letter(curve.closed);
            writeln!(out, "C {x:?} {y:?} {z:?} {} {closed}", i + 1)?;
        }
    }
    Ok(())
}
