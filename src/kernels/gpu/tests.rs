//! Programs and layouts, without an adapter; and kernels against the oracle, with one.
//!
//! Those with one are ignored, so that they never count as passed where there is none:
//! `cargo test --release gpu:: -- --ignored`.

use super::*;
use crate::curve::{Basis, Positions};
use crate::kernels::conformance::polygons::{Polygon, Random, floats, set_of};
use crate::kernels::crossings::{Workspaces, linking_number};
use crate::kernels::direct::{Direct, Formula};
use crate::kernels::{Accelerator, Accuracy, Calibration, Method, Offload, oracle};
use crate::pairs::Trees;
use crate::scenes::Scene as Model;
use crate::verdict::AbortOn;
use crate::verifier::Verifier;
use layout::{Criterion, CrossingSum, Node, NodePair, Undecided};
use std::mem::offset_of;
use wgpu::naga;

fn parsed(stage: &Stage) -> naga::Module {
    let source = (stage.source)();
    let parsed = naga::front::wgsl::parse_str(&source);
    parsed.unwrap_or_else(|e| panic!("{}: {}", stage.name, e.emit_to_string(&source)))
}

#[test]
fn all_programs_are_valid_and_need_nothing_special() {
    for stage in stages() {
        let module = parsed(&stage);
        let flags = naga::valid::ValidationFlags::all();
        let none = naga::valid::Capabilities::empty();
        let valid = naga::valid::Validator::new(flags, none).validate(&module);
        assert!(valid.is_ok(), "{}: {valid:?}", stage.name);
        let main = &module.entry_points[0];
        assert_eq!((module.entry_points.len(), &main.name[..]), (1, "main"));
        assert!(main.workgroup_size.iter().product::<u32>() <= 256);
    }
}

/// Compares a struct of programs with the one of ours.
fn same_layout(name: &str, size: usize, offsets: &[(&str, usize)]) {
    let mut seen = 0;
    for stage in stages() {
        let module = parsed(&stage);
        for (_, ty) in module.types.iter() {
            let naga::TypeInner::Struct { members, span } = &ty.inner else {
                continue;
            };
            if ty.name.as_deref() != Some(name) {
                continue;
            }
            seen += 1;
            assert_eq!(*span as usize, size, "{name} in {}", stage.name);
            let theirs: Vec<(&str, usize)> = members
                .iter()
                .map(|m| (m.name.as_deref().unwrap_or(""), m.offset as usize))
                .collect();
            assert_eq!(theirs, offsets, "{name} in {}", stage.name);
        }
    }
    assert!(seen > 0, "no program has {name}");
}

macro_rules! same_layout {
    ($name:ident: $($field:ident),+) => {
        same_layout(
            stringify!($name),
            size_of::<$name>(),
            &[$((stringify!($field), offset_of!($name, $field))),+],
        );
    };
}

#[test]
fn structs_lie_in_memory_as_programs_expect() {
    same_layout!(Parameters: radius, zero, capacity, items);
    same_layout!(Tile: pair, axis, first_row, rows, first_column, columns, padding);
    same_layout!(CrossingSum: signs, crossings, tests);
    same_layout!(Undecided: pair, upper, lower);
    same_layout!(
        Node: centre, radius, centre_rest, length, second, fourth, first, segments, tangents, right, leaf, moments, padding
    );
    same_layout!(NodePair: pair, first, second);
    same_layout!(Criterion: beta, share);
}

fn adapter() -> Gpu {
    Gpu::open(&Choice::Gpu).unwrap_or_else(|trouble| panic!("{trouble}"))
}

/// A sum.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Direct,
    /// By the bound, or with a beta.
    BarnesHut(Option<f64>),
}

const ALL_KINDS: [Kind; 3] = [
    Kind::Direct,
    Kind::BarnesHut(None),
    Kind::BarnesHut(Some(1.5)),
];

/// All pairs of a set, by a sum.
fn sums(gpu: &Gpu, set: &CurveSet, kind: Kind) -> Vec<(Pair, Estimate)> {
    let n = set.len() as u32;
    let pairs: Vec<Pair> = (0..n).flat_map(|i| (0..i).map(move |j| (j, i))).collect();
    let frame = Frame::new(set);
    let engine = &mut gpu.lock();
    let found = match kind {
        Kind::Direct => direct::linking_numbers(engine, &frame, &pairs),
        Kind::BarnesHut(beta) => {
            let forest = barnes_hut::Forest::new(&frame);
            barnes_hut::linking_numbers(engine, &frame, &forest, &pairs, beta)
        }
    };
    pairs.into_iter().zip(found.unwrap()).collect()
}

/// Many polygons in one set: neighbours make the links.
fn set_of_all(polygons: &[Vec<[f64; 3]>], single: bool) -> CurveSet {
    let counts: Vec<i32> = polygons.iter().map(|p| -(p.len() as i32)).collect();
    let xyz: Vec<f64> = polygons.iter().flatten().flatten().copied().collect();
    let narrow: Vec<f32> = xyz.iter().map(|&x| x as f32).collect();
    let positions = match single {
        true => Positions::F32(&narrow),
        false => Positions::F64(&xyz),
    };
    CurveSet::from_counts(Basis::Polyline, &counts, positions).unwrap()
}

/// Random polygons of one kind: how many, with how many vertices, on a grid of which size, times which scale.
const KINDS: [(u64, usize, u64, u64, f64); 7] = [
    (1, 60, 20, 1000, 1.0),
    (2, 60, 200, 1 << 24, 2.3e-10),
    (3, 60, 100, 1 << 39, 2.0),
    (4, 100, 7, 3, 1.0),
    (5, 100, 9, 5, 0.1),
    (6, 100, 12, 9, 1.0),
    (7, 40, 150, 60, 1e30),
];

fn polygons((seed, count, most, size, _): (u64, usize, u64, u64, f64)) -> Vec<Polygon> {
    let mut random = Random::new(seed * 7919);
    (0..count).map(|_| random.polygon(most, size)).collect()
}

#[test]
#[ignore = "needs an adapter"]
fn sums_are_within_their_bounds_of_the_oracle() {
    let gpu = adapter();
    let all = KINDS.iter().flat_map(|&k| ALL_KINDS.map(|sum| (k, sum)));
    for (kind, sum) in all {
        let polygons = polygons(kind);
        let scaled: Vec<_> = polygons.iter().map(|p| floats(p, kind.4)).collect();
        let (mut decided, mut numbers) = (0, 0);
        for ((i, j), found) in sums(&gpu, &set_of_all(&scaled, false), sum) {
            let want = oracle::linking_number(&polygons[i as usize], &polygons[j as usize]);
            let Some(want) = want else {
                assert_eq!(found.integer(), None, "touching: {found:?}");
                continue;
            };
            numbers += 1;
            let off = (found.value - want as f64).abs();
            assert!(off <= found.bound, "{kind:?}: {found:?}, {want}");
            if let Some(integer) = found.integer() {
                decided += 1;
                assert_eq!(integer, want);
            }
        }
        println!("{kind:?}, {sum:?}: {decided} of {numbers} decided");
        assert!(decided > numbers / 10);
    }
}

/// A square, and triangles that go through it, or past it, closer and closer to an edge, a vertex or the middle of one.
#[test]
#[ignore = "needs an adapter"]
fn curves_that_nearly_touch_are_right_or_undecided() {
    let gpu = adapter();
    let corners = [[-2., -2., 0.], [2., -2., 0.], [2., 2., 0.], [-2., 2., 0.]];
    let mut decided = [0; 3];
    for size in [1.0, 1e-6, 3e6] {
        let mut polygons = vec![corners.map(|p| p.map(|x| x * size)).to_vec()];
        for place in [[2.0, 0.3], [2.0, 2.0], [0.3, 2.0]] {
            for gap in (1..60).flat_map(|k| [0.5f64.powi(k), -0.5f64.powi(k), 0.0]) {
                let at = [place[0] + gap, place[1] + gap];
                let through = [[at[0], at[1], -1.0], [at[0], at[1], 1.0], [9.0, 7.0, 0.5]];
                polygons.push(through.map(|p| p.map(|x| x * size)).to_vec());
            }
        }
        for single in [true, false] {
            let set = set_of_all(&polygons, single);
            counts_agree(&gpu, &set);
            for (kind, decided) in ALL_KINDS.into_iter().zip(&mut decided) {
                let with_square = |(pair, _): &(Pair, Estimate)| pair.0 == 0;
                for ((_, j), found) in sums(&gpu, &set, kind).into_iter().filter(with_square) {
                    let vertex = set.point(j as usize, 0);
                    let edge = set.point(0, 2);
                    let inside = (0..2).all(|x| vertex[x] < edge[x]);
                    let touching = (0..2).any(|x| vertex[x] == edge[x])
                        && (0..2).all(|x| vertex[x] <= edge[x]);
                    if touching {
                        assert_eq!(found.integer(), None, "{size}, {kind:?}, {j}: {found:?}");
                        continue;
                    }
                    let want = i64::from(inside);
                    let off = (found.value - want as f64).abs();
                    assert!(off <= found.bound, "{size}, {kind:?}, {j}: {found:?}");
                    assert!(found.integer().is_none_or(|n| n == want));
                    *decided += usize::from(found.integer().is_some());
                }
            }
        }
    }
    println!("{decided:?} decided");
    assert!(decided.iter().all(|&n| n > 6 * 3 * 2 * 10), "{decided:?}");
}

/// Crossings on the adapter and on the processor: the same numbers, places and counts.
fn counts_agree(gpu: &Gpu, set: &CurveSet) -> (u64, u64) {
    let n = set.len() as u32;
    let mut trees = Trees::default();
    trees.refit(set);
    let whole = |i: u32| set.curve(i as usize).closed && set.has_three_distinct_points(i as usize);
    let pairs: Vec<Pair> = (0..n)
        .flat_map(|i| (0..i).map(move |j| (j, i)))
        .filter(|&(i, j)| whole(i) && whole(j))
        .collect();
    let workspaces = Workspaces::default();
    let scene = Scene {
        set,
        trees: &trees,
        workspaces: &workspaces,
    };
    let frame = gpu.send(set).unwrap();
    let (found, stats, undecided) = gpu.count(&frame, scene, &pairs).unwrap();
    let mut workspace = workspaces.take();
    for (&pair, &found) in pairs.iter().zip(&found) {
        let want = linking_number(scene, pair, None, &mut workspace);
        assert_eq!(found, want, "{pair:?}");
    }
    let mut want = workspace.take_stats();
    if Frame::new(set).radius > 0.0 {
        // What counts as a test there depends on how far vertices may be off, and here on the padding of boxes.
        want.tests = stats.tests;
    }
    // A test that one of them decides roughly the other may decide exactly, where it makes batches of others.
    want.exact = stats.exact;
    assert_eq!(stats, want);
    (stats.tests, undecided)
}

#[test]
#[ignore = "needs an adapter"]
fn crossings_are_those_of_the_processor() {
    let gpu = adapter();
    for kind in KINDS {
        let scaled: Vec<_> = polygons(kind).iter().map(|p| floats(p, kind.4)).collect();
        for single in [true, false] {
            let (tests, undecided) = counts_agree(&gpu, &set_of_all(&scaled, single));
            println!("{kind:?}, {single}: {undecided} of {tests} tests left to the processor");
        }
    }
}

const SCENES: [&str; 9] = [
    "ribbon:segments=1000,lambda=10",
    "ribbon:segments=5000,lambda=-33",
    "torus_link:segments=2000,toroidal=3,poloidal=-5",
    "woundball:segments=3001,crossings=100",
    "knit:rows=3,stitches=16,segments=1152",
    "chainmail:rows=4,columns=6",
    "square_link:loops=12,segments=97",
    "rubber_bands:bands=10",
    "torus_zero:segments=2001,periods=2",
];

#[test]
#[ignore = "needs an adapter"]
fn scenes_have_the_numbers_of_their_constructions() {
    let gpu = adapter();
    for text in SCENES {
        let built = text.parse::<Model>().unwrap().build().unwrap();
        let polylines = crate::homotopic_polylines(&built.curves).unwrap().curves;
        for kind in ALL_KINDS {
            let mut worst = [0f64; 2];
            for (pair, found) in sums(&gpu, &polylines, kind) {
                let links = &built.certificate.links;
                let want = links.iter().find(|l| (l.i, l.j) == pair);
                let want = want.map_or(0, |l| l.lambda);
                let off = (found.value - want as f64).abs();
                assert!(off <= found.bound, "{text}, {kind:?}: {found:?}");
                assert!(found.integer().is_none_or(|i| i == want));
                if found.bound.is_finite() {
                    worst = [worst[0].max(off), worst[1].max(found.bound)];
                }
            }
            println!("{text}, {kind:?}: off by {worst:?}");
        }
        let (tests, undecided) = counts_agree(&gpu, &polylines);
        println!("{text}: {undecided} of {tests} tests undecided");
    }
}

#[test]
#[ignore = "needs an adapter"]
fn sums_have_the_same_bits_on_every_run_and_whichever_curve_comes_first() {
    let gpu = adapter();
    let model: Model = "torus_link:segments=3000,toroidal=2,poloidal=3"
        .parse()
        .unwrap();
    let set = model.build().unwrap().curves;
    for kind in ALL_KINDS {
        let first = sums(&gpu, &set, kind);
        let integer = first[0].1.integer();
        assert!(
            integer == Some(6) || kind == Kind::BarnesHut(Some(1.5)),
            "{kind:?}"
        );
        assert_eq!(first, sums(&gpu, &set, kind));
    }
    let frame = Frame::new(&set);
    let both = direct::linking_numbers(&mut gpu.lock(), &frame, &[(0, 1), (1, 0), (0, 0), (0, 2)]);
    let both = both.unwrap();
    assert_eq!(both[0], both[1]);
    assert_eq!(both[2..], [Estimate::UNKNOWN; 2]);
}

#[test]
#[ignore = "needs an adapter"]
fn a_failing_adapter_is_an_error_and_the_processor_goes_on() {
    let set = set_of(
        &[[-2., -2., 0.], [2., -2., 0.], [2., 2., 0.], [-2., 2., 0.]],
        &[[0., 0., -1.], [0., 0., 1.], [9., 7., 0.5]],
        true,
    );
    let processor = || Direct::new(&set, Formula::Arctangent);
    let want = processor().linking_number((0, 1)).integer();
    // No room.
    let gpu = adapter();
    gpu.lock().device.restrict(64);
    let found = direct::linking_numbers(&mut gpu.lock(), &Frame::new(&set), &[(0, 1)]);
    assert!(matches!(found, Err(Trouble::Limit { .. })), "{found:?}");
    let sum = DirectSum::new(&gpu, &set, Box::new(processor()));
    assert_eq!(sum.linking_number((0, 1)).integer(), want);
    // Lost.
    let gpu = adapter();
    gpu.lock().device.destroy();
    let found = direct::linking_numbers(&mut gpu.lock(), &Frame::new(&set), &[(0, 1)]);
    assert!(matches!(found, Err(Trouble::Failed(_))), "{found:?}");
    let sum = DirectSum::new(&gpu, &set, Box::new(processor()));
    assert_eq!(sum.linking_number((0, 1)).integer(), want);
}

/// Frames before and after the loss of the adapter: the same certificates, and no adapter from then on.
#[test]
#[ignore = "needs an adapter"]
fn a_watch_goes_on_without_its_adapter() {
    let model: Model = "chainmail:rows=5,columns=6".parse().unwrap();
    let built = model.build().unwrap();
    let mut verifier = Verifier::new(AbortOn::Never);
    verifier.set_device(&Choice::Gpu).unwrap();
    assert_eq!(*verifier.certify(&built.curves).0, built.certificate);
    assert!(verifier.offload().tests > 0 && verifier.device().is_some());
    let gpu = Gpu::shared(&Choice::Gpu).unwrap();
    gpu.lock().device.destroy();
    assert_eq!(*verifier.certify(&built.curves).0, built.certificate);
    assert_eq!(verifier.device(), None);
    assert_eq!(*verifier.certify(&built.curves).0, built.certificate);
    assert_eq!(verifier.offload(), Offload::default());
    // Whoever asks anew gets one that works.
    verifier.set_device(&Choice::Gpu).unwrap();
    assert_eq!(*verifier.certify(&built.curves).0, built.certificate);
    assert!(verifier.offload().tests > 0);
}

/// A calibration of this adapter, which was not measured: see [`Calibration::made_up`].
fn made_up(round_trip_ms: f64, speed: f64) -> Calibration {
    let DeviceInfo { name, driver, .. } = adapter().info();
    Calibration {
        adapter: name,
        driver,
        ..Calibration::made_up(round_trip_ms, speed)
    }
}

#[test]
#[ignore = "needs an adapter"]
fn an_adapter_that_is_ours_to_choose_is_taken_where_its_calibration_says_that_it_wins() {
    let (wins, loses) = (made_up(1e-3, 1e6), made_up(1e3, 1e-3));
    let other = Calibration {
        driver: "another".into(),
        ..wins.clone()
    };
    for (calibration, want) in [(wins, true), (loses, false), (other, false)] {
        let mut verifier = Verifier::new(AbortOn::Never);
        verifier.set_accelerator(Accelerator::choosing_by(Some(calibration)));
        for text in [
            "chainmail:rows=12,columns=12",
            "torus_link:segments=8000,toroidal=40,poloidal=40",
        ] {
            let built = text.parse::<Model>().unwrap().build().unwrap();
            for method in [Method::Auto, Method::Crossings] {
                verifier.set_kernel(method, Accuracy::default());
                assert_eq!(*verifier.certify(&built.curves).0, built.certificate);
                assert_eq!(verifier.offload().tests > 0, want, "{text}");
                assert_eq!(verifier.device().is_some(), want);
            }
            for method in [Method::Direct, Method::BarnesHut] {
                verifier.set_kernel(method, Accuracy::default());
                assert_eq!(*verifier.certify(&built.curves).0, built.certificate);
            }
        }
    }
}

/// Too few pairs at first, then enough for an adapter; and a frame that is not computed in full gives it nothing.
#[test]
#[ignore = "needs an adapter"]
fn a_chosen_adapter_counts_the_large_blocks_of_an_early_exit_and_of_no_quiet_frame() {
    let built = "chainmail:rows=24,columns=24".parse::<Model>().unwrap();
    let built = built.build().unwrap();
    let baseline = || built.certificate.clone();
    let chosen = || Accelerator::choosing_by(Some(made_up(0.05, 1e6)));
    let mut early = Verifier::with_baseline(AbortOn::Never, baseline());
    early.set_accelerator(chosen());
    early.set_early_exit(true);
    let report = early.step(0, 0.0, &built.curves).unwrap();
    assert_eq!(report.verdict, crate::Verdict::Intact);
    assert!(early.offload().tests > 0);
    let mut watch = Verifier::with_baseline(AbortOn::Never, baseline());
    watch.set_accelerator(chosen());
    watch.set_incremental(true);
    for (seq, full) in [(0, true), (1, false)] {
        let report = watch.step(seq, 0.0, &built.curves).unwrap();
        assert_eq!(report.verdict, crate::Verdict::Intact);
        assert_eq!(watch.offload().tests > 0, full, "{:?}", watch.work());
        watch.settle();
    }
}

#[test]
#[ignore = "needs an adapter"]
fn a_list_that_is_too_short_is_made_longer() {
    let gpu = adapter();
    gpu.lock().room = 1;
    let scaled: Vec<_> = polygons(KINDS[3]).iter().map(|p| floats(p, 1.0)).collect();
    let (_, undecided) = counts_agree(&gpu, &set_of_all(&scaled, true));
    assert!(undecided > 1 && gpu.lock().room as u64 >= undecided);
}

/// Little room: lists grow as far as they can, and then work is done in parts. The same bits.
#[test]
#[ignore = "needs an adapter"]
fn sums_are_the_same_in_parts() {
    let gpu = adapter();
    for (text, most) in [
        ("chainmail:rows=4,columns=6", 1 << 15),
        ("torus_link:segments=900,toroidal=2,poloidal=3", 1 << 18),
    ] {
        let set = text.parse::<Model>().unwrap().build().unwrap().curves;
        for kind in [Kind::Direct, Kind::BarnesHut(None)] {
            let want = sums(&gpu, &set, kind);
            let small = adapter();
            small.lock().device.restrict(most);
            small.lock().agenda_room = [64, 16];
            assert_eq!(sums(&small, &set, kind), want, "{text}, {kind:?}");
        }
    }
}

/// Two curves of `2^16` segments, so small beside a third that all pairs are in doubt: `2^32`, which in 32 bits is none.
#[test]
#[ignore = "needs an adapter, and minutes in software"]
fn more_doubts_than_32_bits_hold_are_not_forgotten() {
    let n = 1 << 16;
    let angle = |k: usize| k as f64 / n as f64 * std::f64::consts::TAU;
    let small = |p: [f64; 3]| p.map(|x| x * 2f64.powi(-40));
    let first = (0..n).map(|k| small([angle(k).cos(), angle(k).sin(), 0.0]));
    let second = (0..n).map(|k| small([1.0 + angle(k).cos(), 0.0, angle(k).sin()]));
    let large = vec![[0.5, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, 0.0, 0.5]];
    for single in [true, false] {
        let set = set_of_all(
            &[
                first.clone().collect(),
                second.clone().collect(),
                large.clone(),
            ],
            single,
        );
        let gpu = adapter();
        let found = sums(&gpu, &set, Kind::Direct)[0];
        assert_eq!((found.0, found.1.integer()), ((0, 1), None), "{found:?}");
    }
}

#[test]
#[ignore = "needs an adapter"]
fn an_unknown_name_lists_the_adapters() {
    let trouble = Gpu::open(&Choice::Named("no such adapter".into())).unwrap_err();
    let words = trouble.to_string();
    let name = adapter().info().name;
    assert!(
        words.contains("no such adapter") && words.contains(&name),
        "{words}"
    );
}

#[test]
#[ignore = "needs an adapter, and minutes in software"]
fn the_ribbon_of_two_hundred_thousand_segments_is_summed() {
    let gpu = adapter();
    let model: Model = "ribbon:segments=200000,lambda=10".parse().unwrap();
    let set = model.build().unwrap().curves;
    let start = std::time::Instant::now();
    let found = sums(&gpu, &set, Kind::Direct)[0].1;
    println!("{found:?}, {:?}", start.elapsed());
    assert!((found.value - 10.0).abs() < 1e-4);
    assert_eq!(found.integer(), Some(10));
}

#[test]
#[ignore = "a measurement: what the processor does for a count on an adapter"]
fn measure_the_lists_of_a_count() {
    for text in [
        "ribbon:segments=200000,lambda=10",
        "chainmail",
        "square_link",
    ] {
        let set = text.parse::<Model>().unwrap().build().unwrap().curves;
        let mut trees = Trees::default();
        trees.refit(&set);
        let mut search = crate::pairs::LinkSearch::default();
        let pairs = &*search.find(trees.roots());
        let workspaces = Workspaces::default();
        let scene = Scene {
            set: &set,
            trees: &trees,
            workspaces: &workspaces,
        };
        for _ in 0..3 {
            let start = std::time::Instant::now();
            let frame = Frame::new(&set);
            let framed = start.elapsed();
            let tiles = crossings::tiles(&frame, scene, pairs);
            let listed = start.elapsed() - framed;
            let tests: u64 = (tiles.iter())
                .map(|t| u64::from(t.rows) * u64::from(t.columns))
                .sum();
            println!(
                "{text}: frame {framed:?}, {} tiles of {tests} pairs {listed:?}",
                tiles.len()
            );
        }
    }
}
