//! Place of a label: beside its mark, on the side where it covers nothing of the violated curves.
//!
//! The viewer writes the text centred below its point, in letters of a fixed size on the screen.
//! Their size in the scene is known for the eye that the layout sends
//! ([`super::view::View::eye`]); for other eyes, the label is on the same side.

use super::local::Spot;
use super::view::View;
use crate::curve::vector::{add, add_scaled};
use crate::curve::{CurveSet, Point};

/// Size of a letter, and the margin around the text, in sizes of the feature (see
/// [`super::local::feature`]) at the distance of the eye, in a view of some 440 pixels.
const LETTER: [f64; 2] = [0.07, 0.18];
const MARGIN: f64 = 0.1;

/// Distances of a label from its mark that are tried, the nearest first.
const DISTANCES: [f64; 6] = [0.45, 0.8, 1.2, 1.6, 2.1, 2.6];

/// Directions that are tried, to the right and down: below, above, and beside the mark.
const DIRECTIONS: [[f64; 2]; 4] = [[0.0, 1.0], [0.0, -1.0], [1.0, 0.0], [-1.0, 0.0]];

/// Maximum number of segments of a curve, on each side of the place, that a label keeps clear of,
/// and number of points of each.
const SEGMENTS: usize = 200;
const POINTS_PER_SEGMENT: usize = 4;

/// A label and its line.
pub(super) struct Label {
    /// Point of the text, which is written below it.
    pub anchor: Point,
    /// Line from the mark to the edge of the text.
    pub leader: [Point; 2],
}

/// Places a text beside the first mark of the first of some spots. `size` is that of the feature
/// there.
pub(super) fn place(set: &CurveSet, spots: &[&Spot], size: f64, text: &str, view: &View) -> Label {
    let mark = spots[0].marks[0];
    let covered = spots.iter().flat_map(|spot| curve_points(set, spot));
    let covered = covered.filter_map(|p| view.on_screen(p, mark, size));
    let covered: Vec<[f64; 2]> = covered.collect();
    let letters = text.lines().map(|line| line.chars().count()).max();
    let width = letters.unwrap_or(0) as f64 * LETTER[0] + 2.0 * MARGIN;
    let height = text.lines().count() as f64 * LETTER[1] + 2.0 * MARGIN;
    let half = [0.5 * width, 0.5 * height];
    let center = |far: f64, direction: [f64; 2]| [0, 1].map(|x| direction[x] * (far + half[x]));
    let hidden = |center: [f64; 2]| {
        let inside = |p: &&[f64; 2]| (0..2).all(|x| (p[x] - center[x]).abs() < half[x]);
        covered.iter().filter(inside).count()
    };
    let tried = DISTANCES.into_iter();
    let tried = tried.flat_map(|far| DIRECTIONS.map(|d| (far, d)));
    // `min_by_key` returns the first minimum, so nearer labels are preferred.
    let best = tried.min_by_key(|&(far, direction)| hidden(center(far, direction)));
    let (far, direction) = best.expect("there are some");
    let in_scene = |[right, down]: [f64; 2]| {
        let beside = add_scaled(mark, size * right, view.right());
        add_scaled(beside, size * down, view.down())
    };
    let [x, y] = center(far, direction);
    Label {
        anchor: in_scene([x, y - half[1]]),
        leader: [mark, in_scene(direction.map(|d| far * d))],
    }
}

/// Returns points of both curves of a spot.
fn curve_points<'a>(set: &'a CurveSet, spot: &Spot) -> impl Iterator<Item = Point> + 'a {
    let strands = spot.place.curves.into_iter().zip(spot.place.segments);
    let moved = strands.zip([[0.0; 3], spot.by]);
    moved.flat_map(move |((i, s), by)| {
        let (i, s) = (i as usize, s as usize);
        let segments = set.curves().get(i).map_or(0, |c| c.segments as usize);
        let closed = set.curves().get(i).is_some_and(|c| c.closed);
        let first = s.saturating_sub(SEGMENTS)..(s + SEGMENTS).min(segments);
        // Around a short closed curve, from its start to its end.
        let all = closed && segments <= 2 * SEGMENTS;
        let near = if all { 0..segments } else { first };
        near.flat_map(move |s| {
            let at = |k| k as f64 / POINTS_PER_SEGMENT as f64;
            (0..POINTS_PER_SEGMENT).map(move |k| add(set.eval(i, s, at(k)), by))
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::vector::distance;
    use crate::curve::{Basis, Positions};
    use crate::viewer::local;
    use std::f64::consts::TAU;

    /// Rings of radius 1 in the plane of the screen, around these points of it.
    fn rings(centers: &[[f64; 2]]) -> (CurveSet, View) {
        let set = |axes: [Point; 2]| {
            let point = |c: [f64; 2], k: usize| {
                let (sin, cos) = (TAU * k as f64 / 12.0).sin_cos();
                let p = add_scaled([0.0; 3], c[0] + cos, axes[0]);
                add_scaled(p, c[1] + sin, axes[1])
            };
            let rings = centers
                .iter()
                .flat_map(|&c| (0..12).flat_map(move |k| point(c, k)));
            let xyz: Vec<f64> = rings.collect();
            let counts = vec![-12; centers.len()];
            CurveSet::from_counts(Basis::Polyline, &counts, Positions::F64(&xyz)).unwrap()
        };
        // The view of rings in a plane does not depend on the axes of the plane, if these differ
        // little from those of the screen.
        let view = View::of(&set([[1.0, 0.0, 0.0], [0.0, -0.3, -1.0]])).unwrap();
        (set([view.right(), view.down()]), view)
    }

    /// Returns the place of a label at the start of segment 3 of ring 0, the lowest point, on the
    /// screen.
    fn placed(centers: &[[f64; 2]], text: &str) -> ([f64; 2], usize) {
        let (set, view) = rings(centers);
        let place = crate::verdict::Spot {
            curves: [0, centers.len() as u32 - 1],
            image: Default::default(),
            segments: [3, 3],
            point: set.knot(0, 3),
        };
        let spot = local::spot(&set, place, [0.0; 3]);
        let size = view.unit(spot.size);
        let label = super::place(&set, &[&spot], size, text, &view);
        let at = |p: Point| view.on_screen(p, spot.marks[0], size).unwrap();
        assert_eq!(label.leader[0], spot.marks[0]);
        let far = distance(label.leader[0], label.leader[1]) / size;
        assert!(
            (DISTANCES[0] - 1e-9..DISTANCES[5] + 1e-9).contains(&far),
            "{far}"
        );
        let [x, y] = at(label.anchor);
        let half = 0.5 * text.len() as f64 * LETTER[0];
        let hidden = |p: &Point| {
            let [px, py] = at(*p);
            (px - x).abs() < half && (0.0..LETTER[1]).contains(&(py - y))
        };
        ([x, y], curve_points(&set, &spot).filter(hidden).count())
    }

    #[test]
    fn a_label_is_close_below_its_place_if_nothing_is_there() {
        let (at, hidden) = placed(&[[0.0, 0.0]], "0 through itself");
        assert!(at[0].abs() < 1e-9 && (0.4..0.5).contains(&at[1]), "{at:?}");
        assert_eq!(hidden, 0);
    }

    #[test]
    fn a_label_covers_neither_curve() {
        let text = "0 & 1: linking number was 1, is 0";
        for other in [[0.0, 1.0], [0.3, 1.4], [-1.0, 1.0], [0.9, 0.2], [0.0, 2.0]] {
            let (at, hidden) = placed(&[[0.0, 0.0], other], text);
            assert_eq!(hidden, 0, "{other:?}: {at:?}");
        }
    }
}
