//! Verification of periodic scenes: an inner verifier has the pairs of a curve and an image of
//! another one, or of itself, and its findings join those of the frame.
//!
//! The outer verifier has the curves as they are given. The inner one has a set of translated
//! curves ([`CurveSet::translate`]), which is the same from frame to frame, so that it is
//! incremental. If other images come near, another set replaces it: the new inner verifier starts
//! with the previous frame, so that no step is left out. All pairs that it adds had boxes apart
//! from one another throughout the earlier frames.

use super::braided::add_work;
use super::yarns::{Compared, Yarns};
use super::{Strategy, Verifier, VerifierOptions};
use crate::certificate::{Certificate, undefined_entry};
use crate::curve::{Cell, CurveSet, Image, Point, Precision, is_home};
use crate::error::{Error, Result};
use crate::incremental::{Events, QuietBounds, sort_by_time};
use crate::ingest::FramePool;
use crate::kernels::{GpuUse, Method};
use crate::pairs::Pair;
use crate::periodic::{
    Bend, Boxer, Entry, FractionalBoxes, ImagePair, ImagePairs, Jumps, RingAndYarn, Searched,
    Unwrap, check_whole, period_of_pair,
};
use crate::pool;
use crate::verdict::{AbortOn, Change, Defect, DefectKind, Link, PullThrough, Report};
use std::collections::BTreeSet;
use std::sync::Arc;

/// Images of the curves of a periodic scene, and their verifier.
#[derive(Debug)]
pub(super) struct Periodic {
    /// Options of the inner verifier.
    options: VerifierOptions,
    /// Cell of the next frame.
    cell: Cell,
    /// Cell of the last verified frame, or of the first one.
    last_cell: Cell,
    /// [`VerifierOptions::wrapped`].
    wrapped: Option<bool>,
    /// Given baseline, until the first frame.
    given: Option<Certificate>,
    /// Expected linking numbers with images, sorted, once they are known.
    expected: Option<Vec<Entry>>,
    /// Linking numbers of closed curves and those that run through the cell.
    yarns: Yarns,
    /// Images that may meet, once they are known.
    inner: Option<Inner>,
    unwrap: Unwrap,
    jumps: Jumps,
    /// Curves of the current frame, and of the last verified one.
    frame: Option<Arc<CurveSet>>,
    last: Option<Arc<CurveSet>>,
    before: Option<Before>,
    pool: FramePool,
    /// True if the room of a quiet frame was found to be wrong ([`Strategy::Paranoid`]).
    disagreed: bool,
    /// True if the baseline of the curves themselves is not that of the joined one.
    outdated: bool,
}

#[derive(Debug)]
struct Inner {
    pairs: ImagePairs,
    /// `None` if no images may meet.
    verifier: Option<Box<Verifier>>,
}

/// Previous frame.
#[derive(Clone, Debug)]
struct Before {
    frame: Arc<CurveSet>,
    cell: Cell,
    /// Room that the curves had ([`ImagePairs::room`]).
    room: Point,
    seq: u64,
    time: f64,
}

/// Findings about images in a frame.
#[derive(Default)]
pub(super) struct Found {
    /// Report of the inner verifier, with the curves of the scene.
    report: Option<Report>,
    /// Findings about closed curves and those that run through the cell.
    of_yarns: Compared,
    /// True if the images changed while curves touched, so that a passage may be missing.
    pub unknown: bool,
}

impl Found {
    /// Returns the pairs without a linking number.
    fn defects(&self) -> Vec<Defect> {
        let of_images = self.report.iter().flat_map(|report| &report.defects);
        of_images.chain(&self.of_yarns.defects).copied().collect()
    }
}

impl Periodic {
    /// Prepares the images. `options` are those of the outer verifier.
    pub fn new(cell: Cell, options: &VerifierOptions) -> Periodic {
        Periodic {
            options: VerifierOptions {
                baseline: None,
                cell: None,
                wrapped: None,
                clearance: None,
                abort_on: AbortOn::Never,
                kernel: Method::Crossings,
                device: crate::kernels::Device::Cpu,
                ..options.clone()
            },
            cell,
            last_cell: cell,
            wrapped: options.wrapped,
            given: options.baseline.clone(),
            expected: None,
            yarns: Yarns::default(),
            inner: None,
            unwrap: Unwrap::default(),
            jumps: Jumps::default(),
            frame: None,
            last: None,
            before: None,
            pool: FramePool::default(),
            disagreed: false,
            outdated: true,
        }
    }

    pub fn inner_verifier(&mut self) -> Option<&mut Verifier> {
        self.inner.as_mut()?.verifier.as_deref_mut()
    }

    /// Returns the number of curves of a first frame that run through the cell, and logs those that
    /// almost do.
    pub fn count_yarns(&self, set: &CurveSet) -> usize {
        let mut yarns = Yarns::default();
        yarns.find_periods(set, &self.cell);
        yarns.list().len()
    }

    /// Takes the curves of the next frame.
    pub fn receive(&mut self, set: &Arc<CurveSet>) {
        self.frame = Some(Arc::clone(set));
    }

    /// The current frame was verified.
    pub fn commit(&mut self) {
        self.jumps.commit();
        self.last_cell = self.cell;
        self.last.clone_from(&self.frame);
    }

    /// The curves themselves have another baseline than before.
    pub fn outdate(&mut self) {
        self.outdated = true;
    }

    /// The next frame does not continue the previous one.
    pub fn cut(&mut self) {
        self.before = None;
        self.yarns.cut();
        if let Some(verifier) = self.inner_verifier() {
            verifier.cut();
        }
    }

    /// Begins again with another baseline.
    pub fn restart(&mut self, baseline: Certificate) {
        let options = VerifierOptions {
            baseline: Some(baseline),
            wrapped: self.wrapped,
            ..self.options.clone()
        };
        *self = Periodic::new(self.cell, &options);
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
        let of_yarns = self.yarns.expected.as_deref().unwrap_or_default();
        let lacks = [expected, of_yarns]
            .iter()
            .any(|e| e.contains(&(pair, None)));
        let touch = self.inner.as_ref().is_some_and(|inner| {
            let found = inner.pairs.find_pair(pair);
            let verifier = inner.verifier.as_ref();
            let both = found.zip(verifier);
            both.is_some_and(|((a, b), verifier)| verifier.steps.touch_from_the_start(a, Some(b)))
        });
        lacks || touch
    }

    /// Returns all expected linking numbers; `outer` has those of the curves themselves, and
    /// `found` the places of contacts with images.
    fn joined(&self, outer: &Certificate, found: &Found) -> Certificate {
        let periodic = Certificate {
            images: Some(Vec::new()),
            periods: self.yarns.list(),
            ..outer.clone()
        };
        let mut entries = periodic.entries().unwrap_or_default();
        entries.extend(self.expected.iter().flatten());
        entries.extend(self.yarns.expected.iter().flatten());
        entries.sort_unstable();
        periodic.with_entries(&entries, &found.defects())
    }

    /// Returns the curves of the next frame where they are verified; `None`: they are as given.
    ///
    /// Errors: those of [`Unwrap::unwrap`].
    fn place(&mut self, set: &CurveSet) -> Result<Option<CurveSet>> {
        match self.wrapped {
            None => {
                // After a cut, the last frame.
                let before = self.before.as_ref().map(|before| &before.frame);
                let before = before.or(self.last.as_ref()).map(|frame| &**frame);
                self.jumps.follow(set, &self.cell, before)
            }
            Some(true) => self.unwrap.unwrap(set, &self.cell).map(Some),
            Some(false) => Ok(None),
        }
    }

    /// Converts the previous frame to double precision, like those that follow. Its images are
    /// searched for again.
    fn widen(&mut self) -> Result<()> {
        if let Some(before) = &mut self.before {
            before.frame = Arc::new(before.frame.widened()?);
        }
        self.inner = None;
        Ok(())
    }

    /// Refuses the current frame if one of these curves is torn.
    fn refuse_torn(&self, curves: &[usize]) -> Result<()> {
        let curves = curves.iter().copied().filter(|_| self.wrapped.is_none());
        check_whole(self.frame()?, &self.cell, curves)
    }

    /// Finds the images that may meet while the curves are within these boxes.
    fn search(&mut self, boxes: &FractionalBoxes, progress: &super::Progress) -> Result<Inner> {
        self.refuse_torn(&boxes.wide(&self.cell))?;
        let margin = ImagePairs::margin(boxes, &self.cell);
        let searched = Searched {
            curves: self.frame()?.curves(),
            periods: &self.yarns.periods(),
            // Open curves have no linking numbers.
            open_too: self.options.events != Events::Off,
            most: progress.limit.most(),
        };
        let expected = self.expected.iter().flatten().map(|entry| entry.0);
        let pairs = ImagePairs::find(boxes, &self.cell, margin, &searched, expected)?;
        self.yarns.pairs.clone_from(&pairs.yarns);
        if pairs.curves.is_empty() {
            let verifier = None;
            return Ok(Inner { pairs, verifier });
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
        verifier.set_filter(Some(pairs.filter.clone()));
        Ok(Inner {
            pairs,
            verifier: Some(Box::new(verifier)),
        })
    }

    fn frame(&self) -> Result<&Arc<CurveSet>> {
        let none = || Error::Usage("no frame".into());
        self.frame.as_ref().ok_or_else(none)
    }

    /// Finds the images that may meet in the step to the current frame, unless they are known.
    /// Returns the room of the curves, and true if a new search found them.
    fn follow(
        &mut self,
        frame: &CurveSet,
        quiet: Option<&QuietBounds<'_>>,
        progress: &super::Progress,
    ) -> Result<(Point, bool)> {
        let boxer = Boxer::new(frame, &self.cell)?;
        let before = self.before.as_ref();
        let bend = before.map(|before| Bend::between([&before.cell, &self.cell]));
        let bend = bend.transpose()?.unwrap_or_default();
        let room = |pairs: &ImagePairs, boxer: &Boxer<'_>| {
            pool::run(frame.segments(), || pairs.room(boxer))
        };
        if let Some(Inner { pairs, .. }) = &mut self.inner {
            let was_inside = match before {
                Some(before) if pairs.is_enough(before.room, &bend) => true,
                // The room of a quiet frame is a lower bound.
                Some(before) => {
                    let room = room(pairs, &Boxer::new(&before.frame, &before.cell)?);
                    pairs.is_enough(room, &bend)
                }
                None => true,
            };
            let at_least = quiet.map(|at| pairs.quiet_room(&boxer, at, &bend));
            let known = at_least.filter(|&room| pairs.is_enough(room, &bend));
            let room = match known {
                Some(known) if self.options.strategy != Strategy::Paranoid => known,
                _ => room(pairs, &boxer),
            };
            self.disagreed |= known.is_some_and(|known| !boxer.is_at_most(known, room));
            if was_inside && pairs.is_enough(room, &bend) {
                if known.is_none()
                    && let Some(Inner { pairs, .. }) = &self.inner
                {
                    self.refuse_torn(&pairs.wide)?;
                }
                return Ok((room, false));
            }
        }
        let boxes = FractionalBoxes::new(&boxer);
        let swept = match before {
            None => boxes,
            Some(before) => {
                let at_first = Boxer::new(&before.frame, &before.cell)?;
                boxes.swept_from(&FractionalBoxes::new(&at_first), &bend)
            }
        };
        let inner = self.search(&swept, progress)?;
        let room = room(&inner.pairs, &boxer);
        self.inner = Some(inner);
        Ok((room, true))
    }

    /// Returns the pairs of a closed curve and a yarn whose linking numbers may differ from those
    /// of the previous frame; `None`: all. `met` has the pairs of the curves themselves that may
    /// have met, if they are known.
    fn unsettled(
        &self,
        frame: &Arc<CurveSet>,
        met: Option<&[Pair]>,
    ) -> Option<BTreeSet<RingAndYarn>> {
        if !self.options.strategy.is_incremental() {
            return None;
        }
        let (before, Inner { pairs, verifier }) = self.before.as_ref().zip(self.inner.as_ref())?;
        let of_images = match verifier {
            Some(verifier) => verifier.steps.met()?,
            None => &[],
        };
        let of_curves = met?.iter().map(|&(i, j)| (i, j, Image::default()));
        let of_images = of_images.iter().map(|&(a, b)| {
            let ImagePair { i, j, image } = pairs.pair(a, b);
            (i, j, image)
        });
        let met = of_curves.chain(of_images);
        let met = met.filter_map(|(i, j, image)| self.yarns.pair(i, j, image));
        let step = [(&before.frame, &before.cell), (frame, &self.cell)];
        Some(met.chain(self.yarns.past_joints(step)).collect())
    }

    /// [`Periodic::try_step`]. After an error, the images are searched for again: the inner
    /// verifier may have verified a frame that is rejected.
    fn step(
        &mut self,
        frame: (u64, f64),
        outer: (Option<&QuietBounds<'_>>, Option<&[Pair]>),
        progress: &Arc<super::Progress>,
        missing: &mut Vec<String>,
    ) -> Result<Found> {
        let first = self.expected.is_none();
        let found = self.try_step(frame, outer, progress, missing);
        if found.is_err() {
            self.inner = None;
            self.yarns.cut();
            if first {
                self.yarns.forget_periods();
            }
        }
        found
    }

    /// Verifies the images of the current frame. `progress` is that of the outer verifier. `quiet`
    /// says where the curves are if it found the frame to be quiet, and `met` has the pairs of
    /// curves that may have met in the step to it ([`Steps::met`]).
    ///
    /// [`Steps::met`]: super::steps::Steps::met
    fn try_step(
        &mut self,
        (seq, time): (u64, f64),
        (quiet, met): (Option<&QuietBounds<'_>>, Option<&[Pair]>),
        progress: &Arc<super::Progress>,
        missing: &mut Vec<String>,
    ) -> Result<Found> {
        let frame = Arc::clone(self.frame()?);
        let other = |before: &mut Before| !before.frame.same_layout(&frame);
        if self.before.take_if(other).is_some() {
            // The images have the points of the previous frame, and there is no step.
            self.inner = None;
            self.yarns.cut();
        }
        let mut unknown = false;
        if let Some(why) = self.yarns.find_periods(&frame, &self.cell) {
            unknown = true;
            missing.push(why);
        }
        let (room, new) = self.follow(&frame, quiet, progress)?;
        if new {
            self.pool = FramePool::default();
            if let (Some(inner), Some(before)) = (&mut self.inner, &self.before)
                && let Some(verifier) = &mut inner.verifier
            {
                // A signal that cancels the frame cancels both verifiers.
                verifier.full.share_progress(Arc::clone(progress));
                // The new verifier starts with the previous frame.
                let curves = self.pool.receive(|out| {
                    let (curves, cell) = (&inner.pairs.curves, &before.cell);
                    CurveSet::translate(&before.frame, curves, cell, out, CurveSet::update)
                })?;
                let report = verifier.step_shared(before.seq, before.time, &curves)?;
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
        }
        let mut out = None;
        if let Some(Inner {
            pairs,
            verifier: Some(verifier),
        }) = &mut self.inner
        {
            verifier.full.share_progress(Arc::clone(progress));
            let cell = &self.cell;
            let curves = self.pool.receive(|out| {
                CurveSet::translate(&frame, &pairs.curves, cell, out, |set, positions| {
                    verifier.update(set, positions)
                })
            })?;
            let mut report = verifier.step_shared(seq, time, &curves)?;
            name_curves(&mut report, pairs);
            out = Some(report);
            if verifier.baseline_changed || self.expected.is_none() {
                let baseline = verifier.baseline.as_ref();
                self.expected = Some(baseline.map_or_else(Vec::new, |b| entries_of(b, pairs)));
            }
        }
        self.expected.get_or_insert_default();
        let unsettled = self.unsettled(&frame, met);
        let check = self.options.strategy == Strategy::Paranoid;
        let of_yarns = self
            .yarns
            .compare(&frame, &self.cell, unsettled.as_ref(), check)?;
        self.disagreed |= of_yarns.disagreed;
        self.outdated |= !of_yarns.adopted.is_empty();
        self.before = Some(Before {
            frame,
            cell: self.cell,
            room,
            seq,
            time,
        });
        Ok(Found {
            report: out,
            of_yarns,
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
            None => out.undefined.push(undefined_entry(i, Some(j))),
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
    // They have no place for an image; the defects name the pairs with one.
    report.adopted.retain_mut(|link| {
        let pair = pairs.pair(link.i, link.j);
        (link.i, link.j) = (pair.i, pair.j);
        is_home(&pair.image)
    });
}

impl Verifier {
    /// Sets the periodic cell of the frames from the next one on, in the units of the simulation.
    /// The frames of a scene have either all a cell or none.
    ///
    /// Another basis of the same lattice, as simulations take it that shear their cell, is replaced
    /// by that of the previous frame, in which all images have their names.
    ///
    /// Errors: [`Error::Usage`] if the vectors span no lattice, if the scene had no cell, or
    /// repeated along other vectors, or if an option excludes periodic cells
    /// ([`VerifierOptions::cell`]).
    pub fn set_cell(&mut self, cell: Cell) -> Result<()> {
        cell.check()?;
        if let Some(options) = &self.fresh {
            let options = VerifierOptions {
                cell: Some(cell),
                ..VerifierOptions::clone(options)
            };
            options.check()?;
            self.fresh = None;
            self.baseline = None;
            self.periodic = Some(Box::new(Periodic::new(cell, &options)));
        }
        let Some(periodic) = &mut self.periodic else {
            let what = "this frame has a periodic cell, but the previous ones had none";
            return Err(Error::Usage(what.into()));
        };
        if periodic.last_cell.periodic() != cell.periodic() {
            let what = "the cell repeats along other vectors than before";
            return Err(Error::Usage(what.into()));
        }
        periodic.cell = cell.in_basis_of(&periodic.last_cell);
        Ok(())
    }

    /// Returns the curves of the next frame where they are verified, if that differs from where
    /// they are given ([`VerifierOptions::wrapped`]).
    pub(super) fn place(&mut self, set: &CurveSet) -> Result<Option<Arc<CurveSet>>> {
        let Some(periodic) = &mut self.periodic else {
            return match self.wrapped {
                Some(true) => Err(Error::Usage(
                    "wrapped coordinates need a periodic cell, but the frame has none".into(),
                )),
                _ => Ok(None),
            };
        };
        match periodic.place(set) {
            Ok(placed) => {
                let precision = placed.as_ref().unwrap_or(set).precision();
                let before = periodic.before.as_ref().map(|b| b.frame.precision());
                let widened = match (before, precision) {
                    (Some(Precision::F32), Precision::F64) => {
                        periodic.widen()?;
                        self.steps.widen()?;
                        placed
                    }
                    (Some(Precision::F64), Precision::F32) => Some(set.widened()?),
                    _ => placed,
                };
                Ok(widened.map(Arc::new))
            }
            Err(why) => {
                // The next frame is compared with the guess, so nothing is known about that step.
                let searched = self.previous.is_some() && self.steps.events() != Events::Off;
                self.cut();
                let unknown = format!("an earlier frame was rejected: {why}");
                self.unknown_step = searched.then_some(unknown);
                Err(why)
            }
        }
    }

    /// Returns the curves of the last frame where they were verified, if the scene is periodic:
    /// unwrapped, and followed if they jumped ([`VerifierOptions::wrapped`]).
    pub fn placed_curves(&self) -> Option<&Arc<CurveSet>> {
        self.periodic.as_ref()?.frame.as_ref()
    }

    /// Returns how many times a curve jumped by a lattice vector from one frame to the next, as
    /// simulations move molecules back into the cell, and was followed.
    pub fn jumps(&self) -> u64 {
        let periodic = self.periodic.as_ref();
        periodic.map_or(0, |periodic| periodic.jumps.count())
    }

    /// Returns the periodic cell of the next frame, if the scene is periodic.
    pub fn cell(&self) -> Option<Cell> {
        self.periodic.as_ref().map(|periodic| periodic.cell)
    }

    /// Divides a given baseline, before the first frame, into that of the curves themselves and
    /// that of the images, under the names that this frame has for them.
    pub(super) fn divide_baseline(&mut self, set: &CurveSet) -> Result<()> {
        let divided = self.try_to_divide_baseline(set);
        if let (Err(_), Some(periodic)) = (&divided, &mut self.periodic) {
            periodic.yarns.forget_periods();
        }
        divided
    }

    fn try_to_divide_baseline(&mut self, set: &CurveSet) -> Result<()> {
        let Some(periodic) = &mut self.periodic else {
            return match &self.baseline {
                Some(b) if b.images.is_some() => Err(Error::Usage(
                    "the baseline is of a periodic scene, but the frame has no cell".into(),
                )),
                _ => Ok(()),
            };
        };
        // Kept until it is divided: the first frame may be rejected.
        let Some(given) = periodic.given.clone() else {
            return Ok(());
        };
        if given.images.is_none() {
            let what = "the baseline is not of a periodic scene, but the frame has a cell: make \
                        one with the cell";
            return Err(Error::Usage(what.into()));
        }
        if given.curves != set.len() {
            return Err(Error::CertificateMismatch {
                certificate: given.curves,
                model: set.len(),
            });
        }
        // The numbers of this frame, of the curves themselves and of the images.
        periodic.yarns.find_periods(set, &periodic.cell);
        let boxes = FractionalBoxes::new(&Boxer::new(set, &periodic.cell)?);
        self.full.progress.limit.begin(self.max_pairs);
        let inner = periodic.search(&boxes, &self.full.progress)?;
        if let Some(mut verifier) = inner.verifier {
            let mut curves = None;
            let (current, translated) = (periodic.frame()?, &inner.pairs.curves);
            let cell = &periodic.cell;
            CurveSet::translate(current, translated, cell, &mut curves, CurveSet::update)?;
            if let Some(curves) = curves {
                let (certificate, _) = verifier.certify(&curves);
                periodic.expected = Some(entries_of(certificate, &inner.pairs));
            }
        }
        periodic.yarns.expected = None;
        let frame = Arc::clone(periodic.frame()?);
        periodic
            .yarns
            .compare(&frame, &periodic.cell, None, false)?;
        let periods = periodic.yarns.list();
        self.full.heed_cancel(false);
        let stats = pool::run(set.segments(), || self.full.certify(set));
        debug_assert_eq!(stats.curves, set.len() as u64);
        self.full.progress.check()?;
        let frame = periodic.joined(&self.full.certificate, &Found::default());
        let aligned = given.aligned_with(&frame)?;
        let entries = aligned.entries().unwrap_or_default();
        let is_of_yarn = |e: &Entry| period_of_pair(&periods, e.0.i, e.0.j).is_some();
        let (mut of_yarns, others): (Vec<Entry>, Vec<Entry>) =
            entries.into_iter().partition(is_of_yarn);
        of_yarns.sort_unstable();
        let (of_images, own): (Vec<Entry>, Vec<Entry>) = others
            .into_iter()
            .partition(|e| e.0.image != Image::default());
        periodic.expected = Some(of_images);
        periodic.yarns.expected = Some(of_yarns);
        periodic.given = None;
        self.baseline = Some(Certificate {
            images: None,
            periods: Vec::new(),
            ..given.with_entries(&own, &[])
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
        let quiet = periodic.frame().ok();
        let quiet = quiet.and_then(|frame| self.monitor.quiet_bounds(frame));
        let outer = (quiet.as_ref(), self.steps.met());
        let found = periodic.step(frame, outer, &self.full.progress, missing)?;
        let disagreed = std::mem::take(&mut periodic.disagreed);
        let inner = periodic.inner_verifier();
        let inner_changed = inner.is_some_and(|v| std::mem::take(&mut v.baseline_changed));
        if inner_changed || std::mem::take(&mut periodic.outdated) {
            self.baseline_changed = true;
            let outer = self.baseline.as_ref();
            self.joined = outer.map(|outer| periodic.joined(outer, &found));
        }
        if disagreed {
            self.disagree();
        }
        Ok(Some(found))
    }

    /// Adds the findings about images to a report.
    pub(super) fn add_images(&mut self, report: &mut Report, found: Found) {
        report.changes.extend(found.of_yarns.changes);
        for (ImagePair { i, j, image }, lambda) in found.of_yarns.adopted {
            if let Some(lambda) = lambda.filter(|&lambda| lambda != 0 && is_home(&image)) {
                report.adopted.push(Link { i, j, lambda });
            }
        }
        report.adopted.sort_unstable();
        report.defects.extend(found.of_yarns.defects);
        if let Some(of_images) = found.report {
            report.changes.extend(of_images.changes);
            report.events.extend(of_images.events);
            report.unresolved.extend(of_images.unresolved);
            report.defects.extend(of_images.defects);
            report.missing.extend(of_images.missing);
            let fractions = report.safe_fraction.zip(of_images.safe_fraction);
            report.safe_fraction = fractions.map(|(a, b)| a.min(b));
            add_work(&mut report.stats, &of_images.stats);
        }
        report.changes.sort_by_key(|c| (c.i, c.j, c.image));
        // The search for pull-throughs finds contacts with yarns, too.
        let key = |d: &Defect| (d.i, d.j, d.image, d.kind as u8);
        report.defects.sort_by_key(key);
        report.defects.dedup_by_key(|d| key(d));
        sort_by_time(&mut report.events);
        sort_by_time(&mut report.unresolved);
        let inner = self.periodic.as_mut();
        if let Some(verifier) = inner.and_then(|periodic| periodic.inner_verifier()) {
            self.full.timings.add(&verifier.timings());
            self.work.add(&verifier.work());
        }
        self.work.recomputed += found.of_yarns.computed;
    }
}
