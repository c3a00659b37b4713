//! Timeline of all frames, as SVG: a column a bin, in the colours of the verdicts.

use super::axis::{Axis, WIDTH};
use super::facts::Facts;
use super::series::Bin;
use crate::picture::svg::px;
use crate::verdict::Verdict;
use crate::words::{count, plural};
use maud::{Markup, html};

/// Vertical positions: names of frames, marks of pull-throughs, the band, marks of lost frames, the
/// axis.
const NAMES: f64 = 12.0;
const MARKS: f64 = 21.0;
const BAND: f64 = 34.0;
const END: f64 = 70.0;
const LOST: f64 = 77.0;
const AXIS: f64 = 84.0;
const HEIGHT: f64 = 120.0;

/// Minimum height of a verdict other than intact in its column.
const LEAST: f64 = 8.0;

/// Minimum width of a column with a border.
const BORDERED: f64 = 6.0;

impl Facts {
    /// Returns the timeline.
    pub fn timeline(&self) -> Markup {
        let bins = &self.series.bins;
        let axis = Axis::of(bins);
        let gap = if axis.step >= BORDERED { 1.0 } else { 0.0 };
        // Equal columns without borders are one rectangle.
        let alike = |a: &Bin, b: &Bin| gap == 0.0 && is_plain(a) && is_plain(b);
        let columns = bins.chunk_by(alike).scan(0, |end, columns| {
            *end += columns.len();
            Some((axis.x(*end - columns.len()), axis.x(*end), columns))
        });
        let verdicts = &self.verdicts;
        let first = verdicts.changed.as_ref().or(verdicts.unsettled.as_ref());
        let first = first.and_then(|found| {
            let x = axis.middle(self.series.bin_of(found.moment.frame)?);
            let (class, aside) = match x > 0.7 * WIDTH {
                true => ("t e", -9.0),
                false => ("t", 9.0),
            };
            Some((found, class, px(x), px(x + aside)))
        });
        let frames: u64 = bins.iter().map(|b| b.frames).sum();
        let words = format!("timeline of {}", plural(frames, "frame"));
        html! {
            svg viewBox={"0 0 " (WIDTH) " " (HEIGHT)} role="img"
                aria-label={(words) ": " (words_of(&self.verdicts.counts))}
            {
                @for (from, to, columns) in columns {
                    g {
                        (column(&columns[0], from, to - from - gap))
                        title { (title(columns)) }
                    }
                }
                @for (k, bin) in bins.iter().enumerate() {
                    @if bin.pull_throughs + bin.unresolved > 0 {
                        @let class = if bin.pull_throughs > 0 { "p" } else { "p u" };
                        @let (x, y) = (px(axis.middle(k)), px(MARKS + 10.0));
                        path class=(class) d={"M" (x) " " (y) "l-5 -9h10Z"} {}
                    }
                    @if bin.skipped + bin.missing > 0 {
                        @let class = if bin.missing > 0 { "lost" } else { "skip" };
                        @let (x, y) = (px(axis.x(k)), px(LOST - 5.0));
                        path class=(class) d={"M" (x) " " (y) "l-3.5 7h7Z"} {}
                    }
                }
                @if let Some((found, class, x, aside)) = first {
                    path.x d={"M" (x) " 3V" (px(MARKS))} {}
                    text class=(class) x=(aside) y=(NAMES) {
                        "frame " (found.moment.frame) ": first " (found.verdict)
                    }
                }
                (axis.draw(AXIS))
            }
        }
    }

    /// Returns the meaning of the colours and marks that the timeline has, each with its class.
    pub fn legend(&self) -> Vec<(String, String)> {
        let verdicts = Verdict::ALL.into_iter().filter(|v| self.of(*v) > 0);
        let verdicts = verdicts.map(|v| {
            let class = format!("v{}", v as u32);
            (class, format!("{v} ({})", count(self.of(v))))
        });
        let pulled = self.series.bins.iter().any(|b| b.pull_throughs > 0);
        let marks = [
            ("p", "pull-through", pulled),
            ("p u", "unresolved pull-through", self.unresolved > 0),
            ("skip", "frames skipped before", self.counts.skipped > 0),
            ("lost", "frames missing before", self.counts.missing > 0),
        ];
        let marks = marks.into_iter().filter(|(.., there)| *there);
        let marks = marks.map(|(class, what, _)| (class.to_owned(), what.to_owned()));
        verdicts.chain(marks).collect()
    }
}

/// Returns the numbers of verdicts as text: "24 intact, 1 changed".
fn words_of(verdicts: &[u64; 6]) -> String {
    let words = Verdict::ALL.into_iter().zip(verdicts);
    let words = words.filter(|(_, n)| **n > 0);
    let words: Vec<String> = words.map(|(v, n)| format!("{} {v}", count(*n))).collect();
    words.join(", ")
}

/// Returns true if all frames of a column are intact.
fn is_plain(bin: &Bin) -> bool {
    bin.verdicts[Verdict::Intact as usize] == bin.frames
}

/// Draws the column of a bin: the share of each verdict, the worst on top.
fn column(bin: &Bin, x: f64, width: f64) -> Markup {
    use Verdict::{Changed, Contact, Intact, Rejected, Stale, Undecided};
    const BEST_FIRST: [Verdict; 6] = [Intact, Stale, Undecided, Contact, Rejected, Changed];
    let height = |verdict: Verdict| {
        let height = (END - BAND) * bin.verdicts[verdict as usize] as f64 / bin.frames as f64;
        match verdict {
            Intact => height,
            _ if height > 0.0 => height.max(LEAST),
            _ => 0.0,
        }
    };
    let stretch = (END - BAND) / BEST_FIRST.map(height).iter().sum::<f64>();
    let parts = BEST_FIRST.into_iter().filter(|v| height(*v) > 0.0);
    let parts = parts.scan(END, |top, verdict| {
        let height = height(verdict) * stretch;
        *top -= height;
        Some((verdict as u32, px(*top), px(height)))
    });
    html! {
        @for (verdict, top, height) in parts {
            rect class={"v" (verdict)} x=(px(x)) y=(top) width=(px(width.max(0.5)))
                height=(height) {}
        }
    }
}

/// Describes the frames of columns, of which all or one have the same verdicts.
fn title(columns: &[Bin]) -> String {
    let (first, last) = (&columns[0], columns[columns.len() - 1].last_frame);
    let frames = match first.first.frame == last {
        true => first.first.to_string(),
        false => format!("frames {} to {last}", first.first.frame),
    };
    let is_only = |v: &Verdict| first.verdicts[*v as usize] == first.frames;
    let verdict = Verdict::ALL.into_iter().find(is_only);
    let verdicts = verdict.map_or_else(|| words_of(&first.verdicts), |v| v.to_string());
    match first.pull_throughs {
        0 => format!("{frames}: {verdicts}"),
        n => format!("{frames}: {verdicts}, {}", plural(n, "pull-through")),
    }
}
