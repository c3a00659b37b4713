//! Peak memory of a piece of work in its thread.
#![expect(unsafe_code, reason = "an allocator that counts")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// System allocator that counts the bytes of each thread.
struct Counting;

thread_local! {
    /// Bytes allocated minus bytes freed by this thread. Another thread may free them, so only
    /// differences over a short time are meaningful.
    static HELD: Cell<isize> = const { Cell::new(0) };
    /// Maximum of `HELD`.
    static PEAK: Cell<isize> = const { Cell::new(0) };
}

/// Returns the result of some work, and the maximum number of bytes that it held at once.
pub fn peak<T>(work: impl FnOnce() -> T) -> (T, usize) {
    let before = HELD.get();
    PEAK.set(before);
    let result = work();
    let most = PEAK.get() - before;
    (result, usize::try_from(most).expect("at least the start"))
}

impl Counting {
    fn add(bytes: isize) {
        // A thread may free memory after its thread-local variables were destroyed.
        let _ = HELD.try_with(|held| {
            held.set(held.get() + bytes);
            let _ = PEAK.try_with(|peak| peak.set(peak.get().max(held.get())));
        });
    }
}

// SAFETY: every call is forwarded unchanged to the system allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        Counting::add(layout.size() as isize);
        // SAFETY: the caller guarantees the conditions of the system allocator.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        Counting::add(layout.size() as isize);
        // SAFETY: as above.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, old: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // During the call, both blocks may exist.
        Counting::add(size as isize);
        Counting::add(-(layout.size() as isize));
        // SAFETY: as above.
        unsafe { System.realloc(old, layout, size) }
    }

    unsafe fn dealloc(&self, old: *mut u8, layout: Layout) {
        Counting::add(-(layout.size() as isize));
        // SAFETY: as above.
        unsafe { System.dealloc(old, layout) }
    }
}

#[test]
fn the_peak_of_work_is_counted() {
    let ((), most) = peak(|| {
        drop(std::hint::black_box(vec![1_u8; 1000]));
        drop(std::hint::black_box(vec![1_u8; 300]));
    });
    assert_eq!(most, 1000);
}
