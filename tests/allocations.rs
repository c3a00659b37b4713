//! A frame like the one before it allocates nothing: every buffer of a [`Verifier`] serves the next frame.
//!
//! What counts are the allocations of the threads that verify. With `LINKWATCH_TRACE_ALLOCATIONS=1` each one is shown
//! with its backtrace.
#![expect(unsafe_code, reason = "an allocator that counts")]

use linkwatch::scenes::Scene;
use linkwatch::{AbortOn, Basis, CurveSet, Positions, Verifier};
use std::alloc::{GlobalAlloc, Layout, System};
use std::backtrace::Backtrace;
use std::cell::Cell;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// The system's allocator, which counts while it is asked to.
struct Counting;

static ALLOCATIONS: AtomicU64 = AtomicU64::new(0);
static TRACE: AtomicBool = AtomicBool::new(false);

thread_local! {
    /// Whether this thread's allocations count. The harness's do not.
    static COUNTED: Cell<bool> = const { Cell::new(false) };
}

impl Counting {
    fn count(layout: Layout) {
        // The last thing that a thread does may be to free something: its locals are gone then.
        if !COUNTED.try_with(Cell::get).unwrap_or(false) {
            return;
        }
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        if TRACE.load(Ordering::Relaxed) {
            // The backtrace allocates, too.
            COUNTED.set(false);
            eprintln!("{} bytes\n{}", layout.size(), Backtrace::force_capture());
            COUNTED.set(true);
        }
    }
}

// SAFETY: every call goes on to the system's allocator as it is.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        Counting::count(layout);
        // SAFETY: the caller's promise is the one that is asked for here.
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

/// One test at a time: there is one counter.
fn alone() -> MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    // A test that failed has left nothing half done.
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Runs after which the buffers have grown.
const WARM_UP: usize = 4;

/// Runs that are counted.
const COUNTED_RUNS: usize = 40;

fn scene(text: &str) -> (String, CurveSet) {
    let scene: Scene = text.parse().unwrap();
    (text.to_owned(), scene.build().unwrap().curves)
}

/// Splines through one another, so near that their hulls meet.
fn tangle(basis: Basis) -> (String, CurveSet) {
    let mut state = 7u64;
    let mut next = || {
        state = state
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        (state >> 40) as f32 / (1u32 << 24) as f32
    };
    let xyz: Vec<f32> = (0..3 * 8 * 60).map(|_| next()).collect();
    let set = CurveSet::from_counts(basis, &[-60; 8], Positions::F32(&xyz)).unwrap();
    let (_, stats) = Verifier::new(AbortOn::Never).certify(&set);
    assert!(stats.refined > 100, "{stats:?}");
    (format!("tangle of {basis:?}"), set)
}

/// Allocations of each of the calls after those that warm up.
fn allocations(mut frame: impl FnMut()) -> [u64; COUNTED_RUNS] {
    let trace = std::env::var_os("LINKWATCH_TRACE_ALLOCATIONS").is_some();
    let mut count = || {
        let before = ALLOCATIONS.load(Ordering::Relaxed);
        frame();
        ALLOCATIONS.load(Ordering::Relaxed) - before
    };
    assert!(count() > 0, "the first frame makes the buffers");
    for _ in 1..WARM_UP {
        count();
    }
    TRACE.store(trace, Ordering::Relaxed);
    let counts = [(); COUNTED_RUNS].map(|()| count());
    TRACE.store(false, Ordering::Relaxed);
    counts
}

/// Rings that touch their neighbours, and one that is a point: places and defects are part of every frame.
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
    let mut verifier = Verifier::new(AbortOn::Never);
    let undefined = verifier.certify(&set).0.undefined.len();
    assert!(undefined > 100, "{undefined}");
    ("touching rings".to_owned(), set)
}

/// What a scene's frames allocate, with so many threads: of `certify` and of `step`.
fn measure(threads: usize, set: &CurveSet) -> [[u64; COUNTED_RUNS]; 2] {
    // What the threads allocate before they work and when they end is not a frame's.
    let thread = |thread: rayon::ThreadBuilder| {
        COUNTED.set(true);
        thread.run();
        COUNTED.set(false);
    };
    // All frames in one call into the pool. A call from outside goes through rayon's queue, which allocates for every
    // few dozen of them; within the pool rayon allocates nothing.
    let frames = || {
        let mut verifier = Verifier::new(AbortOn::Any);
        let certify = allocations(|| {
            verifier.certify(set);
        });
        let mut verifier = Verifier::new(AbortOn::Any);
        let step = allocations(|| {
            verifier.step(0, 0.0, set).unwrap();
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
    // A report owns its list of defects: 199 of them.
    let (name, set) = touching();
    let [certify, step] = measure(1, &set);
    assert_eq!(certify, [0; COUNTED_RUNS], "{name}");
    assert!(step.iter().all(|&n| n < 20), "{name}: {step:?}");
}

/// Which thread computes which pair changes from frame to frame, and buffers belong to threads for as long as they
/// compute a pair. So one that has met small pairs only grows when it meets a large one, and a frame in which more
/// tasks wait for others than ever before makes buffers for one more. Both end after a while.
#[test]
fn a_further_frame_of_two_threads_allocates_nothing_but_for_a_few() {
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
