//! The certificate of a frame's topology: the sparse matrix of linking numbers, its file, its comparison.

mod compare;
mod file;

pub use compare::{Change, ChangeKind, Comparison};

use crate::verdict::Defect;

/// A non-zero entry of the linking matrix.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize)]
pub struct Link {
    /// First curve, from 0; less than `j`.
    pub i: u32,
    /// Second curve.
    pub j: u32,
    /// Their linking number, never 0.
    pub lambda: i64,
}

/// All linking numbers of a frame: the sparse upper triangular linking matrix (Qu & James 2021, section 3).
///
/// Pairs that are listed neither in [`Certificate::links`] nor in [`Certificate::undefined`] have the linking
/// number 0, proven.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct Certificate {
    /// Number of curves.
    pub curves: usize,
    /// Non-zero linking numbers, sorted by `(i, j)`.
    pub links: Vec<Link>,
    /// What has no linking number (touching, too close, degenerate), sorted; see [`Defect`].
    pub undefined: Vec<Defect>,
}

impl Certificate {
    /// Takes the numbers of these pairs back: they turned out not to be proven.
    pub fn withdraw(&mut self, defects: impl IntoIterator<Item = Defect>) {
        self.undefined.extend(defects);
        self.undefined.sort_by_key(|d| (d.i, d.j));
        self.undefined.dedup_by_key(|d| (d.i, d.j));
        let Certificate {
            links, undefined, ..
        } = self;
        links.retain(|l| {
            let key = (l.i, Some(l.j));
            undefined
                .binary_search_by_key(&key, |d| (d.i, d.j))
                .is_err()
        });
    }
}
