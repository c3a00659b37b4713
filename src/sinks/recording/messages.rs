//! Messages of `schemas/linkwatch.proto` as structs, and their conversions from and to library
//! types.
//!
//! Written by hand, so that no build needs `protoc`. The tests compare them with the compiled
//! schema, field by field.

use crate::certificate::{Certificate, Change, Link};
use crate::curve::{Basis, Precision};
use crate::error::{Error, Result};
use crate::incremental::{Route, Work};
use crate::sinks::BaselineRecord;
use crate::verdict::{Defect, DefectKind, Place, PullThrough, Report, Stats, Verdict};
use prost::bytes::Bytes;
use std::sync::Arc;

/// Compiled form of `schemas/linkwatch.proto`: the schema that every recording carries.
pub(super) const DESCRIPTORS: &[u8] = include_bytes!("../../../schemas/linkwatch.binpb");

/// Package of the messages. Its last part is the version of the format.
pub(super) const PACKAGE: &str = "linkwatch.v1";

#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct FrameMessage {
    #[prost(uint64, tag = "1")]
    pub seq: u64,
    #[prost(double, tag = "2")]
    pub time: f64,
    #[prost(int32, tag = "3")]
    pub basis: i32,
    #[prost(int32, tag = "4")]
    pub precision: i32,
    #[prost(sint32, repeated, tag = "5")]
    pub counts: Vec<i32>,
    #[prost(bytes = "bytes", tag = "6")]
    pub positions: Bytes,
    #[prost(uint32, tag = "7")]
    pub cuts: u32,
}

#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct VerdictMessage {
    #[prost(message, optional, tag = "1")]
    pub report: Option<ReportMessage>,
    #[prost(message, optional, tag = "2")]
    pub progress: Option<ProgressMessage>,
}

#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct ReportMessage {
    #[prost(uint64, tag = "1")]
    pub seq: u64,
    #[prost(double, tag = "2")]
    pub time: f64,
    #[prost(int32, tag = "3")]
    pub verdict: i32,
    #[prost(bool, tag = "4")]
    pub abort: bool,
    #[prost(message, repeated, tag = "5")]
    pub changes: Vec<ChangeMessage>,
    #[prost(message, repeated, tag = "6")]
    pub defects: Vec<DefectMessage>,
    #[prost(string, optional, tag = "7")]
    pub rejected: Option<String>,
    #[prost(message, optional, tag = "8")]
    pub stats: Option<StatsMessage>,
    #[prost(message, repeated, tag = "9")]
    pub events: Vec<PullThroughMessage>,
    #[prost(message, repeated, tag = "10")]
    pub adopted: Vec<LinkMessage>,
    #[prost(message, repeated, tag = "11")]
    pub unresolved: Vec<PullThroughMessage>,
}

#[derive(Clone, Copy, PartialEq, prost::Message)]
pub(super) struct ProgressMessage {
    #[prost(uint64, tag = "1")]
    pub verified: u64,
    #[prost(uint64, tag = "2")]
    pub skipped: u64,
    #[prost(uint64, tag = "3")]
    pub rejected: u64,
    #[prost(uint64, tag = "4")]
    pub check_ns: u64,
    #[prost(message, optional, tag = "5")]
    pub work: Option<WorkMessage>,
}

#[derive(Clone, Copy, PartialEq, prost::Message)]
pub(super) struct WorkMessage {
    #[prost(int32, tag = "1")]
    pub route: i32,
    #[prost(uint64, tag = "2")]
    pub blocks: u64,
    #[prost(uint64, tag = "3")]
    pub marked: u64,
    #[prost(uint64, tag = "4")]
    pub recertified: u64,
    #[prost(uint64, tag = "5")]
    pub recomputed: u64,
    #[prost(uint64, tag = "6")]
    pub searched: u64,
    #[prost(uint64, optional, tag = "7")]
    pub reference_age: Option<u64>,
    #[prost(bool, tag = "8")]
    pub disagreed: bool,
    #[prost(uint64, tag = "9")]
    pub summed: u64,
}

#[derive(Clone, Copy, PartialEq, prost::Message)]
pub(super) struct PullThroughMessage {
    #[prost(uint32, tag = "1")]
    pub i: u32,
    #[prost(uint32, tag = "2")]
    pub j: u32,
    #[prost(uint32, tag = "3")]
    pub segment_i: u32,
    #[prost(uint32, tag = "4")]
    pub segment_j: u32,
    #[prost(double, tag = "5")]
    pub fraction: f64,
    #[prost(sint32, tag = "6")]
    pub sign: i32,
    #[prost(double, tag = "7")]
    pub x: f64,
    #[prost(double, tag = "8")]
    pub y: f64,
    #[prost(double, tag = "9")]
    pub z: f64,
    #[prost(double, tag = "10")]
    pub lengths: f64,
}

#[derive(Clone, Copy, PartialEq, prost::Message)]
pub(super) struct ChangeMessage {
    #[prost(uint32, tag = "1")]
    pub i: u32,
    #[prost(uint32, tag = "2")]
    pub j: u32,
    #[prost(sint64, tag = "3")]
    pub expected: i64,
    #[prost(sint64, tag = "4")]
    pub found: i64,
    #[prost(message, optional, tag = "5")]
    pub place: Option<PlaceMessage>,
}

#[derive(Clone, Copy, PartialEq, prost::Message)]
pub(super) struct DefectMessage {
    #[prost(uint32, tag = "1")]
    pub i: u32,
    #[prost(uint32, optional, tag = "2")]
    pub j: Option<u32>,
    #[prost(int32, tag = "3")]
    pub kind: i32,
    #[prost(message, optional, tag = "4")]
    pub place: Option<PlaceMessage>,
}

#[derive(Clone, Copy, PartialEq, prost::Message)]
pub(super) struct PlaceMessage {
    #[prost(uint32, tag = "1")]
    pub segment_i: u32,
    #[prost(uint32, tag = "2")]
    pub segment_j: u32,
    #[prost(double, tag = "3")]
    pub x: f64,
    #[prost(double, tag = "4")]
    pub y: f64,
    #[prost(double, tag = "5")]
    pub z: f64,
    #[prost(double, tag = "6")]
    pub distance: f64,
}

#[derive(Clone, Copy, PartialEq, prost::Message)]
pub(super) struct StatsMessage {
    #[prost(uint64, tag = "1")]
    pub curves: u64,
    #[prost(uint64, tag = "2")]
    pub segments: u64,
    #[prost(uint64, tag = "3")]
    pub open_curves: u64,
    #[prost(uint64, tag = "4")]
    pub repeated_vertices: u64,
    #[prost(uint64, tag = "5")]
    pub potential_links: u64,
    #[prost(uint64, tag = "6")]
    pub separated: u64,
    #[prost(uint64, tag = "7")]
    pub tests: u64,
    #[prost(uint64, tag = "8")]
    pub crossings: u64,
    #[prost(uint64, tag = "9")]
    pub overlaps: u64,
    #[prost(uint64, tag = "10")]
    pub refined: u64,
    #[prost(uint64, tag = "11")]
    pub exact: u64,
    #[prost(uint64, tag = "12")]
    pub unchecked: u64,
    #[prost(double, tag = "13")]
    pub extent: f64,
}

#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct BaselineMessage {
    #[prost(uint64, tag = "1")]
    pub curves: u64,
    #[prost(message, repeated, tag = "2")]
    pub links: Vec<LinkMessage>,
    #[prost(message, repeated, tag = "3")]
    pub undefined: Vec<DefectMessage>,
    #[prost(string, tag = "4")]
    pub origin: String,
}

#[derive(Clone, Copy, PartialEq, prost::Message)]
pub(super) struct LinkMessage {
    #[prost(uint32, tag = "1")]
    pub i: u32,
    #[prost(uint32, tag = "2")]
    pub j: u32,
    #[prost(sint64, tag = "3")]
    pub lambda: i64,
}

/// Returns the code of a value on disk: its index in `all`, from 1. Code 0 is the value that
/// protobuf reads for a missing field.
fn code<T: PartialEq>(all: &[T], value: T) -> i32 {
    all.iter()
        .position(|v| *v == value)
        .map_or(0, |k| k as i32 + 1)
}

fn from_code<T: Copy>(all: &[T], code: i32, what: &'static str) -> Result<T> {
    usize::try_from(code)
        .ok()
        .and_then(|c| c.checked_sub(1))
        .and_then(|k| all.get(k).copied())
        .ok_or_else(|| {
            invalid(
                what,
                format_args!("code {code}, expected 1 to {}", all.len()),
            )
        })
}

/// Creates the error of a message that decodes, but has invalid content.
pub(super) fn invalid(place: &str, what: impl std::fmt::Display) -> Error {
    Error::format("recording", place, what)
}

const PRECISIONS: [Precision; 2] = [Precision::F32, Precision::F64];

pub(super) fn basis_code(basis: Basis) -> i32 {
    code(&Basis::ALL, basis)
}

pub(super) fn basis(code: i32) -> Result<Basis> {
    from_code(&Basis::ALL, code, "basis of a frame")
}

pub(super) fn precision_code(precision: Precision) -> i32 {
    code(&PRECISIONS, precision)
}

pub(super) fn precision(code: i32) -> Result<Precision> {
    from_code(&PRECISIONS, code, "precision of a frame")
}

impl From<Place> for PlaceMessage {
    fn from(p: Place) -> Self {
        let ([segment_i, segment_j], [x, y, z]) = (p.segments, p.point);
        PlaceMessage {
            segment_i,
            segment_j,
            x,
            y,
            z,
            distance: p.distance,
        }
    }
}

impl From<PlaceMessage> for Place {
    fn from(p: PlaceMessage) -> Self {
        Place {
            segments: [p.segment_i, p.segment_j],
            point: [p.x, p.y, p.z],
            distance: p.distance,
        }
    }
}

impl From<&Defect> for DefectMessage {
    fn from(d: &Defect) -> Self {
        DefectMessage {
            i: d.i,
            j: d.j,
            kind: code(&DefectKind::ALL, d.kind),
            place: Some(d.place.into()),
        }
    }
}

impl TryFrom<DefectMessage> for Defect {
    type Error = Error;
    fn try_from(d: DefectMessage) -> Result<Self> {
        Ok(Defect {
            i: d.i,
            j: d.j,
            kind: from_code(&DefectKind::ALL, d.kind, "kind of a defect")?,
            place: d
                .place
                .ok_or_else(|| invalid("place of a defect", "missing"))?
                .into(),
        })
    }
}

impl From<&PullThrough> for PullThroughMessage {
    fn from(e: &PullThrough) -> Self {
        let ([segment_i, segment_j], [x, y, z]) = (e.segments, e.point);
        PullThroughMessage {
            i: e.i,
            j: e.j,
            segment_i,
            segment_j,
            fraction: e.fraction,
            sign: e.sign,
            x,
            y,
            z,
            lengths: e.lengths,
        }
    }
}

impl From<PullThroughMessage> for PullThrough {
    fn from(e: PullThroughMessage) -> Self {
        PullThrough {
            i: e.i,
            j: e.j,
            segments: [e.segment_i, e.segment_j],
            fraction: e.fraction,
            sign: e.sign,
            point: [e.x, e.y, e.z],
            lengths: e.lengths,
        }
    }
}

impl From<&Work> for WorkMessage {
    fn from(w: &Work) -> Self {
        WorkMessage {
            route: code(&Route::ALL, w.route),
            blocks: w.blocks,
            marked: w.marked,
            recertified: w.recertified,
            recomputed: w.recomputed,
            searched: w.searched,
            reference_age: w.reference_age,
            disagreed: w.disagreed,
            summed: w.summed,
        }
    }
}

impl TryFrom<WorkMessage> for Work {
    type Error = Error;
    fn try_from(w: WorkMessage) -> Result<Self> {
        Ok(Work {
            route: from_code(&Route::ALL, w.route, "route of a frame")?,
            blocks: w.blocks,
            marked: w.marked,
            recertified: w.recertified,
            recomputed: w.recomputed,
            searched: w.searched,
            reference_age: w.reference_age,
            disagreed: w.disagreed,
            summed: w.summed,
        })
    }
}

impl From<&Report> for ReportMessage {
    fn from(r: &Report) -> Self {
        let change = |c: &Change| ChangeMessage {
            i: c.i,
            j: c.j,
            expected: c.expected,
            found: c.found,
            place: c.place.map(Into::into),
        };
        let s = &r.stats;
        ReportMessage {
            seq: r.seq,
            time: r.time,
            verdict: code(&Verdict::ALL, r.verdict),
            abort: r.abort,
            changes: r.changes.iter().map(change).collect(),
            events: r.events.iter().map(Into::into).collect(),
            unresolved: r.unresolved.iter().map(Into::into).collect(),
            defects: r.defects.iter().map(Into::into).collect(),
            adopted: r.adopted.iter().map(Into::into).collect(),
            rejected: r.rejected.clone(),
            stats: Some(StatsMessage {
                curves: s.curves,
                segments: s.segments,
                open_curves: s.open_curves,
                repeated_vertices: s.repeated_vertices,
                potential_links: s.potential_links,
                separated: s.separated,
                tests: s.tests,
                crossings: s.crossings,
                overlaps: s.overlaps,
                refined: s.refined,
                exact: s.exact,
                unchecked: s.unchecked,
                extent: s.extent,
            }),
        }
    }
}

impl TryFrom<ReportMessage> for Report {
    type Error = Error;
    fn try_from(r: ReportMessage) -> Result<Self> {
        let change = |c: ChangeMessage| Change {
            i: c.i,
            j: c.j,
            expected: c.expected,
            found: c.found,
            place: c.place.map(Into::into),
        };
        let s = r.stats.unwrap_or_default();
        Ok(Report {
            seq: r.seq,
            time: r.time,
            verdict: from_code(&Verdict::ALL, r.verdict, "verdict of a report")?,
            abort: r.abort,
            changes: r.changes.into_iter().map(change).collect(),
            events: r.events.into_iter().map(Into::into).collect(),
            unresolved: r.unresolved.into_iter().map(Into::into).collect(),
            defects: collect(r.defects)?,
            adopted: r.adopted.into_iter().map(Into::into).collect(),
            rejected: r.rejected,
            stats: Stats {
                curves: s.curves,
                segments: s.segments,
                open_curves: s.open_curves,
                repeated_vertices: s.repeated_vertices,
                potential_links: s.potential_links,
                separated: s.separated,
                tests: s.tests,
                crossings: s.crossings,
                overlaps: s.overlaps,
                refined: s.refined,
                exact: s.exact,
                unchecked: s.unchecked,
                extent: s.extent,
            },
        })
    }
}

impl From<&Link> for LinkMessage {
    fn from(l: &Link) -> Self {
        LinkMessage {
            i: l.i,
            j: l.j,
            lambda: l.lambda,
        }
    }
}

impl From<LinkMessage> for Link {
    fn from(l: LinkMessage) -> Self {
        Link {
            i: l.i,
            j: l.j,
            lambda: l.lambda,
        }
    }
}

impl From<&BaselineRecord> for BaselineMessage {
    fn from(b: &BaselineRecord) -> Self {
        let c = &b.certificate;
        BaselineMessage {
            curves: c.curves as u64,
            links: c.links.iter().map(Into::into).collect(),
            undefined: c.undefined.iter().map(Into::into).collect(),
            origin: b.origin.clone(),
        }
    }
}

impl TryFrom<BaselineMessage> for BaselineRecord {
    type Error = Error;
    /// Checks the preconditions of comparing certificates: pairs in range and sorted, no number 0.
    fn try_from(b: BaselineMessage) -> Result<Self> {
        let links: Vec<Link> = b.links.into_iter().map(Into::into).collect();
        let bad = |l: &&Link| l.i >= l.j || u64::from(l.j) >= b.curves || l.lambda == 0;
        if let Some(l) = links.iter().find(bad) {
            let what = format!("{},{},{} of {} curves", l.i, l.j, l.lambda, b.curves);
            return Err(invalid("link of the baseline", what));
        }
        if let Some(w) = links
            .windows(2)
            .find(|w| (w[0].i, w[0].j) >= (w[1].i, w[1].j))
        {
            let what = format!(
                "{},{} is not sorted after the previous pair",
                w[1].i, w[1].j
            );
            return Err(invalid("link of the baseline", what));
        }
        let mut undefined: Vec<Defect> = collect(b.undefined)?;
        undefined.sort_by_key(|d| (d.i, d.j));
        if let Some(d) = undefined
            .iter()
            .find(|d| u64::from(d.j.unwrap_or(d.i)) >= b.curves || d.j.is_some_and(|j| d.i >= j))
        {
            let what = format!("{d}, of {} curves", b.curves);
            return Err(invalid("defect of the baseline", what));
        }
        let curves =
            usize::try_from(b.curves).map_err(|_| invalid("curves of the baseline", b.curves))?;
        Ok(BaselineRecord {
            certificate: Arc::new(Certificate {
                curves,
                links,
                undefined,
            }),
            origin: b.origin,
        })
    }
}

fn collect(defects: Vec<DefectMessage>) -> Result<Vec<Defect>> {
    defects.into_iter().map(Defect::try_from).collect()
}
