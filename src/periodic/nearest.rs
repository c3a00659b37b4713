//! The nearest image of a point, in a cell whose lattice vectors may be far from orthogonal.

use crate::curve::vector::{add, add_scaled, dot, per_axis, sub};
use crate::curve::{Cell, Image, Point, is_home, minus, plus};

/// Lattice vectors, and the images that they lead to.
type Translations = Vec<(Point, Image)>;

/// Bound on the number of steps of a reduction, for vectors whose lengths differ by many digits.
const MOST_STEPS: usize = 1000;

/// Number of lattice vectors beyond which images cannot be told apart.
const FARTHEST: f64 = 1e6;

impl Cell {
    /// Returns the cell with the shortest lattice vectors of the same lattice. A box that is
    /// sheared by three times its height may have the lattice of a cube.
    pub fn reduced(&self) -> Cell {
        let [a, b, c] = self.vectors;
        if [dot(a, b), dot(b, c), dot(c, a)] == [0.0; 3] {
            return *self;
        }
        let mut vectors = [Point::default(); 3];
        let periodic = self.periodic();
        let places = (0..3).filter(|&x| periodic[x]);
        for (x, (vector, _)) in places.zip(reduced_basis(self)) {
            vectors[x] = vector;
        }
        Cell { vectors, ..*self }
    }
}

/// Returns a basis of the lattice of which no vector becomes shorter if others are added to it or
/// subtracted (a Minkowski-reduced basis).
fn reduced_basis(cell: &Cell) -> Translations {
    let periodic = cell.periodic();
    let unit = |x: usize| per_axis(|k| i32::from(k == x));
    let of_cell = (0..3).filter(|&x| periodic[x]);
    let mut basis: Translations = of_cell.map(|x| (cell.vectors[x], unit(x))).collect();
    for _ in 0..MOST_STEPS {
        let mut shortened = false;
        for x in 0..basis.len() {
            let before = basis.remove(x);
            let mut rounded = before;
            for (other, image) in &basis {
                let times = (dot(rounded.0, *other) / dot(*other, *other)).round();
                if times.abs() < FARTHEST {
                    let scaled = image.map(|n| n.wrapping_mul(times as i32));
                    rounded = (
                        add_scaled(rounded.0, -times, *other),
                        minus(rounded.1, scaled),
                    );
                }
            }
            let (shortest, _) = nearest_of(rounded.0, &sums(&basis));
            let shortest = (shortest.0, plus(rounded.1, shortest.1));
            // By more than rounding errors, so that this ends.
            let is_shorter = dot(shortest.0, shortest.0) < LESS * dot(before.0, before.0);
            basis.insert(x, if is_shorter { shortest } else { before });
            shortened |= is_shorter;
        }
        if !shortened {
            break;
        }
    }
    basis
}

/// Share of a squared length below which a vector is shorter by more than rounding errors.
const LESS: f64 = 1.0 - 1e-9;

/// Returns the shortest of a step and its images, with the translation, and its squared length.
fn nearest_of(step: Point, translations: &Translations) -> ((Point, Image), f64) {
    let mut shortest = ((step, Image::default()), dot(step, step));
    for &(by, image) in translations {
        let moved = add(step, by);
        let length_sq = dot(moved, moved);
        if length_sq < LESS * shortest.1 {
            shortest = ((moved, image), length_sq);
        }
    }
    shortest
}

/// Returns all sums of some lattice vectors, each with the factor -1, 0 or 1.
fn sums(basis: &Translations) -> Translations {
    let mut all = vec![Default::default()];
    for &(vector, image) in basis {
        let moved = |(v, n): &(Point, Image)| {
            [
                (sub(*v, vector), minus(*n, image)),
                (*v, *n),
                (add(*v, vector), plus(*n, image)),
            ]
        };
        all = all.iter().flat_map(moved).collect();
    }
    all
}

/// The shortest translations of a lattice.
///
/// Rounding fractional coordinates gives the nearest image of a point if the lattice vectors are
/// nearly orthogonal. In an oblique cell, the image that it gives may be much further away.
pub(super) struct Neighbors {
    /// Translations that limit the Voronoi cell of the lattice are among them: sums of the vectors
    /// of a Minkowski-reduced basis, each with the factor -1, 0 or 1 (Nguyen & Stehlé 2009,
    /// *Low-dimensional lattice basis reduction revisited*). A step is the shortest one among its
    /// images if none of them makes it shorter.
    all: Translations,
    /// Squared length up to which a step is the shortest among its images: that of half of the
    /// shortest lattice vector.
    certain_sq: f64,
}

impl Neighbors {
    pub fn of(cell: &Cell) -> Neighbors {
        let mut all = sums(&reduced_basis(cell));
        all.retain(|(_, image)| !is_home(image));
        let lengths_sq = all.iter().map(|(v, _)| dot(*v, *v));
        let certain_sq = 0.25 * lengths_sq.fold(f64::INFINITY, f64::min);
        Neighbors { all, certain_sq }
    }

    /// Returns the translation to the nearest image, and true if it is no guess: the step is then
    /// at most a third of the shortest lattice vector.
    pub fn shorten(&self, mut step: Point) -> (Image, bool) {
        let (mut by, mut length_sq) = (Image::default(), dot(step, step));
        for _ in 0..MOST_STEPS {
            if length_sq <= self.certain_sq {
                break;
            }
            let ((next, image), next_sq) = nearest_of(step, &self.all);
            if is_home(&image) {
                break;
            }
            (step, by, length_sq) = (next, plus(by, image), next_sq);
        }
        (by, length_sq <= self.certain_sq * (4.0 / 9.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn of(vectors: [Point; 3]) -> Cell {
        let origin = Point::default();
        Cell { origin, vectors }
    }

    /// Returns the length of the shortest image of a step among very many.
    fn shortest(cell: &Cell, step: Point) -> f64 {
        let range = || -12..=12;
        let images =
            range().flat_map(|x| range().flat_map(move |y| range().map(move |z| [x, y, z])));
        let moved = images.map(|n| add(step, cell.translation(n)));
        moved
            .map(|v| dot(v, v).sqrt())
            .fold(f64::INFINITY, f64::min)
    }

    proptest! {
        #[test]
        fn the_nearest_image_is_found_in_every_cell(
            tilts in prop::array::uniform3(-3.0f64..3.0),
            edges in prop::array::uniform3(0.5f64..2.0),
            at in prop::array::uniform3(-0.5f64..0.5),
        ) {
            let [x, y, z] = edges;
            let [xy, xz, yz] = tilts;
            let vectors = [[x, 0.0, 0.0], [xy * y, y, 0.0], [xz * z, yz * z, z]];
            let cell = of(vectors);
            let step = (0..3).fold([0.0; 3], |sum, k| add(sum, vectors[k].map(|v| at[k] * v)));
            let (by, certain) = Neighbors::of(&cell).shorten(step);
            let found = add(step, cell.translation(by));
            let length = dot(found, found).sqrt();
            prop_assert!(length <= shortest(&cell, step) * (1.0 + 1e-6));
            if certain {
                prop_assert!(length < 0.5 * x.max(y).max(z));
            }
        }
    }

    #[test]
    fn a_sheared_cube_has_the_neighbors_of_the_cube() {
        let sheared = of([[10.0, 0.0, 0.0], [30.0, 10.0, 0.0], [0.0, 0.0, 10.0]]);
        assert_eq!(sheared.reduced(), Cell::orthogonal([0.0; 3], [10.0; 3]));
        let neighbors = Neighbors::of(&sheared);
        assert_eq!((neighbors.all.len(), neighbors.certain_sq), (26, 25.0));
        assert_eq!(neighbors.shorten([10.0, 3.3, 0.0]), ([-1, 0, 0], true));
        assert_eq!(neighbors.shorten([30.0, 13.3, 0.0]), ([0, -1, 0], true));
        assert_eq!(neighbors.shorten([0.0, 4.0, 0.0]), ([0, 0, 0], false));
    }
}
