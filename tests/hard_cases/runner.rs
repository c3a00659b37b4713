//! Runs the hard cases through any kernel.

use crate::case::{Answer, Case};
use crate::support::session::Step;
use crate::{integers, links, numbers, splines, touching};
use linkwatch::kernels::{Accuracy, Device, Method};
use linkwatch::{
    Certificate, Certifier, Change, CurveSet, Defect, DefectKind, Events, Link, Positions,
    Precision, Session, SessionOptions, Strategy, Verdict,
};
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook};
use std::sync::Once;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Returns all hard cases.
pub fn collection() -> Vec<Case> {
    let parts = [
        integers::cases(),
        links::cases(),
        numbers::cases(),
        touching::cases(),
        splines::cases(),
    ];
    parts.into_iter().flatten().collect()
}

/// Requirement on a kernel. No kernel may ever return a wrong integer.
#[derive(Clone, Copy, PartialEq)]
#[allow(dead_code, reason = "later kernels may leave pairs undecided")]
pub enum Rule {
    /// The kernel must decide every case.
    Complete,
    /// The kernel may leave any pair undecided.
    Honest,
}

/// A kernel: maps curves to a certificate.
#[derive(Clone, Copy)]
pub struct Kernel {
    pub name: &'static str,
    pub rule: Rule,
    pub certify: fn(&CurveSet) -> Certificate,
}

/// Computes a single frame in full.
pub const FULL: Kernel = Kernel {
    name: "certify",
    rule: Rule::Complete,
    certify: |set| Certifier::default().certify(set).0.clone(),
};

/// Verifies a frame that does not move, by an incremental session.
pub const STILL: Kernel = Kernel {
    name: "incremental, still",
    rule: Rule::Complete,
    certify: |set| last_of([set, set, set], Events::Off),
};

/// Verifies a frame after a jump. In the previous frame, the first curve had the opposite
/// direction.
pub const JUMP: Kernel = Kernel {
    name: "incremental, jump",
    rule: Rule::Complete,
    certify: |set| {
        let before = changed(set, |coordinates| {
            let n = 3 * set.curve(0).points as usize;
            coordinates[..n].as_chunks_mut::<3>().0[1..].reverse();
        });
        last_of([&before, &before, set], Events::Off)
    },
};

/// Verifies a frame after growth. In the previous frame, all curves were tiny.
pub const GROWTH: Kernel = Kernel {
    name: "incremental, growth",
    rule: Rule::Complete,
    certify: |set| {
        let before = changed(set, |coordinates| {
            coordinates.iter_mut().for_each(|x| *x *= 2f64.powi(-40));
        });
        last_of([&before, &before, set], Events::Off)
    },
};

/// Verifies a jump with a search for pull-throughs, self-crossings included.
pub const EVENTS: Kernel = Kernel {
    name: "pull-throughs",
    rule: Rule::Complete,
    certify: |set| {
        let before = changed(set, |coordinates| coordinates[..3].fill(0.0));
        last_of([&before, set, set], Events::All)
    },
};

/// Returns the same curves with other coordinates.
pub fn changed(set: &CurveSet, change: impl Fn(&mut [f64])) -> CurveSet {
    let points = |i: usize| (0..set.curve(i).points as usize).map(move |k| set.point(i, k));
    let mut coordinates: Vec<f64> = (0..set.len()).flat_map(points).flatten().collect();
    change(&mut coordinates);
    let mut out = set.clone();
    match set.precision() {
        Precision::F64 => out.update(Positions::F64(&coordinates)),
        Precision::F32 => {
            let singles: Vec<f32> = coordinates.iter().map(|&x| x as f32).collect();
            out.update(Positions::F32(&singles))
        }
    }
    .expect("finite coordinates");
    out
}

/// Returns the certificate of the last frame by a paranoid incremental session. Its baseline has
/// no links, so the report has all of them.
fn last_of(frames: [&CurveSet; 3], events: Events) -> Certificate {
    let curves = frames[0].len();
    let nothing = Certificate::new(curves, Vec::new(), Vec::new());
    let mut session = Session::new(SessionOptions {
        baseline: Some(nothing),
        strategy: Strategy::Paranoid,
        keep_open: true,
        events,
        ..SessionOptions::default()
    })
    .expect("valid options");
    let mut certificate = Certificate::default();
    for (seq, set) in (0..).zip(frames) {
        let verified = session.step(seq, set);
        assert!(!verified.work.disagreed, "incremental and full differ");
        let report = verified.report;
        let link = |c: &Change| Link {
            i: c.i,
            j: c.j,
            lambda: c.found,
        };
        let lasting = report.defects.into_iter().filter(|d| !d.kind.is_of_step());
        let links = report.changes.iter().map(link).collect();
        certificate = Certificate::new(curves, links, lasting.collect());
        session.settle();
    }
    certificate
}

/// Returns the certificate of the first of two equal frames with early exit, after checking that
/// the second one equals it.
pub const EARLY_EXIT: Kernel = Kernel {
    name: "early exit",
    rule: Rule::Complete,
    certify: |set| {
        let mut session = Session::new(SessionOptions {
            early_exit: true,
            keep_open: true,
            ..SessionOptions::default()
        })
        .expect("valid options");
        session.step(0, set);
        let baseline = session.baseline().expect("the first frame").clone();
        let report = session.step(1, set).report;
        assert_eq!(report.changes, []);
        assert_eq!(report.defects, baseline.undefined());
        assert_eq!(report.stats.unchecked, 0);
        let touch = |d: &Defect| d.kind == DefectKind::Contact;
        let verdict = match baseline.undefined() {
            [] => Verdict::Intact,
            defects if defects.iter().any(touch) => Verdict::Contact,
            _ => Verdict::Undecided,
        };
        assert_eq!(report.verdict, verdict);
        baseline
    },
};

/// Kernels that sum. Pairs that their bound does not decide are counted.
pub const SUMS: [Kernel; 7] = [
    Kernel {
        name: "direct",
        rule: Rule::Complete,
        certify: |set| summed(set, Method::Direct, None),
    },
    Kernel {
        name: "angle sum",
        rule: Rule::Complete,
        certify: |set| summed(set, Method::AngleSum, None),
    },
    Kernel {
        name: "Barnes-Hut",
        rule: Rule::Complete,
        certify: |set| summed(set, Method::BarnesHut, None),
    },
    Kernel {
        name: "Barnes-Hut, beta 2",
        rule: Rule::Complete,
        certify: |set| summed(set, Method::BarnesHut, Some(2.0)),
    },
    Kernel {
        name: "fast multipole method",
        rule: Rule::Complete,
        certify: |set| summed(set, Method::Fmm, None),
    },
    Kernel {
        name: "fast multipole method, order 4",
        rule: Rule::Complete,
        certify: |set| {
            let order = Some(4);
            let accuracy = Accuracy {
                order,
                ..Accuracy::default()
            };
            summed_with(set, Method::Fmm, accuracy)
        },
    },
    INTERVAL,
];

/// Arai's interval arithmetic, which is slow.
pub const INTERVAL: Kernel = Kernel {
    name: "interval",
    rule: Rule::Complete,
    certify: |set| summed(set, Method::Interval, None),
};

/// Kernels on a GPU.
#[allow(dead_code, reason = "used only if there is a GPU")]
pub const ON_DEVICE: [Kernel; 3] = [
    Kernel {
        name: "crossings on the GPU",
        rule: Rule::Complete,
        certify: |set| certified_on(&Device::Gpu, set, (Method::Crossings, Accuracy::default())),
    },
    Kernel {
        name: "direct on the GPU",
        rule: Rule::Complete,
        certify: |set| certified_on(&Device::Gpu, set, (Method::Direct, Accuracy::default())),
    },
    Kernel {
        name: "Barnes-Hut on the GPU",
        rule: Rule::Complete,
        certify: |set| certified_on(&Device::Gpu, set, (Method::BarnesHut, Accuracy::default())),
    },
];

fn summed(set: &CurveSet, method: Method, beta: Option<f64>) -> Certificate {
    let accuracy = Accuracy {
        beta,
        ..Accuracy::default()
    };
    summed_with(set, method, accuracy)
}

fn summed_with(set: &CurveSet, method: Method, accuracy: Accuracy) -> Certificate {
    certified_on(&Device::Cpu, set, (method, accuracy))
}

fn certified_on(
    device: &Device,
    set: &CurveSet,
    (kernel, accuracy): (Method, Accuracy),
) -> Certificate {
    let mut certifier = Certifier::new(&SessionOptions {
        kernel,
        accuracy,
        device: device.clone(),
        ..SessionOptions::default()
    })
    .expect("an adapter");
    certifier.certify(set).0.clone()
}

/// Number of panics of any thread, including those that the library catches.
static PANICS: AtomicUsize = AtomicUsize::new(0);

/// Counts panics from now on. Returns their number so far.
pub fn count_panics() -> usize {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        set_hook(Box::new(|panic| {
            PANICS.fetch_add(1, Ordering::Relaxed);
            eprintln!("{panic}");
        }));
    });
    PANICS.load(Ordering::Relaxed)
}

/// Returns thread pools of 1 and of 3 threads.
pub fn pools() -> Vec<ThreadPool> {
    let pool = |n| ThreadPoolBuilder::new().num_threads(n).build();
    [1, 3].map(|n| pool(n).expect("threads")).into()
}

/// Views of a case to run: precisions and variants.
#[derive(Clone, Copy)]
pub enum Views {
    All,
    /// One view, chosen in turn.
    Turn(usize),
}

/// Runs views of a case through a kernel, in every pool, and catches panics. Returns the errors as
/// texts.
pub fn complaints(case: &Case, kernel: Kernel, views: Views, pools: &[ThreadPool]) -> Vec<String> {
    let mut out = Vec::new();
    let mut cases: Vec<Case> = case.precisions().iter().flat_map(Case::variants).collect();
    if let Views::Turn(turn) = views {
        let at = turn % cases.len();
        cases = cases.split_off(at);
        cases.truncate(1);
    }
    for case in cases {
        let mut first = None;
        for pool in pools {
            let run = || pool.install(|| (kernel.certify)(&case.curves));
            let found = catch_unwind(AssertUnwindSafe(run));
            let wrong = match &found {
                Ok(certificate) => check(&case, certificate, kernel.rule),
                Err(_) => vec!["panics".into()],
            };
            out.extend(
                wrong
                    .iter()
                    .map(|w| format!("{}, {}: {w}", case.name, kernel.name)),
            );
            // Compared as text, because NaN differs from itself.
            let words = found.ok().map(|c| format!("{c:?}"));
            if *first.get_or_insert_with(|| words.clone()) != words {
                out.push(format!(
                    "{}, {}: depends on the threads",
                    case.name, kernel.name
                ));
            }
        }
    }
    out
}

/// Compares a certificate with the exact answer.
fn check(case: &Case, certificate: &Certificate, rule: Rule) -> Vec<String> {
    let mut wrong = Vec::new();
    let n = case.curves.len();
    if certificate.curves() != n {
        wrong.push(format!("{} curves", certificate.curves()));
    }
    let links = certificate.links();
    let lambdas: BTreeMap<_, _> = links
        .iter()
        .map(|l| ((l.i as usize, l.j as usize), l.lambda))
        .collect();
    if !links.is_sorted_by(|a, b| (a.i, a.j) < (b.i, b.j))
        || links.iter().any(|l| l.i >= l.j || l.lambda == 0)
    {
        wrong.push("links are not sorted or not links".into());
    }
    let undefined = certificate.undefined();
    if !undefined.is_sorted_by(|a, b| (a.i, a.j) < (b.i, b.j)) {
        wrong.push("defects are not sorted".into());
    }
    let kinds: BTreeMap<_, _> = undefined
        .iter()
        .map(|d| ((d.i as usize, d.j.map(|j| j as usize)), d.kind))
        .collect();
    for d in undefined {
        if !d.place.point.iter().all(|x| x.is_finite())
            || d.place.distance.is_nan()
            || d.place.distance < 0.0
        {
            wrong.push(format!("{:?} has no place: {:?}", (d.i, d.j), d.place));
        }
    }
    let degenerate = &case.expected.degenerate;
    for i in 0..n {
        let expected = degenerate.contains(&i).then_some(&DefectKind::Degenerate);
        let found = kinds.get(&(i, None));
        if found != expected {
            wrong.push(format!("curve {i} is {found:?}, not {expected:?}"));
        }
    }
    for j in 0..n {
        for i in 0..j {
            let kind = kinds.get(&(i, Some(j)));
            let lambda = lambdas.get(&(i, j));
            if degenerate.contains(&i) || degenerate.contains(&j) {
                if kind.is_some() || lambda.is_some() {
                    wrong.push(format!("({i}, {j}) is degenerate, not {kind:?} {lambda:?}"));
                }
                continue;
            }
            let answer = case.expected.of(i, j);
            let number = lambda.copied().unwrap_or(0);
            let right = match (answer, kind) {
                (_, Some(_)) if lambda.is_some() => false,
                (Answer::Number(expected) | Answer::Near(expected), None) => number == expected,
                (Answer::Contact | Answer::Touching, None) => false,
                (Answer::Contact, Some(DefectKind::Contact)) => true,
                (Answer::Touching, Some(DefectKind::Contact | DefectKind::TooClose)) => true,
                (Answer::Near(_), Some(DefectKind::TooClose)) => true,
                // A kernel may be unable to decide. But it must not claim a contact where there is
                // none.
                (_, Some(kind)) => rule == Rule::Honest && *kind != DefectKind::Contact,
            };
            if !right {
                wrong.push(format!("({i}, {j}) is {answer:?}, found {number} {kind:?}"));
            }
        }
    }
    wrong
}
