//! Diagrams as text and as JSON.

use super::{Diagram, Invariants, TripleLink};
use crate::verdict::Link;
use crate::words::plural;
use serde_json::{Value, json};
use std::fmt;

/// Maximum number of curves of a group that are listed by their numbers.
const MOST_NAMED: usize = 12;

/// Invariants of a diagram that are in its words or its JSON.
struct Facts {
    /// Invariants of the curve, if there is only one.
    knot: Option<Invariants>,
    determinant: Option<String>,
    links: Vec<Link>,
    triples: Vec<TripleLink>,
}

impl Diagram {
    /// Returns the diagram with its codes and all its invariants as JSON. If it has only one
    /// curve, `knots` has the invariants of that curve.
    pub fn to_json(&self) -> Value {
        self.json(self.facts())
    }

    /// Returns [`Diagram::to_json`] and the words, from invariants that are computed once.
    pub fn to_json_and_words(&self) -> (Value, String) {
        let facts = self.facts();
        let text = self.text(&facts);
        (self.json(facts), text)
    }

    fn facts(&self) -> Facts {
        let is_knot = self.curves.len() == 1;
        let knot = is_knot.then(|| self.invariants().remove(0));
        Facts {
            determinant: match &knot {
                Some(knot) => knot.determinant.clone(),
                None => self.link_determinant(),
            },
            knot,
            links: self.links(),
            triples: self.triples(),
        }
    }

    fn json(&self, facts: Facts) -> Value {
        json!({
            "curves": self.curves,
            "crossings": self.crossings(),
            "projected": self.projected(),
            "moves": self.moves,
            "signs": self.signs,
            "pd": self.pd_code(),
            "gauss": self.gauss_code(),
            "dt": self.dt_code(),
            "determinant": facts.determinant,
            "knots": facts.knot.as_slice(),
            "links": facts.links,
            "triples": facts.triples,
        })
    }

    /// Returns the numbers of crossings, and the invariants: of the knot, or of the link.
    fn text(&self, facts: &Facts) -> String {
        let crossings = plural(self.crossings() as u64, "crossing");
        let mut text = format!("{}: {crossings}", words_of_curves(&self.curves));
        let moves = self.moves[0] + self.moves[1];
        if moves > 0 {
            let moves = plural(moves, "Reidemeister move");
            text += &format!(" ({} in the projection, {moves})", self.projected());
        }
        if let Some(knot) = &facts.knot {
            return text + &format!("; {knot}");
        }
        text += &format!("; determinant {}", words(facts.determinant.as_ref()));
        text += &match facts.links.len() {
            0 => ", no linking numbers".into(),
            n => format!(", {}", plural(n as u64, "linking number")),
        };
        for triple in &facts.triples {
            text += &format!(", {triple}");
        }
        text
    }

    /// Returns the number of crossings before the moves.
    fn projected(&self) -> u64 {
        self.crossings() as u64 + self.moves[0] + 2 * self.moves[1]
    }
}

impl fmt::Display for Diagram {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text(&self.facts()))
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

/// Returns a number as text.
fn words(number: Option<impl fmt::Display>) -> String {
    number.map_or("not computed".into(), |number| number.to_string())
}
