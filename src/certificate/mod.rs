//! Certificate of the topology of a frame: the sparse matrix of linking numbers, its file format,
//! its comparison.

mod compare;
mod file;

pub use compare::Comparison;

use crate::verdict::{Defect, Link};

/// All linking numbers of a frame: the sparse upper triangular linking matrix (Qu & James 2021,
/// section 3).
///
/// A pair that is listed neither in [`Certificate::links`] nor in [`Certificate::undefined`] has
/// the proven linking number 0.
///
/// ```
/// use linkwatch::Verifier;
/// use linkwatch::scenes::Scene;
///
/// let built = "chainmail:rows=2,columns=2".parse::<Scene>()?.build()?;
/// let mut verifier = Verifier::default();
/// let (certificate, _) = verifier.certify(&built.curves);
/// assert!(certificate.compare(&built.certificate)?.changes.is_empty());
/// # Ok::<(), linkwatch::Error>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
#[must_use]
pub struct Certificate {
    /// Number of curves.
    pub curves: usize,
    /// Nonzero linking numbers, sorted by `(i, j)`.
    pub links: Vec<Link>,
    /// Pairs and curves without a linking number (contact, too close, degenerate), sorted; see
    /// [`Defect`].
    pub undefined: Vec<Defect>,
}

impl Certificate {
    /// Returns this certificate with the entries of these pairs, which must be sorted, replaced by
    /// those of another certificate.
    pub(crate) fn with_replaced(&self, pairs: &[(u32, u32)], by: &Certificate) -> Certificate {
        let mut out = self.filtered(|i, j| j.is_none_or(|j| pairs.binary_search(&(i, j)).is_err()));
        out.links.extend_from_slice(&by.links);
        out.links.sort_unstable_by_key(|l| (l.i, l.j));
        out.undefined.extend_from_slice(&by.undefined);
        out.undefined.sort_by_key(|d| (d.i, d.j));
        out.undefined.dedup_by_key(|d| (d.i, d.j));
        out
    }

    /// Returns true if a curve has no linking number with any other.
    pub(crate) fn has_degenerate_curves(&self) -> bool {
        self.undefined.iter().any(|d| d.j.is_none())
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

    /// Withdraws the linking numbers of pairs that turned out not to be proven.
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
