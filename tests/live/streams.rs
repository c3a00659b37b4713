//! Output streams and disks that fail.

use super::*;

/// An output stream that accepts no data.
#[cfg(target_os = "linux")]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Broken {
    /// `/dev/full`: every write fails, as on a full disk.
    Full,
    /// The reader closed the pipe.
    Closed,
    /// A full pipe without a reader: every write blocks.
    Blocked,
}

#[cfg(target_os = "linux")]
impl Broken {
    /// Returns the stream, and the pipe end that keeps it in this state.
    fn open(self) -> (Stdio, Option<std::io::PipeReader>) {
        if self == Broken::Full {
            let full = std::fs::File::options().write(true).open("/dev/full");
            return (full.unwrap().into(), None);
        }
        let (reader, mut writer) = std::io::pipe().unwrap();
        if self == Broken::Closed {
            return (writer.into(), None);
        }
        // Fills the pipe.
        std::io::Write::write_all(&mut writer, &[b'\n'; 1 << 16]).unwrap();
        (writer.into(), Some(reader))
    }
}

/// Regression test: the watcher aborted (log on a full disk), ended (standard output), or waited
/// forever (pipe).
#[test]
#[cfg(target_os = "linux")]
fn no_broken_stream_stops_the_verdicts_or_the_recording() {
    use Broken::{Blocked, Closed, Full};
    let folder = TempDir::new().unwrap();
    for (k, (out, err, code)) in [
        (None, Some(Full), 0),
        (None, Some(Closed), 0),
        (None, Some(Blocked), 0),
        (Some(Full), None, 3),
        (Some(Closed), None, 0),
        (Some(Blocked), None, 3),
        (Some(Full), Some(Full), 3),
        (Some(Blocked), Some(Blocked), 3),
    ]
    .into_iter()
    .enumerate()
    {
        let case = format!("stdout {out:?}, stderr {err:?}");
        let service = service(&format!("broken-{k}"));
        let recording = folder.path().join(format!("{k}.mcap"));
        let args = ["--record", recording.to_str().unwrap()];
        let [(out_stream, _held_out), (err_stream, _held_err)] = [out, err].map(|broken| {
            broken.map_or((None, None), |broken| {
                let (stream, held) = broken.open();
                (Some(stream), held)
            })
        });
        let streams = [out_stream, err_stream];
        let name = k.to_string();
        let watch = Watch::start_with(folder.path(), &name, &service, &args, command(), streams);
        let mut sim = client(&service);
        assert!(sim.wait_for_watcher(PATIENCE).unwrap(), "{case}");
        for frame in 0..30 {
            assert_eq!(step(&mut sim, frame, 0.0), Verdict::Intact, "{case}");
        }
        sim.finish().unwrap();
        let ended = watch.end();
        let last = ended.lines.last();
        assert_eq!(ended.code, Some(code), "{case}: {last:?} {}", ended.stderr);
        if out.is_none() {
            assert_eq!(ended.reports().len(), 30, "{case}");
        }
        if code == 3 && err.is_none() {
            let reported = ended.stderr.matches("error: standard output: ").count();
            assert_eq!(reported, 1, "{case}: {}", ended.stderr);
            assert!(ended.stderr.contains("31 lines lost"), "{}", ended.stderr);
        }
        let replayed = replay(&recording);
        assert_eq!(replayed.code, Some(0), "{case}: {}", replayed.stderr);
        assert_eq!(replayed.reports().len(), 30, "{case}");
    }
}

/// A limit on the file size simulates a full disk, because that needs no privileges. The limit
/// allows the shared memory of the watcher, and a few hundred frames.
#[test]
#[cfg(unix)]
fn a_full_disk_ends_only_the_recording() {
    let folder = TempDir::new().unwrap();
    let service = service("full-disk");
    let recording = folder.path().join("run.mcap");
    let args = ["--record", recording.to_str().unwrap()];
    let mut command = Command::new("sh");
    command.args(["-c", "ulimit -f 400; exec \"$0\" \"$@\""]);
    command.arg(env!("CARGO_BIN_EXE_linkwatch"));
    let streams = [Some(Stdio::null()), None];
    let watch = Watch::start_with(folder.path(), "watch", &service, &args, command, streams);
    let mut sim = client(&service);
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    for frame in 0..2000 {
        assert_eq!(step(&mut sim, frame, 0.0), Verdict::Intact);
    }
    let last = sim.finish_within(PATIENCE).unwrap().expect("goodbye");
    assert_eq!(last.counters.verified, 2000);
    let ended = watch.end();
    assert_eq!(ended.code, Some(3), "{}", ended.stderr);
    let reported = ended.stderr.contains("recording is incomplete: ");
    assert!(
        reported && ended.stderr.contains("run.mcap: "),
        "{}",
        ended.stderr
    );
    // The written frames are present, and the message does not claim that a process was killed.
    let replayed = replay(&recording);
    assert_eq!(replayed.code, Some(3), "{}", replayed.stderr);
    assert!(
        replayed.stderr.contains("truncated at byte"),
        "{}",
        replayed.stderr
    );
    assert!(!replayed.stderr.contains("killed"), "{}", replayed.stderr);
    assert!(
        replayed.reports().len() > 50,
        "{}",
        replayed.reports().len()
    );
    replayed.assert_recorded_verdicts();
}
