//! Linking numbers with periodic images, and their comparison.

use super::{Certificate, Comparison, undefined_entry};
use crate::curve::{Image, is_home};
use crate::error::{Error, Result};
use crate::periodic::{Entry, ImagePair, aligned, reduced_all};
use crate::verdict::{Change, Defect, DefectKind, ImageLink, Link};
use std::iter::Peekable;

/// Differences of two lists of entries. Pairs that are not in a list have the number 0.
pub(crate) struct Differences {
    /// Other numbers, sorted by pair.
    pub changes: Vec<Change>,
    /// Numbers of pairs that had none before, sorted.
    pub fresh: Vec<(ImagePair, i64)>,
}

impl Differences {
    /// Compares sorted lists.
    pub fn between(
        before: impl IntoIterator<Item = Entry>,
        now: impl IntoIterator<Item = Entry>,
    ) -> Differences {
        let (mut before, mut now) = (before.into_iter().peekable(), now.into_iter().peekable());
        let (mut changes, mut fresh) = (Vec::new(), Vec::new());
        loop {
            let next = [before.peek(), now.peek()].into_iter().flatten();
            let Some(pair) = next.map(|entry| entry.0).min() else {
                return Differences { changes, fresh };
            };
            let ImagePair { i, j, image } = pair;
            match [number(&mut before, pair), number(&mut now, pair)] {
                [None, Some(lambda)] => fresh.push((pair, lambda)),
                [Some(expected), Some(found)] if expected != found => changes.push(Change {
                    i,
                    j,
                    image,
                    expected,
                    found,
                    place: None,
                }),
                // A pair without a number has a separate entry as a defect.
                _ => {}
            }
        }
    }
}

/// Consumes the entries of a pair and returns the linking number of the last one; 0 if there is no
/// entry.
fn number(entries: &mut Peekable<impl Iterator<Item = Entry>>, pair: ImagePair) -> Option<i64> {
    let of_pair = std::iter::from_fn(|| entries.next_if(|entry| entry.0 == pair));
    of_pair.last().map_or(Some(0), |(_, lambda)| lambda)
}

/// Returns the defect of a pair that has a number now, but none to compare with.
pub(crate) fn no_baseline(ImagePair { i, j, image }: ImagePair) -> Defect {
    Defect {
        kind: DefectKind::NoBaseline,
        ..undefined_entry(i, Some(j), image)
    }
}

impl Link {
    /// Returns the entry of this pair of curves.
    pub(super) fn entry(&self) -> Entry {
        let (i, j, image) = (self.i, self.j, Image::default());
        (ImagePair { i, j, image }, Some(self.lambda))
    }
}

impl Certificate {
    /// Returns the entries of all pairs of a periodic scene, sorted; `None` if it is not periodic.
    pub(crate) fn entries(&self) -> Option<Vec<Entry>> {
        let images = self.images.as_ref()?;
        let links = self.links.iter().map(Link::entry);
        let undefined = self.undefined.iter();
        let undefined = undefined.filter_map(|d| Some((d.pair()?, None)));
        let images = images.iter().map(|l| {
            let (i, j, image) = (l.i, l.j, l.image);
            (ImagePair { i, j, image }, Some(l.lambda))
        });
        let mut all: Vec<Entry> = links.chain(undefined).chain(images).collect();
        all.sort_unstable();
        Some(all)
    }

    /// Returns this certificate with other entries of pairs, sorted, of a periodic scene. For pairs
    /// without a number, takes the kind and the place from this certificate or from `others`.
    pub(crate) fn with_entries(&self, entries: &[Entry], others: &[Defect]) -> Certificate {
        let mut out = Certificate {
            curves: self.curves,
            periods: self.periods.clone(),
            ..Certificate::default()
        };
        let mut images = Vec::new();
        for &(ImagePair { i, j, image }, lambda) in entries {
            match (image == Image::default(), lambda) {
                (false, Some(lambda)) => images.push(ImageLink {
                    i,
                    j,
                    image,
                    lambda,
                }),
                (true, Some(lambda)) => out.links.push(Link { i, j, lambda }),
                (_, None) => {
                    let mut known = self.undefined.iter().chain(others);
                    let known = known.find(|d| d.pair() == Some(ImagePair { i, j, image }));
                    let unknown = || undefined_entry(i, Some(j), image);
                    out.undefined.push(known.copied().unwrap_or_else(unknown));
                }
            }
        }
        let curves = self.undefined.iter().filter(|d| d.j.is_none());
        out.undefined.extend(curves);
        Defect::sort(&mut out.undefined);
        out.images = Some(images);
        out
    }

    /// Returns this baseline under the names that a frame has for the images of the curves.
    ///
    /// # Errors
    ///
    /// [`Error::Usage`] if the frame has other yarns, or yarns with other periods.
    pub(crate) fn aligned_with(&self, frame: &Certificate) -> Result<Certificate> {
        let (Some(baseline), Some(now)) = (self.entries(), frame.entries()) else {
            return Ok(self.clone());
        };
        let known = &self.periods;
        if *known != frame.periods {
            let both = known.iter().chain(&frame.periods);
            let of = |c: &Certificate, i: u32| c.periods.iter().find(|p| p.0 == i).map(|p| p.1);
            let mut curves = both.map(|&(i, _)| (i, of(self, i), of(frame, i)));
            let words = |period: Option<Image>| match period {
                Some([n1, n2, n3]) => {
                    format!("runs through the cell with the period {n1},{n2},{n3}")
                }
                None => "does not run through the cell".to_owned(),
            };
            let other = curves.find(|(_, before, now)| before != now);
            let (i, before, now) = other.unwrap_or_default();
            let (before, now) = (words(before), words(now));
            let what = format!("curve {i} {before} in the baseline, but it {now}");
            return Err(Error::Usage(what));
        }
        let entries = aligned(self.curves, &baseline, &now, &frame.periods);
        Ok(self.with_entries(&entries, &[]))
    }

    /// [`Certificate::compare`] of periodic scenes.
    pub(super) fn compare_periodic(&self, baseline: &Certificate) -> Result<Comparison> {
        let baseline = baseline.aligned_with(self)?;
        let (Some(before), Some(now)) = (baseline.entries(), self.entries()) else {
            let what = match baseline.images {
                Some(_) => "the baseline is of a periodic scene, but the frame has no cell",
                None => "the baseline is not of a periodic scene, but the frame has a cell",
            };
            return Err(Error::Usage(what.into()));
        };
        let now = reduced_all(&now, &self.periods);
        let without = |i: u32| self.has_no_number(i, None) || baseline.has_no_number(i, None);
        let found = Differences::between(before, now);
        let (mut changes, mut fresh) = (found.changes, found.fresh);
        changes.retain(|c| !without(c.i) && !without(c.j));
        fresh.retain(|(pair, _)| !without(pair.i) && !without(pair.j));
        let own = fresh.iter().filter(|e| is_home(&e.0.image) && e.1 != 0);
        let adopted = own.map(|&(ImagePair { i, j, .. }, lambda)| Link { i, j, lambda });
        let adopted = adopted.collect();
        let mut defects = self.undefined.clone();
        defects.extend(fresh.iter().map(|(pair, _)| no_baseline(*pair)));
        defects.extend(self.fresh(&baseline).filter(|d| d.j.is_none()));
        Defect::sort(&mut defects);
        Ok(Comparison {
            changes,
            defects,
            adopted,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rejects_translations_whose_sums_would_overflow() {
        for line in ["0,1,-2147483648,0,0,1", "0,,2000000,0,0,period"] {
            let text = format!("periodic 2\n{line}\n");
            assert!(Certificate::parse(&text).is_err(), "{line}");
        }
    }

    #[test]
    fn certificates_of_the_same_periodic_topology_are_equal_under_other_names() {
        let text = "periodic 3\n0,1,0,0,0,1\n1,2,0,0,0,1\n0,2,1,0,0,1\n";
        let baseline = Certificate::parse(text).unwrap();
        // Curve 1 is moved by a lattice vector.
        let moved = "periodic 3\n0,1,0,-1,0,1\n1,2,0,1,0,1\n0,2,1,0,0,1\n";
        let moved = Certificate::parse(moved).unwrap();
        assert_ne!(moved.entries(), baseline.entries());
        assert_eq!(moved.to_string(), baseline.to_string());
        assert!(moved.compare(&baseline).unwrap().changes.is_empty());
        let broken = "periodic 3\n0,1,0,-1,0,1\n1,2,0,1,0,1\n0,2,0,0,0,1\n";
        let broken = Certificate::parse(broken).unwrap();
        let changes = broken.compare(&baseline).unwrap().changes;
        assert!(!changes.is_empty());
        assert!(changes.iter().all(|c| (c.i, c.j) != (0, 0)));
    }

    #[test]
    fn a_periodic_and_a_plain_certificate_are_not_compared() {
        let [periodic, plain] = ["periodic 3\n", "3\n"].map(Certificate::parse);
        let (periodic, plain) = (periodic.unwrap(), plain.unwrap());
        for (a, b) in [(&periodic, &plain), (&plain, &periodic)] {
            let e = a.compare(b).unwrap_err().to_string();
            assert!(e.contains("periodic scene"), "{e}");
        }
    }
}
