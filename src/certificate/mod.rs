//! Certificate of the topology of a frame: the sparse matrix of linking numbers, its file format,
//! its comparison.

mod compare;
mod file;
mod images;

pub use compare::Comparison;
pub(crate) use file::undefined_entry;
pub(crate) use images::{Differences, no_baseline};

use crate::curve::Image;
use crate::verdict::{Defect, ImageLink, Link};

/// All linking numbers of a frame: the sparse upper triangular linking matrix (Qu & James 2021,
/// section 3).
///
/// A pair that is listed neither in [`Certificate::links`] nor in [`Certificate::undefined`] has
/// the proven linking number 0.
///
/// ```
/// use linkwatch::Certifier;
/// use linkwatch::scenes::Scene;
///
/// let built = "chainmail:rows=2,columns=2".parse::<Scene>()?.build()?;
/// let mut certifier = Certifier::default();
/// let (certificate, _) = certifier.certify(&built.curves);
/// assert!(certificate.compare(&built.certificate)?.changes.is_empty());
/// # Ok::<(), linkwatch::Error>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[must_use]
pub struct Certificate {
    /// Number of curves.
    pub curves: usize,
    /// Nonzero linking numbers, sorted by `(i, j)`.
    pub links: Vec<Link>,
    /// Pairs and curves without a linking number (contact, too close, degenerate), sorted; see
    /// [`Defect`]. In periodic scenes, also pairs of a curve and an image ([`Defect::image`]).
    pub undefined: Vec<Defect>,
    /// For periodic scenes ([`Cell`](crate::Cell)): the linking numbers of curves with images of
    /// other curves and of themselves that are not 0, sorted. `None`: the scene is not periodic.
    ///
    /// The coordinates of a curve may be those of any of its images, and the translations depend on
    /// that. [`Certificate::compare`] finds out which belong together.
    pub images: Option<Vec<ImageLink>>,
    /// For periodic scenes: the curves that run through the cell, sorted, and the period of each.
    /// The translations of their entries count up to multiples of it.
    #[serde(default)]
    pub periods: Vec<(u32, Image)>,
}

/// Returns true if sums and multiples of a translation do not overflow.
fn is_near(image: Image) -> bool {
    image.iter().all(|n| n.unsigned_abs() <= 1 << 20)
}

impl Certificate {
    /// Returns this certificate with the entries of these pairs, which must be sorted, replaced by
    /// those of another certificate.
    pub(crate) fn with_replaced(&self, pairs: &[(u32, u32)], by: &Certificate) -> Certificate {
        let keep = |i: u32, j: u32| pairs.binary_search(&(i, j)).is_err();
        let links = self.links.iter().filter(|l| keep(l.i, l.j));
        let undefined = self.undefined.iter();
        let undefined = undefined.filter(|d| d.j.is_none_or(|j| keep(d.i, j)));
        let mut out = Certificate {
            curves: self.curves,
            links: links.chain(&by.links).copied().collect(),
            undefined: undefined.chain(&by.undefined).copied().collect(),
            ..Certificate::default()
        };
        out.sort();
        out
    }

    /// Returns true if a curve has no linking number with any other.
    pub(crate) fn has_degenerate_curves(&self) -> bool {
        self.undefined.iter().any(|d| d.j.is_none())
    }

    /// Returns this certificate for other curves, of which `origins` has the indices in this one.
    /// Curves without an origin have linking number 0 with all others.
    pub(crate) fn with_curves(&self, origins: &[Option<u32>]) -> Certificate {
        let mut index = vec![None; self.curves];
        for (i, origin) in (0_u32..).zip(origins) {
            if let Some(origin) = origin {
                index[*origin as usize] = Some(i);
            }
        }
        let index = |i: u32| index[i as usize];
        let links = self.links.iter().filter_map(|l| {
            let (i, j) = (index(l.i)?, index(l.j)?);
            Some(Link {
                i: i.min(j),
                j: i.max(j),
                ..*l
            })
        });
        let undefined = self.undefined.iter().filter_map(|d| {
            let i = index(d.i)?;
            let Some(j) = d.j else {
                return Some(Defect { i, ..*d });
            };
            let j = index(j)?;
            let mut defect = Defect {
                i: i.min(j),
                j: Some(i.max(j)),
                ..*d
            };
            if i > j {
                defect.place.segments.reverse();
            }
            Some(defect)
        });
        let mut out = Certificate {
            curves: origins.len(),
            links: links.collect(),
            undefined: undefined.collect(),
            ..Certificate::default()
        };
        out.sort();
        out
    }

    /// Adds the entries of the pairs with one of these curves, sorted, from another certificate.
    pub(crate) fn adopt_curves(&mut self, curves: &[u32], from: &Certificate) {
        let has = |i: u32| curves.binary_search(&i).is_ok();
        let links = from.links.iter().filter(|l| has(l.i) || has(l.j));
        self.links.extend(links);
        for d in &from.undefined {
            match d.j {
                _ if has(d.i) => self.undefined.push(*d),
                Some(j) if has(j) => self.undefined.push(*d),
                Some(_) => {}
                // The other linking numbers of this curve are known from earlier frames.
                None => self.undefined.extend(d.with_each_of(curves)),
            }
        }
        self.sort();
    }

    /// Sorts all entries. Of several of one pair, the first one stays.
    fn sort(&mut self) {
        self.links.sort_by_key(|l| (l.i, l.j));
        self.links.dedup_by_key(|l| (l.i, l.j));
        self.undefined.sort_by_key(|d| (d.i, d.j, d.image));
        self.undefined.dedup_by_key(|d| (d.i, d.j, d.image));
    }

    /// Withdraws the linking numbers of pairs that turned out not to be proven.
    pub fn withdraw(&mut self, defects: impl IntoIterator<Item = Defect>) {
        self.undefined.extend(defects);
        self.sort();
        let undefined = &self.undefined;
        self.links.retain(|l| {
            let key = (l.i, Some(l.j));
            let found = undefined.binary_search_by_key(&key, |d| (d.i, d.j));
            found.is_err()
        });
    }
}
