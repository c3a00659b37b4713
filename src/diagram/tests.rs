//! Diagrams of known links, of degenerate polygons, and of random ones.

use super::*;
use crate::curve::{Basis, Positions};
use crate::random::Random;

fn set(curves: &[Vec<[f64; 3]>]) -> CurveSet {
    let counts: Vec<i32> = curves.iter().map(|c| -(c.len() as i32)).collect();
    let xyz: Vec<f64> = curves.iter().flatten().flatten().copied().collect();
    CurveSet::from_counts(Basis::Polyline, &counts, Positions::F64(&xyz)).unwrap()
}

fn all(set: &CurveSet) -> Result<Diagram, Defect> {
    let curves: Vec<u32> = (0..set.len() as u32).collect();
    Diagram::of(set, &curves)
}

/// A torus knot, which is right-handed if `q > 0`.
fn torus_knot(p: i32, q: i32, points: usize) -> Vec<[f64; 3]> {
    let turn = |k: usize| k as f64 * std::f64::consts::TAU / points as f64;
    let point = |k: usize| {
        let (t, s) = (f64::from(p) * turn(k), f64::from(q) * turn(k));
        let r = 2.0 + s.cos();
        [r * t.cos(), r * t.sin(), -s.sin()]
    };
    (0..points).map(point).collect()
}

fn knot(points: Vec<[f64; 3]>) -> Invariants {
    let set = set(&[points]);
    all(&set).unwrap().reduced().invariants().remove(0)
}

#[test]
fn torus_knots_have_their_invariants() {
    for (p, q) in [
        (2, 3),
        (2, 5),
        (2, 7),
        (3, 4),
        (3, 5),
        (4, 5),
        (5, 7),
        (3, 2),
    ] {
        for mirror in [1, -1] {
            let found = knot(torus_knot(p, mirror * q, 200));
            let [p, q] = [p, q].map(i64::from);
            assert_eq!(found.v2, (p * p - 1) * (q * q - 1) / 24, "({p}, {q})");
            let v3 = p * q * (p * p - 1) * (q * q - 1) / 144;
            assert_eq!(found.v3, Some(i64::from(mirror) * v3), "({p}, {q})");
            let determinant = match (p % 2, q % 2) {
                (0, _) => q,
                (_, 0) => p,
                _ => 1,
            };
            assert_eq!(
                found.determinant,
                Some(determinant.to_string()),
                "({p}, {q})"
            );
        }
    }
}

#[test]
fn small_knots_have_names() {
    let figure_eight = |k: i32| {
        let t = f64::from(k) * std::f64::consts::TAU / 120.0;
        let r = 2.0 + (2.0 * t).cos();
        [r * (3.0 * t).cos(), r * (3.0 * t).sin(), (4.0 * t).sin()]
    };
    let found = knot((0..120).map(figure_eight).collect());
    assert_eq!(
        (found.v2, found.v3, found.determinant.as_deref()),
        (-1, Some(0), Some("5"))
    );
    let name = found.name.unwrap();
    assert_eq!((name.symbol, name.right_handed), ("4_1", None));
    for (q, symbol) in [(3, "3_1"), (-3, "3_1"), (5, "5_1"), (1, "unknot")] {
        let name = knot(torus_knot(2, q, 90)).name.unwrap();
        let right_handed = (q.abs() > 1).then_some(q > 0);
        assert_eq!((name.symbol, name.right_handed), (symbol, right_handed));
        assert!(name.proven, "{q}");
    }
    assert_eq!(knot(torus_knot(3, 4, 90)).name, None);
}

/// Three rectangles in orthogonal planes, each through the next one.
fn borromean_rings() -> Vec<Vec<[f64; 3]>> {
    let [a, b] = [1.0, 2.0];
    let rectangle = [[-a, -b], [a, -b], [a, b], [-a, b]];
    let ring = |turn: usize| {
        let points = rectangle.map(|[x, y]| {
            let mut p = [x, y, 0.0];
            p.rotate_right(turn);
            p
        });
        points.to_vec()
    };
    (0..3).map(ring).collect()
}

#[test]
fn borromean_rings_have_a_triple_linking_number() {
    let mut rings = borromean_rings();
    let mu = |rings: &[Vec<[f64; 3]>]| {
        let diagram = all(&set(rings)).unwrap().reduced();
        assert!(diagram.links().is_empty());
        assert_eq!(diagram.parts().len(), 1);
        assert_eq!(diagram.link_determinant().as_deref(), Some("16"));
        let triples = diagram.triples();
        assert_eq!((triples.len(), triples[0].modulus), (1, 0));
        triples[0].mu
    };
    let first = mu(&rings);
    assert_eq!(first.abs(), 1);
    rings.rotate_left(1);
    assert_eq!(mu(&rings), first);
    rings.swap(0, 1);
    assert_eq!(mu(&rings), -first);
    rings[1].reverse();
    assert_eq!(mu(&rings), first);
}

#[test]
fn contact_and_degenerate_curves_are_reported() {
    let square = |x: f64, z: f64| {
        vec![
            [x, 0.0, z],
            [x + 2.0, 0.0, z],
            [x + 2.0, 2.0, z],
            [x, 2.0, z],
        ]
    };
    let defect = |curves: &[Vec<[f64; 3]>]| all(&set(curves)).unwrap_err();
    let found = defect(&[square(0.0, 0.0), square(1.0, 0.0)]);
    assert_eq!((found.i, found.j), (0, Some(1)));
    assert_eq!(found.place.distance, 0.0);
    assert_eq!(found.place.segments, [0, 0]);
    // A vertex on an edge, a curve that folds back, the same curve twice.
    let bow = vec![
        [0.0; 3],
        [2.0, 0.0, 0.0],
        [1.0, 1.0, 1.0],
        [1.0, 0.0, 0.0],
        [0.0, -1.0, 3.0],
    ];
    assert_eq!(defect(&[bow]).j, Some(0));
    let folded = vec![[0.0; 3], [2.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 3.0]];
    assert_eq!(defect(&[folded]).place.segments, [0, 1]);
    assert_eq!(defect(&[square(0.0, 0.0), square(0.0, 0.0)]).j, Some(1));
    let point = vec![[1.0; 3]; 4];
    assert_eq!(defect(&[point]).j, None);
    // Repeated vertices, vertices on straight lines, and curves above one another are fine.
    let mut repeated = square(0.0, 0.0);
    repeated.insert(1, [1.0, 0.0, 0.0]);
    repeated.insert(1, [0.5, 0.0, 0.0]);
    repeated.push([0.0, 2.0, 0.0]);
    repeated.push([0.0, 0.0, 0.0]);
    let stack = [repeated, square(0.0, 1.0), square(0.0, 2.0)];
    let diagram = all(&set(&stack)).unwrap().reduced();
    assert_eq!((diagram.crossings(), diagram.parts().len()), (0, 3));
}

/// Number of faces by Euler's formula: the code is that of a diagram in the plane.
fn check_planar(diagram: &Diagram) {
    for part in diagram.parts().iter().filter(|part| part.crossings() > 0) {
        let code = part.pd_code();
        let arcs = code.as_flattened();
        let mut seen = vec![false; arcs.len()];
        let mut faces = 0;
        for start in 0..arcs.len() {
            let mut at = start;
            faces += usize::from(!seen[at]);
            while !std::mem::replace(&mut seen[at], true) {
                let leave = at / 4 * 4 + (at + 1) % 4;
                let mut ends = (0..arcs.len()).filter(|&e| e != leave && arcs[e] == arcs[leave]);
                at = ends.next().unwrap();
                assert!(ends.next().is_none());
            }
        }
        assert_eq!(faces, code.len() + 2, "{}", part.pd_text());
    }
}

/// Random polygons, on a lattice half of the time, so that there are ties and contact.
fn random_polygons(random: &mut Random) -> Vec<Vec<[f64; 3]>> {
    let lattice = random.one_in(2);
    let curves = 1 + random.below(3usize);
    let polygon = |random: &mut Random| {
        let points = 4 + random.below(14usize);
        let point = |random: &mut Random| match lattice {
            true => [(); 3].map(|()| f64::from(random.below(9))),
            false => random.point(1.0),
        };
        (0..points).map(|_| point(random)).collect::<Vec<_>>()
    };
    (0..curves).map(|_| polygon(random)).collect()
}

fn turned(curves: &[Vec<[f64; 3]>], by: usize) -> Vec<Vec<[f64; 3]>> {
    let turn = |p: &[f64; 3]| {
        let mut p = *p;
        p.rotate_left(by);
        p
    };
    curves
        .iter()
        .map(|c| c.iter().map(turn).collect())
        .collect()
}

/// Invariants do not depend on the projection, on the start of a curve, or on Reidemeister moves.
/// Linking numbers equal those of certificates.
#[test]
fn invariants_do_not_depend_on_the_diagram() {
    let mut random = Random::new(7);
    let (mut compared, mut contacts, mut triples) = (0, 0, 0);
    while compared < 1500 {
        let curves = random_polygons(&mut random);
        let Ok(diagram) = all(&set(&curves)) else {
            contacts += 1;
            for by in 1..3 {
                assert!(all(&set(&turned(&curves, by))).is_err());
            }
            continue;
        };
        compared += 1;
        check_planar(&diagram);
        let reduced = diagram.clone().reduced();
        check_planar(&reduced);
        let [one, two] = reduced.moves();
        assert_eq!(
            diagram.crossings() as u64,
            reduced.crossings() as u64 + one + 2 * two
        );
        let certificate = crate::Certifier::default().certify(&set(&curves)).0.clone();
        let key = |d: &Diagram| {
            let links: Vec<_> = d.links().iter().map(|l| (l.i, l.j, l.lambda)).collect();
            let knots = d.invariants().into_iter();
            let knots: Vec<_> = knots.map(|k| (k.v2, k.v3, k.determinant)).collect();
            (knots, links, d.triples(), d.link_determinant())
        };
        let expected = key(&reduced);
        triples += expected.2.len();
        let links: Vec<_> = certificate
            .links()
            .iter()
            .map(|l| (l.i, l.j, l.lambda))
            .collect();
        assert_eq!(expected.1, links);
        assert_eq!(key(&diagram), expected);
        for by in 1..3 {
            let mut other = turned(&curves, by);
            for curve in &mut other {
                let start = random.below(curve.len());
                curve.rotate_left(start);
            }
            let other = all(&set(&other)).unwrap();
            assert_eq!(key(&other), expected);
        }
    }
    assert!(
        contacts > 20 && triples > 5,
        "{contacts} contacts, {triples} triples"
    );
}

#[test]
fn dt_codes_have_even_numbers_once_each() {
    let mut random = Random::new(8);
    for _ in 0..300 {
        let Ok(diagram) = all(&set(&random_polygons(&mut random))) else {
            continue;
        };
        let code = diagram.reduced();
        let mut numbers: Vec<i32> = code.dt_code().concat().iter().map(|n| n.abs()).collect();
        numbers.sort_unstable();
        let expected: Vec<i32> = (1..=code.crossings() as i32).map(|n| 2 * n).collect();
        assert_eq!(numbers, expected);
    }
}

#[test]
fn codes_of_a_trefoil_are_those_of_the_tables() {
    let diagram = all(&set(&[torus_knot(2, 3, 30)])).unwrap().reduced();
    assert_eq!(diagram.crossings(), 3);
    assert_eq!(diagram.signs(), [1, 1, 1]);
    assert!(
        diagram.pd_text().starts_with("PD[X["),
        "{}",
        diagram.pd_text()
    );
    assert_eq!(diagram.dt_text(), "DT: [(4, 6, 2)]");
    let gauss = diagram.gauss_text();
    assert!(
        [
            "GaussCode[1, -2, 3, -1, 2, -3]",
            "GaussCode[-1, 2, -3, 1, -2, 3]"
        ]
        .contains(&gauss.as_str()),
        "{gauss}"
    );
}

/// Splines through random points, against polylines of many chords.
#[test]
fn splines_have_the_invariants_of_fine_polylines() {
    let mut random = Random::new(9);
    let (mut knotted, mut undecided) = (0, 0);
    for case in 0..120 {
        let basis = [Basis::CatmullRom, Basis::BSpline][case % 2];
        let curves = 1 + case / 2 % 2;
        let points = 14;
        let xyz: Vec<f64> = (0..curves * points)
            .flat_map(|_| random.point(1.0))
            .collect();
        let counts = vec![-(points as i32); curves];
        let set = CurveSet::from_counts(basis, &counts, Positions::F64(&xyz)).unwrap();
        let fine = crate::chords(&set, 400).unwrap();
        let key = |set: &CurveSet| {
            let diagram = all(set)?.reduced();
            let knots = diagram.invariants().into_iter();
            let knots: Vec<_> = knots.map(|k| (k.v2, k.v3, k.determinant)).collect();
            let links: Vec<_> = diagram.links().iter().map(|l| l.lambda).collect();
            Ok::<_, Defect>((knots, links, diagram.link_determinant()))
        };
        match key(&set) {
            Ok(found) => {
                knotted += usize::from(found.0.iter().any(|k| k.2.as_deref() != Some("1")));
                assert_eq!(found, key(&fine).unwrap(), "{case}");
            }
            Err(_) => undecided += 1,
        }
    }
    assert!(
        knotted > 5 && undecided == 0,
        "{knotted} knotted, {undecided} undecided"
    );
}

#[test]
fn splines_in_contact_are_reported_with_their_segments() {
    let square = |x: f64| {
        [
            [x, 0.0, 0.0],
            [x + 2.0, 0.0, 0.0],
            [x + 2.0, 2.0, 0.0],
            [x, 2.0, 0.0],
        ]
    };
    let xyz: Vec<f64> = [square(9.0), square(1.0), square(0.0)]
        .as_flattened()
        .concat();
    let set = CurveSet::from_counts(Basis::CatmullRom, &[-4; 3], Positions::F64(&xyz)).unwrap();
    let defect = Diagram::of(&set, &[2, 0, 1]).unwrap_err();
    assert_eq!((defect.i, defect.j), (1, Some(2)));
    assert!(defect.place.segments.iter().all(|s| *s < 4));
    assert!(defect.place.distance < 1e-3, "{defect:?}");
    let found = diagrams(&set, true);
    let ok: Vec<(Vec<u32>, bool)> = found.into_iter().map(|(c, d)| (c, d.is_ok())).collect();
    let expected = [
        (vec![0], true),
        (vec![1], true),
        (vec![2], true),
        (vec![1, 2], false),
    ];
    assert_eq!(ok, expected);
}

/// A chain of three rings beside a ring with a knot in it.
#[test]
fn groups_are_the_connected_parts() {
    let mut curves = vec![torus_knot(2, 3, 60)];
    for k in 0..3 {
        let x = 10.0 + 1.2 * f64::from(k);
        let ring = [[x, 0.0], [x + 2.0, 0.0], [x + 1.0, 2.0]];
        let up = |[u, v]: [f64; 2]| match k % 2 {
            0 => [u, v - 0.5, 0.0],
            _ => [u, 0.1, v - 0.5],
        };
        curves.push(ring.map(up).to_vec());
    }
    let found = diagrams(&set(&curves), true);
    let curves: Vec<Vec<u32>> = found.iter().map(|(c, _)| c.clone()).collect();
    assert_eq!(curves, [vec![0], vec![1], vec![2], vec![3], vec![1, 2, 3]]);
    let chain = found[4].1.as_ref().unwrap();
    assert_eq!((chain.crossings(), chain.links().len()), (4, 2));
    assert_eq!(chain.link_determinant().as_deref(), Some("4"));
}

/// Closed braid as polygons. A positive generator `k` crosses the strands at places `k - 1` and
/// `k`.
fn closed_braid(strands: usize, word: &[i32]) -> Vec<Vec<[f64; 3]>> {
    let mut paths: Vec<Vec<[f64; 3]>> = (0..strands).map(|k| vec![[k as f64, 0.0, 0.0]]).collect();
    let mut at: Vec<usize> = (0..strands).collect();
    for (step, &letter) in word.iter().enumerate() {
        let (k, y) = (letter.unsigned_abs() as usize - 1, step as f64);
        for (place, &strand) in at.iter().enumerate() {
            let (to, z) = match place {
                _ if place == k => (k + 1, f64::from(letter.signum())),
                _ if place == k + 1 => (k, -f64::from(letter.signum())),
                _ => (place, 0.0),
            };
            let middle = (place as f64 + to as f64) / 2.0;
            paths[strand].extend([[middle, y + 0.5, z], [to as f64, y + 1.0, 0.0]]);
        }
        at.swap(k, k + 1);
    }
    // Back on the left, the first strand innermost.
    let end = word.len() as f64;
    for (place, &strand) in at.iter().enumerate() {
        let out = 1.0 + place as f64;
        let path = &mut paths[strand];
        path.extend([[place as f64, end + out, 0.0], [-out, end + out, 0.0]]);
        path.extend([[-out, -out, 0.0], [place as f64, -out, 0.0]]);
    }
    let mut curves = Vec::new();
    let mut left: Vec<usize> = (0..strands).collect();
    while let Some(&first) = left.first() {
        let (mut curve, mut strand) = (Vec::new(), first);
        while let Some(k) = left.iter().position(|&s| s == strand) {
            left.remove(k);
            curve.extend(paths[strand].iter().copied());
            strand = at.iter().position(|&s| s == strand).unwrap();
        }
        curves.push(curve);
    }
    curves
}

/// Links of Milnor: the closure of the commutator of the `n`-th power of a pure braid of strands 1
/// and 2 with one of strands 2 and 3.
#[test]
fn commutators_have_triple_linking_numbers() {
    let mut found = Vec::new();
    for n in -3_i32..=3 {
        let power = |sign: i32| vec![sign * n.signum(); 2 * n.unsigned_abs() as usize];
        let word = [power(1), vec![2, 2], power(-1), vec![-2, -2]].concat();
        let diagram = all(&set(&closed_braid(3, &word))).unwrap().reduced();
        assert!(diagram.links().is_empty());
        let triples = diagram.triples();
        found.push(triples.first().map_or(0, |t| t.mu));
    }
    let sign = found[6].signum();
    assert_eq!(found, [-3, -2, -1, 0, 1, 2, 3].map(|n| n * sign));
}

/// With linking number 2 of two curves, the number is defined modulo 2.
#[test]
fn triple_linking_numbers_have_a_modulus() {
    for (n, mu) in [(1, Some(1)), (2, None), (3, Some(1))] {
        let word = [
            vec![1; 2 * n],
            vec![2, 2],
            vec![-1; 2 * n],
            vec![-2, -2, 1, 1, 1, 1],
        ];
        let diagram = all(&set(&closed_braid(3, &word.concat()))).unwrap();
        let triples: Vec<_> = diagram
            .triples()
            .iter()
            .map(|t| (t.mu, t.modulus))
            .collect();
        assert_eq!(triples, Vec::from_iter(mu.map(|mu| (mu, 2))), "{n}");
    }
}

fn feed(session: &mut crate::Session, seq: u64, curves: &[Vec<[f64; 3]>]) -> crate::Report {
    session
        .feed(crate::FrameInfo::at(seq, 0.0), set(curves))
        .unwrap()
}

fn session(options: crate::SessionOptions) -> crate::Session {
    crate::Session::new(options).unwrap()
}

#[test]
fn a_session_compares_invariants() {
    let options = crate::SessionOptions {
        invariants: InvariantKind::ALL.to_vec(),
        ..Default::default()
    };
    let far = |curve: Vec<[f64; 3]>| curve.iter().map(|p| [p[0] + 20.0, p[1], p[2]]).collect();
    let mut frame = borromean_rings();
    frame.push(far(torus_knot(2, 3, 60)));
    let mut rings_apart = frame.clone();
    rings_apart[0].iter_mut().for_each(|p| p[2] += 9.0);
    let mut unknotted = frame.clone();
    unknotted[3] = far(torus_knot(2, 1, 60));
    let mut touching = frame.clone();
    touching[3] = far(torus_knot(2, 0, 60));
    let mut of_frames = session(options.clone());
    assert_eq!(
        feed(&mut of_frames, 0, &frame).verdict,
        crate::Verdict::Intact
    );
    let report = feed(&mut of_frames, 1, &rings_apart);
    assert_eq!(report.verdict, crate::Verdict::Changed);
    assert!(report.changes.is_empty() && report.abort);
    assert_eq!(report.invariants[0].curves, [0, 1, 2]);
    assert_eq!(report.invariants[0].found, "mu 0");
    let report = feed(&mut of_frames, 2, &unknotted);
    let sentences: Vec<String> = report.findings().collect();
    let expected = "the knot of curve 3 changed: was v2 1, v3 1, determinant 3, is v2 0, v3 0, \
                    determinant 1";
    assert_eq!(sentences, [expected]);
    let report = feed(&mut of_frames, 3, &touching);
    assert_eq!(report.verdict, crate::Verdict::Contact);
    assert_eq!((report.defects[0].i, report.defects[0].j), (3, Some(3)));
    assert_eq!(
        feed(&mut of_frames, 4, &frame).verdict,
        crate::Verdict::Intact
    );
    // The baseline is the certificate of a file, which also determines what is compared.
    let mut certificate = crate::Certifier::default()
        .certify(&set(&unknotted))
        .0
        .clone();
    for kind in InvariantKind::ALL {
        assert!(
            certificate
                .add_invariants(&set(&unknotted), kind)
                .is_empty()
        );
    }
    let read = crate::Certificate::parse(&certificate.to_string()).unwrap();
    assert_eq!(read, certificate);
    let mut of_file = session(crate::SessionOptions {
        baseline: Some(read),
        ..Default::default()
    });
    assert_eq!(feed(&mut of_file, 0, &frame).invariants[0].curves, [3]);
    // A resumed session keeps the expected invariants.
    let mut resumed = crate::Session::resume(options, of_frames.state()).unwrap();
    assert_eq!(feed(&mut resumed, 5, &unknotted).invariants.len(), 1);
}

/// Regression test: a curve that touches itself had no triple linking numbers, in silence.
#[test]
fn triples_of_curves_that_touch_themselves_are_compared() {
    let options = crate::SessionOptions {
        invariants: vec![InvariantKind::Triple],
        ..Default::default()
    };
    let mut rings = borromean_rings();
    // A spur to the middle and back, and a loop around the start.
    let start = rings[0][0];
    rings[0].extend([start, [0.1, 0.2, 0.3], start]);
    let mut of_frames = session(options);
    assert_eq!(
        feed(&mut of_frames, 0, &rings).verdict,
        crate::Verdict::Intact
    );
    rings[1].iter_mut().for_each(|p| p[2] += 9.0);
    let report = feed(&mut of_frames, 1, &rings);
    assert_eq!(report.verdict, crate::Verdict::Changed);
    assert_eq!(report.invariants[0].curves, [0, 1, 2]);
}

/// The crossings of a curve with itself have no influence on linking numbers and triples.
#[test]
fn triples_need_the_crossings_of_different_curves_only() {
    let mut random = Random::new(17);
    let mut found = [0; 2];
    for case in 0..500 {
        let curves = 3 + random.below(3usize);
        let size = if random.one_in(3) { 20.0 } else { 1.0 };
        let polygon = |random: &mut Random| -> Vec<[f64; 3]> {
            let points = 4 + random.below(12usize);
            (0..points)
                .map(|_| match size == 1.0 {
                    true => random.point(1.0),
                    // Vertices above one another.
                    false => [(); 3].map(|()| f64::from(random.below(9))),
                })
                .collect()
        };
        let polygons: Vec<_> = (0..curves).map(|_| polygon(&mut random)).collect();
        let counts = polygons.iter().map(|p| -(p.len() as i32));
        let counts: Vec<i32> = counts.collect();
        let xyz = polygons.concat().concat();
        let basis = [Basis::Polyline, Basis::CatmullRom][random.below(2usize)];
        let set = CurveSet::from_counts(basis, &counts, Positions::F64(&xyz)).unwrap();
        let all: Vec<u32> = (0..curves as u32).collect();
        let (whole, between) = (
            Diagram::of(&set, &all),
            LinkHomotopic::new(&set).diagram(&all),
        );
        if let Ok(whole) = whole {
            let between = between.expect("curves that touch nothing");
            assert_eq!(between.links(), whole.links(), "{case}");
            let triples = whole.triples();
            assert_eq!(between.reduced().triples(), triples, "{case}");
            found[0] += usize::from(!triples.is_empty());
        } else if between.is_ok() {
            found[1] += 1;
        }
    }
    assert!(found[0] > 50 && found[1] > 5, "{found:?}");
}

/// Moves vertices of random polygons. Each passage of the curve through itself changes `v2` by the
/// linking number of its two parts.
fn check_passages(polygons: u64, seed: u64) {
    let mut random = Random::new(seed);
    let (mut passages, mut several, mut knots, mut undecided) = (0, 0, 0, 0);
    for case in 0..polygons {
        let points = 7 + random.below(12usize);
        let lattice = random.one_in(8);
        let point = |random: &mut Random| match lattice {
            true => [(); 3].map(|()| f64::from(random.below(9))),
            false => random.point(1.0),
        };
        let before: Vec<[f64; 3]> = (0..points).map(|_| point(&mut random)).collect();
        let mut after = before.clone();
        for _ in 0..1 + random.below(3usize) {
            let k = random.below(points);
            after[k] = point(&mut random);
        }
        let mut of_step = session(crate::SessionOptions {
            events: crate::Events::All,
            motion_limit: Some(f64::INFINITY),
            ..Default::default()
        });
        let _ = feed(&mut of_step, 0, std::slice::from_ref(&before));
        let report = feed(&mut of_step, 1, std::slice::from_ref(&after));
        let unaccounted = |d: &Defect| d.kind == crate::DefectKind::Unaccounted;
        assert!(
            !report.defects.iter().any(unaccounted),
            "{case} of {seed}: {report:?}"
        );
        let [a, b] = [&before, &after].map(|p| set(std::slice::from_ref(p)));
        let events: Vec<_> = report.events.iter().collect();
        match change_of_v2([&a, &b], 0, &events) {
            Some([found, expected]) if report.defects.is_empty() => {
                assert_eq!(found, expected, "{case} of {seed}");
                passages += events.len();
                several += usize::from(events.len() > 1);
                knots += usize::from(found != 0);
            }
            _ => undecided += 1,
        }
    }
    println!(
        "{polygons} steps: {passages} passages, {several} steps with several, {knots} changes of \
         v2, {undecided} undecided"
    );
    assert!(passages as u64 > polygons / 4 && undecided < polygons / 5);
}

#[test]
fn passages_of_a_curve_through_itself_change_v2() {
    check_passages(1000, 1);
}

/// `cargo test --release --lib -- --ignored twenty_thousand_steps --nocapture`
#[test]
#[ignore = "takes a minute"]
fn passages_change_v2_in_twenty_thousand_steps() {
    check_passages(20_000, 2);
}
