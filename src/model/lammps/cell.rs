//! The box of a simulation: scaled coordinates, image flags, and torn bonds.

use crate::curve::Point;
use std::sync::Once;

/// The box: edges `(lx, 0, 0)`, `(xy, ly, 0)` and `(xz, yz, lz)` from its lower corner.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Cell {
    pub low: Point,
    pub lengths: Point,
    /// Tilt factors xy, xz, yz.
    pub tilt: [f64; 3],
    /// Directions in which atoms that leave the box come back on the other side.
    pub periodic: [bool; 3],
}

/// How coordinates became those of a whole curve.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Unwrapped {
    /// The file has them (`xu yu zu`, `xsu ysu zsu`).
    Coordinates,
    /// By image flags.
    ByFlags,
    /// Not at all: the file has wrapped coordinates only.
    Unknown,
}

impl Cell {
    /// Returns a box from its bounds.
    pub fn new([low, high]: [Point; 2], tilt: [f64; 3], periodic: [bool; 3]) -> Cell {
        Cell {
            low,
            lengths: [0, 1, 2].map(|x| high[x] - low[x]),
            tilt,
            periodic,
        }
    }

    /// Returns a box from the bounds of a dump, which are those of the axis-parallel box around a
    /// tilted one.
    pub fn of_dump(mut bounds: [Point; 2], tilt: [f64; 3], periodic: [bool; 3]) -> Cell {
        let [xy, xz, yz] = tilt;
        let [low, high] = &mut bounds;
        low[0] -= xy.min(xz).min(xy + xz).min(0.0);
        high[0] -= xy.max(xz).max(xy + xz).max(0.0);
        low[1] -= yz.min(0.0);
        high[1] -= yz.max(0.0);
        Cell::new(bounds, tilt, periodic)
    }

    /// Returns a multiple of each edge, added.
    pub fn shift(&self, [a, b, c]: [f64; 3]) -> Point {
        let [lx, ly, lz] = self.lengths;
        let [xy, xz, yz] = self.tilt;
        [a * lx + b * xy + c * xz, b * ly + c * yz, c * lz]
    }

    /// Returns the direction in which a bond is not proven to be at most half as long as the
    /// periodic box, and its length there in units of the box.
    pub fn torn(&self, [x, y, z]: Point) -> Option<(char, f64)> {
        let [lx, ly, lz] = self.lengths;
        let [xy, xz, yz] = self.tilt;
        let c = z / lz;
        let b = (y - c * yz) / ly;
        let a = (x - b * xy - c * xz) / lx;
        let scaled = [('x', a, lx), ('y', b, ly), ('z', c, lz)];
        (scaled.into_iter().zip(self.periodic))
            // A bound that is not a number is not proven.
            .find(|&((_, s, length), periodic)| periodic && !(s.abs() <= 0.5 && length > 0.0))
            .map(|((axis, s, _), _)| (axis, s.abs()))
    }
}

/// Says, once per process, that periodic images are not considered.
pub(super) fn warn_of_images(cell: &Cell, name: &str) {
    static ONCE: Once = Once::new();
    if cell.periodic.contains(&true) {
        ONCE.call_once(|| {
            tracing::warn!(
                "{name}: the box is periodic; curves are verified where their unwrapped \
                 coordinates are, and links with periodic images are not computed"
            );
        });
    }
}
