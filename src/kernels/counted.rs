//! What counting found of some pairs.

use super::Linking;
use crate::certificate::Link;
use crate::pairs::Pair;
use crate::verdict::{Defect, Stats};

/// Linking numbers of consecutive pairs of a list, in their order.
#[derive(Debug, Default)]
pub(crate) struct Counted {
    /// Those that are not 0.
    pub links: Vec<Link>,
    /// Pairs that have none.
    pub undefined: Vec<Defect>,
    /// The work.
    pub stats: Stats,
}

impl Counted {
    /// Makes it ready for other pairs.
    pub fn clear(&mut self) {
        self.links.clear();
        self.undefined.clear();
        self.stats = Stats::default();
    }

    /// Parts that follow one another, as one.
    #[cfg(any(test, feature = "gpu"))]
    pub fn joined(parts: Vec<Counted>) -> Counted {
        parts.into_iter().fold(Counted::default(), |mut all, part| {
            all.links.extend(part.links);
            all.undefined.extend(part.undefined);
            all.stats.add(&part.stats);
            all
        })
    }

    /// Adds a pair.
    pub fn add(&mut self, (i, j): Pair, linking: Linking) {
        match linking {
            Linking::Number(0) => {}
            Linking::Number(lambda) => self.links.push(Link { i, j, lambda }),
            Linking::Undefined(kind, place) => self.undefined.push(Defect {
                i,
                j: Some(j),
                kind,
                place,
            }),
        }
    }
}
