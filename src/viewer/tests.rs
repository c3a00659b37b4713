//! Tests on the messages that a viewer would receive.

use super::names::APPLICATION;
use super::*;
use crate::curve::{Basis, CurveSet, Positions};
use crate::ingest::FrameInfo;
use crate::sinks::{FrameTimes, RunProgress};
use crate::verdict::{PullThrough, Report};
use re_sdk::RecordingStreamBuilder;
use re_sdk::log::{Chunk, LogMsg};
use re_sdk::sink::MemorySinkStorage;
use re_sdk_types::archetypes::{Capsules3D, LineStrips3D, Points3D, Scalars};
use re_sdk_types::blueprint::archetypes::TimePanelBlueprint;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

/// A triangle at height `z`; `None` for a frame without curves.
pub(super) fn record(seq: u64, z: Option<f32>, events: Vec<PullThrough>) -> FrameRecord {
    let set = |z| {
        let points = [0.0, 0.0, z, 2.0, 0.0, z, 0.0, 2.0, z];
        CurveSet::from_counts(Basis::Polyline, &[-3], Positions::F32(&points)).unwrap()
    };
    let verdict = match (z, events.is_empty()) {
        (None, _) => Verdict::Rejected,
        (_, true) => Verdict::Intact,
        (_, false) => Verdict::Changed,
    };
    let report = Report {
        abort: verdict == Verdict::Changed,
        events,
        ..Report::new(seq, seq as f64, verdict)
    };
    FrameRecord {
        curves: z.map(set).map(Arc::new),
        info: FrameInfo::default(),
        report: Arc::new(report),
        progress: RunProgress {
            verified: seq,
            times: FrameTimes {
                verification: Duration::from_millis(1),
                ..FrameTimes::default()
            },
            ..RunProgress::default()
        },
    }
}

fn event(point: Point) -> PullThrough {
    PullThrough {
        i: 0,
        j: 0,
        image: Default::default(),
        segments: [1, 2],
        fraction: 0.5,
        sign: -1,
        point,
        lengths: 0.5,
    }
}

/// Returns the chunks logged for an entity.
pub(super) fn chunks(messages: &[LogMsg], path: &str) -> impl Iterator<Item = Chunk> {
    let chunks = messages.iter().filter_map(|message| match message {
        LogMsg::ArrowMsg(_, message) => Chunk::from_arrow_msg(message).ok(),
        _ => None,
    });
    chunks.filter(move |c| *c.entity_path() == path.into())
}

/// Points of an entity with their labels, a row for each time that they were logged.
type Points = Vec<(Vec<[f32; 3]>, Vec<String>)>;

fn points(messages: &[LogMsg], path: &str) -> Points {
    let mut rows = Vec::new();
    for chunk in chunks(messages, path) {
        let positions = Points3D::descriptor_positions().component;
        let labels = Points3D::descriptor_labels().component;
        let mut labels = chunk.iter_slices::<String>(labels);
        let frames = chunk.iter_component_indices(FRAME.into(), positions);
        for ((frame, _), row) in frames.zip(chunk.iter_slices::<[f32; 3]>(positions)) {
            let words = labels.next().unwrap_or_default();
            let words = words.iter().map(|w| w.to_string()).collect();
            rows.push((frame, (row.to_vec(), words)));
        }
    }
    // Chunks of different timelines may come in any order.
    rows.sort_by_key(|(frame, _)| *frame);
    rows.into_iter().map(|(_, points)| points).collect()
}

fn logged(frames: &[FrameRecord]) -> Vec<LogMsg> {
    collected(|sink| sink, frames.iter().cloned())
}

/// Returns the messages of a live viewer that was prepared.
pub(super) fn collected(
    prepare: impl FnOnce(ViewerSink) -> ViewerSink,
    frames: impl IntoIterator<Item = FrameRecord>,
) -> Vec<LogMsg> {
    let (rec, storage): (_, MemorySinkStorage) =
        RecordingStreamBuilder::new(APPLICATION).memory().unwrap();
    let mut sink = prepare(ViewerSink::log_to(rec, false).unwrap());
    for frame in frames {
        sink.frame(&frame).unwrap();
    }
    storage.take()
}

#[test]
fn a_pull_through_keeps_a_mark_that_moves_with_the_curve() {
    let messages = logged(&[
        record(1, Some(0.0), Vec::new()),
        record(
            2,
            Some(1.0),
            vec![event([1.0, 1.25, 1.0]), event([1.0, 1.25, 1.0])],
        ),
        record(3, None, Vec::new()),
        record(4, Some(7.0), Vec::new()),
    ]);
    let marked = |path| {
        points(&messages, path)
            .into_iter()
            .map(|(p, _)| p)
            .collect()
    };
    let now: Vec<Vec<_>> = marked(entity::EVENTS);
    assert_eq!(now, [vec![], vec![[1.0, 1.25, 1.0]; 2], vec![]]);
    let before: Vec<Vec<_>> = marked(entity::PASSED);
    assert_eq!(before, [vec![], vec![], vec![[0.875, 1.125, 7.0]; 2]]);
    // One label for both, in their frame only.
    let places = points(&messages, entity::LABELS);
    let labels: Vec<_> = places.into_iter().map(|(_, words)| words).collect();
    let both = "0 through itself\n0 through itself".to_owned();
    assert_eq!(labels, [vec![], vec![both], vec![]]);
    let broken: Vec<_> = strips(&messages, entity::BROKEN);
    assert_eq!(broken, [1, 0]);
}

/// Returns the messages of a run that has ended, of a file or of a live viewer.
fn ended(frames: &[FrameRecord], is_file: bool) -> Vec<LogMsg> {
    let (rec, storage): (_, MemorySinkStorage) =
        RecordingStreamBuilder::new(APPLICATION).memory().unwrap();
    let mut sink = ViewerSink::log_to(rec, is_file).unwrap();
    for frame in frames {
        sink.frame(frame).unwrap();
    }
    Box::new(sink).finish().unwrap();
    storage.take()
}

/// Returns the timelines of the layouts, in the order in which they were sent, and the number
/// of eyes.
fn layouts(messages: &[LogMsg]) -> (Vec<String>, usize) {
    let chunks = messages.iter().filter_map(|message| match message {
        LogMsg::ArrowMsg(_, message) => Chunk::from_arrow_msg(message).ok(),
        _ => None,
    });
    let is_eye = |c: &Chunk| c.entity_path().to_string().ends_with("EyeControls3D");
    let eyes = chunks.filter(is_eye).count();
    let timeline = TimePanelBlueprint::descriptor_timeline().component;
    let mut timelines = Vec::new();
    for chunk in self::chunks(messages, "time_panel") {
        let rows = chunk.iter_slices::<String>(timeline);
        timelines.extend(rows.flatten().map(|name| name.to_string()));
    }
    (timelines, eyes)
}

fn broken(seq: u64) -> FrameRecord {
    record(seq, Some(0.0), vec![event([1.0, 1.0, 0.0])])
}

fn intact(seq: u64) -> FrameRecord {
    record(seq, Some(0.0), Vec::new())
}

#[test]
fn a_file_opens_at_the_first_violation_and_has_the_whole_log() {
    opens_at_the_first_violation(true);
}

/// A browser may open after the run has ended.
#[test]
fn a_server_opens_at_the_first_violation_and_has_the_whole_log() {
    opens_at_the_first_violation(false);
}

fn opens_at_the_first_violation(is_file: bool) {
    let messages = ended(&[intact(1), broken(2), intact(3), broken(4)], is_file);
    let (timelines, eyes) = layouts(&messages);
    assert_eq!(timelines, ["frame", "frame", "until_violation"]);
    assert_eq!(eyes, 2 * VIEWS, "at the violation, and at the end");
    let until = UNTIL.into();
    let ends = messages.iter().filter_map(|message| match message {
        LogMsg::ArrowMsg(_, message) => Chunk::from_arrow_msg(message).ok(),
        _ => None,
    });
    let ends = ends.filter_map(|c| Some(c.timelines().get(&until)?.time_range().max()));
    assert_eq!(ends.max().map(|t| t.as_i64()), Some(2));
    let is_until = |c: &Chunk| c.timelines().contains_key(&until);
    let lines = chunks(&messages, entity::LOG).filter(is_until);
    let lines: usize = lines.map(|c| c.num_rows()).sum();
    assert_eq!(lines, texts(&messages, entity::LOG).len());
    // Chunks of different timelines may come in any order; the note is on one timeline only.
    let mut noted = chunks(&messages, entity::STATUS).filter(|c| c.timelines().len() == 1);
    let text = TextDocument::descriptor_text().component;
    let note = noted.next().unwrap();
    assert!(is_until(&note) && noted.next().is_none());
    let words: Vec<_> = note.iter_slices::<String>(text).flatten().collect();
    let follow = "This is the first violation. 2 frames follow: click";
    assert!(words[0].contains(follow), "{words:?}");
}

#[test]
fn a_file_opens_at_its_end_if_nothing_follows_the_violation() {
    for frames in [[intact(1), broken(2)], [intact(1), intact(2)]] {
        let (timelines, eyes) = layouts(&ended(&frames, true));
        assert_eq!(timelines.last().map(String::as_str), Some("frame"));
        assert!(eyes > 0);
    }
}

/// Regression test: the viewer reported "Component 'Scalars:scalars' does not exist" for series
/// that began after the first violation.
#[test]
fn every_series_exists_on_every_timeline() {
    let mut rejected = record(1, None, Vec::new());
    rejected.progress.times.live = None;
    let live = |mut frame: FrameRecord| {
        frame.progress.times.live = Some(Default::default());
        frame.progress.work.blocks = 3;
        frame
    };
    let messages = ended(&[rejected, live(intact(2)), live(broken(3))], true);
    let scalars = Scalars::descriptor_scalars().component;
    let mut series = BTreeMap::<String, BTreeSet<String>>::new();
    for message in &messages {
        let LogMsg::ArrowMsg(_, message) = message else {
            continue;
        };
        let chunk = Chunk::from_arrow_msg(message).unwrap();
        if chunk.components().contains_component(scalars) {
            let timelines = chunk.timelines().keys().map(|name| name.to_string());
            let path = chunk.entity_path().to_string();
            series.entry(path).or_default().extend(timelines);
        }
    }
    assert_eq!(series.len(), 19, "{series:?}");
    let expected = [FRAME, SIM_TIME, UNTIL].map(str::to_owned).into();
    for (path, timelines) in series {
        assert_eq!(timelines, expected, "{path}");
    }
}

#[test]
fn the_eye_of_a_live_viewer_is_moved_once() {
    let messages = logged(&[intact(1), broken(2), broken(3), intact(4), broken(5)]);
    let (timelines, eyes) = layouts(&messages);
    assert_eq!(timelines, ["frame", "frame"]);
    assert_eq!(eyes, VIEWS);
}

/// Number of views of curves at the first violation: the scene, the overview, and the frames
/// before, at and after it.
const VIEWS: usize = 5;

/// Returns the number of curves of an entity, for each time that it was logged.
fn strips(messages: &[LogMsg], path: &str) -> Vec<usize> {
    strips_by_frame(messages, path)
        .into_iter()
        .map(|(_, count)| count)
        .collect()
}

/// Returns the frames in which an entity was logged, with the number of its curves.
pub(super) fn strips_by_frame(messages: &[LogMsg], path: &str) -> Vec<(i64, usize)> {
    let component = LineStrips3D::descriptor_strips().component;
    let mut counts = Vec::new();
    for chunk in chunks(messages, path) {
        let rows = chunk.iter_component::<re_sdk_types::components::LineStrip3D>(component);
        let frames = chunk.iter_component_indices(FRAME.into(), component);
        counts.extend(
            frames
                .map(|(t, _)| t.as_i64())
                .zip(rows.map(|row| row.as_slice().len())),
        );
    }
    // Chunks of different components may come in any order.
    counts.sort_unstable();
    counts
}

#[test]
fn every_pull_through_is_logged() {
    let frame = |seq| record(seq, Some(0.0), vec![event([0.0; 3])]);
    let messages = logged(&[frame(1), frame(2), frame(3)]);
    let texts = texts(&messages, entity::LOG);
    let logged = texts.iter().filter(|t| t.contains("passed through itself"));
    assert_eq!(logged.count(), 3, "{texts:?}");
}

fn texts(messages: &[LogMsg], path: &str) -> Vec<String> {
    let component = TextLog::descriptor_text().component;
    let mut texts = Vec::new();
    for chunk in chunks(messages, path) {
        let rows = chunk.iter_slices::<String>(component);
        texts.extend(rows.flatten().map(|text| text.to_string()));
    }
    texts
}

/// Number of tubes in the last row of an entity.
fn tubes(messages: &[LogMsg], path: &str) -> usize {
    let component = Capsules3D::descriptor_lengths().component;
    let lengths = |chunk: Chunk| {
        let rows = chunk.iter_slices::<f32>(component);
        rows.map(<[f32]>::len).last()
    };
    chunks(messages, path)
        .filter_map(lengths)
        .last()
        .unwrap_or(0)
}

#[test]
fn the_first_violation_is_shown_before_at_and_after_its_frame() {
    let passes = |seq, z| record(seq, Some(z), vec![event([1.0, 1.0, z.into()])]);
    let frames = [
        record(1, Some(0.0), Vec::new()),
        passes(2, 1.0),
        record(3, Some(2.0), Vec::new()),
        passes(4, 3.0),
    ];
    let [before, at, after] = entity::MOMENTS.map(|path| format!("{path}/strands"));
    let messages = logged(&frames[..2]);
    assert_eq!(
        [&before, &at, &after].map(|path| tubes(&messages, path)),
        [3, 3, 0]
    );
    let messages = logged(&frames);
    assert_eq!(
        [&before, &at, &after].map(|path| tubes(&messages, path)),
        [3, 3, 3]
    );
    // The scene has those of its frame.
    let component = Capsules3D::descriptor_lengths().component;
    let mut in_scene: Vec<(i64, usize)> = Vec::new();
    for chunk in chunks(&messages, entity::TUBES) {
        let frames = chunk.iter_component_indices(FRAME.into(), component);
        let counts = chunk.iter_slices::<f32>(component).map(<[f32]>::len);
        in_scene.extend(frames.map(|(t, _)| t.as_i64()).zip(counts));
    }
    in_scene.sort_unstable();
    assert_eq!(in_scene, [(1, 0), (2, 3), (3, 0), (4, 3)]);
}

#[test]
fn at_most_three_places_have_a_label() {
    let apart = (0..8).map(|k| event([f64::from(k), 0.0, 0.0])).collect();
    let messages = logged(&[record(1, Some(0.0), apart)]);
    let labels = points(&messages, entity::LABELS);
    assert_eq!(labels.last().unwrap().1.len(), 3, "{labels:?}");
}
