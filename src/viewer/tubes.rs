//! Strands near a violation as tubes, because lines have no depth: two rings that came apart would
//! look as if they were linked.
//!
//! The first violation is also shown before, at and after its frame, from the side on which its
//! strands are seen apart.

use super::names::entity;
use super::picture::SHOWN;
use super::stream::{log, log_static};
use super::style::{DIMMED, FIRST, SECOND, lines, narrow};
use crate::curve::vector::{add_scaled, distance};
use crate::curve::{CurveSet, Point, is_home};
use crate::error::Result;
use crate::picture::{Part, Radii, Scene, Spot, Strand, Window, strands_of};
use crate::verdict::{Finding, Report};
use nalgebra::{UnitQuaternion, Vector3};
use re_sdk::RecordingStream;
use re_sdk_types::archetypes::Capsules3D;
use re_sdk_types::blueprint::archetypes::EyeControls3D;
use re_sdk_types::components::FillMode;
use re_sdk_types::datatypes::Quaternion;
use std::sync::Arc;

/// Radius of the tube of a curve without one, in lengths of its edges, and the largest radius, in
/// sizes of the window around the place.
const RADIUS: f64 = 0.12;
const LARGEST: f64 = 0.045;

/// Distance of the eye from a moment, in sizes of its window.
const EYE: f64 = 2.6;

/// A frame, and its number.
type Numbered = (u64, Arc<CurveSet>);

/// The first violation, until the frame after it is known.
pub(super) struct Moments {
    spot: Spot,
    before: Option<Numbered>,
    at: Numbered,
}

/// Views of the moments: names, and the eye.
pub(super) struct MomentViews {
    pub names: [Option<String>; 3],
    pub eye: EyeControls3D,
}

/// Returns the place of a finding, if it is between curves and not their images.
fn spot(finding: Finding<'_>) -> Option<Spot> {
    let (segments, point) = finding.place()?;
    let (.., image) = finding.pair();
    is_home(&image).then(|| Spot {
        curves: finding.curves(),
        image,
        segments,
        point,
    })
}

/// Tubes in the making.
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
            // Downwards there are many.
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

/// Logs the strands near the places of a frame.
pub(super) fn draw(
    rec: &RecordingStream,
    set: &CurveSet,
    report: &Report,
    published: &[f32],
) -> Result<()> {
    let radii = Radii {
        published,
        measured: None,
    };
    let mut tubes = Tubes::default();
    let mut drawn: Vec<Spot> = Vec::new();
    for spot in report.first_findings(SHOWN).filter_map(spot).take(SHOWN) {
        // A change and its pull-through are at one place.
        let is_known = |other: &Spot| other.curves == spot.curves;
        let [_, window, _] = Window::around([None, Some((set, spot)), None], 0.0);
        let Some(window) = window.filter(|_| !drawn.iter().any(is_known)) else {
            continue;
        };
        drawn.push(spot);
        for strand in strands_of(set, spot, window) {
            let place = |p: &Point| add_scaled(window.centre, window.reach, *p);
            let radius = radii.of(strand.curve) / window.reach;
            tubes.add(&strand, radius, window.reach, place);
        }
    }
    log(rec, entity::TUBES, &tubes.archetype())
}

impl Moments {
    /// Returns the moments of the first finding of a report that has a place.
    pub fn of(report: &Report, before: Option<Numbered>, set: &Arc<CurveSet>) -> Option<Moments> {
        let is_event = |f: &Finding<'_>| matches!(f, Finding::PullThrough(_));
        let (events, others): (Vec<_>, Vec<_>) = report.first_findings(SHOWN).partition(is_event);
        Some(Moments {
            spot: events.into_iter().chain(others).find_map(spot)?,
            before: before.filter(|(_, before)| before.same_layout(set)),
            at: (report.seq, Arc::clone(set)),
        })
    }

    /// Logs the moments; `after` is the next frame, if there is one. Returns their views.
    pub fn draw(
        self,
        rec: &RecordingStream,
        after: Option<Numbered>,
        published: &[f32],
    ) -> Result<Option<MomentViews>> {
        let (spot, radii) = (
            self.spot,
            Radii {
                published,
                measured: None,
            },
        );
        let after = after.filter(|(_, after)| after.same_layout(&self.at.1));
        let frames = [self.before, Some(self.at), after];
        let placed = frames
            .each_ref()
            .map(|frame| Some((&*frame.as_ref()?.1, spot)));
        let windows = Window::around(placed, 0.0);
        let mut eye = None;
        for ((placed, window), path) in placed.into_iter().zip(windows).zip(entity::MOMENTS) {
            let (Some((set, spot)), Some(window)) = (placed, window) else {
                continue;
            };
            let scene = Scene::of(set, spot, window);
            let mut tubes = Tubes::default();
            let (own, others): (Vec<&Strand>, _) = scene
                .strands()
                .iter()
                .partition(|strand| strand.part != Part::Other);
            for strand in own {
                tubes.add(strand, radii.of(strand.curve) / window.reach, 1.0, |p| *p);
            }
            log_static(rec, &format!("{path}/strands"), &tubes.archetype())?;
            let others = others
                .iter()
                .map(|strand| strand.points.iter().map(|p| narrow(*p)));
            let others = others.map(|points| points.collect::<Vec<_>>());
            let others = lines(others, 0.7).with_colors([DIMMED]);
            log_static(rec, &format!("{path}/others"), &others)?;
            if path == entity::MOMENTS[1] {
                let view = scene.views()[0];
                eye = Some(
                    EyeControls3D::new()
                        .with_position(view.towards.map(|x| (EYE * x) as f32))
                        .with_look_target([0.0; 3])
                        .with_eye_up(narrow(view.up)),
                );
            }
        }
        let words = ["before", "at the violation", "after"];
        let name = |(frame, words): (&Option<Numbered>, &str)| {
            let (seq, _) = frame.as_ref()?;
            Some(format!("{words}: frame {seq}"))
        };
        let mut names = frames.iter().zip(words).map(name);
        let names = [(); 3].map(|()| names.next().flatten());
        Ok(eye.map(|eye| MomentViews { names, eye }))
    }
}
