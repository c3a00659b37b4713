//! Two sessions that must agree, and checks of their reports.

use crate::support::session::Step;
use linkwatch::{
    Certifier, CurveLabels, CurveSet, Defect, DefectKind, Events, FrameInfo, Positions, Precision,
    RawFrame, Report, Route, Session, SessionOptions, Strategy, Verdict, VerifiedFrame,
};
use std::collections::BTreeMap;

/// A session under test, and a reference session that must give the same reports.
pub struct Both {
    incremental: Session,
    full: Session,
    /// Number of the layout, and the curves of the last frame.
    layout: u32,
    last: Option<CurveSet>,
    pub tally: Tally,
    /// Check of pull-throughs against linking numbers, if pull-throughs are searched for.
    pub balance: Option<Balance>,
}

impl Both {
    pub fn new(events: Events) -> Both {
        let [incremental, full] = [Strategy::Incremental, Strategy::Full].map(|strategy| {
            Session::new(SessionOptions {
                strategy,
                events,
                keep_open: true,
                ..SessionOptions::default()
            })
            .unwrap()
        });
        Both {
            incremental,
            full,
            layout: 0,
            last: None,
            tally: Tally::default(),
            balance: (events != Events::Off).then(Balance::new),
        }
    }

    /// Verifies a frame incrementally. Most frames are passed as positions, as in a live run, and
    /// some as a set.
    fn verify_incrementally(&mut self, info: FrameInfo, set: &CurveSet) -> VerifiedFrame {
        if info.seq % 5 == 3 {
            return self.incremental.step_at(info, set);
        }
        let mut bytes = Vec::new();
        set.write_positions(&mut bytes);
        let single: Vec<f32>;
        let double: Vec<f64>;
        let positions = match set.precision() {
            Precision::F32 => {
                let values = bytes.as_chunks().0.iter();
                single = values.map(|b| f32::from_le_bytes(*b)).collect();
                Positions::F32(&single)
            }
            Precision::F64 => {
                let values = bytes.as_chunks().0.iter();
                double = values.map(|b| f64::from_le_bytes(*b)).collect();
                Positions::F64(&double)
            }
        };
        let frame_in_memory = RawFrame {
            basis: set.basis(),
            counts: &set.counts().collect::<Vec<_>>(),
            positions,
        };
        self.incremental.step_at(info, frame_in_memory)
    }

    /// Verifies a frame by both sessions, compares the reports, and returns one.
    pub fn step(&mut self, frame: u64, set: &CurveSet, what: &dyn std::fmt::Display) -> Report {
        let same = |last: &CurveSet| {
            let same = (last.basis(), last.precision()) == (set.basis(), set.precision());
            same && last.counts().eq(set.counts())
        };
        self.layout += u32::from(!self.last.as_ref().is_none_or(same));
        self.last = Some(set.clone());
        let names = CurveLabels::named((0..set.len()).map(|i| i.to_string()));
        let info = FrameInfo::at(frame, 0.5).with_labels(self.layout, names);
        let verified = self.verify_incrementally(info.clone(), set);
        let (found, work) = (verified.report, verified.work);
        let mut expected = self.full.step_at(info, set).report;
        // Work counters depend on earlier frames, so only the sizes of the scene are compared.
        let sizes = |r: &Report| (r.stats.curves, r.stats.segments, r.stats.open_curves);
        assert_eq!(sizes(&found), sizes(&expected), "{what}, frame {frame}");
        expected.stats = found.stats;
        assert_eq!(found, expected, "{what}, frame {frame}");
        *match found.verdict {
            Verdict::Intact => &mut self.tally.intact,
            Verdict::Changed => &mut self.tally.changed,
            Verdict::Contact => &mut self.tally.contact,
            _ => &mut self.tally.undecided,
        } += 1;
        let defects = || found.defects.iter().map(|d| d.kind);
        // In every frame, the sum of the signs of the events is compared with the linking numbers.
        assert!(
            defects().all(|kind| kind != DefectKind::Unaccounted),
            "{what}, frame {frame}: {found:?}"
        );
        self.tally.events += found.events.len() as u64;
        self.tally.undecided_steps += defects().filter(|kind| kind.is_of_step()).count() as u64;
        self.tally.unsearched += u64::from(frame > 0 && work.searched == 0);
        *match work.route {
            Route::Full => &mut self.tally.full,
            Route::Quiet => &mut self.tally.quiet,
            Route::Partial => &mut self.tally.partial,
        } += 1;
        if let Some(balance) = &mut self.balance {
            balance.add(&found, set, &format!("{what}, frame {frame}"));
        }
        // Waits for most reference frames; some are ready only later.
        if frame % 4 != 3 {
            self.incremental.settle();
        }
        found
    }
}

/// Checks pull-throughs against linking numbers, over frames in which curves touch. Between two
/// frames in which a pair of closed curves has a linking number, it changes by the sum of the signs
/// of their pull-throughs.
pub struct Balance {
    numbers: Certifier,
    pairs: BTreeMap<(u32, u32), Since>,
    /// Number of sums over frames in which the pair touched, and how many of these are not 0.
    pub through_contact: [u64; 2],
}

/// State of a pair since the last frame in which it had a linking number.
#[derive(Clone, Copy)]
struct Since {
    /// Linking number in that frame; `None` if there was no such frame.
    lambda: Option<i64>,
    /// Sum of the signs of the pull-throughs.
    sum: i64,
    /// True if a step was undecided.
    undecided_step: bool,
    /// True if the curves touched.
    touched: bool,
}

impl Balance {
    fn new() -> Balance {
        Balance {
            numbers: Certifier::default(),
            pairs: BTreeMap::new(),
            through_contact: [0; 2],
        }
    }

    fn add(&mut self, report: &Report, set: &CurveSet, what: &str) {
        let (certificate, _) = self.numbers.certify(set);
        let closed = |i: &u32| set.curve(*i as usize).closed;
        let curves: Vec<u32> = (0..set.len() as u32).filter(closed).collect();
        for (k, &j) in curves.iter().enumerate() {
            for &i in &curves[..k] {
                let of_pair = |d: &&Defect| match d.j {
                    Some(other) => (d.i, other) == (i, j),
                    None => d.i == i || d.i == j,
                };
                let start = Since {
                    lambda: None,
                    sum: 0,
                    undecided_step: false,
                    touched: false,
                };
                let since = self.pairs.entry((i, j)).or_insert(start);
                let events = report.events.iter().chain(&report.unresolved);
                let own = events.filter(|e| (e.i, e.j) == (i, j));
                since.sum += own.map(|e| i64::from(e.sign)).sum::<i64>();
                let mut defects = report.defects.iter().filter(of_pair);
                since.undecided_step |= defects.any(|d| d.kind.is_of_step());
                if let Some(missing) = certificate.undefined().iter().find(of_pair) {
                    since.touched |= missing.kind == DefectKind::Contact;
                    // The polylines do not represent a loop of fewer than three points, or splines
                    // that are too close.
                    since.undecided_step |= missing.kind != DefectKind::Contact;
                    continue;
                }
                let link = certificate.links().iter().find(|l| (l.i, l.j) == (i, j));
                let lambda = link.map_or(0, |l| l.lambda);
                if let Some(before) = since.lambda.filter(|_| !since.undecided_step) {
                    assert_eq!(
                        lambda,
                        before + since.sum,
                        "{what}, pair {i} {j}: {report:?}"
                    );
                    self.through_contact[0] += u64::from(since.touched);
                    self.through_contact[1] += u64::from(since.touched && since.sum != 0);
                }
                *since = Since {
                    lambda: Some(lambda),
                    ..start
                };
            }
        }
    }
}

/// Numbers of frames and findings.
#[derive(Debug, Default)]
pub struct Tally {
    pub intact: u64,
    pub changed: u64,
    pub contact: u64,
    pub undecided: u64,
    pub full: u64,
    pub quiet: u64,
    pub partial: u64,
    /// Number of pull-throughs, and of undecided steps.
    pub events: u64,
    pub undecided_steps: u64,
    /// Number of frames that were not searched for pull-throughs, although they moved.
    pub unsearched: u64,
}

impl Tally {
    pub fn add(&mut self, o: &Tally) {
        self.intact += o.intact;
        self.changed += o.changed;
        self.contact += o.contact;
        self.undecided += o.undecided;
        self.full += o.full;
        self.quiet += o.quiet;
        self.partial += o.partial;
        self.events += o.events;
        self.undecided_steps += o.undecided_steps;
        self.unsearched += o.unsearched;
    }
}
