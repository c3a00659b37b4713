//! Cost of recording on the verification thread: handing a frame to the queue of a recording, and
//! copying frames into new memory because the queue or the recording still holds earlier ones.

use linkwatch::scenes::Scene;
use linkwatch::{
    BaselineRecord, FrameInfo, FrameRecord, Overflow, Positions, RawFrame, RecordingOptions,
    Report, Retention, RunProgress, Session, SessionOptions, SinkQueue, SinkSummary, Verdict,
    VerifiedFrame,
};
use std::num::NonZeroU64;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime};

/// Capacity of the queue, as in the command.
const WAITING: usize = 8;
const WAITING_POINTS: usize = 1_000_000;

/// Memory of the frames that wait for a violation.
const MEMORY: u64 = 256 << 20;

const FINISH: Duration = Duration::from_secs(600);

/// Measures each way to record. `frames` are the frames of a run, of which the last tenth follows a
/// violation.
pub fn measure(frames: usize, rounds: usize) {
    let scene: Scene = "chainmail".parse().expect("a scene");
    let built = scene.build().expect("a scene").curves;
    // Coordinates in single precision, as most simulators publish them.
    let points = (0..built.len()).flat_map(|i| {
        let points = built.curve(i).points as usize;
        (0..points).map(move |k| (i, k))
    });
    let xyz: Vec<f32> = points
        .flat_map(|(i, k)| built.point(i, k))
        .map(|x| x as f32)
        .collect();
    let counts: Vec<i32> = built.counts().collect();
    let raw = RawFrame {
        basis: built.basis(),
        counts: &counts,
        positions: Positions::F32(&xyz),
    };
    let full = full_run(raw, frames.min(21));
    println!(
        "handing over {} segments, {:.2} MB a frame; a full run takes {full:?}",
        built.segments(),
        4e-6 * xyz.len() as f64
    );
    let folder = tempfile::tempdir().expect("a folder");
    let window = Retention::Window {
        span: Duration::from_secs(3600),
        memory: MEMORY,
    };
    let ten = NonZeroU64::new(10).expect("not zero");
    let cases = [
        ("no recording", None, None),
        ("--record", Some(Retention::All), None),
        ("every=10", Some(Retention::Every(ten)), None),
        ("max=50MB", Some(Retention::All), Some(50_000_000)),
        ("window, memory=256MiB", Some(window), None),
    ];
    // The cases alternate, so that a disturbance of one round does not decide a median.
    let mut runs: Vec<Vec<Cost>> = cases.iter().map(|_| Vec::new()).collect();
    for round in 0..rounds {
        for (k, (_, retention, max_bytes)) in cases.into_iter().enumerate() {
            let folder = folder.path().join(format!("{k}-{round}"));
            std::fs::create_dir(&folder).expect("a folder");
            let queue = retention.map(|retention| {
                let mut options = RecordingOptions::new(folder.join("run.mcap"));
                (options.retention, options.max_bytes) = (retention, max_bytes);
                let wait = Overflow::Wait(Duration::from_millis(500));
                let queue = SinkQueue::spawn("recording", WAITING, wait, move || options.open());
                queue.expect("a thread").with_points(WAITING_POINTS)
            });
            let mut run = run(raw, queue, frames);
            run.bytes = size(&folder) / frames as u64;
            std::fs::remove_dir_all(&folder).expect("the folder is removed");
            runs[k].push(run);
        }
    }
    let cost = |runs: &[Cost]| median(runs.iter().map(|run| run.cost).collect());
    let without = cost(&runs[0]);
    for ((name, ..), runs) in cases.iter().zip(&runs) {
        let added = cost(runs).saturating_sub(without);
        print!(
            "{name}: {:?} a frame, handed over in {:?} ({:?} at most), {:.1} % of a full run \
             added, {} MB more memory",
            cost(runs),
            median(runs.iter().map(|run| run.handed).collect()),
            runs.iter().map(|run| run.longest).max().unwrap_or_default(),
            100.0 * added.as_secs_f64() / full.as_secs_f64(),
            runs.iter().map(|run| run.memory).max().unwrap_or_default() >> 20,
        );
        if runs.iter().any(|run| run.summary.is_some()) {
            let mut dropped = 0;
            for summary in runs.iter().filter_map(|run| run.summary.as_ref()) {
                let written = frames as u64 - summary.dropped;
                assert_eq!((&summary.failed, summary.written), (&None, written));
                dropped += summary.dropped;
            }
            print!(
                "; {} bytes a frame on disk, {dropped} dropped",
                runs[0].bytes
            );
        }
        println!();
    }
}

/// Returns the median time of a full run, from a copy of the positions to the report.
fn full_run(raw: RawFrame<'_>, runs: usize) -> Duration {
    let mut session = session();
    let run = |k| {
        let start = Instant::now();
        verify(&mut session, k as u64, raw);
        start.elapsed()
    };
    median((0..runs).map(run).collect())
}

/// Returns a session that computes every frame in full.
fn session() -> Session {
    Session::new(SessionOptions::default()).expect("valid options")
}

/// Copies and verifies a frame.
fn verify(session: &mut Session, seq: u64, raw: RawFrame<'_>) -> VerifiedFrame {
    let received = session.receive(FrameInfo::at(seq, 0.0), |copy| copy(raw));
    let verified = session.verify(received).expect("a frame");
    assert_eq!(verified.report.verdict, Verdict::Intact);
    verified
}

struct Cost {
    /// Median time to copy a frame and to hand it over.
    cost: Duration,
    /// Median and longest time to hand a frame over.
    handed: Duration,
    longest: Duration,
    /// Growth of the memory of the process, in bytes.
    memory: u64,
    /// Bytes on disk per frame.
    bytes: u64,
    summary: Option<SinkSummary>,
}

/// Verifies frames in full, and passes them to a queue.
fn run(raw: RawFrame<'_>, queue: Option<SinkQueue>, frames: usize) -> Cost {
    let mut session = session();
    let before = resident();
    let (mut all, mut handed) = (Vec::new(), Vec::new());
    let mut most = before;
    for seq in 0..frames as u64 {
        let verified = verify(&mut session, seq, raw);
        let verdict = match seq < frames as u64 * 9 / 10 {
            true => Verdict::Intact,
            false => Verdict::Changed,
        };
        let begin = Instant::now();
        if let Some(queue) = &queue {
            if seq == 0 {
                queue.begin(Arc::new(BaselineRecord {
                    certificate: Arc::default(),
                    origin: "first frame".into(),
                    frame: Some(0),
                    unverified: 0,
                }));
            }
            queue.frame(Arc::new(FrameRecord {
                curves: verified.curves,
                info: verified.info,
                report: Arc::new(Report::new(seq, 0.0, verdict)),
                progress: RunProgress {
                    verified: seq + 1,
                    ..RunProgress::default()
                }
                .received(SystemTime::now()),
            }));
        }
        handed.push(begin.elapsed());
        all.push(verified.ingest + begin.elapsed());
        most = most.max(resident());
    }
    let longest = handed.iter().max().copied().unwrap_or_default();
    Cost {
        cost: median(all),
        handed: median(handed),
        longest,
        memory: most - before,
        bytes: 0,
        summary: queue.map(|queue| queue.finish(FINISH)),
    }
}

fn median(mut times: Vec<Duration>) -> Duration {
    times.sort();
    times[times.len() / 2]
}

/// Returns the size of all files in a folder.
fn size(folder: &Path) -> u64 {
    let files = std::fs::read_dir(folder).expect("a folder");
    files
        .map(|file| file.and_then(|f| f.metadata()).expect("a file").len())
        .sum()
}

/// Returns the resident memory of this process in bytes; 0 if the system does not tell.
fn resident() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|l| l.strip_prefix("VmRSS:"));
    let kilobytes = line.and_then(|l| l.split_whitespace().next());
    kilobytes.and_then(|k| k.parse::<u64>().ok()).unwrap_or(0) << 10
}
