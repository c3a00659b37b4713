//! The report as one HTML page without scripts and without external resources.

use super::figures::{CHOICE, Figure};
use super::rows::{PullThroughRow, Remark, Rows};
use super::sentence::Conclusion;
use super::svg::escape;
use super::violations::{LinkRow, Violation};
use super::{RunReport, words_of_curves};
use crate::curve::{Image, is_home};
use crate::words::{count, plural};

/// Number of rows of a table that are always visible. The others can be opened.
const VISIBLE: usize = 12;

const STYLE: &str = include_str!("style.css");

impl RunReport {
    /// Returns the report as an HTML page: one file without scripts and external resources, for
    /// light and dark screens and for print.
    ///
    /// Texts of the recording are escaped. The size is limited: tables have at most 400 rows,
    /// there are pictures of at most six violations and of the lowest clearance, and plots have at
    /// most 400 columns. Usual pages have 20 to 100 kB; it stays below [`RunReport::MOST_BYTES`].
    pub fn html(&self) -> String {
        let facts = &self.facts;
        let conclusion = facts.conclusion();
        let gaps = conclusion == Conclusion::Intact && !facts.gaps().is_empty();
        let (word, class) = match gaps {
            true => ("intact, with gaps", "gaps"),
            false => (conclusion.word(), conclusion.word()),
        };
        let name = self.recording.file_name().unwrap_or_default();
        let name = super::svg::plain(&name.to_string_lossy(), 255);
        let mut out = format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; \
             style-src 'unsafe-inline'\">\n<title>{word}: {}</title>\n<style>\n{STYLE}</style>\n\
             </head>\n<body>\n<main>\n<header>\n<p class=\"badge {class}\">{word}</p>\n\
             <h1>{}</h1>\n",
            escape(&name),
            escape(&facts.sentence()),
        );
        let notes = facts.notes();
        if !notes.is_empty() {
            let items = notes
                .iter()
                .map(|note| format!("<li>{}</li>\n", escape(note)));
            out += &format!("<ul class=\"notes\">\n{}</ul>\n", items.collect::<String>());
        }
        out += &format!(
            "<p class=\"dim\">{}</p>\n</header>\n",
            escape(&facts.summary(&name))
        );
        if !facts.series.bins.is_empty() {
            out += "<section>\n<h2>Timeline</h2>\n";
            out += &facts.timeline();
            self.legend(&mut out);
            out += "</section>\n";
        }
        self.figures_section(&mut out);
        if let Some(figure) = &self.low_clearance {
            out += "<section>\n<h2>Lowest clearance</h2>\n";
            draw(figure, &mut out);
            out += "</section>\n";
        }
        self.links_section(&mut out);
        self.pull_throughs_section(&mut out);
        self.defects_section(&mut out);
        remarks_section(&facts.remarks, &mut out);
        self.run_section(&mut out);
        self.plots_section(&mut out);
        out += &format!(
            "<footer>Report of linkwatch {} about recorded verdicts; <code>linkwatch replay</code> \
             verifies them again, and <code>--view</code> shows all frames.</footer>\n</main>\n\
             </body>\n</html>\n",
            env!("CARGO_PKG_VERSION")
        );
        out
    }

    fn legend(&self, out: &mut String) {
        *out += "<p class=\"legend\">";
        for (class, what) in self.facts.legend() {
            let mark = match class.starts_with('v') {
                true => format!("<rect class=\"{class}\" width=\"16\" height=\"11\"/>"),
                false => format!("<path class=\"{class}\" d=\"M8 10L3 1H13Z\"/>"),
            };
            *out += &format!("<span>{}{what}</span>", swatch(&mark));
        }
        *out += "</p>\n";
        let width = self.facts.series.width;
        if width > 1 {
            *out += &format!(
                "<p class=\"dim\">Each column has {} frames: its colours have the share of each \
                 verdict, the worst on top and never invisible.</p>\n",
                count(width)
            );
        }
    }

    fn figures_section(&self, out: &mut String) {
        if self.figures.is_empty() {
            return;
        }
        let what = match self.facts.changed {
            Some(_) => "Worst violations",
            None => "Pairs without a verdict",
        };
        *out += &format!("<section>\n<h2>{what}</h2>\n<p class=\"dim\">{CHOICE}</p>\n");
        for figure in &self.figures {
            draw(figure, out);
        }
        *out += "</section>\n";
    }

    fn links_section(&self, out: &mut String) {
        let pairs = &self.facts.violations.pairs;
        let links: Vec<(&Violation, &LinkRow)> = pairs
            .iter()
            .filter_map(|v| Some((v, v.link.as_ref()?)))
            .collect();
        if links.is_empty() {
            return;
        }
        let rows = links.iter().map(|(v, link)| {
            let [place, distance] = link.words.clone().unwrap_or_default();
            let segments = link.segments.map(|[s, t]| format!("{s} and {t}"));
            [
                words_of_curves(v.curves, v.image, &v.names),
                link.kind.word().into(),
                link.expected.to_string(),
                link.found.to_string(),
                link.first.to_string(),
                place,
                segments.unwrap_or_default(),
                distance,
                count(v.pull_throughs),
                match link.frames {
                    1 => "1".to_owned(),
                    n => format!("{}, to {}", count(n), link.last.frame),
                },
            ]
        });
        let heads = [
            "curves",
            "link",
            "expected",
            "found",
            "first in",
            "near",
            "segments",
            "apart",
            "pull-throughs",
            "frames",
        ];
        let more = match self.facts.violations.more {
            true => format!(
                "Only the first {} are listed.",
                plural(pairs.len() as u64, "pair")
            ),
            false => String::new(),
        };
        table(
            "Violated links",
            &heads,
            &[2, 3, 8],
            rows.collect(),
            &more,
            out,
        );
    }

    fn pull_throughs_section(&self, out: &mut String) {
        let all = &self.facts.pull_throughs;
        if all.rows.is_empty() {
            return;
        }
        let row = |row: &PullThroughRow| {
            let [s, t] = row.event.segments;
            let note = if row.unresolved { "unresolved" } else { "" };
            [
                row.moment.to_string(),
                words_of_curves([row.event.i, row.event.j], row.event.image, &row.names),
                format!("{:.3}", row.event.fraction),
                format!("{:+}", row.event.sign),
                row.place.clone(),
                format!("{s} and {t}"),
                format!("{:.2}", row.event.lengths),
                note.to_owned(),
            ]
        };
        let heads = [
            "in",
            "curves",
            "share of the step",
            "sign",
            "at",
            "segments",
            "motion (segment lengths)",
            "",
        ];
        let rows = all.rows.iter().map(row).collect();
        table("Pull-throughs", &heads, &[2, 3, 6], rows, &more(all), out);
    }

    fn defects_section(&self, out: &mut String) {
        let pairs = &self.facts.violations.pairs;
        let rows = pairs.iter().filter_map(|v| {
            let defect = v.defect.as_ref()?;
            Some([
                defect.first.to_string(),
                defect.sentence.clone(),
                count(defect.frames),
            ])
        });
        let rows: Vec<[String; 3]> = rows.collect();
        if !rows.is_empty() {
            let heads = ["first in", "finding", "frames"];
            table(
                "Pairs that could not be decided",
                &heads,
                &[2],
                rows,
                "",
                out,
            );
        }
    }

    fn run_section(&self, out: &mut String) {
        *out += "<section>\n<h2>Run</h2>\n<table class=\"facts\">\n";
        for (name, value) in self.facts.run(&self.recording) {
            *out += &format!(
                "<tr><th scope=\"row\">{}</th><td>{}</td></tr>\n",
                escape(&name),
                escape(&value)
            );
        }
        *out += "</table>\n</section>\n";
    }

    fn plots_section(&self, out: &mut String) {
        let (plots, zero) = self.facts.plots();
        if self.facts.series.bins.is_empty() {
            return;
        }
        *out += "<section>\n<h2>Figures over time</h2>\n";
        for plot in plots {
            *out += &format!("<figure>\n<figcaption><h3>{}</h3>", escape(&plot.title));
            if plot.legend.len() > 1 {
                *out += "<p class=\"legend\">";
                for (class, name) in &plot.legend {
                    let mark = format!("<path class=\"{class} n\" d=\"M0 6H16\"/>");
                    *out += &format!("<span>{}{name}</span>", swatch(&mark));
                }
                *out += "</p>";
            }
            *out += &format!("</figcaption>\n{}</figure>\n", plot.svg);
        }
        if !zero.is_empty() {
            *out += &format!(
                "<p class=\"dim\">None in any frame: {}.</p>\n",
                zero.join(", ")
            );
        }
        *out += "</section>\n";
    }
}

/// Returns a small picture for a legend.
fn swatch(mark: &str) -> String {
    format!("<svg viewBox=\"0 0 16 11\" aria-hidden=\"true\">{mark}</svg>")
}

/// Draws the pictures of a finding.
fn draw(figure: &Figure, out: &mut String) {
    let [i, j] = figure.shot.spot.curves;
    let image = figure.shot.spot.image;
    let [s, t] = figure.shot.spot.segments;
    let curve = |class: &str, i: u32, image: Image, s: u32| {
        let mark = format!("<path class=\"{class}\" d=\"M0 6H16\"/>");
        let image = match (is_home(&image), image) {
            (true, _) => String::new(),
            (false, [n1, n2, n3]) => format!("image {n1},{n2},{n3} of "),
        };
        format!(
            "<span>{}{image}curve {i}, segment {s}</span>",
            swatch(&mark)
        )
    };
    *out += &format!(
        "<figure>\n<figcaption><h3>{}</h3>\n<p class=\"dim\">{}{}</p>\n\
         <p class=\"legend\">{}{}{}<span>{}neighbours</span><span>{}the place</span></p>\
         </figcaption>\n<div class=\"pictures\">\n",
        escape(&format!("{}: {}", figure.shot.moment, figure.shot.sentence)),
        figure
            .shot
            .passage
            .as_ref()
            .map_or(String::new(), |p| format!("{}. ", escape(p))),
        escape(&figure.reason),
        curve("sa", i, Image::default(), s),
        if (i, s) == (j, t) && is_home(&image) {
            String::new()
        } else {
            curve("sb", j, image, t)
        },
        match figure.thick {
            true => format!(
                "<span>{}diameter of the strands</span>",
                swatch("<path class=\"sa w\" d=\"M0 5.5H16\" style=\"stroke-width:11\"/>")
            ),
            false => String::new(),
        },
        swatch("<path class=\"o\" d=\"M0 6H16\"/>"),
        swatch("<circle class=\"m\" cx=\"8\" cy=\"5.5\" r=\"4.5\"/>"),
    );
    for caption in &figure.captions {
        *out += &format!("<p>{}</p>\n", escape(caption));
    }
    for row in &figure.rows {
        for picture in row {
            *out += &match picture {
                Some(svg) => format!("<div>{svg}</div>\n"),
                None => "<div class=\"none\">no picture</div>\n".to_owned(),
            };
        }
    }
    *out += "</div>\n</figure>\n";
}

fn remarks_section(remarks: &Rows<Remark>, out: &mut String) {
    if remarks.rows.is_empty() {
        return;
    }
    let row = |r: &Remark| {
        [
            r.moment.to_string(),
            r.verdict.to_string(),
            r.reason.clone(),
        ]
    };
    let rows = remarks.rows.iter().map(row).collect();
    let heads = ["frame", "verdict", "reason"];
    table(
        "Rejected and incomplete frames",
        &heads,
        &[],
        rows,
        &more(remarks),
        out,
    );
}

/// Returns a sentence about rows that are not listed.
fn more<T>(rows: &Rows<T>) -> String {
    match rows.more() {
        0 => String::new(),
        n => format!("{} more are not listed.", count(n)),
    }
}

/// Writes a table. Rows beyond the first ones can be opened. `numeric` are the columns of numbers.
fn table<const N: usize>(
    title: &str,
    heads: &[&str; N],
    numeric: &[usize],
    rows: Vec<[String; N]>,
    more: &str,
    out: &mut String,
) {
    let class = |k: usize| {
        if numeric.contains(&k) {
            " class=\"n\""
        } else {
            ""
        }
    };
    let part = |rows: &[[String; N]], out: &mut String| {
        *out += "<div class=\"wide\"><table>\n<thead><tr>";
        for (k, head) in heads.iter().enumerate() {
            *out += &format!("<th scope=\"col\"{}>{head}</th>", class(k));
        }
        *out += "</tr></thead>\n<tbody>\n";
        for row in rows {
            *out += "<tr>";
            for (k, cell) in row.iter().enumerate() {
                *out += &format!("<td{}>{}</td>", class(k), escape(cell));
            }
            *out += "</tr>\n";
        }
        *out += "</tbody></table></div>\n";
    };
    *out += &format!("<section>\n<h2>{title}</h2>\n");
    let (visible, others) = rows.split_at(rows.len().min(VISIBLE));
    part(visible, out);
    if !others.is_empty() {
        let n = count(others.len() as u64);
        *out += &format!("<details><summary>{n} more</summary>\n");
        part(others, out);
        *out += "</details>\n";
    }
    if !more.is_empty() {
        *out += &format!("<p class=\"dim\">{more}</p>\n");
    }
    *out += "</section>\n";
}
