//! Oracle for frames that follow or break the protocol. Written from `docs/reference/bus.md` alone;
//! it shares no code with the crate.

use super::frame::Frame;
use super::support::raw_bus::Header;
use std::collections::HashSet;

/// Largest coordinate of a spline.
const SPLINE_LIMIT: f64 = 2.037_035_976_334_486e90; // 2^300

/// Knowledge of a watcher before a frame.
#[derive(Clone, Default)]
pub struct Known {
    pub session: u64,
    /// Sequence number of the last frame with a valid number.
    pub seq: Option<u64>,
    /// Sequence number of the first such frame, which is the baseline of the session.
    pub first: Option<u64>,
    /// True if the last frame was a baseline, which its simulator may have published long ago.
    pub baseline: bool,
    /// Layout number of the last verified frame, and the properties that the layout fixes.
    pub verified: Option<(u32, Fixed)>,
    /// Limit of the watcher, in bytes.
    pub cap: usize,
    /// True if the watcher searches for pull-throughs, also those of open curves.
    pub events: bool,
}

/// Properties that all frames with the same `layout` share.
#[derive(Clone, PartialEq)]
pub struct Fixed {
    n_points: u64,
    basis: u32,
    coordinate_bytes: u32,
    pub counts: Vec<i32>,
    names: Vec<Vec<u8>>,
    radii: Option<Vec<f32>>,
}

/// Expected reaction to a message.
pub enum Expected {
    /// The format is unknown to the watcher. It must give one of these reasons.
    Unreadable(Vec<Reason>),
    /// Not a frame to verify: the end of a session, a query for watchers, or a repeated baseline.
    Signal,
    /// The message starts another session.
    OtherSession,
    Rejected(Vec<Reason>),
    /// The frame gets a verdict. Contains the properties that its layout fixes.
    Accepted(Fixed),
}

/// Texts that the reason of a rejection must contain, with the wrong numbers.
pub type Reason = Vec<String>;

macro_rules! reason {
    ($($word:expr),+) => { vec![$($word.to_string()),+] };
}

/// Returns the expected reaction to a frame.
pub fn judge(frame: &Frame, known: &Known) -> Expected {
    let h = &frame.header;
    let mut unreadable = Vec::new();
    if h.magic != Header::MAGIC {
        unreadable.push(reason!["magic number", format!("{:#018x}", h.magic)]);
    } else if h.version != Header::VERSION {
        unreadable.push(reason!["version", h.version]);
    } else if h.session == 0 {
        unreadable.push(reason!["session", 0]);
    }
    if !unreadable.is_empty() {
        return Expected::Unreadable(unreadable);
    }
    if h.session != known.session {
        return Expected::OtherSession;
    }
    if h.flags & (Header::END | Header::ANNOUNCE) != 0 {
        return Expected::Signal;
    }
    // Only a baseline may arrive twice.
    if h.flags & Header::BASELINE != 0 && known.first.is_some_and(|first| h.seq <= first) {
        return Expected::Signal;
    }
    let mut reasons = Vec::new();
    if !has_possible_number(frame, known) {
        reasons.push(reason!["sequence number", h.seq]);
    }
    if !h.time.is_finite() {
        reasons.push(reason!["time", h.time]);
    }
    if !(h.time_step >= 0.0 && h.time_step < f64::INFINITY) {
        reasons.push(reason!["time step", h.time_step]);
    }
    // No scene of these tests has a cell.
    let numbers = h.cell.iter().chain(&h.cell_origin);
    if h.cell_vectors != 0 || numbers.into_iter().any(|&x| x != 0.0) {
        reasons.push(reason!["periodic cell"]);
    }
    if h.basis > 3 {
        reasons.push(reason!["basis code", h.basis]);
    }
    let size = u128::from(h.coordinate_bytes);
    if ![4, 8].contains(&size) {
        reasons.push(reason!["bytes of a coordinate", h.coordinate_bytes]);
    }
    if frame.payload.len() > known.cap {
        reasons.push(reason![
            "more than the limit",
            frame.payload.len(),
            known.cap
        ]);
    }
    let padded = |bytes: u128| bytes.next_multiple_of(64);
    let counts = padded(4 * u128::from(h.n_curves));
    let names = padded(h.names_bytes.into());
    let radii = if h.flags & Header::RADII != 0 {
        counts
    } else {
        0
    };
    let promised = counts + names + radii + 3 * u128::from(h.n_points) * size;
    let exact = promised == frame.payload.len() as u128;
    if !exact {
        // The message saturates the number.
        let promised = promised.min(u64::MAX.into());
        reasons.push(reason!["bytes of a frame", promised, frame.payload.len()]);
    }
    if !exact || h.basis > 3 || ![4, 8].contains(&size) {
        return Expected::Rejected(reasons);
    }
    let parts = [0, counts, counts + names, counts + names + radii].map(|at| at as usize);
    let fixed = fixed(frame, parts, &mut reasons);
    positions(frame, parts[3], &fixed, &mut reasons);
    match &known.verified {
        Some((layout, before)) if *layout == h.layout => compare(before, &fixed, &mut reasons),
        Some((_, before)) if before.names.is_empty() || fixed.names.is_empty() => {
            reasons.push(reason!["described again", "no names"]);
        }
        _ => {}
    }
    if !known.events && fixed.counts.iter().all(|&count| count > 0) {
        reasons.push(reason!["none of", fixed.counts.len(), "curves is closed"]);
    }
    match reasons.is_empty() {
        true => Expected::Accepted(fixed),
        false => Expected::Rejected(reasons),
    }
}

/// Returns true if a frame may have its sequence number. No simulator can have published 2^40
/// frames during a test, and the mutations use no number between 1000 and 2^40.
pub fn has_possible_number(frame: &Frame, known: &Known) -> bool {
    match known.seq {
        None => frame.header.seq < 1 << 53,
        Some(last) => {
            let most = if known.baseline {
                1 << 53
            } else {
                last + (1 << 40)
            };
            (last + 1..most).contains(&frame.header.seq)
        }
    }
}

/// Reads the parts before the positions.
fn fixed(frame: &Frame, parts: [usize; 4], reasons: &mut Vec<Reason>) -> Fixed {
    let h = &frame.header;
    let n = h.n_curves as usize;
    let word = |at: usize| frame.payload[at..at + 4].try_into().expect("four bytes");
    let counts: Vec<i32> = (0..n).map(|k| i32::from_ne_bytes(word(4 * k))).collect();
    let sum: u64 = counts.iter().map(|c| u64::from(c.unsigned_abs())).sum();
    if sum != h.n_points {
        // The reason is the number of points, or a curve whose number of points changed.
        reasons.push(reason!["points", h.n_points]);
        reasons.push(reason!["coordinates", 3 * u128::from(h.n_points)]);
        reasons.push(reason!["control points of a curve was"]);
    }
    for (i, &count) in counts.iter().enumerate() {
        let (points, closed) = (count.unsigned_abs(), count < 0);
        let enough = match (h.basis, closed) {
            (0, true) => points >= 1,
            (0, false) => points >= 2,
            (1 | 2, true) => points >= 3,
            (1 | 2, false) => points >= 4,
            (_, true) => points >= 3 && points % 3 == 0,
            (_, false) => points >= 4 && points % 3 == 1,
        };
        if !enough {
            reasons.push(reason![format!("curve {i}"), points]);
            reasons.push(reason!["control points of a curve was", points]);
        }
    }
    let mut names = Vec::new();
    if h.names_bytes > 0 {
        let bytes = &frame.payload[parts[1]..][..h.names_bytes as usize];
        match bytes.strip_suffix(&[0]) {
            Some(bytes) => names = bytes.split(|&b| b == 0).map(<[u8]>::to_vec).collect(),
            None => reasons.push(reason!["the last name does not end with a zero byte"]),
        }
        if bytes.ends_with(&[0]) && names.len() != n {
            reasons.push(reason!["names of curves", n, names.len()]);
        }
        let mut seen = HashSet::new();
        for (i, name) in names.iter().enumerate() {
            let text = std::str::from_utf8(name);
            match text {
                Err(_) => reasons.push(reason!["not UTF-8"]),
                Ok(text) if text.chars().any(char::is_control) => {
                    reasons.push(reason![format!("curve ({i})"), "control characters"]);
                }
                _ if !(1..=255).contains(&name.len()) => {
                    reasons.push(reason![format!("curve ({i})"), "1 to 255 bytes"]);
                }
                _ => {}
            }
            if !seen.insert(name) {
                reasons.push(reason![format!("curve ({i})"), "which is that of curve"]);
            }
        }
    }
    let radii = h.flags & Header::RADII != 0;
    let radii = radii.then(|| {
        let radius = |k: usize| f32::from_ne_bytes(word(parts[2] + 4 * k));
        (0..n).map(radius).collect::<Vec<f32>>()
    });
    for (i, &r) in radii.iter().flatten().enumerate() {
        if !(0.0..f32::INFINITY).contains(&r) {
            reasons.push(reason![format!("curve ({i})"), "radius", r]);
        }
    }
    Fixed {
        n_points: h.n_points,
        basis: h.basis,
        coordinate_bytes: h.coordinate_bytes,
        counts,
        names,
        radii,
    }
}

/// Reads the coordinates.
fn positions(frame: &Frame, start: usize, fixed: &Fixed, reasons: &mut Vec<Reason>) {
    let size = fixed.coordinate_bytes as usize;
    let owner = |point: usize| {
        let mut first = 0;
        for (i, c) in fixed.counts.iter().enumerate() {
            let points = c.unsigned_abs() as usize;
            if point < first + points {
                return (i, point - first);
            }
            first += points;
        }
        (fixed.counts.len(), point)
    };
    for (k, x) in frame.payload[start..].chunks_exact(size).enumerate() {
        let x = match x.try_into() {
            Ok(bytes) => f64::from(f32::from_ne_bytes(bytes)),
            Err(_) => f64::from_ne_bytes(x.try_into().expect("4 or 8 bytes")),
        };
        let ((curve, point), axis) = (owner(k / 3), ["x", "y", "z"][k % 3]);
        if !x.is_finite() {
            let place = format!("curve {curve}, point {point}: coordinate {axis} is {x}");
            reasons.push(reason![place]);
        } else if fixed.basis != 0 && x.abs() > SPLINE_LIMIT {
            reasons.push(reason![
                format!("curve {curve}"),
                format!("{:.3e}", x.abs())
            ]);
        }
    }
}

/// Compares the properties that the layout fixes.
fn compare(before: &Fixed, now: &Fixed, reasons: &mut Vec<Reason>) {
    let mut differs = |what: &str, before: u64, now: u64| {
        if before != now {
            reasons.push(reason![what, "was", before, "is", now]);
        }
    };
    differs("basis code", before.basis.into(), now.basis.into());
    let bytes = [before, now].map(|f| f.coordinate_bytes.into());
    differs("bytes of a coordinate", bytes[0], bytes[1]);
    let curves = [before, now].map(|f| f.counts.len() as u64);
    differs("number of curves", curves[0], curves[1]);
    for (&b, &n) in before.counts.iter().zip(&now.counts) {
        differs(
            "control points of a curve",
            b.unsigned_abs().into(),
            n.unsigned_abs().into(),
        );
        differs("closed (1) or open (0)", u64::from(b < 0), u64::from(n < 0));
    }
    if before.names != now.names {
        reasons.push(reason!["names of the curves", "layout"]);
    }
    if before.radii != now.radii {
        reasons.push(reason!["radii of the curves", "layout"]);
    }
}
