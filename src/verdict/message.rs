//! Messages about verdicts, which the command, the log and the viewer print.

use super::finding::Finding;
use super::{
    Change, ChangeKind, Clearance, CloseStrands, Defect, DefectKind, ImageLink, InvariantChange,
    LoopPair, Place, PullThrough, Report,
};
use crate::curve::vector::per_axis;
use crate::curve::{Image, Notation, is_home, significant, words_of_change, words_of_curve};
use std::fmt;

impl Place {
    /// Returns the place as text, for a scene of this extent (0: unknown).
    fn words(&self, extent: f64) -> String {
        let [s, t] = self.segments;
        self.between(&format!("segments {s}"), &t.to_string(), extent)
    }

    /// Returns the place as text, with words for both parts that are close.
    fn between(&self, first: &str, second: &str, extent: f64) -> String {
        let notation = Notation::of_scene(extent, self.point);
        let (point, distance) = (notation.point(self.point), notation.length(self.distance));
        format!("near {point}, {first} and {second}, {distance} apart")
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.words(0.0))
    }
}

/// Returns two curves in words: "curves 3 and 4", "parts of curve 3", "curve 3 and the image 1,0,0
/// of curve 4".
pub(crate) fn words_of_pair((i, j): (u32, u32), image: Image, names: &[String]) -> String {
    let [first, second] = [i, j].map(|curve| words_of_curve(curve, names));
    let [n1, n2, n3] = image;
    match (is_home(&image), i == j) {
        (true, false) => format!("curves {first} and {second}"),
        (true, true) => format!("parts of curve {first}"),
        (false, false) => format!("curve {first} and the image {n1},{n2},{n3} of curve {second}"),
        (false, true) => format!("curve {first} and its image {n1},{n2},{n3}"),
    }
}

/// Returns a curve for a label: its name, of which a long one keeps its end, or its index.
pub(crate) fn label_of_curve(i: u32, names: &[String]) -> String {
    const MOST: usize = 20;
    let name = names.get(i as usize).filter(|name| !name.is_empty());
    let Some(name) = name else {
        return i.to_string();
    };
    match name.char_indices().rev().nth(MOST - 1) {
        Some((at, _)) if at > 0 => format!("\u{2026}{}", &name[at..]),
        _ => name.clone(),
    }
}

/// Returns two curves for a label: "3 & 4", or as [`words_of_pair`] if one is an image.
pub(crate) fn label_of_pair((i, j): (u32, u32), image: Image, names: &[String]) -> String {
    match is_home(&image) {
        true => [i, j].map(|curve| label_of_curve(curve, names)).join(" & "),
        false => words_of_pair((i, j), image, names),
    }
}

impl fmt::Display for ImageLink {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let pair = words_of_pair((self.i, self.j), self.image, &[]);
        write!(f, "{pair}: linking number {}", self.lambda)
    }
}

impl Change {
    fn what(&self) -> &'static str {
        match self.kind() {
            ChangeKind::Lost => "came apart",
            ChangeKind::Gained => "became linked",
            ChangeKind::Changed => "changed their link",
        }
    }

    /// Returns the change in a few words: "curves 3 and 4 came apart".
    pub(crate) fn words(&self, names: &[String]) -> String {
        let pair = words_of_pair((self.i, self.j), self.image, names);
        format!("{pair} {}", self.what())
    }

    /// Returns a sentence. Coordinates have six significant digits of `extent`, the extent of the
    /// scene ([`CurveSet::extent`](crate::CurveSet::extent)); 0 if it is unknown. `names` are those
    /// of all curves, or empty.
    pub fn sentence_named(&self, extent: f64, names: &[String]) -> String {
        self.with_numbers(&self.words(names), |place| place.words(extent))
    }

    /// Returns the numbers after some words, and the place as text if it is known.
    fn with_numbers(&self, words: &str, place: impl FnOnce(&Place) -> String) -> String {
        let (expected, found) = (self.expected, self.found);
        let place = self.place.as_ref().map(place);
        let place = place.map_or(String::new(), |place| format!(", {place}"));
        format!("{words}: linking number was {expected}, is {found}{place}")
    }
}

impl fmt::Display for Change {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.sentence_named(0.0, &[]))
    }
}

impl InvariantChange {
    /// Returns a sentence, with the names of all curves, or without if empty.
    pub fn sentence_named(&self, names: &[String]) -> String {
        let curves = self.curves.iter().map(|&i| words_of_curve(i, names));
        let curves: Vec<String> = curves.collect();
        let (expected, found) = (&self.expected, &self.found);
        match &curves[..] {
            [one] => format!("the knot of curve {one} changed: was {expected}, is {found}"),
            _ => {
                let curves = curves.join(", ");
                format!("curves {curves}: triple linking number was {expected}, is {found}")
            }
        }
    }
}

impl LoopPair {
    /// Returns the loops as text: "the virtual loops of curves 0 + 1 and 2 + 3".
    fn words(&self, names: &[String]) -> String {
        let [first, second] = [0, 1].map(|k| {
            let own = words_of_curve(self.curves[k], names);
            match self.partners[k].map(|j| words_of_curve(j, names)) {
                Some(other) => format!("the virtual loop of curves {own} + {other}"),
                None => format!("curve {own}"),
            }
        });
        format!("{first} and {second}")
    }

    /// Returns the place of closest approach as text, on the real curves.
    fn place(&self, place: &Place, extent: f64, names: &[String]) -> String {
        let [first, second] = self.nearest.map(|nearest| match nearest {
            Some([curve, s]) => format!("segment {s} of curve {}", words_of_curve(curve, names)),
            None => "a virtual connection".into(),
        });
        place.between(&first, &second, extent)
    }

    /// Returns the sentence for a change.
    fn change(&self, change: &Change, extent: f64, names: &[String]) -> String {
        let words = format!("{} {}", self.words(names), change.what());
        change.with_numbers(&words, |place| self.place(place, extent, names))
    }
}

impl PullThrough {
    /// Returns the pull-through in a few words: "curves 3 and 4 passed through one another".
    pub(crate) fn words(&self, names: &[String]) -> String {
        match self.i == self.j && is_home(&self.image) {
            true => format!(
                "curve {} passed through itself",
                words_of_curve(self.i, names)
            ),
            false => {
                let pair = words_of_pair((self.i, self.j), self.image, names);
                format!("{pair} passed through one another")
            }
        }
    }

    /// Returns the pull-through for a label: "3 through 4".
    pub(crate) fn label(&self, names: &[String]) -> String {
        let ([i, j], [n1, n2, n3]) = ([self.i, self.j], self.image);
        let [i, j] = [i, j].map(|curve| label_of_curve(curve, names));
        match (is_home(&self.image), self.i == self.j) {
            (true, true) => format!("{i} through itself"),
            (true, false) => format!("{i} through {j}"),
            (false, true) => format!("{i} through its image {n1},{n2},{n3}"),
            (false, false) => format!("{i} through the image {n1},{n2},{n3} of {j}"),
        }
    }

    /// Returns a sentence: see [`Change::sentence_named`].
    pub fn sentence_named(&self, extent: f64, names: &[String]) -> String {
        let (fraction, sign, [s, t]) = (self.fraction, self.sign, self.segments);
        let what = self.words(names);
        let point = Notation::of_scene(extent, self.point).point(self.point);
        format!("{what} at {fraction:.3} of the step ({sign:+}), at {point}, segments {s} and {t}")
    }

    /// Returns a sentence with the motion in the step.
    pub(crate) fn with_motion(&self, names: &[String], extent: f64) -> String {
        let (sentence, lengths) = (self.sentence_named(extent, names), self.lengths);
        format!("{sentence}, which moved {lengths:.1} segment lengths in the step")
    }
}

impl fmt::Display for PullThrough {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.sentence_named(0.0, &[]))
    }
}

impl Defect {
    /// Returns the defect in a few words: "curves 3 and 4 touch".
    pub(crate) fn words(&self, names: &[String]) -> String {
        let (i, what) = (words_of_curve(self.i, names), self.kind.words());
        let is_alone = self.j == Some(self.i) && is_home(&self.image);
        match self.j {
            Some(_) if is_alone && self.kind == DefectKind::Unaccounted => {
                format!("curve {i} has a change of v2 that differs from that of its pull-throughs")
            }
            Some(j) => format!("{} {what}", words_of_pair((self.i, j), self.image, names)),
            None => format!("curve {i} {what}"),
        }
    }

    /// Returns a sentence: see [`Change::sentence_named`].
    pub fn sentence_named(&self, extent: f64, names: &[String]) -> String {
        let (what, point) = (self.words(names), self.place.point);
        let notation = Notation::of_scene(extent, point);
        match self.j {
            Some(_) => format!("{what}, {}", self.place.words(extent)),
            None => format!("{what}, at {}", notation.point(point)),
        }
    }
}

impl fmt::Display for Defect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.sentence_named(0.0, &[]))
    }
}

impl CloseStrands {
    /// Returns a sentence: see [`Change::sentence_named`].
    pub fn sentence_named(&self, extent: f64, names: &[String]) -> String {
        let ([s, t], [p, q]) = (self.segments, self.points);
        let strands = words_of_pair((self.i, self.j), self.image, names);
        let middle = per_axis(|x| p[x] + 0.5 * (q[x] - p[x]));
        let notation = Notation::of_scene(extent, middle);
        let (point, distance) = (notation.point(middle), notation.length(self.distance));
        format!(
            "the centre lines of {strands} are {distance} apart, {:.1} % of their diameter, near \
             {point}, segments {s} and {t}",
            100.0 * self.ratio
        )
    }
}

impl Clearance {
    /// Returns a sentence about the closest strands, if some are close, and their trend. See
    /// [`CloseStrands::sentence_named`].
    pub fn sentence_named(&self, extent: f64, names: &[String]) -> Option<String> {
        let closest = self.closest?;
        Some(closest.sentence_named(extent, names) + &self.trend(closest.ratio))
    }

    /// Returns the curves of a low clearance and their trend in a few words.
    pub(crate) fn reason(&self) -> Option<String> {
        let closest = self.closest.filter(|_| self.low)?;
        let (share, trend) = (100.0 * closest.ratio, self.trend(closest.ratio));
        let strands = words_of_pair((closest.i, closest.j), closest.image, &[]);
        Some(format!(
            "low clearance of {strands}, {share:.1} % of their diameter{trend}"
        ))
    }

    /// Returns the end of a sentence about strands of this clearance.
    fn trend(&self, ratio: f64) -> String {
        let Some(left) = self.frames_left else {
            return String::new();
        };
        let what = if ratio > 1.0 { "contact" } else { "they meet" };
        match left.round() {
            ..2.0 => format!("; {what} in the next frame at this rate"),
            left => format!("; {what} in about {left} frames at this rate"),
        }
    }
}

/// Returns the state to which a simulator can roll back, as text, if there is one: see
/// [`Report::last_intact`] and [`Report::safe_fraction`].
pub(crate) fn words_of_roll_back(
    last_intact: Option<u64>,
    safe_fraction: Option<f64>,
) -> Option<String> {
    let safe = safe_fraction.map_or(String::new(), |fraction| {
        // Rounded down, as the fraction is.
        let fraction = (fraction * 1e3).floor() / 1e3;
        format!(", and {fraction:.3} of the step from there is safe")
    });
    Some(format!("frame {} is intact{safe}", last_intact?))
}

/// Returns a count and its noun, in which an asterisk stands for the plural: `link* lost`.
pub(crate) fn words_of_count(n: usize, what: &str) -> String {
    format!("{n} {}", what.replace('*', if n == 1 { "" } else { "s" }))
}

/// Returns the number of a frame and its simulation time: see [`Report::frame`].
pub(crate) fn words_of_frame(seq: u64, time: f64) -> String {
    match time {
        0.0 => format!("frame {seq}"),
        time => format!("frame {seq} at {} s", significant(time)),
    }
}

impl Report {
    /// Returns the state to which a simulator can roll back, as text. `None` if this frame is
    /// known to be intact, or if no frame is.
    pub fn roll_back(&self) -> Option<String> {
        let last_intact = self.last_intact.filter(|&seq| seq != self.seq);
        words_of_roll_back(last_intact, self.safe_fraction)
    }

    /// Returns the number of changes of one kind.
    pub fn count(&self, kind: ChangeKind) -> usize {
        self.changes.iter().filter(|c| c.kind() == kind).count()
    }

    /// Returns true if any curves touch.
    pub fn has_contact(&self) -> bool {
        self.defects.iter().any(|d| d.kind == DefectKind::Contact)
    }

    /// Returns the number of the frame and its simulation time: "frame 28 at 0.28 s". Omits the
    /// time if it is 0, as for frames without one.
    pub fn frame(&self) -> String {
        words_of_frame(self.seq, self.time)
    }

    /// Returns one line with the frame, the verdict, and the number of findings of each kind.
    pub fn headline(&self) -> String {
        let of_step = self.defects.iter().filter(|d| d.kind.is_of_step()).count();
        let [lost, gained, changed] = ChangeKind::ALL.map(|kind| self.count(kind));
        let numbers = self.defects.len() - of_step;
        let step = match of_step {
            1 => "step of a pair or curve undecided",
            _ => "step* of pair* or curve* undecided",
        };
        let counts = [
            (lost, "link* lost"),
            (gained, "link* gained"),
            (changed, "link* changed"),
            (self.invariants.len(), "knot* or triple* changed"),
            (self.events.len(), "pull-through*"),
            (numbers, "pair* or curve* without a linking number"),
            (of_step, step),
            (self.unresolved.len(), "unresolved pull-through*"),
        ];
        let counts = counts.into_iter().filter(|(n, _)| *n > 0);
        let mut parts: Vec<String> = counts.map(|(n, what)| words_of_count(n, what)).collect();
        parts.extend(self.missing.iter().cloned());
        parts.extend(self.rejected.clone());
        parts.extend(self.change_of_curves());
        let detail = match parts.is_empty() {
            true => String::new(),
            false => format!(" ({})", parts.join(", ")),
        };
        format!("{}: {}{detail}", self.frame(), self.verdict)
    }

    /// Returns which curves appeared and which are gone, as text. `None` if there are none.
    pub fn change_of_curves(&self) -> Option<String> {
        words_of_change(&self.appeared, &self.gone)
    }

    /// Returns a sentence for every finding of the frame: changes, events, defects, unresolved
    /// pull-throughs. Coordinates have six significant digits of the extent of the scene
    /// ([`Stats::extent`](crate::Stats::extent)).
    pub fn findings(&self) -> impl Iterator<Item = String> + '_ {
        self.findings_named(&[])
    }

    /// Same as [`findings`](Report::findings), with the names of all curves, or without if empty.
    pub fn findings_named<'a>(&'a self, names: &'a [String]) -> impl Iterator<Item = String> + 'a {
        let all = self.all_findings();
        all.map(move |finding| self.sentence_of(finding, names))
    }

    /// Returns the sentence for a finding.
    pub(crate) fn sentence_of(&self, finding: Finding<'_>, names: &[String]) -> String {
        let extent = self.stats.extent;
        match finding {
            Finding::Change(c) => match self.loops_of(c.i, Some(c.j)) {
                Some(pair) => pair.change(c, extent, names),
                None => c.sentence_named(extent, names),
            },
            Finding::Invariant(c) => c.sentence_named(names),
            Finding::PullThrough(e) => e.sentence_named(extent, names),
            Finding::Defect(d) => self.defect(d, names),
            Finding::Unresolved(e) => format!("unresolved: {}", e.with_motion(names, extent)),
        }
    }

    /// Returns the curves of a finding about virtual loops.
    fn loops_of(&self, i: u32, j: Option<u32>) -> Option<&LoopPair> {
        let key = [i, j?];
        let at = self.loops.binary_search_by_key(&key, |p| p.curves);
        at.ok().map(|at| &self.loops[at])
    }

    /// Returns the sentence for a defect.
    fn defect(&self, defect: &Defect, names: &[String]) -> String {
        let sentence = match self.loops_of(defect.i, defect.j) {
            Some(pair) => {
                let place = pair.place(&defect.place, self.stats.extent, names);
                format!("{} {}, {place}", pair.words(names), defect.kind.words())
            }
            None => defect.sentence_named(self.stats.extent, names),
        };
        if defect.kind != DefectKind::NoBaseline {
            return sentence;
        }
        let numbers = match defect.j {
            Some(_) if !is_home(&defect.image) => "its linking number in this frame is".into(),
            Some(j) => {
                let adopted = self.adopted.iter().find(|l| (l.i, l.j) == (defect.i, j));
                format!("{} is", adopted.map_or(0, |l| l.lambda))
            }
            None => "the linking numbers of this frame are".to_owned(),
        };
        format!("{sentence}; {numbers} expected from here on")
    }
}
