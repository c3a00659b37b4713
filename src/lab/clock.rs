//! Wall-clock and CPU time of some work.

use std::time::Instant;

/// Time of some work, in milliseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Elapsed {
    /// Wall-clock time.
    pub wall_ms: f64,
    /// CPU time of all threads of this process. On systems other than Linux and macOS, the
    /// wall-clock time.
    pub cpu_ms: f64,
}

/// Runs `work` and measures its time.
pub fn timed<T>(work: impl FnOnce() -> T) -> (T, Elapsed) {
    let (start, cpu) = (Instant::now(), cpu_ms());
    let found = work();
    let wall_ms = start.elapsed().as_secs_f64() * 1e3;
    let cpu_ms = match (cpu, cpu_ms()) {
        (Some(before), Some(after)) => after - before,
        _ => wall_ms,
    };
    (found, Elapsed { wall_ms, cpu_ms })
}

/// Returns the CPU time of this process so far, in milliseconds.
#[cfg(any(target_os = "linux", target_os = "macos"))]
fn cpu_ms() -> Option<f64> {
    use rustix::time::{ClockId, clock_gettime};
    let t = clock_gettime(ClockId::ProcessCPUTime);
    Some(t.tv_sec as f64 * 1e3 + t.tv_nsec as f64 * 1e-6)
}

/// Returns `None`: the CPU time is not known on this system.
#[cfg(not(any(target_os = "linux", target_os = "macos")))]
fn cpu_ms() -> Option<f64> {
    None
}

/// Returns the peak memory of this process in MB, if the system reports it.
pub fn peak_mb() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with("VmHWM:"))?;
    let kb: f64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kb / 1024.0)
}

/// Forgets the peak memory of this process so far. Returns true if the system can do that.
pub fn reset_peak() -> bool {
    std::fs::write("/proc/self/clear_refs", "5").is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn returns_the_result_and_the_times_of_some_work() {
        let (found, elapsed) = timed(|| {
            std::thread::sleep(std::time::Duration::from_millis(30));
            7
        });
        assert_eq!(found, 7);
        assert!(elapsed.wall_ms >= 30.0 && elapsed.cpu_ms >= 0.0);
        if cfg!(any(target_os = "linux", target_os = "macos")) {
            // Other tests run in the same process at the same time.
            assert!(elapsed.cpu_ms.is_finite());
        }
    }
}
