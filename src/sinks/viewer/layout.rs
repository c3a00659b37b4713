//! What a viewer shows when it opens: the layout of its views, and the status in words.

use super::entity;
use crate::verdict::{Report, Verdict};
use rerun::RecordingStream;
use rerun::blueprint::components::{PanelState, PlayState};
use rerun::blueprint::{
    Blueprint, BlueprintActivation, BlueprintPanel, Horizontal, SelectionPanel, Spatial3DView,
    TextDocumentView, TextLogView, TimePanel, TimeSeriesView, Vertical,
};
use std::fmt::Write;

/// Timelines: the number of the frame, and the time of the simulation.
pub(super) const FRAME: &str = "frame";
pub(super) const SIM_TIME: &str = "sim_time";

/// Sends the layout. It opens at the newest frame: the end of a broken run shows what is broken.
pub(super) fn send(rec: &RecordingStream) -> rerun::RecordingStreamResult<()> {
    let scene = Spatial3DView::new("curves").with_contents(["/curves/**"]);
    let status = TextDocumentView::new("status").with_origin(entity::STATUS);
    let log = TextLogView::new("log").with_origin(entity::LOG);
    let links = TimeSeriesView::new("links lost, gained, changed").with_contents(["/links/**"]);
    let cost = TimeSeriesView::new("cost of a check").with_contents(["/cost/**"]);
    let top = Horizontal::new([scene.into(), status.into()]).with_column_shares([4.0, 1.2]);
    let bottom = Horizontal::new([log.into(), links.into(), cost.into()])
        .with_column_shares([2.4, 1.4, 1.4]);
    let root = Vertical::new([top.into(), bottom.into()]).with_row_shares([2.6, 1.0]);
    let time = TimePanel::new()
        .with_state(PanelState::Collapsed)
        .with_timeline(FRAME)
        .with_play_state(PlayState::Following);
    Blueprint::new(root)
        .with_auto_views(false)
        .with_auto_layout(false)
        .with_blueprint_panel(BlueprintPanel::from_state(PanelState::Collapsed))
        .with_selection_panel(SelectionPanel::from_state(PanelState::Collapsed))
        .with_time_panel(time)
        .send(rec, BlueprintActivation::default())
}

/// The status as markdown: the answer, since when, and the pairs.
pub(super) fn status(report: &Report, since: u64, shown: usize) -> String {
    let mut text = match report.verdict {
        Verdict::Intact => String::from("# Intact\n"),
        Verdict::Changed => String::from("# TOPOLOGY CHANGED\n"),
        Verdict::Contact => String::from("# Contact\n"),
        Verdict::Undecided => String::from("# Undecided\n"),
        Verdict::Stale => String::from("# Not verified in time\n"),
        Verdict::Rejected => String::from("# Frame rejected\n"),
    };
    // Writing to a string cannot fail.
    let mut say = |line: std::fmt::Arguments<'_>| writeln!(text, "{line}").unwrap_or_default();
    say(format_args!("## since frame {since}\n"));
    let s = &report.stats;
    if let Some(why) = &report.rejected {
        say(format_args!("{why}\n"));
    } else {
        say(format_args!(
            "{} curves, {} potential links checked\n",
            s.curves, s.potential_links
        ));
    }
    if !report.changes.is_empty() {
        say(format_args!("| curves | expected | found |\n|---|---|---|"));
        for c in report.changes.iter().take(shown) {
            say(format_args!(
                "| **{} & {}** | {} | {} |",
                c.i, c.j, c.expected, c.found
            ));
        }
        say(format_args!(""));
    }
    for d in report.defects.iter().take(shown) {
        match d.j {
            Some(j) => say(format_args!("- curves {} and {j} {}", d.i, d.kind.words())),
            None => say(format_args!("- curve {} {}", d.i, d.kind.words())),
        }
    }
    let listed = report.changes.len().min(shown) + report.defects.len().min(shown);
    let more = report.changes.len() + report.defects.len() - listed;
    if more > 0 {
        say(format_args!("\nand {more} more"));
    }
    text
}
