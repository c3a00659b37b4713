//! Rejected frames leave no trace: without them, all other frames have the same reports. The same
//! holds for a session that is resumed from the state of another one.

use super::support::random::Random;
use linkwatch::{
    Basis, Braid, Braids, Cell, ClearanceOptions, Continuation, CurveLabels, CurveSet, Events,
    FrameInfo, Point, Positions, RawFrame, Report, Session, SessionOptions, Strategy, Verdict,
};
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::sync::Arc;

/// Number of curves of a scene.
const CURVES: usize = 9;

/// Maximum number of pairs of curves. A frame with all curves in one place has 36 pairs.
const MOST: usize = 30;

/// Number of frames of a sequence.
const FRAMES: u64 = 12;

/// Kind of the scene of a sequence.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    /// Curves that appear and disappear.
    Open,
    /// Curves in a periodic cell that are linked with images.
    Cell,
    /// The same, wrapped into the cell.
    Wrapped,
    /// The rods are strands of a braid.
    Braid,
}

impl Kind {
    /// Returns true if a curve is open.
    fn is_rod(self, i: usize) -> bool {
        // A braid needs at least four strands.
        match self {
            Kind::Braid => i % 2 == 1,
            _ => i % 4 == 3,
        }
    }
}

/// Rings and rods in a row, each near the next one.
#[derive(Clone)]
struct Scene {
    kind: Kind,
    cell: Option<Cell>,
    centers: Vec<Point>,
    /// Number of points of each curve.
    sizes: Vec<usize>,
}

impl Scene {
    fn random(random: &mut Random, kind: Kind) -> Scene {
        let center = |i: usize| [1.2 * i as f64, 0.0, 0.0];
        let cell = || "10.8,7,7".parse().unwrap();
        Scene {
            kind,
            cell: [Kind::Cell, Kind::Wrapped].contains(&kind).then(cell),
            centers: (0..CURVES).map(center).collect(),
            // Segments of wrapped curves are less than a third of the cell.
            sizes: (0..CURVES).map(|_| 6 + random.below(6)).collect(),
        }
    }

    /// Moves each curve, some of them so far that links change.
    fn advance(&mut self, random: &mut Random) {
        for c in &mut self.centers {
            let far = if random.one_in(12) { 1.0 } else { 0.08 };
            let by: Point = [0, 1, 2].map(|_| far * (random.below(2001) as f64 / 1e3 - 1.0));
            *c = [0, 1, 2].map(|x| (c[x] + by[x]) * if x > 0 { 0.9 } else { 1.0 });
        }
        if let Some(cell) = &mut self.cell
            && random.one_in(3)
        {
            cell.vectors[1][0] += random.below(201) as f64 / 1e3 - 0.1;
            cell.vectors[0][0] += random.below(21) as f64 / 1e3 - 0.01;
        }
    }

    fn is_rod(&self, i: usize) -> bool {
        self.kind.is_rod(i)
    }

    fn points(&self, i: usize) -> Vec<Point> {
        let n = self.sizes[i];
        let point = |k: usize| {
            let (sin, cos) = (TAU * k as f64 / n as f64).sin_cos();
            let offset = match (self.is_rod(i), i % 2) {
                (true, _) => [0.0, 0.0, 3.0 * k as f64 / (n - 1) as f64 - 1.5],
                (_, 0) => [cos, sin, 0.0],
                _ => [cos, 0.0, sin],
            };
            // The ends of the strands of a braid are rigid.
            let by = match self.kind == Kind::Braid && self.is_rod(i) && (k == 0 || k == n - 1) {
                true => [1.2 * i as f64, 0.0, 0.0],
                false => self.centers[i],
            };
            let p = [0, 1, 2].map(|x| by[x] + offset[x]);
            match (self.kind, self.cell) {
                (Kind::Wrapped, Some(cell)) => wrapped(p, &cell),
                _ => p,
            }
        };
        (0..n).map(point).collect()
    }

    /// Returns the numbers of points of these curves, negative if they are closed, and the points.
    fn numbers(&self, curves: &[usize]) -> (Vec<i32>, Vec<f64>) {
        let (mut counts, mut xyz) = (Vec::new(), Vec::new());
        for &i in curves {
            let sign = if self.is_rod(i) { 1 } else { -1 };
            let points = self.points(i);
            counts.push(sign * points.len() as i32);
            xyz.extend_from_slice(points.as_flattened());
        }
        (counts, xyz)
    }
}

fn diagonal(edges: Point) -> [Point; 3] {
    [0, 1, 2].map(|k| [0, 1, 2].map(|x| if x == k { edges[k] } else { 0.0 }))
}

/// Wraps a point into a cell whose corner is the origin.
fn wrapped(mut p: Point, cell: &Cell) -> Point {
    // The third and the second vector come first, because the second one has a component along the
    // first axis.
    for k in [2, 1, 0] {
        let times = (p[k] / cell.vectors[k][k]).floor();
        p = [0, 1, 2].map(|x| p[x] - times * cell.vectors[k][x]);
    }
    p
}

/// A frame: its information, numbers of points, and coordinates.
#[derive(Clone)]
struct Frame {
    info: FrameInfo,
    counts: Vec<i32>,
    xyz: Vec<f64>,
    /// True if the session copies the coordinates, and compares them in the same pass.
    raw: bool,
}

impl Frame {
    fn new(scene: &Scene, curves: &[usize], info: &FrameInfo, raw: bool) -> Frame {
        let (counts, xyz) = scene.numbers(curves);
        let names = CurveLabels::named(curves.iter().map(usize::to_string));
        let info = FrameInfo {
            cell: scene.cell,
            labels: Arc::new(names),
            ..info.clone()
        };
        Frame {
            info,
            counts,
            xyz,
            raw,
        }
    }

    /// Returns a frame that may be rejected, to replace this one.
    fn spoiled(&self, random: &mut Random, scene: &Scene, curves: &[usize]) -> Frame {
        let mut bad = self.clone();
        bad.info.cuts += random.below(2_u32);
        if random.one_in(4) {
            bad.info.baseline += 1;
        }
        if random.one_in(4) {
            bad.info.layout += 100;
        }
        let heap = || Scene {
            centers: vec![[0.5, 0.1, 0.2]; CURVES],
            ..scene.clone()
        };
        match random.below(9) {
            // Too many pairs, possibly of other curves.
            0 => bad = Frame::new(&heap(), curves, &bad.info, self.raw),
            1 => {
                let mut others = curves.to_vec();
                others.rotate_left(1);
                bad.info.layout += 100;
                bad = Frame::new(&heap(), &others, &bad.info, self.raw);
            }
            // Numbers of points that differ from those before, or fewer coordinates than promised.
            2 => {
                let mut larger = scene.clone();
                larger.sizes.iter_mut().for_each(|n| *n += 1);
                bad = Frame::new(&larger, curves, &bad.info, self.raw);
            }
            3 => bad.xyz.truncate(self.xyz.len() - 3),
            4 => bad.xyz[random.below(self.xyz.len())] = f64::NAN,
            // A curve that jumps to an uncertain image, or that is torn.
            5 => bad.xyz[0] += 0.5 * scene.cell.map_or(0.0, |cell| cell.vectors[0][0]),
            // Dependent lattice vectors, other periodic directions, or a scene without a cell.
            6 => {
                let flat = [[1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 0.0, 3.0]];
                let cells = [flat, diagonal([10.0, 0.0, 7.0]), diagonal([0.01; 3])];
                let (origin, vectors) = ([0.0; 3], random.pick(&cells));
                bad.info.cell = match scene.cell {
                    Some(_) if random.one_in(4) => None,
                    _ => Some(Cell { origin, vectors }),
                };
            }
            // Names that changed, or names without a curve.
            7 => {
                bad.info.layout += u32::from(random.one_in(2));
                let names = Arc::make_mut(&mut bad.info.labels);
                names.names.rotate_left(1);
            }
            _ => {
                bad.info.layout += 1;
                let names = Arc::make_mut(&mut bad.info.labels);
                match random.one_in(2) {
                    true => names.names[0] = names.names[1].clone(),
                    false => names.radii = vec![-1.0; self.counts.len()],
                }
            }
        }
        bad
    }
}

/// Verifies a frame.
fn feed(session: &mut Session, frame: &Frame) -> Report {
    let numbers = RawFrame {
        basis: Basis::Polyline,
        counts: &frame.counts,
        positions: Positions::F64(&frame.xyz),
    };
    let set = CurveSet::from_counts(numbers.basis, numbers.counts, numbers.positions);
    let fed = match set {
        Ok(set) if !frame.raw => session.feed(frame.info.clone(), set),
        _ => session.feed(frame.info.clone(), numbers),
    };
    session.settle();
    fed.unwrap()
}

/// Options of a random sequence.
fn options(random: &mut Random, kind: Kind) -> SessionOptions {
    let strands = (0..CURVES).filter(|&i| kind.is_rod(i));
    SessionOptions {
        strategy: random.pick(&[Strategy::Full, Strategy::Incremental, Strategy::Incremental]),
        events: random.pick(&[Events::Off, Events::Between, Events::All]),
        max_pairs: MOST,
        wrapped: (kind == Kind::Wrapped).then_some(true),
        clearance: random.one_in(4).then(|| ClearanceOptions::new(Some(0.05))),
        braids: (kind == Kind::Braid).then(|| {
            Braids::Given(vec![Braid {
                curves: strands.map(|i| i as u32).collect(),
                ..Braid::default()
            }])
        }),
        ..SessionOptions::default()
    }
}

/// Returns the report of a resumed session with the clearance of another report. The two may differ
/// in the lower bound, and in the choice among several places with the same distance.
fn without_history(mut report: Report, of: &Report) -> Report {
    if let (Some(a), Some(b)) = (report.clearance, of.clearance) {
        let [a, b] = [a, b].map(|clearance| clearance.closest.map(|closest| closest.ratio));
        match (a, b) {
            (Some(a), Some(b)) => assert!((a - b).abs() <= 1e-9 * b, "{a}, {b}"),
            (a, b) => assert_eq!(a, b),
        }
        report.clearance = of.clearance;
    }
    report
}

/// Verifies sequences with rejected frames, without them, by full runs, and by sessions that resume
/// one another.
fn sequences(seeds: std::ops::Range<u64>) {
    let mut verdicts = BTreeMap::<(String, String), u64>::new();
    let (mut rejected, mut resumed) = (BTreeMap::<String, u64>::new(), 0);
    for seed in seeds {
        let mut random = Random::from_key([seed, 97]);
        let kinds = [Kind::Open, Kind::Cell, Kind::Wrapped, Kind::Braid];
        let kind = random.pick(&kinds);
        let mut scene = Scene::random(&mut random, kind);
        let options = options(&mut random, kind);
        let new = || Session::new(options.clone()).unwrap();
        let [mut with, mut without, mut continued] = [new(), new(), new()];
        let mut full = Session::new(SessionOptions {
            strategy: Strategy::Full,
            ..options.clone()
        })
        .unwrap();
        let mut feed_full = |frame: &Frame, expected: &Report| {
            let mut report = feed(&mut full, frame);
            // The work depends on the strategy.
            report.stats = expected.stats;
            assert_eq!(&report, expected, "seed {seed}: in full, {options:?}");
        };
        let mut active: Vec<usize> = (0..CURVES).collect();
        let mut info = FrameInfo::default();
        for seq in 0..FRAMES {
            scene.advance(&mut random);
            if kind == Kind::Open && random.one_in(4) {
                let k = random.below(active.len());
                match active.len() < CURVES {
                    true => active = (0..CURVES).collect(),
                    false => drop(active.remove(k)),
                }
                info.layout += 1;
            }
            (info.seq, info.time) = (seq, 0.1 * seq as f64);
            info.cuts += u32::from(random.one_in(10));
            if random.one_in(15) {
                info.baseline = seq;
            }
            let frame = Frame::new(&scene, &active, &info, random.one_in(2));
            // The first frame must fit the options.
            while seq > 0 && random.one_in(2) {
                let bad = frame.spoiled(&mut random, &scene, &active);
                let report = feed(&mut with, &bad);
                match &report.rejected {
                    Some(why) => {
                        let words = why
                            .split(' ')
                            .filter(|w| w.chars().all(char::is_alphabetic));
                        let words: Vec<&str> = words.take(4).collect();
                        *rejected.entry(words.join(" ")).or_default() += 1;
                    }
                    // A valid frame, which is part of all sequences.
                    None => {
                        assert_eq!(feed(&mut without, &bad), report, "seed {seed}, frame {seq}");
                        feed_full(&bad, &report);
                        let of_resumed = feed(&mut continued, &bad);
                        assert_eq!(
                            without_history(of_resumed, &report),
                            report,
                            "seed {seed}, frame {seq}"
                        );
                        // The next frame has another layout and another baseline.
                        let more = random.below(2_u32);
                        info.layout = info.layout.max(bad.info.layout) + 1;
                        info.cuts = info.cuts.max(bad.info.cuts) + more;
                        break;
                    }
                }
            }
            let frame = Frame {
                info: FrameInfo {
                    layout: info.layout,
                    cuts: info.cuts,
                    ..frame.info
                },
                ..frame
            };
            let report = feed(&mut without, &frame);
            feed_full(&frame, &report);
            assert_eq!(
                feed(&mut with, &frame),
                report,
                "seed {seed}, frame {seq}, {options:?}"
            );
            assert_eq!(
                with.baseline(),
                without.baseline(),
                "seed {seed}, frame {seq}"
            );
            if random.one_in(3) {
                resumed += 1;
                continued = Session::resume(options.clone(), continued.state()).unwrap();
            }
            let of_resumed = feed(&mut continued, &frame);
            assert_eq!(
                without_history(of_resumed, &report),
                report,
                "seed {seed}, frame {seq}: resumed, {options:?}"
            );
            assert_eq!(
                continued.baseline(),
                without.baseline(),
                "seed {seed}, frame {seq}"
            );
            let key = (format!("{kind:?}"), report.verdict.to_string());
            *verdicts.entry(key).or_default() += 1;
        }
    }
    println!("{verdicts:?}; {resumed} resumed; rejected: {rejected:?}");
    for kind in ["Open", "Cell", "Wrapped", "Braid"] {
        let of = |verdict: Verdict| verdicts.get(&(kind.into(), verdict.to_string()));
        let both = [Verdict::Intact, Verdict::Changed].map(|v| of(v).copied().unwrap_or(0));
        assert!(both.iter().all(|&n| n > 0), "{kind}: {verdicts:?}");
    }
    assert!(rejected.len() > 8, "{rejected:?}");
}

#[test]
fn rejected_frames_and_resumed_sessions_leave_no_trace() {
    sequences(0..400);
}

/// The same with 100,000 sequences.
#[test]
#[ignore = "takes an hour"]
fn very_many_rejected_frames_leave_no_trace() {
    let all = |name: &str, default: u64| -> u64 {
        let given = std::env::var(name);
        given.map_or(default, |n| n.parse().unwrap())
    };
    sequences(all("FROM", 1000)..all("TO", 101_000));
}

/// Regression test: strands that touched after a large motion had no clearance and gave no warning.
#[test]
fn strands_that_touch_after_a_large_motion_have_a_clearance() {
    sequences(11_640..11_680);
}

/// Regression test: a rejected frame that the simulator had accepted ended the current violation.
#[test]
fn the_frame_after_a_rejected_one_is_the_accepted_one() {
    let mut session = Session::new(SessionOptions::default()).unwrap();
    let square = [0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.];
    let mut bad = square;
    bad[0] = f64::NAN;
    let mut verify = |seq, baseline, xyz: &[f64]| {
        let info = FrameInfo {
            baseline,
            ..FrameInfo::at(seq, 0.0)
        };
        let frame = RawFrame {
            basis: Basis::Polyline,
            counts: &[-4],
            positions: Positions::F64(xyz),
        };
        let received = session.receive(info, |copy| copy(frame));
        let verified = session.verify(received).unwrap();
        (verified.report.verdict, verified.continuation)
    };
    let expected = [
        (
            verify(0, 0, &square),
            (Verdict::Intact, Continuation::Continues),
        ),
        (
            verify(1, 1, &bad),
            (Verdict::Rejected, Continuation::Continues),
        ),
        (
            verify(2, 1, &square),
            (Verdict::Intact, Continuation::Accepted),
        ),
    ];
    for (found, expected) in expected {
        assert_eq!(found, expected);
    }
}
