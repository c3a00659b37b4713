//! Frames with a periodic cell.

use super::*;
use linkwatch::{
    Cell, Events, Finding, LastLabels, MessageKind, Positions, Session, SessionOptions,
    VerdictMessage,
};

fn cell(text: &str) -> Cell {
    text.parse().unwrap()
}

/// Returns the name of a service that no other test uses.
fn service() -> String {
    format!("cellbus-{}", super::service())
}

#[test]
fn the_cell_arrives_with_its_frame_and_may_change() {
    let name = service();
    let mut sidecar = sidecar(&name);
    let mut client = client(&name);
    let mut labels = LastLabels::default();
    let sheared = cell("10,0,0,2.5,10,0,0,0,12,-5,-5,1");
    let cells = [
        None,
        Some(cell("10,10,12")),
        Some(sheared),
        Some(sheared),
        Some(cell("0,10,0")),
        None,
    ];
    for (seq, expected) in (0..).zip(cells) {
        client.set_cell(expected).unwrap();
        publish(&mut client, seq);
        if seq == 0 {
            new_session(&mut sidecar);
        }
        let frame = next_frame(&mut sidecar);
        assert_eq!(frame.info(&mut labels).unwrap().cell, expected);
        assert_eq!(frame.seq(), seq);
        answer(&mut sidecar, &frame, &mut None);
    }
    assert_eq!(sidecar.counters().verified, cells.len() as u64);
}

#[test]
fn the_cell_of_a_frame_is_that_at_its_publication() {
    let name = service();
    let mut sidecar = sidecar(&name);
    let mut client = client(&name);
    let (early, late) = (cell("10,10,12"), cell("11,11,13"));
    client.set_cell(Some(early)).unwrap();
    let mut frame = client.begin(0.0).unwrap();
    frame
        .positions_f32()
        .unwrap()
        .copy_from_slice(&positions(0));
    client.set_cell(Some(late)).unwrap();
    client.send(frame).unwrap();
    new_session(&mut sidecar);
    let frame = next_frame(&mut sidecar);
    let info = frame.info(&mut LastLabels::default()).unwrap();
    assert_eq!(info.cell, Some(late));
}

#[test]
fn a_client_refuses_a_cell_that_is_no_lattice_and_keeps_the_last_one() {
    let name = service();
    let mut sidecar = sidecar(&name);
    let mut client = client(&name);
    let kept = cell("10,10,12");
    client.set_cell(Some(kept)).unwrap();
    let [mut empty, mut flat, mut endless] = [kept; 3];
    empty.vectors = [[0.0; 3]; 3];
    flat.vectors[1] = [20.0, 0.0, 0.0];
    endless.origin[1] = f64::NAN;
    for (wrong, words) in [
        (empty, "no vector"),
        (flat, "one plane"),
        (endless, "not finite"),
    ] {
        let why = client.set_cell(Some(wrong)).unwrap_err().to_string();
        assert!(why.contains(words), "{why}");
    }
    publish(&mut client, 0);
    new_session(&mut sidecar);
    let info = next_frame(&mut sidecar).info(&mut LastLabels::default());
    assert_eq!(info.unwrap().cell, Some(kept));
}

/// A square at x = 0, and one that passes through the image of the first at x = `side` if `near`.
fn squares(side: f32, near: bool) -> Vec<f32> {
    let x = if near { side } else { side - 3.0 };
    let first = [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(|[x, y]| [x as f32, y as f32, 0.0]);
    let second = [[-2, -1], [0, -1], [0, 1], [-2, 1]].map(|[u, z]| [x + u as f32, 0.0, z as f32]);
    [first, second].as_flattened().as_flattened().to_vec()
}

/// Two squares are linked across the boundary of a cell that grows, and then come apart.
#[test]
fn a_link_that_is_lost_across_the_boundary_is_reported_with_its_image() {
    let name = service();
    let mut sidecar = sidecar(&name);
    let mut client = client(&name);
    let mut session = Session::new(SessionOptions {
        events: Events::All,
        ..SessionOptions::default()
    })
    .unwrap();
    let mut labels = LastLabels::default();
    let mut messages: Vec<VerdictMessage> = Vec::new();
    for (seq, (side, near)) in (0..).zip([(10.0, true), (10.5, true), (10.5, false)]) {
        let current = cell(&format!("{side},12,0"));
        client.set_cell(Some(current)).unwrap();
        let positions = squares(side as f32, near);
        let sent = client.publish(0.0, Positions::F32(&positions)).unwrap();
        assert_eq!(sent, seq);
        if seq == 0 {
            new_session(&mut sidecar);
        }
        let frame = next_frame(&mut sidecar);
        let info = frame.info(&mut labels).unwrap();
        let received = session.receive(info, |copy| frame.read(copy));
        let report = session.verify(received).unwrap().report;
        sidecar.send_verdict(&report, Duration::ZERO).unwrap();
        messages.push(until("a verdict", || {
            let message = client.poll().unwrap()?;
            (message.kind == MessageKind::Verdict).then_some(message)
        }));
    }
    let verdicts: Vec<Verdict> = messages.iter().map(|m| m.verdict).collect();
    let expected = [Verdict::Intact, Verdict::Intact, Verdict::Changed];
    assert_eq!(verdicts, expected);
    let Some(Finding::Change(change)) = messages[2].first else {
        panic!("{:?}", messages[2]);
    };
    assert_eq!((change.i, change.j, change.image), (0, 1, [-1, 0, 0]));
    assert_eq!((change.expected.abs(), change.found), (1, 0));
}
