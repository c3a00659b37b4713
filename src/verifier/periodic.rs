//! Verification of periodic scenes: an inner verifier has the pairs of a curve and an image of
//! another one, or of itself, and its findings join those of the frame.
//!
//! The outer verifier has the curves as they are given. The inner one has a set of translated curves
//! ([`CurveSet::translate`]), which is the same from frame to frame, so that it is incremental. If
//! other images come near, another set replaces it: the new inner verifier starts with the previous
//! frame, so that no step is left out. All pairs that it adds had boxes apart from one another
//! throughout the earlier frames.

use super::braided::add_work;
use super::{Verifier, VerifierOptions};
use crate::certificate::Certificate;
use crate::curve::{Cell, CurveSet, Image, Point};
use crate::error::{Error, Result};
use crate::incremental::{Events, sort_by_time};
use crate::ingest::FramePool;
use crate::kernels::{GpuUse, Method};
use crate::periodic::{Entry, FractionalBoxes, ImagePair, ImagePairs};
use crate::verdict::{
    AbortOn, Change, Defect, DefectKind, ImageLink, Link, Place, PullThrough, Report,
};
use std::sync::Arc;

/// Distance that curves may move before the images are searched for again, in shares of the cell;
/// along directions without repetition, in shares of the extent of the scene.
const MARGIN: f64 = 0.05;

/// Images of the curves of a periodic scene, and their verifier.
#[derive(Debug)]
pub(super) struct Periodic {
    /// Options of the inner verifier.
    options: VerifierOptions,
    /// Cell of the next frame.
    cell: Cell,
    /// Given baseline, until the first frame.
    given: Option<Certificate>,
    /// Expected linking numbers with images, sorted, once they are known.
    expected: Option<Vec<Entry>>,
    /// Verifier of the images, if there are any that may meet.
    inner: Option<Inner>,
    /// Curves of the current frame.
    frame: Option<Arc<CurveSet>>,
    before: Option<Before>,
    pool: FramePool,
}

#[derive(Debug)]
struct Inner {
    pairs: ImagePairs,
    verifier: Verifier,
}

/// Previous frame.
#[derive(Clone, Debug)]
struct Before {
    frame: Arc<CurveSet>,
    cell: Cell,
    boxes: FractionalBoxes,
    seq: u64,
    time: f64,
}

/// Findings about images in a frame.
pub(super) struct Found {
    /// Report of the inner verifier, with the curves of the scene.
    report: Option<Report>,
    /// True if the images changed while curves touched, so that a passage may be missing.
    pub unknown: bool,
}

impl Periodic {
    /// Prepares the images. `options` are those of the outer verifier.
    pub fn new(cell: Cell, options: &VerifierOptions) -> Periodic {
        Periodic {
            options: VerifierOptions {
                baseline: None,
                cell: None,
                clearance: None,
                abort_on: AbortOn::Never,
                kernel: Method::Crossings,
                device: crate::kernels::Device::Cpu,
                ..options.clone()
            },
            cell,
            given: options.baseline.clone(),
            expected: None,
            inner: None,
            frame: None,
            before: None,
            pool: FramePool::default(),
        }
    }

    /// Takes the curves of the next frame.
    pub fn receive(&mut self, set: &Arc<CurveSet>) {
        self.frame = Some(Arc::clone(set));
    }

    /// The next frame does not continue the previous one.
    pub fn cut(&mut self) {
        self.before = None;
        if let Some(inner) = &mut self.inner {
            inner.verifier.cut();
        }
    }

    /// Begins again with another baseline.
    pub fn restart(&mut self, baseline: Certificate) {
        self.given = Some(baseline);
        self.expected = None;
        self.inner = None;
        self.before = None;
    }

    /// Returns true if a defect of a pair with an image is one of the baseline.
    pub fn expects(&self, defect: &Defect) -> bool {
        let Some((i, j)) = defect.j.map(|j| (defect.i, j)) else {
            return false;
        };
        let pair = ImagePair {
            i,
            j,
            image: defect.image,
        };
        let expected = self.expected.as_deref().unwrap_or_default();
        let lacks = expected.binary_search(&(pair, None)).is_ok();
        let touch = self.inner.as_ref().is_some_and(|inner| {
            let found = inner.pairs.find_pair(pair);
            found.is_some_and(|(a, b)| inner.verifier.steps.touch_from_the_start(a, Some(b)))
        });
        lacks || touch
    }

    /// Returns all expected linking numbers; `outer` has those of the curves themselves.
    fn joined(&self, outer: &Certificate) -> Certificate {
        let images = self.expected.iter().flatten();
        let images = images.map(|&(ImagePair { i, j, image }, lambda)| ImageLink {
            i,
            j,
            image,
            lambda,
        });
        Certificate {
            images: Some(images.collect()),
            ..outer.clone()
        }
    }

    /// Returns a verifier of the images that may meet in a frame, or in the step to it; `None` if
    /// there are none.
    fn search(&self, boxes: &FractionalBoxes, progress: &super::Progress) -> Result<Option<Inner>> {
        let frame = self.frame()?;
        let mut swept = boxes.clone();
        if let Some(before) = &self.before {
            swept = swept.union(&before.boxes);
        }
        let periodic = self.cell.periodic();
        let margin = [0, 1, 2].map(|x| match periodic[x] {
            true => MARGIN,
            false => MARGIN * swept.extent(x),
        });
        // Open curves have no linking numbers.
        let open_too = self.options.events != Events::Off;
        let used = |i: usize| open_too || frame.curve(i).closed;
        let expected = self.expected.iter().flatten().map(|entry| entry.0);
        let limit = progress.limit.most();
        let pairs = ImagePairs::find(&swept, &self.cell, margin, used, limit, expected)?;
        if pairs.curves.is_empty() {
            return Ok(None);
        }
        let baseline = self
            .expected
            .as_ref()
            .map(|entries| of_pairs(entries, &pairs));
        let options = VerifierOptions {
            baseline,
            ..self.options.clone()
        };
        let mut verifier = Verifier::with_gpu(options, GpuUse::default());
        verifier.set_share(Some(pairs.share.clone()));
        Ok(Some(Inner { pairs, verifier }))
    }

    fn frame(&self) -> Result<&Arc<CurveSet>> {
        let none = || Error::Usage("no frame".into());
        self.frame.as_ref().ok_or_else(none)
    }

    /// Verifies the images of the current frame. `progress` is that of the outer verifier.
    fn step(
        &mut self,
        (seq, time): (u64, f64),
        progress: &Arc<super::Progress>,
        missing: &mut Vec<String>,
    ) -> Result<Found> {
        let frame = Arc::clone(self.frame()?);
        let boxes = FractionalBoxes::new(&frame, &self.cell)?;
        let mut unknown = false;
        let complete = |inner: &Inner| inner.pairs.are_complete(&boxes);
        if !self.inner.as_ref().is_some_and(complete) {
            let mut inner = self.search(&boxes, progress)?;
            self.pool = FramePool::default();
            if let (Some(inner), Some(before)) = (&mut inner, &self.before) {
                // One signal ends both.
                inner.verifier.full.share_progress(Arc::clone(progress));
                // Starts where the last one ended.
                let curves = self.pool.receive(|out| {
                    CurveSet::translate(&before.frame, &inner.pairs.curves, &before.cell, out)
                })?;
                let report = inner
                    .verifier
                    .step_shared(before.seq, before.time, &curves)?;
                let touch = |d: &Defect| d.kind == DefectKind::Contact;
                if self.options.events != Events::Off && report.defects.iter().any(touch) {
                    unknown = true;
                    missing.push(
                        "curves and periodic images touched while others came near: passages \
                         through this contact may be missing"
                            .into(),
                    );
                }
            }
            self.inner = inner;
        }
        let mut out = None;
        if let Some(Inner { pairs, verifier }) = &mut self.inner {
            verifier.full.share_progress(Arc::clone(progress));
            let cell = &self.cell;
            let curves = self
                .pool
                .receive(|out| CurveSet::translate(&frame, &pairs.curves, cell, out))?;
            let mut report = verifier.step_shared(seq, time, &curves)?;
            name_curves(&mut report, pairs);
            out = Some(report);
            if verifier.baseline_changed || self.expected.is_none() {
                let baseline = verifier.baseline.as_ref();
                self.expected = Some(baseline.map_or_else(Vec::new, |b| entries_of(b, pairs)));
            }
        }
        self.expected.get_or_insert_default();
        self.before = Some(Before {
            frame,
            cell: self.cell,
            boxes,
            seq,
            time,
        });
        Ok(Found {
            report: out,
            unknown,
        })
    }
}

/// Returns a certificate of the translated curves with the entries of these pairs.
fn of_pairs(entries: &[Entry], pairs: &ImagePairs) -> Certificate {
    let mut out = Certificate {
        curves: pairs.curves.len(),
        ..Certificate::default()
    };
    for &(pair, lambda) in entries {
        // All expected pairs are among them.
        let Some((i, j)) = pairs.find_pair(pair) else {
            continue;
        };
        match lambda {
            Some(lambda) => out.links.push(Link { i, j, lambda }),
            None => out.undefined.push(Defect {
                i,
                j: Some(j),
                image: Image::default(),
                kind: DefectKind::TooClose,
                place: Place {
                    segments: [0, 0],
                    point: Point::default(),
                    distance: 0.0,
                },
            }),
        }
    }
    out.links.sort_unstable();
    out.undefined.sort_by_key(|d| (d.i, d.j));
    out
}

/// Returns the entries of a certificate of the translated curves, sorted.
fn entries_of(certificate: &Certificate, pairs: &ImagePairs) -> Vec<Entry> {
    let links = certificate.links.iter();
    let links = links.map(|l| (pairs.pair(l.i, l.j), Some(l.lambda)));
    let undefined = certificate.undefined.iter();
    let undefined = undefined.filter_map(|d| Some((pairs.pair(d.i, d.j?), None)));
    let mut out: Vec<Entry> = links.chain(undefined).collect();
    out.sort_unstable();
    out
}

/// Replaces the translated curves of findings by those of the scene.
fn name_curves(report: &mut Report, pairs: &ImagePairs) {
    let rename = |i: &mut u32, j: &mut u32, image: &mut Image| {
        let pair = pairs.pair(*i, *j);
        (*i, *j, *image) = (pair.i, pair.j, pair.image);
    };
    for Change { i, j, image, .. } in &mut report.changes {
        rename(i, j, image);
    }
    let events = report.events.iter_mut().chain(&mut report.unresolved);
    for PullThrough { i, j, image, .. } in events {
        rename(i, j, image);
    }
    // The outer verifier reports single curves.
    report.defects.retain(|d| d.j.is_some());
    for Defect { i, j, image, .. } in &mut report.defects {
        if let Some(j) = j {
            rename(i, j, image);
        }
    }
    // They have no place for an image; the defects name the pairs.
    report.adopted.clear();
}

impl Verifier {
    /// Sets the periodic cell of the frames from the next one on, in the units of the simulation. The
    /// frames of a scene have either all a cell or none.
    ///
    /// Errors: [`Error::Usage`] if the vectors span no lattice, if the scene had no cell, or repeated
    /// along other vectors, or if an option excludes periodic cells ([`VerifierOptions::cell`]).
    pub fn set_cell(&mut self, cell: Cell) -> Result<()> {
        cell.check()?;
        if let Some(options) = self.fresh.take() {
            let options = VerifierOptions {
                cell: Some(cell),
                ..*options
            };
            options.check()?;
            if self.share.is_some() {
                let what = "the pairs of periodic images cannot be shared among several verifiers";
                return Err(Error::Usage(what.into()));
            }
            self.baseline = None;
            self.periodic = Some(Box::new(Periodic::new(cell, &options)));
        }
        let Some(periodic) = &mut self.periodic else {
            let what = "this frame has a periodic cell, but the previous ones had none";
            return Err(Error::Usage(what.into()));
        };
        if periodic.cell.periodic() != cell.periodic() {
            let what = "the cell repeats along other vectors than before";
            return Err(Error::Usage(what.into()));
        }
        periodic.cell = cell;
        Ok(())
    }

    /// Returns the periodic cell of the next frame, if the scene is periodic.
    pub fn cell(&self) -> Option<Cell> {
        self.periodic.as_ref().map(|periodic| periodic.cell)
    }

    /// Divides a given baseline, before the first frame, into that of the curves themselves and that
    /// of the images, under the names that this frame has for them.
    pub(super) fn divide_baseline(&mut self, set: &CurveSet) -> Result<()> {
        let Some(periodic) = &mut self.periodic else {
            return match &self.baseline {
                Some(b) if b.images.is_some() => Err(Error::Usage(
                    "the baseline is of a periodic scene, but the frame has no cell".into(),
                )),
                _ => Ok(()),
            };
        };
        let Some(given) = periodic.given.take() else {
            return Ok(());
        };
        if given.images.is_none() {
            let what = "the baseline is not of a periodic scene, but the frame has a cell: make one \
                        with the cell";
            return Err(Error::Usage(what.into()));
        }
        if given.curves != set.len() {
            return Err(Error::CertificateMismatch {
                certificate: given.curves,
                model: set.len(),
            });
        }
        // The numbers of this frame, of the curves themselves and of the images.
        let mut frame = periodic.joined(&Certificate::default());
        let boxes = FractionalBoxes::new(set, &periodic.cell)?;
        self.full.progress.limit.begin(self.max_pairs);
        if let Some(mut inner) = periodic.search(&boxes, &self.full.progress)? {
            let mut curves = None;
            let current = periodic.frame()?;
            CurveSet::translate(current, &inner.pairs.curves, &periodic.cell, &mut curves)?;
            if let Some(curves) = curves {
                let (certificate, _) = inner.verifier.certify(&curves);
                periodic.expected = Some(entries_of(certificate, &inner.pairs));
                frame = periodic.joined(&Certificate::default());
            }
        }
        let (certificate, _) = self.certify(set);
        let images = frame.images;
        let frame = Certificate {
            images,
            ..certificate.clone()
        };
        let aligned = given.aligned_with(&frame);
        let entries = aligned.entries().unwrap_or_default();
        let of_images = entries
            .into_iter()
            .filter(|e| e.0.image != Image::default());
        if let Some(periodic) = &mut self.periodic {
            periodic.expected = Some(of_images.collect());
        }
        self.baseline = Some(Certificate {
            images: None,
            ..aligned
        });
        Ok(())
    }

    /// Verifies the images of the curves, if there is a cell.
    pub(super) fn verify_images(
        &mut self,
        frame: (u64, f64),
        missing: &mut Vec<String>,
    ) -> Result<Option<Found>> {
        let Some(periodic) = &mut self.periodic else {
            return Ok(None);
        };
        let first = self.joined.is_none();
        let found = periodic.step(frame, &self.full.progress, missing)?;
        let inner = periodic.inner.as_mut().map(|inner| &mut inner.verifier);
        let inner_changed = inner.is_some_and(|v| std::mem::take(&mut v.baseline_changed));
        if first || inner_changed || self.baseline_changed {
            self.baseline_changed = true;
            let outer = self.baseline.as_ref();
            self.joined = outer.map(|outer| periodic.joined(outer));
        }
        Ok(Some(found))
    }

    /// Adds the findings about images to a report.
    pub(super) fn add_images(&mut self, report: &mut Report, found: Found) {
        let Some(of_images) = found.report else {
            return;
        };
        report.changes.extend(of_images.changes);
        report.changes.sort_by_key(|c| (c.i, c.j, c.image));
        report.events.extend(of_images.events);
        sort_by_time(&mut report.events);
        report.unresolved.extend(of_images.unresolved);
        sort_by_time(&mut report.unresolved);
        report.defects.extend(of_images.defects);
        report.defects.sort_by_key(|d| (d.i, d.j, d.image));
        report.missing.extend(of_images.missing);
        let fractions = report.safe_fraction.zip(of_images.safe_fraction);
        report.safe_fraction = fractions.map(|(a, b)| a.min(b));
        add_work(&mut report.stats, &of_images.stats);
        if let Some(Inner { verifier, .. }) = self.periodic.as_ref().and_then(|p| p.inner.as_ref())
        {
            self.full.timings.add(&verifier.timings());
            self.work.add(&verifier.work());
        }
    }
}
