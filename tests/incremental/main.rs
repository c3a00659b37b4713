//! Compares incremental with full verification: on every frame of random moving sets, the same
//! verdict, and the same changes and defects with the same places.
//!
//! `cargo test --release --test incremental` runs hundreds of sequences in seconds. Many more, for
//! about an hour:
//!
//! ```sh
//! cargo test --release --test incremental -- --ignored --nocapture
//! ```
//!
//! Each sequence depends only on its seed, which a failure prints.

mod both;
mod curves;
mod movie;
mod rejected;
mod sets;
#[path = "../support/mod.rs"]
mod support;

use both::{Both, Tally};
use linkwatch::scenes::{Frames, Motion, MotionKind, Scene, pull_throughs};
use linkwatch::{Basis, Events, Precision, Verdict};
use movie::Movie;
use sets::{MOST, random_set, update, values};
use std::ops::{Range, RangeInclusive};
use support::random::Random;

/// Polylines on a lattice, which touch in most frames. Contacts of open and closed curves begin,
/// last, move and end.
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
            let _ = both.step(frame, &movie.set, &what);
        }
        let balance = both.balance.expect("pull-throughs are searched for");
        for (all, own) in through_contact.iter_mut().zip(balance.through_contact) {
            *all += own;
        }
        all.add(&both.tally);
    }
    println!("lattice: {all:?}; through contact, not 0: {through_contact:?}");
    let [sums, changes] = through_contact;
    assert!(sums > 8 && changes > 0, "{through_contact:?}");
}

#[test]
fn polylines_that_touch_on_a_lattice() {
    snapped_sequences(100_000..100_060);
}

/// The same test with 50 times as many sequences.
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
    // Few frames need a full run: the first ones, and those in which a search takes longer.
    for (route, least) in [(all.full, 50), (all.quiet, 10), (all.partial, 10)] {
        assert!(route > total / least, "{all:?}");
    }
    // Points of splines are computed, so splines that touch are too close to decide.
    assert_eq!(all.contact > total / 20, basis == Basis::Polyline);
}

/// Runs `count` sequences of many curves for each basis and precision, in which few curves move.
/// Checks that findings are frequent enough.
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
            let _ = both.step(frame, &movie.set, &what);
        }
        all.add(&both.tally);
    }
    println!("{basis:?} {precision:?}: {all:?}");
    all
}

#[test]
fn polylines_in_single_precision() {
    sequences(Basis::Polyline, Precision::F32, 0..60);
}

#[test]
fn polylines_in_double_precision() {
    sequences(Basis::Polyline, Precision::F64, 10_000..10_060);
}

#[test]
fn catmull_rom_curves() {
    sequences(Basis::CatmullRom, Precision::F32, 20_000..20_030);
    sequences(Basis::CatmullRom, Precision::F64, 30_000..30_012);
}

#[test]
fn b_splines() {
    sequences(Basis::BSpline, Precision::F32, 40_000..40_024);
    sequences(Basis::BSpline, Precision::F64, 50_000..50_012);
}

#[test]
fn bezier_curves() {
    sequences(Basis::Bezier, Precision::F32, 60_000..60_024);
    sequences(Basis::Bezier, Precision::F64, 70_000..70_012);
}

#[test]
fn many_curves_of_which_few_move() {
    calm_sequences(80_000, 18);
}

/// For changes of the incremental verification: some 400 times as many sequences as in
/// [`sequences`], with other seeds.
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

/// Regression test: a ring that was degenerate only in the reference frame was still reported as
/// degenerate in later frames.
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
    changed_curves(0..40);
}

#[test]
#[ignore = "takes minutes"]
fn very_many_sets_with_changed_curves() {
    changed_curves(40..2000);
}

fn changed_curves(seeds: Range<u64>) {
    for seed in seeds {
        let mut random = Random::new(900_000 + seed);
        let mut movies: Vec<Movie> = (0..3)
            .map(|_| {
                let basis = random.pick(&Basis::ALL);
                let precision = random.pick(&[Precision::F32, Precision::F64]);
                let set = random_set(&mut random, basis, precision, 4);
                Movie::new(Random::new(random.next()), set)
            })
            .collect();
        // No motion is defined between different curves, so pull-throughs are not searched for.
        let mut both = Both::new(Events::Off);
        let mut now = 0;
        for frame in 0..30 {
            if random.one_in(5) {
                now = random.below(movies.len());
            }
            movies[now].advance(frame);
            let _ = both.step(frame, &movies[now].set, &format!("seed {seed}, set {now}"));
        }
    }
}

/// Every pull-through that the test makes is found in its frame, and is undone when the test
/// reverts it, whatever the other motion.
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
