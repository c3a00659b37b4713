//! Random frames whose points move within their allowances.

use super::*;
use crate::curve::vector::{distance, norm, per_axis, sub};
use crate::curve::{Basis, Point, Positions};
use crate::incremental::affine::Affine;
use crate::incremental::ledger::Ledger;
use crate::incremental::quiet_bounds::QuietBounds;

use crate::engine::Certifier;
use proptest::prelude::*;

/// A few curves.
#[derive(Clone, Debug)]
struct Curves {
    basis: Basis,
    counts: Vec<i32>,
    xyz: Vec<f64>,
    double: bool,
}

impl Curves {
    fn set(&self, xyz: &[f64]) -> CurveSet {
        let narrow: Vec<f32> = xyz.iter().map(|&x| x as f32).collect();
        let positions = match self.double {
            true => Positions::F64(xyz),
            false => Positions::F32(&narrow),
        };
        CurveSet::from_counts(self.basis, &self.counts, positions).unwrap()
    }
}

/// Returns a wavy ring, an arc of one, or arbitrary points.
fn points(n: usize) -> impl Strategy<Value = Vec<Point>> {
    let vector = || prop::array::uniform3(-1.0f64..1.0);
    let ring = (
        vector(),
        vector(),
        vector(),
        vector(),
        0.0..0.3f64,
        1u8..5,
        0.3..1.0f64,
    );
    let ring = ring.prop_map(move |(center, u, v, w, size, f, part)| -> Vec<Point> {
        (0..n)
            .map(|k| {
                let t = part * std::f64::consts::TAU * k as f64 / n as f64;
                let wave = size * (f64::from(f) * t).cos();
                let at = |x: usize| t.cos() * u[x] + t.sin() * v[x] + wave * w[x];
                per_axis(|x| center[x] + 2.0 * at(x))
            })
            .collect()
    });
    prop_oneof![3 => ring, 1 => prop::collection::vec(prop::array::uniform3(-2.0..2.0f64), n)]
}

fn random_curves() -> impl Strategy<Value = Curves> {
    let basis = prop::sample::select(Basis::ALL.to_vec());
    let curve = (any::<bool>(), 2usize..14);
    let curves = prop::collection::vec(curve, 1..4);
    (basis, curves, any::<bool>()).prop_flat_map(|(basis, curves, double)| {
        let counts: Vec<i32> = curves
            .iter()
            .map(|&(closed, n)| match (basis, closed) {
                (Basis::Bezier, true) => -3 * n as i32,
                (Basis::Bezier, false) => 3 * n as i32 + 1,
                (_, true) => -(n as i32) - 1,
                (_, false) => n as i32 + 3,
            })
            .collect();
        let all: Vec<_> = counts
            .iter()
            .map(|n| points(n.unsigned_abs() as usize))
            .collect();
        all.prop_map(move |points| Curves {
            basis,
            counts: counts.clone(),
            xyz: points.into_iter().flatten().flatten().collect(),
            double,
        })
    })
}

/// Direction in which points move.
#[derive(Clone, Copy, Debug)]
enum Direction {
    /// A separate random direction for each point.
    Each,
    /// One random direction for each curve.
    Together,
    /// Towards the nearest point of another curve, or of a distant part of the same one.
    Near,
    /// Towards the previous or the next point.
    Fold,
}

/// Moves every point as far as its allowance permits.
fn moved(curves: &Curves, reference: &Reference, seed: u64, direction: Direction) -> CurveSet {
    let mut state = seed | 1;
    let mut random = move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    };
    let set = &reference.set;
    let mut xyz = Vec::new();
    for i in 0..set.len() {
        let whole = [0; 3].map(|_| random());
        for (k, slot) in set.points_of(i).zip(set.body(i)) {
            let p = set.at(slot);
            let others = (0..set.len()).flat_map(|j| set.body(j));
            let v = match direction {
                Direction::Each => [0; 3].map(|_| random()),
                Direction::Together => whole,
                Direction::Near => others
                    .filter(|&q| !set.body(i).contains(&q) || q.abs_diff(slot) > 2)
                    .map(|q| sub(set.at(q), p))
                    .min_by(|&v, &w| norm(v).total_cmp(&norm(w)))
                    .unwrap_or(whole),
                Direction::Fold => {
                    let to = if random() < 0.0 {
                        slot.wrapping_sub(1)
                    } else {
                        slot + 1
                    };
                    match set.body(i).contains(&to) {
                        true => sub(set.at(to), p),
                        false => whole,
                    }
                }
            };
            let allowed = f64::from(reference.allowances[k]).min(10.0);
            let scale = 0.999_999 * allowed / norm(v).max(1e-9);
            let mut q = per_axis(|x| p[x] + scale * v[x]);
            if !curves.double {
                q = q.map(|x| f64::from(x as f32));
            }
            xyz.extend(if distance(q, p) <= allowed { q } else { p });
        }
    }
    curves.set(&xyz)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(3000))]

    /// No covered curves meet between two frames within the allowances, so the ledger has no
    /// entry.
    #[test]
    fn no_covered_curves_meet_within_the_allowances(
        curves in random_curves(),
        self_crossings in any::<bool>(),
        open_curves in any::<bool>(),
        seeds in prop::array::uniform2(any::<u64>()),
        directions in prop::array::uniform2(prop::sample::select(vec![
            Direction::Each,
            Direction::Together,
            Direction::Near,
            Direction::Fold,
        ])),
    ) {
        let set = curves.set(&curves.xyz);
        let certificate = Certifier::default().certify(&set).0.clone();
        let mut ledger = Ledger::default();
        let coverage = Coverage {
                self_crossings,
                open_curves,
            };
        // Pairs that are too close to decide remain so.
        let unknown = ledger.first_step(&set, &set, coverage, None).undecided;
        let frame = set.clone().into();
        let (certificate, needed) = (Arc::new(certificate), Cancel::default());
        let reference =
            Reference::build(&frame, certificate, 0, coverage, None, MOST_NEAR, &needed);
        let reference = reference.unwrap();
        prop_assert!(reference.allowances.iter().all(|&a| a >= 0.0));
        let [a, b] = [0, 1].map(|k| moved(&curves, &reference, seeds[k], directions[k]));
        for (before, after) in [(&set, &a), (&set, &b), (&a, &b)] {
            let outcome = ledger.first_step(before, after, coverage, None);
            prop_assert_eq!(&outcome.events, &[]);
            for defect in &outcome.undecided {
                let known = unknown.iter().any(|u| (u.i, u.j) == (defect.i, defect.j));
                prop_assert!(known, "{defect:?}");
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1000))]

    /// All control points of a frame whose points stay within their allowances, after any affine
    /// map, are within the bounds that need not read them.
    #[test]
    fn frames_within_the_allowances_are_within_their_quiet_bounds(
        curves in random_curves(),
        seed in any::<u64>(),
        direction in prop::sample::select(vec![Direction::Each, Direction::Together]),
        map in prop::array::uniform9(-0.3..0.3f64),
        shift in prop::array::uniform3(-20.0..20.0f64),
        rows in prop::array::uniform3(prop::array::uniform3(-2.0..2.0f64)),
    ) {
        let set = curves.set(&curves.xyz);
        let certificate = Arc::new(Certifier::default().certify(&set).0.clone());
        let coverage = Coverage { self_crossings: false, open_curves: true };
        let frame = set.clone().into();
        let needed = Cancel::default();
        let reference =
            Reference::build(&frame, certificate, 0, coverage, None, MOST_NEAR, &needed).unwrap();
        let m = nalgebra::Matrix3::identity() + nalgebra::Matrix3::from_row_slice(&map);
        let affine = Affine::new(m, shift.into());
        prop_assume!(affine.is_some());
        let affine = affine.unwrap();
        let near = moved(&curves, &reference, seed, direction);
        let mut xyz = Vec::new();
        for (q, p) in (0..set.len()).flat_map(|i| {
            let points = 0..set.curve(i).points as usize;
            points.map(move |k| (i, k))
        }).map(|(i, k)| (set.point(i, k), near.point(i, k))) {
            let mapped = m * nalgebra::Vector3::from(q) + affine.t;
            xyz.extend((0..3).map(|x| mapped[x] + affine.sigma * (p[x] - q[x])));
        }
        let frame = Curves { double: true, ..curves }.set(&xyz);
        let at = QuietBounds { reference: &reference, affine };
        for (i, [lo, hi]) in at.bounds(&at.map(rows)).enumerate() {
            let [least, most] = frame.bounds_along(i, &rows);
            for x in 0..3 {
                let inside = lo[x] - 1e-9 <= least[x] && most[x] <= hi[x] + 1e-9;
                prop_assert!(inside, "{lo:?} {least:?} {most:?} {hi:?}");
            }
        }
    }
}

/// Regression test: the list of near segments of a wound ball grew until the memory was exhausted.
#[test]
fn a_reference_frame_that_is_too_large_or_not_needed_is_given_up() {
    let scene = "woundball:segments=20000".parse::<crate::scenes::Scene>();
    let scene = scene.unwrap().build().unwrap();
    let certificate = Arc::new(scene.certificate);
    let build = |most, cancel: &Cancel| {
        let (set, certificate) = (scene.curves.clone(), Arc::clone(&certificate));
        let coverage = Coverage::default();
        Reference::build(&set.into(), certificate, 0, coverage, None, most, cancel)
    };
    // It has some 1,500,000 near pairs of blocks.
    let needed = Cancel::default();
    assert!(build(MOST_NEAR, &needed).is_some());
    for most in [1_000_000, 1000, 0] {
        assert!(build(most, &needed).is_none(), "{most}");
    }
    needed.set();
    assert!(build(MOST_NEAR, &needed).is_none());
}
