//! Layout of the viewer's views, and the status in words.

use super::passed::{Passed, name};
use super::{Findings, entity};
use crate::curve::{CurveSet, Point};
use crate::verdict::{Defect, Report, Verdict};
use rerun::blueprint::components::{BackgroundKind, PanelState, PlayState};
use rerun::blueprint::datatypes::{TextLogColumn, TextLogColumnKind, TimelineColumn};
use rerun::blueprint::{
    Blueprint, BlueprintActivation, BlueprintPanel, ContainerLike, Horizontal, SelectionPanel,
    Spatial3DView, Tabs, TextDocumentView, TextLogView, TimePanel, TimeSeriesView, Vertical,
};
use rerun::external::re_sdk_types::blueprint::archetypes::{
    Background, EyeControls3D, LineGrid3D, PlotLegend, TextLogColumns,
};
use rerun::log::LogMsg;
use rerun::{
    AsComponents, Color, EntityPath, RecordingStream, RecordingStreamBuilder, RecordingStreamResult,
};

/// Timelines: the number of the frame, and the simulation time.
pub(super) const FRAME: &str = "frame";
pub(super) const SIM_TIME: &str = "sim_time";

/// Timeline of the frames up to the first violation, in files. A layout cannot place the time
/// cursor, but a viewer that follows a timeline opens at its end.
pub(super) const UNTIL: &str = "until_violation";

/// Legend in words, because legends in the plots would cover a third of them.
pub(super) const KEY: &str = "\
**Curves** red: changed; orange: no verdict

**Marks** blue star: pull-through in this frame; blue dot: an earlier one; pale dots: where two \
curves are closest

**Links** red: lost; violet: gained; orange: changed; blue: pull-throughs

**Check** red: full; orange: partial; green: quiet
";

/// Dark and uniform, so that muted curves are visible and red ones stand out.
const BACKGROUND: u32 = 0x0f1318ff;

/// Distance of the eye from the centre of the scene, in radii of the scene.
const EYE_DISTANCE: f64 = 2.0;

/// Distance of the eye from a violation, in sizes of the feature there (see
/// [`super::local::feature`]). A ring fills a third of the height.
const EYE_DISTANCE_NEAR: f64 = 4.0;

/// Mean length of a segment from which on curves are drawn at their size, and number of segments of
/// that mean.
const SMALL: f64 = 0.05;
const SAMPLED: usize = 100_000;

/// Maximum number of digits by which curves are enlarged: single precision has 38.
const MOST_DIGITS: f64 = 36.0;

/// Directions of view, by the axis along which the scene is thinnest: cloth is seen from the front,
/// a little from the side, with z upwards.
const LOOK_FROM: [Point; 3] = [[1.0, -0.3, 0.4], [-0.3, -1.0, 0.4], [-0.25, -0.65, 1.0]];

/// Sends the layout. It opens at the end of `timeline`. Without an eye, the viewer follows the
/// scene.
pub(super) fn send(
    rec: &RecordingStream,
    timeline: &str,
    eye: Option<&EyeControls3D>,
) -> RecordingStreamResult<()> {
    let scene = Spatial3DView::new("curves").with_contents(["/curves/**"]);
    let status = TextDocumentView::new("status").with_origin(entity::STATUS);
    let key = TextDocumentView::new("colours").with_origin(entity::KEY);
    let log = TextLogView::new("log").with_origin(entity::LOG);
    let links = TimeSeriesView::new("links and pull-throughs").with_contents(["/links/**"]);
    let check = TimeSeriesView::new("check, ms").with_contents(["/check/**"]);
    let marked = TimeSeriesView::new("blocks marked, %").with_contents(["/marked/**"]);
    let recomputed = TimeSeriesView::new("pairs recomputed").with_contents(["/recomputed/**"]);
    let skipped = TimeSeriesView::new("skipped").with_contents(["/skipped/**"]);
    let (scene, log) = (ContainerLike::from(scene), ContainerLike::from(log));
    let mut properties: Vec<(EntityPath, Box<dyn AsComponents>)> = Vec::new();
    if let ContainerLike::View(view) = &scene {
        let mut property = |name: &str, what| {
            properties.push((format!("{}/{name}", view.blueprint_path()).into(), what));
        };
        let background =
            Background::new(BackgroundKind::SolidColor).with_color(Color::from_u32(BACKGROUND));
        property("Background", Box::new(background));
        property(
            "LineGrid3D",
            Box::new(LineGrid3D::new().with_visible(false)),
        );
        if let Some(eye) = eye {
            property("EyeControls3D", Box::new(eye.clone()));
        }
    }
    if let ContainerLike::View(view) = &log {
        // All lines come from one entity, so a column for its name is not needed.
        let columns =
            [TextLogColumnKind::LogLevel, TextLogColumnKind::Body].map(|kind| TextLogColumn {
                visible: true.into(),
                kind,
            });
        // The frame on every timeline, so that a click jumps to it.
        let frame = TimelineColumn {
            visible: true.into(),
            timeline: FRAME.into(),
        };
        let columns = TextLogColumns::new()
            .with_timeline_columns([frame])
            .with_text_log_columns(columns);
        let path = format!("{}/TextLogColumns", view.blueprint_path());
        properties.push((path.into(), Box::new(columns)));
    }
    let plots = [links, check, marked, recomputed, skipped].map(ContainerLike::from);
    for plot in &plots {
        if let ContainerLike::View(view) = plot {
            let legend = PlotLegend::new().with_visible(false);
            let path = format!("{}/PlotLegend", view.blueprint_path());
            properties.push((path.into(), Box::new(legend)));
        }
    }
    let [links, check, marked, recomputed, skipped] = plots;
    let words = Vertical::new([status.into(), key.into()]).with_row_shares([2.4, 1.0]);
    let top = Horizontal::new([scene, words.into()]).with_column_shares([4.0, 1.1]);
    // Work counters, one above the other, because counts of frames and pairs share no axis.
    let work = Vertical::new([marked, recomputed]).with_name("work");
    let costs = Tabs::new([check, work.into(), skipped]);
    let bottom = Horizontal::new([log, links, costs.into()]);
    let bottom = bottom.with_column_shares([2.6, 1.25, 1.25]);
    let root = Vertical::new([top.into(), bottom.into()]).with_row_shares([2.6, 1.0]);
    let time = TimePanel::new()
        .with_state(PanelState::Collapsed)
        .with_timeline(timeline)
        .with_play_state(PlayState::Following);
    let blueprint = Blueprint::new(root)
        .with_auto_views(false)
        .with_auto_layout(false)
        .with_blueprint_panel(BlueprintPanel::from_state(PanelState::Collapsed))
        .with_selection_panel(SelectionPanel::from_state(PanelState::Collapsed))
        .with_time_panel(time);
    send_with(rec, &blueprint, &properties)
}

/// Sends a blueprint together with properties of its views for which the blueprint API of rerun
/// 0.36 has no methods. They are logged into the store of the same blueprint before its activation.
fn send_with(
    rec: &RecordingStream,
    blueprint: &Blueprint,
    properties: &[(EntityPath, Box<dyn AsComponents>)],
) -> RecordingStreamResult<()> {
    let builder = RecordingStreamBuilder::new(super::APPLICATION).send_properties(false);
    let (staging, staged) = builder.memory()?;
    blueprint.send(&staging, BlueprintActivation::default())?;
    let mut activation = None;
    for message in staged.take() {
        match message {
            LogMsg::BlueprintActivationCommand(command) => activation = Some(command),
            message if message.store_id().is_blueprint() => rec.record_msg(message),
            _ => {}
        }
    }
    let Some(activation) = activation else {
        return Ok(());
    };
    let builder = RecordingStreamBuilder::from_store_id(&activation.blueprint_id);
    let (extra, logged) = builder.send_properties(false).memory()?;
    extra.set_time_sequence("blueprint", 0);
    for (path, what) in properties {
        extra.log(path.clone(), what.as_ref())?;
    }
    for message in logged.take() {
        if matches!(message, LogMsg::ArrowMsg(..)) {
            rec.record_msg(message);
        }
    }
    rec.record_msg(activation.into());
    Ok(())
}

/// Bounding box of all control points, and the direction of view.
pub(super) struct Scene {
    center: Point,
    /// Half the diagonal.
    pub radius: f64,
    /// Unit vector from the scene to the eye.
    from: Point,
}

impl Scene {
    /// Returns `None` if the scene has no extent.
    pub fn of(set: &CurveSet) -> Option<Scene> {
        let (mut lo, mut hi) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for (i, curve) in set.curves().iter().enumerate() {
            for k in 0..curve.points as usize {
                let p = set.point(i, k);
                for x in 0..3 {
                    (lo[x], hi[x]) = (lo[x].min(p[x]), hi[x].max(p[x]));
                }
            }
        }
        let size = [0, 1, 2].map(|x| hi[x] - lo[x]);
        let radius = 0.5 * size[0].hypot(size[1]).hypot(size[2]);
        let thinnest = (0..3).min_by(|&a, &b| size[a].total_cmp(&size[b]))?;
        (radius > 0.0 && radius.is_finite()).then(|| Scene {
            center: [0, 1, 2].map(|x| 0.5 * (lo[x] + hi[x])),
            radius,
            from: unit(LOOK_FROM[thinnest]),
        })
    }

    /// Returns the unit vector that points down on the screen.
    pub fn down(&self) -> Point {
        let [x, y, z] = self.from;
        unit([z * x, z * y, z * z - 1.0])
    }

    /// Returns an eye that sees all curves, or those around a place if one is given. Viewers draw
    /// curves enlarged by `scale`.
    pub fn eye(&self, place: Option<(Point, f64)>, scale: f64) -> EyeControls3D {
        let far = EYE_DISTANCE * self.radius;
        let (target, away) = match place {
            Some((point, size)) if size > 0.0 => (point, (EYE_DISTANCE_NEAR * size).min(far)),
            Some((point, _)) => (point, far),
            None => (self.center, far),
        };
        let position = [0, 1, 2].map(|x| (scale * (target[x] + away * self.from[x])) as f32);
        EyeControls3D::new()
            .with_position(position)
            .with_look_target(target.map(|x| (scale * x) as f32))
            .with_eye_up([0.0, 0.0, 1.0])
    }
}

fn unit(v: Point) -> Point {
    let length = v[0].hypot(v[1]).hypot(v[2]);
    v.map(|x| x / length)
}

/// Returns the factor by which curves are enlarged: a power of ten, 1 for most scenes.
///
/// The viewer draws nothing closer to the eye than 0.01, and the eye comes no closer to its target
/// than 0.02, for scenes of any size.
pub(super) fn scale(set: &CurveSet) -> f64 {
    let segments = set.curves().iter().enumerate().flat_map(|(i, curve)| {
        let knots = (0..=curve.segments as usize).map(move |s| set.knot(i, s));
        let next = knots.clone().skip(1);
        knots.zip(next)
    });
    let length = |(p, q): (Point, Point)| (q[0] - p[0]).hypot(q[1] - p[1]).hypot(q[2] - p[2]);
    let (count, sum) = segments.take(SAMPLED).fold((0, 0.0), |(count, sum), ends| {
        (count + 1, sum + length(ends))
    });
    let mean = sum / f64::from(count.max(1));
    if mean > 0.0 && mean < SMALL {
        10.0_f64.powi((SMALL / mean).log10().ceil().min(MOST_DIGITS) as i32)
    } else {
        1.0
    }
}

/// Identity of a finding that lasts over several frames: the curves, and the number found or the
/// kind of the defect.
pub(super) type Key = (u32, Option<u32>, i64);

/// Returns the key of each finding, in the order of [`Report::findings`]. Events have the key
/// `None`, because they do not last: each one is new.
pub(super) fn keys(report: &Report) -> impl Iterator<Item = Option<Key>> + '_ {
    let changes = report.changes.iter().map(|c| (c.i, Some(c.j), c.found));
    let events = report.events.iter().map(|_| None);
    // Larger than every linking number of a frame.
    let kind = |d: &Defect| i64::MAX - d.kind as i64;
    let defects = report.defects.iter().map(move |d| (d.i, d.j, kind(d)));
    let unresolved = report.unresolved.iter().map(|_| None);
    let lasting = defects.map(Some);
    changes
        .map(Some)
        .chain(events)
        .chain(lasting)
        .chain(unresolved)
}

/// Returns the status as markdown: the verdict, its first frame, the pairs, and the pull-throughs
/// in this frame and so far.
pub(super) fn status(
    report: &Report,
    since: u64,
    seen: &Findings,
    passed: &Passed,
    shown: usize,
) -> String {
    // If the linking numbers are as expected, the status concerns this frame only.
    let only_events = !report.events.is_empty() && report.changes.is_empty();
    let title = match report.verdict {
        Verdict::Intact => "Intact",
        Verdict::Changed if only_events => "PULLED THROUGH",
        Verdict::Changed => "TOPOLOGY CHANGED",
        Verdict::Contact => "Contact",
        Verdict::Undecided => "Undecided",
        Verdict::Stale => "Not verified in time",
        Verdict::Rejected => "Frame rejected",
    };
    let when = match report.verdict {
        Verdict::Changed if only_events => format!("in frame {}", report.seq),
        _ => format!("since frame {since}"),
    };
    let s = &report.stats;
    let detail = report.rejected.clone().unwrap_or_else(|| {
        match s.potential_links {
            // Not counted if the frame was compared with a reference frame.
            0 => format!("{} curves", s.curves),
            pairs => format!("{} curves, {pairs} pairs that could be linked", s.curves),
        }
    });
    let mut text = format!("# {title}\n## {when}\n\n{detail}\n");
    if only_events && report.defects.is_empty() {
        text.push_str("\nEvery linking number is the expected one.\n");
    }
    if !(report.changes.is_empty() && report.defects.is_empty()) {
        text.push_str("\n| curves | linking number | since |\n|---|---|---|\n");
    }
    let changes = report.changes.iter().map(|c| {
        let words = format!("was {}, is {}", c.expected, c.found);
        (c.i, Some(c.j), words)
    });
    let defects = report.defects.iter().map(|d| {
        let words = d.kind.words().to_owned();
        (d.i, d.j, words)
    });
    let rows = changes.chain(defects).zip(keys(report).flatten());
    let frame = |key| seen.get(&key).copied().unwrap_or(since);
    let mut rows: Vec<_> = rows.map(|(row, key)| (frame(key), row)).collect();
    rows.sort_by_key(|(frame, _)| *frame);
    for (frame, (i, j, words)) in rows.into_iter().take(shown) {
        let curves = j.map_or(format!("{i}"), |j| format!("{i} & {j}"));
        text.push_str(&format!("| **{curves}** | {words} | {frame} |\n"));
    }
    let more = |count: usize| {
        let more = count.saturating_sub(shown);
        (more > 0).then(|| format!("\nand {more} more\n"))
    };
    text.extend(more(report.changes.len() + report.defects.len()));
    if !report.events.is_empty() {
        text.push_str("\n| pulled in this frame | sign | moment |\n|---|---|---|\n");
    }
    for e in report.events.iter().take(shown) {
        let row = format!("| **{}** | {:+} | {:.3} |\n", name(e), e.sign, e.fraction);
        text.push_str(&row);
    }
    text.extend(more(report.events.len()));
    match report.unresolved.len() {
        0 => {}
        1 => text.push_str("\n1 unresolved pull-through: the frames are too far apart.\n"),
        n => text.push_str(&format!(
            "\n{n} unresolved pull-throughs: the frames are too far apart.\n"
        )),
    }
    text.extend(passed.words().map(|words| format!("\n{words}\n")));
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::certificate::Change;
    use crate::curve::{Basis, Positions};
    use crate::verdict::PullThrough;
    use crate::verdict::{DefectKind, Place};
    use rerun::Loggable;

    fn report(changes: u32) -> Report {
        let change = |k| Change {
            i: k,
            j: k + 100,
            expected: 1,
            found: 0,
            place: None,
        };
        Report {
            seq: 9,
            time: 0.0,
            verdict: Verdict::Changed,
            abort: true,
            changes: (0..changes).map(change).collect(),
            events: Vec::new(),
            unresolved: Vec::new(),
            adopted: Vec::new(),
            defects: Vec::new(),
            rejected: None,
            stats: Default::default(),
        }
    }

    #[test]
    fn the_status_names_the_broken_pairs_and_the_first_frame() {
        let report = report(5);
        let seen = keys(&report).flatten().zip(3..).collect();
        let text = status(&report, 2, &seen, &Passed::default(), 4);
        assert!(
            text.starts_with("# TOPOLOGY CHANGED\n## since frame 2\n"),
            "{text}"
        );
        assert!(text.contains("| **1 & 101** | was 1, is 0 | 4 |"), "{text}");
        assert!(text.ends_with("\nand 1 more\n"), "{text}");
    }

    #[test]
    fn the_table_is_sorted_by_the_frame_of_the_break() {
        let report = report(3);
        let seen = keys(&report).flatten().zip([30, 10, 20]).collect();
        let text = status(&report, 2, &seen, &Passed::default(), 2);
        let rows: Vec<&str> = text.lines().filter(|l| l.starts_with("| **")).collect();
        assert_eq!(
            rows,
            [
                "| **1 & 101** | was 1, is 0 | 10 |",
                "| **2 & 102** | was 1, is 0 | 20 |"
            ]
        );
        let header = "| curves | linking number | since |";
        assert!(text.contains(header), "{text}");
    }

    #[test]
    fn small_scenes_are_drawn_larger() {
        for (unit, expected) in [(1e-9, 1e8), (0.01, 10.0), (0.1, 1.0), (1e6, 1.0)] {
            let points = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].map(|x| x * unit);
            let set = CurveSet::from_counts(Basis::Polyline, &[-3], Positions::F64(&points));
            assert_eq!(scale(&set.unwrap()), expected, "{unit}");
        }
    }

    #[test]
    fn the_eye_is_near_a_violation_or_sees_all_curves() {
        let points = [0.0, 0.0, 0.0, 200.0, 0.0, 0.0, 0.0, 200.0, 40.0];
        let set = CurveSet::from_counts(Basis::Polyline, &[-3], Positions::F64(&points)).unwrap();
        let scene = Scene::of(&set).unwrap();
        let down = scene.down();
        let across: f64 = (0..3).map(|x| down[x] * scene.from[x]).sum();
        assert!(across.abs() < 1e-12 && down[2] < 0.0, "{down:?}");
        let position = |place, scale| {
            let eye = scene.eye(place, scale);
            let batch = eye.position.unwrap().array;
            let points = rerun::components::Position3D::from_arrow(&batch).unwrap();
            [points[0].x(), points[0].y(), points[0].z()].map(f64::from)
        };
        let distance = |p: Point, q: Point| (0..3).map(|x| (p[x] - q[x]).powi(2)).sum::<f64>();
        let near = distance(position(Some(([9.0; 3], 2.0)), 1.0), [9.0; 3]).sqrt();
        assert!((near - 8.0).abs() < 1e-5, "{near}");
        let far = distance(position(None, 10.0), scene.center.map(|x| 10.0 * x)).sqrt();
        assert!((far / scene.radius - 20.0).abs() < 1e-5, "{far}");
    }

    fn event(i: u32, j: u32) -> PullThrough {
        PullThrough {
            i,
            j,
            segments: [3, 4],
            fraction: 0.25,
            sign: -1,
            point: [0.0; 3],
            lengths: 0.5,
        }
    }

    #[test]
    fn every_finding_has_its_key() {
        let mut report = report(2);
        report.events = vec![event(0, 1), event(7, 7)];
        report.unresolved = vec![event(0, 2)];
        let place = Place {
            segments: [0, 0],
            point: [0.0; 3],
            distance: 0.0,
        };
        report.defects.push(Defect {
            i: 5,
            j: None,
            kind: DefectKind::Degenerate,
            place,
        });
        assert_eq!(keys(&report).count(), report.findings().count());
        for (key, sentence) in keys(&report).zip(report.findings()) {
            assert_eq!(key.is_none(), sentence.contains("through"), "{sentence}");
            if let Some((i, ..)) = key {
                assert!(sentence.contains(&format!(" {i} ")), "{sentence}");
            }
        }
    }

    #[test]
    fn the_status_of_an_event_alone_reports_the_expected_numbers() {
        let mut report = report(0);
        report.events = vec![event(18, 19), event(7, 7)];
        let mut passed = Passed::default();
        passed.add(&report, None);
        let text = status(&report, 2, &Findings::new(), &passed, 4);
        assert!(
            text.starts_with("# PULLED THROUGH\n## in frame 9\n"),
            "{text}"
        );
        assert!(
            text.contains("\nEvery linking number is the expected one.\n"),
            "{text}"
        );
        assert!(
            text.contains("| **18 through 19** | -1 | 0.250 |"),
            "{text}"
        );
        assert!(text.contains("| **7 through itself** |"), "{text}");
        let so_far = "\n2 pull-throughs so far, the last in frame 9\n";
        assert!(text.ends_with(so_far), "{text}");
        // In later frames the status is intact.
        (report.verdict, report.events) = (Verdict::Intact, Vec::new());
        let text = status(&report, 10, &Findings::new(), &passed, 4);
        assert!(text.starts_with("# Intact\n"), "{text}");
        assert!(text.ends_with(so_far), "{text}");
    }

    #[test]
    fn a_scene_without_extent_has_no_eye() {
        let point = [1.0_f32; 9];
        let set = CurveSet::from_counts(Basis::Polyline, &[-3], Positions::F32(&point)).unwrap();
        assert!(Scene::of(&set).is_none());
        assert_eq!(scale(&set), 1.0);
        let empty = CurveSet::from_counts(Basis::Polyline, &[], Positions::F32(&[])).unwrap();
        assert!(Scene::of(&empty).is_none());
        assert_eq!(scale(&empty), 1.0);
    }
}
