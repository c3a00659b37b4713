//! Notes for the user about the curves that a rule closed or opened.

use crate::verdict::LeftOut;
use crate::words::plural;
use std::fmt;

/// A decision of [`Closing`](super::Closing) about some curves of the first frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClosingNote {
    /// The decision.
    pub kind: ClosingKind,
    /// Number of the curves.
    pub count: usize,
    /// The first of them.
    pub first: usize,
    /// Length of the closing segment of the first one, as a multiple of its longest other segment;
    /// 0 if it is no reason of the decision.
    pub factor: f64,
}

/// Kind of a [`ClosingNote`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum ClosingKind {
    /// Curves are closed, because they end where they start.
    Joined,
    /// Splines stay open, although their ends or the control points there meet: a closed spline
    /// would have another shape.
    Corner,
    /// Curves that only the format closes stay open, because the closing segment would be long.
    Opened,
    /// Curves are closed by a long segment, because the source says that they are closed.
    Long,
}

impl ClosingNote {
    /// Multiple of the longest other segment of its curve from which on a closing segment is long.
    /// The bonds of a ring have about the same length, and no triangle has such a side.
    pub const FACTOR: f64 = 2.0;

    /// Adds a curve to the notes.
    pub(super) fn add(notes: &mut Vec<ClosingNote>, kind: ClosingKind, curve: usize, factor: f64) {
        match notes.iter_mut().find(|note| note.kind == kind) {
            Some(note) => note.count += 1,
            None => notes.push(ClosingNote {
                kind,
                count: 1,
                first: curve,
                factor,
            }),
        }
    }

    /// Counts the curves that may be meant to be closed, and are not verified as closed ones.
    pub fn left_out(&self) -> Option<LeftOut> {
        let kind = ["spline with ends that meet", "splines with ends that meet"];
        let first = format!("curve {}", self.first);
        (self.kind == ClosingKind::Corner).then(|| LeftOut::new(self.count as u64, kind, first))
    }
}

impl fmt::Display for ClosingNote {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (count, factor) = (self.count, self.factor);
        let verb = |one: &'static str, many: &'static str| if count == 1 { one } else { many };
        let first = format!("{}curve {}", verb("", "the first one: "), self.first);
        let curves = plural(count, "curve");
        let (are, stay) = (verb("is", "are"), verb("stays", "stay"));
        let limit = ClosingNote::FACTOR;
        match self.kind {
            ClosingKind::Joined => {
                let end = verb("ends where it starts", "end where they start");
                write!(
                    f,
                    "{curves} {end} and {are} closed, without the repeated point ({first})"
                )
            }
            ClosingKind::Corner => write!(
                f,
                "{} {stay} open ({first}): first and last points coincide, but a closed spline \
                 repeats its first three control points at the end, and another one would have \
                 another shape",
                plural(count, "spline"),
            ),
            ClosingKind::Opened => write!(
                f,
                "{curves} {stay} open ({first}): nothing says if {} closed, and the closing \
                 segment would be {factor:.1} times as long as the longest other one (at most \
                 {limit})",
                verb("it is", "they are"),
            ),
            ClosingKind::Long => write!(
                f,
                "{curves} {are} closed by a segment that is more than {limit} times as long as the \
                 longest other one ({first}, {factor:.1} times): is it an open chain?",
            ),
        }
    }
}
