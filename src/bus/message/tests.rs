use super::*;
use crate::verdict::{InvariantChange, PreviousFindings};

fn report(verdict: Verdict) -> Report {
    Report::new(12, 0.5, verdict)
}

fn sent(report: &Report) -> VerdictMessage {
    let check = Duration::from_nanos(77);
    let new = PreviousFindings::default().update(report).new;
    message(report, &new, check).read().unwrap()
}

fn message(report: &Report, new: &[bool], check: Duration) -> VerdictWire {
    let base = VerdictWire::new(MessageKind::Verdict, 5, Counters::default());
    base.with_report(report, new, check)
}

const PLACE: Place = Place {
    segments: [7, 8],
    point: [1.0, 2.0, 3.0],
    distance: 0.25,
};

const EVENT: PullThrough = PullThrough {
    i: 3,
    j: 4,
    image: [0; 3],
    segments: [7, 9],
    fraction: 0.25,
    sign: 1,
    point: [1.0, 2.0, 3.0],
    lengths: 0.25,
};

#[test]
fn a_change_is_transmitted_with_its_place() {
    let change = Change {
        i: 3,
        j: 4,
        image: [0; 3],
        expected: 1,
        found: 0,
        place: Some(PLACE),
    };
    let mut r = report(Verdict::Changed);
    r.abort = true;
    r.changes = vec![change, Change { found: 2, ..change }];
    let m = sent(&r);
    assert_eq!(m.first, Some(Finding::Change(change)));
    assert_eq!((m.lost, m.gained, m.changed), (1, 0, 1));
    assert_eq!((m.session, m.check.as_nanos()), (5, 77));
    assert_eq!(
        m.to_string(),
        "frame 12: changed, 1 link lost, 1 link changed: curves 3 and 4 came apart: linking \
         number was 1, is 0, near (1.00000, 2.00000, 3.00000), segments 7 and 8, 0.25 \
         apart. Stop or roll back"
    );
}

/// Regression test: the message named an old defect, and gave no reason if only a knot had changed.
#[test]
fn knots_do_not_shift_the_first_new_finding() {
    let mut r = report(Verdict::Changed);
    r.invariants = vec![InvariantChange {
        curves: vec![7],
        expected: "v2 0".into(),
        found: "v2 1".into(),
    }];
    let m = sent(&r);
    assert_eq!((m.findings, m.first), (1, None));
    let of = |new: &[bool], r: &Report| message(r, new, Duration::ZERO).read();
    let reason = r.invariants[0].sentence_named(&[]);
    assert!(m.to_string().ends_with(&reason), "{m}");
    let place = PLACE;
    let kind = DefectKind::Contact;
    r.defects = vec![Defect {
        i: 1,
        j: Some(2),
        image: [0; 3],
        kind,
        place,
    }];
    let mut known = PreviousFindings::default();
    known.update(&r);
    let new = known.update(&r).new;
    assert!(of(&new, &r).unwrap().to_string().ends_with(&reason));
    r.events = vec![EVENT];
    let new = known.update(&r).new;
    assert_eq!(first_new(&r, &new), Some((Finding::Event(EVENT), true)));
}

#[test]
fn the_first_new_finding_is_transmitted_with_the_number_of_all() {
    let lost = |i| Change {
        i,
        j: 9,
        image: [0; 3],
        expected: 1,
        found: 0,
        place: None,
    };
    let mut known = PreviousFindings::default();
    let mut sent = |changes: Vec<Change>| {
        let mut r = report(Verdict::Changed);
        r.changes = changes;
        let new = known.update(&r).new;
        let message = message(&r, &new, Duration::ZERO).read().unwrap();
        (message.first, message.findings)
    };
    let change = |i| Some(Finding::Change(lost(i)));
    assert_eq!(sent(vec![lost(3)]), (change(3), 1));
    assert_eq!(sent(vec![lost(2), lost(3)]), (change(2), 2));
    assert_eq!(sent(vec![lost(2), lost(3), lost(4)]), (change(4), 3));
    // None of the findings is new.
    assert_eq!(sent(vec![lost(3), lost(4)]), (change(3), 2));
    assert_eq!(sent(vec![]), (None, 0));
    assert_eq!(sent(vec![lost(3)]), (change(3), 1));
}

#[test]
fn a_goodbye_has_the_reason_and_the_violations_that_were_rolled_back() {
    let hello = VerdictWire::new(MessageKind::Goodbye, 5, Counters::default());
    let wire = VerdictWire {
        recovered: 2,
        ..hello.with_reason("no curve is closed")
    };
    assert_eq!(
        wire.read().unwrap().to_string(),
        "linkwatch is done with this session: 0 frames verified, 0 skipped, 0 rejected; \
         recovered: 2 violations were rolled back; no curve is closed"
    );
}

#[test]
fn the_state_to_roll_back_to_is_transmitted() {
    let mut r = report(Verdict::Changed);
    let m = sent(&r);
    assert_eq!((m.last_intact, m.safe_fraction), (None, None));
    (r.abort, r.last_intact, r.safe_fraction) = (true, Some(11), Some(0.37196));
    let m = sent(&r);
    assert_eq!((m.last_intact, m.safe_fraction), (Some(11), Some(0.37196)));
    assert_eq!(
        m.to_string(),
        "frame 12: changed. Stop or roll back: frame 11 is intact, and 0.371 of the step from \
         there is safe"
    );
}

#[test]
fn a_pull_through_is_transmitted() {
    let event = PullThrough {
        j: 3,
        sign: -1,
        ..EVENT
    };
    let mut r = report(Verdict::Changed);
    r.events = vec![event];
    let m = sent(&r);
    assert_eq!((m.first, m.events), (Some(Finding::Event(event)), 1));
    assert_eq!(
        m.to_string(),
        "frame 12: changed, 1 pull-through: curve 3 passed through itself at 0.250 of the step \
         (-1), at (1.00000, 2.00000, 3.00000), segments 7 and 9"
    );
}

#[test]
fn the_change_of_the_pair_that_was_pulled_through_first_is_transmitted() {
    let lost = |i, j| Change {
        i,
        j,
        image: [0; 3],
        expected: 1,
        found: 0,
        place: None,
    };
    let passage = |i, j, fraction| PullThrough {
        i,
        j,
        fraction,
        ..EVENT
    };
    let mut r = report(Verdict::Changed);
    r.changes = vec![lost(1, 2), lost(3, 4)];
    r.events = vec![passage(3, 4, 0.25), passage(1, 2, 0.5)];
    assert_eq!(sent(&r).first, Some(Finding::Change(lost(3, 4))));
    r.events = vec![passage(5, 6, 0.125)];
    assert_eq!(sent(&r).first, Some(Finding::Change(lost(1, 2))));
}

#[test]
fn a_defect_and_a_reason_are_transmitted() {
    let defect = Defect {
        i: 2,
        j: None,
        image: [0; 3],
        kind: DefectKind::Degenerate,
        place: PLACE,
    };
    let mut r = report(Verdict::Undecided);
    r.defects = vec![defect];
    assert_eq!(sent(&r).first, Some(Finding::Defect(defect)));

    let mut r = report(Verdict::Rejected);
    r.rejected = Some("ä".repeat(200));
    let m = sent(&r);
    assert_eq!(m.reason.as_deref(), Some("ä".repeat(90).as_str()));
    assert!(m.to_string().starts_with("frame 12: rejected: ää"));
}

#[test]
fn the_image_of_a_finding_is_transmitted() {
    let (i, j, image) = (3, 4, [1, -2, i32::MIN]);
    let change = Change {
        i,
        j,
        image,
        expected: 1,
        found: 0,
        place: None,
    };
    let mut r = report(Verdict::Changed);
    r.changes = vec![change];
    assert_eq!(sent(&r).first, Some(Finding::Change(change)));
    let event = PullThrough {
        i,
        j: i,
        image,
        ..EVENT
    };
    (r.changes, r.events) = (vec![], vec![event]);
    assert_eq!(sent(&r).first, Some(Finding::Event(event)));
    let defect = Defect {
        i,
        j: Some(j),
        image,
        kind: DefectKind::Contact,
        place: PLACE,
    };
    (r.events, r.defects) = (vec![], vec![defect]);
    assert_eq!(sent(&r).first, Some(Finding::Defect(defect)));
}

#[test]
fn a_hello_reports_the_counters() {
    let counters = Counters {
        verified: 7,
        skipped: 2,
        rejected: 1,
    };
    let m = VerdictWire::new(MessageKind::Hello, 0, counters).read();
    assert_eq!(
        m.unwrap().to_string(),
        "linkwatch is watching: 7 frames verified, 2 skipped, 1 rejected"
    );
}

#[test]
fn rejects_unknown_codes() {
    let good = VerdictWire::new(MessageKind::Hello, 0, Counters::default());
    let bad: [fn(&mut VerdictWire); 7] = [
        |w| w.magic = 0,
        |w| w.version += 1,
        |w| w.kind = 3,
        |w| w.verdict = 6,
        |w| w.finding = 4,
        |w| (w.finding, w.defect_kind) = (FINDING_DEFECT, 6),
        |w| w.reason_len = 181,
    ];
    for change in bad {
        let mut wire = good;
        change(&mut wire);
        assert!(wire.read().is_err(), "{wire:?}");
    }
}
