//! Tests of what recordings keep, with times that the tests set.

use super::*;
use crate::certificate::Certificate;
use crate::curve::{Basis, CurveLabels, CurveSet, Positions};
use crate::ingest::FrameInfo;
use crate::record::{Ending, RecordedItem, RecordingReader};
use crate::sinks::RunProgress;
use crate::verdict::{Change, Report};
use std::io::{Read, Seek};
use tempfile::TempDir;

mod disks;
mod parts;
mod windows;

/// Memory for all frames of a test.
const MEMORY: u64 = 1 << 30;

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
        image: Default::default(),
        expected: 1,
        found: 0,
        place: None,
    }));
    FrameRecord {
        info: FrameInfo::default(),
        curves: Some(Arc::new(set)),
        report: Arc::new(report),
        progress: RunProgress {
            verified: seq + 1,
            ..RunProgress::default()
        },
    }
}

fn baseline(curves: usize) -> BaselineRecord {
    BaselineRecord {
        certificate: Arc::new(Certificate {
            curves,
            ..Certificate::default()
        }),
        origin: format!("{curves} curves"),
        frame: Some(0),
        unverified: 0,
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
    /// Number of frames that are missing in the file, but were not skipped on purpose.
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

#[test]
fn the_page_of_limits_has_those_of_recordings() {
    let page = include_str!("../../../../docs/reference/limits.md");
    assert_eq!(
        (Retention::WINDOW_MEMORY, RecordingOptions::LEAST_MAX_BYTES),
        (1 << 30, 1_000_000)
    );
    for row in [
        "(`window=SECONDS`) | 1 GiB (`memory=SIZE`): their positions, and about 1 KiB",
        "(`max=SIZE`) | SIZE, at least 1 MB;",
        "after the first one | 10,000;",
    ] {
        assert!(page.contains(row), "not in docs/reference/limits.md: {row}");
    }
    assert_eq!((files::NAMES, window::RECORD_BYTES), (10_000, 1 << 10));
}
