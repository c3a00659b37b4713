//! Layout of the viewer's views.

use super::ViewerSink;
use super::names::{APPLICATION, FRAME, entity};
use super::stream::failed;
use crate::error::Result;
use re_sdk::blueprint::components::{BackgroundKind, PanelState, PlayState};
use re_sdk::blueprint::datatypes::{TextLogColumn, TextLogColumnKind, TimelineColumn};
use re_sdk::blueprint::{
    Blueprint, BlueprintActivation, BlueprintPanel, ContainerLike, Horizontal, SelectionPanel,
    Spatial3DView, Tabs, TextDocumentView, TextLogView, TimePanel, TimeSeriesView, Vertical,
};
use re_sdk::log::LogMsg;
use re_sdk::{
    AsComponents, EntityPath, RecordingStream, RecordingStreamBuilder, RecordingStreamResult,
};
use re_sdk_types::blueprint::archetypes::{
    Background, EyeControls3D, LineGrid3D, PlotLegend, TextLogColumns,
};
use re_sdk_types::components::Color;

/// Legend as text, because legends in the plots would cover a third of them.
pub(super) const KEY: &str = "\
**Curves** red: changed, with its other curve in pale orange; orange: no verdict

**Marks** blue star: pull-through in this frame; blue dot: an earlier one; pale dots: where two \
curves are closest

**Links** red: lost; violet: gained; orange: changed; blue: pull-throughs

**Check** red: full; orange: partial; green: quiet
";

/// Legend of the clearance, if it is shown.
pub(super) const CLEARANCE_KEY: &str = "\
**Clearance** blue-green: strands come near; yellow: they touch; red: below the warning; dots: \
the closest places
";

/// Dark and uniform, so that muted curves are visible and red ones stand out.
const BACKGROUND: u32 = 0x0f1318ff;

impl ViewerSink {
    /// Sends the layout. It opens at the end of `timeline`. Without an eye, the viewer follows the
    /// scene.
    pub(super) fn layout(&self, timeline: &str, eye: Option<&EyeControls3D>) -> Result<()> {
        let clearance = self.clearance.is_some();
        let mut properties: Vec<(EntityPath, Box<dyn AsComponents>)> = Vec::new();
        let mut property = |view: &ContainerLike, name: &str, what: Box<dyn AsComponents>| {
            if let ContainerLike::View(view) = view {
                properties.push((format!("{}/{name}", view.blueprint_path()).into(), what));
            }
        };
        let background =
            Background::new(BackgroundKind::SolidColor).with_color(Color::from_u32(BACKGROUND));
        let grid = LineGrid3D::new().with_visible(false);
        let mut spatial = |view: Spatial3DView, eye: Option<&EyeControls3D>| {
            let view = ContainerLike::from(view);
            property(&view, "Background", Box::new(background.clone()));
            property(&view, "LineGrid3D", Box::new(grid.clone()));
            if let Some(eye) = eye {
                property(&view, "EyeControls3D", Box::new(eye.clone()));
            }
            view
        };
        let scene = Spatial3DView::new("curves").with_contents(["/curves/**"]);
        let scene = spatial(scene, eye);
        let moments = self.moment_views.as_ref().map(|moments| {
            let left_out = entity::NEAR_ONLY.map(|path| format!("- /{path}/**"));
            let all = ["+ /curves/**".to_owned()].into_iter().chain(left_out);
            let overview = Spatial3DView::new("overview").with_contents(all);
            let named = moments.names.iter().zip(entity::MOMENTS);
            let near = named.filter_map(|(name, path)| {
                let view =
                    Spatial3DView::new(name.as_deref()?).with_contents([format!("{path}/**")]);
                Some((view, &moments.eye))
            });
            let views = [(overview, &moments.overview)].into_iter().chain(near);
            let views = views.map(|(view, eye)| spatial(view, Some(eye)));
            views.collect::<Vec<_>>()
        });
        let status = TextDocumentView::new("status").with_origin(entity::STATUS);
        let key = TextDocumentView::new("colours").with_origin(entity::KEY);
        let log = ContainerLike::from(TextLogView::new("log").with_origin(entity::LOG));
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
        property(&log, "TextLogColumns", Box::new(columns));
        let plot = |name: &str, contents: &str| TimeSeriesView::new(name).with_contents([contents]);
        let [links, close, check, wait, marked, recomputed, skipped] = [
            ("links and pull-throughs", "/links/**"),
            ("clearance, diameters", "/clearance/**"),
            ("check, ms", "/check/**"),
            ("wait for the frame, ms", "/wait/**"),
            ("blocks marked, %", "/marked/**"),
            ("pairs recomputed", "/recomputed/**"),
            ("skipped", "/skipped/**"),
        ]
        .map(|(name, contents)| {
            let plot = ContainerLike::from(plot(name, contents));
            let legend = PlotLegend::new().with_visible(false);
            property(&plot, "PlotLegend", Box::new(legend));
            plot
        });
        let times = plot("stages, ms", "/times/**");
        let both = "clearance and links";
        let links = match clearance {
            true => Vertical::new([close, links]).with_name(both).into(),
            false => links,
        };
        let words = Vertical::new([status.into(), key.into()])
            .with_row_shares([if clearance { 1.3 } else { 2.4 }, 1.0]);
        let scene = match moments {
            Some(views) => {
                let scenes = Vertical::new([scene, Horizontal::new(views).into()]);
                scenes.with_row_shares([1.5, 1.0]).into()
            }
            None => scene,
        };
        let top = Horizontal::new([scene, words.into()]).with_column_shares([4.0, 1.1]);
        // Work counters, one above the other, because counts of frames and pairs share no axis.
        let work = Vertical::new([marked, recomputed]).with_name("work");
        // The wait is often a hundred times longer than the rest.
        let times = Vertical::new([times.into(), wait]).with_name("times");
        let plots = Tabs::new([links, check, times.into(), work.into(), skipped]);
        // Wide enough for most sentences of the log.
        let bottom = Horizontal::new([log, plots.into()]).with_column_shares([1.9, 1.0]);
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
        send_with(&self.rec, &blueprint, &properties).map_err(failed)
    }
}

/// Sends a blueprint together with properties of its views for which the blueprint API of rerun
/// 0.36 has no methods. They are logged into the store of the same blueprint before its activation.
fn send_with(
    rec: &RecordingStream,
    blueprint: &Blueprint,
    properties: &[(EntityPath, Box<dyn AsComponents>)],
) -> RecordingStreamResult<()> {
    let builder = RecordingStreamBuilder::new(APPLICATION).send_properties(false);
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
