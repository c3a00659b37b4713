//! `study sweep`: how far a model can be reduced before its topology breaks (Qu & James 2021,
//! section 4.3.2).
//!
//! A sweep reduces a model step by step, from fine to coarse, by quantization of its coordinates or
//! by resampling of its curves:
//!
//! ```text
//! original ─▶ step 1 ─▶ step 2 ─▶ ..   pull-throughs from each step to the next
//!     └──────────┴─────────┴─────────  linking numbers of each step and of the original
//! ```
//!
//! Each step is compared with the original. A large reduction may make several errors that cancel
//! in the linking numbers. So the pull-throughs of the straight motion from each step to the next
//! are searched for, too; a step after a pull-through is not intact, whatever its linking numbers.
//!
//! Steps of a resampling differ in their numbers of points. Both curves of such a motion are cut
//! into the same pieces, and the points at equal shares of their lengths belong together.
//!
//! Limits: nothing is known about reductions between two steps.

mod refine;
mod resample;

use self::refine::{By, refine};
use self::resample::resample;
use crate::input::{self, count, plural, usage};
use crate::plot::{Plot, Series};
use linkwatch::{
    CurveSet, Error, Events, FrameInfo, Point, Positions, Precision, Received, Report, Result,
    Session, SessionOptions, Strategy, Verdict,
};
use std::collections::BTreeSet;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Maximum number of findings that are printed; the rest is counted.
const SENTENCES: usize = 20;

/// Maximum number of bits: coordinates of doubles have no more.
const MOST_BITS: f64 = 52.0;

/// Reduce a model step by step until its topology breaks: fewer bits, or fewer control points
///
/// Linking numbers of each step are compared with those of the model. Pull-throughs are searched
/// for from each step to the next, so that errors that cancel are found. A step is intact if no
/// curve was pulled through another one on the way to it. The exit code is 1 if a step is broken,
/// and 3 if one is undecided.
#[derive(clap::Args)]
#[command(group(clap::ArgGroup::new("reduction").required(true)))]
pub struct Args {
    /// A model, or a scene as `linkwatch generate` takes it
    #[arg(value_name = "MODEL|SCENE")]
    input: String,
    /// Quantize coordinates to a grid of 2^BITS cells along each axis of the bounding box, for
    /// example 24..8: from 24 bits to 8
    #[arg(long, value_name = "FROM..TO", group = "reduction", value_parser = range)]
    quantize: Option<[f64; 2]>,
    /// Resample each curve to a share of its control points, at equal distances along it, for
    /// example 1.0..0.5
    #[arg(long, value_name = "FROM..TO", group = "reduction", value_parser = range)]
    resample: Option<[f64; 2]>,
    /// Difference of two steps [default: 1 bit, or a share of 0.05]
    #[arg(long, value_name = "D")]
    step: Option<f64>,
    /// Write a plot of the violations of each step, an .svg file
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
}

/// Parses `FROM..TO`. A single value is a range of one step.
fn range(text: &str) -> Result<[f64; 2], String> {
    let (from, to) = text.split_once("..").unwrap_or((text, text));
    match (from.trim().parse(), to.trim().parse()) {
        (Ok(from), Ok(to)) if from >= to => Ok([from, to]),
        (Ok(_), Ok(_)) => Err("a sweep goes from fine to coarse".into()),
        _ => Err("expected FROM..TO, as in 24..8 or 1.0..0.5".into()),
    }
}

/// A reduction of a model.
#[derive(Clone, Copy)]
enum Reduction {
    /// Quantization to this number of bits per coordinate.
    Bits(u32),
    /// Resampling to this share of the control points.
    Share(f64),
}

impl Reduction {
    fn apply(self, set: &CurveSet) -> Result<CurveSet> {
        match self {
            Reduction::Bits(bits) => quantize(set, bits),
            Reduction::Share(share) => resample(set, share),
        }
    }

    /// Returns the number of the reduction: bits, or percent.
    fn value(self) -> f64 {
        match self {
            Reduction::Bits(bits) => bits.into(),
            // Without the rounding errors of the steps of a range.
            Reduction::Share(share) => (share * 1e8).round() / 1e6,
        }
    }
}

impl fmt::Display for Reduction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Reduction::Bits(1) => f.write_str("1 bit"),
            Reduction::Bits(bits) => write!(f, "{bits} bits"),
            Reduction::Share(_) => write!(f, "{} % of the points", self.value()),
        }
    }
}

/// Returns the reductions of the sweep.
fn reductions(args: &Args) -> Result<Vec<Reduction>> {
    let bits = args.quantize.is_some();
    let [from, to] = args.quantize.or(args.resample).unwrap_or_default();
    let step = args.step.unwrap_or(if bits { 1.0 } else { 0.05 });
    let whole = |x: f64| x.fract() == 0.0;
    match bits {
        true if !(to >= 1.0 && from <= MOST_BITS && whole(from) && whole(to)) => {
            return Err(usage(format!(
                "--quantize: expected bits from 1 to {MOST_BITS}"
            )));
        }
        false if !(to > 0.0 && from <= 1.0) => {
            return Err(usage(
                "--resample: expected shares above 0 and up to 1".into(),
            ));
        }
        _ => {}
    }
    if !(step > 0.0 && step.is_finite()) || bits && !whole(step) {
        let expected = if bits {
            "a whole number of bits"
        } else {
            "a share"
        };
        return Err(usage(format!("--step {step}: expected {expected} above 0")));
    }
    // The last step is exactly the end of the range, as far as rounding errors go.
    let steps = ((from - to) / step + 1e-9).floor() + 1.0;
    let values = (0..steps as usize).map(|k| from - k as f64 * step);
    Ok(match bits {
        true => values.map(|x| Reduction::Bits(x as u32)).collect(),
        // Without the rounding errors of the multiples, but not below the end.
        false => values
            .map(|x| Reduction::Share(((x * 1e12).round() / 1e12).max(to)))
            .collect(),
    })
}

/// A step of a sweep.
struct Step {
    reduction: Reduction,
    /// Number of control points that are left.
    points: usize,
    /// Changed if a linking number differs from that of the original, or if a curve was pulled
    /// through another one in any step so far. Undecided if neither is proven.
    verdict: Verdict,
    /// Linking numbers that differ from those of the original, and the pull-throughs since the
    /// previous step. Segments are those of the reduced curves.
    report: Report,
}

impl Step {
    /// Returns the numbers of changed links, of pull-throughs, and of pairs and pull-throughs that
    /// are undecided.
    fn findings(&self) -> [usize; 3] {
        let report = &self.report;
        let undecided = report.defects.len() + report.unresolved.len();
        [report.changes.len(), report.events.len(), undecided]
    }
}

/// A sweep over reductions of a model.
struct Sweep {
    original: CurveSet,
    /// Compares each step with the original.
    session: Session,
    /// The previous step.
    previous: CurveSet,
    seq: u64,
    /// True if a curve was pulled through another one in a step.
    passed: bool,
    /// True if that may have happened in a step.
    may_have_passed: bool,
}

impl Sweep {
    /// Verifies the original. Returns its report as well.
    fn new(original: CurveSet, reductions: &[Reduction]) -> Result<(Sweep, Report)> {
        let mut session = match reductions {
            // Numbers of points differ, so another session looks at the motion.
            [Reduction::Share(_), ..] => Session::new(SessionOptions {
                events: Events::Off,
                ..options()
            })?,
            _ => Session::new(options())?,
        };
        let report = compare(&mut session, 0, &original)?;
        let sweep = Sweep {
            previous: original.clone(),
            original,
            session,
            seq: 0,
            passed: false,
            may_have_passed: false,
        };
        Ok((sweep, report))
    }

    fn step(&mut self, reduction: Reduction) -> Result<Step> {
        self.seq += 1;
        let curves = reduction.apply(&self.original)?;
        let mut report = compare(&mut self.session, self.seq, &curves)?;
        if let Reduction::Share(_) = reduction {
            self.add_motion(&curves, &mut report)?;
        }
        self.passed |= !report.events.is_empty();
        let undecided = report.defects.iter().any(|d| d.kind.is_of_step());
        self.may_have_passed |= undecided || !report.unresolved.is_empty();
        let found = !(report.defects.is_empty() && report.unresolved.is_empty());
        let verdict = if self.passed || !report.changes.is_empty() {
            Verdict::Changed
        } else if report.has_contact() {
            Verdict::Contact
        } else if self.may_have_passed || found {
            Verdict::Undecided
        } else {
            Verdict::Intact
        };
        let points = curves.points();
        self.previous = curves;
        Ok(Step {
            reduction,
            points,
            verdict,
            report,
        })
    }

    /// Adds the pull-throughs of the motion from the previous step to curves with other numbers of
    /// points.
    fn add_motion(&self, curves: &CurveSet, report: &mut Report) -> Result<()> {
        let by = match self.seq {
            1 => By::Length,
            _ => By::Segments,
        };
        let [from, to] = refine((&self.previous, by), (curves, By::Segments))?;
        let mut session = Session::new(SessionOptions {
            strategy: Strategy::Full,
            ..options()
        })?;
        let _ = verify(&mut session, 0, &from.set)?;
        let mut motion = verify(&mut session, 1, &to.set)?;
        for event in motion.events.iter_mut().chain(&mut motion.unresolved) {
            let [s, t] = event.segments;
            event.segments = [to.segment(event.i, s), to.segment(event.j, t)];
        }
        for mut defect in motion.defects.into_iter().filter(|d| d.kind.is_of_step()) {
            let [s, t] = defect.place.segments;
            let j = defect.j.unwrap_or(defect.i);
            defect.place.segments = [to.segment(defect.i, s), to.segment(j, t)];
            report.defects.push(defect);
        }
        report.defects.sort_by_key(|d| (d.i, d.j));
        report.events = motion.events;
        report.unresolved = motion.unresolved;
        Ok(())
    }
}

fn options() -> SessionOptions {
    SessionOptions {
        strategy: Strategy::Incremental,
        events: Events::Between,
        keep_open: true,
        // The model is a file of the user, and no simulator waits.
        max_pairs: usize::MAX,
        ..SessionOptions::default()
    }
}

/// Compares the linking numbers of curves with those of the first ones. Open curves have none.
fn compare(session: &mut Session, seq: u64, set: &CurveSet) -> Result<Report> {
    match verify(session, seq, set) {
        // Only their pull-throughs are searched for.
        Err(Error::NothingClosed { .. }) if !set.is_empty() => {
            Ok(Report::new(seq, 0.0, Verdict::Intact))
        }
        verified => verified,
    }
}

/// Verifies a frame.
///
/// Errors: those of [`Session::verify`], and the reason why the frame is rejected.
fn verify(session: &mut Session, seq: u64, set: &CurveSet) -> Result<Report> {
    let frame = Received::new(FrameInfo::at(seq, 0.0), Ok(Arc::new(set.clone())));
    let report = session.verify(frame)?.report;
    match report.rejected.clone() {
        Some(why) => Err(usage(why)),
        None => Ok(report),
    }
}

/// Rounds all control points to a grid of 2^`bits` cells along each axis of their bounding box, as
/// a file of `bits` bits per coordinate does. Each coordinate becomes the middle of its cell, in
/// the precision of the curves. An axis along which all points agree is kept.
fn quantize(set: &CurveSet, bits: u32) -> Result<CurveSet> {
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for p in points(set) {
        low = [0, 1, 2].map(|x| low[x].min(p[x]));
        high = [0, 1, 2].map(|x| high[x].max(p[x]));
    }
    let cells = 2f64.powi(bits as i32);
    let round = |p: Point| {
        [0, 1, 2].map(|x| {
            // Halved, since the difference of two finite numbers may be infinite.
            let half = 0.5 * high[x] - 0.5 * low[x];
            if half == 0.0 {
                return p[x];
            }
            let share = (0.5 * p[x] - 0.5 * low[x]) / half;
            let cell = (share * cells).floor().clamp(0.0, cells - 1.0);
            let middle = (cell + 0.5) / cells;
            // A convex combination, so that it does not overflow either.
            low[x] * (1.0 - middle) + high[x] * middle
        })
    };
    let counts: Vec<i32> = set.counts().collect();
    from_points(set, &counts, points(set).map(round))
}

/// Returns all control points in order.
fn points(set: &CurveSet) -> impl Iterator<Item = Point> + '_ {
    let curves = set.curves().iter().enumerate();
    curves.flat_map(move |(i, c)| (0..c.points as usize).map(move |k| set.point(i, k)))
}

/// Returns a set of curves with the basis and the precision of another one.
fn from_points(
    like: &CurveSet,
    counts: &[i32],
    points: impl Iterator<Item = Point>,
) -> Result<CurveSet> {
    let xyz: Vec<f64> = points.flatten().collect();
    if like.precision() == Precision::F64 {
        return CurveSet::from_counts(like.basis(), counts, Positions::F64(&xyz));
    }
    let xyz: Vec<f32> = xyz.into_iter().map(|x| x as f32).collect();
    CurveSet::from_counts(like.basis(), counts, Positions::F32(&xyz))
}

/// Runs the command.
pub fn run(args: &Args) -> Result<u8> {
    let reductions = reductions(args)?;
    let name = &args.input;
    let set = input::read(name)?;
    for reduction in &reductions {
        if let Reduction::Share(share) = *reduction {
            resample::check(&set, share)?;
        }
    }
    let (mut sweep, original) = Sweep::new(set, &reductions)?;
    for defect in &original.defects {
        println!(
            "{name}: {}",
            defect.sentence_named(original.stats.extent, &[])
        );
    }
    println!(
        "{name}: {} of {}, {}",
        plural(sweep.original.len(), "curve"),
        plural(sweep.original.points(), "control point"),
        plural(
            sweep.session.baseline().map_or(0, |b| b.links().len()),
            "link"
        )
    );
    println!(
        "{:>24} {:>10} {:>13} {:>13} {:>9}  verdict",
        "step", "points", "changed links", "pull-throughs", "undecided"
    );
    let mut steps: Vec<Step> = Vec::new();
    for reduction in reductions {
        let step = sweep.step(reduction)?;
        let [changed, passed, undecided] = step.findings().map(|n| count(n as u64));
        println!(
            "{:>24} {:>10} {changed:>13} {passed:>13} {undecided:>9}  {}",
            step.reduction.to_string(),
            count(step.points as u64),
            step.verdict
        );
        steps.push(step);
    }
    let broken = steps.iter().find(|s| s.verdict == Verdict::Changed);
    let not_intact = steps.iter().find(|s| s.verdict != Verdict::Intact);
    let words = conclusion(&steps, broken);
    println!("{name}: {words}");
    if let Some(step) = broken.or(not_intact) {
        explain(step);
    }
    if let Some(file) = &args.plot {
        let model = Path::new(name).file_name().unwrap_or_default();
        plot(format!("{}: {words}", model.to_string_lossy()), &steps).write(file)?;
    }
    Ok(match (broken, not_intact) {
        (Some(_), _) => 1,
        (None, Some(_)) => 3,
        (None, None) => 0,
    })
}

/// Returns the result in a few words.
fn conclusion(steps: &[Step], broken: Option<&Step>) -> String {
    let intact = steps
        .iter()
        .take_while(|s| s.verdict == Verdict::Intact)
        .count();
    let until = match intact.checked_sub(1) {
        Some(last) => format!("intact down to {}", steps[last].reduction),
        None => "no step is intact".to_owned(),
    };
    match broken {
        Some(step) => format!("{until}, broken at {}", step.reduction),
        None if intact < steps.len() => {
            format!("{until}, undecided at {}", steps[intact].reduction)
        }
        None => until,
    }
}

/// Prints the findings of the first broken or undecided step.
fn explain(step: &Step) {
    let report = &step.report;
    let changes = report.changes.iter().map(|c| [c.i, c.j]);
    let events = report.events.iter().chain(&report.unresolved);
    let defects = report.defects.iter().map(|d| [d.i, d.j.unwrap_or(d.i)]);
    let curves = changes.chain(events.map(|e| [e.i, e.j])).chain(defects);
    let curves: BTreeSet<u32> = curves.flatten().collect();
    let listed: Vec<String> = curves.iter().map(u32::to_string).collect();
    println!(
        "{}: {}: {}",
        step.reduction,
        plural(curves.len(), "curve"),
        listed.join(", ")
    );
    let findings: Vec<String> = report.findings().collect();
    for finding in findings.iter().take(SENTENCES) {
        println!("  {finding}");
    }
    if findings.len() > SENTENCES {
        println!("  and {} more", findings.len() - SENTENCES);
    }
}

/// Plots the findings of each step.
fn plot(title: String, steps: &[Step]) -> Plot {
    const NAMES: [&str; 3] = ["changed links", "pull-throughs", "undecided"];
    let series = NAMES.into_iter().enumerate().map(|(k, name)| {
        // The axis is logarithmic.
        let point = |step: &Step| (step.reduction.value(), (step.findings()[k] as f64).max(0.1));
        Series::marks(name, steps.iter().map(point).collect())
    });
    Plot {
        title,
        x: match steps.first().map(|s| s.reduction) {
            Some(Reduction::Bits(_)) => "bits per coordinate",
            _ => "share of the control points, in %",
        },
        y: "findings of a step (0 drawn at 0.1); pull-throughs since the step before",
        series: series.collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use linkwatch::Basis;

    fn sweep(set: CurveSet, reductions: &[Reduction]) -> Vec<Step> {
        let (mut sweep, _) = Sweep::new(set, reductions).unwrap();
        let steps = reductions.iter().map(|&reduction| sweep.step(reduction));
        steps.map(Result::unwrap).collect()
    }

    fn set(counts: &[i32], xyz: &[f64]) -> CurveSet {
        CurveSet::from_counts(Basis::Polyline, counts, Positions::F64(xyz)).unwrap()
    }

    #[test]
    fn coordinates_become_the_middle_of_their_cell() {
        // Four cells of 2 along x; z is flat.
        let set = set(&[-3], &[0., 0., 5., 8., 4., 5., 3.9, 1.1, 5.]);
        let coarse = quantize(&set, 2).unwrap();
        let points: Vec<Point> = points(&coarse).collect();
        assert_eq!(points, [[1., 0.5, 5.], [7., 3.5, 5.], [3., 1.5, 5.]]);
        let most = f64::MAX;
        let coarse = super::quantize(
            &self::set(&[-3], &[-most, 0., 0., most, 0., 0., 0., 1., 0.]),
            4,
        );
        assert!(coarse.unwrap().max_abs() < most);
    }

    #[test]
    fn many_bits_keep_a_knit_intact_and_few_do_not() {
        let knit = input::read("knit:rows=4,stitches=24,segments=1152").unwrap();
        let bits: Vec<Reduction> = (2..=16).rev().map(Reduction::Bits).collect();
        let verdicts: Vec<Verdict> = sweep(knit, &bits).iter().map(|s| s.verdict).collect();
        assert_eq!(verdicts[..6], [Verdict::Intact; 6], "{verdicts:?}");
        let first = verdicts.iter().position(|v| *v != Verdict::Intact).unwrap();
        let later = &verdicts[first..];
        assert!(later.iter().all(|v| *v != Verdict::Intact), "{verdicts:?}");
    }

    #[test]
    fn fewer_points_break_a_knit_and_most_points_do_not() {
        let knit = input::read("knit:rows=3,stitches=16,segments=1152").unwrap();
        let shares = [1.0, 0.8, 0.6, 0.4, 0.3, 0.2, 0.15, 0.1].map(Reduction::Share);
        let steps = sweep(knit.clone(), &shares);
        let verdicts: Vec<Verdict> = steps.iter().map(|s| s.verdict).collect();
        assert_eq!(verdicts[..3], [Verdict::Intact; 3], "{verdicts:?}");
        assert!(verdicts.contains(&Verdict::Changed), "{verdicts:?}");
        for (step, reduction) in steps.iter().zip(shares) {
            let curves = reduction.apply(&knit).unwrap();
            for event in &step.report.events {
                for (i, s) in [event.i, event.j].into_iter().zip(event.segments) {
                    assert!(s < curves.curve(i as usize).segments, "{event:?}");
                }
            }
        }
        assert!(steps.iter().any(|s| !s.report.events.is_empty()));
    }

    /// A bar goes through a ring in two strands, there and back, so its linking number is 0. On a
    /// coarse grid, both strands are outside the ring, and the linking number is still 0.
    #[test]
    fn pull_throughs_that_cancel_are_not_missed() {
        // Corners of the bounding box. On a grid of four cells, coordinates become 2, 6, 10 and 14.
        let corners = [0., 0., 0., 16., 0., 0., 16., 16., 0., 16., 16., 16.];
        let ring = [1.9, 9.9, 6., 13.9, 5.9, 6., 1.9, 1.9, 6.];
        // Both strands move from below the first side of the ring to (6, 10), above it.
        let bar = [
            4.1, 8.1, 2.5, 4.1, 8.1, 13.5, 1., 15., 15., 4.5, 8.2, 13.5, 4.5, 8.2, 2.5, 1., 15., 1.,
        ];
        let set = set(&[-4, -3, -6], &[&corners[..], &ring, &bar].concat());
        let steps = sweep(set, &[8, 6, 2].map(Reduction::Bits));
        let verdicts: Vec<Verdict> = steps.iter().map(|s| s.verdict).collect();
        assert_eq!(verdicts[..2], [Verdict::Intact; 2]);
        assert_ne!(verdicts[2], Verdict::Intact);
        let report = &steps[2].report;
        assert!(report.changes.is_empty(), "{:?}", report.changes);
        let found = report.events.iter().chain(&report.unresolved);
        let pairs: Vec<(u32, u32)> = found.map(|e| (e.i, e.j)).collect();
        assert_eq!(pairs, [(1, 2), (1, 2)]);
    }

    #[test]
    fn open_curves_are_swept_for_pull_throughs() {
        let point = |k: usize| {
            let t = k as f64 * 0.1;
            [t.cos(), t.sin(), 0.02 * t]
        };
        let xyz: Vec<f64> = (0..100).flat_map(point).collect();
        let set = CurveSet::from_counts(Basis::CatmullRom, &[100], Positions::F64(&xyz)).unwrap();
        let steps = sweep(set, &[20, 16].map(Reduction::Bits));
        assert!(steps.iter().all(|s| s.verdict == Verdict::Intact));
    }
}
