//! What is said about the curves that a rule closed or opened.

use crate::verdict::LeftOut;
use crate::words::plural;
use std::fmt;

/// A decision of [`Closing`](super::Closing) about some curves of the first frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ClosingNote {
    /// Curves are closed, because they end where they start.
    Joined {
        /// Number of the curves.
        count: usize,
        /// The first of them.
        first: usize,
    },
    /// Splines stay open, although their ends or the control points there meet: a closed spline
    /// would have another shape.
    Corner {
        /// Number of the curves.
        count: usize,
        /// The first of them.
        first: usize,
    },
    /// Curves that only the format closes stay open, because the closing segment would be long.
    Opened {
        /// Number of the curves.
        count: usize,
        /// The first of them.
        first: usize,
        /// Length of its closing segment, as a multiple of its longest other segment.
        factor: f64,
    },
    /// Curves are closed by a long segment, because the source says that they are closed.
    Long {
        /// Number of the curves.
        count: usize,
        /// The first of them.
        first: usize,
        /// Length of its closing segment, as a multiple of its longest other segment.
        factor: f64,
    },
}

impl ClosingNote {
    /// Multiple of the longest other segment of its curve from which on a closing segment is long.
    /// The bonds of a ring have about the same length, and no triangle has such a side.
    pub const FACTOR: f64 = 2.0;

    /// Returns the notes about curves, each with the factor of its closing segment.
    pub(super) fn all(
        joined: &[(usize, f64)],
        corners: &[(usize, f64)],
        opened: &[(usize, f64)],
        long: &[(usize, f64)],
    ) -> Vec<ClosingNote> {
        let note = |curves: &[(usize, f64)], note: fn(usize, usize, f64) -> ClosingNote| {
            let &(first, factor) = curves.first()?;
            Some(note(curves.len(), first, factor))
        };
        let notes = [
            note(joined, |count, first, _| ClosingNote::Joined {
                count,
                first,
            }),
            note(corners, |count, first, _| ClosingNote::Corner {
                count,
                first,
            }),
            note(opened, |count, first, factor| ClosingNote::Opened {
                count,
                first,
                factor,
            }),
            note(long, |count, first, factor| ClosingNote::Long {
                count,
                first,
                factor,
            }),
        ];
        notes.into_iter().flatten().collect()
    }

    /// Counts the curves that may be meant to be closed, and are not verified as closed ones.
    pub fn left_out(&self) -> Option<LeftOut> {
        let ClosingNote::Corner { count, first } = self else {
            return None;
        };
        let kind = ["spline with ends that meet", "splines with ends that meet"];
        Some(LeftOut::new(*count as u64, kind, format!("curve {first}")))
    }
}

impl fmt::Display for ClosingNote {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let which = |count: usize, first: usize| match count {
            1 => format!("curve {first}"),
            _ => format!("the first one: curve {first}"),
        };
        let verb = |count: usize, one: &'static str, many: &'static str| match count {
            1 => one,
            _ => many,
        };
        let limit = ClosingNote::FACTOR;
        match *self {
            ClosingNote::Joined { count, first } => write!(
                f,
                "{} {} and {} closed, without the repeated point ({})",
                plural(count as u64, "curve"),
                verb(count, "ends where it starts", "end where they start"),
                verb(count, "is", "are"),
                which(count, first),
            ),
            ClosingNote::Corner { count, first } => write!(
                f,
                "{} {} open ({}): first and last points coincide, but a closed spline repeats its \
                 first three control points at the end, and another one would have another shape",
                plural(count as u64, "spline"),
                verb(count, "stays", "stay"),
                which(count, first),
            ),
            ClosingNote::Opened {
                count,
                first,
                factor,
            } => write!(
                f,
                "{} {} open ({}): nothing says if {} closed, and the closing segment would be \
                 {factor:.1} times as long as the longest other one (at most {limit})",
                plural(count as u64, "curve"),
                verb(count, "stays", "stay"),
                which(count, first),
                verb(count, "it is", "they are"),
            ),
            ClosingNote::Long {
                count,
                first,
                factor,
            } => write!(
                f,
                "{} {} closed by a segment that is more than {limit} times as long as the longest \
                 other one ({}, {factor:.1} times): is it an open chain?",
                plural(count as u64, "curve"),
                verb(count, "is", "are"),
                which(count, first),
            ),
        }
    }
}
