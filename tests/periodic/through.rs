//! Curves that run through the cell.

use crate::scene::{Point, Scene, translation};
use crate::support::random::Random;
use crate::support::session::Step;
use crate::yarn::Yarn;
use linkwatch::{
    Basis, Cell, Certificate, Certifier, CurveSet, Events, FrameInfo, Image, Positions, Report,
    Session, SessionOptions, Strategy, Unwrap, Verdict,
};
use std::collections::BTreeMap;
use std::sync::Arc;

/// A yarn that runs through the cell, and a ring.
struct RingAndYarn {
    yarn: Yarn,
    ring: Vec<Point>,
}

impl RingAndYarn {
    fn random(seed: u64, basis: Basis) -> RingAndYarn {
        let mut random = Random::from_key([seed, 41]);
        let cells = [
            "4,4,4",
            "4,3,5",
            "4,0,0,1,4,0,-1,0.5,4",
            "3.3,0,0,0.7,4.1,0,0.4,0.2,3.9",
        ];
        let cell: Cell = random.pick(&cells).parse().unwrap();
        let periods = [
            [1, 0, 0],
            [0, 1, 0],
            [0, 0, 1],
            [1, 1, 0],
            [1, -1, 1],
            [2, 0, 1],
        ];
        let period = random.pick(&periods);
        let grid = seed.is_multiple_of(2);
        let snap = |p: Point| match grid {
            true => p.map(|x| (2.0 * x).round() / 2.0),
            false => p,
        };
        let along = translation(&cell, period);
        let controls = if basis == Basis::Bezier { 3 } else { 1 };
        let n = controls * (6 + random.below(6));
        let points = (0..n).map(|k| {
            let t = f64::from(k) / f64::from(n);
            snap([0, 1, 2].map(|x| t * along[x] + 1.2 * (2.0 * random.unit() - 1.0)))
        });
        let points: Vec<Point> = points.collect();
        let m = controls * (5 + random.below(5));
        let center = [0; 3].map(|_| 4.0 * random.unit());
        let size = 0.8 + 2.0 * random.unit();
        let ring =
            (0..m).map(|_| snap([0, 1, 2].map(|x| center[x] + size * (2.0 * random.unit() - 1.0))));
        let ring = ring.collect();
        RingAndYarn {
            yarn: Yarn {
                cell,
                period,
                basis,
                points,
            },
            ring,
        }
    }

    /// Returns the curves, with the ring first or last.
    fn set(&self, ring_first: bool) -> CurveSet {
        let yarn = self.yarn.in_a_row(1);
        let (ring_count, yarn_count) = (-(self.ring.len() as i32), yarn.len() as i32);
        let (counts, points) = match ring_first {
            true => ([ring_count, yarn_count], [self.ring.clone(), yarn].concat()),
            false => ([yarn_count, ring_count], [yarn, self.ring.clone()].concat()),
        };
        let positions = Positions::F64(points.as_flattened());
        CurveSet::from_counts(self.yarn.basis, &counts, positions).unwrap()
    }

    /// Returns the linking number with the yarn translated by an image, closed by hand: many
    /// periods, and a long way around. `None` if they touch.
    fn closed_by_hand(&self, image: Image) -> Option<i64> {
        let along = translation(&self.yarn.cell, self.yarn.period);
        let by = translation(&self.yarn.cell, image);
        let n = self.yarn.points.len() as i32;
        let points = (-12 * n..=12 * n).map(|k| self.yarn.point(k));
        let mut loops: Vec<Point> = points.map(|p| [0, 1, 2].map(|x| p[x] + by[x])).collect();
        // Around, at a distance, orthogonally to the period.
        let [ends_at, starts_at] = [loops[loops.len() - 1], loops[0]];
        let away = [
            -along[1] - along[2],
            along[0] - along[2],
            along[0] + along[1],
        ];
        let away = match away == [0.0; 3] {
            true => [1.0, 0.0, 0.0],
            false => away,
        };
        let far = |p: Point, a: f64, b: f64| {
            [0, 1, 2].map(|x| p[x] + 40.0 * a * away[x] + 20.0 * b * along[x])
        };
        let corners = [
            far(ends_at, 0.0, 1.0),
            far(ends_at, 1.0, 1.0),
            far(starts_at, 1.0, -1.0),
            far(starts_at, 0.0, -1.0),
        ];
        for corner in corners {
            if self.yarn.basis == Basis::Bezier {
                // A straight segment.
                loops.extend([loops[loops.len() - 1], corner]);
            }
            loops.push(corner);
        }
        if self.yarn.basis == Basis::Bezier {
            loops.extend([corners[3], starts_at]);
        }
        let counts = [-(self.ring.len() as i32), -(loops.len() as i32)];
        let points = [self.ring.clone(), loops].concat();
        let positions = Positions::F64(points.as_flattened());
        let set = CurveSet::from_counts(self.yarn.basis, &counts, positions).unwrap();
        let mut certifier = Certifier::default();
        let (certificate, _) = certifier.certify(&set);
        match certificate.undefined().is_empty() {
            true => Some(certificate.links().first().map_or(0, |l| l.lambda)),
            false => None,
        }
    }
}

/// Returns a translation that is the same for all that differ by multiples of the period.
fn reduced(image: Image, period: Image) -> Image {
    let x = (0..3).find(|&x| period[x] != 0).unwrap();
    let times = image[x].div_euclid(period[x]);
    [0, 1, 2].map(|k| image[k] - times * period[k])
}

/// Compares the linking numbers of rings and yarns. Returns how many pairs are linked, and how many
/// touch.
fn compare(basis: Basis, seeds: u64) -> [usize; 2] {
    let (mut linked, mut touching) = (0, 0);
    for seed in 0..seeds {
        let scene = RingAndYarn::random(seed, basis);
        let (cell, period) = (scene.yarn.cell, scene.yarn.period);
        let mut expected = BTreeMap::new();
        for n in 0..9 * 9 * 9 {
            let image = [n % 9 - 4, n / 9 % 9 - 4, n / 81 - 4];
            if reduced(image, period) == image {
                let number = scene.closed_by_hand(image);
                if number != Some(0) {
                    expected.insert(image, number);
                }
            }
        }
        for ring_first in [true, false] {
            let set = scene.set(ring_first);
            let options = SessionOptions {
                cell: Some(cell),
                wrapped: Some(false),
                ..SessionOptions::default()
            };
            let mut session = Session::new(options).unwrap();
            let report = session.step(0, set).report;
            assert_eq!(report.stats.open_curves, 0);
            let certificate = session.baseline().unwrap();
            let mut found = BTreeMap::new();
            for l in certificate.links() {
                found.insert(Image::default(), Some(l.lambda));
            }
            // The translation is that of the second curve.
            let of_yarn = |image: Image| match ring_first {
                true => reduced(image, period),
                false => reduced(image.map(|n| -n), period),
            };
            let touching = certificate.undefined().iter();
            for d in touching.filter(|d| d.j.is_some_and(|j| d.i != j)) {
                found.insert(of_yarn(d.image), None);
            }
            for l in certificate
                .images()
                .into_iter()
                .flatten()
                .filter(|l| l.i != l.j)
            {
                found.insert(of_yarn(l.image), Some(l.lambda));
            }
            assert_eq!(
                found, expected,
                "{basis:?}, seed {seed}, ring first: {ring_first}"
            );
        }
        linked += expected.values().filter(|l| l.is_some()).count();
        touching += expected.values().filter(|l| l.is_none()).count();
    }
    println!("{basis:?}: {linked} linked, {touching} touching");
    [linked, touching]
}

#[test]
fn linking_numbers_of_rings_and_yarns_are_those_of_yarns_closed_by_hand() {
    let [linked, touching] = compare(Basis::Polyline, 300);
    assert!(linked > 50 && touching > 10, "{linked} {touching}");
}

#[test]
fn linking_numbers_of_splines_and_yarns_are_those_of_yarns_closed_by_hand() {
    for basis in [Basis::CatmullRom, Basis::BSpline, Basis::Bezier] {
        let [linked, _] = compare(basis, 100);
        assert!(linked > 12, "{basis:?}: {linked}");
    }
}

/// Regression test: in single precision, the end of a yarn was not recognised as the image of its
/// start, and its lost link with a ring was not found.
#[test]
fn a_yarn_in_single_precision_is_recognised_and_verified_as_in_double_precision() {
    let mut changed = 0;
    for seed in 0..60 {
        let basis = Basis::ALL[seed as usize % 4];
        // Not on a grid, on which curves touch.
        let scene = RingAndYarn::random(2 * seed + 1, basis);
        let start = [0.0, 100.3][seed as usize / 4 % 2];
        let frames = [0.0, 0.01, 0.02].map(|drift: f64| {
            let mut frame = RingAndYarn {
                yarn: scene.yarn.clone(),
                ring: scene.ring.clone(),
            };
            let far = if drift == 0.02 { 5.0 } else { 0.0 };
            let drift = start + drift;
            frame.ring.iter_mut().for_each(|p| p[0] += drift + far);
            frame.yarn.points.iter_mut().for_each(|p| p[0] += drift);
            frame.set(false)
        });
        let mut verdicts = Vec::new();
        for single in [false, true] {
            let mut session = Session::new(SessionOptions {
                cell: Some(scene.yarn.cell),
                wrapped: Some(false),
                ..SessionOptions::default()
            })
            .unwrap();
            for (seq, set) in (0..).zip(&frames) {
                let mut bytes = Vec::new();
                set.write_positions(&mut bytes);
                let (numbers, _) = bytes.as_chunks::<8>();
                let numbers = numbers.iter().map(|b| f64::from_le_bytes(*b));
                let counts: Vec<i32> = set.counts().collect();
                let set = match single {
                    true => {
                        let xyz: Vec<f32> = numbers.map(|x| x as f32).collect();
                        CurveSet::from_counts(basis, &counts, Positions::F32(&xyz)).unwrap()
                    }
                    false => set.clone(),
                };
                let period = linkwatch::period(&set, 0, &scene.yarn.cell);
                assert_eq!(
                    period,
                    Some(scene.yarn.period),
                    "{basis:?}, seed {seed}, {seq}"
                );
                let report = session.step(seq, set).report;
                // On a grid, a contact may be decided by the rounding.
                verdicts.push((report.defects.is_empty(), report.verdict));
            }
        }
        let (double, single) = verdicts.split_at(frames.len());
        for (a, b) in double.iter().zip(single).filter(|(a, b)| a.0 && b.0) {
            assert_eq!(a.1, b.1, "{basis:?}, seed {seed}");
            changed += usize::from(b.1 == Verdict::Changed);
        }
    }
    assert!(changed > 20, "{changed}");
}

/// A yarn and three rings that move a little, or much.
fn moving(seed: u64, basis: Basis) -> (Cell, Vec<CurveSet>) {
    let mut random = Random::from_key([seed, 42]);
    let scenes = [0, 1, 2].map(|k| RingAndYarn::random(3 * seed + k, basis));
    let yarn = &scenes[0].yarn;
    let mut curves = vec![yarn.points.clone()];
    curves.extend(scenes.iter().map(|scene| scene.ring.clone()));
    let frames = (0..24).map(|_| {
        let amplitude = random.pick(&[0.0, 1e-6, 1e-4, 1e-3, 0.01, 0.1, 0.6]);
        for curve in &mut curves {
            let drift = [0; 3].map(|_| 2.0 * random.unit() - 1.0);
            for p in curve {
                for x in 0..3 {
                    p[x] += amplitude * (drift[x] + 0.3 * (2.0 * random.unit() - 1.0));
                }
            }
        }
        let points = curves[0].clone();
        let mut given = vec![
            Yarn {
                points,
                ..yarn.clone()
            }
            .in_a_row(1),
        ];
        given.extend_from_slice(&curves[1..]);
        let counts = given.iter().enumerate().map(|(k, c)| {
            let n = c.len() as i32;
            if k == 0 { n } else { -n }
        });
        let counts: Vec<i32> = counts.collect();
        let points = given.concat();
        CurveSet::from_counts(basis, &counts, Positions::F64(points.as_flattened())).unwrap()
    });
    (yarn.cell, frames.collect())
}

/// Linking numbers that the step from the previous frame proves are not computed again. The
/// findings are those of a computation in full.
#[test]
fn kept_linking_numbers_of_rings_and_yarns_are_those_of_a_full_computation() {
    for basis in Basis::ALL {
        let (mut changes, mut frames, mut computed) = (0, 0, [0; 2]);
        for seed in 0..24 {
            let (cell, sets) = moving(seed, basis);
            let strategies = [Strategy::Full, Strategy::Incremental, Strategy::Paranoid];
            let mut sessions = strategies.map(|strategy| {
                let options = SessionOptions {
                    cell: Some(cell),
                    wrapped: Some(false),
                    strategy,
                    events: [Events::Between, Events::Off][usize::from(seed % 6 == 5)],
                    ..SessionOptions::default()
                };
                Session::new(options).unwrap()
            });
            for (seq, set) in sets.into_iter().enumerate() {
                let set = Arc::new(set);
                if seq == 15 {
                    sessions.iter_mut().for_each(Session::cut);
                }
                let verified = sessions.each_mut().map(|session| {
                    session.settle();
                    session.step_at(FrameInfo::at(seq as u64, seq as f64), &set)
                });
                let findings = |r: &Report| {
                    let passages = (r.events.clone(), r.unresolved.clone());
                    (r.verdict, r.changes.clone(), passages, r.defects.clone())
                };
                let [full, incremental, paranoid] =
                    verified.each_ref().map(|v| findings(&v.report));
                assert_eq!(incremental, full, "{basis:?}, seed {seed}, frame {seq}");
                assert_eq!(paranoid, full, "{basis:?}, seed {seed}, frame {seq}");
                assert!(
                    !verified[2].work.disagreed,
                    "{basis:?}, seed {seed}, frame {seq}"
                );
                let of_yarn = |c: &&linkwatch::Change| c.i == 0 || c.j == 0;
                changes += full.1.iter().filter(of_yarn).count();
                frames += 1;
                computed[0] += verified[0].work.recomputed;
                computed[1] += verified[1].work.recomputed;
            }
        }
        println!("{basis:?}: {frames} frames, {changes} changes, numbers computed: {computed:?}");
        assert!(changes > 100, "{basis:?}: {changes}");
        assert!(2 * computed[1] < computed[0], "{basis:?}: {computed:?}");
    }
}

/// Two yarns and three rings on a grid: yarns, and their vertices, then rings.
fn bundle(seed: u64) -> (Vec<Yarn>, Vec<Vec<Point>>) {
    let scenes = [0, 1, 2].map(|k| RingAndYarn::random(6 * seed + 2 * k, Basis::Polyline));
    let cell: Cell = ["4,4,4", "4,3,5", "4,0,0,1,4,0,-1,0.5,4"][seed as usize % 3]
        .parse()
        .unwrap();
    let yarns = [0, 1].map(|k| Yarn {
        cell,
        period: [[1, 0, 0], [0, 1, 0], [1, -1, 1]][(seed as usize + k) % 3],
        ..scenes[k].yarn.clone()
    });
    (yarns.into(), scenes.map(|scene| scene.ring).into())
}

/// Returns the certificate of yarns and rings, one after the other.
fn certificate(yarns: &[Yarn], rings: &[Vec<Point>]) -> (Certificate, CurveSet) {
    let yarns_in_a_row = yarns.iter().map(|yarn| yarn.in_a_row(1));
    let counts = yarns_in_a_row.clone().map(|yarn| yarn.len() as i32);
    let counts: Vec<i32> = counts
        .chain(rings.iter().map(|ring| -(ring.len() as i32)))
        .collect();
    let points: Vec<Point> = yarns_in_a_row
        .chain(rings.iter().cloned())
        .flatten()
        .collect();
    let positions = Positions::F64(points.as_flattened());
    let set = CurveSet::from_counts(Basis::Polyline, &counts, positions).unwrap();
    let options = SessionOptions {
        cell: Some(yarns[0].cell),
        wrapped: Some(false),
        ..SessionOptions::default()
    };
    let mut session = Session::new(options).unwrap();
    session.step(0, set.clone());
    (session.baseline().unwrap().clone(), set)
}

/// The text of the certificate, and the verdict on a baseline of other images, depend neither on
/// the images that the coordinates of rings and yarns belong to, nor on the vertices at which yarns
/// start.
#[test]
fn certificates_of_rings_and_yarns_do_not_depend_on_their_images() {
    let (mut linked, mut loops) = (0, 0);
    for seed in 0..120 {
        let (yarns, rings) = bundle(seed);
        let (before, _) = certificate(&yarns, &rings);
        let mut random = Random::from_key([seed, 43]);
        let cell = yarns[0].cell;
        let mut by = || translation(&cell, [0; 3].map(|_| random.below(7) - 3));
        let (mut moved, mut moved_rings) = (yarns, rings);
        let curves = moved.iter_mut().map(|yarn| &mut yarn.points);
        for curve in curves.chain(&mut moved_rings) {
            let by = by();
            curve
                .iter_mut()
                .for_each(|p| *p = [0, 1, 2].map(|x| p[x] + by[x]));
        }
        for yarn in &mut moved {
            let start = random.below(yarn.points.len() as i32);
            let points = start..start + yarn.points.len() as i32;
            yarn.points = points.map(|k| yarn.point(k)).collect();
        }
        let (after, set) = certificate(&moved, &moved_rings);
        assert_eq!(after.to_string(), before.to_string(), "seed {seed}");
        let read = Certificate::parse(&before.to_string()).unwrap();
        assert_eq!(read.to_string(), before.to_string(), "seed {seed}");
        assert!(
            after.compare(&read).unwrap().changes.is_empty(),
            "seed {seed}"
        );
        let undefined = before.to_string().contains("undefined");
        let options = SessionOptions {
            cell: Some(cell),
            wrapped: Some(false),
            baseline: Some(read),
            ..SessionOptions::default()
        };
        let mut session = Session::new(options).unwrap();
        for seq in 0..2 {
            let report = session.step(seq, set.clone()).report;
            assert!(report.changes.is_empty(), "seed {seed}: {report:?}");
            assert!(
                undefined || report.verdict == Verdict::Intact,
                "seed {seed}: {report:?}"
            );
        }
        let of_yarns = before
            .images()
            .into_iter()
            .flatten()
            .filter(|l| l.i < 2 && l.j >= 2);
        linked += of_yarns.count() + before.links().iter().filter(|l| l.i < 2).count();
        let texts = before.to_string();
        let named = texts.lines().filter(|line| !line.ends_with("period"));
        loops += usize::from(named.skip(1).any(|line| !line.contains(",0,0,0,")));
    }
    println!("{linked} linked, {loops} with translations");
    assert!(linked > 100 && loops > 20, "{linked} {loops}");
}

/// A baseline of yarns with other periods is refused.
#[test]
fn a_baseline_with_other_periods_is_refused() {
    let (yarns, rings) = bundle(1);
    let (baseline, set) = certificate(&yarns, &rings);
    let text = baseline.to_string();
    let line = |period: &str| format!("0,,{period},period");
    let other = text.replacen(&line("0,1,0"), &line("1,0,0"), 1);
    assert_ne!(other, text);
    let options = SessionOptions {
        cell: Some(yarns[0].cell),
        wrapped: Some(false),
        baseline: Some(Certificate::parse(&other).unwrap()),
        ..SessionOptions::default()
    };
    let mut session = Session::new(options).unwrap();
    let report = session.feed(FrameInfo::at(0, 0.0), set).unwrap();
    let e = report.rejected.unwrap();
    assert!(
        e.contains("curve 0 runs through the cell with the period 1,0,0 in the baseline, but it"),
        "{e}"
    );
    let twice = text.replacen(&line("0,1,0"), &format!("{0}\n{0}", line("0,1,0")), 1);
    let twice = twice
        .split_once('#')
        .map(|(a, b)| format!("{a}\n{}", &b[b.find('\n').unwrap()..]));
    let e = Certificate::parse(&twice.unwrap()).unwrap_err().to_string();
    assert!(e.contains("the period of curve 0 is listed twice"), "{e}");
}

/// Two warp and two weft yarns of a plain weave, one cell of length 2.
fn weave() -> Scene {
    let wave = |along: usize, at: f64, sign: f64| -> Vec<Point> {
        let point = |k: i32| {
            let t = f64::from(k) / 16.0;
            let mut p = [0.0; 3];
            p[along] = 2.0 * t;
            p[1 - along] = at;
            p[2] = sign * 0.3 * (std::f64::consts::TAU * (t - 0.25)).cos();
            p
        };
        // The yarn starts between two crossings.
        (0..=16).map(point).collect()
    };
    let curves = vec![
        wave(0, 0.5, 1.0),
        wave(0, 1.5, -1.0),
        wave(1, 0.5, -1.0),
        wave(1, 1.5, 1.0),
    ];
    Scene {
        cell: "2,2,0".parse().unwrap(),
        curves,
        closed: false,
        reach: 2,
    }
}

#[test]
fn a_weave_at_rest_is_intact_and_has_no_linking_numbers() {
    for strategy in [Strategy::Full, Strategy::Incremental] {
        let scene = weave();
        let mut session = Session::new(scene.options(strategy, Events::Between)).unwrap();
        for seq in 0..4 {
            let report = session.step(seq, scene.set()).report;
            assert_eq!(report.verdict, Verdict::Intact, "{report:?}");
        }
        let baseline = session.baseline().unwrap();
        assert!(baseline.links().is_empty());
        assert_eq!(baseline.images(), Some(&[][..]));
    }
}

/// A weft yarn is lifted through all warp yarns: it passes the two that were above it, and no
/// linking number shows that.
#[test]
fn a_yarn_that_is_lifted_out_of_a_weave_passes_through_others() {
    for strategy in [Strategy::Full, Strategy::Incremental] {
        let scene = weave();
        let mut session = Session::new(scene.options(strategy, Events::Between)).unwrap();
        session.step(0, scene.set());
        let mut lifted = scene.clone();
        lifted.curves[2].iter_mut().for_each(|p| p[2] += 1.0);
        let report = session.step_at(FrameInfo::at(1, 0.1), lifted.set()).report;
        assert_eq!(report.verdict, Verdict::Changed);
        // It crosses two warp yarns per cell, and was below one of them.
        assert_eq!(report.events.len(), 1, "{:?}", report.events);
        let event = &report.events[0];
        assert!(event.i < 2 && event.j == 2, "{event:?}");
    }
}

/// Regression test: an image that continues a yarn touches that yarn at its end. If a third curve
/// needed this image, and some sums were rounded, the two counted as curves in contact.
#[test]
fn a_yarn_does_not_touch_the_image_that_continues_it() {
    for strategy in [Strategy::Full, Strategy::Incremental] {
        let weave = weave();
        // Numbers whose sums are rounded.
        let scaled = |x: f64| 1.037 * x;
        let moved = |c: &[Point], by: Point| -> Vec<Point> {
            let moved = |p: &Point| [0, 1, 2].map(|x| scaled(p[x] + by[x]));
            c.iter().map(moved).collect()
        };
        // The first warp yarn crosses the next period of the weft yarn, the second one the weft
        // yarn itself, by an image.
        let mut scene = Scene {
            curves: vec![
                moved(&weave.curves[0], [0.0, 2.0, 0.0]),
                moved(&weave.curves[2], [0.0; 3]),
                moved(&weave.curves[1], [2.0, 0.0, 0.0]),
            ],
            ..weave
        };
        scene.cell.vectors = scene.cell.vectors.map(|v| v.map(scaled));
        for yarn in &mut scene.curves {
            // Ends exactly at the image of the start.
            yarn[0][2] = 0.0;
            yarn[16][2] = 0.0;
        }
        let mut session = Session::new(scene.options(strategy, Events::Between)).unwrap();
        for seq in 0..3 {
            let report = session.step(seq, scene.set()).report;
            assert_eq!(report.verdict, Verdict::Intact, "{report:?}");
        }
    }
}

/// The yarns are shifted so that each crossing is at the boundary of the cell, where a yarn starts
/// and ends: the passage is found once, between the image of a yarn and another one.
#[test]
fn a_passage_at_the_boundary_is_found_once() {
    for shift in [0.45, 0.5, 0.51] {
        let mut scene = weave();
        scene.curves.truncate(3);
        scene.curves.remove(1);
        let mut lifted = scene.clone();
        lifted.curves[1].iter_mut().for_each(|p| p[2] += 1.0);
        // One yarn starts and ends near the crossing.
        let mut set = scene.clone();
        for scene in [&mut set, &mut lifted] {
            for p in &mut scene.curves[0] {
                p[0] += shift;
                let t = (p[0] - 0.0) / 2.0 - 0.25;
                p[2] = 0.3 * (std::f64::consts::TAU * t).cos();
            }
        }
        let below = |scene: &Scene| scene.curves[0][0][2];
        let mut session = Session::new(scene.options(Strategy::Full, Events::Between)).unwrap();
        session.step(0, set.set());
        let report = session.step_at(FrameInfo::at(1, 0.1), lifted.set()).report;
        let crossing_is_above = below(&set) > -1.0;
        assert!(crossing_is_above);
        assert_eq!(report.events.len(), 1, "shift {shift}: {:?}", report.events);
    }
}

#[test]
fn a_wrapped_yarn_becomes_one_that_runs_through_the_cell() {
    let scene = weave();
    let wrapped: Vec<Point> = scene.curves[0][..16]
        .iter()
        .map(|p| [(p[0] + 1.3).rem_euclid(2.0), p[1], p[2]])
        .collect();
    let positions = Positions::F64(wrapped.as_flattened());
    let set = CurveSet::from_counts(Basis::Polyline, &[-16], positions).unwrap();
    let set = Unwrap::default().unwrap(&set, &scene.cell).unwrap();
    assert_eq!((set.curve(0).closed, set.points()), (false, 17));
    let mut session = Session::new(scene.options(Strategy::Full, Events::Between)).unwrap();
    for seq in 0..3 {
        let report = session.step(seq, set.clone()).report;
        assert_eq!(report.verdict, Verdict::Intact, "{report:?}");
    }
}

#[test]
fn a_yarn_that_no_longer_closes_up_is_not_intact() {
    let scene = weave();
    let mut session = Session::new(scene.options(Strategy::Full, Events::Between)).unwrap();
    session.step(0, scene.set());
    let mut torn = scene.clone();
    torn.curves[1][16][0] += 0.1;
    let report = session.step_at(FrameInfo::at(1, 0.1), torn.set()).report;
    assert_eq!(report.verdict, Verdict::Undecided);
    assert!(
        report.missing[0].contains("curve 1 no longer ends at the image"),
        "{report:?}"
    );
}
