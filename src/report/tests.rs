//! Tests of reports about recordings that are written here.

mod clearance;

use super::*;
use crate::certificate::Certificate;
use crate::curve::{Basis, Cell, CurveLabels, CurveSet, Positions};
use crate::ingest::FrameInfo;
use crate::record::RecordingSink;
use crate::sinks::{BaselineRecord, FrameRecord, FrameTimes, RunProgress, Sink};
use crate::verdict::{Change, Clearance, Defect, DefectKind, Place, PullThrough, Report, Verdict};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

/// A square in the plane z = 0, and one in the plane y = 0 at `shift`.
fn squares(shift: f64) -> CurveSet {
    let points = [
        [-1.0, -1.0, 0.0],
        [1.0, -1.0, 0.0],
        [1.0, 1.0, 0.0],
        [-1.0, 1.0, 0.0],
        [shift, 0.0, -1.0],
        [2.0 + shift, 0.0, -1.0],
        [2.0 + shift, 0.0, 1.0],
        [shift, 0.0, 1.0],
    ];
    let points = Positions::F64(points.as_flattened());
    CurveSet::from_counts(Basis::Polyline, &[-4, -4], points).unwrap()
}

fn place() -> Place {
    Place {
        segments: [1, 3],
        point: [1.0, 0.0, 0.0],
        distance: 0.25,
    }
}

fn change(i: u32, j: u32) -> Change {
    Change {
        i,
        j,
        image: Default::default(),
        expected: 1,
        found: 0,
        place: Some(place()),
    }
}

fn defect(kind: DefectKind) -> Defect {
    Defect {
        i: 0,
        j: Some(1),
        image: Default::default(),
        kind,
        place: place(),
    }
}

fn pull_through(i: u32, j: u32) -> PullThrough {
    PullThrough {
        i,
        j,
        image: Default::default(),
        segments: [1, 3],
        fraction: 0.5,
        sign: 1,
        point: [1.0, 0.0, 0.0],
        lengths: 0.5,
    }
}

/// A run to record: the frames, and their curves.
#[derive(Default)]
struct Recorded {
    reports: Vec<(Report, Option<CurveSet>)>,
    labels: CurveLabels,
    cell: Option<Cell>,
    metadata: BTreeMap<String, String>,
    /// Number of skipped frames before the last one, and of verified frames that are not recorded.
    skipped: u64,
    missing: u64,
    /// Number of verified frames before the last one that the recording skips on purpose.
    left_out: u64,
    /// Frame from which on a violation is recovered.
    recovered: Option<usize>,
}

impl Recorded {
    /// Adds the next frame, with its findings.
    fn frame(mut self, verdict: Verdict, find: impl FnOnce(&mut Report)) -> Recorded {
        let seq = self.reports.len() as u64;
        let mut report = Report::new(seq, 0.5 * seq as f64, verdict);
        find(&mut report);
        let curves = (verdict != Verdict::Rejected).then(|| squares(0.1 * seq as f64));
        self.reports.push((report, curves));
        self
    }

    fn intact(self) -> Recorded {
        self.frame(Verdict::Intact, |_| {})
    }

    fn with(mut self, key: &str, value: &str) -> Recorded {
        self.metadata.insert(key.into(), value.into());
        self
    }

    fn write(self, path: &Path) {
        let mut sink = Box::new(RecordingSink::create(path, &self.metadata).unwrap());
        let certificate = Arc::new(Certificate {
            curves: 2,
            links: Vec::new(),
            undefined: Vec::new(),
            images: None,
            periods: Vec::new(),
            higher: Vec::new(),
        });
        let origin = "first frame".to_owned();
        sink.begin(&BaselineRecord {
            certificate,
            origin,
            frame: Some(0),
            unverified: 0,
        })
        .unwrap();
        let info = FrameInfo {
            labels: Arc::new(self.labels),
            cell: self.cell,
            ..FrameInfo::default()
        };
        let (mut verified, mut rejected, last) = (0, 0, self.reports.len());
        for (k, (report, curves)) in self.reports.into_iter().enumerate() {
            match report.verdict {
                Verdict::Rejected => rejected += 1,
                _ => verified += 1,
            }
            let is_last = k + 1 == last;
            if is_last {
                verified += self.missing;
            }
            if is_last {
                sink.leave_out(self.left_out);
                verified += self.left_out;
            }
            sink.frame(&FrameRecord {
                curves: curves.map(Arc::new),
                info: info.clone(),
                report: Arc::new(report),
                progress: RunProgress {
                    recovered: self.recovered.is_some_and(|first| k >= first).into(),
                    verified,
                    skipped: if is_last { self.skipped } else { 0 },
                    rejected,
                    times: FrameTimes {
                        verification: Duration::from_millis(2),
                        ..FrameTimes::default()
                    },
                    received_ns: 1_700_000_000_000_000_000,
                    ..RunProgress::default()
                },
            })
            .unwrap();
        }
        sink.finish().unwrap();
    }

    fn report(self) -> RunReport {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        self.write(&path);
        RunReport::read(&path).unwrap()
    }
}

/// Asserts the conclusion and the sentence of a run.
#[track_caller]
fn says(run: Recorded, conclusion: Conclusion, sentence: &str) -> RunReport {
    let report = run.report();
    assert_eq!(report.conclusion(), conclusion, "{report}");
    assert_eq!(report.sentence(), sentence);
    report
}

#[test]
fn an_intact_run_says_so_with_its_frames() {
    let run = Recorded::default().with("events", "all").intact().intact();
    let sentence = "Intact: 2 frames, from frame 0 to frame 1 at 0.5 s.";
    let report = says(run, Conclusion::Intact, sentence);
    assert_eq!(report.facts.notes(), [""; 0]);
}

#[test]
fn no_sentence_hides_frames_that_are_not_known_to_be_intact() {
    let run = Recorded {
        skipped: 3,
        ..Recorded::default().intact().intact()
    };
    let sentence = "Intact as far as verified: 2 frames, from frame 0 to frame 1 at 0.5 s; 3 \
                    frames were skipped.";
    let report = says(run, Conclusion::Intact, sentence);
    assert!(report.html().contains(">intact, with gaps<"));
    let run = Recorded {
        missing: 1,
        ..Recorded::default().intact().intact()
    };
    let sentence = "Not complete: 1 frame was not recorded; what was recorded is intact: 2 \
                    frames, from frame 0 to frame 1 at 0.5 s.";
    says(run, Conclusion::Incomplete, sentence);
    let rejected = |r: &mut Report| r.rejected = Some("coordinate x is NaN".into());
    let run = Recorded::default()
        .intact()
        .frame(Verdict::Rejected, rejected);
    let sentence = "No change was found, but 1 of 2 frames are not known to be intact; the first \
                    is frame 1 at 0.5 s (rejected): coordinate x is NaN.";
    says(run, Conclusion::Undecided, sentence);
    let undecided = |r: &mut Report| r.defects = vec![defect(DefectKind::TooClose)];
    let run = Recorded::default()
        .intact()
        .frame(Verdict::Undecided, undecided);
    let sentence = "No change was found, but 1 of 2 frames are not known to be intact; the first \
                    is frame 1 at 0.5 s (undecided): curves 0 and 1 are too close to decide, near \
                    (1.00000, 0.00000, 0.00000).";
    says(run, Conclusion::Undecided, sentence);
    let run = Recorded {
        missing: 1,
        ..Recorded::default().frame(Verdict::Rejected, rejected)
    };
    assert_eq!(run.report().conclusion(), Conclusion::Undecided);
}

/// Regression test: the violation that was rolled back was named, and "no change was found".
#[test]
fn a_violation_that_was_rolled_back_is_not_named_as_one_that_lasts() {
    let run = || {
        let changed = |r: &mut Report| r.changes = vec![change(0, 1)];
        let run = Recorded::default()
            .intact()
            .frame(Verdict::Changed, changed);
        Recorded {
            recovered: Some(2),
            ..run.intact()
        }
    };
    let rejected = |r: &mut Report| r.rejected = Some("coordinate x is NaN".into());
    let undecided = run().frame(Verdict::Rejected, rejected);
    let sentence = "No change lasts, but 1 of 4 frames are not known to be intact; the first is \
                    frame 3 at 1.5 s (rejected): coordinate x is NaN.";
    let report = says(undecided, Conclusion::Undecided, sentence);
    assert_eq!(report.json()["first_violation"]["frame"], 3);
    assert_eq!(report.json()["first_changed"]["frame"], 1);
    let lost = Recorded {
        missing: 1,
        ..run()
    };
    let sentence = "Not complete: 1 frame was not recorded; no violation lasts in what was \
                    recorded: 3 frames, from frame 0 to frame 2 at 1 s.";
    says(lost, Conclusion::Incomplete, sentence);
}

#[test]
fn a_clearance_that_was_not_measured_makes_a_run_incomplete() {
    let measured = |r: &mut Report| {
        r.clearance = Some(Clearance {
            at_least: 1.0,
            closest: None,
            low: false,
            frames_left: None,
        });
    };
    let run = || Recorded::default().with("thickness", "0.1");
    let all = run().frame(Verdict::Intact, measured);
    says(all, Conclusion::Intact, "Intact: 1 frame, frame 0.");
    let some = run().frame(Verdict::Intact, measured).intact();
    let sentence = "Not complete: 1 frame was verified without the clearance; what was recorded \
                    is intact: 2 frames, from frame 0 to frame 1 at 0.5 s.";
    says(some, Conclusion::Incomplete, sentence);
}

#[test]
fn curves_that_were_left_out_on_purpose_are_not_lost() {
    let mut run = Recorded::default().intact().intact();
    run.reports[1].1 = None;
    assert_eq!(run.report().conclusion(), Conclusion::Incomplete);
    let mut run = Recorded::default().intact().intact();
    run.reports[1].1 = None;
    let report = run.with("record_every", "2").report();
    assert_eq!(report.conclusion(), Conclusion::Intact);
    let text = report.to_string();
    assert!(text.contains("left out on purpose (every 2)"), "{text}");
}

#[test]
fn frames_that_were_left_out_on_purpose_are_named_and_not_missing() {
    let run = Recorded {
        left_out: 7,
        ..Recorded::default().intact().intact()
    };
    let sentence = "Intact as far as verified: 2 frames, from frame 0 to frame 1 at 0.5 s; 7 \
                    frames were left out of the recording on purpose.";
    says(run, Conclusion::Intact, sentence);
}

#[test]
fn open_curves_that_were_not_verified_are_in_the_sentence() {
    let open = |r: &mut Report| r.stats.open_curves = 2;
    let run = Recorded::default().frame(Verdict::Intact, open);
    let sentence = "Intact: 1 frame, frame 0; 2 open curves were not verified.";
    says(run, Conclusion::Intact, sentence);
    let run = Recorded::default().frame(Verdict::Intact, open).intact();
    let sentence = "Not complete: what was recorded is intact: 2 frames, from frame 0 to frame 1 \
                    at 0.5 s; 2 open curves were not verified.";
    says(run, Conclusion::Incomplete, sentence);
    let run = Recorded::default()
        .frame(Verdict::Intact, open)
        .with("events", "between");
    says(run, Conclusion::Intact, "Intact: 1 frame, frame 0.");
}

#[test]
fn a_change_after_a_contact_is_in_the_sentence() {
    let contact = |r: &mut Report| r.defects = vec![defect(DefectKind::Contact)];
    let run = Recorded::default()
        .intact()
        .frame(Verdict::Contact, contact);
    let sentence = "No change was found, but 1 of 2 frames are not known to be intact; the first \
                    is frame 1 at 0.5 s (contact): curves 0 and 1 touch, near (1.00000, 0.00000, \
                    0.00000).";
    let report = says(run, Conclusion::Contact, sentence);
    assert_eq!(report.figures(), 1);
    let run = Recorded {
        labels: CurveLabels::named(["sleeve", "cuff"]),
        ..Recorded::default()
            .intact()
            .frame(Verdict::Contact, contact)
    };
    let run = run.frame(Verdict::Changed, |r| r.changes = vec![change(0, 1)]);
    let sentence = "The topology changed in frame 2 at 1 s: curves 0 (sleeve) and 1 (cuff) came \
                    apart, near (1.00000, 0.00000, 0.00000).";
    let report = says(run, Conclusion::Changed, sentence);
    // The picture is that of the change.
    assert_eq!(report.figures[0].shot.moment.frame, 2);
    assert_eq!(report.figures[0].captions[0], "before: frame 1 at 0.5 s");
    assert_eq!(
        report.figures[0].captions[2],
        "after: no later frame was recorded"
    );
}

#[test]
fn the_pair_that_was_pulled_through_first_is_named() {
    let run = Recorded::default().intact().frame(Verdict::Changed, |r| {
        r.changes = vec![change(0, 1), change(2, 3)];
        r.events = vec![pull_through(2, 3), pull_through(0, 1)];
    });
    let report = run.report();
    let sentence = report.sentence();
    assert!(sentence.contains("curves 2 and 3 came apart"), "{sentence}");
    let notes = report.facts.notes();
    assert_eq!(notes[0], "frame 1 at 0.5 s has 3 more findings");
    assert_eq!(
        notes[1],
        "1 frame has a changed topology, in 2 pairs of curves"
    );
}

#[test]
fn a_run_without_an_end_is_not_intact() {
    let run = Recorded::default().with("events", "all").intact().intact();
    let run = run.with("cut_off", "the simulator died");
    let sentence = "Not complete: the simulator died; what was recorded is intact: 2 frames, from \
                    frame 0 to frame 1 at 0.5 s.";
    says(run, Conclusion::Incomplete, sentence);
}

#[test]
fn a_recording_that_was_cut_off_is_reported_up_to_its_end() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let mut run = Recorded::default();
    for _ in 0..20 {
        run = run.intact();
    }
    run.write(&path);
    let whole = std::fs::read(&path).unwrap();
    let mut cut = 0;
    for share in 1..40 {
        std::fs::write(&path, &whole[..whole.len() * share / 40]).unwrap();
        let report = RunReport::read(&path).unwrap();
        // Only the index at the end is missing.
        if report.conclusion() == Conclusion::Intact {
            assert!(
                report.sentence().starts_with("Intact: 20 frames"),
                "{report}"
            );
            continue;
        }
        cut += 1;
        assert_eq!(report.conclusion(), Conclusion::Incomplete);
        assert!(!report.sentence().contains("Intact"), "{report}");
        assert!(report.to_string().contains("truncated at byte"), "{report}");
        assert!(report.json()["cut"]["byte"].is_u64());
    }
    assert!(cut > 10, "{cut}");
    std::fs::write(&path, b"").unwrap();
    let sentence = RunReport::read(&path).unwrap().sentence();
    assert!(sentence.starts_with("Nothing was verified"), "{sentence}");
    std::fs::write(&path, b"no recording at all").unwrap();
    assert!(RunReport::read(&path).is_err());
}

#[test]
fn damage_after_the_first_verdict_is_reported() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let mut run = Recorded::default();
    for _ in 0..200 {
        run = run.intact();
    }
    run.write(&path);
    let mut bytes = std::fs::read(&path).unwrap();
    // The end of the data: the checksum of all of it differs.
    let at = bytes.len() * 3 / 4;
    bytes[at] ^= 0x40;
    std::fs::write(&path, &bytes).unwrap();
    match RunReport::read(&path) {
        Ok(report) => {
            assert_eq!(report.conclusion(), Conclusion::Incomplete);
            assert!(report.sentence().contains("damaged"), "{report}");
        }
        // All frames are in one damaged chunk.
        Err(e) => assert!(e.to_string().contains("run.mcap"), "{e}"),
    }
}

#[test]
fn hostile_texts_do_not_become_markup_or_control_the_terminal() {
    let names = [
        "<script>alert(1)</script>",
        "\"><img src=x onerror=alert(1)> & \u{202e}",
    ];
    let why = "</td></table><script src='//x'></script>\u{1b}[2J";
    let run = Recorded {
        labels: CurveLabels::named(names),
        ..Recorded::default()
    };
    let run = run
        .with("<b>key</b>", "</style><script>alert(2)</script>\n\u{7}")
        .with("service", "a' onload='alert(3)")
        .intact()
        .frame(Verdict::Changed, |r| {
            r.changes = vec![change(0, 1)];
            r.events = vec![pull_through(0, 1)];
            r.defects = vec![defect(DefectKind::TooClose)];
        })
        .frame(Verdict::Rejected, |r| r.rejected = Some(why.into()));
    let report = run.report();
    let html = report.html();
    assert_eq!(html.matches("<script").count(), 0);
    assert_eq!(html.matches("<img").count(), 0);
    assert_eq!(html.matches("</style>").count(), 1);
    assert_eq!(html.matches("<b>").count(), 0);
    assert!(html.contains("&lt;script&gt;alert(1)&lt;/script&gt;"));
    let hostile = |c: char| c.is_control() && c != '\n' || c == '\u{202e}';
    for text in [&html, &report.to_string(), &report.json().to_string()] {
        assert!(!text.contains(hostile), "{text}");
    }
    // Nothing is loaded from elsewhere.
    for outside in ["http:", "https:", "url(", "@import", "src=\"", "href"] {
        assert!(!html.contains(outside), "{outside}");
    }
}

#[test]
fn impossible_findings_of_a_hostile_recording_are_reported_without_a_panic() {
    for (curves, segments, point) in [
        ([7, 8], [0, 0], [0.0; 3]),
        ([0, 1], [u32::MAX, 9], [0.0; 3]),
        ([1, 0], [1, 3], [f64::NAN, 0.0, f64::INFINITY]),
        ([1, 1], [0, u32::MAX], [f64::MAX; 3]),
        ([u32::MAX, 0], [3, 3], [-1e-320; 3]),
    ] {
        let [i, j] = curves;
        let place = Place {
            segments,
            point,
            distance: f64::NAN,
        };
        let run = Recorded::default().intact().frame(Verdict::Changed, |r| {
            r.time = f64::NAN;
            r.stats.extent = f64::INFINITY;
            r.changes = vec![Change {
                expected: i64::MIN,
                found: i64::MAX,
                place: Some(place),
                ..change(i, j)
            }];
            r.events = vec![PullThrough {
                segments,
                point,
                fraction: f64::INFINITY,
                ..pull_through(i, j)
            }];
            r.defects = vec![Defect {
                i,
                j: None,
                image: Default::default(),
                kind: DefectKind::Degenerate,
                place,
            }];
        });
        let report = run.intact().report();
        assert_eq!(report.conclusion(), Conclusion::Changed);
        for row in report.figures.iter().flat_map(|f| &f.rows) {
            for svg in row.iter().flatten() {
                // The first line has the time of the frame, which is not a number.
                let (_, svg) = svg.split_once('\n').unwrap();
                assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
            }
        }
        assert!(report.html().ends_with("</html>\n"));
    }
}

#[test]
fn pages_of_broken_scenes_stay_small() {
    const CURVES: u32 = 3000;
    let names = (0..CURVES).map(|k| format!("{k:05}{}", "\"".repeat(250)));
    let mut run = Recorded {
        labels: CurveLabels::named(names),
        ..Recorded::default()
    };
    for k in 0..3 {
        run = run.frame(Verdict::Changed, |r| {
            let pairs = (0..CURVES - 1).filter(|i| i % 3 == k);
            r.changes = pairs.clone().map(|i| change(i, i + 1)).collect();
            r.events = pairs.clone().map(|i| pull_through(i, i + 1)).collect();
            let defects = pairs.map(|i| Defect {
                i,
                j: Some(i + 1),
                ..defect(DefectKind::TooClose)
            });
            r.defects = defects.collect();
        });
    }
    let report = run.report();
    let html = report.html();
    assert!(html.len() < 8 << 20, "{} bytes", html.len());
    assert_eq!(report.facts.violations.pairs.len(), 400);
    assert_eq!(report.facts.pull_throughs.total, u64::from(CURVES) - 1);
    assert!(html.contains("Only the first 400 pairs are listed."));
    assert!(html.contains("2,599 more are not listed."));
    assert!(report.to_string().lines().count() < 200);
}

#[test]
fn pictures_show_both_curves_before_at_and_after_the_violation() {
    let run = Recorded::default().intact().frame(Verdict::Changed, |r| {
        r.changes = vec![change(0, 1)];
    });
    let report = run.intact().report();
    assert_eq!(report.figures(), 1);
    for row in &report.figures[0].rows {
        for picture in row {
            let svg = picture.as_ref().expect("a picture");
            for class in ["a", "b", "m"] {
                assert!(
                    svg.contains(&format!("class=\"{class}\"")),
                    "{class}: {svg}"
                );
            }
            for segment in ["segment 1", "segment 3"] {
                assert!(svg.contains(segment), "{svg}");
            }
            assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
        }
    }
}

#[test]
fn pairs_are_followed_by_name_when_curves_come_and_go() {
    let mut violations = violations::Violations::default();
    let names = |list: &[&str]| list.iter().map(|n| (*n).to_owned()).collect::<Vec<_>>();
    let mut report = Report::new(0, 0.0, Verdict::Changed);
    report.changes = vec![change(0, 1)];
    violations.add(&report, &names(&["a", "b"]), Some(0));
    violations.rename(&names(&["new", "b", "a"]));
    report.changes = vec![change(1, 2)];
    violations.add(&report, &names(&["new", "b", "a"]), Some(1));
    assert_eq!(violations.pairs.len(), 1);
    assert_eq!(violations.pairs[0].link.as_ref().unwrap().frames, 2);
}

#[test]
fn the_worst_violations_are_the_first_the_most_frequent_and_the_deepest() {
    let mut violations = violations::Violations::default();
    for k in 0..20 {
        let mut report = Report::new(k, 0.0, Verdict::Changed);
        let (i, j) = (2 * k as u32, 2 * k as u32 + 1);
        let mut change = change(i, j);
        if k == 15 {
            change.place = Some(Place {
                distance: 9.0,
                ..place()
            });
        }
        report.changes = vec![change];
        report.events = vec![pull_through(i, j); if k == 12 { 5 } else { 1 }];
        violations.add(&report, &[], Some(k));
    }
    let chosen = figures::choose(&violations);
    let chosen: Vec<(usize, &str)> = chosen.iter().map(|(k, why)| (*k, &**why)).collect();
    assert_eq!(
        chosen,
        [
            (0, "first"),
            (1, "number 2"),
            (2, "number 3"),
            (3, "number 4"),
            (12, "most pull-throughs (5)"),
            (15, "deepest"),
        ]
    );
}

#[test]
fn the_timeline_of_a_million_frames_is_small_and_shows_one_violation() {
    let mut facts = Facts::default();
    for seq in 0..1_000_000 {
        let verdict = match seq {
            654_321 => Verdict::Changed,
            _ => Verdict::Intact,
        };
        let report = Report::new(seq, seq as f64 * 1e-3, verdict);
        facts.verdicts.counts[verdict as usize] += 1;
        facts.series.add(&report, 0.5, [0, 0]);
    }
    let svg = facts.timeline().into_string();
    assert!(svg.len() < 60_000, "{} bytes", svg.len());
    assert_eq!(svg.matches("class=\"v1\"").count(), 1);
    assert!(svg.matches("class=\"t c\"").count() <= 12, "{svg}");
    let (plots, _) = facts.plots();
    assert!(plots.iter().all(|plot| plot.svg.0.len() < 40_000));
}

/// Curve 0 is linked with two images of curve 1, and with its own image.
#[test]
fn images_of_one_pair_have_rows_pictures_and_names_of_their_own() {
    let of = |image| Change {
        image,
        ..change(0, 1)
    };
    let broken = |r: &mut Report| {
        r.changes = vec![of([0, 0, 0]), of([1, 0, 0])];
        r.events = vec![PullThrough {
            image: [0, -1, 0],
            ..pull_through(0, 0)
        }];
    };
    let mut run = Recorded::default().intact().frame(Verdict::Changed, broken);
    run.cell = Some("9,9,9".parse().unwrap());
    let report = run.report();
    let text = report.to_string();
    for row in [
        ": curves 0 and 1 came apart: linking number was 1, is 0",
        ": curve 0 and the image 1,0,0 of curve 1 came apart: linking number was 1, is 0",
        ": curve 0 and its image 0,-1,0 passed through one another at 0.500 of the step",
    ] {
        assert_eq!(text.matches(row).count(), 1, "{row}: {text}");
    }
    let pairs = &report.facts.violations.pairs;
    let images: Vec<_> = pairs.iter().map(|pair| pair.image).collect();
    assert_eq!(images, [[0, -1, 0], [0, 0, 0], [1, 0, 0]]);
    assert_eq!(report.figures(), 3);
    let page = report.html();
    for words in [
        "<td>curve 0 and the image 1,0,0 of curve 1 came apart",
        "<td>curve 0 and its image 0,-1,0 passed through one another",
        "image 1,0,0 of curve 1, segment 3</span>",
    ] {
        assert!(page.contains(words), "{words}");
    }
}
