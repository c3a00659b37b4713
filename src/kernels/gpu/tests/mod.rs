//! Tests of shaders, and of the kernels on an adapter.
//!
//! Tests that need an adapter are ignored, so that they never count as passed without one:
//! `cargo test --release gpu:: -- --ignored`.

mod automatic;
mod capacity;
mod failures;
mod results;
mod shaders;

use super::summations::DirectSum;
use super::*;
use crate::curve::{Basis, Positions};
use crate::engine::{Certifier, Engine, SessionOptions, Strategy};
use crate::kernels::crossings::{Workspaces, linking_number};
use crate::kernels::gpu_use::fallback::WithFallback;
use crate::kernels::sums::direct::{Direct, Formula};
use crate::kernels::tests::oracle;
use crate::kernels::tests::polygons::{Polygon, floats, set_of};
use crate::kernels::{Calibration, Counted, Estimate, GpuUse, Method, Offload, Summation};
use crate::pairs::Trees;
use crate::random::Random;
use crate::scenes::Scene as Model;
use layout::{BoxNode, Criterion, Node, NodePair, Roots, Undecided};
use std::f64::consts::TAU;
use std::mem::offset_of;
use std::sync::LazyLock;
use wgpu::naga;

/// Returns a certifier that uses a device.
fn on(device: &Device, kernel: Method) -> Certifier {
    Certifier::new(&SessionOptions {
        kernel,
        device: device.clone(),
        ..SessionOptions::default()
    })
    .expect("an adapter")
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
const KINDS: [(u64, usize, usize, i64, f64); 7] = [
    (1, 60, 20, 1000, 1.0),
    (2, 60, 200, 1 << 24, 2.3e-10),
    (3, 60, 100, 1 << 39, 2.0),
    (4, 100, 7, 3, 1.0),
    (5, 100, 9, 5, 0.1),
    (6, 100, 12, 9, 1.0),
    (7, 40, 150, 60, 1e30),
];

fn polygons((seed, count, most, size, _): (u64, usize, usize, i64, f64)) -> Vec<Polygon> {
    let mut random = Random::new(seed * 7919);
    (0..count).map(|_| random.polygon(most, size)).collect()
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

/// A scene with many strands close to one another, for which the error bound of single precision
/// exceeds 1/2.
const CROWDED: &str = "woundball:segments=20001,crossings=300";

/// Returns two frames of the same layout.
pub(super) fn two_frames() -> [Arc<CurveSet>; 2] {
    ["0.0", "0.4"].map(|crumple| {
        let text = format!("chainmail:rows=5,columns=6,crumple={crumple}");
        Arc::new(text.parse::<Model>().unwrap().build().unwrap().curves)
    })
}
