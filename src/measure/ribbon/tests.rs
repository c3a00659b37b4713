//! `Lk = Tw + Wr` on random ribbons, and ribbons with known numbers.

use super::*;
use crate::curve::vector::{add_scaled, cross, dot, norm, per_axis, sub};
use crate::curve::{Basis, Positions};
use crate::random::Random;
use crate::scenes::Scene;
use crate::{Events, FrameInfo, Session, SessionOptions, Verdict};
use std::f64::consts::{PI, TAU};

const ANTIPARALLEL: Pairing = Pairing {
    antiparallel: true,
    shift: 0,
};

fn set(strands: &[Vec<Point>]) -> CurveSet {
    let counts: Vec<i32> = strands.iter().map(|s| -(s.len() as i32)).collect();
    let points: Vec<f64> = strands.iter().flatten().flatten().copied().collect();
    CurveSet::from_counts(Basis::Polyline, &counts, Positions::F64(&points)).unwrap()
}

fn about(axis: Axis, tolerance: f64) -> RibbonOptions {
    RibbonOptions {
        axis,
        tolerance,
        ..RibbonOptions::default()
    }
}

/// Returns a smooth random closed axis: a Fourier series with a few terms.
fn axis(random: &mut Random, n: usize) -> Vec<Point> {
    let terms: Vec<[Point; 2]> = (0..4)
        .map(|k| [1, 2].map(|_| random.point(1.0 / f64::from(k + 1))))
        .collect();
    let at = |k: usize| {
        let t = k as f64 / n as f64 * TAU;
        let mut p = [0.0; 3];
        for (m, [a, b]) in terms.iter().enumerate() {
            let (s, c) = ((m + 1) as f64 * t).sin_cos();
            p = add_scaled(add_scaled(p, c, *a), s, *b);
        }
        p
    };
    (0..n).map(at).collect()
}

/// Returns the edge of a ribbon around an axis, at a distance of about `width`. It turns `turns`
/// times with respect to a parallel transported frame, plus the angle by which that frame fails to
/// close.
fn edge(axis: &[Point], width: f64, turns: f64, random: &mut Random) -> Vec<Point> {
    let n = axis.len();
    let tangent = |k: usize| {
        let t = sub(axis[(k + 1) % n], axis[(k + n - 1) % n]);
        t.map(|x| x / norm(t))
    };
    let mut normal = [0.3, 0.5, 0.8];
    let mut frame = Vec::new();
    for k in 0..n {
        let t = tangent(k);
        normal = add_scaled(normal, -dot(normal, t), t);
        normal = normal.map(|x| x / norm(normal));
        frame.push((t, normal));
    }
    // The angle by which the frame fails to close, spread evenly.
    let (t, first) = frame[0];
    let last = add_scaled(normal, -dot(normal, t), t);
    let gap = dot(t, cross(last, first)).atan2(dot(last, first));
    let turn = |k: usize| (gap + TAU * turns) * k as f64 / n as f64;
    let vertex = |(k, &(t, normal)): (usize, &(Point, Point))| {
        let (s, c) = (turn(k) + 0.2 * random.unit()).sin_cos();
        let across = add_scaled(normal.map(|x| c * x), s, cross(t, normal));
        let along = 0.3 * random.between(-1.0, 1.0);
        add_scaled(axis[k], width, add_scaled(across, along, t))
    };
    frame.iter().enumerate().map(vertex).collect()
}

/// Returns the least distance of vertices of the axis that are not adjacent.
fn clearance(axis: &[Point]) -> f64 {
    let n = axis.len();
    let mut least = f64::INFINITY;
    for i in 0..n {
        for j in i + 2..n.min(n + i - 1) {
            least = least.min(norm(sub(axis[i], axis[j])));
        }
    }
    least
}

/// Returns true if every corner of the axis turns by less than 60 degrees. Then the ribbon does not
/// cross the axis at a corner: that needs an edge whose direction is between both tangents, but
/// edges are more than 70 degrees from the tangents.
fn is_blunt(axis: &[Point]) -> bool {
    let n = axis.len();
    (0..n).all(|k| {
        let [p, q] = [k, k + 1].map(|k| sub(axis[(k + 1) % n], axis[k % n]));
        dot(p, q) > 0.5 * norm(p) * norm(q)
    })
}

/// Checks `Lk = Tw + Wr`, and returns the largest residual, the largest bound and the number of
/// ribbons.
fn random_ribbons(seed: u64, count: usize) -> (f64, f64, usize) {
    let mut random = Random::new(seed);
    let (mut residual, mut bound, mut done) = (0f64, 0f64, 0);
    let mut linkings = std::collections::BTreeSet::new();
    while done < count {
        let n = 60 + random.below(140usize);
        let axis = axis(&mut random, n);
        if !is_blunt(&axis) {
            continue;
        }
        let width = 0.02 * clearance(&axis);
        let turns = random.below(13) as f64 - 6.0;
        let edge = edge(&axis, width, turns, &mut random);
        let axis_of = random.pick(&[Axis::Centre, Axis::First]);
        let ribbon = Ribbon::of(&set(&[axis, edge]), [0, 1], about(axis_of, 1e-9)).unwrap();
        let found = ribbon.residual();
        assert!(found.bound < 1e-6, "{done}: {ribbon:?}");
        assert!(
            found.value.abs() <= found.bound,
            "{done}: {found:?} {ribbon:?}"
        );
        assert_eq!(ribbon.passages(), Some(0));
        assert_eq!(ribbon.pairing, Pairing::PARALLEL);
        linkings.insert(ribbon.linking);
        residual = residual.max(found.value.abs());
        bound = bound.max(found.bound);
        done += 1;
    }
    assert!(linkings.len() > 9, "{linkings:?}");
    (residual, bound, done)
}

#[test]
fn linking_is_twist_plus_writhe_on_random_ribbons() {
    let (residual, bound, count) = random_ribbons(1, 1000);
    println!("{count} ribbons: |Lk - Tw - Wr| <= {residual:.1e}, bounds <= {bound:.1e}");
}

#[test]
fn a_wide_strip_that_passes_through_its_axis_has_an_integer_residual() {
    let mut random = Random::new(5);
    let mut passing = 0;
    for _ in 0..100 {
        let axis = axis(&mut random, 80);
        let edge = edge(&axis, 0.8, 3.0, &mut random);
        let found = Ribbon::of(&set(&[axis, edge]), [0, 1], about(Axis::First, 1e-9)).unwrap();
        let Some(k) = found.passages() else {
            assert!(found.residual().bound > 0.3, "{found:?}");
            continue;
        };
        let residual = found.residual();
        assert!(
            (residual.value - k as f64).abs() <= residual.bound,
            "{found:?}"
        );
        passing += usize::from(k != 0);
    }
    assert!(passing > 10, "{passing}");
}

#[test]
fn generated_ribbons_have_their_linking_number_as_twist() {
    for (segments, lambda) in [(2000, 10), (2000, -7), (20000, 40)] {
        let scene: Scene = format!("ribbon:segments={segments},lambda={lambda}")
            .parse()
            .unwrap();
        let curves = scene.build().unwrap().curves;
        for axis in [Axis::Centre, Axis::First] {
            let ribbon = Ribbon::of(&curves, [0, 1], about(axis, 1e-3)).unwrap();
            assert_eq!(ribbon.linking, Some(lambda));
            assert_eq!(ribbon.passages(), Some(0), "{ribbon:?}");
            assert!(ribbon.residual().bound < 2e-3, "{ribbon:?}");
        }
        // The centre line is nearly a circle; a strand winds around it.
        let centre = Ribbon::of(&curves, [0, 1], about(Axis::Centre, 1e-3)).unwrap();
        assert!(centre.writhe.value.abs() < 0.01, "{centre:?}");
    }
}

#[test]
fn a_strand_in_the_opposite_direction_is_reversed() {
    let mut random = Random::new(3);
    let axis = axis(&mut random, 90);
    let edge = edge(&axis, 0.01, 4.0, &mut random);
    let of = |edge: &Vec<Point>| {
        let both = set(&[axis.clone(), edge.clone()]);
        Ribbon::of(&both, [0, 1], about(Axis::First, 1e-9)).unwrap()
    };
    let expected = of(&edge);
    let mut back = edge.clone();
    back.reverse();
    let mut same_start = back.clone();
    same_start.rotate_right(1);
    for strand in [back, same_start] {
        let found = of(&strand);
        assert_eq!(
            (found.linking, found.pairing.antiparallel),
            (expected.linking, true)
        );
        assert_eq!(found.twist, expected.twist);
    }
}

#[test]
fn curves_that_are_no_strands_are_refused_with_a_reason() {
    let square = vec![[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]];
    let mut five = square.clone();
    five.push([-1., 0.5, 0.]);
    let both = set(&[square.clone(), five]);
    let reason = |set: &CurveSet, pair| match Ribbon::of(set, pair, about(Axis::Centre, 1e-6)) {
        Err(e) => e.to_string(),
        Ok(found) => panic!("{found:?}"),
    };
    assert!(reason(&both, [0, 1]).contains("4 and 5 vertices"));
    assert!(reason(&both, [0, 0]).contains("two different curves"));
    assert!(reason(&both, [0, 7]).contains("0 to 1"));
    let points: Vec<f64> = square.iter().chain(&square).flatten().copied().collect();
    let open = CurveSet::from_counts(Basis::Polyline, &[4, -4], Positions::F64(&points)).unwrap();
    assert!(reason(&open, [0, 1]).contains("curve 0 is open"));
    // Two strands that are the same curve touch everywhere.
    let same = set(&[square.clone(), square]);
    let ribbon = Ribbon::of(&same, [0, 1], about(Axis::First, 1e-6)).unwrap();
    assert_eq!((ribbon.linking, ribbon.passages()), (None, None));
    assert!(ribbon.contact.is_some());
}

#[test]
fn a_strand_passage_changes_lk_by_two_in_the_ledger() {
    // The strands of a ribbon along a figure eight, which passes through itself at its crossing.
    let n = 100;
    let strands = |height: f64| {
        let strand = |side: f64| -> Vec<Point> {
            let vertex = |k: usize| {
                let t = (k as f64 + 0.3) / n as f64 * TAU;
                [t.sin(), (2.0 * t).sin(), height * t.cos() + side]
            };
            (0..n).map(vertex).collect()
        };
        set(&[strand(-0.03), strand(0.03)])
    };
    let mut session = Session::new(SessionOptions {
        events: Events::All,
        ..SessionOptions::default()
    })
    .unwrap();
    let frames = [strands(0.05), strands(-0.05)];
    let first = session.feed(FrameInfo::at(0, 0.0), &frames[0]).unwrap();
    assert_eq!(first.verdict, Verdict::Intact);
    let report = session.feed(FrameInfo::at(1, 1.0), &frames[1]).unwrap();
    let change = report.changes[0].found - report.changes[0].expected;
    assert_eq!((report.changes.len(), change.abs()), (1, 2));
    let passages = |i, j| -> Vec<i32> {
        let all = report.events.iter();
        let these = all.filter(|p| (p.i, p.j) == (i, j));
        these.map(|p| p.sign).collect()
    };
    let sign = change.signum() as i32;
    assert_eq!(passages(0, 1), [sign; 2]);
    assert_eq!((passages(0, 0), passages(1, 1)), (vec![sign], vec![sign]));

    let [before, after] =
        frames.map(|frame| Ribbon::of(&frame, [0, 1], about(Axis::Centre, 1e-9)).unwrap());
    for ribbon in [&before, &after] {
        assert_eq!(ribbon.passages(), Some(0), "{ribbon:?}");
    }
    let [from, to] = [&before, &after].map(|ribbon| ribbon.linking.unwrap());
    assert_eq!(to - from, change);
    // The writhe jumps by 2 there, but the twist is continuous and changes little.
    let jump = after.writhe.value - before.writhe.value;
    assert!((jump - change as f64).abs() < 0.5, "{before:?} {after:?}");
}

/// Double helix around a circle, as DNA is.
#[derive(Clone, Copy)]
struct Helix {
    pairs: usize,
    turns: f64,
    /// Angle between the vertices of a pair, seen along the axis: less than half a turn if one
    /// groove is narrower than the other one.
    groove: f64,
    /// Deviation of each coordinate, as from thermal motion.
    noise: f64,
}

/// Relaxed minicircle of 210 base pairs, in units of the radius of the helix.
const DNA: Helix = Helix {
    pairs: 210,
    turns: 20.0,
    groove: PI,
    noise: 0.0,
};

impl Helix {
    /// Returns both strands: the second one in the direction of the first, pair by pair.
    fn strands(self) -> [Vec<Point>; 2] {
        let mut random = Random::new(11);
        let n = self.pairs as f64;
        let radius = 0.34 * n / TAU;
        [0.5 * self.groove, -0.5 * self.groove].map(|phase| {
            let vertex = |k: usize| {
                let (s, c) = (TAU * k as f64 / n).sin_cos();
                let (z, out) = (TAU * self.turns * k as f64 / n + phase).sin_cos();
                let exact = [(radius + out) * c, (radius + out) * s, z];
                let deviation = random.point(self.noise);
                per_axis(|x| exact[x] + deviation[x])
            };
            (0..self.pairs).map(vertex).collect()
        })
    }

    /// Returns the ribbon if the second strand is stored in another order.
    fn stored(self, order: impl Fn(&mut Vec<Point>), pairing: Option<Pairing>) -> Ribbon {
        let [first, mut second] = self.strands();
        order(&mut second);
        let options = RibbonOptions {
            pairing,
            ..RibbonOptions::default()
        };
        Ribbon::of(&set(&[first, second]), [0, 1], options).unwrap()
    }
}

fn antiparallel(shift: usize) -> Pairing {
    Pairing {
        antiparallel: true,
        shift,
    }
}

#[test]
fn strands_of_dna_that_are_stored_from_5_to_3_are_paired_by_base() {
    let narrow = Helix { groove: 2.4, ..DNA };
    let large = Helix {
        pairs: 5250,
        turns: 500.0,
        ..narrow
    };
    for helix in [DNA, narrow, large] {
        let found = helix.stored(|strand| strand.reverse(), None);
        assert_eq!(found.pairing, ANTIPARALLEL);
        assert_eq!(found.reason, PairingReason::Order);
        let turns = helix.turns;
        assert_eq!(found.linking.map(i64::abs), Some(turns as i64));
        if helix.groove == PI {
            // The centre line is the axis of the helix, a flat circle.
            assert!((found.twist.value.abs() - turns).abs() < 1e-6, "{found:?}");
            assert!(found.writhe.value.abs() < 1e-3, "{found:?}");
        }
        let parallel = helix.stored(|_| {}, None);
        assert_eq!(parallel.pairing, Pairing::PARALLEL);
        assert_eq!(parallel.linking, found.linking);
        assert!((parallel.twist.value - found.twist.value).abs() < 1e-9);
        assert!(found.rivals.is_empty() && parallel.rivals.is_empty());
    }
}

#[test]
fn strands_that_start_at_other_bases_are_paired_by_constant_distances() {
    let narrow = Helix { groove: 2.4, ..DNA };
    for helix in [DNA, narrow] {
        let [expected, ahead] = [0, 1].map(|shift| {
            let rotated = helix.stored(|s| s.rotate_left(shift), Some(Pairing::PARALLEL));
            rotated.twist.value
        });
        assert!((expected - ahead).abs() > 0.5);
        for shift in [1, 2, 5, 100, 209] {
            let reversed = |strand: &mut Vec<Point>| {
                strand.reverse();
                strand.rotate_right(shift);
            };
            let found = helix.stored(reversed, None);
            assert_eq!(found.pairing, antiparallel(shift));
            assert_eq!(found.reason, PairingReason::Distances);
            assert!((found.twist.value - expected).abs() < 1e-9, "{found:?}");
            let found = helix.stored(|strand| strand.rotate_right(shift), None);
            let parallel = Pairing {
                antiparallel: false,
                shift,
            };
            assert_eq!(found.pairing, parallel);
            assert!((found.twist.value - expected).abs() < 1e-9, "{found:?}");
        }
    }
}

#[test]
fn thermal_motion_does_not_change_the_pairing_and_is_reported() {
    let noisy = Helix { noise: 0.15, ..DNA };
    let found = noisy.stored(|strand| strand.reverse(), None);
    assert_eq!(found.pairing, ANTIPARALLEL);
    assert!((found.twist.value.abs() - 20.0).abs() < 0.2, "{found:?}");
    // The distances of other bases vary as much, and their twist differs by one turn or more.
    assert!(!found.rivals.is_empty());
    let moved = |strand: &mut Vec<Point>| {
        strand.reverse();
        strand.rotate_right(70);
    };
    let found = noisy.stored(moved, None);
    assert_eq!(found.pairing, antiparallel(70));
    let given = noisy.stored(moved, Some(antiparallel(69)));
    assert_eq!(
        (given.reason, given.rivals.len()),
        (PairingReason::Given, 0)
    );
    assert!((given.twist.value - found.twist.value).abs() > 0.5);
}

#[test]
fn the_edge_of_a_strip_is_paired_with_the_nearest_vertices() {
    // Two circles. Their vertices have constant distances for every shift.
    let circle = |radius: f64| -> Vec<Point> {
        let at = |k: usize| {
            let (s, c) = (TAU * k as f64 / 100.0).sin_cos();
            [radius * c, radius * s, 0.0]
        };
        (0..100).map(at).collect()
    };
    for (width, shift) in [(0.001, 7), (0.05, 0), (0.3, 0)] {
        let (first, mut second) = (circle(1.0), circle(1.0 + width));
        second.rotate_right(shift);
        let both = set(&[first, second]);
        let found = Ribbon::of(&both, [0, 1], RibbonOptions::default()).unwrap();
        let Pairing { antiparallel, .. } = found.pairing;
        assert_eq!((antiparallel, found.pairing.shift), (false, shift));
        assert_eq!((found.linking, found.rivals.len()), (Some(0), 0));
        assert!(found.twist.value.abs() < 1e-9);
    }
}

#[test]
fn pairings_are_written_as_they_are_read() {
    for text in ["parallel", "antiparallel", "parallel:3", "antiparallel:1"] {
        assert_eq!(text.parse::<Pairing>().unwrap().to_string(), text);
    }
    for wrong in ["", "anti", "parallel:", "parallel:-1", "antiparallel:x"] {
        let error = wrong.parse::<Pairing>().unwrap_err().to_string();
        assert!(
            error.contains("expected auto, parallel, antiparallel"),
            "{error}"
        );
    }
    let partners = |pairing: Pairing| [0, 1, 4].map(|k| pairing.partner(k, 5));
    assert_eq!(partners(ANTIPARALLEL), [4, 3, 0]);
    assert_eq!(partners(antiparallel(1)), [0, 4, 1]);
}
