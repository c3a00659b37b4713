//! Tests of random spline links against the oracle on densely sampled polygons.

use super::*;
use crate::Certifier;
use crate::curve::{Basis, Positions};
use crate::discretize::homotopic_polylines;
use crate::kernels::tests::oracle;
use crate::random::Random;

/// Points per segment of the reference polygons; the finer one is used if the coarser one
/// disagrees.
const SAMPLES: [usize; 2] = [12, 150];

/// Returns the curve as an integer polygon, with `samples` points per segment.
fn sampled(set: &CurveSet, i: usize, samples: usize) -> Vec<[i64; 3]> {
    let n = set.curve(i).segments as usize;
    (0..n * samples)
        .map(|k| {
            let p = set.eval(i, k / samples, (k % samples) as f64 / samples as f64);
            p.map(|x| (x * (1u64 << 36) as f64).round() as i64)
        })
        .collect()
}

#[test]
fn random_splines_match_finely_sampled_polygons_in_all_six_directions() {
    check_random_splines(100, 4242);
}

#[test]
#[ignore = "takes minutes"]
fn many_random_splines_match_finely_sampled_polygons_in_all_six_directions() {
    check_random_splines(2000, 4243);
}

/// Checks that many pairs of curves of each basis.
fn check_random_splines(pairs: usize, seed: u64) {
    let mut random = Random::new(seed);
    // 24 bits, so that the oracle sees the coordinates as they are.
    let mut next = || random.below(1u32 << 24) as f32 / (1u32 << 24) as f32;
    for basis in [Basis::CatmullRom, Basis::BSpline, Basis::Bezier] {
        let (mut linked, mut refined, mut control_polygon_lies) = (0, 0, 0);
        for _ in 0..pairs {
            let sizes = [next(), next()].map(|r| 4 + (r * 8.0) as i32);
            let counts = sizes.map(|n| if basis == Basis::Bezier { -3 * n } else { -n });
            let total = -(counts[0] + counts[1]) as usize;
            let xyz: Vec<f32> = (0..3 * total).map(|_| next()).collect();
            let set = CurveSet::from_counts(basis, &counts, Positions::F32(&xyz)).unwrap();
            let mut trees = Trees::default();
            trees.refit(&set);
            let input = Input {
                set: &set,
                trees: &trees,
                workspaces: &Workspaces::default(),
            };
            let want = |samples| {
                oracle::linking_number(&sampled(&set, 0, samples), &sampled(&set, 1, samples))
                    .expect("random curves do not touch")
            };
            let mut workspace = Workspace::default();
            let mut expected = want(SAMPLES[0]);
            for fixed in Direction::ALL.map(Some).into_iter().chain([None]) {
                let found = linking_number(input, (0, 1), fixed, &mut workspace);
                if found != Linking::Number(expected) {
                    expected = want(SAMPLES[1]);
                }
                assert_eq!(
                    found,
                    Linking::Number(expected),
                    "{basis:?} {fixed:?} {xyz:?}"
                );
            }
            refined += workspace.take_stats().refined;
            linked += usize::from(expected != 0);
            let control =
                CurveSet::from_counts(Basis::Polyline, &counts, Positions::F32(&xyz)).unwrap();
            let mut certifier = Certifier::default();
            let lambda = |links: &[crate::Link]| links.first().map_or(0, |l| l.lambda);
            control_polygon_lies +=
                usize::from(lambda(&certifier.certify(&control).0.links) != expected);
            let polylines = homotopic_polylines(&set).unwrap();
            assert!(polylines.too_close.is_empty());
            let certificate = certifier.certify(&polylines.curves).0.clone();
            assert_eq!(lambda(&certificate.links), expected, "Algorithm 3");
        }
        println!(
            "{basis:?}: {linked} linked, {refined} points added, \
             {control_polygon_lies} unlike their control polygons"
        );
        assert!(
            linked > pairs / 10
                && 2 * refined > 5 * pairs as u64
                && control_polygon_lies > pairs / 40
        );
    }
}

/// Scaling by a power of two scales every rounding error with it, until numbers underflow. Larger
/// scales are rejected.
#[test]
fn the_scale_of_splines_does_not_change_the_result() {
    let mut random = Random::new(7);
    let mut next = || random.between(-0.5, 0.5);
    for basis in [Basis::CatmullRom, Basis::BSpline, Basis::Bezier] {
        for n in [-5, -7, -11, -21] {
            let counts = [n, n].map(|n| if basis == Basis::Bezier { 3 * n } else { n });
            let xyz: Vec<f64> = (0..-3 * (counts[0] + counts[1])).map(|_| next()).collect();
            let certify = |power: i32| {
                let scaled: Vec<f64> = xyz.iter().map(|x| x * 2f64.powi(power)).collect();
                let set = CurveSet::from_counts(basis, &counts, Positions::F64(&scaled))?;
                Ok::<_, crate::Error>(Certifier::default().certify(&set).0.clone())
            };
            let want = certify(0).unwrap();
            for power in [-200, -120, -40, 60, 126, 130, 200, 299] {
                assert_eq!(
                    certify(power).unwrap().links,
                    want.links,
                    "{basis:?} {n} 2^{power}"
                );
            }
            // Too small to compute with: the linking number may be undecided, but never wrong.
            for power in [-1000, -600, -340] {
                let found = certify(power).unwrap();
                assert!(
                    found.links == want.links || !found.undefined.is_empty(),
                    "{basis:?} 2^{power}"
                );
            }
            assert!(matches!(certify(303), Err(crate::Error::TooLarge { .. })));
        }
    }
}

#[test]
fn touching_splines_are_reported_as_too_close_with_their_place() {
    // Two closed curves through one common point.
    let a = [[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]];
    let b = [[0., 0., 0.], [-1., 0., 0.], [-1., 0., 1.], [0., 0., 1.]];
    let xyz: Vec<f32> = a.iter().chain(&b).flatten().copied().collect();
    let set = CurveSet::from_counts(Basis::CatmullRom, &[-4, -4], Positions::F32(&xyz)).unwrap();
    let mut certifier = Certifier::default();
    let (certificate, _) = certifier.certify(&set);
    let [defect] = certificate.undefined[..] else {
        panic!("{certificate:?}")
    };
    assert_eq!(
        (defect.i, defect.j, defect.kind),
        (0, Some(1), DefectKind::TooClose)
    );
    assert!(defect.place.distance < 1e-9);
    assert!(defect.place.point.iter().all(|x| x.abs() < 1e-9));
}

#[test]
fn identical_and_parallel_splines_take_bounded_time() {
    let ring = |z: f64| {
        (0..64).flat_map(move |k| {
            let t = f64::from(k) / 64.0 * std::f64::consts::TAU;
            [t.cos(), t.sin(), z]
        })
    };
    let cases = [
        (0.0, Some(DefectKind::TooClose)),
        (1e-12, None),
        (1e-6, None),
    ];
    for (gap, kind) in cases {
        let xyz: Vec<f64> = ring(0.0).chain(ring(gap)).collect();
        let set = CurveSet::from_counts(Basis::BSpline, &[-64, -64], Positions::F64(&xyz)).unwrap();
        let mut certifier = Certifier::default();
        let (certificate, _) = certifier.certify(&set);
        assert_eq!(
            certificate.undefined.first().map(|d| d.kind),
            kind,
            "gap {gap}"
        );
        assert!(certificate.links.is_empty());
    }
}
