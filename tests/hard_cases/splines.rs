//! Splines whose control polygon or chords have another linking number than the curve.

use crate::case::{Answer, Case, Expected, Loop};
use linkwatch::{Basis, Point};

pub fn cases() -> Vec<Case> {
    let mut cases = Vec::new();
    for curve in curves() {
        cases.extend(needles(&curve));
    }
    cases
}

/// A planar spline that runs counterclockwise, and its intersections with the line `x = 0`.
struct Plane {
    name: &'static str,
    basis: Basis,
    points: Vec<[f64; 2]>,
    /// Height at which the curve meets the line: inside below, outside above.
    border: f64,
    /// Heights inside and outside of the curve. The far ones are beyond the control polygon or the
    /// chords.
    inside: f64,
    outside: f64,
}

fn curves() -> Vec<Plane> {
    let square = vec![[-3.0, -3.0], [3.0, -3.0], [3.0, 3.0], [-3.0, 3.0]];
    vec![
        // The weights at the middle of a segment are 1, 23, 23 and 1, over 48: (46 * 3 - 2 * 3) /
        // 48.
        Plane {
            name: "B-spline within its control polygon",
            basis: Basis::BSpline,
            points: square.clone(),
            border: 2.75,
            inside: 2.6,
            outside: 2.9,
        },
        // At the middle of this segment, the weights are -1, 9, 9 and -1, over 16: (18 * 3 + 2 * 3)
        // / 16.
        Plane {
            name: "Catmull-Rom around its control polygon",
            basis: Basis::CatmullRom,
            points: square,
            border: 3.75,
            inside: 3.4,
            outside: 3.9,
        },
        // The upper side bends inwards, because both its neighbours rise: (18 * 0 - 2 * 3) / 16.
        Plane {
            name: "Catmull-Rom within its control polygon",
            basis: Basis::CatmullRom,
            points: vec![
                [-3.0, 3.0],
                [-3.0, -3.0],
                [3.0, -3.0],
                [3.0, 3.0],
                [1.0, 3.0],
                [1.0, 0.0],
                [-1.0, 0.0],
                [-1.0, 3.0],
            ],
            border: -0.375,
            inside: -0.5,
            outside: -0.25,
        },
        // The weights are 1, 3, 3 and 1, over 8: 6 * 4 / 8. The chords enclose no area.
        Plane {
            name: "Bezier between its chords and its control polygon",
            basis: Basis::Bezier,
            points: vec![
                [3.0, 0.0],
                [3.0, 4.0],
                [-3.0, 4.0],
                [-3.0, 0.0],
                [-3.0, -4.0],
                [3.0, -4.0],
            ],
            border: 3.0,
            inside: 1.0,
            outside: 3.5,
        },
    ]
}

/// The spline, and a loop that goes up at some height on the line and comes down far outside. The
/// linking number is +1 inside and 0 outside, at any distance. Also a loop exactly through the
/// curve.
fn needles(plane: &Plane) -> Vec<Case> {
    let Plane {
        name,
        basis,
        border,
        inside,
        outside,
        ..
    } = plane;
    let disc: Loop = plane.points.iter().map(|&[x, y]| [x, y, 0.0]).collect();
    let case = |what: String, y: f64, answer: Answer| {
        let curves = [disc.clone(), needle(*basis, y)];
        Case::new(
            format!("{name}, {what}"),
            *basis,
            &curves,
            Expected::pair(answer),
        )
    };
    let mut cases = vec![
        case("inside".into(), *inside, Answer::Number(1)),
        case("outside".into(), *outside, Answer::Number(0)),
        case("touching".into(), *border, Answer::Touching),
    ];
    for k in [6, 12, 18, 24, 30, 40, 48] {
        let gap = 2f64.powi(-k);
        // The hulls of pieces become flatter with the square of their length, so these gaps are
        // wide for them.
        let answer: fn(i64) -> Answer = if k <= 30 {
            Answer::Number
        } else {
            Answer::Near
        };
        cases.push(case(format!("2^-{k} inside"), border - gap, answer(1)));
        cases.push(case(format!("2^-{k} outside"), border + gap, answer(0)));
    }
    cases
}

/// A loop with a straight side upwards at `(0, y)`, and its other sides far away.
fn needle(basis: Basis, y: f64) -> Loop {
    let corners = [
        [0.0, y, -20.0],
        [0.0, y, 20.0],
        [0.0, y + 40.0, 20.0],
        [0.0, y + 40.0, -20.0],
    ];
    let between =
        |p: Point, q: Point, t: f64| -> Point { std::array::from_fn(|x| p[x] + (q[x] - p[x]) * t) };
    let mut out = Loop::new();
    for (k, &p) in corners.iter().enumerate() {
        let q = corners[(k + 1) % 4];
        match basis {
            Basis::Polyline => out.push(p),
            // Four equal steps: the middle ones depend on this side alone, so they are straight.
            Basis::CatmullRom | Basis::BSpline => {
                out.extend((0..4).map(|j| between(p, q, f64::from(j) / 4.0)))
            }
            Basis::Bezier => out.extend([p, between(p, q, 0.25), between(p, q, 0.75)]),
        }
    }
    out
}
