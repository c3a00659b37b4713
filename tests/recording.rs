//! Recordings: the content is read bit for bit as it was written; damage is detected and named,
//! without a panic.

use linkwatch::{
    BaselineRecord, Basis, Certificate, Change, CurveSet, Defect, DefectKind, Ending, Error,
    FrameInfo, FrameRecord, FrameTimes, Link, LiveTimes, Place, Positions, Precision, PullThrough,
    RecordedItem, RecordingReader, RecordingSink, Report, Route, RunProgress, Sink, Verdict, Work,
};
use std::collections::BTreeMap;
use std::io::Cursor;
use std::sync::Arc;
use std::time::Duration;

fn place() -> Place {
    Place {
        segments: [3, 4],
        point: [0.1, -2e30, 3e-300],
        distance: 1.5e-9,
    }
}

/// A report that uses every field, if its verdict is that it was rejected. The verdict varies.
fn report(seq: u64) -> Report {
    let verdict = Verdict::ALL[seq as usize % Verdict::ALL.len()];
    let kinds = DefectKind::ALL.iter().enumerate();
    let mut report = Report::new(seq, seq as f64 * 0.1, verdict);
    report.abort = seq % 2 == 1;
    report.changes = vec![
        Change {
            i: 1,
            j: 2,
            image: Default::default(),
            expected: -1,
            found: 0,
            place: Some(place()),
        },
        Change {
            i: 1,
            j: u32::MAX,
            image: [i32::MIN, 0, i32::MAX],
            expected: i64::MIN,
            found: i64::MAX,
            place: None,
        },
    ];
    report.events = vec![PullThrough {
        i: 3,
        j: 3,
        image: Default::default(),
        segments: [4, 5],
        fraction: 0.1 * (seq % 10) as f64,
        sign: if seq.is_multiple_of(2) { 1 } else { -1 },
        point: [0.5, -1.5, 2.5],
        lengths: 0.125,
    }];
    report.unresolved = vec![PullThrough {
        i: 2,
        j: 5,
        image: [1, 0, -2],
        segments: [1, 0],
        fraction: 0.75,
        sign: 1,
        point: [1.5, 0.5, -2.5],
        lengths: 3.5,
    }];
    report.adopted = vec![Link {
        i: 0,
        j: 9,
        lambda: -3,
    }];
    report.defects = kinds
        .map(|(k, &kind)| Defect {
            i: k as u32,
            j: (k != 2).then_some(k as u32 + 7),
            image: Default::default(),
            kind,
            place: place(),
        })
        .collect();
    report.last_intact = Some(6);
    report.safe_fraction = Some(0.375);
    report.rejected = (verdict == Verdict::Rejected).then(|| "coordinate y is NaN".into());
    report.stats.curves = 1;
    report.stats.segments = 2;
    report.stats.open_curves = 3;
    report.stats.repeated_vertices = 4;
    report.stats.potential_links = 5;
    report.stats.separated = 6;
    report.stats.tests = 7;
    report.stats.crossings = 8;
    report.stats.overlaps = 9;
    report.stats.refined = 10;
    report.stats.exact = u64::MAX;
    report.stats.unchecked = 11;
    report.stats.extent = 12.5;
    report
}

/// A field that was added to the library must be added above, or its round trip is not tested.
#[test]
fn the_reports_of_these_tests_use_every_field() {
    let json = |report: &Report, work: &Work| serde_json::to_value((report, work)).unwrap();
    let empty = json(&Report::new(0, 0.0, Verdict::Intact), &Work::default());
    let rejected = Verdict::ALL.iter().position(|v| *v == Verdict::Rejected);
    // Odd, so that it asks to stop; and the number of a frame in which both runs disagreed.
    let seq = (0..100).find(|n| n % 2 == 1 && n % Verdict::ALL.len() == rejected.unwrap());
    let full = json(&report(seq.unwrap() as u64), &work(7));
    fn compare(path: &str, empty: &serde_json::Value, full: &serde_json::Value) {
        match (empty.as_object(), full.as_object()) {
            (Some(a), Some(b)) => {
                assert_eq!(a.len(), b.len(), "{path}");
                for (key, value) in a {
                    compare(&format!("{path}.{key}"), value, &b[key]);
                }
            }
            _ => assert_ne!(empty, full, "{path} is not set"),
        }
    }
    for part in 0..2 {
        compare(["report", "work"][part], &empty[part], &full[part]);
    }
}

/// Counts that are valid for every basis, with negative zeros and subnormal numbers among the
/// coordinates.
fn curves(basis: Basis, precision: Precision, seq: u64) -> CurveSet {
    let counts = [-6, 7, -9, -3];
    let at = |k: i32| match k {
        0 => -0.0,
        1 => 5e-324,
        k => f64::from(k * k % 31).sqrt() + seq as f64,
    };
    let wide: Vec<f64> = (0..3 * 25).map(at).collect();
    let narrow: Vec<f32> = wide.iter().map(|&v| v as f32).collect();
    let positions = match precision {
        Precision::F32 => Positions::F32(&narrow),
        Precision::F64 => Positions::F64(&wide),
    };
    CurveSet::from_counts(basis, &counts, positions).unwrap()
}

fn work(seq: u64) -> Work {
    let mut work = Work::default();
    work.route = Route::ALL[seq as usize % 3];
    work.blocks = 100;
    work.marked = seq;
    work.recertified = 2;
    work.recomputed = 3;
    work.summed = 2;
    work.searched = 4;
    work.reference_age = (seq > 1).then_some(seq);
    work.disagreed = seq == 7;
    work
}

fn record(seq: u64, curves: Option<CurveSet>) -> FrameRecord {
    FrameRecord {
        curves: curves.map(Arc::new),
        info: FrameInfo {
            cuts: seq as u32 / 2,
            ..FrameInfo::at(seq, report(seq).time)
        },
        report: Arc::new(report(seq)),
        progress: RunProgress {
            verified: seq,
            skipped: 2 * seq,
            rejected: 3,
            times: FrameTimes {
                ingest: Duration::from_nanos(123_456_789 + seq),
                verification: Duration::from_nanos(987_654_321),
                live: (seq > 0).then(|| LiveTimes {
                    interval: Duration::from_secs(seq),
                    wait: Duration::from_millis(seq),
                    send: Duration::from_nanos(seq),
                }),
                ..FrameTimes::default()
            },
            work: work(seq),
            received_ns: 1_700_000_000_000_000_000 + seq,
            ..RunProgress::default()
        },
    }
}

fn baseline() -> BaselineRecord {
    let links = vec![
        Link {
            i: 0,
            j: 1,
            lambda: -2,
        },
        Link {
            i: 0,
            j: 3,
            lambda: 1,
        },
    ];
    let undefined = vec![Defect {
        i: 1,
        j: Some(2),
        image: Default::default(),
        kind: DefectKind::TooClose,
        place: place(),
    }];
    BaselineRecord {
        certificate: Arc::new(Certificate::new(4, links, undefined)),
        origin: "first frame".into(),
        frame: Some(0),
        unverified: 0,
    }
}

fn metadata() -> BTreeMap<String, String> {
    [("service", "cloth"), ("abort", "any")]
        .map(|(k, v)| (k.into(), v.into()))
        .into()
}

/// Writes a recording and returns its bytes.
fn write(frames: &[FrameRecord], flush: bool, finish: bool) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let mut sink = Box::new(RecordingSink::create(&path, &metadata()).unwrap());
    sink.begin(&baseline()).unwrap();
    for frame in frames {
        sink.frame(frame).unwrap();
        if flush {
            sink.flush().unwrap();
        }
    }
    if finish {
        sink.finish().unwrap();
        return std::fs::read(&path).unwrap();
    }
    // As a killed process leaves it: read while the writer is still open.
    let bytes = std::fs::read(&path).unwrap();
    sink.finish().unwrap();
    bytes
}

fn small(frames: u64) -> Vec<FrameRecord> {
    (1..=frames)
        .map(|seq| record(seq, Some(curves(Basis::Polyline, Precision::F32, seq))))
        .collect()
}

/// Returns all readable items, and the error that ended the reading.
fn read(bytes: &[u8]) -> (Vec<RecordedItem>, Option<Ending>, Option<Error>) {
    let mut reader = match RecordingReader::new(Cursor::new(bytes)) {
        Ok(reader) => reader,
        Err(e) => return (Vec::new(), None, Some(e)),
    };
    let mut items = Vec::new();
    loop {
        match reader.next_item() {
            Ok(Some(item)) => items.push(item),
            Ok(None) => return (items, reader.ending().cloned(), None),
            Err(e) => {
                assert!(reader.next_item().unwrap().is_none(), "{e}");
                return (items, reader.ending().cloned(), Some(e));
            }
        }
    }
}

fn positions(set: &CurveSet) -> Vec<u8> {
    let mut bytes = Vec::new();
    set.write_positions(&mut bytes);
    bytes
}

#[test]
fn every_basis_and_precision_is_read_bit_for_bit() {
    for basis in Basis::ALL {
        for precision in [Precision::F32, Precision::F64] {
            let frames: Vec<_> = (1..=4)
                .map(|seq| record(seq, Some(curves(basis, precision, seq))))
                .collect();
            let (items, ending, error) = read(&write(&frames, false, true));
            assert!(error.is_none(), "{error:?}");
            assert_eq!(ending, Some(Ending::Finished));
            assert_eq!(items.len(), 1 + 2 * frames.len());
            assert_eq!(items[0], RecordedItem::Baseline(baseline()));
            let mut set = None;
            for (item, was) in items[1..].chunks(2).zip(&frames) {
                let [RecordedItem::Frame(frame), RecordedItem::Verdict(verdict)] = item else {
                    panic!("{item:?}");
                };
                frame.ingest(&mut set).unwrap();
                let (set, was_set) = (set.as_ref().unwrap(), was.curves.as_ref().unwrap());
                assert_eq!(positions(set), positions(was_set));
                assert!(set.counts().eq(was_set.counts()));
                assert_eq!((set.basis(), set.precision()), (basis, precision));
                assert_eq!((frame.seq, frame.time), (was.report.seq, was.report.time));
                assert_eq!(frame.info, was.info);
                assert_eq!(verdict.report, *was.report);
                assert_eq!(verdict.progress, was.progress);
            }
        }
    }
}

#[test]
fn rejects_a_frame_of_other_curves() {
    let mut other = curves(Basis::Polyline, Precision::F64, 1);
    for (set, what) in [
        (curves(Basis::Polyline, Precision::F32, 1), "coordinate"),
        (curves(Basis::BSpline, Precision::F64, 1), "basis"),
    ] {
        let (items, ..) = read(&write(&[record(1, Some(set))], false, true));
        let RecordedItem::Frame(frame) = &items[1] else {
            panic!("{items:?}");
        };
        let mut before = Some(other.clone());
        let e = frame.ingest(&mut before).unwrap_err().to_string();
        assert!(e.contains(what), "{e}");
        other = before.unwrap();
    }
}

#[test]
fn other_readers_read_all_messages_and_the_index() {
    let bytes = write(&small(5), true, true);
    let topics: Vec<_> = mcap::MessageStream::new(&bytes)
        .unwrap()
        .map(|m| m.unwrap().channel.topic.clone())
        .collect();
    assert_eq!(topics.len(), 11);
    assert_eq!(
        topics[..3],
        [
            "/linkwatch/baseline",
            "/linkwatch/frames",
            "/linkwatch/verdicts"
        ]
    );
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    assert_eq!(summary.stats.unwrap().message_count, 11);
    assert_eq!(summary.metadata_indexes.len(), 1);
    assert!(!summary.chunk_indexes.is_empty());
    let largest = summary.chunk_indexes.iter().map(|c| c.uncompressed_size);
    assert!(largest.max().unwrap() <= 1 << 20);
    assert_eq!(summary.schemas.len(), 4);
}

#[test]
fn a_rejected_frame_has_a_verdict_and_no_curves() {
    let (items, ending, error) = read(&write(&[record(5, None)], false, true));
    assert!(error.is_none());
    assert_eq!(ending, Some(Ending::Finished));
    assert!(matches!(&items[1], RecordedItem::Verdict(v) if v.report == report(5)));
    assert_eq!(items.len(), 2);
}

#[test]
fn a_recording_without_frames_is_complete() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("empty.mcap");
    let sink = RecordingSink::create(&path, &metadata()).unwrap();
    Box::new(sink).finish().unwrap();
    let mut reader = RecordingReader::open(&path).unwrap();
    assert!(reader.next_item().unwrap().is_none());
    assert_eq!(reader.ending(), Some(&Ending::Finished));
    assert_eq!(reader.metadata()["service"], "cloth");
    assert_eq!(reader.metadata()["abort"], "any");
    assert_eq!(reader.metadata()["version"], env!("CARGO_PKG_VERSION"));
}

#[test]
fn reads_a_frame_larger_than_a_chunk() {
    let ring = |seq: u64| {
        let xyz: Vec<f32> = (0..3 * 210_000)
            .map(|k| (k as f32).sin() + seq as f32)
            .collect();
        let counts = vec![-15; 14_000];
        CurveSet::from_counts(Basis::Polyline, &counts, Positions::F32(&xyz)).unwrap()
    };
    let frames: Vec<_> = (1..=3).map(|s| record(s, Some(ring(s)))).collect();
    let bytes = write(&frames, false, true);
    let (items, ending, error) = read(&bytes);
    assert!(error.is_none(), "{error:?}");
    assert_eq!((items.len(), ending), (7, Some(Ending::Finished)));
    // After a kill, every flushed frame is present.
    let (items, ending, error) = read(&write(&frames, true, false));
    assert!(error.is_none(), "{error:?}");
    assert_eq!(items.len(), 7);
    assert!(matches!(ending, Some(Ending::Cut { .. })));
}

/// 240 MB in one frame: slow in a debug build, so run by hand.
#[test]
#[ignore = "takes 2 GB of memory"]
fn reads_a_huge_frame() {
    let xyz: Vec<f64> = (0..30_000_000).map(f64::from).collect();
    let set = CurveSet::from_counts(Basis::Polyline, &[-10_000_000], Positions::F64(&xyz)).unwrap();
    let before = positions(&set);
    let (items, ending, error) = read(&write(&[record(1, Some(set))], true, true));
    assert!(error.is_none(), "{error:?}");
    assert_eq!(ending, Some(Ending::Finished));
    let RecordedItem::Frame(frame) = &items[1] else {
        panic!("no frame");
    };
    let mut set = None;
    frame.ingest(&mut set).unwrap();
    assert!(positions(&set.unwrap()) == before);
}

#[test]
fn reads_the_complete_part_of_a_truncated_recording() {
    let frames = small(6);
    for flush in [true, false] {
        let whole = write(&frames, flush, true);
        let (all, ..) = read(&whole);
        let mut most = 0;
        for end in 0..whole.len() {
            let (items, ending, error) = read(&whole[..end]);
            assert!(error.is_none(), "cut at {end}: {error:?}");
            assert_eq!(items[..], all[..items.len()], "cut at {end}");
            assert!(items.len() >= most, "cut at {end} gives less than before");
            most = items.len();
            match ending {
                Some(Ending::Cut { at, .. }) => assert!(at <= end as u64),
                // Truncated after the data: only the index is missing.
                Some(Ending::Finished) => assert_eq!(most, all.len(), "cut at {end}"),
                None => panic!("no ending at {end}"),
            }
        }
    }
}

#[test]
fn detects_damage_at_any_byte() {
    let whole = write(&small(4), true, true);
    let (all, ..) = read(&whole);
    for at in 0..whole.len() {
        for flip in [0x01, 0x80, 0xff] {
            let mut bytes = whole.clone();
            bytes[at] ^= flip;
            let (items, ending, error) = read(&bytes);
            // The returned items are as written. A gap is possible if a chunk has become a record
            // that readers skip; then the checksum of the whole file is wrong, which is an error.
            let prefix = items[..] == all[..items.len()];
            assert!(items.iter().all(|i| all.contains(i)), "byte {at}");
            assert!(prefix || error.is_some(), "byte {at}");
            // No frame is lost without notice: either all are present, or the end reports the loss.
            let reported = error.is_some() || matches!(ending, Some(Ending::Cut { .. }));
            assert!(reported || items.len() == all.len(), "byte {at}");
        }
    }
}

/// Regression test: the second of two recordings in one file was ignored without a message.
#[test]
fn recordings_that_were_joined_are_an_error() {
    let one = write(&small(3), false, true);
    let (all, ending, error) = read(&one);
    assert!(ending == Some(Ending::Finished) && error.is_none());
    for more in [&one[..], &[0]] {
        let (items, ending, error) = read(&[&one, more].concat());
        let error = error.unwrap().to_string();
        let words = format!("{} bytes after the end of the recording", more.len());
        assert!(error.contains(&words), "{error}");
        assert_eq!((items, ending), (all.clone(), None));
    }
}

#[test]
fn rejects_wrong_lengths_without_allocating_them() {
    let whole = write(&small(2), true, true);
    // Every position at which eight bytes could be a length.
    for at in 0..whole.len() - 8 {
        for length in [u64::MAX, u64::MAX - 8, 1 << 62, 1 << 40] {
            let mut bytes = whole.clone();
            bytes[at..at + 8].copy_from_slice(&length.to_le_bytes());
            read(&bytes);
        }
        for count in [u32::MAX, 1 << 31] {
            let mut bytes = whole.clone();
            bytes[at..at + 4].copy_from_slice(&count.to_le_bytes());
            read(&bytes);
        }
    }
}

#[test]
fn rejects_other_files_by_name() {
    for bytes in [&b"no recording at all"[..], &[0; 100], b"\x89MCAP1\r\n"] {
        let (.., error) = read(bytes);
        let e = error.unwrap().to_string();
        assert!(e.contains("not an MCAP file"), "{e}");
    }
    assert!(matches!(read(b"").1, Some(Ending::Cut { at: 0, .. })));
    let e = RecordingReader::open(&std::env::temp_dir()).err().unwrap();
    assert!(e.to_string().contains("regular file"), "{e}");
}

/// A recording of another program: its own topics, linkwatch topics with another schema.
fn foreign(topic: &str, schema: &str) -> Vec<u8> {
    let options = mcap::WriteOptions::new().compression(None);
    let mut writer = options.create(Cursor::new(Vec::new())).unwrap();
    let schema = writer.add_schema(schema, "protobuf", b"").unwrap();
    let channel = writer
        .add_channel(schema, topic, "protobuf", &BTreeMap::new())
        .unwrap();
    for sequence in 0..3 {
        let header = mcap::records::MessageHeader {
            channel_id: channel,
            sequence,
            log_time: 0,
            publish_time: 0,
        };
        // A frame: basis 1, precision 1.
        let data = [0x18, 1, 0x20, 1];
        writer.write_to_known_channel(&header, &data).unwrap();
    }
    writer.finish().unwrap();
    writer.into_inner().into_inner()
}

#[test]
fn skips_and_counts_other_topics_and_schemas() {
    for (topic, schema) in [
        ("/camera", "linkwatch.v1.CurveFrame"),
        ("/linkwatch/frames", "other.v1.CurveFrame"),
        ("/linkwatch/frames", "linkwatch.v1.Verdict"),
    ] {
        let bytes = foreign(topic, schema);
        let mut reader = RecordingReader::new(Cursor::new(bytes)).unwrap();
        assert!(reader.next_item().unwrap().is_none());
        assert_eq!(reader.skipped(), 3);
        assert_eq!(reader.ending(), Some(&Ending::Finished));
    }
}

#[test]
fn another_version_is_an_error() {
    let (.., error) = read(&foreign("/linkwatch/frames", "linkwatch.v7.CurveFrame"));
    assert!(matches!(
        error,
        Some(Error::Version {
            found: 7,
            known: 1,
            ..
        })
    ));
}
