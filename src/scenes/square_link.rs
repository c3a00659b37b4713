//! The thick square link: two bundles of squares; each square of one is linked with each of the
//! other.

use super::pen::polylines;
use super::{Generated, Kind, MOST_SEGMENTS, Parameter, Scene};
use crate::error::Result;
use crate::verdict::Link;

pub(super) const KIND: Kind = Kind {
    name: "square_link",
    purpose: "thick square link: two bundles of squares, each square linked with all of the other \
              bundle; very many links",
    parameters: &[
        Parameter::integer("loops", 1250, 2, 20_000).is("squares of both bundles, an even number"),
        Parameter::integer("segments", 500_000, 8, MOST_SEGMENTS)
            .is("segments of all squares, at least four each"),
    ],
    build,
};

/// Half of the smallest side of the squares; the largest is this plus [`THICKNESS`].
const HALF_SIDE: f64 = 1.0;

/// Thickness of a bundle in both directions: squares nest in parallel planes.
const THICKNESS: f64 = 0.5;

/// Distance of the centres of both bundles. The near side of each goes through the middle of the
/// other.
const CENTRE_DISTANCE: f64 = 1.5;

/// Builds the link. The first bundle lies in planes `z = const` and runs counterclockwise seen from
/// above; the second one lies in planes `y = const` and goes up through the first.
///
/// The far sides are near nothing. The first bundle goes along y for x from 1 to 1.5, through all
/// squares of the second one; the second goes along z for x from 0 to 0.5, through all squares of
/// the first. Bundles are 0.5 apart, squares of a bundle at least 0.005. Sides are straight lines
/// along the axes, which rounding moves as a whole, by at most `2^-22`.
fn build(scene: &Scene) -> Result<Generated> {
    let (loops, segments) = (scene.count("loops"), scene.count("segments"));
    if loops % 2 == 1 {
        return Err(scene.error("two bundles need an even number of loops"));
    }
    if segments < 4 * loops {
        return Err(scene.error(format!(
            "{loops} squares need at least {} segments",
            4 * loops
        )));
    }
    let half = loops / 2;
    // Smallest square number that is large enough.
    let side = half.isqrt() + usize::from(half.isqrt().pow(2) < half);

    let place = |k: usize| THICKNESS * k as f64 / side as f64;
    let squares = polylines(loops, segments, |i, k, n| {
        let (bundle, own) = (i / half, i % half);
        let half_side = HALF_SIDE + place(own % side);
        let height = place(own / side) - THICKNESS / 2.0;
        let [u, v] = on_square(k, n).map(|x| half_side * x);
        match bundle {
            0 => [u, v, height],
            _ => [u + CENTRE_DISTANCE, height, -v],
        }
    });
    let n = half as u32;
    let lambda = 1;
    let links = (0..n).flat_map(|i| (n..2 * n).map(move |j| Link { i, j, lambda }));
    Ok(Generated::new(squares?, links.collect()))
}

/// Returns point `k` of `n` on the square with corners `(+-1, +-1)`, counterclockwise. The corners
/// are among the points.
fn on_square(k: usize, n: usize) -> [f64; 2] {
    // Side `s` starts at the point `s n / 4`, rounded up.
    let start = |side: usize| (side * n).div_ceil(4);
    let side = 4 * k / n;
    let along = (k - start(side)) as f64 / (start(side + 1) - start(side)) as f64;
    let x = 2.0 * along - 1.0;
    match side {
        0 => [x, -1.0],
        1 => [1.0, x],
        2 => [-x, 1.0],
        _ => [-1.0, -x],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn squares_have_their_corners() {
        for n in 4..40 {
            let points: Vec<[f64; 2]> = (0..n).map(|k| on_square(k, n)).collect();
            for corner in [[-1., -1.], [1., -1.], [1., 1.], [-1., 1.]] {
                assert!(points.contains(&corner), "{n}: {points:?}");
            }
            assert!(
                points
                    .iter()
                    .all(|p| p[0].abs() == 1.0 || p[1].abs() == 1.0)
            );
        }
    }
}
