//! The certificate of a frame's topology: the sparse matrix of linking numbers, its file, its comparison.

mod compare;
mod file;

pub use crate::verdict::{Change, Link};
pub use compare::Comparison;

use crate::verdict::Defect;

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
    /// What it says of these pairs, which are sorted, and of curves that have no numbers at all.
    pub(crate) fn of_pairs(&self, pairs: &[(u32, u32)]) -> Certificate {
        self.filtered(|i, j| j.is_none_or(|j| pairs.binary_search(&(i, j)).is_ok()))
    }

    /// This certificate with what another one says of these pairs, which are sorted.
    pub(crate) fn patched(&self, pairs: &[(u32, u32)], with: &Certificate) -> Certificate {
        let mut out = self.filtered(|i, j| j.is_none_or(|j| pairs.binary_search(&(i, j)).is_err()));
        out.links.extend_from_slice(&with.links);
        out.links.sort_unstable_by_key(|l| (l.i, l.j));
        out.undefined.extend_from_slice(&with.undefined);
        out.undefined.sort_by_key(|d| (d.i, d.j));
        out.undefined.dedup_by_key(|d| (d.i, d.j));
        out
    }

    fn filtered(&self, keep: impl Fn(u32, Option<u32>) -> bool) -> Certificate {
        let links = self.links.iter().filter(|l| keep(l.i, Some(l.j)));
        let undefined = self.undefined.iter().filter(|d| keep(d.i, d.j));
        Certificate {
            curves: self.curves,
            links: links.copied().collect(),
            undefined: undefined.copied().collect(),
        }
    }

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
