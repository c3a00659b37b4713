//! Tests of which curves are logged in which frames.

use super::names::{SIM_TIME, entity};
use super::tests::{chunks, collected, record, strips_by_frame};
use super::*;
use crate::curve::{Basis, CurveSet, Positions};
use crate::verdict::{Change, Place, Report};
use re_sdk::log::LogMsg;
use re_sdk_types::archetypes::LineStrips3D;
use std::num::NonZeroU64;
use std::sync::Arc;

const BLOCK: &str = "curves/intact/at_rest/0";

/// Triangles beside one another, at these heights.
fn triangles(seq: u64, heights: &[f32]) -> FrameRecord {
    let triangle = |(k, &z): (usize, &f32)| {
        let x = 3.0 * k as f32;
        [x, 0.0, z, x + 2.0, 0.0, z, x, 2.0, z]
    };
    let xyz: Vec<f32> = heights.iter().enumerate().flat_map(triangle).collect();
    let counts = vec![-3; heights.len()];
    let set = CurveSet::from_counts(Basis::Polyline, &counts, Positions::F32(&xyz)).unwrap();
    FrameRecord {
        curves: Some(Arc::new(set)),
        ..record(seq, None, Vec::new()).with_report(Report::new(seq, seq as f64, Verdict::Intact))
    }
}

impl FrameRecord {
    fn with_report(self, report: Report) -> FrameRecord {
        let report = Arc::new(report);
        FrameRecord { report, ..self }
    }

    /// Curves 0 and 1 came apart.
    fn broken(self) -> FrameRecord {
        let place = Place {
            segments: [0, 0],
            point: [4.0, 0.0, 0.0],
            distance: 0.0,
        };
        let change = Change {
            i: 0,
            j: 1,
            image: Default::default(),
            expected: 1,
            found: 0,
            place: Some(place),
        };
        let report = Report {
            changes: vec![change],
            verdict: Verdict::Changed,
            ..Report::clone(&self.report)
        };
        self.with_report(report)
    }

    fn at_time(self, time: f64) -> FrameRecord {
        let report = Report {
            time,
            ..Report::clone(&self.report)
        };
        self.with_report(report)
    }
}

fn all(frames: impl IntoIterator<Item = FrameRecord>) -> Vec<LogMsg> {
    collected(|sink| sink, frames)
}

#[test]
fn curves_at_rest_are_logged_once() {
    let messages = all((1..=5).map(|seq| triangles(seq, &[0.0; 3])));
    assert_eq!(strips_by_frame(&messages, BLOCK), [(1, 3)]);
    assert_eq!(strips_by_frame(&messages, entity::MOVING), []);
}

#[test]
fn a_curve_that_moves_is_logged_without_the_others() {
    let frames = [0.0, 0.0, 1.0, 2.0, 2.0, 3.0];
    let messages = all((1..)
        .zip(frames)
        .map(|(seq, z)| triangles(seq, &[0.0, z, 0.0])));
    assert_eq!(strips_by_frame(&messages, BLOCK), [(1, 3), (3, 2)]);
    let moving = [(3, 1), (4, 1), (6, 1)];
    assert_eq!(strips_by_frame(&messages, entity::MOVING), moving);
}

#[test]
fn a_curve_that_has_stopped_returns_to_its_block() {
    let height = |seq| if seq == 1 { 0.0 } else { 1.0 };
    let messages = all((1..=90).map(|seq| triangles(seq, &[height(seq), 0.0])));
    assert_eq!(strips_by_frame(&messages, BLOCK), [(1, 2), (2, 1), (60, 2)]);
    assert_eq!(
        strips_by_frame(&messages, entity::MOVING),
        [(2, 1), (60, 0)]
    );
}

#[test]
fn the_curves_of_a_finding_leave_their_group_and_the_others_are_dimmed() {
    let frame = |seq| triangles(seq, &[0.0; 3]);
    let messages = all([frame(1), frame(2).broken(), frame(3).broken(), frame(4)]);
    assert_eq!(strips_by_frame(&messages, entity::BROKEN), [(2, 2), (4, 0)]);
    assert_eq!(strips_by_frame(&messages, BLOCK), [(1, 3), (2, 1), (4, 3)]);
    let component = LineStrips3D::descriptor_colors().component;
    let colors = chunks(&messages, BLOCK).flat_map(|chunk| {
        let rows = chunk.iter_slices::<u32>(component);
        rows.map(|row| row[0]).collect::<Vec<_>>()
    });
    let mut colors: Vec<u32> = colors.collect();
    colors.sort_unstable();
    assert_eq!(colors, [style::DIMMED, style::QUIET, style::QUIET]);
}

#[test]
fn other_curves_replace_all_groups() {
    let frames = [triangles(1, &[0.0; 3]), triangles(2, &[0.0, 0.0, 1.0])];
    let mut fewer = triangles(3, &[0.0; 2]);
    fewer.info.layout = 1;
    let messages = all(frames.into_iter().chain([fewer]));
    assert_eq!(strips_by_frame(&messages, BLOCK), [(1, 3), (2, 2), (3, 2)]);
    assert_eq!(strips_by_frame(&messages, entity::MOVING), [(2, 1), (3, 0)]);
}

#[test]
fn large_scenes_have_a_limited_number_of_blocks() {
    for (curves, blocks) in [(10, 1), (10_000, 4), (400_000, 64)] {
        let messages = all([triangles(1, &vec![0.0; curves])]);
        let number = |k: &usize| {
            !strips_by_frame(&messages, &format!("curves/intact/at_rest/{k}")).is_empty()
        };
        assert_eq!((0..100).take_while(number).count(), blocks, "{curves}");
    }
}

#[test]
fn the_curves_of_every_third_frame_and_of_every_violation_are_logged() {
    let frame = |seq| triangles(seq, &[seq as f32; 3]);
    let frames = (1..=9).map(|seq| match seq {
        5 => frame(seq).broken(),
        _ => frame(seq),
    });
    let every = NonZeroU64::new(3).unwrap();
    let messages = collected(|sink| sink.with_every(every), frames);
    // The block of the first frame, the violation in frame 5, and its end in frame 6.
    assert_eq!(strips_by_frame(&messages, BLOCK), [(1, 3), (4, 0)]);
    let moving = [(4, 3), (5, 1), (6, 3), (7, 3)];
    assert_eq!(strips_by_frame(&messages, entity::MOVING), moving);
    assert_eq!(strips_by_frame(&messages, entity::BROKEN), [(5, 2), (6, 0)]);
    // The plots have all frames.
    let counts = chunks(&messages, entity::SKIPPED).filter(|c| !c.is_static());
    assert_eq!(counts.map(|c| c.num_rows()).sum::<usize>(), 9);
}

#[test]
fn frames_at_earlier_times_are_on_the_timeline_of_frames_only() {
    let frame = |seq: u64, time| triangles(seq, &[seq as f32, 0.0]).at_time(time);
    let times = [0.0, 1.0, 2.0, 1.0, 2.5, 3.0];
    let messages = all((1..).zip(times).map(|(seq, time)| frame(seq, time)));
    let on_time = |path: &str| {
        let timed = |c: &re_sdk::log::Chunk| c.timelines().contains_key(&SIM_TIME.into());
        let frames = chunks(&messages, path).filter(timed).flat_map(|chunk| {
            let component = LineStrips3D::descriptor_strips().component;
            let frames = chunk.iter_component_indices(FRAME.into(), component);
            frames.map(|(t, _)| t.as_i64()).collect::<Vec<_>>()
        });
        let mut frames: Vec<i64> = frames.collect();
        frames.sort_unstable();
        frames
    };
    assert_eq!(on_time(entity::MOVING), [2, 3, 5, 6]);
    // Frame 5 has all groups, because those of frame 4 are not on the timeline.
    assert_eq!(on_time(BLOCK), [1, 2, 5]);
    let moving = strips_by_frame(&messages, entity::MOVING);
    assert_eq!(moving, [2, 3, 4, 5, 6].map(|seq| (seq, 1)));
}

#[test]
fn a_live_viewer_gets_all_curves_again_from_time_to_time() {
    let messages = all((1..=REPEAT + 5).map(|seq| triangles(seq, &[0.0])));
    let again = REPEAT as i64;
    assert_eq!(strips_by_frame(&messages, BLOCK), [(1, 1), (again, 1)]);
}
