//! Results of counting crossings for a list of pairs.

use super::Linking;
use crate::pairs::Pair;
use crate::verdict::{Defect, Link, Stats};

/// Linking numbers of consecutive pairs of a list, in their order.
#[derive(Debug, Default)]
pub(crate) struct Counted {
    /// Pairs whose linking number is not 0.
    pub links: Vec<Link>,
    /// Pairs whose linking number is undefined.
    pub undefined: Vec<Defect>,
    /// Work counters.
    pub stats: Stats,
}

impl Counted {
    /// Clears the results, so that the buffers can be reused.
    pub fn clear(&mut self) {
        self.links.clear();
        self.undefined.clear();
        self.stats = Stats::default();
    }

    /// Concatenates the results of consecutive parts of a list.
    #[cfg(test)]
    pub fn joined(parts: Vec<Counted>) -> Counted {
        parts.into_iter().fold(Counted::default(), |mut all, part| {
            all.links.extend(part.links);
            all.undefined.extend(part.undefined);
            all.stats.add(&part.stats);
            all
        })
    }

    /// Appends the result of a pair.
    pub fn add(&mut self, pair @ (i, j): Pair, linking: Linking) {
        match linking {
            Linking::Number(0) => {}
            Linking::Number(lambda) => self.links.push(Link { i, j, lambda }),
            Linking::Undefined(kind, place) => {
                self.undefined.push(Defect::of_pair(pair, kind, place));
            }
        }
    }
}
