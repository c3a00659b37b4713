//! Cases that might give a wrong count of crossings on an adapter: sizes at the limits of boxes and
//! levels, sequences of frames, and an adapter that is shared.

use super::tests::{adapter, counts_agree, pairs_of, set_of_all, two_frames};
use super::*;
use crate::curve::{Basis, Positions};
use crate::engine::{Engine, SessionOptions};
use crate::kernels::Counted;
use crate::kernels::crossings::Workspaces;
use crate::kernels::tests::oracle;
use crate::kernels::tests::polygons::{Polygon, floats, winding};
use crate::pairs::Trees;
use crate::random::Random;
use rayon::prelude::*;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
use std::time::Duration;

/// Numbers of segments at the limits of leaves, of roots and of levels.
const EDGES: [usize; 16] = [
    3, 4, 15, 16, 17, 31, 32, 33, 255, 256, 257, 1023, 1024, 1025, 4096, 4097,
];

/// Returns the links of a set as counted by the adapter.
fn counted(
    gpu: &Gpu,
    frame: &Frame,
    set: &CurveSet,
    next: Option<&CurveSet>,
) -> (Counted, Option<Frame>) {
    let mut trees = Trees::default();
    trees.refit(set);
    let input = Input {
        set,
        trees: &trees,
        workspaces: &Workspaces::default(),
    };
    let ((parts, _), sent) = gpu.count(frame, input, &pairs_of(set), next).unwrap();
    (Counted::joined(parts), sent)
}

/// Returns random walks of these sizes. The grids are so coarse that most projections are
/// degenerate, or so fine that few are.
fn walks(seed: u64, sizes: &[usize], size: i64, step: i64) -> Vec<Polygon> {
    let mut random = Random::new(seed);
    sizes.iter().map(|&n| random.walk(n, size, step)).collect()
}

#[test]
#[ignore = "needs an adapter"]
fn no_crossing_is_lost_at_the_limits_of_levels() {
    let gpu = adapter();
    let kinds = [
        (1000, 40, 1.0),
        (40, 3, 1.0),
        (6, 1, -0.5),
        (1 << 20, 1 << 16, 1e-40),
        (1 << 38, 1 << 34, 3.0),
    ];
    for (seed, (size, step, scale)) in (0..).zip(kinds) {
        let polygons = walks(seed, &EDGES, size, step);
        let scaled: Vec<_> = polygons.iter().map(|p| floats(p, scale)).collect();
        for single in [true, false] {
            counts_agree(&gpu, &set_of_all(&scaled, single));
        }
        let set = set_of_all(&scaled, false);
        let (found, _) = counted(&gpu, &Frame::new(&set), &set, None);
        for &(i, j) in pairs_of(&set)
            .iter()
            .filter(|p| EDGES[p.0 as usize] * EDGES[p.1 as usize] < 1 << 20)
        {
            let want = oracle::linking_number(&polygons[i as usize], &polygons[j as usize]);
            let link = found.links.iter().find(|l| (l.i, l.j) == (i, j));
            let undefined = found.undefined.iter().any(|d| (d.i, d.j) == (i, Some(j)));
            let number = (!undefined).then(|| link.map_or(0, |l| l.lambda));
            // A scale that rounds changes the polygons.
            if scale.abs() >= 0.5 {
                assert_eq!(
                    number,
                    want.map(|n| n * scale.signum() as i64),
                    "{size}, {i}, {j}"
                );
            }
        }
    }
}

/// Curves without linking numbers between the others (open ones, a point, one with fewer than three
/// distinct points); and a set of those only.
#[test]
#[ignore = "needs an adapter"]
fn curves_without_linking_numbers_do_not_affect_others() {
    let gpu = adapter();
    let mut random = Random::new(77);
    for _ in 0..4 {
        let mut counts: Vec<i32> = Vec::new();
        let mut xyz: Vec<f64> = Vec::new();
        for &n in &EDGES {
            for closed in [false, true, false] {
                let n = if closed { n } else { 2 + random.below(40) };
                let size = 1 + random.below(30);
                let points = random.walk(n, size, 2);
                counts.push(if closed { -(n as i32) } else { n as i32 });
                xyz.extend(points.iter().flatten().map(|&x| x as f64));
            }
            counts.push(-3);
            xyz.extend([1.0; 9]);
        }
        let set = CurveSet::from_counts(Basis::Polyline, &counts, Positions::F64(&xyz)).unwrap();
        counts_agree(&gpu, &set);
    }
    let set = CurveSet::from_counts(Basis::Polyline, &[3, 4], Positions::F64(&[0.5; 21])).unwrap();
    gpu.send(&Frame::new(&set)).unwrap();
}

#[test]
#[ignore = "needs an adapter"]
fn counts_three_segments_against_two_hundred_thousand() {
    let gpu = adapter();
    let [core, around] = winding(1000, 200_000, 0.1);
    let thin: Polygon = vec![[0, 0, -90_000], [0, 0, 90_000], [200_000, 3, 5]];
    let small: Polygon = vec![
        [65_536, -5_000, 0],
        [65_536, 5_000, 300],
        [60_000, 0, 70_000],
    ];
    let polygons = [thin, around, small, core];
    let scaled: Vec<_> = polygons.iter().map(|p| floats(p, 1.0)).collect();
    counts_agree(&gpu, &set_of_all(&scaled, true));
    let off: Vec<_> = scaled
        .iter()
        .map(|p| p.iter().map(|q| q.map(|x| x / 3.0 + 1e7)).collect())
        .collect();
    counts_agree(&gpu, &set_of_all(&off, false));
}

/// Regression test: a workgroup of Mesa's software adapter had more pairs than it can process. It
/// left its loops early, and a third of the links was missing.
#[test]
#[ignore = "needs an adapter"]
fn no_tile_of_a_million_pairs_is_lost() {
    let gpu = adapter();
    let mut random = Random::new(31);
    let polygons: Vec<_> = (0..1500)
        .map(|_| floats(&random.points(3, 1000), 1.0))
        .collect();
    counts_agree(&gpu, &set_of_all(&polygons, true));
}

/// More pairs than the maximum of a pass, so they are processed in batches.
#[test]
#[ignore = "needs an adapter, and a minute in software"]
fn pairs_in_batches_keep_their_order() {
    let gpu = adapter();
    let mut random = Random::new(31);
    let polygons: Vec<_> = (0..2900)
        .map(|_| floats(&random.points(3, 1000), 1.0))
        .collect();
    counts_agree(&gpu, &set_of_all(&polygons, true));
}

/// Small curves beside something large or far away, so that boxes are as small as the error of the
/// vertices.
#[test]
#[ignore = "needs an adapter"]
fn curves_as_small_as_the_vertex_error_are_decided_by_the_cpu() {
    let gpu = adapter();
    for power in [
        -300i32, -150, -140, -126, -60, -40, -30, -24, -23, -22, -20, -10,
    ] {
        let mut random = Random::new(900 + power.unsigned_abs() as u64);
        let mut polygons: Vec<Vec<[f64; 3]>> = (0..30)
            .map(|_| floats(&random.polygon(40, 7), 2f64.powi(power)))
            .collect();
        polygons.push(vec![[1.0, 0.25, 0.0], [-0.0, 1.0, -0.75], [0.3, -0.7, 1.0]]);
        for single in [true, false] {
            counts_agree(&gpu, &set_of_all(&polygons, single));
            for shift in [1.0, -1e9] {
                let off: Vec<_> = (polygons.iter())
                    .map(|p| p.iter().map(|q| q.map(|x| x + shift)).collect())
                    .collect();
                counts_agree(&gpu, &set_of_all(&off, single));
            }
        }
    }
    let mut random = Random::new(5);
    for scale in [3e37, 1e38 / 7.0, 1e-44, 1e-38] {
        let polygons: Vec<_> = (0..40)
            .map(|_| floats(&random.polygon(60, 9), scale))
            .collect();
        counts_agree(&gpu, &set_of_all(&polygons, true));
    }
    for scale in [1.9e307, 4e-324, 1e-310] {
        let polygons: Vec<_> = (0..40)
            .map(|_| floats(&random.polygon(60, 9), scale))
            .collect();
        counts_agree(&gpu, &set_of_all(&polygons, false));
    }
}

/// Sets of several layouts in random order, announced or not, correctly or not, with sums in
/// between. No result may depend on another set.
#[test]
#[ignore = "needs an adapter"]
fn frames_of_any_layout_may_follow_one_another() {
    let gpu = adapter();
    let mut random = Random::new(4242);
    let layouts: [&[usize]; 5] = [
        &[300, 40, 5, 17],
        &[40, 300, 17, 5],
        &[5000, 3],
        &EDGES,
        &[300, 40, 5, 17],
    ];
    let sets: Vec<CurveSet> = (0..15)
        .map(|k| {
            // On the coarse grid most pairs touch; on the other one they have linking numbers.
            let (size, step) = if k % 4 == 0 {
                (12, 2)
            } else {
                (1 << 20, 1 << 17)
            };
            let polygons = walks(k, layouts[k as usize % 5], size, step);
            let scale = if k % 2 == 0 { 1.0 } else { 0.1 };
            let scaled: Vec<_> = polygons.iter().map(|p| floats(p, scale)).collect();
            set_of_all(&scaled, k % 3 == 0)
        })
        .collect();
    let want: Vec<Counted> = (sets.iter())
        .map(|set| counted(&adapter(), &Frame::new(set), set, None).0)
        .collect();
    for set in &sets {
        counts_agree(&gpu, set);
    }
    let mut sent: Vec<(usize, Frame)> = Vec::new();
    for _ in 0..60 {
        let at = random.below(15);
        let (at, frame) = match sent.pop() {
            Some(known) if random.below(3) > 0 => known,
            _ => (at, Frame::new(&sets[at])),
        };
        if random.one_in(2) {
            gpu.send(&frame).unwrap();
        }
        if random.one_in(4) {
            let other = Frame::new(&sets[random.below(15)]);
            match random.below(2) {
                0 => gpu.send(&other).unwrap(),
                _ => drop(direct::linking_numbers(&mut gpu.lock(), &other, &[(0, 1)]).unwrap()),
            }
        }
        let next = random.below(15);
        let announced = (random.one_in(2)).then(|| &sets[next]);
        let (found, ahead) = counted(&gpu, &frame, &sets[at], announced);
        assert_eq!(
            (&found.links, &found.undefined),
            (&want[at].links, &want[at].undefined)
        );
        sent.extend(ahead.map(|frame| (next, frame)));
    }
}

/// A thread must not wait for the rayon pool while it holds the lock of the adapter: it may steal a
/// task that needs the same lock, and deadlocks.
#[test]
#[ignore = "needs an adapter"]
fn counting_does_not_wait_for_the_pool_under_the_lock() {
    ends_beside_tasks_that_need_the_lock(|gpu, now, next| {
        counted(gpu, &Frame::new(now), now, Some(next));
    });
}

/// Regression test: the vertices were built under the lock that calibrations and measurements hold.
#[test]
#[ignore = "needs an adapter"]
fn vertices_of_a_sum_are_not_built_under_the_lock() {
    ends_beside_tasks_that_need_the_lock(|gpu, _, large| {
        let frame = Frame::<f32>::new(large);
        direct::linking_numbers(&mut gpu.lock(), &frame, &[(0, 1)]).unwrap();
    });
}

fn ends_beside_tasks_that_need_the_lock(
    work_of: impl Fn(&Gpu, &CurveSet, &CurveSet) + Send + Sync + 'static,
) {
    let polygons = walks(1, &[40, 30], 1 << 20, 1 << 17);
    let scaled: Vec<_> = polygons.iter().map(|p| floats(p, 1.0)).collect();
    let now = set_of_all(&scaled, true);
    let many = walks(2, &[1000; 512], 1 << 20, 1 << 17);
    let scaled: Vec<_> = many.iter().map(|p| floats(p, 1.0)).collect();
    let next = set_of_all(&scaled, true);
    let (done, ended) = mpsc::channel();
    std::thread::spawn(move || {
        let gpu = adapter();
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(3)
            .build()
            .unwrap();
        for _ in 0..30 {
            let counted_now = AtomicBool::new(false);
            let busy = || !counted_now.load(Ordering::Relaxed);
            pool.scope(|scope| {
                // The first task offers work that needs the lock. The second thread becomes idle
                // once the third one holds the lock.
                scope.spawn(|_| {
                    let work = || while busy() {};
                    rayon::join(work, || drop(gpu.lock()));
                });
                scope.spawn(|_| while busy() && gpu.state.try_lock().is_ok() {});
                scope.spawn(|_| {
                    work_of(&gpu, &now, &next);
                    counted_now.store(true, Ordering::Relaxed);
                });
            });
        }
        done.send(())
    });
    let ended = ended.recv_timeout(Duration::from_secs(90));
    assert!(ended.is_ok(), "deadlock: no result within 90 s");
}

/// Several verifiers in the threads of one pool share one adapter.
#[test]
#[ignore = "needs an adapter"]
fn verifiers_that_share_an_adapter_do_not_affect_one_another() {
    let tangled: Vec<CurveSet> = (0..4)
        .map(|k| {
            let kind = [(12, 2), (1 << 20, 1 << 17)][k as usize % 2];
            let polygons = [
                walks(k, &[700; 6], kind.0, kind.1),
                walks(k, &[3; 200], 9, 4),
            ]
            .concat();
            let scaled: Vec<_> = polygons.iter().map(|p| floats(p, 1.0)).collect();
            set_of_all(&scaled, true)
        })
        .collect();
    let certify = |k: usize, device: &Device| {
        let set = &tangled[k % 4];
        let mut verifier = Engine::new(SessionOptions {
            device: device.clone(),
            ..SessionOptions::default()
        })
        .unwrap();
        verifier.announce(&Arc::new(tangled[(k + 1) % 4].clone()));
        let _ = verifier.step(0, 0.0, set).unwrap();
        verifier.baseline().unwrap().clone()
    };
    let want: Vec<_> = (0..4).map(|k| certify(k, &Device::Cpu)).collect();
    let _open = Gpu::shared(&Device::Gpu).unwrap();
    let all = (0..16usize).into_par_iter().with_max_len(1);
    assert!(all.all(
        |k| certify(k, &Device::Gpu) == want[k % 4] && certify(k, &Device::Gpu) == want[k % 4]
    ));
}

/// If boxes were not computed, or shaders did not run, no number is returned.
#[test]
#[ignore = "needs an adapter"]
fn incomplete_work_is_an_error() {
    let gpu = adapter();
    let polygons = walks(9, &[400, 30, 3000], 1 << 20, 1 << 17);
    let scaled: Vec<_> = polygons.iter().map(|p| floats(p, 1.0)).collect();
    let set = set_of_all(&scaled, true);
    counts_agree(&gpu, &set);
    let mut trees = Trees::default();
    trees.refit(&set);
    let input = Input {
        set: &set,
        trees: &trees,
        workspaces: &Workspaces::default(),
    };
    let frame = Frame::new(&set);
    drop(boxes::fit(&mut gpu.lock(), &frame));
    gpu.lock().boxes_of = Some(frame.id);
    let found = gpu.count(&frame, input, &pairs_of(&set), None);
    assert!(matches!(found, Err(Error::Failed(_))));
    let state = &mut gpu.lock();
    let zeros = [256, 24, 12, 4].map(|n| vec![0; n]);
    state.boxes_made = 0;
    assert!(crossings::counters(state, &zeros, |_| 3).is_err());
    assert!(direct::read(state, &[0; 36], 1).is_err());
    assert!(barnes_hut::tiles(state, &[0; 64], 4, 1).is_err());
    // Two levels with 1 and 4 node pairs, all processed; then one of them not processed.
    let mut counts = [0; 64];
    let [done, tiles] = [counters::DONE, counters::TILES].map(|counter| counter as usize);
    (counts[0], counts[1], counts[done], counts[tiles]) = (1, 4, 5, 7);
    assert_eq!(barnes_hut::tiles(state, &counts, 2, 1), Ok(Some(7)));
    counts[done] = 4;
    assert!(barnes_hut::tiles(state, &counts, 2, 1).is_err());
}

/// A thread panics after it recorded an upload and before the upload itself. Other users of the
/// shared adapter must not be affected.
#[test]
#[ignore = "needs an adapter"]
fn uploads_are_repeated_after_a_panic() {
    let gpu = adapter();
    let sets = [[400usize, 30], [30, 400]].map(|sizes| {
        let polygons = walks(3, &sizes, 1 << 20, 1 << 17);
        set_of_all(
            &polygons.iter().map(|p| floats(p, 1.0)).collect::<Vec<_>>(),
            true,
        )
    });
    counts_agree(&gpu, &sets[0]);
    std::thread::scope(|scope| {
        let panics = scope.spawn(|| {
            let mut state = gpu.lock();
            drop(boxes::fit(&mut state, &Frame::new(&sets[1])));
            panic!("on purpose");
        });
        assert!(panics.join().is_err());
    });
    counts_agree(&gpu, &sets[1]);
}

#[test]
#[ignore = "needs an adapter"]
fn an_uploaded_next_frame_stays_uploaded_until_its_turn() {
    let [now, next] = two_frames();
    let mut gpu = crate::kernels::GpuUse::open(&Device::Gpu, None).unwrap();
    let mut trees = Trees::default();
    trees.refit(&*now);
    let input = Input {
        set: &now,
        trees: &trees,
        workspaces: &Workspaces::default(),
    };
    let pairs = pairs_of(&now);
    gpu.announce(&next);
    // Block by block, as with an early exit.
    for block in pairs.chunks(64) {
        gpu.count(input, block).unwrap();
        assert!(gpu.has_sent(&next));
    }
}
