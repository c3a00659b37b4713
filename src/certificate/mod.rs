//! Certificate of the topology of a frame: the sparse matrix of linking numbers, its file format,
//! its comparison.

mod compare;
mod file;
mod higher;
mod images;

pub use compare::Comparison;
pub(crate) use file::undefined_entry;
#[cfg(feature = "mcap")]
pub(crate) use higher::{invariant_lines, parse_invariant};
pub(crate) use images::{Differences, no_baseline};

use crate::curve::{CurveSet, Image};
use crate::diagram::{HigherInvariants, InvariantKind};
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
    pub(crate) curves: usize,
    pub(crate) links: Vec<Link>,
    pub(crate) undefined: Vec<Defect>,
    pub(crate) images: Option<Vec<ImageLink>>,
    #[serde(default)]
    pub(crate) periods: Vec<(u32, Image)>,
    /// Invariants of curves and of triples, if they were requested.
    #[serde(default, rename = "invariants")]
    pub(crate) higher: Vec<HigherInvariants>,
}

/// Returns true if sums and multiples of a translation do not overflow.
fn is_near(image: Image) -> bool {
    image.iter().all(|n| n.unsigned_abs() <= 1 << 20)
}

impl Certificate {
    /// Returns the certificate with these linking numbers that are not 0, and with these pairs and
    /// curves without a linking number. All other pairs have the linking number 0.
    pub fn new(curves: usize, links: Vec<Link>, undefined: Vec<Defect>) -> Certificate {
        let mut certificate = Certificate {
            curves,
            links,
            undefined,
            ..Certificate::default()
        };
        certificate.sort();
        certificate
    }

    /// Returns the number of curves.
    pub fn curves(&self) -> usize {
        self.curves
    }

    /// Returns the nonzero linking numbers, sorted by `(i, j)`.
    pub fn links(&self) -> &[Link] {
        &self.links
    }

    /// Returns the pairs and curves without a linking number (contact, too close, degenerate),
    /// sorted. In periodic scenes, also pairs of a curve and an image ([`Defect::image`]).
    pub fn undefined(&self) -> &[Defect] {
        &self.undefined
    }

    /// Returns the linking numbers that are not 0 of curves with images of other curves and of
    /// themselves, sorted; `None` if the scene is not periodic ([`Cell`](crate::Cell)).
    ///
    /// The coordinates of a curve may be those of any of its images, and the translations depend on
    /// that. [`Certificate::compare`] finds which translations correspond.
    pub fn images(&self) -> Option<&[ImageLink]> {
        self.images.as_deref()
    }

    /// Returns the curves that run through a periodic cell, sorted, and the period of each. The
    /// translations of their entries count up to multiples of it.
    pub fn periods(&self) -> &[(u32, Image)] {
        &self.periods
    }

    /// Returns the number of curves that run through the cell and have no linking number with one
    /// another: all of them, or 0 if there is only one.
    pub fn periods_without_numbers(&self) -> usize {
        match self.periods.len() {
            1 => 0,
            through => through,
        }
    }

    /// Adds invariants of one kind of the curves of the frame. Returns the reasons why curves have
    /// none, except for pairs and curves that have no linking number either.
    ///
    /// # Panics
    ///
    /// If the set has another number of curves.
    pub fn add_invariants(&mut self, set: &CurveSet, kind: InvariantKind) -> Vec<Defect> {
        assert_eq!(set.len(), self.curves, "the curves of the certificate");
        let (found, mut defects) = HigherInvariants::of(set, kind);
        defects.retain(|d| !self.has_no_number(d.i, d.j));
        self.higher.retain(|other| other.kind != kind);
        self.higher.push(found);
        defects
    }

    /// Returns the number of curves or triples with an invariant that was not computed, because
    /// there are too many crossings.
    #[cfg(feature = "cli")]
    pub(crate) fn uncomputed(&self) -> usize {
        self.higher.iter().map(HigherInvariants::uncomputed).sum()
    }

    /// Returns the kinds of invariants that the certificate has beside linking numbers.
    pub fn invariants(&self) -> impl Iterator<Item = InvariantKind> + '_ {
        self.higher.iter().map(|found| found.kind)
    }

    /// Returns this certificate with the entries of these pairs, which must be sorted, replaced by
    /// those of another certificate.
    pub(crate) fn with_replaced(&self, pairs: &[(u32, u32)], by: &Certificate) -> Certificate {
        let keep = |i: u32, j: u32| pairs.binary_search(&(i, j)).is_err();
        let links = self.links.iter().filter(|l| keep(l.i, l.j));
        let undefined = self.undefined.iter();
        let undefined = undefined.filter(|d| d.j.is_none_or(|j| keep(d.i, j)));
        let links = links.chain(&by.links).copied().collect();
        let undefined = undefined.chain(&by.undefined).copied().collect();
        Certificate::new(self.curves, links, undefined)
    }

    /// Returns the first curve with this property that must be closed: it has a linking number or
    /// an invariant that is not trivial, and is no yarn through a cell.
    pub(crate) fn closed_curve_that(&self, is_wanted: impl Fn(u32) -> bool) -> Option<usize> {
        let links = self.links.iter().map(|l| [l.i, l.j]);
        let images = self.images.iter().flatten().map(|l| [l.i, l.j]);
        let higher = self.higher.iter().flat_map(|of| &of.numbers);
        let higher = higher.flat_map(|(curves, _)| curves.iter().copied());
        let is_yarn = |i| self.periods.binary_search_by_key(&i, |p| p.0).is_ok();
        let mut curves = links.chain(images).flatten().chain(higher);
        let found = curves.find(|&i| is_wanted(i) && !is_yarn(i));
        found.map(|i| i as usize)
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
            let (mut defect, i) = (*d, index(d.i)?);
            defect.i = i;
            if let Some(j) = d.j {
                let j = index(j)?;
                (defect.i, defect.j) = (i.min(j), Some(i.max(j)));
                if i > j {
                    defect.place.segments.reverse();
                }
            }
            Some(defect)
        });
        Certificate::new(origins.len(), links.collect(), undefined.collect())
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
        Defect::sort(&mut self.undefined);
        self.undefined.dedup_by_key(|d| (d.i, d.j, d.image));
    }
}
