//! Timeline of all frames, as SVG: a column a bin, in the colours of the verdicts.

use super::axis::{Axis, WIDTH};
use super::facts::Facts;
use super::series::Bin;
use super::svg::{escape, px};
use crate::verdict::Verdict;
use crate::words::{count, plural, plural_of};

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
    pub fn timeline(&self) -> String {
        let (series, axis) = (&self.series, Axis::of(&self.series));
        let mut out = format!(
            "<svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"{}\">\n",
            escape(&self.timeline_words())
        );
        let gap = if axis.step >= BORDERED { 1.0 } else { 0.0 };
        let mut k = 0;
        while k < series.bins.len() {
            let bin = &series.bins[k];
            // Equal columns without borders are one rectangle.
            let alike = |b: &&Bin| gap == 0.0 && is_plain(bin) && is_plain(b);
            let same = series.bins[k + 1..].iter().take_while(alike).count();
            let last = &series.bins[k + same];
            let width = axis.x(k + same + 1) - axis.x(k) - gap;
            out += "<g>";
            column(bin, axis.x(k), width, &mut out);
            out += &format!("<title>{}</title></g>\n", title(bin, last));
            k += same + 1;
        }
        for (k, bin) in series.bins.iter().enumerate() {
            let x = axis.middle(k);
            if bin.pull_throughs + bin.unresolved > 0 {
                let class = if bin.pull_throughs > 0 { "p" } else { "p u" };
                out += &format!(
                    "<path class=\"{class}\" d=\"M{} {}l-5 -9h10Z\"/>\n",
                    px(x),
                    px(MARKS + 10.0)
                );
            }
            if bin.skipped + bin.missing > 0 {
                let class = if bin.missing > 0 { "lost" } else { "skip" };
                out += &format!(
                    "<path class=\"{class}\" d=\"M{} {}l-3.5 7h7Z\"/>\n",
                    px(axis.x(k)),
                    px(LOST - 5.0)
                );
            }
        }
        if let Some(found) = self.changed.as_ref().or(self.unsettled.as_ref())
            && let Some(bin) = series.bin_of(found.moment.frame)
        {
            let x = axis.middle(bin);
            let (class, aside) = if x > 0.7 * WIDTH {
                ("e", -9.0)
            } else {
                ("", 9.0)
            };
            out += &format!(
                "<path class=\"x\" d=\"M{} 3V{}\"/><text class=\"t {class}\" x=\"{}\" \
                 y=\"{NAMES}\">frame {}: first {}</text>\n",
                px(x),
                px(MARKS),
                px(x + aside),
                found.moment.frame,
                found.verdict
            );
        }
        axis.draw(AXIS, &mut out);
        out += "</svg>\n";
        out
    }

    /// Returns the meaning of the colours and marks that the timeline has, each with its class.
    pub fn legend(&self) -> Vec<(String, String)> {
        let mut legend = Vec::new();
        for verdict in Verdict::ALL {
            let n = self.verdicts[verdict as usize];
            if n > 0 {
                legend.push((
                    format!("v{}", verdict as u32),
                    format!("{verdict} ({})", count(n)),
                ));
            }
        }
        let bins = &self.series.bins;
        for (class, what, there) in [
            (
                "p",
                "pull-through",
                bins.iter().any(|b| b.pull_throughs > 0),
            ),
            ("p u", "unresolved pull-through", self.unresolved > 0),
            ("skip", "frames skipped before", self.counts.skipped > 0),
            ("lost", "frames missing before", self.counts.missing > 0),
        ] {
            if there {
                legend.push((class.into(), what.into()));
            }
        }
        legend
    }

    /// Describes the timeline.
    fn timeline_words(&self) -> String {
        let bins = &self.series.bins;
        let frames: u64 = bins.iter().map(|b| b.frames).sum();
        let words = Verdict::ALL.into_iter().filter_map(|verdict| {
            let n = self.verdicts[verdict as usize];
            (n > 0).then(|| format!("{} {verdict}", count(n)))
        });
        let words: Vec<String> = words.collect();
        format!(
            "timeline of {}: {}",
            plural(frames, "frame"),
            words.join(", ")
        )
    }
}

/// Returns true if all frames of a column are intact.
fn is_plain(bin: &Bin) -> bool {
    bin.verdicts[Verdict::Intact as usize] == bin.frames
}

/// Draws the column of a bin: the share of each verdict, the worst on top.
fn column(bin: &Bin, x: f64, width: f64, out: &mut String) {
    const BEST_FIRST: [Verdict; 6] = [
        Verdict::Intact,
        Verdict::Stale,
        Verdict::Undecided,
        Verdict::Contact,
        Verdict::Rejected,
        Verdict::Changed,
    ];
    let mut top = END;
    let mut rects = Vec::new();
    for verdict in BEST_FIRST {
        let n = bin.verdicts[verdict as usize];
        if n == 0 {
            continue;
        }
        let height = (END - BAND) * n as f64 / bin.frames as f64;
        let height = if verdict == Verdict::Intact {
            height
        } else {
            height.max(LEAST)
        };
        rects.push((verdict, height));
    }
    let all: f64 = rects.iter().map(|(_, height)| height).sum();
    for (verdict, height) in rects {
        let height = height * (END - BAND) / all;
        top -= height;
        *out += &format!(
            "<rect class=\"v{}\" x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\"/>",
            verdict as u32,
            px(x),
            px(top),
            px(width.max(0.5)),
            px(height)
        );
    }
}

/// Describes the frames of the bins from `first` to `last`.
fn title(first: &Bin, last: &Bin) -> String {
    if first.first.frame == last.last_frame {
        let words = Verdict::ALL
            .into_iter()
            .find(|v| first.verdicts[*v as usize] > 0);
        let word = words.map_or("", Verdict::word);
        return format!("{}: {word}{}", first.first, passages(first));
    }
    let frames = format!("frames {} to {}", first.first.frame, last.last_frame);
    let verdicts = match is_plain(first) {
        true => "intact".to_owned(),
        false => {
            let words = Verdict::ALL.into_iter().filter_map(|verdict| {
                let n = first.verdicts[verdict as usize];
                (n > 0).then(|| format!("{} {verdict}", count(n)))
            });
            words.collect::<Vec<_>>().join(", ")
        }
    };
    format!("{frames}: {verdicts}{}", passages(first))
}

fn passages(bin: &Bin) -> String {
    match bin.pull_throughs {
        0 => String::new(),
        n => format!(", {}", plural_of(n, "pull-through", "pull-throughs")),
    }
}
