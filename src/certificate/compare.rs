//! Comparison of two certificates: lost, gained and changed links.

use super::{Certificate, Differences};
use crate::curve::Image;
use crate::error::{Error, Result};
use crate::pairs::Pair;
use crate::verdict::{Change, Defect, DefectKind, Link};

/// Result of comparing a frame with its baseline.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
#[must_use]
pub struct Comparison {
    /// Pairs with different linking numbers, sorted.
    pub changes: Vec<Change>,
    /// Pairs that could not be compared, sorted: those without a linking number in the frame, and
    /// those that have one now but had none in the baseline.
    pub defects: Vec<Defect>,
    /// Nonzero linking numbers of pairs that had none in the baseline, sorted.
    pub adopted: Vec<Link>,
}

impl Comparison {
    /// Returns this comparison with other numbers of the curves. `None` if a pair with a finding
    /// has none.
    pub(crate) fn renamed(&self, pair: impl Fn(Pair) -> Option<Pair>) -> Option<Comparison> {
        let mut out = self.clone();
        for c in &mut out.changes {
            (c.i, c.j) = pair((c.i, c.j))?;
        }
        for d in &mut out.defects {
            let (i, j) = pair((d.i, d.j.unwrap_or(d.i)))?;
            (d.i, d.j) = (i, d.j.map(|_| j));
        }
        for l in &mut out.adopted {
            (l.i, l.j) = pair((l.i, l.j))?;
        }
        Some(out)
    }

    /// Returns true if the frame has linking numbers that the baseline lacks.
    pub(crate) fn has_fresh(&self) -> bool {
        let is_fresh = |d: &Defect| d.kind == DefectKind::NoBaseline;
        self.defects.iter().any(is_fresh)
    }
}

impl Certificate {
    /// Adds the linking numbers that this baseline lacks, from the first frame that has them.
    /// `comparison` covers all pairs of the frame. Returns true if any number was added.
    pub(crate) fn adopt(&mut self, comparison: &Comparison) -> bool {
        if !comparison.has_fresh() {
            return false;
        }
        let defects = comparison.defects.iter();
        let (fresh, others): (Vec<&Defect>, Vec<&Defect>) =
            defects.partition(|d| d.kind == DefectKind::NoBaseline);
        let has = |i: u32, j: Option<u32>| fresh.iter().any(|d| (d.i, d.j) == (i, j));
        self.undefined.retain(|d| !has(d.i, d.j));
        // A curve that has linking numbers again may still touch another curve, or may be paired
        // with a curve without linking numbers.
        let curves = fresh.iter().filter(|d| d.j.is_none()).map(|d| d.i);
        let curves: Vec<u32> = curves.collect();
        for d in others {
            match d.j {
                Some(j) if has(d.i, None) || has(j, None) => self.undefined.push(*d),
                Some(_) => {}
                None => self.undefined.extend(d.with_each_of(&curves)),
            }
        }
        self.links.extend_from_slice(&comparison.adopted);
        self.sort();
        true
    }

    /// Returns true if the pair, or one of its curves, has no linking number here.
    pub(crate) fn has_no_number(&self, i: u32, j: Option<u32>) -> bool {
        is_undefined(&self.undefined, i, j)
    }

    /// Returns a defect for each pair and curve that has no linking number in the baseline, but one
    /// here.
    pub(super) fn fresh(&self, baseline: &Certificate) -> impl Iterator<Item = Defect> {
        let known = baseline.undefined.iter();
        let known = known.filter(|d| !self.has_no_number(d.i, d.j));
        known.map(|d| Defect {
            kind: DefectKind::NoBaseline,
            ..*d
        })
    }

    /// Compares this frame with its baseline.
    ///
    /// A pair without a linking number on either side is not compared, but reported.
    /// [`Comparison::adopted`] has the numbers that the baseline lacks.
    ///
    /// In periodic scenes, the images that the coordinates belong to do not matter.
    ///
    /// # Errors
    ///
    /// [`Error::CertificateMismatch`] if the numbers of curves differ; [`Error::Usage`] if only one
    /// certificate is of a periodic scene.
    pub fn compare(&self, baseline: &Certificate) -> Result<Comparison> {
        self.compare_except(baseline, &[])
    }

    /// [`Certificate::compare`] without the pairs `unchecked`, which must be sorted: they were not
    /// computed.
    pub(crate) fn compare_except(
        &self,
        baseline: &Certificate,
        unchecked: &[(u32, u32)],
    ) -> Result<Comparison> {
        if self.curves != baseline.curves {
            let (certificate, model) = (baseline.curves, self.curves);
            return Err(Error::CertificateMismatch { certificate, model });
        }
        if self.images.is_some() || baseline.images.is_some() {
            return self.compare_periodic(baseline);
        }
        let checked = |i: u32, j: u32| unchecked.binary_search(&(i, j)).is_err();
        let mut defects = self.undefined.clone();
        let fresh = self.fresh(baseline);
        defects.extend(fresh.filter(|d| d.j.is_none_or(|j| checked(d.i, j))));
        Defect::sort(&mut defects);
        let known = |i: u32, j: u32| !is_undefined(&defects, i, Some(j));
        let [before, now] = [baseline, self].map(|c| c.links.iter().map(Link::entry));
        let mut changes = Differences::between(before, now).changes;
        changes.retain(|c| checked(c.i, c.j) && known(c.i, c.j));
        let adopted = self.links.iter();
        let adopted = adopted.filter(|l| checked(l.i, l.j) && !known(l.i, l.j));
        Ok(Comparison {
            adopted: adopted.copied().collect(),
            changes,
            defects,
        })
    }
}

/// Returns true if the sorted list has the pair, or has one of its curves alone.
fn is_undefined(undefined: &[Defect], i: u32, j: Option<u32>) -> bool {
    let contains = |i, j| {
        let key = (i, j, Image::default());
        let found = undefined.binary_search_by_key(&key, |d| (d.i, d.j, d.image));
        found.is_ok()
    };
    contains(i, j) || contains(i, None) || j.is_some_and(|j| contains(j, None))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::verdict::{ChangeKind, Place};

    fn certificate(links: &[(u32, u32, i64)], undefined: &[(u32, Option<u32>)]) -> Certificate {
        Certificate {
            curves: 9,
            links: links
                .iter()
                .map(|&(i, j, lambda)| Link { i, j, lambda })
                .collect(),
            undefined: undefined
                .iter()
                .map(|&(i, j)| Defect {
                    i,
                    j,
                    image: Default::default(),
                    kind: DefectKind::Contact,
                    place: Place {
                        segments: [0, 0],
                        point: [0.0; 3],
                        distance: 0.0,
                    },
                })
                .collect(),
            images: None,
            periods: Vec::new(),
            higher: Vec::new(),
        }
    }

    #[test]
    fn distinguishes_lost_gained_and_changed_links() {
        let before = certificate(&[(0, 1, 1), (0, 3, 2), (5, 6, -1)], &[]);
        let after = certificate(&[(0, 3, 3), (2, 4, 1), (5, 6, -1)], &[]);
        let c = after.compare(&before).unwrap();
        let seen: Vec<_> = c
            .changes
            .iter()
            .map(|c| (c.i, c.j, c.expected, c.found, c.kind()))
            .collect();
        assert_eq!(
            seen,
            [
                (0, 1, 1, 0, ChangeKind::Lost),
                (0, 3, 2, 3, ChangeKind::Changed),
                (2, 4, 0, 1, ChangeKind::Gained),
            ]
        );
        assert!(c.defects.is_empty());
        assert!(before.compare(&before).unwrap().changes.is_empty());
    }

    #[test]
    fn a_pair_without_a_linking_number_is_reported_and_hides_no_other() {
        let before = certificate(&[(0, 1, 1), (2, 3, 1)], &[(4, Some(5))]);
        let after = certificate(&[(4, 5, 1)], &[(0, Some(1))]);
        let c = after.compare(&before).unwrap();
        assert_eq!(c.changes.len(), 1);
        assert_eq!((c.changes[0].i, c.changes[0].j), (2, 3));
        let kinds: Vec<_> = c.defects.iter().map(|d| (d.i, d.kind)).collect();
        assert_eq!(
            kinds,
            [(0, DefectKind::Contact), (4, DefectKind::NoBaseline)]
        );
    }

    #[test]
    fn a_degenerate_curve_excludes_only_its_pairs() {
        let before = certificate(&[(0, 1, 1), (1, 2, 1), (3, 4, 1)], &[]);
        let after = certificate(&[], &[(1, None)]);
        let c = after.compare(&before).unwrap();
        assert_eq!(c.changes.len(), 1);
        assert_eq!((c.changes[0].i, c.changes[0].j), (3, 4));
    }

    #[test]
    fn no_linking_number_of_a_degenerate_curve_is_adopted() {
        // Curves 1 and 2 touch in the baseline; then curve 1 is degenerate, then it is not.
        let mut baseline = certificate(&[], &[(1, Some(2))]);
        let degenerate = certificate(&[], &[(1, None)]);
        let comparison = degenerate.compare(&baseline).unwrap();
        assert_eq!(comparison.defects, degenerate.undefined);
        assert!(!baseline.adopt(&comparison));
        let linked = certificate(&[(1, 2, 1)], &[]);
        let comparison = linked.compare(&baseline).unwrap();
        assert!(comparison.changes.is_empty(), "{comparison:?}");
        assert_eq!(comparison.adopted.len(), 1);

        // Curve 1 is degenerate in the baseline; it has linking numbers again while curve 2 has
        // none.
        let mut baseline = certificate(&[], &[(1, None)]);
        let comparison = certificate(&[], &[(2, None)]).compare(&baseline).unwrap();
        assert!(baseline.adopt(&comparison));
        let comparison = linked.compare(&baseline).unwrap();
        assert!(comparison.changes.is_empty(), "{comparison:?}");
        assert_eq!(comparison.adopted.len(), 1);
    }

    #[test]
    fn a_curve_that_appears_beside_a_degenerate_one_gets_its_linking_number_later() {
        let mut baseline = certificate(&[], &[]);
        baseline.adopt_curves(&[2], &certificate(&[(2, 5, 1)], &[(1, None)]));
        assert_eq!(baseline.links.len(), 1);
        let comparison = certificate(&[(1, 2, 1), (2, 5, 1)], &[]);
        let comparison = comparison.compare(&baseline).unwrap();
        assert!(comparison.changes.is_empty(), "{comparison:?}");
        assert_eq!(comparison.adopted.len(), 1);
    }

    #[test]
    fn rejects_the_certificate_of_another_model() {
        let a = certificate(&[], &[]);
        let mut b = a.clone();
        b.curves = 8;
        assert!(matches!(
            a.compare(&b),
            Err(Error::CertificateMismatch {
                certificate: 8,
                model: 9
            })
        ));
    }
}
