//! Strands near a violation as tubes, because lines have no depth: two rings that came apart would
//! look as if they were linked.
//!
//! The first violation is also shown before, at and after its frame, from the side on which its
//! strands are seen apart.

use super::curves::Numbered;
use super::names::entity;
use super::picture::SHOWN;
use super::stream::{Drawing, log_static};
use super::style::{CYAN, DIMMED, FAINT_RED, FIRST, SECOND, lines, narrow};
use super::view::View;
use crate::curve::vector::{add_scaled, distance, mix};
use crate::curve::{AXES, CurveSet, Point, bounds, is_home};
use crate::error::Result;
use crate::picture::{Part, Radii, Scene, Strand, Window, strands_of};
use crate::sinks::FrameRecord;
use crate::verdict::{Finding, Spot, label_of_pair};
use nalgebra::{UnitQuaternion, Vector3};
use re_sdk_types::archetypes::Capsules3D;
use re_sdk_types::blueprint::archetypes::EyeControls3D;
use re_sdk_types::components::FillMode;
use re_sdk_types::datatypes::Quaternion;
use std::sync::Arc;

/// Radius of the tube of a curve without one, in lengths of its edges, and the largest radius, in
/// sizes of the window around the place.
const RADIUS: f64 = 0.12;
const LARGEST: f64 = 0.045;

/// Distance of the eye from the middle of the strands of the moments, in their radius: all of it
/// is in view.
const EYE: f64 = 2.3;

/// Length of the rays of the star at the place, in radii of the strands.
const STAR: f64 = 0.2;

/// The first violation, until the frame after it is known.
pub(super) struct Moments {
    /// The curves, for a label.
    pair: String,
    spot: Spot,
    before: Option<Numbered>,
    at: Numbered,
}

/// Views of the moments: names, the eye of all, and that of the whole scene beside them.
pub(super) struct MomentViews {
    pub names: [Option<String>; 3],
    pub eye: EyeControls3D,
    pub overview: EyeControls3D,
}

/// Returns the place of a finding, if it is between curves and not their images.
fn spot(finding: Finding<'_>) -> Option<Spot> {
    finding.spot().filter(|spot| is_home(&spot.image))
}

/// Columns of a [`Capsules3D`], one entry per edge of a strand.
#[derive(Default)]
struct Tubes {
    translations: Vec<[f32; 3]>,
    rotations: Vec<Quaternion>,
    lengths: Vec<f32>,
    radii: Vec<f32>,
    colors: Vec<u32>,
}

impl Tubes {
    /// Adds a strand of a window. `place` returns where its points are drawn, at this scale.
    fn add(&mut self, strand: &Strand, radius: f64, scale: f64, place: impl Fn(&Point) -> Point) {
        let edges = strand.points.array_windows::<2>();
        let length = edges.clone().map(|[a, b]| distance(*a, *b)).sum::<f64>();
        let own = RADIUS * length / edges.len().max(1) as f64;
        let radius = if radius > 0.0 { radius } else { own };
        let radius = (scale * radius.min(LARGEST)) as f32;
        for [a, b] in edges {
            let [a, b] = [place(a), place(b)];
            let along = Vector3::from(b) - Vector3::from(a);
            let turned = UnitQuaternion::rotation_between(&Vector3::z(), &along);
            // If the edge points down, the rotation is not unique.
            let turned = turned.unwrap_or_else(|| {
                UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI)
            });
            let [x, y, z, w] = turned.coords.map(|x| x as f32).into();
            self.translations.push(narrow(a));
            self.rotations.push(Quaternion::from_xyzw([x, y, z, w]));
            self.lengths.push(along.norm() as f32);
            self.radii.push(radius);
            self.colors.push(match strand.part {
                Part::Second => SECOND,
                _ => FIRST,
            });
        }
    }

    fn archetype(self) -> Capsules3D {
        Capsules3D::from_lengths_and_radii(self.lengths, self.radii)
            .with_translations(self.translations)
            .with_quaternions(self.rotations)
            .with_colors(self.colors)
            .with_fill_mode(FillMode::Solid)
    }
}

/// Returns the radii of the curves of a frame.
fn radii(record: &FrameRecord) -> Radii<'_> {
    Radii {
        published: &record.info.labels.radii,
        measured: None,
    }
}

/// Logs the strands near the places of a frame.
pub(super) fn draw(drawing: &Drawing<'_>) -> Result<()> {
    let (set, report) = (drawing.set, &drawing.record.report);
    let radii = radii(drawing.record);
    let mut tubes = Tubes::default();
    let mut drawn: Vec<[u32; 2]> = Vec::new();
    for spot in report.first_findings(SHOWN).filter_map(spot).take(SHOWN) {
        // A change and its pull-through are at one place.
        if drawn.contains(&spot.curves) {
            continue;
        }
        let [_, window, _] = Window::around([None, Some((set, spot)), None], 0.0);
        let Some(window) = window else {
            continue;
        };
        drawn.push(spot.curves);
        let own = strands_of(set, spot, window).into_iter();
        for strand in own.filter(|strand| strand.part != Part::Rest) {
            let place = |p: &Point| add_scaled(window.centre, window.reach, *p);
            let radius = radii.of(strand.curve) / window.reach;
            tubes.add(&strand, radius, window.reach, place);
        }
    }
    drawing.log(entity::TUBES, &tubes.archetype())
}

impl Moments {
    /// Returns the moments of the first finding of a frame that has a place.
    pub fn of(drawing: &Drawing<'_>, before: Option<Numbered>) -> Option<Moments> {
        let (set, report) = (drawing.set, &drawing.record.report);
        let placed = |finding| Some((finding, spot(finding)?));
        let (finding, spot) = report.passages_first().find_map(placed)?;
        let (i, j, image) = finding.pair();
        let names = &drawing.record.info.labels.names;
        Some(Moments {
            pair: label_of_pair((i, j.unwrap_or(i)), image, names),
            spot,
            before: before.filter(|(_, before)| before.same_layout(set)),
            at: (report.seq, Arc::clone(set)),
        })
    }

    /// Logs the moments; `after` is the next frame, if there is one. Returns their views, and one
    /// of the whole scene, which is drawn enlarged by `scale`.
    pub fn draw(
        &self,
        drawing: &Drawing<'_>,
        after: Option<Numbered>,
        scale: f64,
    ) -> Result<Option<MomentViews>> {
        let (rec, radii) = (drawing.rec, radii(drawing.record));
        let after = after.filter(|(_, after)| after.same_layout(&self.at.1));
        let frames = [self.before.clone(), Some(self.at.clone()), after];
        let frame = frames.each_ref();
        let placed = frame.map(|frame| Some((&*frame.as_ref()?.1, self.spot)));
        let windows = Window::around(placed, 0.0);
        let scene = |(placed, window): (Option<(&CurveSet, Spot)>, Option<Window>)| {
            let (set, spot) = placed?;
            Some((Scene::of(set, spot, window?), window?))
        };
        let scenes: Vec<_> = placed.into_iter().zip(windows).map(scene).collect();
        let shown = scenes.iter().flatten().flat_map(|(scene, _)| scene.own());
        let shown: Vec<Point> = shown.copied().collect();
        let Some(Some((at, _))) = scenes.get(1).filter(|_| !shown.is_empty()) else {
            return Ok(None);
        };
        let [low, high] = bounds(shown);
        let (middle, radius) = (mix(low, high, 0.5), 0.5 * distance(low, high));
        let view = at.views()[0];
        let eye = EyeControls3D::new()
            .with_position(narrow(add_scaled(middle, EYE * radius, view.towards)))
            .with_look_target(narrow(middle))
            .with_eye_up(narrow(view.up));
        for (scene, path) in scenes.iter().zip(entity::MOMENTS) {
            let Some((scene, window)) = scene else {
                continue;
            };
            let mut tubes = Tubes::default();
            for strand in scene.strands().iter().filter(|strand| strand.is_own()) {
                tubes.add(strand, radii.of(strand.curve) / window.reach, 1.0, |p| *p);
            }
            log_static(rec, &format!("{path}/strands"), &tubes.archetype())?;
            if path == entity::MOMENTS[1] {
                let reach = STAR * radius;
                let rays = AXES.map(|axis| [-reach, reach].map(|t| axis.map(|x| (t * x) as f32)));
                let star = lines(rays, 2.5).with_colors([CYAN]);
                log_static(rec, &format!("{path}/place"), &star)?;
            }
            let others = scene.strands().iter().filter(|strand| !strand.is_own());
            let (rest, others): (Vec<&Strand>, Vec<_>) =
                others.partition(|strand| strand.part == Part::Rest);
            for (name, group, color) in [("rest", rest, FAINT_RED), ("others", others, DIMMED)] {
                let points = group.iter().map(|s| s.points.iter().map(|p| narrow(*p)));
                let strips = lines(points.map(|points| points.collect::<Vec<_>>()), 0.8);
                log_static(rec, &format!("{path}/{name}"), &strips.with_colors([color]))?;
            }
        }
        let name = |k: usize, words: &str| {
            let (seq, _) = frames[k].as_ref()?;
            Some(format!("{words}: frame {seq}"))
        };
        let at = format!("{}, at", self.pair);
        let names = [name(0, "before"), name(1, &at), name(2, "after")];
        let overview = View::of(&self.at.1).map_or_else(|| eye.clone(), |v| v.eye(None, scale));
        Ok(Some(MomentViews {
            names,
            eye,
            overview,
        }))
    }
}
