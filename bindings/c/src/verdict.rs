//! Verdicts and messages, as a C struct.

use linkwatch::{ChangeKind, Finding, MessageKind, Report, VerdictMessage};
use std::ffi::c_char;

/// Every linking number was proven to be the expected one.
pub const LW_INTACT: u32 = 0;
/// A linking number differs from the expected one, or a curve was pulled through another one.
pub const LW_CHANGED: u32 = 1;
/// Curves touch, so their linking number is undefined.
pub const LW_CONTACT: u32 = 2;
/// Some pair could not be decided or compared.
pub const LW_UNDECIDED: u32 = 3;
/// The message is not a verdict on a frame, or there is no message.
pub const LW_NOT_VERIFIED: u32 = 4;
/// The frame is invalid: NaN, counts that do not match, or other curves than in the last frame.
pub const LW_REJECTED: u32 = 5;

/// The watcher is present.
pub const LW_HELLO: u32 = 0;
/// The watcher verified a frame.
pub const LW_VERDICT: u32 = 1;
/// The watcher has finished this session.
pub const LW_GOODBYE: u32 = 2;

/// The verdict has no finding.
pub const LW_FINDING_NONE: u32 = 0;
/// A linking number differs from the expected one.
pub const LW_FINDING_CHANGE: u32 = 1;
/// A pair of curves, or a curve, could not be decided or compared.
pub const LW_FINDING_DEFECT: u32 = 2;
/// A curve was pulled through another one, or through itself.
pub const LW_FINDING_PULL_THROUGH: u32 = 3;

/// Number of the second curve if a finding concerns a single curve.
pub const LW_NO_CURVE: u32 = u32::MAX;
/// Number of the last intact frame if there is none.
pub const LW_NO_FRAME: u64 = u64::MAX;

/// Number of bytes of `lw_verdict.text`.
pub const LW_TEXT: usize = 512;

/// Verdict on a frame, or another message of the watcher.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct lw_verdict {
    /// Sequence number of the frame, from 0.
    pub seq: u64,
    /// Simulation time of the frame, in seconds.
    pub time: f64,
    /// LW_VERDICT, LW_HELLO or LW_GOODBYE.
    pub kind: u32,
    /// LW_INTACT, LW_CHANGED, LW_CONTACT, LW_UNDECIDED or LW_REJECTED. LW_NOT_VERIFIED if `kind` is
    /// not LW_VERDICT, or if the function that writes the verdict does not return LW_OK.
    pub verdict: u32,
    /// True if the simulator is asked to stop or to roll back.
    pub abort: bool,
    /// Number of links lost, gained, and changed otherwise.
    pub lost: u32,
    /// See `lost`.
    pub gained: u32,
    /// See `lost`.
    pub changed: u32,
    /// Number of pull-throughs since the last verified frame.
    pub pull_throughs: u32,
    /// Number of pull-throughs that cannot be resolved, because the frames are too far apart.
    pub unresolved: u32,
    /// Number of pairs and curves that could not be decided or compared.
    pub defects: u32,
    /// Number of curves that appeared since the last verified frame.
    pub appeared: u32,
    /// Number of curves that are gone since the last verified frame.
    pub gone: u32,
    /// Number of all findings of the frame.
    pub findings: u32,
    /// Number of violations in the session that were rolled back, so that a later frame is intact;
    /// 0 in process.
    pub recovered: u32,
    /// Last frame that is known to be intact, or LW_NO_FRAME.
    pub last_intact: u64,
    /// Largest proven fraction of the step from the last intact frame without a pull-through, from
    /// 0 to 1; NaN if it is unknown.
    pub safe_fraction: f64,
    /// The first finding that the last verified frame did not have (in process: the first one):
    /// LW_FINDING_NONE, LW_FINDING_CHANGE, LW_FINDING_DEFECT or LW_FINDING_PULL_THROUGH.
    pub finding: u32,
    /// Curves of the first finding, from 0. The second one is LW_NO_CURVE if it concerns one curve.
    pub i: u32,
    /// See `i`.
    pub j: u32,
    /// Translation of the curve `j` of the first finding, in lattice vectors; zeros without a cell.
    pub image: [i32; 3],
    /// True if the place of the first finding is known.
    pub has_place: bool,
    /// Segments of the curves `i` and `j` at the place of the first finding, from 0.
    pub segments: [u32; 2],
    /// Place of the first finding, in the units of the simulation.
    pub point: [f64; 3],
    /// Time of a pull-through, as a fraction of the step.
    pub fraction: f64,
    /// Frames of the session that were verified, skipped and rejected; 0 in process.
    pub frames_verified: u64,
    /// See `frames_verified`.
    pub frames_skipped: u64,
    /// See `frames_verified`.
    pub frames_rejected: u64,
    /// The verdict and its first findings as a sentence, which ends with a zero byte. It is
    /// truncated if it is long.
    pub text: [c_char; LW_TEXT],
}

/// Writes a sentence, truncated between two characters.
fn text(words: &str) -> [c_char; LW_TEXT] {
    let mut out = [0; LW_TEXT];
    let end = words.floor_char_boundary(LW_TEXT - 1);
    for (to, &from) in out.iter_mut().zip(&words.as_bytes()[..end]) {
        *to = from as c_char;
    }
    out
}

impl lw_verdict {
    /// The absence of a verdict.
    pub(crate) const NONE: lw_verdict = lw_verdict {
        seq: 0,
        time: 0.0,
        kind: LW_HELLO,
        verdict: LW_NOT_VERIFIED,
        abort: false,
        lost: 0,
        gained: 0,
        changed: 0,
        pull_throughs: 0,
        unresolved: 0,
        defects: 0,
        appeared: 0,
        gone: 0,
        findings: 0,
        recovered: 0,
        last_intact: LW_NO_FRAME,
        safe_fraction: f64::NAN,
        finding: LW_FINDING_NONE,
        i: LW_NO_CURVE,
        j: LW_NO_CURVE,
        image: [0; 3],
        has_place: false,
        segments: [0; 2],
        point: [0.0; 3],
        fraction: f64::NAN,
        frames_verified: 0,
        frames_skipped: 0,
        frames_rejected: 0,
        text: [0; LW_TEXT],
    };

    /// Adds the first finding, if there is one.
    fn with_first(mut self, first: Option<&Finding>) -> lw_verdict {
        match first {
            Some(Finding::Change(c)) => {
                self.finding = LW_FINDING_CHANGE;
                (self.i, self.j, self.image) = (c.i, c.j, c.image);
                if let Some(place) = &c.place {
                    self.has_place = true;
                    (self.segments, self.point) = (place.segments, place.point);
                }
            }
            Some(Finding::Event(p)) => {
                self.finding = LW_FINDING_PULL_THROUGH;
                (self.i, self.j, self.image) = (p.i, p.j, p.image);
                self.has_place = true;
                (self.segments, self.point) = (p.segments, p.point);
                self.fraction = p.fraction;
            }
            Some(Finding::Defect(d)) => {
                self.finding = LW_FINDING_DEFECT;
                (self.i, self.j) = (d.i, d.j.unwrap_or(LW_NO_CURVE));
                self.image = d.image;
                self.has_place = true;
                (self.segments, self.point) = (d.place.segments, d.place.point);
            }
            _ => {}
        }
        self
    }
}

impl From<&VerdictMessage> for lw_verdict {
    fn from(m: &VerdictMessage) -> lw_verdict {
        let kind = match m.kind {
            MessageKind::Verdict => LW_VERDICT,
            MessageKind::Goodbye => LW_GOODBYE,
            _ => LW_HELLO,
        };
        let verdict = lw_verdict {
            seq: m.seq,
            time: m.time,
            kind,
            verdict: match kind {
                LW_VERDICT => m.verdict as u32,
                _ => LW_NOT_VERIFIED,
            },
            abort: m.abort,
            lost: m.lost,
            gained: m.gained,
            changed: m.changed,
            pull_throughs: m.events,
            unresolved: m.unresolved,
            defects: m.defects,
            appeared: m.appeared,
            gone: m.gone,
            findings: m.findings,
            recovered: m.recovered,
            last_intact: m.last_intact.unwrap_or(LW_NO_FRAME),
            safe_fraction: m.safe_fraction.unwrap_or(f64::NAN),
            frames_verified: m.counters.verified,
            frames_skipped: m.counters.skipped,
            frames_rejected: m.counters.rejected,
            text: text(&m.to_string()),
            ..lw_verdict::NONE
        };
        verdict.with_first(m.first.as_ref())
    }
}

impl lw_verdict {
    /// Converts a report on curves with these names, if any.
    pub(crate) fn of(r: &Report, names: &[String]) -> lw_verdict {
        let count = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
        let first = None
            .or(r.changes.first().copied().map(Finding::Change))
            .or(r.events.first().copied().map(Finding::Event))
            .or(r.defects.first().copied().map(Finding::Defect));
        let sentences = [r.headline()].into_iter().chain(r.findings_named(names));
        let verdict = lw_verdict {
            seq: r.seq,
            time: r.time,
            kind: LW_VERDICT,
            verdict: r.verdict as u32,
            abort: r.abort,
            lost: count(r.count(ChangeKind::Lost)),
            gained: count(r.count(ChangeKind::Gained)),
            changed: count(r.count(ChangeKind::Changed)),
            pull_throughs: count(r.events.len()),
            unresolved: count(r.unresolved.len()),
            defects: count(r.defects.len()),
            appeared: count(r.appeared.len()),
            gone: count(r.gone.len()),
            findings: count(r.findings().count()),
            last_intact: r.last_intact.unwrap_or(LW_NO_FRAME),
            safe_fraction: r.safe_fraction.unwrap_or(f64::NAN),
            text: text(&sentences.take(8).collect::<Vec<_>>().join("; ")),
            ..lw_verdict::NONE
        };
        verdict.with_first(first.as_ref())
    }
}
