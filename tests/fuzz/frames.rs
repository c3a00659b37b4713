//! Frames that a raw publisher sends through the bus to a watcher. The watcher receives them by the
//! crate's [`Sidecar`], checks, verifies and answers them, like `linkwatch watch`.
//!
//! Each mutated frame is followed by a valid one, which must get its verdict.

use super::frame::{Frame, Scene};
use super::memory::peak;
use super::mutations::{ByteChange, CURVES, Effect, HEADER, LAYOUT, PAYLOAD, SHAPES};
use super::oracle::{Expected, Known, Reason, has_possible_number, judge};
use super::support::random::Random;
use super::support::raw_bus::{Header, RawSimulator};
use super::support::session::Step;
use super::{service, units};
use linkwatch::{
    Certificate, CurveSet, Error, Event, Events, FrameInfo, LastLabels, Received, Report, Session,
    SessionOptions, Sidecar, SidecarOptions, Strategy, Verdict,
};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Maximum size of a frame that the watcher accepts, in bytes.
const CAP: usize = 1 << 15;

/// Maximum number of bytes that the watcher may allocate for one frame, per byte of [`CAP`]. Curves
/// of few points need this much for the copy, the arrays, the hierarchy and the reference frame.
const MEMORY: usize = 64;

/// Maximum number of bytes for one frame of splines, because two that nearly touch are split many
/// times.
const SPLINES: usize = 64 << 20;

/// Number of frames of a session, half of which are mutated.
const SESSION: u64 = 200;

/// Reaction of a watcher to a message.
enum Answer {
    Report(Box<Report>, Option<Arc<CurveSet>>),
    Unreadable(String),
    /// Neither a frame nor unreadable.
    Other,
}

/// A watcher built from the parts of the crate, without the command and its sinks.
struct Watcher {
    sidecar: Sidecar,
    options: SessionOptions,
    session: Session,
    labels: LastLabels,
}

impl Watcher {
    fn open(service: &str) -> Watcher {
        let mut options = SidecarOptions::default();
        options.max_frame_bytes = CAP;
        Watcher {
            sidecar: Sidecar::open(service, &options).expect("sidecar"),
            options: SessionOptions::default(),
            session: Session::new(SessionOptions::default()).expect("options"),
            labels: LastLabels::default(),
        }
    }

    /// Answers everything that was sent. Returns the last answer.
    fn answer(&mut self) -> Answer {
        let mut answer = Answer::Other;
        loop {
            match self.sidecar.wait(Duration::ZERO).expect("wait") {
                Event::Idle => return answer,
                Event::Unreadable(why) => answer = Answer::Unreadable(why.to_string()),
                Event::NewSession { .. } => {
                    self.session = Session::new(self.options.clone()).expect("options");
                }
                Event::Frame(frame) => {
                    let (report, curves) = self.verify(frame);
                    let sent = self.sidecar.send_verdict(&report, Duration::ZERO);
                    sent.expect("send a verdict");
                    answer = Answer::Report(Box::new(report), curves);
                }
                _ => {}
            }
        }
    }

    /// Verifies a frame like the sessions of the command.
    fn verify(&mut self, frame: linkwatch::Frame) -> (Report, Option<Arc<CurveSet>>) {
        let (seq, time) = (frame.seq(), frame.time());
        let received = match frame.info(&mut self.labels) {
            Ok(info) if info.cell.is_some() => {
                let what = "a periodic cell in a scene without one";
                Received::new(info, Err(Error::Usage(what.into())))
            }
            Ok(info) => self.session.receive(info, |copy| frame.read(copy)),
            Err(why) => Received::new(FrameInfo::at(seq, time), Err(why)),
        };
        drop(frame);
        match self.session.verify(received) {
            Ok(verified) => (verified.report, verified.curves),
            Err(why) => {
                let mut report = Report::new(seq, time, Verdict::Rejected);
                report.rejected = Some(why.to_string());
                (report, None)
            }
        }
    }
}

/// A simulator that sends valid and mutated frames, and checks the reaction of the watcher to each.
struct Fuzzer<'a> {
    simulator: &'a RawSimulator,
    watcher: &'a mut Watcher,
    changes: &'a [&'a [ByteChange]],
    known: Known,
    scene: Scene,
    /// Layout number of the frames, and the largest one that any frame claimed.
    layout: u32,
    largest_layout: u32,
    cuts: u32,
    baseline: Option<Certificate>,
    most_memory: usize,
    /// Code of the basis of the last frame that was sent.
    last_basis: u32,
    tally: Tally,
}

/// Numbers of mutated frames by the reaction of the watcher.
#[derive(Default, Debug)]
struct Tally {
    rejected: u64,
    unreadable: u64,
    signals: u64,
    accepted: u64,
    compared: u64,
    good: u64,
}

impl Fuzzer<'_> {
    /// Sends a message and returns the answer to it.
    fn exchange(&mut self, frame: &Frame, names: &[&str]) -> Answer {
        self.simulator.send(frame.header, &frame.payload);
        let (answer, bytes) = peak(|| self.watcher.answer());
        self.most_memory = self.most_memory.max(bytes);
        // The watcher may have kept the frame before, which then counts here: the first frame of
        // a session waits for its baseline until another session begins.
        let before = std::mem::replace(&mut self.last_basis, frame.header.basis);
        let splines = [before, frame.header.basis]
            .iter()
            .any(|basis| (1..=3).contains(basis));
        let most = if splines { SPLINES } else { MEMORY * CAP };
        assert!(
            bytes <= most,
            "{names:?}: {bytes} bytes for a frame, limit {most}"
        );
        answer
    }

    /// Starts another session with other curves.
    fn restart(&mut self, random: &mut Random) {
        self.known = Known {
            session: random.next() | 1,
            seq: None,
            first: None,
            baseline: false,
            verified: None,
            cap: CAP,
            events: false,
        };
        self.scene = Scene::random(random);
        (self.layout, self.largest_layout, self.cuts) = (1, 1, 0);
        self.watcher.options = SessionOptions {
            strategy: random.pick(&[Strategy::Incremental, Strategy::Incremental, Strategy::Full]),
            events: if random.one_in(8) {
                Events::Between
            } else {
                Events::Off
            },
            keep_open: true,
            ..SessionOptions::default()
        };
        self.known.events = self.watcher.options.events != Events::Off;
        self.baseline = None;
    }

    fn next_frame(&self, scene: &Scene, layout: u32) -> Frame {
        let seq = self.known.seq.map_or(0, |seq| seq + 1);
        let mut frame = scene.frame(self.known.session, seq, layout);
        frame.header.cuts = self.cuts;
        frame.header.baseline = self.known.first.unwrap_or(seq);
        frame
    }

    /// Sends a valid frame, which must be intact.
    fn good(&mut self, random: &mut Random, after: &[&str]) {
        // A frame after a cut has no step, so that its verdict is that of its linking numbers.
        self.cuts += 1;
        let scene = self.scene.moved(random);
        let frame = self.next_frame(&scene, self.layout);
        let Expected::Accepted(fixed) = judge(&frame, &self.known) else {
            panic!("the generator made an invalid frame after {after:?}");
        };
        match self.exchange(&frame, after) {
            Answer::Report(report, _) => assert_eq!(
                (report.verdict, report.seq),
                (Verdict::Intact, frame.header.seq),
                "a valid frame after {after:?}: {report:?}"
            ),
            _ => panic!("no verdict on a valid frame after {after:?}"),
        }
        (self.known.seq, self.known.baseline) = (Some(frame.header.seq), false);
        self.known.first.get_or_insert(frame.header.seq);
        self.known.verified = Some((self.layout, fixed));
        let baseline = self.watcher.session.baseline();
        self.baseline
            .get_or_insert_with(|| baseline.expect("a baseline").clone());
        self.tally.good += 1;
    }

    /// Sends a mutated frame and checks the reaction. Returns false if the session is over.
    fn mutated(&mut self, random: &mut Random, names: &mut Vec<&'static str>) -> bool {
        let mut curves = self.scene.clone();
        let mut layout = self.layout;
        let mut effect = Effect::None;
        if random.one_in(4) {
            let (name, change) = random.pick(CURVES);
            names.push(name);
            effect = change(&mut curves, random);
            if random.one_in(2) {
                names.push("announced");
                layout = self.largest_layout + 1 + random.below(3_u32);
            } else {
                effect = Effect::Unknown;
            }
        }
        let mut scene = curves.moved(random);
        if names.is_empty() && random.one_in(3) {
            let (name, change) = random.pick(SHAPES);
            names.push(name);
            effect = change(&mut scene, random);
        }
        let mut frame = self.next_frame(&scene, layout);
        let described = names.len();
        for _ in 0..random.below(4).max(u64::from(names.is_empty())) {
            let changes = random.pick(self.changes);
            let (name, change) = random.pick(changes);
            names.push(name);
            if change(&mut frame, random) == Effect::Unknown {
                effect = Effect::Unknown;
            }
        }
        if self.known.first.is_none() {
            frame.header.baseline = frame.header.seq;
        }
        self.largest_layout = self.largest_layout.max(frame.header.layout);
        let expected = judge(&frame, &self.known);
        let answer = self.exchange(&frame, names);
        if has_possible_number(&frame, &self.known)
            && matches!(expected, Expected::Rejected(_) | Expected::Accepted(_))
        {
            self.known.seq = Some(frame.header.seq);
            self.known.first.get_or_insert(frame.header.seq);
            self.known.baseline = frame.header.flags & Header::BASELINE != 0;
        }
        let header = &frame.header;
        match (expected, answer) {
            (Expected::Unreadable(reasons), Answer::Unreadable(why)) => {
                self.tally.unreadable += 1;
                assert_names(&reasons, &why, names);
            }
            (Expected::Rejected(reasons), Answer::Report(report, None)) => {
                self.tally.rejected += 1;
                assert_eq!(
                    (report.verdict, report.seq),
                    (Verdict::Rejected, header.seq)
                );
                let why = report.rejected.as_deref().unwrap_or("");
                assert_names(&reasons, why, names);
                // Only the positions are incomplete, so the curves of the frame have become known.
                if why.starts_with("nothing to verify") {
                    return false;
                }
            }
            (Expected::Accepted(fixed), Answer::Report(report, Some(set))) => {
                self.tally.accepted += 1;
                assert_ne!(report.verdict, Verdict::Rejected, "{names:?}");
                let changed = layout != self.layout;
                // If there was no earlier frame, this one is the baseline.
                let steps =
                    self.watcher.options.events != Events::Off || self.known.verified.is_none();
                match effect {
                    _ if steps => {}
                    Effect::None => {
                        assert_eq!(report.verdict, Verdict::Intact, "{names:?}: {report:?}");
                    }
                    Effect::Verdict(verdict) => assert_eq!(
                        report.verdict,
                        verdict,
                        "{names:?} {report:?} basis {} {:?}",
                        header.basis,
                        scene
                            .curves
                            .iter()
                            .map(|c| (c.closed, c.points.len()))
                            .collect::<Vec<_>>()
                    ),
                    Effect::Unknown if changed => {}
                    Effect::Unknown => self.compare(&report, &set, names),
                }
                // Later frames of the session have the changed scene, but not the changed bytes.
                let other = effect != Effect::None || steps || names.len() > described;
                if changed && other || self.known.verified.is_none() {
                    return false;
                }
                if changed {
                    (self.scene, self.layout) = (curves, layout);
                    self.baseline = None;
                }
                self.known.verified = Some((layout, fixed));
            }
            // Without a search for pull-throughs, the watch ends a session in which no curve is
            // closed.
            (Expected::Accepted(fixed), Answer::Report(report, None))
                if fixed.counts.iter().all(|&count| count > 0)
                    && self.watcher.options.events == Events::Off =>
            {
                self.tally.rejected += 1;
                let why = report.rejected.as_deref().unwrap_or("");
                assert!(why.starts_with("nothing to verify"), "{names:?}: {why}");
                return false;
            }
            // The end of a session may have an impossible sequence number.
            (Expected::Signal, Answer::Other | Answer::Unreadable(_)) => {
                self.tally.signals += 1;
                return header.flags & Header::END == 0;
            }
            (Expected::OtherSession, _) => return false,
            (expected, answer) => {
                let expected = match expected {
                    Expected::Unreadable(reasons) => format!("unreadable: {reasons:?}"),
                    Expected::Rejected(reasons) => format!("rejected: {reasons:?}"),
                    Expected::Accepted(_) => "accepted".into(),
                    Expected::Signal | Expected::OtherSession => "no verdict".into(),
                };
                let answer = match answer {
                    Answer::Report(report, _) => format!("{report:?}"),
                    Answer::Unreadable(why) => format!("unreadable: {why}"),
                    Answer::Other => "none".into(),
                };
                panic!("{names:?}: expected {expected}, the answer is {answer}; {header:?}");
            }
        }
        // After such a number, no later number is possible.
        self.known.seq.is_none_or(|seq| seq < 1 << 50)
    }

    /// Compares a verdict with that of a full run against the baseline.
    fn compare(&mut self, report: &Report, set: &CurveSet, names: &[&str]) {
        let Some(baseline) = &self.baseline else {
            return;
        };
        let mut full = Session::new(SessionOptions {
            baseline: Some(baseline.clone()),
            keep_open: true,
            ..SessionOptions::default()
        })
        .expect("options");
        let full = full.step(report.seq, set).report;
        assert_eq!(report.verdict, full.verdict, "{names:?}");
        assert_eq!(report.changes, full.changes, "{names:?}");
        self.tally.compared += 1;
    }
}

/// Checks that the message of a rejection contains one of the wrong numbers.
fn assert_names(reasons: &[Reason], why: &str, names: &[&str]) {
    let named = |reason: &Reason| reason.iter().all(|word| why.contains(word.as_str()));
    assert!(
        reasons.iter().any(named),
        "{names:?}: \"{why}\", expected one of {reasons:?}"
    );
}

/// Runs sessions of frames with these changes.
fn run(target: &'static str, sessions: u64, changes: &[&[ByteChange]]) {
    let name = service();
    let mut watcher = Watcher::open(&name);
    let simulator = RawSimulator::open(&name);
    let mut fuzzer = fuzzer((&simulator, &mut watcher), changes);
    let start = Instant::now();
    units(target, sessions, |random| {
        fuzzer.restart(random);
        // Sometimes the first frame of a session is a mutated one.
        let mut begun = random.one_in(4);
        for _ in 0..SESSION / 2 {
            if !begun {
                fuzzer.good(random, &["the start"]);
            }
            begun = true;
            let mut names = Vec::new();
            if !fuzzer.mutated(random, &mut names) {
                fuzzer.restart(random);
            }
            fuzzer.good(random, &names);
        }
    });
    let Fuzzer {
        tally, most_memory, ..
    } = fuzzer;
    println!(
        "{target}: {tally:?}, at most {most_memory} bytes for a frame, {:.1} s",
        start.elapsed().as_secs_f64()
    );
}

/// Creates a fuzzer for these ends of a service.
fn fuzzer<'a>(
    (simulator, watcher): (&'a RawSimulator, &'a mut Watcher),
    changes: &'a [&'a [ByteChange]],
) -> Fuzzer<'a> {
    Fuzzer {
        simulator,
        watcher,
        changes,
        known: Known::default(),
        scene: Scene::random(&mut Random::new(0)),
        layout: 1,
        largest_layout: 1,
        cuts: 0,
        baseline: None,
        most_memory: 0,
        last_basis: 0,
        tally: Tally::default(),
    }
}

#[test]
fn header() {
    run("frames::header", 60, &[HEADER]);
}

#[test]
fn layout() {
    run("frames::layout", 40, &[LAYOUT]);
}

#[test]
fn payload() {
    run("frames::payload", 6, &[PAYLOAD]);
}

#[test]
fn all_parts() {
    run("frames::all_parts", 10, &[HEADER, LAYOUT, PAYLOAD]);
}

/// Address of a payload in the memory of the sender.
#[derive(Clone, Copy)]
struct Address(*mut u8);

#[expect(unsafe_code, reason = "a writer of shared memory")]
// SAFETY: the memory stays mapped while the simulator lives, and is written to by one thread only.
unsafe impl Send for Address {}

/// A payload that a thread overwrites while the watcher reads it. The watcher decides from its copy
/// only: it does not panic, and the next frame is verified.
#[test]
fn values_that_change_after_they_were_sent() {
    let name = service();
    let mut watcher = Watcher::open(&name);
    let simulator = RawSimulator::open(&name);
    let mut fuzzer = fuzzer((&simulator, &mut watcher), &[]);
    let (mut rejected, mut others) = (0, 0);
    units(
        "frames::values_that_change_after_they_were_sent",
        150,
        |random| {
            fuzzer.restart(random);
            fuzzer.good(random, &["the start"]);
            for _ in 0..5 {
                let scene = fuzzer.scene.moved(random);
                let frame = fuzzer.next_frame(&scene, fuzzer.layout);
                let at = Address(simulator.send(frame.header, &frame.payload));
                let length = frame.payload.len();
                let mut writer = Random::new(random.next());
                // Some values change before the frame is read, however busy the machine is.
                let first = random.below(8);
                let (begun, done) = (AtomicBool::new(first == 0), AtomicBool::new(false));
                let answer = std::thread::scope(|scope| {
                    let (begun, done) = (&begun, &done);
                    scope.spawn(move || {
                        let at = at;
                        for written in 0.. {
                            if written >= first {
                                begun.store(true, Ordering::Relaxed);
                            }
                            if done.load(Ordering::Relaxed) {
                                break;
                            }
                            let k = writer.below(length);
                            #[expect(unsafe_code, reason = "a writer of shared memory")]
                            // SAFETY: within the payload, which stays mapped (see `Address`).
                            unsafe {
                                at.0.add(k).write_volatile(writer.next() as u8);
                            }
                        }
                    });
                    while !begun.load(Ordering::Relaxed) {
                        std::thread::yield_now();
                    }
                    let answer = fuzzer.watcher.answer();
                    done.store(true, Ordering::Relaxed);
                    answer
                });
                fuzzer.known.seq = Some(frame.header.seq);
                match answer {
                    Answer::Report(report, _) => match report.verdict {
                        Verdict::Rejected => rejected += 1,
                        _ => others += 1,
                    },
                    _ => panic!("no verdict"),
                }
                fuzzer.good(random, &["values that changed"]);
            }
        },
    );
    println!("changing values: {rejected} rejected, {others} verified");
    assert!(
        rejected > 0 && others > 0,
        "the writer had an effect, and not always"
    );
}

#[test]
#[ignore = "ten million frames, or LINKWATCH_FUZZ_FRAMES: half an hour"]
fn ten_million_frames() {
    let frames = std::env::var("LINKWATCH_FUZZ_FRAMES").ok();
    let frames = frames.map(|n| n.parse().expect("LINKWATCH_FUZZ_FRAMES is a number"));
    let sessions = frames.unwrap_or(10_000_000_u64).div_ceil(SESSION);
    run("frames::ten_million_frames", sessions, &[HEADER, LAYOUT]);
}
