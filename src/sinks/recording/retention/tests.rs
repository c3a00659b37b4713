//! Tests of what recordings keep, without a clock and without threads.

use super::*;
use crate::certificate::Certificate;
use crate::curve::{Basis, CurveLabels, CurveSet, Positions};
use crate::ingest::FrameInfo;
use crate::sinks::{Ending, RecordedItem, RecordingReader};
use crate::sinks::{Overflow, SinkQueue};
use crate::verdict::{Change, Report};
use proptest::prelude::*;
use std::io::{self, Cursor, Read, Seek, Write};
use std::sync::{Mutex, RwLock};
use tempfile::TempDir;

/// A frame of triangles, whose verdict is not intact if a pair of curves changed.
fn frame(seq: u64, curves: usize, changed: Option<u32>) -> FrameRecord {
    let xyz: Vec<f32> = (0..9 * curves).map(|k| k as f32 + seq as f32).collect();
    let counts = vec![-3; curves];
    let set = CurveSet::from_counts(Basis::Polyline, &counts, Positions::F32(&xyz)).unwrap();
    let verdict = match changed {
        Some(_) => Verdict::Changed,
        None => Verdict::Intact,
    };
    let mut report = Report::new(seq, 0.0, verdict);
    report.changes.extend(changed.map(|j| Change {
        i: 0,
        j,
        expected: 1,
        found: 0,
        place: None,
    }));
    FrameRecord {
        info: FrameInfo::default(),
        curves: Some(Arc::new(set)),
        report: Arc::new(report),
        verified: seq + 1,
        skipped: 0,
        rejected: 0,
        times: Default::default(),
        work: Default::default(),
        received: std::time::UNIX_EPOCH,
    }
}

fn baseline(curves: usize) -> BaselineRecord {
    BaselineRecord {
        certificate: Arc::new(Certificate {
            curves,
            ..Certificate::default()
        }),
        origin: format!("{curves} curves"),
    }
}

/// Content of a file.
#[derive(Debug, Default, PartialEq)]
struct Content {
    /// Number of each frame with a verdict, and true if it has curves.
    frames: Vec<(u64, bool)>,
    /// Number of the frame after each baseline, and the curves of the baseline.
    baselines: Vec<(u64, usize)>,
    names: Vec<Vec<String>>,
    /// Frames that are neither in the file nor were left out on purpose.
    missing: u64,
    metadata: BTreeMap<String, String>,
}

impl Content {
    fn seqs(&self) -> Vec<u64> {
        self.frames.iter().map(|(seq, _)| *seq).collect()
    }

    fn with_curves(&self) -> Vec<u64> {
        let with = self.frames.iter().filter(|(_, curves)| *curves);
        with.map(|(seq, _)| *seq).collect()
    }
}

fn read(path: &Path) -> Content {
    read_from(RecordingReader::open(path).unwrap())
}

fn read_from<R: Read + Seek>(mut reader: RecordingReader<R>) -> Content {
    let mut content = Content::default();
    let mut curves = None;
    let mut waiting = Vec::new();
    while let Some(item) = reader.next_item().unwrap() {
        match item {
            RecordedItem::Baseline(b) => waiting.push(b.certificate.curves),
            RecordedItem::Frame(f) => {
                content.names.push(f.info.labels.names.clone());
                let mut set = None;
                f.ingest(&mut set).unwrap();
                let expected = frame(f.seq, f.counts.len(), None).curves.unwrap();
                let bits = |set: &CurveSet| {
                    let mut bytes = Vec::new();
                    set.write_positions(&mut bytes);
                    bytes
                };
                assert_eq!(bits(&set.unwrap()), bits(&expected), "frame {}", f.seq);
                curves = Some(f.seq);
            }
            RecordedItem::Verdict(v) => {
                let seq = v.report.seq;
                let before = waiting.drain(..).map(|curves| (seq, curves));
                content.baselines.extend(before);
                content.frames.push((seq, curves.take() == Some(seq)));
                let answered = v.progress.verified + v.progress.rejected;
                let here = content.frames.len() as u64;
                content.missing = answered - here - v.progress.left_out;
            }
        }
    }
    assert_eq!(reader.ending(), Some(&Ending::Finished));
    content.metadata = reader.metadata().clone();
    content
}

fn options(folder: &TempDir, retention: Retention) -> RecordingOptions {
    let mut options = RecordingOptions::new(folder.path().join("run.mcap"));
    options.retention = retention;
    options
}

fn every(n: u64) -> Retention {
    Retention::Every(NonZeroU64::new(n).unwrap())
}

/// Names of the files in a folder, sorted.
fn names(folder: &TempDir) -> Vec<String> {
    let entries = std::fs::read_dir(folder.path()).unwrap();
    let names = entries.map(|e| e.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = names.collect();
    names.sort();
    names
}

#[test]
fn every_nth_frame_is_kept_and_those_before_and_at_violations() {
    let folder = TempDir::new().unwrap();
    let mut sink = options(&folder, every(4)).open().unwrap();
    sink.begin(&baseline(2)).unwrap();
    for seq in 0..14 {
        let changed = (seq == 7 || seq == 10).then_some(1);
        let mut record = frame(seq, 2, changed);
        // The simulator rolled back before frame 11.
        record.info.cuts = u32::from(seq >= 11);
        sink.frame(&record).unwrap();
        sink.flush().unwrap();
    }
    let note = sink.note().unwrap();
    assert!(note.contains("curves of 9 of 14 frames"), "{note}");
    sink.finish().unwrap();
    let content = read(&folder.path().join("run.mcap"));
    assert_eq!(content.seqs(), (0..14).collect::<Vec<_>>());
    assert_eq!(content.with_curves(), [0, 4, 6, 7, 8, 9, 10, 11, 12]);
    assert_eq!(
        (content.missing, content.metadata["record_every"].as_str()),
        (0, "4")
    );
}

/// A rejected frame has no curves, but the frame before it is kept.
#[test]
fn the_frame_before_a_rejected_one_is_kept() {
    let folder = TempDir::new().unwrap();
    let mut sink = options(&folder, every(100)).open().unwrap();
    sink.begin(&baseline(1)).unwrap();
    for seq in 0..6 {
        let mut record = frame(seq, 1, None);
        if seq == 4 {
            record.curves = None;
            record.report = Arc::new(Report::new(seq, 0.0, Verdict::Rejected));
        }
        sink.frame(&record).unwrap();
    }
    sink.finish().unwrap();
    let content = read(&folder.path().join("run.mcap"));
    assert_eq!(
        (content.seqs().len(), content.with_curves()),
        (6, vec![0, 3])
    );
}

/// Records frames in windows. Each has a time in seconds, and the curve that is violated.
fn record_windows(
    folder: &TempDir,
    (span, memory): (f64, u64),
    frames: &[(f64, Option<u32>)],
) -> (Option<Content>, String) {
    let files = Files::new(options(folder, Retention::All));
    let mut window = Box::new(Window::new(files, Duration::from_secs_f64(span), memory));
    window.begin(&baseline(3)).unwrap();
    for (seq, (at, changed)) in frames.iter().enumerate() {
        let record = frame(seq as u64, 3, *changed);
        window.take(&record, Duration::from_secs_f64(*at)).unwrap();
        let (bytes, waiting) = window.memory();
        assert!(
            bytes <= memory || waiting == 1,
            "{bytes} in {waiting} frames"
        );
        if seq % 3 == 0 {
            while window.work().unwrap() {}
        }
    }
    let note = window.note().unwrap();
    (window as Box<dyn Sink>).finish().unwrap();
    let path = folder.path().join("run.mcap");
    (path.exists().then(|| read(&path)), note)
}

/// Frames that arrive once a second, of which some are violations that last one frame.
fn once_a_second(frames: u64, violations: &[u64]) -> Vec<(f64, Option<u32>)> {
    let changed = |seq: u64| violations.contains(&seq).then_some(1);
    (0..frames).map(|seq| (seq as f64, changed(seq))).collect()
}

const MEMORY: u64 = 1 << 30;

#[test]
fn a_window_has_the_frames_before_and_after_a_violation() {
    let folder = TempDir::new().unwrap();
    let frames = once_a_second(100, &[20, 60, 64]);
    let (content, note) = record_windows(&folder, (5.0, MEMORY), &frames);
    let content = content.unwrap();
    assert_eq!(content.seqs(), (15..=25).chain(55..=69).collect::<Vec<_>>());
    assert_eq!(content.with_curves(), content.seqs());
    // Each window replays by itself, and nothing counts as lost.
    assert_eq!(content.baselines, [(15, 3), (55, 3)]);
    assert_eq!(content.missing, 0);
    assert!(
        note.contains("26 of 100 frames, around 2 violations"),
        "{note}"
    );
}

#[test]
fn no_file_is_written_without_a_violation() {
    let folder = TempDir::new().unwrap();
    let (content, note) = record_windows(&folder, (5.0, MEMORY), &once_a_second(100, &[]));
    assert_eq!((content, names(&folder).len()), (None, 0));
    assert!(
        note.contains("no violation in 100 frames, so no file"),
        "{note}"
    );
}

#[test]
fn a_violation_that_lasts_begins_one_window() {
    let folder = TempDir::new().unwrap();
    let mut frames = once_a_second(100, &[]);
    frames[20..].iter_mut().for_each(|frame| frame.1 = Some(1));
    // Another pair of curves.
    frames[70..].iter_mut().for_each(|frame| frame.1 = Some(2));
    let (content, _) = record_windows(&folder, (3.0, MEMORY), &frames);
    let expected: Vec<u64> = (17..=23).chain(67..=73).collect();
    assert_eq!(content.unwrap().seqs(), expected);
}

#[test]
fn a_window_is_shorter_if_the_memory_is_too_small_and_says_so() {
    let folder = TempDir::new().unwrap();
    let frames = once_a_second(100, &[50]);
    // A frame of three triangles, with its record.
    let frame_bytes = 3 * 9 * 4 + 1024;
    let (content, note) = record_windows(&folder, (20.0, 4 * frame_bytes), &frames);
    let seqs = content.unwrap().seqs();
    assert_eq!((seqs[0], seqs.len()), (46, 25));
    assert!(note.contains("1 shorter before the violation"), "{note}");
    // The frame before a violation is kept in any case.
    let folder = TempDir::new().unwrap();
    let (content, _) = record_windows(&folder, (0.1, 1), &frames);
    assert_eq!(content.unwrap().seqs(), [49, 50]);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Compares windows with their definition.
    #[test]
    fn windows_have_exactly_the_frames_near_violations(
        steps in proptest::collection::vec((0_u32..30, 0_u32..8), 1..120),
        span in 0_u32..60,
    ) {
        let mut at = 0;
        let frames: Vec<(f64, Option<u32>)> = steps
            .iter()
            .map(|(step, violated)| {
                at += step;
                (f64::from(at), (*violated == 0).then_some(1))
            })
            .collect();
        let folder = TempDir::new().unwrap();
        let (content, _) = record_windows(&folder, (f64::from(span), MEMORY), &frames);
        let is_new = |k: &usize| frames[*k].1.is_some() && (*k == 0 || frames[k - 1].1.is_none());
        let violations: Vec<usize> = (0..frames.len()).filter(is_new).collect();
        let near = |k: &usize| {
            violations.iter().any(|&v| {
                (frames[v].0 - frames[*k].0).abs() <= f64::from(span) || *k == v || *k + 1 == v
            })
        };
        let expected: Vec<u64> = (0..frames.len()).filter(near).map(|k| k as u64).collect();
        let content = content.unwrap_or_default();
        prop_assert_eq!(content.seqs(), expected);
        prop_assert_eq!(content.missing, 0);
    }
}

/// Records frames of about 108 kB in several files.
fn record_files(options: RecordingOptions, frames: u64, violations: &[u64]) -> String {
    let mut sink = options.open().unwrap();
    sink.begin(&baseline(3000)).unwrap();
    for seq in 0..frames {
        let changed = violations.contains(&seq).then_some(1);
        sink.frame(&frame(seq, 3000, changed)).unwrap();
    }
    let note = sink.note().unwrap();
    sink.finish().unwrap();
    note
}

#[test]
fn files_stay_below_the_maximum_size_and_replay_by_themselves() {
    for retention in [Retention::All, every(3)] {
        let folder = TempDir::new().unwrap();
        let mut options = options(&folder, retention);
        options.max_bytes = Some(1_000_000);
        let note = record_files(options, 60, &[13, 40]);
        let files = names(&folder);
        assert!(files.len() >= 3, "{files:?}");
        assert!(note.contains(&format!("{} files", files.len())), "{note}");
        let mut all = Vec::new();
        for number in 1..=files.len() as u64 {
            let path = part_of(&folder.path().join("run.mcap"), number);
            assert!(std::fs::metadata(&path).unwrap().len() <= 1_000_000);
            let content = read(&path);
            assert_eq!((content.missing, content.baselines.len()), (0, 1));
            assert_eq!(content.baselines[0].0, content.seqs()[0]);
            // A replay of a violation needs the frame before it.
            for violation in [13, 40] {
                let seqs = content.with_curves();
                let has = |seq: u64| seqs.contains(&seq);
                assert_eq!(has(violation), has(violation) && has(violation - 1));
            }
            let part = (number > 1).then(|| number.to_string());
            assert_eq!(content.metadata.get("part"), part.as_ref());
            all.extend(content.seqs());
        }
        assert_eq!(all, (0..60).collect::<Vec<_>>());
    }
}

#[test]
fn a_frame_that_is_larger_than_the_maximum_has_a_file_of_its_own() {
    let folder = TempDir::new().unwrap();
    let mut options = options(&folder, Retention::All);
    options.max_bytes = Some(1_000_000);
    let mut sink = options.clone().open().unwrap();
    for seq in 0..3 {
        sink.frame(&frame(seq, 40_000, Some(1))).unwrap();
    }
    sink.finish().unwrap();
    assert_eq!(names(&folder).len(), 3);
    options.max_bytes = Some(1000);
    let e = options.open().err().unwrap().to_string();
    assert!(e.contains("1000 bytes are too small"), "{e}");
}

#[test]
fn old_files_are_deleted_but_not_the_one_with_the_first_violation() {
    let folder = TempDir::new().unwrap();
    let mut options = options(&folder, Retention::All);
    options.max_bytes = Some(1_000_000);
    options.keep_files = NonZeroU64::new(2);
    let note = record_files(options, 80, &[10]);
    let files = names(&folder);
    assert_eq!(files.len(), 3, "{files:?}");
    let evidence = files.iter().filter(|name| {
        let content = read(&folder.path().join(name));
        content.seqs().contains(&10)
    });
    assert_eq!(evidence.count(), 1);
    assert!(note.contains("were deleted"), "{note}");
    let last = files
        .iter()
        .any(|name| read(&folder.path().join(name)).seqs().contains(&79));
    assert!(last, "the newest file is kept");
}

/// A name that is taken ends no recording that is hours old.
#[test]
fn later_files_skip_names_that_are_taken() {
    for overwrite in [false, true] {
        let folder = TempDir::new().unwrap();
        let mine = folder.path().join("run-part2.mcap");
        std::fs::write(&mine, "mine").unwrap();
        // With `overwrite`, another process reads it.
        let reader = std::fs::File::open(&mine).unwrap();
        super::super::file::share(&reader);
        let mut options = options(&folder, Retention::All);
        options.max_bytes = Some(1_000_000);
        options.overwrite = overwrite;
        record_files(options, 20, &[]);
        let expected = match cfg!(unix) || !overwrite {
            true => [
                "run-part2.mcap",
                "run-part3.mcap",
                "run-part4.mcap",
                "run.mcap",
            ],
            false => return,
        };
        assert_eq!(names(&folder), expected);
        assert_eq!(std::fs::read(&mine).unwrap(), b"mine");
        let third = read(&folder.path().join("run-part3.mcap"));
        assert_eq!(third.metadata["continues"], "run.mcap");
    }
    // The name that the user chose is not replaced by another one.
    let folder = TempDir::new().unwrap();
    std::fs::write(folder.path().join("run.mcap"), "mine").unwrap();
    assert!(options(&folder, Retention::All).open().is_err());
}

/// Curves appear in frame 5: a window after that has the new baseline and the new names, and one
/// before it the old ones.
#[test]
fn a_window_has_the_baseline_and_the_names_of_its_own_frames() {
    let folder = TempDir::new().unwrap();
    let files = Files::new(options(&folder, Retention::All));
    let mut window = Window::new(files, Duration::from_secs(1), MEMORY);
    let labels = |curves: usize| {
        let names = (0..curves).map(|k| format!("curve {k}"));
        Arc::new(CurveLabels::named(names))
    };
    window.begin(&baseline(2)).unwrap();
    for seq in 0..20 {
        let curves = if seq < 5 { 2 } else { 3 };
        if seq == 5 {
            window.expect(&baseline(3)).unwrap();
        }
        let changed = [2, 10].contains(&seq).then_some(1);
        let mut record = frame(seq, curves, changed);
        record.info.labels = labels(curves);
        record.info.layout = u32::from(seq >= 5);
        window.take(&record, Duration::from_secs(seq)).unwrap();
    }
    Box::new(window).finish().unwrap();
    let content = read(&folder.path().join("run.mcap"));
    assert_eq!(content.seqs(), [1, 2, 3, 9, 10, 11]);
    assert_eq!(content.baselines, [(1, 2), (9, 3)]);
    assert_eq!(content.names[2].len(), 2);
    assert_eq!(content.names[3], labels(3).names);
}

#[test]
fn the_baseline_before_a_frame_that_changes_it_is_that_of_the_frame_before() {
    let mut state = InForce::default();
    let curves = |start: &Start| start.baseline.as_ref().map(|b| b.certificate.curves);
    state.begin(&baseline(1));
    assert_eq!(curves(&state.pass(&frame(0, 1, None))), Some(1));
    // Pairs have linking numbers again: the curves stay the same.
    state.expect(&baseline(2));
    let start = state.pass(&frame(1, 1, None));
    assert_eq!(
        (curves(&start), start.answered, start.new),
        (Some(1), 1, false)
    );
    assert_eq!(curves(&state.pass(&frame(2, 1, None))), Some(2));
    // Other curves: the indices of the old baseline do not fit.
    state.expect(&baseline(3));
    let mut record = frame(3, 1, None);
    record.info.layout = 1;
    let start = state.pass(&record);
    assert_eq!((curves(&start), start.new), (Some(3), true));
}

/// A disk that freezes at one of its calls, until the test thaws it.
#[derive(Clone)]
struct Disk {
    files: Arc<Mutex<Vec<Vec<u8>>>>,
    /// Held by the test while the disk is frozen.
    frozen: Arc<RwLock<()>>,
    /// Number of calls before the disk freezes.
    calls: Arc<Mutex<usize>>,
}

impl Disk {
    fn call(&self) {
        let mut calls = self.calls.lock().unwrap();
        match calls.checked_sub(1) {
            Some(left) => *calls = left,
            None => drop(self.frozen.read().unwrap()),
        }
    }
}

/// A file on this disk.
struct OnDisk {
    disk: Disk,
    number: usize,
}

impl Write for OnDisk {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.disk.call();
        self.disk.files.lock().unwrap()[self.number].extend(bytes);
        Ok(bytes.len())
    }
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl super::super::writer::Output for OnDisk {
    fn sync(&self) -> io::Result<()> {
        self.disk.call();
        Ok(())
    }
}

/// A disk that freezes when a file is created, written or closed delays no caller, whatever the
/// recording keeps. When it works again, every frame that was not counted as dropped is there.
#[test]
fn a_frozen_disk_delays_no_caller_whatever_is_kept() {
    const LONG: Duration = Duration::from_secs(60);
    let window = Retention::Window {
        span: LONG,
        memory: MEMORY,
    };
    for (retention, calls) in [
        (Retention::All, 0),
        (Retention::All, 5),
        // From the creation of the second file on, or while the first one is closed.
        (Retention::All, 14),
        (every(3), 7),
        (window, 0),
        (window, 2),
    ] {
        let frozen = Arc::new(RwLock::new(()));
        let disk = Disk {
            files: Arc::default(),
            frozen: Arc::clone(&frozen),
            calls: Arc::new(Mutex::new(calls)),
        };
        let on = disk.clone();
        let create: files::Create = Box::new(move |path, metadata| {
            on.call();
            let mut files = on.files.lock().unwrap();
            files.push(Vec::new());
            let number = files.len() - 1;
            drop(files);
            let disk = on.clone();
            super::super::writer::RecordingSink::on(
                path,
                Box::new(OnDisk { disk, number }),
                metadata,
            )
        });
        let mut options = RecordingOptions::new("run.mcap");
        options.max_bytes = Some(1_000_000);
        let queue = SinkQueue::spawn("recording", 4, Overflow::Wait(Duration::from_millis(5)), {
            move || sink(Files::created_by(options, create), retention)
        });
        let queue = queue.unwrap();
        let thaw = frozen.write().unwrap();
        let start = std::time::Instant::now();
        queue.begin(Arc::new(baseline(3000)));
        for seq in 0..40 {
            let changed = (seq == 20).then_some(1);
            queue.frame(Arc::new(frame(seq, 3000, changed)));
        }
        assert!(start.elapsed() < LONG / 2, "{retention:?}");
        drop(thaw);
        let summary = queue.finish(LONG);
        assert_eq!(summary.failed, None);
        assert_eq!(summary.written + summary.dropped, 40);
        let files = disk.files.lock().unwrap();
        let contents = files
            .iter()
            .map(|bytes| read_from(RecordingReader::new(Cursor::new(bytes)).unwrap()));
        let contents: Vec<Content> = contents.collect();
        let seqs: Vec<u64> = contents.iter().flat_map(Content::seqs).collect();
        assert!(seqs.is_sorted_by(|a, b| a < b), "{seqs:?}");
        assert_eq!(seqs.len() as u64, summary.written, "{retention:?} {calls}");
        let missing: u64 = contents.iter().map(|c| c.missing).sum();
        assert_eq!(missing, summary.dropped, "{retention:?} {calls}");
    }
}

#[test]
fn the_page_of_limits_has_those_of_recordings() {
    let page = include_str!("../../../../docs/limits.md");
    assert_eq!(
        (Retention::WINDOW_MEMORY, RecordingOptions::LEAST_MAX_BYTES),
        (1 << 30, 1_000_000)
    );
    for row in [
        "(`--record-window`) | 1 GiB (`--record-window-memory`): their positions, and about 1 KiB",
        "(`--record-max SIZE`) | SIZE, at least 1 MB;",
        "after the first one | 10,000;",
    ] {
        assert!(page.contains(row), "not in docs/limits.md: {row}");
    }
    assert_eq!((files::NAMES, window::RECORD_BYTES), (10_000, 1 << 10));
}
