//! Diagrams in words and as JSON.

use super::{Diagram, Invariants};
use crate::words::plural;
use serde_json::{Value, json};
use std::fmt;

/// Maximum number of curves of a group that are listed by their numbers.
const MOST_NAMED: usize = 12;

impl Diagram {
    /// Returns the diagram with its codes and all its invariants as JSON. `knots` has the
    /// invariants of the curve of a diagram of one curve.
    pub fn to_json(&self) -> Value {
        let knots = match self.curves.len() {
            1 => self.invariants(),
            _ => Vec::new(),
        };
        json!({
            "curves": self.curves,
            "crossings": self.crossings(),
            "projected": self.projected(),
            "moves": self.moves,
            "signs": self.signs,
            "pd": self.pd_code(),
            "gauss": self.gauss_code(),
            "dt": self.dt_code(),
            "determinant": self.link_determinant(),
            "knots": knots,
            "links": self.links(),
            "triples": self.triples(),
        })
    }

    /// Returns the number of crossings before the moves.
    fn projected(&self) -> u64 {
        self.crossings() as u64 + self.moves[0] + 2 * self.moves[1]
    }
}

impl fmt::Display for Diagram {
    /// Writes the numbers of crossings, and the invariants: of the knot, or of the link.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: ", words_of_curves(&self.curves))?;
        write!(f, "{}", plural(self.crossings() as u64, "crossing"))?;
        let moves = self.moves[0] + self.moves[1];
        if moves > 0 {
            let moves = plural(moves, "Reidemeister move");
            write!(f, " ({} in the projection, {moves})", self.projected())?;
        }
        if self.curves.len() == 1 {
            return write!(f, "; {}", self.invariants()[0]);
        }
        write!(f, "; determinant {}", words(self.link_determinant()))?;
        match self.links().len() {
            0 => write!(f, ", no linking numbers")?,
            n => write!(f, ", {}", plural(n as u64, "linking number"))?,
        }
        let mut triples = self.triples().into_iter();
        triples.try_for_each(|triple| write!(f, ", {triple}"))
    }
}

/// Returns curves as the subject of a sentence.
fn words_of_curves(curves: &[u32]) -> String {
    match curves {
        [one] => format!("curve {one}"),
        [first, .., last] if curves.len() > MOST_NAMED => {
            format!("{} curves from {first} to {last}", curves.len())
        }
        _ => {
            let curves: Vec<String> = curves.iter().map(u32::to_string).collect();
            format!("curves {}", curves.join(", "))
        }
    }
}

impl fmt::Display for Invariants {
    /// Writes the numbers and the name.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (v2, v3) = (self.v2, words(self.v3));
        let determinant = words(self.determinant.as_ref());
        write!(f, "v2 {v2}, v3 {v3}, determinant {determinant}")?;
        match &self.name {
            Some(name) => write!(f, ": {name}"),
            None => Ok(()),
        }
    }
}

/// Returns a number in words.
fn words(number: Option<impl fmt::Display>) -> String {
    number.map_or("not computed".into(), |number| number.to_string())
}
