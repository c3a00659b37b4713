//! Conversions of the messages in a recording from and to library types.

use super::schema;
use crate::certificate::{Certificate, invariant_lines, parse_invariant, undefined_entry};
use crate::curve::{Basis, Cell, Image, Precision, is_home};
use crate::error::Result;
pub(super) use crate::formats::container::invalid;
use crate::incremental::{Route, Work};
use crate::sinks::{BaselineRecord, FrameTimes, LiveTimes, RunProgress};
use crate::verdict::{
    Change, Clearance, CloseStrands, Defect, DefectKind, ImageLink, InvariantChange, LeftOut, Link,
    Place, PullThrough, Report, Stats, Verdict,
};
use std::borrow::Cow;
use std::sync::Arc;
use std::time::Duration;

/// Compiled form of `schemas/linkwatch.proto`: the schema that every recording carries.
pub(super) const DESCRIPTORS: &[u8] = include_bytes!("../../schemas/linkwatch.binpb");

/// Package of the messages. Its last part is the version of the format.
pub(super) const PACKAGE: &str = "linkwatch.v1";

/// Conversion between a type of the library and the type `S` of the schema, as which it is
/// recorded.
pub(super) trait Recorded<S>: Sized {
    fn record(&self) -> S;
    fn read(recorded: S) -> Result<Self>;
}

/// Records values as they are.
macro_rules! plain {
    ($($name:ty),*) => {$(
        impl Recorded<$name> for $name {
            fn record(&self) -> $name {
                self.clone()
            }
            fn read(recorded: $name) -> Result<$name> {
                Ok(recorded)
            }
        }
    )*};
}

plain!(bool, i32, i64, u32, u64, f64, String);

impl<S, T: Recorded<S>> Recorded<Vec<S>> for Vec<T> {
    fn record(&self) -> Vec<S> {
        self.iter().map(T::record).collect()
    }
    fn read(recorded: Vec<S>) -> Result<Self> {
        recorded.into_iter().map(T::read).collect()
    }
}

impl<S, T: Recorded<S>> Recorded<Option<S>> for Option<T> {
    fn record(&self) -> Option<S> {
        self.as_ref().map(T::record)
    }
    fn read(recorded: Option<S>) -> Result<Self> {
        recorded.map(T::read).transpose()
    }
}

/// Records enumerations by a code: the index of a value, from 1. Code 0 is the value that protobuf
/// reads for a missing field.
macro_rules! codes {
    ($($name:ident $all:expr, $what:literal;)*) => {$(
        impl Recorded<i32> for $name {
            fn record(&self) -> i32 {
                $all.iter().position(|v| v == self).map_or(0, |k| k as i32 + 1)
            }
            fn read(code: i32) -> Result<$name> {
                let index = usize::try_from(code).ok().and_then(|c| c.checked_sub(1));
                index.and_then(|k| $all.get(k).copied()).ok_or_else(|| {
                    invalid($what, format_args!("code {code}, expected 1 to {}", $all.len()))
                })
            }
        }
    )*};
}

const PRECISIONS: [Precision; 2] = [Precision::F32, Precision::F64];

codes! {
    Basis Basis::ALL, "basis of a frame";
    Precision PRECISIONS, "precision of a frame";
    Verdict Verdict::ALL, "verdict of a report";
    DefectKind DefectKind::ALL, "kind of a defect";
    Route Route::ALL, "route of a frame";
}

/// Nanoseconds, at most the largest number.
impl Recorded<u64> for Duration {
    fn record(&self) -> u64 {
        self.as_nanos().try_into().unwrap_or(u64::MAX)
    }
    fn read(nanoseconds: u64) -> Result<Duration> {
        Ok(Duration::from_nanos(nanoseconds))
    }
}

/// A translation: nothing for 0.
impl Recorded<Vec<i32>> for Image {
    fn record(&self) -> Vec<i32> {
        match is_home(self) {
            true => Vec::new(),
            false => self.to_vec(),
        }
    }
    fn read(numbers: Vec<i32>) -> Result<Image> {
        match numbers[..] {
            [] => Ok(Image::default()),
            [n1, n2, n3] => Ok([n1, n2, n3]),
            _ => Err(invalid("image", format!("{} numbers", numbers.len()))),
        }
    }
}

/// A periodic cell: nothing without one.
impl Recorded<Vec<f64>> for Option<Cell> {
    fn record(&self) -> Vec<f64> {
        let numbers = |c: &Cell| [c.vectors.as_flattened(), &c.origin].concat();
        self.as_ref().map(numbers).unwrap_or_default()
    }
    fn read(numbers: Vec<f64>) -> Result<Self> {
        if numbers.is_empty() {
            return Ok(None);
        }
        let (&[a, b, c, origin], []) = numbers.as_chunks::<3>() else {
            return Err(invalid("cell", format!("{} numbers", numbers.len())));
        };
        let vectors = [a, b, c];
        let cell = Cell { origin, vectors };
        cell.check()?;
        Ok(Some(cell))
    }
}

/// A message that every recording has.
impl Recorded<Option<schema::Place>> for Place {
    fn record(&self) -> Option<schema::Place> {
        Some(self.record())
    }
    fn read(place: Option<schema::Place>) -> Result<Place> {
        Place::read(place.ok_or_else(|| invalid("place of a defect", "missing"))?)
    }
}

impl Recorded<String> for Cow<'static, str> {
    fn record(&self) -> String {
        self.to_string()
    }
    fn read(text: String) -> Result<Self> {
        Ok(text.into())
    }
}

/// Missing counters are 0.
impl Recorded<Option<schema::Stats>> for Stats {
    fn record(&self) -> Option<schema::Stats> {
        Some(self.record())
    }
    fn read(stats: Option<schema::Stats>) -> Result<Stats> {
        Stats::read(stats.unwrap_or_default())
    }
}

/// Records structs, field by field. After `;`: fields that are one or several fields with other
/// names in the schema; after `=>`: a field that is not recorded, and its value.
macro_rules! messages {
    ($($name:ident {
        $($field:ident),*
        $(; $($parts:ident = $pattern:tt of [$($part:ident),*]),*)?
        $(=> $missing:ident: $value:expr)?
    })*) => {$(
        impl Recorded<schema::$name> for $name {
            fn record(&self) -> schema::$name {
                $($(let $pattern = &self.$parts;)*)?
                schema::$name {
                    $($($($part: $part.record(),)*)*)?
                    $($field: self.$field.record(),)*
                }
            }
            fn read(recorded: schema::$name) -> Result<$name> {
                $($($(let $part = Recorded::read(recorded.$part)?;)*)*)?
                Ok($name {
                    $($($parts: $pattern,)*)?
                    $($field: Recorded::read(recorded.$field)?,)*
                    $($missing: $value,)?
                })
            }
        }
    )*};
}

messages! {
    LeftOut { count, first; kind = [one, several] of [one, several] }
    Link { i, j, lambda }
    Stats {
        curves, segments, open_curves, repeated_vertices, potential_links, separated, tests,
        crossings, overlaps, refined, exact, unchecked, extent
    }
    Place {
        distance;
        segments = [segment_i, segment_j] of [segment_i, segment_j],
        point = [x, y, z] of [x, y, z]
    }
    Change { i, j, image, expected, found, place }
    InvariantChange { curves, expected, found }
    Defect { i, j, image, kind, place }
    PullThrough {
        i, j, image, fraction, sign, lengths;
        segments = [segment_i, segment_j] of [segment_i, segment_j],
        point = [x, y, z] of [x, y, z]
    }
    Clearance { at_least, closest, low, frames_left }
    CloseStrands {
        i, j, image, ratio, error, distance;
        segments = [segment_i, segment_j] of [segment_i, segment_j],
        points = [[x_i, y_i, z_i], [x_j, y_j, z_j]] of [x_i, y_i, z_i, x_j, y_j, z_j]
    }
    Report {
        seq, time, verdict, abort, changes, events, unresolved, defects, adopted, last_intact,
        safe_fraction, clearance, appeared, gone, missing, left_out, rejected, stats, invariants
        => loops: Vec::new()
    }
    FrameTimes {
        live;
        ingest = ingest_ns of [ingest_ns],
        verification = verification_ns of [verification_ns]
        => stages: Default::default()
    }
    LiveTimes {
        ;
        interval = interval_ns of [interval_ns],
        wait = wait_ns of [wait_ns],
        send = send_ns of [send_ns]
    }
    Work {
        route, blocks, marked, recertified, recomputed, searched, reference_age, disagreed, summed
    }
}

/// The time at which the frame arrived is that of the message.
impl Recorded<schema::Progress> for RunProgress {
    fn record(&self) -> schema::Progress {
        schema::Progress {
            verified: self.verified,
            skipped: self.skipped,
            rejected: self.rejected,
            check_ns: self.times.check().record(),
            work: Some(self.work.record()),
            times: Some(self.times.record()),
            left_out: self.left_out,
            recovered: self.recovered,
            accepted: self.accepted,
        }
    }

    /// Recordings of earlier versions lack the work, and have the sum of the times.
    fn read(p: schema::Progress) -> Result<RunProgress> {
        Ok(RunProgress {
            verified: p.verified,
            skipped: p.skipped,
            rejected: p.rejected,
            times: Option::read(p.times)?.unwrap_or(FrameTimes {
                verification: Duration::from_nanos(p.check_ns),
                ..FrameTimes::default()
            }),
            work: Option::read(p.work)?.unwrap_or_default(),
            received_ns: 0,
            left_out: p.left_out,
            recovered: p.recovered,
            accepted: p.accepted,
        })
    }
}

impl Recorded<schema::Translation> for (u32, Image) {
    fn record(&self) -> schema::Translation {
        let (curve, image) = (self.0, self.1.to_vec());
        schema::Translation { curve, image }
    }
    fn read(translation: schema::Translation) -> Result<Self> {
        Ok((translation.curve, Image::read(translation.image)?))
    }
}

impl Recorded<schema::Baseline> for BaselineRecord {
    fn record(&self) -> schema::Baseline {
        let (b, c) = (self, &self.certificate);
        let image = |l: &ImageLink| schema::ImageLink {
            i: l.i,
            j: l.j,
            image: l.image.record(),
            lambda: Some(l.lambda),
        };
        schema::Baseline {
            curves: c.curves as u64,
            links: c.links.record(),
            undefined: c.undefined.record(),
            origin: b.origin.clone(),
            frame: b.frame,
            unverified: b.unverified,
            periodic: c.images.is_some(),
            images: c.images.iter().flatten().map(image).collect(),
            periods: c.periods.record(),
            invariants: invariant_lines(&c.higher),
        }
    }

    /// Checks the preconditions of comparing certificates: pairs in range and sorted, no number 0.
    fn read(b: schema::Baseline) -> Result<Self> {
        let bad_link = |what: String| Err(invalid("link of the baseline", what));
        let links: Vec<Link> = Recorded::read(b.links)?;
        let bad = |l: &&Link| l.i >= l.j || u64::from(l.j) >= b.curves || l.lambda == 0;
        if let Some(Link { i, j, lambda }) = links.iter().find(bad) {
            return bad_link(format!("{i},{j},{lambda} of {} curves", b.curves));
        }
        let mut pairs = links.array_windows();
        if let Some([_, Link { i, j, .. }]) = pairs.find(|[k, l]| (k.i, k.j) >= (l.i, l.j)) {
            return bad_link(format!("{i},{j} is not sorted after the previous pair"));
        }
        let mut undefined: Vec<Defect> = Recorded::read(b.undefined)?;
        let mut images = Vec::with_capacity(b.images.len());
        for l in b.images {
            let (i, j, image) = (l.i, l.j, Image::read(l.image)?);
            match l.lambda {
                Some(lambda) => images.push(ImageLink {
                    i,
                    j,
                    image,
                    lambda,
                }),
                // Earlier versions recorded pairs without a linking number here.
                None => undefined.push(undefined_entry(i, Some(j), image)),
            }
        }
        Defect::sort(&mut undefined);
        let bad = |d: &&Defect| {
            let j = d.j.unwrap_or(d.i);
            let of_one = d.j.is_some() && (d.i > j || d.i == j && is_home(&d.image));
            of_one || u64::from(j) >= b.curves
        };
        if let Some(d) = undefined.iter().find(bad) {
            let what = format!("{d}, of {} curves", b.curves);
            return Err(invalid("defect of the baseline", what));
        }
        let curves = usize::try_from(b.curves);
        let curves = curves.map_err(|_| invalid("curves of the baseline", b.curves))?;
        let mut higher = Vec::new();
        for line in &b.invariants {
            let parsed = parse_invariant(line, curves, &mut higher);
            let parsed = parsed.unwrap_or_else(|| Err(line.clone()));
            parsed.map_err(|e| invalid("invariants of the baseline", e))?;
        }
        Ok(BaselineRecord {
            certificate: Arc::new(Certificate {
                curves,
                links,
                undefined,
                images: b.periodic.then_some(images),
                periods: Recorded::read(b.periods)?,
                higher,
            }),
            origin: b.origin,
            frame: b.frame,
            unverified: b.unverified,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fmt::Debug;

    /// Asserts that the codes of `all` are those of an enumeration of the schema.
    macro_rules! agree {
        ($enumeration:ident, $all:expr) => {
            let name = |code| schema::$enumeration::try_from(code).map(|v| v.as_str_name());
            compare(stringify!($enumeration), &$all, |code| name(code).ok());
        };
    }

    /// The name of an enumeration precedes those of its values.
    fn compare<T: Debug + Recorded<i32>>(
        enumeration: &str,
        all: &[T],
        name: impl Fn(i32) -> Option<&'static str>,
    ) {
        for value in all {
            let found = name(value.record()).unwrap_or_default();
            let expected = format!("{enumeration}{value:?}").to_lowercase();
            assert_eq!(found.replace('_', "").to_lowercase(), expected);
        }
        assert_eq!(name(all.len() as i32 + 1), None, "{enumeration}");
    }

    #[test]
    fn the_codes_equal_the_schema() {
        agree!(Basis, Basis::ALL);
        agree!(Precision, PRECISIONS);
        agree!(VerdictCode, Verdict::ALL);
        agree!(Route, Route::ALL);
        agree!(DefectKind, DefectKind::ALL);
    }
}
