//! The report as one HTML page without scripts and without external resources.

use super::RunReport;
use super::figures::{CHOICE, Figure};
use super::rows::Table;
use super::sentence::Conclusion;
use crate::curve::{Image, is_home};
use crate::picture;
use crate::picture::svg::plain;
use crate::words::count;
use maud::{DOCTYPE, Markup, PreEscaped, html};

/// Number of rows of a table that are always visible. The others can be opened.
const VISIBLE: usize = 12;

const STYLE: &str = include_str!("style.css");

/// Rules for the browser: nothing is loaded from elsewhere.
const POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'";

impl RunReport {
    /// Returns the report as an HTML page: one file without scripts and external resources, for
    /// light and dark screens and for print.
    ///
    /// Texts of the recording are escaped. The size is limited: tables have at most 400 rows,
    /// there are pictures of at most six violations and of the lowest clearance, and plots have at
    /// most 400 columns. Usual pages have 20 to 100 kB; it stays below 8 MiB.
    pub fn html(&self) -> String {
        let facts = &self.facts;
        let conclusion = facts.conclusion();
        let gaps = conclusion == Conclusion::Intact && !facts.gaps().is_empty();
        let (word, class) = match gaps {
            true => ("intact, with gaps", "gaps"),
            false => (conclusion.word(), conclusion.word()),
        };
        let name = self.recording.file_name().unwrap_or_default();
        let name = plain(&name.to_string_lossy(), 255);
        let (notes, has_frames) = (facts.notes(), !facts.series.bins.is_empty());
        let violations = match self.facts.verdicts.changed {
            Some(_) => "Worst violations",
            None => "Pairs without a verdict",
        };
        let page = html! {
            (DOCTYPE)
            html lang="en" {
                head {
                    meta charset="utf-8";
                    meta name="viewport" content="width=device-width, initial-scale=1";
                    meta http-equiv="Content-Security-Policy" content=(POLICY);
                    title { (word) ": " (name) }
                    style { (PreEscaped(picture::STYLE)) (PreEscaped(STYLE)) }
                }
                body { main {
                    header {
                        p class={"badge " (class)} { (word) }
                        h1 { (facts.sentence()) }
                        @if !notes.is_empty() {
                            ul.notes { @for note in &notes { li { (note) } } }
                        }
                        p.dim { (facts.summary(&name)) }
                    }
                    @if has_frames { section { h2 { "Timeline" } (self.timeline()) } }
                    @if !self.figures.is_empty() {
                        section {
                            h2 { (violations) }
                            p.dim { (CHOICE) }
                            @for figure in &self.figures { (pictures(figure)) }
                        }
                    }
                    @if let Some(figure) = &self.low_clearance {
                        section { h2 { "Lowest clearance" } (pictures(figure)) }
                    }
                    @for table in facts.tables() { (section(&table)) }
                    section {
                        h2 { "Run" }
                        table.facts {
                            @for (name, value) in facts.run(&self.recording) {
                                tr { th scope="row" { (name) } td { (value) } }
                            }
                        }
                    }
                    @if has_frames { section { h2 { "Figures over time" } (self.plots()) } }
                    footer {
                        "Report of linkwatch " (env!("CARGO_PKG_VERSION")) " about recorded \
                         verdicts; " code { "linkwatch replay" } " verifies them again, and "
                        code { "--show live" } " shows all frames."
                    }
                } }
            }
        };
        page.into_string() + "\n"
    }

    /// Returns the timeline with its legend.
    fn timeline(&self) -> Markup {
        let facts = &self.facts;
        let marks = facts.legend().into_iter().map(|(class, what)| {
            let mark = match class.starts_with('v') {
                true => html! { rect class=(class) width="16" height="11" {} },
                false => html! { path class=(class) d="M8 10L3 1H13Z" {} },
            };
            (mark, what)
        });
        html! {
            (facts.timeline())
            (legend(marks))
            @if facts.series.width() > 1 {
                p.dim {
                    "Each column has " (count(facts.series.width())) " frames: its colours have \
                     the share of each verdict, the worst on top and never invisible."
                }
            }
        }
    }

    fn plots(&self) -> Markup {
        let (plots, zero) = self.facts.plots();
        html! {
            @for plot in plots {
                figure {
                    figcaption {
                        h3 { (plot.title) }
                        @if plot.legend.len() > 1 {
                            (legend(plot.legend.iter().map(|(class, name)| {
                                let class = format!("{class} n");
                                (line(&class), (*name).to_owned())
                            })))
                        }
                    }
                    (plot.svg)
                }
            }
            @if !zero.is_empty() { p.dim { "None in any frame: " (zero.join(", ")) "." } }
        }
    }
}

/// Returns a legend of marks in 16 by 11 pixels, and their meaning.
fn legend(marks: impl IntoIterator<Item = (Markup, String)>) -> Markup {
    html! {
        p.legend {
            @for (mark, what) in marks {
                span { svg viewBox="0 0 16 11" aria-hidden="true" { (mark) } (what) }
            }
        }
    }
}

fn line(class: &str) -> Markup {
    html! { path class=(class) d="M0 6H16" {} }
}

/// Returns the pictures of a finding.
fn pictures(figure: &Figure) -> Markup {
    let (shot, spot) = (&figure.shot, figure.shot.spot);
    let curve = |class: &str, k: usize, image: Image| {
        let image = match (is_home(&image), image) {
            (true, _) => String::new(),
            (false, [n1, n2, n3]) => format!("image {n1},{n2},{n3} of "),
        };
        let [i, s] = [spot.curves[k], spot.segments[k]];
        let name = match &figure.names {
            Some(names) => format!(" ({})", plain(&names[k], 60)),
            None => String::new(),
        };
        (line(class), format!("{image}curve {i}{name}, segment {s}"))
    };
    let mut marks = vec![curve("sa", 0, Image::default())];
    if curve("", 0, Image::default()).1 != curve("", 1, spot.image).1 {
        marks.push(curve("sb", 1, spot.image));
    }
    if figure.thick {
        let band = html! { path.sa.w d="M0 5.5H16" style="stroke-width:11" {} };
        marks.push((band, "diameter of the strands".into()));
    }
    let has_rest = |svg: &String| svg.contains("class=\"r\"");
    if figure.rows.iter().flatten().flatten().any(has_rest) {
        marks.push((line("r"), "other parts of these curves".into()));
    }
    let ring = html! { circle.m cx="8" cy="5.5" r="4.5" {} };
    marks.extend([(line("o"), "neighbours".into()), (ring, "the place".into())]);
    html! {
        figure {
            figcaption {
                h3 { (shot.moment) ": " (shot.sentence) }
                p.dim {
                    @if let Some(passage) = &shot.passage { (passage) ". " }
                    (figure.reason)
                }
                (legend(marks))
            }
            div.pictures {
                @for (k, caption) in figure.captions.iter().enumerate() {
                    @let pictures = figure.rows.iter().filter_map(|row| row[k].as_ref());
                    div.moment {
                        p { (caption) }
                        @for svg in pictures { div { (PreEscaped(svg)) } }
                    }
                }
            }
        }
    }
}

/// Returns a table. Rows beyond the first ones can be opened.
fn section(table: &Table) -> Markup {
    let (visible, others) = table.rows.split_at(table.rows.len().min(VISIBLE));
    let lasted = table.rows.iter().any(|[.., lasted]| !lasted.is_empty());
    let part = |rows: &[[String; 3]]| {
        html! {
            div.wide { table {
                thead { tr {
                    th scope="col" { "frame" } th scope="col" { "finding" }
                    @if lasted { th scope="col" { "lasted" } }
                } }
                tbody {
                    @for row in rows {
                        tr { @for cell in &row[..2 + usize::from(lasted)] { td { (cell) } } }
                    }
                }
            } }
        }
    };
    html! {
        section {
            h2 { (table.title) }
            (part(visible))
            @if !others.is_empty() {
                details { summary { (count(others.len())) " more" } (part(others)) }
            }
            @if let Some(more) = &table.more { p.dim { (more) } }
        }
    }
}
