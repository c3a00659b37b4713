//! The box of a simulation: scaled coordinates, image flags, and the cell along which it repeats.

use crate::curve::vector::per_axis;
use crate::curve::{Cell, Point};
use crate::error::Result;
use crate::formats::lines::integer;
use crate::formats::number;
use crate::formats::torn::cell_along;

/// Id of an atom, its coordinates, and its image flags (0 without).
pub(super) type Atom = (u64, Point, [f64; 3]);

/// Parses an atom.
pub(super) fn atom(id: &[u8], at: &[&[u8]], flags: Option<&[&[u8]]>) -> Result<Atom, String> {
    let id = integer(id, "the id of an atom")?;
    let mut atom = (id, [0.0; 3], [0.0; 3]);
    for (x, word) in atom.1.iter_mut().zip(at) {
        *x = number(word).map_err(|what| format!("atom {id}: {what}"))?;
    }
    for (flag, word) in atom.2.iter_mut().zip(flags.unwrap_or_default()) {
        *flag = f64::from(integer::<i32>(word, "an image flag")?);
    }
    Ok(atom)
}

/// The box: three edges from its lower corner. Unless it is general, they are `(lx, 0, 0)`,
/// `(xy, ly, 0)` and `(xz, yz, lz)`. The coordinates of a file with a general box
/// (`triclinic/general`, and the default of OVITO) are in the same system as its edges.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct SimulationBox {
    pub low: Point,
    pub edges: [Point; 3],
    /// Directions in which atoms that leave the box come back on the other side.
    pub periodic: [bool; 3],
}

/// Source of the unwrapped coordinates of the curves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Unwrapped {
    /// The file has them (`xu yu zu`, `xsu ysu zsu`).
    Coordinates,
    /// Wrapped coordinates and image flags.
    ByFlags,
    /// None: the file has wrapped coordinates only.
    Unknown,
}

impl SimulationBox {
    /// Returns a box from its bounds and its tilt factors xy, xz and yz.
    pub fn new([low, high]: [Point; 2], tilt: [f64; 3], periodic: [bool; 3]) -> SimulationBox {
        let [lx, ly, lz] = per_axis(|x| high[x] - low[x]);
        let [xy, xz, yz] = tilt;
        SimulationBox {
            low,
            edges: [[lx, 0.0, 0.0], [xy, ly, 0.0], [xz, yz, lz]],
            periodic,
        }
    }

    /// Returns a box from the bounds of a dump, which are those of the axis-parallel box around a
    /// tilted one.
    pub fn of_dump(mut bounds: [Point; 2], tilt: [f64; 3], periodic: [bool; 3]) -> SimulationBox {
        let [xy, xz, yz] = tilt;
        // A tilted box reaches beyond its bounds in x and in y.
        let [low, high] = &mut bounds;
        low[0] -= xy.min(xz).min(xy + xz).min(0.0);
        high[0] -= xy.max(xz).max(xy + xz).max(0.0);
        low[1] -= yz.min(0.0);
        high[1] -= yz.max(0.0);
        SimulationBox::new(bounds, tilt, periodic)
    }

    /// Returns a multiple of each edge, added.
    pub fn shift(&self, [a, b, c]: [f64; 3]) -> Point {
        let [u, v, w] = &self.edges;
        per_axis(|x| a * u[x] + b * v[x] + c * w[x])
    }

    /// Returns the cell along which the scene repeats, if it does.
    ///
    /// # Errors
    ///
    /// [`crate::Error::Usage`] if a periodic cell has no volume.
    pub fn cell(&self) -> Result<Option<Cell>> {
        let cell = Cell {
            origin: self.low,
            vectors: self.edges,
        };
        cell_along(cell, self.periodic, |k| {
            let axis = ["x", "y", "z"][k];
            format!("the box is periodic in {axis}, but has no length in {axis}")
        })
    }
}
