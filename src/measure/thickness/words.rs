//! Texts for struts and bends.

use super::{MinRad, Strut};
use crate::curve::{Notation, is_home};
use crate::verdict::words_of_pair;
use std::fmt;

/// Returns a text for an error bound; empty if the bound is 0.
fn error(error: f64) -> String {
    match error {
        0.0 => String::new(),
        error => format!(" (or less by at most {})", format_args!("{error:.1e}")),
    }
}

impl Strut {
    /// Returns a sentence. Coordinates have six significant digits of `extent`, the extent of the
    /// scene ([`CurveSet::extent`](crate::CurveSet::extent)); 0 if it is unknown.
    pub fn sentence(&self, extent: f64) -> String {
        let [a, b] = &self.ends;
        let notation = Notation::of_scene(extent, a.point);
        let [from, to] = [a, b].map(|end| notation.point(end.point));
        let curves = match a.curve == b.curve && is_home(&self.image) {
            true => format!("curve {} and itself", a.curve),
            false => words_of_pair((a.curve, b.curve), self.image, &[]),
        };
        let length = notation.length(self.length);
        format!(
            "{curves} are {length} apart{}, from {from} to {to}, segments {} and {}",
            error(self.error),
            a.segment,
            b.segment
        )
    }
}

impl fmt::Display for Strut {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.sentence(0.0))
    }
}

impl MinRad {
    /// Returns a sentence. Coordinates have six significant digits of `extent`, the extent of the
    /// scene; 0 if it is unknown.
    pub fn sentence(&self, extent: f64) -> String {
        let notation = Notation::of_scene(extent, self.point);
        format!(
            "curve {} bends to a radius of {}{}, at {}, {} {}",
            self.curve,
            notation.length(self.radius),
            error(self.error),
            notation.point(self.point),
            if self.t == 0.0 { "vertex" } else { "segment" },
            self.vertex
        )
    }
}

impl fmt::Display for MinRad {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.sentence(0.0))
    }
}
