//! Named links, and strands that are twisted by a given number of turns.

use crate::case::{Answer, Case, Expected, Loop, Polygon};
use linkwatch::scenes::Scene;

pub fn cases() -> Vec<Case> {
    let mut cases = vec![
        hopf(1),
        hopf(-1),
        whitehead(),
        borromean(),
        two_four_torus_link(2),
        two_four_torus_link(-2),
        chain(12),
        coils(50, -40),
        coils(1000, 1000),
    ];
    for (turns, pitch) in [
        (1, 1 << 4),
        (-3, 1 << 12),
        (7, 1 << 20),
        (100, 1 << 30),
        (-100, 1 << 40),
    ] {
        cases.push(twisted_strands(turns, pitch));
    }
    cases.extend(SCENES.map(generated));
    cases
}

/// A counterclockwise square in the xy plane, and one that passes upwards through it. By the sign
/// rule this counts +1; reversed, it counts -1.
pub fn hopf_polygons(sign: i64) -> [Polygon; 2] {
    let a = vec![[-2, -2, 0], [2, -2, 0], [2, 2, 0], [-2, 2, 0]];
    let b = vec![[0, 0, -sign], [0, 0, sign], [5, 0, sign], [5, 0, -sign]];
    [a, b]
}

fn floats(polygons: &[Polygon]) -> Vec<Loop> {
    let point = |p: &[i64; 3]| p.map(|x| x as f64);
    polygons
        .iter()
        .map(|p| p.iter().map(point).collect())
        .collect()
}

fn pair(name: &str, polygons: &[Polygon], lambda: i64) -> Case {
    Case::built(
        name,
        &floats(polygons),
        Expected::pair(Answer::Number(lambda)),
    )
}

/// The Hopf link along the axes: edges through the middle of edges in two of three views.
fn hopf(sign: i64) -> Case {
    pair(&format!("Hopf link {sign:+}"), &hopf_polygons(sign), sign)
}

/// The alternating diagram with five crossings: a square around the crossing of a figure eight. The
/// curves are linked, but their linking number is 0.
fn whitehead() -> Case {
    let square = vec![[4, 0, 0], [0, 4, 0], [-4, 0, 0], [0, -4, 0]];
    let mut eight = vec![[-6, 4, 3], [-3, 2, 3], [0, 0, -2], [3, -2, 3], [6, -4, 3]];
    eight.extend([
        [6, 4, -3],
        [3, 2, -3],
        [0, 0, 2],
        [-3, -2, -3],
        [-6, -4, -3],
    ]);
    pair("Whitehead link", &[square, eight], 0)
}

/// Three rectangles, one in each axis plane. They are linked as a triple, but each pair has linking
/// number 0.
fn borromean() -> Case {
    let ring = vec![[3, 1, 0], [-3, 1, 0], [-3, -1, 0], [3, -1, 0]];
    let turned = |by: usize| -> Polygon {
        let mut points = ring.clone();
        points.iter_mut().for_each(|p| p.rotate_left(by));
        points
    };
    let rings = [0, 1, 2].map(turned);
    Case::built("Borromean rings", &floats(&rings), Expected::unlinked())
}

/// Two strands that are twisted around each other twice: the torus link T(2, 4).
fn two_four_torus_link(lambda: i64) -> Case {
    let mut case = twisted_strands(lambda, 2);
    case.name = format!("(2, 4) torus link {lambda:+}");
    case
}

/// A straight strand, and one that winds around it in a square helix of radius 1, a quarter of a
/// turn every `pitch`. At a large pitch they are nearly parallel, and very near for their length.
/// The straight strand closes far away and bounds a flat disc, which each turn passes through once,
/// so the answer is the number of turns.
fn twisted_strands(turns: i64, pitch: i64) -> Case {
    let quarters = 4 * turns.abs();
    let (end, far) = (quarters * pitch, 1000);
    let straight = vec![
        [-pitch, 0, 0],
        [end + pitch, 0, 0],
        [end + pitch, -far, 0],
        [-pitch, -far, 0],
    ];
    let corner = |k: i64| {
        let [y, z] = [[1, 0], [0, 1], [-1, 0], [0, -1]][k as usize % 4];
        [k * pitch, y, z * turns.signum()]
    };
    let mut helix: Polygon = (0..=quarters).map(corner).collect();
    helix.extend([[end, far, 0], [0, far, 0]]);
    let name = format!("{turns} turns of pitch {pitch}");
    pair(&name, &[straight, helix], turns)
}

/// Rings in rotated planes, each through the next: by the rule of signs, +1 and -1 in turn.
fn chain(rings: i64) -> Case {
    let ring = |k: i64| -> Polygon {
        let square = [[-2, -2], [2, -2], [2, 2], [-2, 2]];
        let place = |[x, y]: [i64; 2]| match k % 2 {
            0 => [3 * k + x, y, 0],
            _ => [3 * k + x, 0, y],
        };
        square.map(place).into()
    };
    let polygons: Vec<Polygon> = (0..rings).map(ring).collect();
    let mut expected = Expected::unlinked();
    for i in 0..rings as usize - 1 {
        // The left side of each ring goes down through the previous one: away from the side from
        // which that one runs counterclockwise in x and y, and towards that side in x and z.
        let sign = if i % 2 == 0 { -1 } else { 1 };
        expected.answers.insert((i, i + 1), Answer::Number(sign));
    }
    Case::built(format!("chain of {rings}"), &floats(&polygons), expected)
}

/// A coil of `p` square turns, each of which surrounds `q` turns of another coil. The linking
/// number `p q` is large for so few segments, and every projection has at least that many
/// crossings.
fn coils(p: i64, q: i64) -> Case {
    let (width, height, sign) = (q.abs() + 2, p + 1, q.signum());
    let turn = |z: i64| [[0, 0, z], [width, 0, z], [width, width, z], [0, width, z]];
    let first = (0..p).flat_map(turn).collect();
    let across = |y: i64| {
        let [down, up] = [-height * sign, height * sign];
        [
            [1, y, down],
            [1, y, up],
            [2 * width, y, up],
            [2 * width, y, down],
        ]
    };
    let second = (1..=q.abs()).flat_map(across).collect();
    pair(
        &format!("coils of {p} and {q} turns"),
        &[first, second],
        p * q,
    )
}

/// Small links of all kinds, including splines, and links with large linking numbers and few
/// segments.
const SCENES: [&str; 9] = [
    "chainmail:rows=2,columns=3,tilt=0",
    "knit:rows=4,stitches=16,segments=512",
    "ribbon:segments=2000,lambda=-10",
    "ribbon:segments=12000,lambda=1000",
    "rubber_bands:bands=12",
    "square_link:loops=16,segments=64",
    "torus_link:segments=20000,toroidal=-20,poloidal=25",
    "torus_zero:segments=4000,periods=8",
    "woundball:segments=2000,crossings=10",
];

/// A generated scene of the library, with the certificate that follows from its construction.
fn generated(name: &str) -> Case {
    let scene: Scene = name.parse().expect("a scene");
    let generated = scene.build().expect("a scene that can be built");
    let links = generated.certificate.links().iter();
    let answers = links.map(|l| ((l.i as usize, l.j as usize), Answer::Number(l.lambda)));
    Case {
        name: name.into(),
        curves: generated.curves,
        expected: Expected {
            answers: answers.collect(),
            ..Expected::unlinked()
        },
    }
}
