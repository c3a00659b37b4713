//! Conversions of the messages in a recording from and to library types.

use super::schema;
use crate::certificate::{Certificate, undefined_entry};
pub(super) use crate::container::invalid;
use crate::curve::{Basis, Cell, Image, Precision, is_home};
use crate::error::{Error, Result};
use crate::incremental::{Route, Work};
use crate::sinks::{BaselineRecord, FrameTimes, LiveTimes};
use crate::verdict::{
    Change, Clearance, CloseStrands, Defect, DefectKind, ImageLink, Link, Place, PullThrough,
    Report, Stats, Verdict,
};
use std::sync::Arc;
use std::time::Duration;

/// Compiled form of `schemas/linkwatch.proto`: the schema that every recording carries.
pub(super) const DESCRIPTORS: &[u8] = include_bytes!("../../../schemas/linkwatch.binpb");

/// Package of the messages. Its last part is the version of the format.
pub(super) const PACKAGE: &str = "linkwatch.v1";

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

/// Converts structs whose fields have the same names and types in the schema and in the library.
macro_rules! convert {
    ($name:ident { $($field:ident),* $(,)? }) => {
        impl From<&$name> for schema::$name {
            fn from(from: &$name) -> Self {
                schema::$name { $($field: from.$field),* }
            }
        }

        impl From<schema::$name> for $name {
            fn from(from: schema::$name) -> Self {
                $name { $($field: from.$field),* }
            }
        }
    };
}

convert!(Link { i, j, lambda });

convert!(Stats {
    curves,
    segments,
    open_curves,
    repeated_vertices,
    potential_links,
    separated,
    tests,
    crossings,
    overlaps,
    refined,
    exact,
    unchecked,
    extent,
});

impl From<Place> for schema::Place {
    fn from(p: Place) -> Self {
        let ([segment_i, segment_j], [x, y, z]) = (p.segments, p.point);
        schema::Place {
            segment_i,
            segment_j,
            x,
            y,
            z,
            distance: p.distance,
        }
    }
}

impl From<schema::Place> for Place {
    fn from(p: schema::Place) -> Self {
        Place {
            segments: [p.segment_i, p.segment_j],
            point: [p.x, p.y, p.z],
            distance: p.distance,
        }
    }
}

impl From<&Defect> for schema::Defect {
    fn from(d: &Defect) -> Self {
        schema::Defect {
            i: d.i,
            j: d.j,
            kind: code(&DefectKind::ALL, d.kind),
            place: Some(d.place.into()),
            image: numbers_of(d.image),
        }
    }
}

impl TryFrom<schema::Defect> for Defect {
    type Error = Error;
    fn try_from(d: schema::Defect) -> Result<Self> {
        Ok(Defect {
            i: d.i,
            j: d.j,
            image: image_of(&d.image)?,
            kind: from_code(&DefectKind::ALL, d.kind, "kind of a defect")?,
            place: d
                .place
                .ok_or_else(|| invalid("place of a defect", "missing"))?
                .into(),
        })
    }
}

impl From<&PullThrough> for schema::PullThrough {
    fn from(e: &PullThrough) -> Self {
        let ([segment_i, segment_j], [x, y, z]) = (e.segments, e.point);
        schema::PullThrough {
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
            image: numbers_of(e.image),
        }
    }
}

impl TryFrom<schema::PullThrough> for PullThrough {
    type Error = Error;
    fn try_from(e: schema::PullThrough) -> Result<Self> {
        Ok(PullThrough {
            i: e.i,
            j: e.j,
            image: image_of(&e.image)?,
            segments: [e.segment_i, e.segment_j],
            fraction: e.fraction,
            sign: e.sign,
            point: [e.x, e.y, e.z],
            lengths: e.lengths,
        })
    }
}

/// Returns a translation as it is recorded: nothing for 0.
fn numbers_of(image: Image) -> Vec<i32> {
    match image == Image::default() {
        true => Vec::new(),
        false => image.to_vec(),
    }
}

fn image_of(numbers: &[i32]) -> Result<Image> {
    match numbers {
        [] => Ok(Image::default()),
        &[n1, n2, n3] => Ok([n1, n2, n3]),
        _ => Err(invalid("image", format!("{} numbers", numbers.len()))),
    }
}

/// Returns a periodic cell as it is recorded.
pub(super) fn numbers_of_cell(cell: Option<&Cell>) -> Vec<f64> {
    let Some(cell) = cell else {
        return Vec::new();
    };
    let vectors = cell.vectors.as_flattened();
    vectors.iter().chain(&cell.origin).copied().collect()
}

/// Returns the periodic cell of a recorded frame.
pub(super) fn cell_of(numbers: &[f64]) -> Result<Option<Cell>> {
    if numbers.is_empty() {
        return Ok(None);
    }
    let (&[a, b, c, origin], []) = numbers.as_chunks::<3>() else {
        return Err(invalid("cell", format!("{} numbers", numbers.len())));
    };
    let cell = Cell {
        origin,
        vectors: [a, b, c],
    };
    cell.check()?;
    Ok(Some(cell))
}

impl From<&FrameTimes> for schema::FrameTimes {
    fn from(t: &FrameTimes) -> Self {
        schema::FrameTimes {
            ingest_ns: nanoseconds(t.ingest),
            verification_ns: nanoseconds(t.verification),
            live: t.live.map(|live| schema::LiveTimes {
                interval_ns: nanoseconds(live.interval),
                wait_ns: nanoseconds(live.wait),
                send_ns: nanoseconds(live.send),
            }),
        }
    }
}

impl From<schema::FrameTimes> for FrameTimes {
    fn from(t: schema::FrameTimes) -> Self {
        FrameTimes {
            ingest: Duration::from_nanos(t.ingest_ns),
            verification: Duration::from_nanos(t.verification_ns),
            live: t.live.map(|live| LiveTimes {
                interval: Duration::from_nanos(live.interval_ns),
                wait: Duration::from_nanos(live.wait_ns),
                send: Duration::from_nanos(live.send_ns),
            }),
            ..FrameTimes::default()
        }
    }
}

/// Returns a duration in nanoseconds, at most the largest number.
pub(super) fn nanoseconds(duration: Duration) -> u64 {
    duration.as_nanos().try_into().unwrap_or(u64::MAX)
}

impl From<&Work> for schema::Work {
    fn from(w: &Work) -> Self {
        schema::Work {
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

impl TryFrom<schema::Work> for Work {
    type Error = Error;
    fn try_from(w: schema::Work) -> Result<Self> {
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

impl From<&Report> for schema::Report {
    fn from(r: &Report) -> Self {
        let change = |c: &Change| schema::Change {
            i: c.i,
            j: c.j,
            expected: c.expected,
            found: c.found,
            place: c.place.map(Into::into),
            image: numbers_of(c.image),
        };
        schema::Report {
            seq: r.seq,
            time: r.time,
            verdict: code(&Verdict::ALL, r.verdict),
            abort: r.abort,
            changes: r.changes.iter().map(change).collect(),
            events: r.events.iter().map(Into::into).collect(),
            unresolved: r.unresolved.iter().map(Into::into).collect(),
            defects: r.defects.iter().map(Into::into).collect(),
            adopted: r.adopted.iter().map(Into::into).collect(),
            last_intact: r.last_intact,
            safe_fraction: r.safe_fraction,
            clearance: r.clearance.as_ref().map(Into::into),
            appeared: r.appeared.clone(),
            gone: r.gone.clone(),
            missing: r.missing.clone(),
            rejected: r.rejected.clone(),
            stats: Some((&r.stats).into()),
        }
    }
}

impl TryFrom<schema::Report> for Report {
    type Error = Error;
    fn try_from(r: schema::Report) -> Result<Self> {
        let change = |c: schema::Change| {
            Ok(Change {
                i: c.i,
                j: c.j,
                image: image_of(&c.image)?,
                expected: c.expected,
                found: c.found,
                place: c.place.map(Into::into),
            })
        };
        let changes: Result<Vec<Change>> = r.changes.into_iter().map(change).collect();
        let pull_throughs = |all: Vec<schema::PullThrough>| -> Result<Vec<PullThrough>> {
            all.into_iter().map(PullThrough::try_from).collect()
        };
        Ok(Report {
            seq: r.seq,
            time: r.time,
            verdict: from_code(&Verdict::ALL, r.verdict, "verdict of a report")?,
            abort: r.abort,
            changes: changes?,
            events: pull_throughs(r.events)?,
            unresolved: pull_throughs(r.unresolved)?,
            defects: collect(r.defects)?,
            adopted: r.adopted.into_iter().map(Into::into).collect(),
            last_intact: r.last_intact,
            safe_fraction: r.safe_fraction,
            clearance: r.clearance.map(TryInto::try_into).transpose()?,
            appeared: r.appeared,
            gone: r.gone,
            missing: r.missing,
            loops: Vec::new(),
            rejected: r.rejected,
            stats: r.stats.unwrap_or_default().into(),
        })
    }
}

impl From<&Clearance> for schema::Clearance {
    fn from(c: &Clearance) -> Self {
        let strands = |c: CloseStrands| {
            let [[x_i, y_i, z_i], [x_j, y_j, z_j]] = c.points;
            schema::CloseStrands {
                i: c.i,
                j: c.j,
                segment_i: c.segments[0],
                segment_j: c.segments[1],
                x_i,
                y_i,
                z_i,
                x_j,
                y_j,
                z_j,
                distance: c.distance,
                ratio: c.ratio,
                error: c.error,
                image: numbers_of(c.image),
            }
        };
        schema::Clearance {
            at_least: c.at_least,
            closest: c.closest.map(strands),
            low: c.low,
            frames_left: c.frames_left,
        }
    }
}

impl TryFrom<schema::Clearance> for Clearance {
    type Error = Error;

    fn try_from(c: schema::Clearance) -> Result<Self> {
        let strands = |c: schema::CloseStrands| -> Result<CloseStrands> {
            Ok(CloseStrands {
                i: c.i,
                j: c.j,
                image: image_of(&c.image)?,
                segments: [c.segment_i, c.segment_j],
                points: [[c.x_i, c.y_i, c.z_i], [c.x_j, c.y_j, c.z_j]],
                distance: c.distance,
                ratio: c.ratio,
                error: c.error,
            })
        };
        Ok(Clearance {
            at_least: c.at_least,
            closest: c.closest.map(strands).transpose()?,
            low: c.low,
            frames_left: c.frames_left,
        })
    }
}

impl From<&BaselineRecord> for schema::Baseline {
    fn from(b: &BaselineRecord) -> Self {
        let c = &b.certificate;
        let image = |l: &ImageLink| schema::ImageLink {
            i: l.i,
            j: l.j,
            image: l.image.to_vec(),
            lambda: Some(l.lambda),
        };
        let period = |(i, period): &(u32, Image)| schema::YarnPeriod {
            curve: *i,
            period: period.to_vec(),
        };
        schema::Baseline {
            curves: c.curves as u64,
            links: c.links.iter().map(Into::into).collect(),
            undefined: c.undefined.iter().map(Into::into).collect(),
            origin: b.origin.clone(),
            frame: b.frame,
            unverified: b.unverified,
            periodic: c.images.is_some(),
            images: c.images.iter().flatten().map(image).collect(),
            periods: c.periods.iter().map(period).collect(),
        }
    }
}

impl TryFrom<schema::Baseline> for BaselineRecord {
    type Error = Error;
    /// Checks the preconditions of comparing certificates: pairs in range and sorted, no number 0.
    fn try_from(b: schema::Baseline) -> Result<Self> {
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
        let mut images = Vec::with_capacity(b.images.len());
        for schema::ImageLink {
            i,
            j,
            image,
            lambda,
        } in b.images
        {
            let image = image_of(&image)?;
            match lambda {
                Some(lambda) => images.push(ImageLink {
                    i,
                    j,
                    image,
                    lambda,
                }),
                // As earlier versions recorded a pair without a linking number.
                None => undefined.push(Defect {
                    image,
                    ..undefined_entry(i, Some(j))
                }),
            }
        }
        undefined.sort_by_key(|d| (d.i, d.j, d.image));
        let of_one = |d: &Defect| {
            d.j.is_some_and(|j| d.i > j || d.i == j && is_home(&d.image))
        };
        if let Some(d) = undefined
            .iter()
            .find(|d| u64::from(d.j.unwrap_or(d.i)) >= b.curves || of_one(d))
        {
            let what = format!("{d}, of {} curves", b.curves);
            return Err(invalid("defect of the baseline", what));
        }
        let images = b.periodic.then_some(images);
        let periods = b.periods.into_iter();
        let periods = periods.map(|p| Ok((p.curve, image_of(&p.period)?)));
        let periods: Result<Vec<(u32, Image)>> = periods.collect();
        let curves =
            usize::try_from(b.curves).map_err(|_| invalid("curves of the baseline", b.curves))?;
        Ok(BaselineRecord {
            certificate: Arc::new(Certificate {
                curves,
                links,
                undefined,
                images,
                periods: periods?,
            }),
            origin: b.origin,
            frame: b.frame,
            unverified: b.unverified,
        })
    }
}

fn collect(defects: Vec<schema::Defect>) -> Result<Vec<Defect>> {
    defects.into_iter().map(Defect::try_from).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fmt::Debug;

    /// Asserts that the codes of `values` are those of an enumeration in the schema: `name` is the
    /// name of a code there, with the name of the enumeration before that of the value.
    fn agree<T: Debug>(
        enumeration: &str,
        values: &[T],
        name: impl Fn(i32) -> Option<&'static str>,
    ) {
        let last = values.len() as i32;
        assert_eq!(name(last + 1), None, "{enumeration}");
        for (code, value) in (1..=last).zip(values) {
            let found = name(code).map(|n| n.replace('_', "").to_lowercase());
            let expected = format!("{enumeration}{value:?}").to_lowercase();
            assert_eq!(found, Some(expected));
        }
    }

    #[test]
    fn the_codes_equal_the_schema() {
        macro_rules! check {
            ($($name:ident $values:expr),*) => {$(
                agree(stringify!($name), &$values, |code| {
                    schema::$name::try_from(code).ok().map(|v| v.as_str_name())
                });
            )*};
        }
        check!(
            Basis Basis::ALL,
            Precision PRECISIONS,
            VerdictCode Verdict::ALL,
            Route Route::ALL,
            DefectKind DefectKind::ALL
        );
    }
}
