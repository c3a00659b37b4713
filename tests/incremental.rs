//! Compares incremental with full verification: on every frame of random moving sets, the same
//! verdict, and the same changes and defects with the same places.
//!
//! `cargo test --release --test incremental` runs thousands of sequences in seconds. Many more, for
//! about an hour:
//!
//! ```sh
//! cargo test --release --test incremental -- --ignored --nocapture
//! ```
//!
//! Each sequence depends only on its seed, which a failure prints.

use linkwatch::scenes::{Frames, Motion, MotionKind, Scene, pull_throughs};
use linkwatch::{
    Basis, CurveSet, Defect, DefectKind, Events, Point, Positions, Precision, Report, Route,
    Strategy, Verdict, Verifier, VerifierOptions,
};
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::ops::{Range, RangeInclusive};

/// Marsaglia's xorshift64*.
struct Random(u64);

impl Random {
    fn new(seed: u64) -> Random {
        let mut random = Random(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1);
        // Neighbouring seeds give similar first numbers.
        (0..8).for_each(|_| _ = random.next());
        random
    }

    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 16
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }

    fn one_in(&mut self, n: usize) -> bool {
        self.below(n) == 0
    }

    fn between(&mut self, lo: f64, hi: f64) -> f64 {
        lo + (hi - lo) * (self.next() as f64 / (1u64 << 48) as f64)
    }

    fn point(&mut self, size: f64) -> Point {
        [(); 3].map(|()| self.between(-size, size))
    }

    fn pick<T: Copy>(&mut self, from: &[T]) -> T {
        from[self.below(from.len())]
    }
}

/// Returns a number of control points that is valid for the basis. Some `large` curves have several
/// levels of boxes.
fn size(random: &mut Random, basis: Basis, closed: bool, large: bool) -> usize {
    let n = match random.below(12) {
        0 if large => 60 + random.below(200),
        1 => 3,
        _ => 4 + random.below(24),
    };
    match (basis, closed) {
        (Basis::Bezier, true) => 3 * n.div_ceil(3),
        (Basis::Bezier, false) => 3 * n.div_ceil(3) + 1,
        (_, true) => n,
        (_, false) => n.max(4),
    }
}

/// Maximum number of curves of a set in which all may be tangled.
const MOST: usize = 7;

/// Returns random curves: a chain, rings anywhere, random polygons, strands side by side, or a
/// lattice with many ties.
fn random_set(random: &mut Random, basis: Basis, precision: Precision, curves: usize) -> CurveSet {
    let many = curves > MOST;
    let shape = match many {
        true => random.pick(&[0, 1, 3]),
        false => random.below(5),
    };
    // As dense as a few curves.
    let room = (curves as f64 / MOST as f64).cbrt().max(1.0);
    // Random points; long curves take long to verify.
    let tangled = matches!(shape, 2 | 4);
    let mut counts = Vec::new();
    let mut xyz = Vec::new();
    for i in 0..curves {
        let closed = i < 2 || !random.one_in(5);
        let n = size(random, basis, closed, !tangled && !many);
        counts.push(if closed { -(n as i32) } else { n as i32 });
        let (centre, u, v) = match shape {
            // Each ring through the next.
            0 => {
                let (up, side) = ([0.0, 0.0, 1.0], [0.0, 1.0, 0.0]);
                let across = if i % 2 == 0 { side } else { up };
                ([1.3 * i as f64, 0.0, 0.0], [1.0, 0.0, 0.0], across)
            }
            // Nested, at a small distance.
            3 => {
                let r = 1.0 + 0.05 * i as f64;
                (
                    [0.0, 0.0, 0.03 * i as f64],
                    [r, 0.0, 0.0],
                    [0.0, r, 0.1 * r],
                )
            }
            _ => (random.point(room), random.point(1.2), random.point(1.2)),
        };
        let wobble = random.pick(&[0.0, 0.01, 0.2]);
        for k in 0..n {
            let (s, c) = (TAU * k as f64 / n as f64).sin_cos();
            let bump = random.point(wobble);
            let p: Point = match shape {
                2 => random.point(1.0),
                4 => random.point(3.0).map(f64::round),
                _ => std::array::from_fn(|x| centre[x] + c * u[x] + s * v[x] + bump[x]),
            };
            xyz.extend(p);
        }
    }
    match precision {
        Precision::F64 => CurveSet::from_counts(basis, &counts, Positions::F64(&xyz)),
        Precision::F32 => {
            let xyz: Vec<f32> = xyz.iter().map(|&x| x as f32).collect();
            CurveSet::from_counts(basis, &counts, Positions::F32(&xyz))
        }
    }
    .unwrap()
}

/// Event that changes a frame after its motion, for a few frames.
#[derive(Clone, Copy, Debug)]
enum Event {
    /// Points of the second curve coincide with points of the first one.
    Contact([usize; 2], [usize; 2]),
    /// The curve shrinks to this number of first points.
    Collapse(usize, usize),
    /// The curve is scaled down by this factor about its first point.
    Shrink(usize, i32),
    /// Two neighbouring points of a curve coincide.
    Repeat(usize, usize),
    /// One coordinate is the same in the whole frame.
    Flatten(usize),
    /// One point moves far away.
    Spike(usize, usize),
}

/// Frames of one sequence.
struct Movie {
    random: Random,
    set: CurveSet,
    frames: Frames,
    pulls: Vec<linkwatch::scenes::PullThrough>,
    motion: Motion,
    amplitude: f64,
    /// True if few curves have events.
    calm: bool,
    /// True if the waves persist and grow, instead of changing in every frame.
    steady: bool,
    /// Number of frames since the motion began.
    age: u64,
    /// Width of the lattice to which all points are rounded, so that curves touch exactly in many
    /// frames.
    lattice: Option<f64>,
    /// Displacement of each curve, and its displacement per frame.
    ways: Vec<[Point; 2]>,
    events: Vec<(Event, u64)>,
}

impl Movie {
    fn new(mut random: Random, set: CurveSet) -> Movie {
        let mut movie = Movie {
            frames: Frames::new(&set, 0.2).with_seed(random.next()),
            pulls: pull_throughs(&set),
            motion: MotionKind::Still.into(),
            amplitude: 0.0,
            calm: set.len() > MOST,
            steady: false,
            age: 0,
            lattice: None,
            ways: vec![[[0.0; 3]; 2]; set.len()],
            events: Vec::new(),
            random,
            set,
        };
        movie.change_motion();
        movie
    }

    fn change_motion(&mut self) {
        let random = &mut self.random;
        let kinds = 1 + random.below(2);
        let kinds: Vec<_> = (0..kinds).map(|_| random.pick(&MotionKind::ALL)).collect();
        self.motion = Motion::new(kinds);
        let largest = if self.calm { -3.0 } else { 0.0 };
        self.amplitude = 0.3 * 10f64.powf(random.between(-6.0, largest));
        self.steady = random.one_in(2);
        self.age = 0;
    }

    /// Returns the index of the first point of a curve among all points.
    fn first(&self, curve: usize) -> usize {
        self.set.curves()[..curve]
            .iter()
            .map(|c| c.points as usize)
            .sum()
    }

    /// Returns a random curve and one of its points.
    fn somewhere(&mut self) -> (usize, usize) {
        let i = self.random.below(self.set.len());
        let n = self.set.curve(i).points as usize;
        (i, self.random.below(n))
    }

    fn random_event(&mut self) -> Event {
        let ((i, a), (j, b)) = (self.somewhere(), self.somewhere());
        match self.random.below(7) {
            6 => Event::Shrink(i, 1 << self.random.below(31)),
            0 => Event::Collapse(i, 1 + self.random.below(3)),
            1 => Event::Repeat(i, a),
            // Splines in a plane cross everywhere, and each crossing is refined up to the limit.
            2 if !self.calm && (self.set.basis().is_polyline() || self.set.points() < 40) => {
                Event::Flatten(self.random.below(3))
            }
            3 => Event::Spike(i, a),
            // B-splines with a common knot have a common tangent and curvature there, which takes
            // 0.1 s until the limit.
            _ if i == j || (self.set.basis() == Basis::BSpline && !self.random.one_in(12)) => {
                Event::Repeat(j, b)
            }
            _ => Event::Contact([i, a], [j, b]),
        }
    }

    /// Moves the set to the next frame.
    fn advance(&mut self, frame: u64) {
        self.age += 1;
        if self.random.one_in(if self.calm { 25 } else { 9 }) {
            self.change_motion();
        }
        if self.random.one_in(10) && !self.pulls.is_empty() {
            let at = self.random.below(self.pulls.len());
            self.frames.pull(&self.pulls[at]);
        }
        if self.random.one_in(12) {
            self.frames.release();
        }
        let curve = self.random.below(self.ways.len());
        match self.random.below(30) {
            // A teleport.
            0 => self.ways[curve][0] = self.random.point(2.0),
            // An individual motion from now on.
            1 => {
                let step = 0.3 * 10f64.powf(self.random.between(-3.0, 0.0));
                self.ways[curve][1] = self.random.point(step);
            }
            2 => self.ways[curve][1] = [0.0; 3],
            3 => self.ways.fill([[0.0; 3]; 2]),
            _ => {}
        }
        if self.random.one_in(9) {
            let event = self.random_event();
            let last = frame + self.random.below(4) as u64;
            self.events.push((event, last));
        }
        self.events.retain(|&(_, last)| frame <= last);

        let mut xyz = match self.steady {
            true => values(
                self.frames
                    .at(&self.motion, self.amplitude * self.age as f64, 1),
            ),
            false => values(self.frames.at(&self.motion, self.amplitude, frame)),
        };
        let mut at = 0;
        for (c, [gone, step]) in self.set.curves().iter().zip(&mut self.ways) {
            let end = at + 3 * c.points as usize;
            for x in 0..3 {
                gone[x] += step[x];
                xyz[at..end]
                    .iter_mut()
                    .skip(x)
                    .step_by(3)
                    .for_each(|v| *v += gone[x]);
            }
            at = end;
        }
        for &(event, _) in &self.events {
            self.apply(event, &mut xyz);
        }
        if let Some(width) = self.lattice {
            xyz.iter_mut()
                .for_each(|x| *x = (*x / width).round() * width);
        }
        if self.random.one_in(40) {
            // Rejected after half of it was written.
            let at = self.random.below(xyz.len());
            let mut broken = xyz.clone();
            broken[at] = f64::NAN;
            update(&mut self.set, &broken).unwrap_err();
        }
        update(&mut self.set, &xyz).unwrap();
    }

    fn apply(&self, event: Event, xyz: &mut [f64]) {
        let points = |i: usize| self.set.curve(i).points as usize;
        let slot = |i: usize, k: usize| 3 * (self.first(i) + k % points(i));
        let mut copy = |from: usize, to: usize| xyz.copy_within(from..from + 3, to);
        match event {
            Event::Shrink(i, by) => {
                let first = slot(i, 0);
                for at in first..first + 3 * points(i) {
                    let centre = xyz[first + at % 3];
                    xyz[at] = centre + (xyz[at] - centre) / f64::from(by);
                }
            }
            Event::Contact([i, a], [j, b]) => match self.set.basis() {
                // A knot depends on three control points.
                Basis::BSpline => (0..3).for_each(|k| copy(slot(i, a + k), slot(j, b + k))),
                // At the joint of two segments.
                Basis::Bezier => copy(slot(i, a - a % 3), slot(j, b - b % 3)),
                Basis::Polyline | Basis::CatmullRom => copy(slot(i, a), slot(j, b)),
            },
            Event::Collapse(i, n) => (0..points(i)).for_each(|k| copy(slot(i, k % n), slot(i, k))),
            Event::Repeat(i, a) => copy(slot(i, a), slot(i, a + 1)),
            Event::Flatten(x) => {
                let value = xyz[x];
                xyz.iter_mut().skip(x).step_by(3).for_each(|v| *v = value);
            }
            Event::Spike(i, a) => xyz[slot(i, a)] += 5.0,
        }
    }
}

fn values(positions: Positions<'_>) -> Vec<f64> {
    match positions {
        Positions::F32(v) => v.iter().map(|&x| x.into()).collect(),
        Positions::F64(v) => v.to_vec(),
    }
}

fn update(set: &mut CurveSet, xyz: &[f64]) -> linkwatch::Result<()> {
    match set.precision() {
        Precision::F64 => set.update(Positions::F64(xyz)),
        Precision::F32 => {
            let xyz: Vec<f32> = xyz.iter().map(|&x| x as f32).collect();
            set.update(Positions::F32(&xyz))
        }
    }
}

/// The verifier under test, and the reference verifier.
struct Both {
    incremental: Verifier,
    full: Verifier,
    tally: Tally,
    /// Balance of the pull-throughs, if they are looked for.
    balance: Option<Balance>,
}

/// Checks pull-throughs against linking numbers, over frames in which curves touch. Between two
/// frames in which a pair of closed curves has a linking number, it changes by the sum of the signs
/// of their pull-throughs.
struct Balance {
    numbers: Verifier,
    pairs: BTreeMap<(u32, u32), Since>,
    /// Number of sums over frames in which the pair touched, and how many of these are not 0.
    through_contact: [u64; 2],
}

/// State of a pair since the last frame in which it had a linking number.
#[derive(Clone, Copy)]
struct Since {
    /// Linking number in that frame; `None` if there was no such frame.
    lambda: Option<i64>,
    /// Sum of the signs of the pull-throughs.
    sum: i64,
    /// True if a step was undecided.
    untold: bool,
    /// True if the curves touched.
    touched: bool,
}

impl Balance {
    fn new() -> Balance {
        Balance {
            numbers: Verifier::default(),
            pairs: BTreeMap::new(),
            through_contact: [0; 2],
        }
    }

    fn add(&mut self, report: &Report, set: &CurveSet, what: &str) {
        let (certificate, _) = self.numbers.certify(set);
        let closed = |i: &u32| set.curve(*i as usize).closed;
        let curves: Vec<u32> = (0..set.len() as u32).filter(closed).collect();
        for (k, &j) in curves.iter().enumerate() {
            for &i in &curves[..k] {
                let of_pair = |d: &&Defect| match d.j {
                    Some(other) => (d.i, other) == (i, j),
                    None => d.i == i || d.i == j,
                };
                let start = Since {
                    lambda: None,
                    sum: 0,
                    untold: false,
                    touched: false,
                };
                let since = self.pairs.entry((i, j)).or_insert(start);
                let events = report.events.iter().chain(&report.unresolved);
                let own = events.filter(|e| (e.i, e.j) == (i, j));
                since.sum += own.map(|e| i64::from(e.sign)).sum::<i64>();
                let mut defects = report.defects.iter().filter(of_pair);
                since.untold |= defects.any(|d| d.kind.is_of_step());
                if let Some(missing) = certificate.undefined.iter().find(of_pair) {
                    since.touched |= missing.kind == DefectKind::Contact;
                    // A loop of fewer than three points, or splines that are too close: the
                    // polylines do not represent the curves.
                    since.untold |= missing.kind != DefectKind::Contact;
                    continue;
                }
                let link = certificate.links.iter().find(|l| (l.i, l.j) == (i, j));
                let lambda = link.map_or(0, |l| l.lambda);
                if let Some(before) = since.lambda.filter(|_| !since.untold) {
                    assert_eq!(
                        lambda,
                        before + since.sum,
                        "{what}, pair {i} {j}: {report:?}"
                    );
                    self.through_contact[0] += u64::from(since.touched);
                    self.through_contact[1] += u64::from(since.touched && since.sum != 0);
                }
                *since = Since {
                    lambda: Some(lambda),
                    ..start
                };
            }
        }
    }
}

/// Numbers of frames and findings.
#[derive(Debug, Default)]
struct Tally {
    intact: u64,
    changed: u64,
    contact: u64,
    undecided: u64,
    full: u64,
    quiet: u64,
    partial: u64,
    /// Number of pull-throughs, and of undecided steps.
    events: u64,
    untold: u64,
    /// Number of frames that were not searched for pull-throughs, although they moved.
    unsearched: u64,
}

impl Tally {
    fn add(&mut self, o: &Tally) {
        self.intact += o.intact;
        self.changed += o.changed;
        self.contact += o.contact;
        self.undecided += o.undecided;
        self.full += o.full;
        self.quiet += o.quiet;
        self.partial += o.partial;
        self.events += o.events;
        self.untold += o.untold;
        self.unsearched += o.unsearched;
    }
}

impl Both {
    fn new(events: Events) -> Both {
        let [incremental, full] = [Strategy::Incremental, Strategy::Full].map(|strategy| {
            Verifier::new(VerifierOptions {
                strategy,
                events,
                ..VerifierOptions::default()
            })
            .unwrap()
        });
        Both {
            incremental,
            full,
            tally: Tally::default(),
            balance: (events != Events::Off).then(Balance::new),
        }
    }

    /// Verifies a frame by both verifiers, compares the reports, and returns one.
    fn step(&mut self, frame: u64, set: &CurveSet, what: &dyn std::fmt::Display) -> Report {
        let found = self.incremental.step(frame, 0.5, set).unwrap();
        let mut expected = self.full.step(frame, 0.5, set).unwrap();
        // Except for the sizes of the scene, counts of work depend on earlier frames.
        let sizes = |r: &Report| (r.stats.curves, r.stats.segments, r.stats.open_curves);
        assert_eq!(sizes(&found), sizes(&expected), "{what}, frame {frame}");
        expected.stats = found.stats;
        assert_eq!(found, expected, "{what}, frame {frame}");
        *match found.verdict {
            Verdict::Intact => &mut self.tally.intact,
            Verdict::Changed => &mut self.tally.changed,
            Verdict::Contact => &mut self.tally.contact,
            _ => &mut self.tally.undecided,
        } += 1;
        let defects = || found.defects.iter().map(|d| d.kind);
        // In every frame, the sum of the signs of the events is compared with the linking numbers.
        assert!(
            defects().all(|kind| kind != DefectKind::Unaccounted),
            "{what}, frame {frame}: {found:?}"
        );
        self.tally.events += found.events.len() as u64;
        self.tally.untold += defects().filter(|kind| kind.is_of_step()).count() as u64;
        let work = self.incremental.work();
        self.tally.unsearched += u64::from(frame > 0 && work.searched == 0);
        *match work.route {
            Route::Full => &mut self.tally.full,
            Route::Quiet => &mut self.tally.quiet,
            Route::Partial => &mut self.tally.partial,
        } += 1;
        if let Some(balance) = &mut self.balance {
            balance.add(&found, set, &format!("{what}, frame {frame}"));
        }
        // Most reference frames are ready for the next frame, some come later.
        if frame % 4 != 3 {
            self.incremental.settle();
        }
        found
    }
}

/// Polylines on a lattice: contacts in most frames, of open and closed curves, which begin, last,
/// move and end.
fn snapped_sequences(seeds: Range<u64>) {
    let (mut all, mut through_contact) = (Tally::default(), [0; 2]);
    for seed in seeds {
        let mut random = Random::new(seed);
        let precision = random.pick(&[Precision::F32, Precision::F64]);
        let curves = 2 + random.below(3);
        let set = random_set(&mut random, Basis::Polyline, precision, curves);
        let events = random.pick(&[Events::Between, Events::All]);
        let what = format!("lattice seed {seed}, {precision:?}, events {events}");
        let width = random.pick(&[0.25, 0.5, 0.125, 1.0]);
        let mut both = Both::new(events);
        let mut movie = Movie::new(random, set);
        movie.lattice = Some(width);
        for frame in 0..25 {
            movie.advance(frame);
            both.step(frame, &movie.set, &what);
        }
        let balance = both.balance.expect("pull-throughs are searched for");
        for (all, own) in through_contact.iter_mut().zip(balance.through_contact) {
            *all += own;
        }
        all.add(&both.tally);
    }
    println!("lattice: {all:?}; through contact, not 0: {through_contact:?}");
    let [sums, changes] = through_contact;
    assert!(sums > 20 && changes > 2, "{through_contact:?}");
}

#[test]
fn polylines_that_touch_on_a_lattice() {
    snapped_sequences(100_000..100_150);
}

/// The same test with 20 times as many sequences.
#[test]
#[ignore = "takes ten minutes"]
fn very_many_sequences_on_a_lattice() {
    snapped_sequences(200_000..203_000);
}

/// Runs sequences of few curves that all move, and checks that findings are frequent enough.
fn sequences(basis: Basis, precision: Precision, seeds: Range<u64>) {
    let all = run(basis, precision, seeds, 2..=MOST);
    let total = all.intact + all.changed + all.contact + all.undecided;
    for (verdict, least) in [(all.intact, 10), (all.changed, 10), (all.undecided, 100)] {
        assert!(verdict > total / least / 2, "{all:?}");
    }
    for route in [all.full, all.quiet, all.partial] {
        assert!(route > total / 10, "{all:?}");
    }
    // Points of splines are computed, so splines that touch are too close to decide.
    assert_eq!(all.contact > total / 20, basis == Basis::Polyline);
}

/// Runs sequences of many curves of which few move, this many for each basis in both precisions,
/// and checks that findings are frequent enough.
fn calm_sequences(first: u64, count: u64) {
    let mut all = Tally::default();
    for precision in [Precision::F32, Precision::F64] {
        for (basis, share) in Basis::ALL.into_iter().zip([1, 3, 3, 6]) {
            let seeds = first..first + count / share;
            all.add(&run(basis, precision, seeds, 40..=90));
        }
    }
    let total = all.full + all.quiet + all.partial;
    for route in [all.full, all.quiet, all.partial] {
        assert!(route > total / 20, "{all:?}");
    }
}

fn run(
    basis: Basis,
    precision: Precision,
    seeds: Range<u64>,
    curves: RangeInclusive<usize>,
) -> Tally {
    let mut all = Tally::default();
    for seed in seeds {
        let mut random = Random::new(seed);
        let curves = curves.start() + random.below(curves.end() - curves.start() + 1);
        let set = random_set(&mut random, basis, precision, curves);
        let length = if seed % 50 == 0 {
            150
        } else {
            20 + random.below(15) as u64
        };
        let events = random.pick(&[Events::Off, Events::Between, Events::All]);
        let mut both = Both::new(events);
        let what = format!("{basis:?} {precision:?} seed {seed}, events {events}");
        let mut movie = Movie::new(random, set);
        for frame in 0..length {
            if frame > 0 || seed % 4 == 0 {
                movie.advance(frame);
            }
            both.step(frame, &movie.set, &what);
        }
        all.add(&both.tally);
    }
    println!("{basis:?} {precision:?}: {all:?}");
    all
}

#[test]
fn polylines_in_single_precision() {
    sequences(Basis::Polyline, Precision::F32, 0..400);
}

#[test]
fn polylines_in_double_precision() {
    sequences(Basis::Polyline, Precision::F64, 10_000..10_400);
}

#[test]
fn catmull_rom_curves() {
    sequences(Basis::CatmullRom, Precision::F32, 20_000..20_150);
    sequences(Basis::CatmullRom, Precision::F64, 30_000..30_060);
}

#[test]
fn b_splines() {
    sequences(Basis::BSpline, Precision::F32, 40_000..40_150);
    sequences(Basis::BSpline, Precision::F64, 50_000..50_060);
}

#[test]
fn bezier_curves() {
    sequences(Basis::Bezier, Precision::F32, 60_000..60_100);
    sequences(Basis::Bezier, Precision::F64, 70_000..70_060);
}

#[test]
fn many_curves_of_which_few_move() {
    calm_sequences(80_000, 36);
}

/// For changes of the incremental verification: 100 times as many sequences, with other seeds.
#[test]
#[ignore = "takes an hour"]
fn very_many_sequences() {
    for basis in Basis::ALL {
        for precision in [Precision::F32, Precision::F64] {
            sequences(basis, precision, 1_000_000..1_025_000);
        }
    }
}

/// The same for [`calm_sequences`].
#[test]
#[ignore = "takes half an hour"]
fn very_many_calm_sequences() {
    calm_sequences(2_000_000, 6000);
}

/// Regression test: incremental verification called a ring degenerate that was degenerate only in
/// the reference frame, if little else moved.
#[test]
fn a_loop_that_was_degenerate_in_the_reference_frame_recovers() {
    let scene: Scene = "chainmail:rows=6,columns=6".parse().unwrap();
    let mut set = scene.build().unwrap().curves;
    let whole = values(Frames::new(&set, 1.0).at(&MotionKind::Still.into(), 0.0, 0));
    let mut collapsed = whole.clone();
    for k in 1..set.curve(0).points as usize {
        collapsed.copy_within(0..3, 3 * k);
    }
    let mut both = Both::new(Events::Off);
    for (frame, xyz) in [&whole, &collapsed, &collapsed, &whole, &whole]
        .iter()
        .enumerate()
    {
        update(&mut set, xyz).unwrap();
        let report = both.step(frame as u64, &set, &"a ring");
        let expected = [Verdict::Intact, Verdict::Undecided][usize::from(*xyz == &collapsed)];
        assert_eq!(report.verdict, expected, "frame {frame}");
    }
}

/// The curves of a stream may change between frames, if their number stays the same.
#[test]
fn sets_with_changed_curves() {
    for seed in 0..100 {
        let mut random = Random::new(900_000 + seed);
        let mut movies: Vec<Movie> = (0..3)
            .map(|_| {
                let basis = random.pick(&Basis::ALL);
                let precision = random.pick(&[Precision::F32, Precision::F64]);
                let set = random_set(&mut random, basis, precision, 4);
                Movie::new(Random::new(random.next()), set)
            })
            .collect();
        // There is no motion between different curves.
        let mut both = Both::new(Events::Off);
        let mut now = 0;
        for frame in 0..30 {
            if random.one_in(5) {
                now = random.below(movies.len());
            }
            movies[now].advance(frame);
            both.step(frame, &movies[now].set, &format!("seed {seed}, set {now}"));
        }
    }
}

/// Every synthetic pull-through is found in its frame, and disappears when it is reverted, for any
/// other motion.
#[test]
fn finds_synthetic_pull_throughs() {
    for (text, diameter) in [
        ("chainmail:rows=5,columns=5", 0.2),
        ("chainmail:rows=5,columns=5,crumple=1", 0.2),
        ("knit:rows=4,stitches=16,segments=512", 1.0),
        ("knit:rows=5,stitches=20,segments=2000", 1.0),
        ("ribbon:segments=3000,lambda=30", 0.01),
    ] {
        let mut set = text.parse::<Scene>().unwrap().build().unwrap().curves;
        let pulls = pull_throughs(&set);
        for (name, amplitude) in [
            ("still", 0.0),
            ("smooth", 1e-3),
            ("iid", 1e-3),
            ("translate", 0.0),
            ("rotate+smooth", 1e-4),
            ("scale+iid", 1e-4),
        ] {
            let motion: Motion = name.parse().unwrap();
            let mut frames = Frames::new(&set, diameter);
            let mut both = Both::new(Events::All);
            let what = format!("{text} {name}");
            for frame in 0..30 {
                let pull = &pulls[frame as usize % pulls.len()];
                // Some persist for several frames.
                let pulled = frame % 3 == 2 || (10..14).contains(&frame);
                if pulled {
                    frames.pull(pull);
                }
                set.update(frames.at(&motion, amplitude * diameter, frame))
                    .unwrap();
                let report = both.step(frame, &set, &what);
                let pairs: Vec<_> = report.changes.iter().map(|c| (c.i, c.j)).collect();
                let planted = if pulled { vec![pull.pair] } else { vec![] };
                assert_eq!(pairs, planted, "{what}, frame {frame}");
                frames.release();
            }
            // Restores the scene for the next motion.
            set.update(frames.at(&motion, 0.0, 0)).unwrap();
        }
    }
}
