//! A frame like the previous one allocates nothing, because [`Session`] and [`Certifier`] reuse
//! every buffer.
//!
//! Only allocations of the verifying threads are counted. With `LINKWATCH_TRACE_ALLOCATIONS=1` each
//! one is printed with its backtrace.
#![expect(unsafe_code, reason = "an allocator that counts")]

mod support;

use linkwatch::scenes::Scene;
use linkwatch::{Basis, Certifier, CurveSet, FrameInfo, Positions, Session, SessionOptions};
use std::alloc::{GlobalAlloc, Layout, System};
use std::backtrace::Backtrace;
use std::cell::Cell;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use support::random::Random;
use support::session::Step;

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// System allocator that counts allocations while enabled.
struct Counting;

static ALLOCATIONS: AtomicU64 = AtomicU64::new(0);
static TRACE: AtomicBool = AtomicBool::new(false);

thread_local! {
    /// True if the allocations of this thread are counted; those of the test harness are not.
    static COUNTED: Cell<bool> = const { Cell::new(false) };
}

impl Counting {
    fn count(layout: Layout) {
        // A thread may free memory after its thread-local variables were destroyed.
        if !COUNTED.try_with(Cell::get).unwrap_or(false) {
            return;
        }
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        if TRACE.load(Ordering::Relaxed) {
            // The backtrace itself allocates.
            COUNTED.set(false);
            eprintln!("{} bytes\n{}", layout.size(), Backtrace::force_capture());
            COUNTED.set(true);
        }
    }
}

// SAFETY: every call is forwarded unchanged to the system allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        Counting::count(layout);
        // SAFETY: the caller guarantees the conditions of the system allocator.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        Counting::count(layout);
        // SAFETY: as above.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, block: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        Counting::count(layout);
        // SAFETY: as above.
        unsafe { System.realloc(block, layout, size) }
    }

    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(block, layout) }
    }
}

/// Locks out other tests, because there is only one counter.
fn alone() -> MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    // A failed test leaves the counter valid.
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Number of runs after which the buffers have grown.
const WARM_UP: usize = 4;

/// Number of runs that are counted.
const COUNTED_RUNS: usize = 40;

fn scene(text: &str) -> (String, CurveSet) {
    let scene: Scene = text.parse().unwrap();
    (text.to_owned(), scene.build().unwrap().curves)
}

/// Splines that intersect so closely that their hulls overlap.
fn tangle(basis: Basis) -> (String, CurveSet) {
    let mut random = Random::new(7);
    let xyz: Vec<f32> = (0..3 * 8 * 60)
        .map(|_| random.between(0.0, 1.0) as f32)
        .collect();
    let set = CurveSet::from_counts(basis, &[-60; 8], Positions::F32(&xyz)).unwrap();
    let (_, stats) = Certifier::default().certify(&set);
    assert!(stats.refined > 100, "{stats:?}");
    (format!("tangle of {basis:?}"), set)
}

/// Returns the number of allocations of each call after the warm-up.
fn allocations(mut frame: impl FnMut()) -> [u64; COUNTED_RUNS] {
    let trace = std::env::var_os("LINKWATCH_TRACE_ALLOCATIONS").is_some();
    let mut count = || {
        let before = ALLOCATIONS.load(Ordering::Relaxed);
        frame();
        ALLOCATIONS.load(Ordering::Relaxed) - before
    };
    assert!(count() > 0, "the first frame allocates the buffers");
    for _ in 1..WARM_UP {
        count();
    }
    TRACE.store(trace, Ordering::Relaxed);
    let counts = [(); COUNTED_RUNS].map(|()| count());
    TRACE.store(false, Ordering::Relaxed);
    counts
}

/// Rings that touch their neighbours, and one degenerate ring: every frame has places and defects.
fn touching() -> (String, CurveSet) {
    const SQUARE: [[f32; 2]; 4] = [[-1., -1.], [1., -1.], [1., 1.], [-1., 1.]];
    let rings = (0..200).flat_map(|k| {
        let size = if k == 0 { 0.0 } else { 1.0 };
        SQUARE.map(|[x, y]| match k % 2 {
            0 => [size * x + k as f32, size * y, 0.0],
            _ => [x + k as f32, 0.0, y],
        })
    });
    let xyz: Vec<f32> = rings.flatten().collect();
    let set = CurveSet::from_counts(Basis::Polyline, &[-4; 200], Positions::F32(&xyz)).unwrap();
    let mut certifier = Certifier::default();
    let undefined = certifier.certify(&set).0.undefined().len();
    assert!(undefined > 100, "{undefined}");
    ("touching rings".to_owned(), set)
}

/// Returns the allocations of `certify` and of `step` for a scene, with this number of threads.
fn measure(threads: usize, set: &CurveSet) -> [[u64; COUNTED_RUNS]; 2] {
    // Allocations of threads when they start and end do not belong to a frame.
    let thread = |thread: rayon::ThreadBuilder| {
        COUNTED.set(true);
        thread.run();
        COUNTED.set(false);
    };
    // All frames run in one call into the pool. A call from outside uses rayon's queue, which
    // allocates for every few dozen calls; within the pool rayon allocates nothing.
    let frames = || {
        let mut certifier = Certifier::default();
        let certify = allocations(|| {
            certifier.certify(set);
        });
        let mut session = Session::new(SessionOptions::default()).unwrap();
        let (info, set) = (FrameInfo::at(0, 0.0), Arc::new(set.clone()));
        let step = allocations(|| {
            session.step_at(info.clone(), &set);
        });
        [certify, step]
    };
    let builder = rayon::ThreadPoolBuilder::new().num_threads(threads);
    builder
        .build_scoped(thread, |pool| pool.install(frames))
        .unwrap()
}

fn scenes() -> Vec<(String, CurveSet)> {
    vec![
        scene("chainmail:rows=20,columns=20,crumple=1"),
        scene("ribbon:segments=200000,lambda=1000"),
        scene("square_link:loops=60,segments=30000"),
        scene("torus_zero:segments=40000,periods=40"),
        scene("rubber_bands:bands=200"),
        scene("knit:rows=12,stitches=30,segments=4320"),
        tangle(Basis::CatmullRom),
        tangle(Basis::BSpline),
        tangle(Basis::Bezier),
    ]
}

#[test]
fn a_further_frame_allocates_nothing() {
    let _alone = alone();
    for (name, set) in scenes() {
        let counts = measure(1, &set);
        assert_eq!(counts, [[0; COUNTED_RUNS]; 2], "{name}");
    }
    // A report owns its list of 199 defects.
    let (name, set) = touching();
    let [certify, step] = measure(1, &set);
    assert_eq!(certify, [0; COUNTED_RUNS], "{name}");
    assert!(step.iter().all(|&n| n < 20), "{name}: {step:?}");
}

/// The assignment of pairs to threads changes from frame to frame, and a thread holds its buffers
/// while it computes a pair. So a buffer grows if its thread, which had only small pairs before,
/// gets a large one. If more tasks than ever before wait for others, an additional set of buffers
/// is allocated. Both stop after some frames.
#[test]
fn nearly_all_further_frames_of_two_threads_allocate_nothing() {
    let _alone = alone();
    for (name, set) in scenes() {
        for counts in measure(2, &set) {
            let some = counts.iter().filter(|&&n| n > 0).count();
            println!(
                "{name}: {some} of {COUNTED_RUNS} frames, {} in all",
                counts.iter().sum::<u64>()
            );
            assert!(some < COUNTED_RUNS / 4, "{name}: {counts:?}");
        }
    }
}
