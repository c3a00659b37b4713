//! Checks that shared memory has enough free space.
//!
//! iceoryx2 reserves addresses, not memory: if `/dev/shm` is full, the first write to a new page
//! ends the process with SIGBUS. Containers have 64 MB by default. The checks here return an error
//! instead.

use crate::error::{Error, Result};

/// Fails if the free shared memory is smaller than the pages of `memory` that are not allocated
/// yet.
#[cfg(target_os = "linux")]
pub(super) fn ensure<T>(memory: &mut [T]) -> Result<()> {
    use rustix::io::Errno;
    use rustix::mm::{Advice, madvise};

    let bytes = size_of_val(memory) as u64;
    let Some([size, free]) = room().filter(|[_, free]| *free < bytes) else {
        return Ok(());
    };
    // Pages that an earlier frame has written to are allocated already.
    let page = rustix::param::page_size();
    let start = memory.as_mut_ptr() as usize / page * page;
    let end = memory.as_ptr_range().end as usize;
    #[expect(
        unsafe_code,
        reason = "shared memory that must be there before it is written to"
    )]
    // SAFETY: all pages of the range are part of a mapping, and are lent to this process for
    // writing. Their content does not change.
    let populated = unsafe { madvise(start as *mut _, end - start, Advice::LinuxPopulateWrite) };
    match populated {
        // Before Linux 5.14 it is unknown.
        Ok(()) | Err(Errno::INVAL) => Ok(()),
        Err(_) => Err(too_small(bytes, size, free)),
    }
}

/// Fails if the free shared memory is too small for a service.
#[cfg(target_os = "linux")]
pub(super) fn ensure_service() -> Result<()> {
    /// A service, its ports and their queues take less than half of this.
    const SERVICE: u64 = 1 << 20;
    match room() {
        Some([size, free]) if free < SERVICE => Err(too_small(SERVICE, size, free)),
        _ => Ok(()),
    }
}

/// Returns the size of the shared memory and the free part of it, in bytes.
#[cfg(target_os = "linux")]
fn room() -> Option<[u64; 2]> {
    let found = rustix::fs::statvfs("/dev/shm").ok()?;
    // A file system without limit says 0.
    (found.f_blocks > 0).then(|| [found.f_blocks, found.f_bavail].map(|n| n * found.f_frsize))
}

#[cfg(target_os = "linux")]
fn too_small(bytes: u64, size: u64, free: u64) -> Error {
    // Frames that are written, wait, or are read, and some that become longer.
    let wanted = (10 * bytes).max(2 * size).next_multiple_of(64 << 20);
    let [bytes, size, free] = [bytes, size, free].map(|n| n as f64 / 1e6);
    Error::Bus(format!(
        "the shared memory /dev/shm is too small: {bytes:.1} MB are needed, {free:.1} MB of \
         {size:.1} MB are free. Enlarge it to {wanted} MB (`docker run --shm-size={wanted}m`, or \
         `mount -o remount,size={wanted}m /dev/shm`), or remove files of other programs from it",
        wanted = wanted >> 20
    ))
}

#[cfg(not(target_os = "linux"))]
pub(super) fn ensure<T>(_memory: &mut [T]) -> Result<()> {
    Ok(())
}

#[cfg(not(target_os = "linux"))]
pub(super) fn ensure_service() -> Result<()> {
    Ok(())
}
