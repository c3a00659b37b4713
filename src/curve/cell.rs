//! Periodic cell of a frame.

use super::Point;
use super::vector::{cross, dot, norm, per_axis};
use crate::error::{Error, Result};
use std::fmt;
use std::ops::RangeInclusive;
use std::str::FromStr;

/// Translation of a curve by lattice vectors: the multiples of the first, second and third vector
/// of a [`Cell`].
pub type Image = [i32; 3];

/// Returns true if an image is the curve itself.
pub(crate) fn is_home(image: &Image) -> bool {
    *image == Image::default()
}

/// Returns the sum of two translations.
pub(crate) fn plus(a: Image, b: Image) -> Image {
    per_axis(|k| a[k].wrapping_add(b[k]))
}

/// Returns the difference of two translations.
pub(crate) fn minus(a: Image, b: Image) -> Image {
    per_axis(|k| a[k].wrapping_sub(b[k]))
}

/// Periodic cell: the lattice along which a scene repeats.
///
/// A scene is periodic along one, two or three vectors, which need not be orthogonal. A vector of
/// zeros stands for a direction without repetition. The origin is a corner of the cell; it is for
/// pictures, and no result depends on it.
///
/// ```
/// use linkwatch::Cell;
///
/// let cell: Cell = "10,10,12".parse()?;
/// assert_eq!(cell.vectors[2], [0.0, 0.0, 12.0]);
/// let slab: Cell = "10,10,0".parse()?; // repeats along x and y
/// assert_eq!(slab.periodic(), [true, true, false]);
/// let sheared: Cell = "10,0,0, 2,10,0, 0,0,12".parse()?;
/// assert_eq!(sheared.vectors[1], [2.0, 10.0, 0.0]);
/// # Ok::<(), linkwatch::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Cell {
    /// A corner of the cell, in the units of the simulation.
    pub origin: Point,
    /// Lattice vectors, in the units of the simulation; zeros if the scene does not repeat.
    pub vectors: [Point; 3],
}

impl Cell {
    /// Returns the cell with these edges along the axes. An edge of 0 means that the axis is not
    /// periodic.
    pub fn orthogonal(origin: Point, edges: [f64; 3]) -> Cell {
        let vectors = per_axis(|k| per_axis(|x| if x == k { edges[k] } else { 0.0 }));
        Cell { origin, vectors }
    }

    /// Returns for each vector if the scene repeats along it.
    pub fn periodic(&self) -> [bool; 3] {
        self.vectors.map(|v| v != [0.0; 3])
    }

    /// Checks that the lattice vectors are linearly independent.
    ///
    /// # Errors
    ///
    /// [`Error::Usage`] if a number is not finite, or too large or small to compute with,
    /// if the scene does not repeat along any vector, or if the vectors are (almost) linearly
    /// dependent.
    pub fn check(&self) -> Result<()> {
        let refuse = |why: &str| Err(Error::Usage(format!("cell {self}: {why}")));
        let mut numbers = self.origin.iter().chain(self.vectors.as_flattened());
        if !numbers.all(|x| *x == 0.0 || Self::SIZES.contains(&x.abs())) {
            return refuse("a number that is not finite, or beyond 1e-60 to 1e60");
        }
        if !self.periodic().contains(&true) {
            return refuse("no vector along which the scene repeats");
        }
        self.inverse_or_error().map(drop)
    }

    /// Returns the inverse ([`Cell::inverse`]).
    ///
    /// # Errors
    ///
    /// [`Error::Usage`] if there is none.
    pub(crate) fn inverse_or_error(&self) -> Result<[Point; 3]> {
        let what = || format!("cell {self}: the vectors lie in one plane or on one line");
        self.inverse().ok_or_else(|| Error::Usage(what()))
    }

    /// Range of the numbers of a cell, except 0. Products of six stay finite and normal.
    const SIZES: RangeInclusive<f64> = 1e-60..=1e60;

    /// Returns three vectors `b` with `b[k] . a[l] = 1` if `k = l`, else 0, up to rounding, for the
    /// lattice vectors `a`. A lattice vector of zeros is replaced by a unit vector orthogonal to
    /// the others. `None` if the vectors are almost linearly dependent.
    pub(crate) fn inverse(&self) -> Option<[Point; 3]> {
        let a = self.basis()?;
        let normals = per_axis(|k| cross(a[(k + 1) % 3], a[(k + 2) % 3]));
        let volume = dot(a[0], normals[0]);
        let box_volume: f64 = a.map(norm).iter().product();
        // Also false if a number is not finite.
        let spans = volume.abs() > 1e-6 * box_volume;
        spans.then(|| normals.map(|n| n.map(|x| x / volume)))
    }

    /// Returns the lattice vectors, with each vector of zeros replaced by a unit vector orthogonal
    /// to the others. `None` if all are zero.
    pub(crate) fn basis(&self) -> Option<[Point; 3]> {
        let mut a = self.vectors;
        let periodic = self.periodic();
        for k in (0..3).filter(|&k| !periodic[k]) {
            let [p, q] = [a[(k + 1) % 3], a[(k + 2) % 3]];
            let normal = match (norm(p) > 0.0, norm(q) > 0.0) {
                (true, true) => cross(p, q),
                (true, false) => orthogonal_to(p),
                (false, true) => orthogonal_to(q),
                (false, false) => return None,
            };
            let size = norm(normal);
            a[k] = normal.map(|x| x / size);
        }
        Some(a)
    }

    /// Returns the size of a cell along each direction in fractional coordinates: 1, or the length
    /// of the longest lattice vector if the scene does not repeat along it. Its coordinates are
    /// lengths.
    pub(crate) fn units(&self) -> Point {
        let longest = self.vectors.map(norm).into_iter().fold(0.0, f64::max);
        let unit = |periodic| if periodic { 1.0 } else { longest };
        self.periodic().map(unit)
    }

    /// Returns this cell with the basis of its lattice that is nearest to another cell: a
    /// simulation that shears its cell takes another basis from time to time. Sums of vectors are
    /// rounded.
    pub(crate) fn in_basis_of(&self, before: &Cell) -> Cell {
        let Some(inverse) = before.inverse() else {
            return *self;
        };
        let periodic = self.periodic();
        // `vectors[l]` is the sum of `m[k][l]` times the vector `k` of the other cell.
        let multiple = |k: usize, l: usize| match periodic[l] {
            true => dot(inverse[k], self.vectors[l]).round(),
            false => f64::from(u8::from(k == l)),
        };
        let m = per_axis(|k| per_axis(|l| multiple(k, l)));
        let minor = |r: usize, c: usize| {
            let [r1, r2, c1, c2] = [(r + 1) % 3, (r + 2) % 3, (c + 1) % 3, (c + 2) % 3];
            m[r1][c1] * m[r2][c2] - m[r1][c2] * m[r2][c1]
        };
        let determinant: f64 = (0..3).map(|c| m[0][c] * minor(0, c)).sum();
        let is_same = (0..3).all(|k| (0..3).all(|l| m[k][l] == f64::from(u8::from(k == l))));
        if is_same || determinant.abs() != 1.0 {
            return *self;
        }
        // The inverse of `m` has the entries `minor(k, l) * determinant` in row `l`, column `k`.
        let vectors = per_axis(|k| match periodic[k] {
            false => self.vectors[k],
            true => per_axis(|x| {
                let term = |l: usize| determinant * minor(k, l) * self.vectors[l][x];
                term(0) + term(1) + term(2)
            }),
        });
        Cell { vectors, ..*self }
    }

    /// Returns the translation of an image, up to rounding.
    pub(crate) fn translation(&self, image: Image) -> Point {
        self.translation_by(image.map(f64::from))
    }

    /// Returns the sum of the lattice vectors with these factors.
    pub(crate) fn translation_by(&self, factors: Point) -> Point {
        per_axis(|x| {
            let terms = per_axis(|k| factors[k] * self.vectors[k][x]);
            terms[0] + terms[1] + terms[2]
        })
    }
}

/// Returns some vector orthogonal to a vector that is not 0. A small change of the vector rarely
/// leads to another choice.
fn orthogonal_to(v: Point) -> Point {
    let mut axis = [0.0; 3];
    // The first axis that is not almost parallel. At most one is.
    let differs = |&k: &usize| v[k] * v[k] < 0.81 * dot(v, v);
    axis[(0..3).find(differs).unwrap_or(0)] = 1.0;
    cross(v, axis)
}

impl fmt::Display for Cell {
    /// Writes three numbers for a cell along the axes with its corner at the origin, else nine or
    /// twelve: the vectors, and then the corner.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let edges = per_axis(|x| self.vectors[x][x]);
        let corner = (self.origin != [0.0; 3]).then_some(self.origin);
        let along_axes = Cell::orthogonal(self.origin, edges) == *self;
        let numbers: Vec<f64> = match (along_axes, corner) {
            (true, None) => edges.to_vec(),
            _ => {
                let vectors = self.vectors.as_flattened().iter().copied();
                vectors.chain(corner.into_iter().flatten()).collect()
            }
        };
        let numbers: Vec<String> = numbers.iter().map(f64::to_string).collect();
        f.write_str(&numbers.join(","))
    }
}

impl FromStr for Cell {
    type Err = Error;

    /// Parses three numbers (edges along the axes), nine (three vectors), or twelve (three vectors
    /// and the corner), separated by commas or spaces.
    fn from_str(text: &str) -> Result<Cell> {
        let parts = text.split([',', ' ']).filter(|part| !part.is_empty());
        let numbers: Option<Vec<f64>> = parts.map(|part| part.parse().ok()).collect();
        let cell = match numbers.as_deref() {
            Some(&[x, y, z]) if [x, y, z].iter().any(|edge| *edge < 0.0) => {
                let what = format!("'{text}': the edges of a cell are at least 0");
                return Err(Error::Usage(what));
            }
            Some(&[x, y, z]) => Cell::orthogonal([0.0; 3], [x, y, z]),
            Some(numbers) if matches!(numbers.len(), 9 | 12) => {
                let (points, _) = numbers.as_chunks::<3>();
                Cell {
                    origin: points.get(3).copied().unwrap_or_default(),
                    vectors: [points[0], points[1], points[2]],
                }
            }
            _ => {
                return Err(Error::Usage(format!(
                    "'{text}': expected the edges of a cell along the axes (10,10,10; 0 for a \
                     direction without repetition), nine numbers (three vectors), or twelve (and \
                     the corner)"
                )));
            }
        };
        cell.check()?;
        Ok(cell)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::vector::dot;

    #[test]
    fn the_text_of_a_cell_round_trips() {
        for text in [
            "10,10,12",
            "10,0,12.5",
            "10,0,0,2,10,0,0,0,12",
            "10,0,0,0,0,0,0,3,12",
            "10,0,0,2,10,0,0,0,12,-5,-5,1",
        ] {
            let cell: Cell = text.parse().unwrap();
            assert_eq!(cell.to_string().parse::<Cell>().unwrap(), cell, "{text}");
        }
        assert_eq!(
            "10, 10, 12".parse::<Cell>().unwrap().to_string(),
            "10,10,12"
        );
    }

    #[test]
    fn rejects_cells_that_are_no_lattice() {
        for (text, says) in [
            ("", "expected the edges"),
            ("10,10", "expected the edges"),
            ("10,10,x", "expected the edges"),
            ("0,0,0", "no vector"),
            ("nan,1,1", "not finite"),
            ("inf,1,1", "not finite"),
            ("1e300,1,1", "1e-60 to 1e60"),
            ("1,0,0,1,1e-9,0,0,0,1", "one plane"),
            ("1,0,0,1,1,0,1,-1,0", "one plane"),
            ("1,2,3,2,4,6,0,0,0", "one plane"),
        ] {
            let e = text.parse::<Cell>().unwrap_err().to_string();
            assert!(e.contains(says), "{text}: {e}");
        }
    }

    #[test]
    fn another_basis_is_replaced_by_the_known_one() {
        for (before, now, expected) in [
            ("10,10,12", "10,10,12", "10,10,12"),
            // The second vector minus the first one, and some shear.
            (
                "10,0,0,4.9,10,0,0,0,12",
                "10,0,0,-4.9,10,0,0,0,12",
                "10,0,0,5.1,10,0,0,0,12",
            ),
            (
                "8,0,0,0,8,0,0,0,8",
                "0,8,0,0,0,8,8.25,0,0",
                "8.25,0,0,0,8,0,0,0,8",
            ),
            (
                "8,0,0,1,8,0,0,0,0",
                "8,0,0,-7,8,0,0,0,0",
                "8,0,0,1,8,0,0,0,0",
            ),
            // Not the same lattice.
            ("10,10,12", "20,10,12", "20,10,12"),
        ] {
            let [before, now, expected] =
                [before, now, expected].map(|t| t.parse::<Cell>().unwrap());
            let found = now.in_basis_of(&before);
            let both = found
                .vectors
                .as_flattened()
                .iter()
                .zip(expected.vectors.as_flattened());
            assert!(
                both.clone().all(|(a, b)| (a - b).abs() < 1e-12),
                "{found} {expected}"
            );
        }
    }

    #[test]
    fn the_inverse_gives_multiples_of_the_vectors() {
        for text in [
            "10,10,12",
            "7,0,0",
            "0,3,4",
            "10,0,0,2,10,0,-3,1,12",
            "1,2,3,-2,1,0,0,0,0",
        ] {
            let cell: Cell = text.parse().unwrap();
            let inverse = cell.inverse().unwrap();
            for (k, b) in inverse.iter().enumerate() {
                for (l, a) in cell.vectors.iter().enumerate() {
                    let expected = f64::from(u8::from(k == l && cell.periodic()[l]));
                    assert!((dot(*a, *b) - expected).abs() < 1e-12, "{text}");
                }
            }
        }
    }
}
