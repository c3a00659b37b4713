//! Many frames: memory and files of a watch must not grow.

use super::*;

/// Resident memory of a process in bytes, and its number of open files.
fn used(process: u32) -> (u64, usize) {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).unwrap();
    let line = status.lines().find(|l| l.starts_with("VmRSS:")).unwrap();
    let kilobytes = line.split_whitespace().nth(1).unwrap();
    let files = std::fs::read_dir(format!("/proc/{process}/fd")).unwrap();
    (kilobytes.parse::<u64>().unwrap() << 10, files.count())
}

/// Publishes frames that move, every thousandth one with a pull-through and back, to a watch that
/// records them. The memory of both is measured after a tenth of them, and at the end.
fn soak(name: &str, frames: u64) {
    /// Maximum growth of the memory: allocators keep a little more over time.
    const GROWTH: u64 = 8 << 20;
    let folder = TempDir::new().unwrap();
    let service = service(name);
    let recording = folder.path().join("run.mcap");
    let args = [
        "--events",
        "--abort-on",
        "never",
        "--record",
        recording.to_str().unwrap(),
    ];
    let watch = Watch::start(folder.path(), "watch", &service, &args);
    let mut sim = client(&service);
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    let of = |sim: u32, watch: u32| [sim, watch].map(used);
    let measure = || of(std::process::id(), watch.process.id());
    let mut early = None;
    let mut changed = 0;
    for frame in 0..frames {
        let shift = match frame % 1000 {
            500 => 3.0,
            k => (k % 50) as f32 * 0.005,
        };
        let verdict = step(&mut sim, frame, shift);
        assert_eq!(
            verdict == Verdict::Intact,
            frame % 1000 < 500 || frame % 1000 > 501,
            "{frame}"
        );
        changed += u64::from(verdict != Verdict::Intact);
        if frame == frames / 10 {
            early = Some(measure());
        }
    }
    let early = early.unwrap();
    let late = measure();
    sim.finish().unwrap();
    let ended = watch.end();
    assert_eq!(ended.summary()["verified"], frames);
    println!("{frames} frames, {changed} changed; [simulator, watch] (bytes, files):");
    println!("after a tenth {early:?}, at the end {late:?}");
    for (early, late) in early.into_iter().zip(late) {
        assert!(late.0 <= early.0 + GROWTH, "memory: {early:?}, {late:?}");
        assert!(late.1 <= early.1, "files: {early:?}, {late:?}");
    }
    let kept = std::fs::metadata(&recording).unwrap().len();
    println!("recording: {kept} bytes");
}

/// Runs this test again in a process of its own, whose files no other test opens.
fn alone(test: &str) -> bool {
    const ALONE: &str = "LINKWATCH_SOAK_ALONE";
    if std::env::var_os(ALONE).is_some() {
        return true;
    }
    let again = std::process::Command::new(std::env::current_exe().unwrap())
        .args(["--exact", test, "--include-ignored", "--nocapture"])
        .env(ALONE, "1")
        .output()
        .unwrap();
    let output = [again.stdout, again.stderr].map(|text| String::from_utf8(text).unwrap());
    assert!(again.status.success(), "{}", output.concat());
    assert!(output[0].contains("1 passed"), "{}", output[0]);
    false
}

#[test]
fn memory_and_files_do_not_grow_with_the_frames() {
    if alone("soak::memory_and_files_do_not_grow_with_the_frames") {
        soak("soak", 10_000);
    }
}

#[test]
#[ignore = "a million frames: some minutes"]
fn memory_and_files_do_not_grow_with_a_million_frames() {
    if alone("soak::memory_and_files_do_not_grow_with_a_million_frames") {
        soak("soak-long", 1_000_000);
    }
}
