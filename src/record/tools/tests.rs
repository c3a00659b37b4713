use super::*;
use crate::curve::{Basis, CurveLabels, CurveSet, Positions};
use crate::formats::container::foxglove::{LineType, PointCloud, SceneUpdate};
use crate::ingest::FrameInfo;
use crate::sinks::FrameRecord;
use crate::verdict::{Change, Place, PullThrough, Verdict};
use std::sync::Arc;

/// Rings of `points` points each, one above the other; those in `open` are open.
fn rings(basis: Basis, count: usize, points: usize, open: &[usize]) -> CurveSet {
    let at = |i: usize, k: usize| {
        let angle = std::f64::consts::TAU * k as f64 / points as f64;
        [angle.cos(), angle.sin(), i as f64]
    };
    let xyz = (0..count).flat_map(|i| (0..points).flat_map(move |k| at(i, k)));
    let counts = (0..count).map(|i| match open.contains(&i) {
        true => points as i32,
        false => -(points as i32),
    });
    let counts: Vec<i32> = counts.collect();
    let xyz: Vec<f64> = xyz.collect();
    CurveSet::from_counts(basis, &counts, Positions::F64(&xyz)).unwrap()
}

/// Curves 0 and 2 came apart, and 2 was pulled through itself.
fn broken(seq: u64) -> Report {
    Report {
        changes: vec![Change {
            i: 0,
            j: 2,
            image: Default::default(),
            expected: -1,
            found: 0,
            place: Some(Place {
                segments: [0, 1],
                point: [1.0, 2.0, 3.0],
                distance: 0.5,
            }),
        }],
        events: vec![PullThrough {
            i: 2,
            j: 2,
            image: Default::default(),
            segments: [0, 2],
            fraction: 0.5,
            sign: 1,
            point: [0.0, 1.0, 2.0],
            lengths: 0.1,
        }],
        ..Report::new(seq, 0.5, Verdict::Changed)
    }
}

fn update(scene: &mut Scene, set: &CurveSet, report: Report, names: &[&str]) -> SceneUpdate {
    let record = FrameRecord {
        curves: None,
        info: FrameInfo {
            labels: Arc::new(CurveLabels::named(names.iter().copied())),
            ..FrameInfo::default()
        },
        report: Arc::new(report),
        progress: Default::default(),
    };
    scene.update(set, &record)
}

fn ids(update: &SceneUpdate) -> Vec<&str> {
    update.entities.iter().map(|e| e.id.as_str()).collect()
}

#[test]
fn an_intact_frame_has_all_curves_in_one_list_of_lines() {
    let set = rings(Basis::Polyline, 3, 5, &[1]);
    let report = Report::new(7, 1.5, Verdict::Intact);
    let update = update(&mut Scene::default(), &set, report, &[]);
    assert_eq!(ids(&update), ["curves"]);
    let entity = &update.entities[0];
    let time = entity.timestamp.unwrap();
    assert_eq!((time.seconds, time.nanos), (1, 500_000_000));
    let [line] = &entity.lines[..] else {
        panic!("{:?}", entity.lines);
    };
    assert_eq!(line.r#type, LineType::List as i32);
    assert!(line.scale_invariant);
    assert_eq!(line.points.len(), 15);
    // Closed, open, closed.
    assert_eq!(line.indices.len(), 2 * (5 + 4 + 5));
    assert_eq!(line.indices[..10], [0, 1, 1, 2, 2, 3, 3, 4, 4, 0]);
    assert_eq!(line.indices[10..18], [5, 6, 6, 7, 7, 8, 8, 9]);
}

#[test]
fn curves_with_findings_are_entities_that_later_frames_delete() {
    let set = rings(Basis::Polyline, 3, 5, &[2]);
    let mut scene = Scene::default();
    let intact = |seq| Report::new(seq, 0.0, Verdict::Intact);
    update(&mut scene, &set, intact(0), &["a", "b", "c"]);
    let broken = update(&mut scene, &set, broken(1), &["a", "b", "c"]);
    assert_eq!(ids(&broken), ["curves", "curve a", "curve c", "findings"]);
    assert!(broken.deletions.is_empty());
    let kind = |k: usize| broken.entities[k].lines[0].r#type;
    assert_eq!(kind(1), LineType::Loop as i32);
    assert_eq!(kind(2), LineType::Strip as i32);
    assert_eq!(broken.entities[2].lines[0].points.len(), 5);
    let findings = &broken.entities[3];
    let texts: Vec<&str> = findings.texts.iter().map(|t| t.text.as_str()).collect();
    assert_eq!(
        texts,
        [
            "0 (a) & 2 (c): linking number was -1, is 0",
            "2 (c) through itself, +1"
        ]
    );
    // Three rays.
    assert_eq!(findings.lines[0].points.len(), 6);
    let later = update(&mut scene, &set, intact(2), &["a", "b", "c"]);
    assert_eq!(ids(&later), ["curves"]);
    let deleted: Vec<&str> = later.deletions.iter().map(|d| d.id.as_str()).collect();
    assert_eq!(deleted, ["curve a", "curve c", "findings"]);
}

#[test]
fn splines_are_sampled() {
    for (basis, points) in [(Basis::CatmullRom, 6), (Basis::Bezier, 6)] {
        let set = rings(basis, 2, points, &[]);
        let report = Report::new(7, 0.5, Verdict::Intact);
        let update = update(&mut Scene::default(), &set, report, &[]);
        let line = &update.entities[0].lines[0];
        assert_eq!(line.points.len(), 6 * set.segments());
        for (k, p) in line.points[..6].iter().enumerate() {
            assert_eq!([p.x, p.y, p.z], set.eval(0, 0, k as f64 / 6.0));
        }
    }
}

/// Thousands of short curves, and one long one.
#[test]
fn the_number_of_points_is_bounded_and_curves_with_findings_are_in_full() {
    for (count, points) in [(30_000, 5), (4, 50_000), (1000, 200)] {
        let set = rings(Basis::Polyline, count, points, &[]);
        let mut scene = Scene::default();
        let update = update(&mut scene, &set, broken(1), &[]);
        let line = &update.entities[0].lines[0];
        assert!(line.points.len() <= 60_000, "{}", line.points.len());
        assert!(line.points.len() >= 10_000, "{}", line.points.len());
        assert!(
            line.indices
                .iter()
                .all(|&k| (k as usize) < line.points.len())
        );
        assert_eq!(update.entities[1].lines[0].points.len(), points);
        // Points of a thinned polyline are its vertices.
        let is_vertex = |k: usize| {
            let p = [line.points[k].x, line.points[k].y];
            (0..points).any(|v| set.point(1, v)[..2] == p)
        };
        assert!((0..3).all(is_vertex));
    }
}

fn cloud(set: &CurveSet, report: &Report) -> PointCloud {
    let mut points = Points::default();
    let first = points.message(set, report);
    points.reuse(first.clone());
    let again = points.message(set, report);
    assert_eq!(first, again, "the buffer is cleared");
    again
}

#[test]
fn a_cloud_has_coordinates_and_colours() {
    let set = rings(Basis::Polyline, 3, 5, &[]);
    let cloud = cloud(&set, &broken(1));
    let (points, rest) = cloud.data.as_chunks::<16>();
    assert!(rest.is_empty());
    assert_eq!(cloud.point_stride, 16);
    // 16 points per edge.
    assert_eq!(points.len(), 16 * set.segments());
    let at = |k: usize| {
        let [x, y, z, color]: [[u8; 4]; 4] = points[k].as_chunks().0.try_into().unwrap();
        ([x, y, z].map(f32::from_le_bytes), color)
    };
    assert_eq!(at(0), ([1.0, 0.0, 0.0], State::Broken.color()));
    assert_eq!(at(80), ([1.0, 0.0, 1.0], State::Intact.color()));
    assert_eq!(at(160), ([1.0, 0.0, 2.0], State::Broken.color()));
    let names: Vec<&str> = cloud.fields.iter().map(|f| f.name.as_str()).collect();
    assert_eq!(names, ["x", "y", "z", "red", "green", "blue", "alpha"]);
}

#[test]
fn a_cloud_of_a_large_scene_is_bounded() {
    let report = Report::new(7, 0.5, Verdict::Intact);
    // All vertices up to the limit.
    let set = rings(Basis::Polyline, 1000, 200, &[]);
    assert_eq!(cloud(&set, &report).data.len(), 16 * 200_000);
    let set = rings(Basis::Polyline, 200_000, 5, &[]);
    let points = cloud(&set, &report).data.len() / 16;
    assert!((100_000..=500_000).contains(&points), "{points}");
}

#[test]
fn any_time_has_a_timestamp() {
    for (time, expected) in [
        (0.0, (0, 0)),
        (2.25, (2, 250_000_000)),
        (-0.25, (-1, 750_000_000)),
        (f64::NAN, (0, 0)),
        (f64::INFINITY, (i64::MAX, 0)),
    ] {
        let time = time_of(&Report::new(0, time, Verdict::Intact));
        assert_eq!((time.seconds, time.nanos), expected);
    }
}
