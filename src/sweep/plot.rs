//! Plot of a sweep: violations of each step, as SVG.

use super::{Reduction, SweepStep};
use crate::svg::{escape, plain, px};
use crate::verdict::Verdict;
use crate::words::count;

/// Size of the picture, and the rectangle of the plot: left, top, right, bottom.
const SIZE: [f64; 2] = [860.0, 400.0];
const FRAME: [f64; 4] = [64.0, 76.0, 846.0, 336.0];

/// Maximum number of labels of steps.
const LABELS: usize = 18;

/// Colours of the verdicts intact, changed, and neither.
const BANDS: [(&str, &str); 3] = [
    ("#dff2ea", "intact"),
    ("#fae0dc", "broken"),
    ("#e2eefa", "not decided"),
];

/// A curve of the plot: its name, its colour, and its value in a step.
type Series = (&'static str, &'static str, fn(&SweepStep) -> usize);

const SERIES: [Series; 3] = [
    ("changed links", "#0067b1", |step| step.report.changes.len()),
    ("pull-throughs since the step before", "#d35400", |step| {
        step.report.events.len()
    }),
    ("undecided", "#7d878f", SweepStep::undecided),
];

/// Returns a plot of the violations of each step of a sweep, as an SVG file: the linking numbers
/// that differ from those of the original, the pull-throughs since the step before, and the pairs
/// and pull-throughs that are undecided. The colour of a column is the verdict. Numbers are on a
/// logarithmic scale that starts at 0.
pub fn plot(title: &str, steps: &[SweepStep]) -> String {
    let [left, top, right, bottom] = FRAME;
    let each = (right - left) / steps.len().max(1) as f64;
    let middle = |k: usize| left + each * (k as f64 + 0.5);
    let most = steps
        .iter()
        .flat_map(|s| SERIES.map(|(.., of)| of(s)))
        .max()
        .unwrap_or(0);
    let decades = ((most.max(9) + 1) as f64).log10().ceil();
    let y = |n: usize| bottom - (bottom - top) * (n as f64 + 1.0).log10() / decades;
    let [width, height] = SIZE;
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" \
         font-family=\"DejaVu Sans, sans-serif\" font-size=\"12\" fill=\"#1c2329\">\n\
         <rect width=\"{width}\" height=\"{height}\" fill=\"#fff\"/>\n\
         <text x=\"12\" y=\"24\" font-size=\"15\" font-weight=\"bold\">{}</text>\n",
        escape(&plain(title, 100))
    );
    for (k, step) in steps.iter().enumerate() {
        let (colour, _) = BANDS[band(step.verdict)];
        out += &format!(
            "<rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" fill=\"{colour}\"/>\n",
            px(left + each * k as f64),
            px(top),
            // No seams between columns.
            px(each + 0.5),
            px(bottom - top)
        );
    }
    for n in std::iter::once(0).chain((0..decades as u32).map(|k| 10usize.pow(k))) {
        out += &format!(
            "<path d=\"M{left} {}H{right}\" stroke=\"#c3cbd1\" stroke-width=\"0.7\"/>\
             <text x=\"{}\" y=\"{}\" text-anchor=\"end\">{}</text>\n",
            px(y(n)),
            left - 8.0,
            px(y(n) + 4.0),
            count(n as u64)
        );
    }
    for k in (0..steps.len()).step_by(steps.len().div_ceil(LABELS).max(1)) {
        let points = match steps[k].reduction {
            Reduction::Share(_) => count(steps[k].curves.points() as u64),
            Reduction::Bits(_) => String::new(),
        };
        out += &format!(
            "<path d=\"M{x} {bottom}v5\" stroke=\"#5c6770\"/>\
             <text x=\"{x}\" y=\"{}\" text-anchor=\"middle\">{}</text>\
             <text x=\"{x}\" y=\"{}\" text-anchor=\"middle\" fill=\"#5c6770\" font-size=\"9.5\">\
             {points}</text>\n",
            bottom + 20.0,
            label(steps[k].reduction),
            bottom + 34.0,
            x = px(middle(k)),
        );
    }
    let axis = match steps.first().map(|s| s.reduction) {
        Some(Reduction::Share(_)) => "control points: share in %, and number",
        _ => "bits per coordinate",
    };
    out += &format!(
        "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">{axis}</text>\n",
        px(0.5 * (left + right)),
        height - 10.0
    );
    for (name, colour, of) in SERIES {
        let mut line = String::new();
        let mut dots = String::new();
        for (k, step) in steps.iter().enumerate() {
            let (x, y) = (px(middle(k)), px(y(of(step))));
            line += &format!("{}{x} {y}", if k == 0 { "M" } else { "L" });
            dots += &format!("<circle cx=\"{x}\" cy=\"{y}\" r=\"3.2\"/>");
        }
        out += &format!(
            "<g fill=\"{colour}\" stroke=\"{colour}\"><title>{name}</title>\
             <path d=\"{line}\" fill=\"none\" stroke-width=\"2\"/>{dots}</g>\n"
        );
    }
    legend(&mut out);
    out += "</svg>\n";
    out
}

fn legend(out: &mut String) {
    let mut x = 12.0;
    for (name, colour, _) in SERIES {
        *out += &format!(
            "<path d=\"M{x} 46h22\" stroke=\"{colour}\" stroke-width=\"2.5\"/>\
             <text x=\"{}\" y=\"50\">{name}</text>\n",
            x + 28.0
        );
        x += 46.0 + 6.9 * name.len() as f64;
    }
    for (colour, name) in BANDS {
        *out += &format!(
            "<rect x=\"{x}\" y=\"38\" width=\"16\" height=\"14\" fill=\"{colour}\"/>\
             <text x=\"{}\" y=\"50\">{name}</text>\n",
            x + 22.0
        );
        x += 36.0 + 6.9 * name.len() as f64;
    }
}

/// Returns the index of the colour of a verdict.
fn band(verdict: Verdict) -> usize {
    match verdict {
        Verdict::Intact => 0,
        Verdict::Changed => 1,
        _ => 2,
    }
}

fn label(reduction: Reduction) -> String {
    match reduction {
        Reduction::Bits(bits) => bits.to_string(),
        Reduction::Share(share) => format!("{}", (share * 1e4).round() / 1e2),
    }
}
