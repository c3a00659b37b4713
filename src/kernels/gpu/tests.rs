//! Tests of shaders and layouts, without an adapter, and of the kernels against the oracle, with
//! one.
//!
//! Tests that need an adapter are ignored, so that they never count as passed without one:
//! `cargo test --release gpu:: -- --ignored`.

use super::summations::DirectSum;
use super::*;
use crate::curve::{Basis, Positions};
use crate::kernels::conformance::polygons::{Polygon, Random, floats, set_of};
use crate::kernels::crossings::{Workspaces, linking_number};
use crate::kernels::gpu_use::fallback::WithFallback;
use crate::kernels::sums::direct::{Direct, Formula};
use crate::kernels::{Accuracy, Calibration, Estimate, GpuUse, Method, Offload, Summation, oracle};
use crate::pairs::Trees;
use crate::scenes::Scene as Model;
use crate::verdict::AbortOn;
use crate::verifier::Verifier;
use layout::{BoxNode, Criterion, Node, NodePair, Roots, Undecided};
use std::f64::consts::TAU;
use std::mem::offset_of;
use std::sync::LazyLock;
use wgpu::naga;

fn parsed(stage: &Stage) -> naga::Module {
    let source = (stage.source)();
    let parsed = naga::front::wgsl::parse_str(&source);
    parsed.unwrap_or_else(|e| panic!("{}: {}", stage.name, e.emit_to_string(&source)))
}

#[test]
fn all_shaders_are_valid_and_need_no_optional_feature_but_double_precision() {
    use naga::valid::Capabilities;
    let double = Capabilities::FLOAT64 | Capabilities::SHADER_INT64;
    let single = stages().into_iter().map(|s| (s, Capabilities::empty()));
    let all = single.chain(stages_in::<f64>().into_iter().map(|s| (s, double)));
    for (stage, needed) in all {
        let module = parsed(&stage);
        let flags = naga::valid::ValidationFlags::all();
        let valid = naga::valid::Validator::new(flags, needed).validate(&module);
        assert!(valid.is_ok(), "{}: {valid:?}", stage.name);
        let main = &module.entry_points[0];
        assert_eq!((module.entry_points.len(), &main.name[..]), (1, "main"));
        assert!(main.workgroup_size.iter().product::<u32>() <= 256);
    }
}

/// Compares a struct of the shaders with that of Rust.
fn same_layout(name: &str, size: usize, offsets: &[(&str, usize)]) {
    let mut seen = 0;
    for stage in stages().into_iter().chain(stages_in::<f64>()) {
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
    assert!(seen > 0, "no shader has {name}");
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
fn structs_have_the_same_layout_in_rust_and_in_shaders() {
    same_layout!(Parameters: radius, zero, first, items);
    same_layout!(Tile: pair, first_row, rows, first_column, columns, padding);
    same_layout!(BoxNode: low, first, high, below);
    same_layout!(Roots: first, count);
    same_layout!(Undecided: pair, upper, lower);
    same_layout!(
        Node: centre, radius, centre_rest, length, second, fourth, first, segments, tangents,
        right, leaf, moments, padding
    );
    same_layout!(NodePair: pair, first, second);
    same_layout!(Criterion: beta, share);
}

/// Returns direct sums computed in double precision alone, on an adapter of its own.
pub(crate) fn direct_in_double(set: &CurveSet, pairs: &[Pair]) -> Vec<Estimate> {
    // Not the shared adapter, because a test destroys that one.
    static OWN: LazyLock<Gpu> = LazyLock::new(adapter);
    let frame = Frame::<f64>::new(set);
    let found = direct::linking_numbers(&mut OWN.lock(), &frame, pairs);
    found.unwrap()
}

pub(super) fn adapter() -> Gpu {
    Gpu::open(&Device::Gpu).unwrap_or_else(|error| panic!("{error}"))
}

/// A summation kernel.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Direct,
    /// The direct sum in double precision.
    DirectDouble,
    /// Barnes-Hut with the error bound as the criterion, or with a beta.
    BarnesHut(Option<f64>),
}

const ALL_KINDS: [Kind; 4] = [
    Kind::Direct,
    Kind::DirectDouble,
    Kind::BarnesHut(None),
    Kind::BarnesHut(Some(1.5)),
];

/// Returns the sums of all pairs of a set.
fn sums(gpu: &Gpu, set: &CurveSet, kind: Kind) -> Vec<(Pair, Estimate)> {
    let n = set.len() as u32;
    let pairs: Vec<Pair> = (0..n).flat_map(|i| (0..i).map(move |j| (j, i))).collect();
    let frame = Frame::new(set);
    let state = &mut gpu.lock();
    let found = match kind {
        Kind::Direct => direct::linking_numbers(state, &frame, &pairs),
        Kind::DirectDouble => direct::linking_numbers(state, &Frame::<f64>::new(set), &pairs),
        Kind::BarnesHut(beta) => {
            let forest = barnes_hut::Forest::new(&frame);
            barnes_hut::linking_numbers(state, &frame, &forest, &pairs, beta)
        }
    };
    pairs.into_iter().zip(found.unwrap()).collect()
}

/// Returns a set of all these polygons.
pub(super) fn set_of_all(polygons: &[Vec<[f64; 3]>], single: bool) -> CurveSet {
    let counts: Vec<i32> = polygons.iter().map(|p| -(p.len() as i32)).collect();
    let xyz: Vec<f64> = polygons.iter().flatten().flatten().copied().collect();
    let narrow: Vec<f32> = xyz.iter().map(|&x| x as f32).collect();
    let positions = match single {
        true => Positions::F32(&narrow),
        false => Positions::F64(&xyz),
    };
    CurveSet::from_counts(Basis::Polyline, &counts, positions).unwrap()
}

/// Kinds of random polygons: seed, number of polygons, maximum number of vertices, size of the
/// grid, scale.
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

/// Polygons whose vertices lie at all distances, down to a unit of the grid, from a few places. So
/// segments of all lengths meet at tiny distances.
#[test]
#[ignore = "needs an adapter"]
fn sums_of_segments_of_all_sizes_are_within_their_bounds_of_the_oracle() {
    let gpu = adapter();
    let mut decided = [0; ALL_KINDS.len()];
    let mut numbers = 0;
    for seed in 1..=20 {
        let mut random = Random::new(seed);
        let mut coordinate = |bits: u64| random.next(2 << bits) - (1 << bits);
        let places: Vec<[i64; 3]> = (0..4).map(|_| [0; 3].map(|_| coordinate(38))).collect();
        let polygons: Vec<Polygon> = (0..40)
            .map(|k| {
                let vertex = |at: [i64; 3]| {
                    let bits = (coordinate(38) & 31) as u64;
                    at.map(|x| x + coordinate(bits))
                };
                let at = places.iter().cycle().skip(k % 4).copied();
                at.take(3 + k % 9).map(vertex).collect()
            })
            .collect();
        let scaled: Vec<_> = polygons.iter().map(|p| floats(p, 1.0)).collect();
        let set = set_of_all(&scaled, false);
        for (kind, decided) in ALL_KINDS.into_iter().zip(&mut decided) {
            for ((i, j), found) in sums(&gpu, &set, kind) {
                let want = oracle::linking_number(&polygons[i as usize], &polygons[j as usize]);
                let Some(want) = want else {
                    assert_eq!(found.integer(), None, "touching: {found:?}");
                    continue;
                };
                numbers += 1;
                let off = (found.value - want as f64).abs();
                assert!(
                    off <= found.bound,
                    "{seed}, {kind:?}, {i} {j}: {found:?}, {want}"
                );
                assert!(found.integer().is_none_or(|n| n == want));
                *decided += usize::from(found.integer().is_some());
            }
        }
    }
    println!("{decided:?} of {} decided", numbers / ALL_KINDS.len());
}

/// A square, and triangles that pass through it or beside it, closer and closer to an edge, a
/// vertex or the middle of an edge.
#[test]
#[ignore = "needs an adapter"]
fn nearly_touching_curves_are_right_or_undecided() {
    let gpu = adapter();
    let corners = [[-2., -2., 0.], [2., -2., 0.], [2., 2., 0.], [-2., 2., 0.]];
    let mut decided = [0; ALL_KINDS.len()];
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

/// Returns all pairs of curves that have a linking number or touch.
pub(super) fn pairs_of(set: &CurveSet) -> Vec<Pair> {
    let n = set.len() as u32;
    let whole = |i: u32| set.curve(i as usize).closed && set.has_three_distinct_points(i as usize);
    let all = (0..n).flat_map(|i| (0..i).map(move |j| (j, i)));
    all.filter(|&(i, j)| whole(i) && whole(j)).collect()
}

/// Compares the crossings counted by the adapter and by the CPU: the same numbers and places.
/// Returns the numbers of tests and of undecided tests.
pub(super) fn counts_agree(gpu: &Gpu, set: &CurveSet) -> (u64, u64) {
    let mut trees = Trees::default();
    trees.refit(set);
    let pairs = pairs_of(set);
    let workspaces = Workspaces::default();
    let input = Input {
        set,
        trees: &trees,
        workspaces: &workspaces,
    };
    let frame = Frame::new(set);
    gpu.send(&frame).unwrap();
    let ((found, undecided), _) = gpu.count(&frame, input, &pairs, None).unwrap();
    let found = Counted::joined(found);
    let mut want = Counted::default();
    let mut workspace = workspaces.take();
    for &pair in &pairs {
        want.add(pair, linking_number(input, pair, None, &mut workspace));
    }
    assert_eq!(found.links, want.links);
    assert_eq!(found.undefined, want.undefined);
    let stats = found.stats;
    assert_eq!(stats.potential_links, pairs.len() as u64);
    assert!(stats.separated <= stats.potential_links && stats.crossings <= stats.tests);
    (stats.tests, undecided)
}

#[test]
#[ignore = "needs an adapter"]
fn adapter_and_cpu_count_the_same_crossings() {
    let gpu = adapter();
    for kind in KINDS {
        let scaled: Vec<_> = polygons(kind).iter().map(|p| floats(p, kind.4)).collect();
        for single in [true, false] {
            let (tests, undecided) = counts_agree(&gpu, &set_of_all(&scaled, single));
            println!("{kind:?}, {single}: {undecided} of {tests} tests decided by the CPU");
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
fn scenes_have_the_linking_numbers_of_their_construction() {
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
fn sums_have_the_same_bits_on_every_run_and_for_either_order_of_the_curves() {
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
    let pairs = [(0, 1), (1, 0), (0, 0), (0, 2)];
    let single = direct::linking_numbers(&mut gpu.lock(), &Frame::<f32>::new(&set), &pairs);
    let double = direct::linking_numbers(&mut gpu.lock(), &Frame::<f64>::new(&set), &pairs);
    for both in [single.unwrap(), double.unwrap()] {
        assert_eq!(both[0], both[1]);
        assert_eq!(both[2..], [Estimate::UNKNOWN; 2]);
    }
}

/// A scene with many strands close to one another, for which the error bound of single precision
/// exceeds 1/2.
const CROWDED: &str = "woundball:segments=20001,crossings=300";

#[test]
#[ignore = "needs an adapter"]
fn double_precision_decides_pairs_that_single_precision_does_not() {
    let gpu = adapter();
    assert!(gpu.computes_in_double());
    let built = CROWDED.parse::<Model>().unwrap().build().unwrap();
    let set = built.curves;
    let want = built.certificate.links.first().map_or(0, |l| l.lambda);
    let [single, double] = [Kind::Direct, Kind::DirectDouble].map(|k| sums(&gpu, &set, k)[0].1);
    println!("{single:?}, {double:?}");
    assert_eq!((single.integer(), double.integer()), (None, Some(want)));
    assert!(double.bound < 1e-4 && (double.value - want as f64).abs() < 1e-9);
    let sum = DirectSum::new(&gpu, &set);
    assert_eq!(sum.linking_numbers(&[(0, 1)]).unwrap(), [double]);
    assert!(sum.finer.is_made());
    // Pairs that single precision decides are not summed again.
    let model: Model = "ribbon:segments=200,lambda=1".parse().unwrap();
    let set = model.build().unwrap().curves;
    let single = sums(&gpu, &set, Kind::Direct)[0].1;
    let sum = DirectSum::new(&gpu, &set);
    assert_eq!(sum.linking_numbers(&[(0, 1)]).unwrap(), [single]);
    assert!(!sum.finer.is_made());
}

/// Regression test: a decided angle is off by less than 1, but its computed bound is 32,000, which
/// fixed point does not hold. It was converted to 2048, and the sum of some hundred of those in a
/// workgroup was negative.
#[test]
#[ignore = "needs an adapter"]
fn the_bound_of_a_pair_fits_into_fixed_point() {
    let set = set_of(
        &[
            [7.5e-8, 6.75e-14, 0.],
            [2.4e-7, -1.29e-7, 5.25e-7],
            [-0.6, 0.2, 0.7],
        ],
        &[[0., 0., 0.], [0.9, 0., 0.], [0.6, 0., 0.3]],
        false,
    );
    let mut verifier = Verifier::new(AbortOn::Never);
    let want = verifier
        .certify(&set)
        .0
        .links
        .first()
        .map_or(0, |l| l.lambda);
    let found = sums(&adapter(), &set, Kind::DirectDouble)[0].1;
    println!("{found:?}");
    assert!(
        found.bound > 1.0 / TAU && found.bound < 2.0 / TAU,
        "{found:?}"
    );
    assert_eq!(found.integer(), Some(want));
}

#[test]
#[ignore = "needs an adapter"]
fn single_precision_sums_are_kept_if_double_precision_exceeds_a_buffer() {
    let set = CROWDED.parse::<Model>().unwrap().build().unwrap().curves;
    let gpu = adapter();
    let want = sums(&gpu, &set, Kind::Direct)[0].1;
    let capacity = size_of_val(&Frame::<f32>::new(&set).vertices[..]) as u64;
    gpu.lock().adapter.restrict(capacity);
    let sum = DirectSum::new(&gpu, &set);
    assert_eq!(sum.linking_numbers(&[(0, 1)]).unwrap(), [want]);
}

#[test]
#[ignore = "needs an adapter"]
fn a_failing_adapter_returns_an_error_and_the_cpu_takes_over() {
    let set = set_of(
        &[[-2., -2., 0.], [2., -2., 0.], [2., 2., 0.], [-2., 2., 0.]],
        &[[0., 0., -1.], [0., 0., 1.], [9., 7., 0.5]],
        true,
    );
    let verifiers = [GpuUse::default(), GpuUse::default()];
    let cpu = || -> Box<dyn Summation> { Box::new(Direct::new(&set, Formula::Arctangent)) };
    let want = cpu().linking_number((0, 1)).integer();
    // Buffers that are too small.
    let gpu = adapter();
    gpu.lock().adapter.restrict(64);
    let found = direct::linking_numbers(&mut gpu.lock(), &Frame::<f32>::new(&set), &[(0, 1)]);
    assert!(matches!(found, Err(Error::Limit { .. })), "{found:?}");
    let sum = WithFallback::new(&verifiers[0], gpu.direct_sum(&set), cpu);
    assert_eq!(sum.linking_number((0, 1)).integer(), want);
    // A lost adapter.
    let gpu = adapter();
    gpu.lock().adapter.destroy();
    let found = direct::linking_numbers(&mut gpu.lock(), &Frame::<f32>::new(&set), &[(0, 1)]);
    assert!(matches!(found, Err(Error::Failed(_))), "{found:?}");
    let sum = WithFallback::new(&verifiers[1], gpu.direct_sum(&set), cpu);
    assert_eq!(sum.linking_number((0, 1)).integer(), want);
}

/// Certificates before and after the loss of the adapter are the same, and no adapter is used
/// afterwards.
#[test]
#[ignore = "needs an adapter"]
fn a_verifier_continues_without_its_adapter() {
    let model: Model = "chainmail:rows=5,columns=6".parse().unwrap();
    let built = model.build().unwrap();
    // Other tests share the adapter of `Device::Gpu`.
    let device = Device::Index(adapter().info().index);
    for method in [Method::Crossings, Method::Direct, Method::BarnesHut] {
        let mut verifier = Verifier::new(AbortOn::Never);
        verifier.set_kernel(method, Accuracy::default());
        verifier.set_device(&device).unwrap();
        assert_eq!(*verifier.certify(&built.curves).0, built.certificate);
        let counts = method == Method::Crossings;
        assert_eq!(verifier.offload().tests > 0, counts);
        assert!(verifier.device().is_some());
        let gpu = Gpu::shared(&device).unwrap();
        gpu.lock().adapter.destroy();
        for _ in 0..2 {
            assert_eq!(*verifier.certify(&built.curves).0, built.certificate);
            assert_eq!(verifier.device(), None, "{method}");
            assert_eq!(verifier.offload(), Offload::default());
        }
        // A new request opens a working adapter.
        verifier.set_device(&device).unwrap();
        assert_eq!(*verifier.certify(&built.curves).0, built.certificate);
        assert_eq!(verifier.offload().tests > 0, counts);
        assert!(verifier.device().is_some());
    }
}

/// Returns two frames of the same layout.
pub(super) fn two_frames() -> [Arc<CurveSet>; 2] {
    ["0.0", "0.4"].map(|crumple| {
        let text = format!("chainmail:rows=5,columns=6,crumple={crumple}");
        Arc::new(text.parse::<Model>().unwrap().build().unwrap().curves)
    })
}

/// Returns an invented calibration of this adapter: see [`Calibration::made_up`].
fn made_up(round_trip_ms: f64, speed: f64) -> Calibration {
    let DeviceInfo {
        name,
        backend,
        driver,
        ..
    } = adapter().info();
    Calibration {
        adapter: name,
        backend,
        driver,
        ..Calibration::made_up(round_trip_ms, speed)
    }
}

#[test]
#[ignore = "needs an adapter"]
fn vertices_are_uploaded_once_and_during_the_previous_frame() {
    let gpu = adapter();
    let [now, next] = two_frames();
    let mut trees = Trees::default();
    trees.refit(&*now);
    let input = Input {
        set: &now,
        trees: &trees,
        workspaces: &Workspaces::default(),
    };
    let pairs = crate::pairs::LinkSearch::default()
        .find(trees.roots())
        .to_vec();
    let frame = Frame::new(&now);
    let (_, sent) = gpu.count(&frame, input, &pairs, Some(&next)).unwrap();
    let sent = sent.unwrap();
    let both = gpu.lock().vertices_of;
    assert!(both.contains(&Some(frame.id)) && both.contains(&Some(sent.id)));
    // Nothing else is uploaded for it.
    gpu.send(&sent).unwrap();
    let commands = boxes::fit(&mut gpu.lock(), &sent).concat();
    assert!(commands.is_empty() && gpu.lock().vertices_of == both);
}

#[test]
#[ignore = "needs an adapter"]
fn announcing_frames_changes_no_verdict() {
    let [first, second] = two_frames();
    let order = [&first, &second, &second, &first];
    let reports = |announce: bool| {
        let mut verifier = Verifier::new(AbortOn::Never);
        verifier.set_device(&Device::Gpu).unwrap();
        let step = |(k, set): (usize, &&Arc<CurveSet>)| {
            if announce {
                // The last announced frame is never verified.
                verifier.announce(order.get(k + 1).copied().unwrap_or(&second));
            }
            let report = verifier.step_shared(k as u64, 0.0, set).unwrap();
            assert!(verifier.offload().tests > 0);
            report
        };
        order.iter().enumerate().map(step).collect::<Vec<_>>()
    };
    assert_eq!(reports(true), reports(false));
}

#[test]
#[ignore = "needs an adapter"]
fn under_auto_the_adapter_is_used_if_its_calibration_predicts_a_gain() {
    let (wins, loses) = (made_up(1e-3, 1e6), made_up(1e3, 1e-3));
    let other = Calibration {
        driver: "another".into(),
        ..wins.clone()
    };
    for (calibration, want) in [(wins, true), (loses, false), (other, false)] {
        let mut verifier = Verifier::new(AbortOn::Never);
        verifier.set_gpu(GpuUse::automatic(calibration));
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

/// The first blocks of an early exit have too few pairs for an adapter, later ones enough. A frame
/// that is not computed in full does not use the adapter.
#[test]
#[ignore = "needs an adapter"]
fn under_auto_the_adapter_counts_large_blocks_of_an_early_exit_and_no_quiet_frames() {
    let built = "chainmail:rows=24,columns=24".parse::<Model>().unwrap();
    let built = built.build().unwrap();
    let baseline = || built.certificate.clone();
    let chosen = || GpuUse::automatic(made_up(0.05, 1e6));
    let mut early = Verifier::with_baseline(AbortOn::Never, baseline());
    early.set_gpu(chosen());
    early.set_early_exit(true);
    let report = early.step(0, 0.0, &built.curves).unwrap();
    assert_eq!(report.verdict, crate::Verdict::Intact);
    assert!(early.offload().tests > 0);
    let mut watch = Verifier::with_baseline(AbortOn::Never, baseline());
    watch.set_gpu(chosen());
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
fn the_list_of_undecided_tests_grows() {
    let gpu = adapter();
    gpu.lock().undecided_capacity = 1;
    let scaled: Vec<_> = polygons(KINDS[3]).iter().map(|p| floats(p, 1.0)).collect();
    let (_, undecided) = counts_agree(&gpu, &set_of_all(&scaled, true));
    assert!(undecided > 1 && u64::from(gpu.lock().undecided_capacity) >= undecided);
}

/// With small buffers the lists grow to the limit, and then the work is done in batches. The
/// results have the same bits.
#[test]
#[ignore = "needs an adapter"]
fn sums_in_batches_are_the_same() {
    let gpu = adapter();
    for (text, most) in [
        ("chainmail:rows=4,columns=6", 1 << 16),
        ("torus_link:segments=900,toroidal=2,poloidal=3", 1 << 18),
    ] {
        let set = text.parse::<Model>().unwrap().build().unwrap().curves;
        for kind in [Kind::Direct, Kind::DirectDouble, Kind::BarnesHut(None)] {
            let want = sums(&gpu, &set, kind);
            let small = adapter();
            small.lock().adapter.restrict(most);
            small.lock().sum_capacity = Capacity {
                node_pairs: 64,
                tiles: 16,
            };
            assert_eq!(sums(&small, &set, kind), want, "{text}, {kind:?}");
        }
    }
}

/// With a small capacity for node pairs and short submissions; one scene exceeds the capacity even
/// with one pair of curves, which the CPU counts.
#[test]
#[ignore = "needs an adapter"]
fn counts_in_batches_are_the_same() {
    for (text, most) in [
        ("square_link:loops=12,segments=1200", 1 << 15),
        ("woundball:segments=3000,crossings=100", 1 << 17),
        ("woundball:segments=30000,crossings=2000", 1 << 19),
    ] {
        let set = text.parse::<Model>().unwrap().build().unwrap().curves;
        let gpu = adapter();
        {
            let mut state = gpu.lock();
            state.adapter.restrict(most);
            state.crossing_capacity = Capacity {
                node_pairs: 16,
                tiles: 16,
            };
            state.max_work = 64 << 8;
            state.undecided_capacity = 16;
        }
        let (tests, undecided) = counts_agree(&gpu, &set);
        println!(
            "{text}: {undecided} of {tests}, {:?}",
            gpu.lock().crossing_capacity
        );
    }
}

/// Two curves of `2^16` segments, so small beside a third curve that all segment pairs are
/// undecided: `2^32` pairs, a count that wraps to 0 in 32 bits.
#[test]
#[ignore = "needs an adapter, and minutes in software"]
fn an_overflow_of_the_undecided_count_leaves_the_pair_undecided() {
    let n = 1 << 16;
    let angle = |k: usize| k as f64 / n as f64 * std::f64::consts::TAU;
    let small = |p: [f64; 3]| p.map(|x| x * 2f64.powi(-70));
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
        for kind in [Kind::Direct, Kind::DirectDouble] {
            let found = sums(&gpu, &set, kind)[0];
            assert_eq!((found.0, found.1.integer()), ((0, 1), None), "{found:?}");
        }
    }
}

#[test]
#[ignore = "needs an adapter"]
fn an_unknown_name_is_an_error_that_lists_the_adapters() {
    let error = Gpu::open(&Device::Named("no such adapter".into())).unwrap_err();
    let words = error.to_string();
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
