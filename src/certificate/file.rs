//! Text format of a certificate, as defined by verifycurves (Qu & James 2021): the number of curves
//! on the first line, then `i,j,lambda` for every nonzero pair, 0-based, sorted.
//!
//! ```text
//! 39 # lines: 2
//! 5,6,-2
//! 7,9,1
//! ```
//!
//! A pair without a linking number, because its curves touch or are too close to decide, is listed
//! as `i,j,undefined`; `i,,undefined` stands for all pairs of a degenerate curve `i`. (verifycurves
//! has no such pairs; it reads these as 0.)
//!
//! The comment states the number of lines after the first one. Without it, a file that was
//! truncated at the end of a line would be a valid certificate with fewer links. It is on the first
//! line, because other readers most likely ignore it there: verifycurves reads the number with
//! `atoi`, and table readers skip the first line. Files without the comment are accepted.
//!
//! # Periodic scenes
//!
//! ```text
//! periodic 39 # lines: 3
//! 5,6,0,0,0,-2
//! 7,7,1,0,0,1
//! 7,9,0,-1,0,1
//! ```
//!
//! The first word is `periodic`, which readers of the plain form refuse. An entry `i,j,n1,n2,n3,
//! lambda` is the linking number of curve `i` and of curve `j` translated by `n1`, `n2` and `n3`
//! times the lattice vectors. `i <= j`; if both are equal, the translation is positive in
//! lexicographic order. `undefined` stands for a number, and `i,,undefined` for a curve, as in the
//! plain form.
//!
//! `i,,n1,n2,n3,period` states that curve `i` is a yarn that runs through the cell: it ends at the
//! image of its start by this translation. The translations of entries with it count up to
//! multiples of that.
//!
//! The translations are those of [`canonical`] names, which depend on the topology alone. So the
//! text does not depend on the images by which the curves are given.
//!
//! More lines have invariants of curves and of triples: see [`higher`].

use super::{Certificate, higher, is_near};
use crate::curve::{Image, is_home};
use crate::error::{Error, Result};
use crate::periodic::{ImagePair, YarnPeriod, canonical};
use crate::verdict::{Defect, DefectKind, Place};
use std::fmt;
use std::path::Path;

/// The entry of a pair without a linking number.
pub(super) const UNDEFINED: &str = "undefined";

/// Last word of the line of a yarn.
const PERIOD: &str = "period";

/// First word of the certificate of a periodic scene.
const PERIODIC: &str = "periodic";

impl fmt::Display for Certificate {
    /// Writes the text of the file. Pairs without a linking number are listed as `i,j,undefined`,
    /// or `i,,undefined` for all pairs of a curve. If they were omitted, they would read as 0.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let higher = higher::invariant_lines(&self.higher);
        let Some(entries) = self.entries() else {
            let lines = self.links.len() + self.undefined.len() + higher.len();
            writeln!(f, "{} {}", self.curves, line_count(lines))?;
            for l in &self.links {
                writeln!(f, "{},{},{}", l.i, l.j, l.lambda)?;
            }
            for d in &self.undefined {
                let j = d.j.map_or(String::new(), |j| j.to_string());
                writeln!(f, "{},{j},{UNDEFINED}", d.i)?;
            }
            return higher.iter().try_for_each(|line| writeln!(f, "{line}"));
        };
        let curves = self.undefined.iter().filter(|d| d.j.is_none());
        let lines = entries.len() + curves.clone().count() + self.periods.len() + higher.len();
        let lines = line_count(lines);
        writeln!(f, "{PERIODIC} {} {lines}", self.curves)?;
        for (i, [n1, n2, n3]) in &self.periods {
            writeln!(f, "{i},,{n1},{n2},{n3},{PERIOD}")?;
        }
        let entries = canonical(self.curves, &entries, &self.periods);
        for (ImagePair { i, j, image }, lambda) in entries {
            let [n1, n2, n3] = image;
            let lambda = lambda.map_or(UNDEFINED.to_owned(), |lambda| lambda.to_string());
            writeln!(f, "{i},{j},{n1},{n2},{n3},{lambda}")?;
        }
        for d in curves {
            writeln!(f, "{},,{UNDEFINED}", d.i)?;
        }
        higher.iter().try_for_each(|line| writeln!(f, "{line}"))
    }
}

impl Certificate {
    /// Parses the text of a certificate. Lines may be in any order. If the first line states their
    /// number, it must match.
    ///
    /// The text does not contain the reason or the place of an undefined pair. Parsed pairs have
    /// the kind [`DefectKind::TooClose`], curves have [`DefectKind::Degenerate`], and the place is
    /// the origin.
    ///
    /// # Errors
    ///
    /// [`Error::Format`] with the line that is invalid.
    pub fn parse(text: &str) -> Result<Certificate> {
        // Some editors of Windows write a byte order mark.
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let bad = |line: usize, what: String| {
            Error::format("certificate", format_args!("line {}", line + 1), what)
        };
        let lines = text.lines().enumerate();
        let mut lines = lines.filter(|(_, line)| !line.trim().is_empty());
        let empty = || bad(0, "empty; expected the number of curves".into());
        let (at, first) = lines.next().ok_or_else(empty)?;
        let after = first.trim_start().strip_prefix(PERIODIC);
        let after = after.filter(|rest| rest.starts_with(char::is_whitespace));
        let (periodic, first) = (after.is_some(), after.unwrap_or(first));
        let (number, comment) = match first.split_once('#') {
            Some((number, _)) => (number, Some(&first[number.len()..])),
            None => (first, None),
        };
        let Ok(curves) = number.trim().parse::<u32>() else {
            let what = format!("'{}', expected the number of curves", clip(first));
            return Err(bad(at, what));
        };
        let curves = curves as usize;
        let expected = match periodic {
            true => "expected i,j,n1,n2,n3,lambda or i,j,n1,n2,n3,undefined or i,,n1,n2,n3,period",
            false => "expected i,j,lambda or i,j,undefined",
        };
        let (mut entries, mut singles, mut periods) = (Vec::new(), Vec::new(), Vec::new());
        let mut found = 0;
        let mut invariants = Vec::new();
        for (at, line) in lines {
            found += 1;
            match higher::parse_invariant(line, curves, &mut invariants) {
                Some(Ok(())) => continue,
                Some(Err(what)) => return Err(bad(at, format!("'{}', {what}", clip(line)))),
                None => {}
            }
            let parsed = Line::parse(line, periodic);
            let parsed = parsed.ok_or_else(|| bad(at, format!("'{}', {expected}", clip(line))));
            match parsed? {
                Line::Pair(pair, lambda) => {
                    let ImagePair { i, j, image } = pair;
                    let valid = i < j || i == j && image > Image::default();
                    if !valid || j as usize >= curves {
                        let or = match periodic {
                            true => ", or i = j and a positive translation",
                            false => "",
                        };
                        let expected = format!("expected i < j < {curves}{or}");
                        let what = format!("pair {i},{j} of {curves} curves; {expected}");
                        return Err(bad(at, what));
                    }
                    entries.push((pair, lambda));
                }
                Line::Single(i) if i as usize >= curves => {
                    return Err(bad(at, format!("curve {i} of {curves} curves")));
                }
                Line::Single(i) => singles.push(i),
                Line::Period((i, period)) => {
                    if i as usize >= curves || period == Image::default() {
                        let what = format!("period {period:?} of curve {i} of {curves} curves");
                        return Err(bad(at, what));
                    }
                    periods.push((i, period));
                }
            }
        }
        // The last line may be truncated within its number.
        let whole =
            comment.is_none_or(|c| text.ends_with('\n') && c.trim_end() == line_count(found));
        if !whole {
            let what = format!(
                "'{}', found {found}: the file was cut or edited (remove the comment to read it \
                 anyway)",
                clip(first)
            );
            return Err(bad(at, what));
        }
        entries.sort_unstable();
        singles.sort_unstable();
        periods.sort_unstable();
        let pair = entries.array_windows().find(|[a, b]| a.0 == b.0);
        let pair = pair.map(|[(ImagePair { i, j, image }, _), _]| match is_home(image) {
            true => format!("pair {i},{j}"),
            false => format!("pair {i},{j} {image:?}"),
        });
        let single = singles.array_windows().find(|[a, b]| a == b);
        let period = periods.array_windows().find(|[a, b]| a.0 == b.0);
        let twice = pair
            .or(single.map(|[i, _]| format!("pair {i},")))
            .or(period.map(|[(i, _), _]| format!("the period of curve {i}")));
        if let Some(twice) = twice {
            return Err(bad_file(format_args!("{twice} is listed twice")));
        }
        entries.retain(|e| e.1 != Some(0));
        let singles = singles.into_iter();
        let undefined = singles.map(|i| undefined_entry(i, None, Image::default()));
        let certificate = Certificate {
            curves,
            undefined: undefined.collect(),
            periods,
            ..Certificate::default()
        };
        let mut certificate = certificate.with_entries(&entries, &[]);
        certificate.images.take_if(|_| !periodic);
        certificate.higher = invariants;
        Ok(certificate)
    }

    /// Reads a certificate file.
    ///
    /// # Errors
    ///
    /// [`Error::File`] if the file cannot be read. [`Error::Format`] (within [`Error::InFile`]) if
    /// it is not a certificate but a model, for example.
    pub fn read(path: &Path) -> Result<Certificate> {
        let bytes = std::fs::read(path).map_err(Error::file(path))?;
        let text = String::from_utf8(bytes).map_err(|_| bad_file("binary data, expected text"));
        let parsed = text.and_then(|text| Self::parse(&text));
        let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
        let parsed = parsed.map_err(|e| match extension.to_str() {
            Some("bcc" | "obj" | "vect") => bad_file(format_args!(
                "a model, not a certificate; `linkwatch certify {} -o CERT` writes one for it",
                path.display()
            )),
            _ => e,
        });
        parsed.map_err(|e| e.in_file(path))
    }

    /// Writes a certificate file, with `i,j,undefined` for pairs without a linking number.
    ///
    /// # Errors
    ///
    /// [`Error::File`].
    pub fn write(&self, path: &Path) -> Result<()> {
        std::fs::write(path, self.to_string()).map_err(Error::file(path))
    }
}

/// A line after the first one.
enum Line {
    /// A pair, and its linking number, or `None` if it is undefined.
    Pair(ImagePair, Option<i64>),
    /// A curve whose linking number with every other curve is undefined.
    Single(u32),
    /// A yarn.
    Period(YarnPeriod),
}

impl Line {
    /// Parses a line, or returns `None` if it is malformed, or a translation is too large.
    fn parse(line: &str, periodic: bool) -> Option<Line> {
        let fields: Vec<&str> = line.split(',').map(str::trim).collect();
        let index = |text: &str| text.parse().ok();
        let translation = |[a, b, c]: [&str; 3]| {
            let image = [a.parse().ok()?, b.parse().ok()?, c.parse().ok()?];
            is_near(image).then_some(image)
        };
        let (i, j, image, lambda) = match (periodic, &fields[..]) {
            (_, &[i, "", UNDEFINED]) => return Some(Line::Single(index(i)?)),
            (true, &[i, "", n1, n2, n3, PERIOD]) => {
                return Some(Line::Period((index(i)?, translation([n1, n2, n3])?)));
            }
            (true, &[i, j, n1, n2, n3, lambda]) => (i, j, translation([n1, n2, n3])?, lambda),
            (false, &[i, j, lambda]) => (i, j, Image::default(), lambda),
            _ => return None,
        };
        let lambda = match lambda {
            UNDEFINED => None,
            number => Some(number.parse().ok()?),
        };
        let (i, j) = (index(i)?, index(j)?);
        Some(Line::Pair(ImagePair { i, j, image }, lambda))
    }
}

/// Returns a defect of a pair, or of all pairs of a curve, for an unknown reason.
pub(crate) fn undefined_entry(i: u32, j: Option<u32>, image: Image) -> Defect {
    let kind = match j {
        Some(_) => DefectKind::TooClose,
        None => DefectKind::Degenerate,
    };
    Defect {
        i,
        j,
        image,
        kind,
        place: Place::default(),
    }
}

/// Returns an error of the whole file.
fn bad_file(what: impl fmt::Display) -> Error {
    Error::format("certificate", "whole file", what)
}

/// Returns the comment of the first line.
fn line_count(lines: usize) -> String {
    format!("# lines: {lines}")
}

/// Returns the start of a line of the file, short enough for a message.
fn clip(s: &str) -> String {
    s.chars().take(40).flat_map(char::escape_debug).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_round_trips() {
        let text = "39 # lines: 2\n5,6,-2\n7,9,1\n";
        let c = Certificate::parse(text).unwrap();
        assert_eq!(c.curves, 39);
        assert_eq!(c.to_string(), text);
        // Files written by verifycurves and by earlier versions of linkwatch.
        for plain in [
            "39\n5,6,-2\n7,9,1\n",
            "39\n 7, 9, 1\n5,6,-2\n1,2,0",
            "\u{feff}39\n5,6,-2\n7,9,1\n",
        ] {
            assert_eq!(Certificate::parse(plain).unwrap(), c);
        }
        assert!(Certificate::parse("periodic9").is_err());
        let empty = Certificate::parse("70").unwrap();
        assert_eq!(empty.to_string(), "70 # lines: 0\n");
        assert_eq!(Certificate::parse(&empty.to_string()).unwrap(), empty);
    }

    #[test]
    fn pairs_without_a_linking_number_round_trip() {
        let text = "9 # lines: 4\n0,1,-2\n2,3,undefined\n2,8,undefined\n4,,undefined\n";
        let c = Certificate::parse(text).unwrap();
        assert_eq!(c.links.len(), 1);
        let keys: Vec<_> = c.undefined.iter().map(|d| (d.i, d.j)).collect();
        assert_eq!(keys, [(2, Some(3)), (2, Some(8)), (4, None)]);
        assert_eq!(c.to_string(), text);
        let shuffled = "9\n4,,undefined\n 2, 8, undefined\n0,1,-2\n2,3,undefined\n";
        assert_eq!(Certificate::parse(shuffled).unwrap(), c);
    }

    #[test]
    fn certificates_of_periodic_scenes_round_trip() {
        let text = "periodic 9 # lines: 5\n0,1,0,0,0,-2\n2,2,0,0,1,1\n2,3,0,0,0,1\n\
                    2,3,0,1,0,undefined\n4,,undefined\n";
        let c = Certificate::parse(text).unwrap();
        assert_eq!(c.to_string(), text);
        assert_eq!((c.links.len(), c.undefined.len()), (2, 2));
        assert_eq!(c.images.as_ref().unwrap().len(), 1);
        let empty = Certificate::parse("periodic 70").unwrap();
        assert_eq!(empty.to_string(), "periodic 70 # lines: 0\n");
        assert_eq!(Certificate::parse(&empty.to_string()).unwrap(), empty);
        for (text, says) in [
            ("periodic 3\n0,1,1\n", "expected i,j,n1,n2,n3,lambda"),
            ("periodic 3\n0,0,0,0,-1,1\n", "a positive translation"),
            ("periodic 3\n0,3,0,0,0,1\n", "of 3 curves"),
            ("periodic 3\n0,1,0,0,0,1\n0,1,0,0,0,2\n", "listed twice"),
            ("periodic 3 # lines: 2\n0,1,0,0,0,1\n", "found 1"),
            ("periodic\n", "number of curves"),
        ] {
            let e = Certificate::parse(text).unwrap_err().to_string();
            assert!(e.contains(says), "{text:?}: {e}");
        }
    }

    #[test]
    fn rejects_a_truncated_certificate() {
        for text in ["39 # lines: 2\n5,6,-2\n7,9,12\n", "70 # lines: 0\n"] {
            // The number of curves by itself is a complete file of an earlier version.
            for end in 3..text.len() {
                let cut = &text[..end];
                let e = Certificate::parse(cut)
                    .map(|_| ())
                    .map_err(|e| e.to_string());
                match cut.trim_end().len() {
                    2 => assert_eq!(e, Ok(())),
                    _ => assert!(e.is_err(), "{cut:?}"),
                }
            }
        }
        let cut = Certificate::parse("39 # lines: 2\n5,6,-2\n");
        let e = cut.unwrap_err().to_string();
        assert!(
            e.contains("'39 # lines: 2', found 1: the file was cut"),
            "{e}"
        );
    }

    /// The algorithm of the published tool: it reads numbers with `atoi` and skips lines with fewer
    /// than three fields.
    #[test]
    fn verifycurves_can_read_the_file() {
        fn atoi(text: &str) -> i64 {
            let end = text
                .char_indices()
                .skip(1)
                .find(|(_, c)| !c.is_ascii_digit());
            text[..end.map_or(text.len(), |(at, _)| at)]
                .parse()
                .unwrap_or(0)
        }
        let text = Certificate::parse("39\n5,6,-2\n7,9,1\n")
            .unwrap()
            .to_string();
        let mut lines = text.lines();
        assert_eq!(lines.next().map(atoi), Some(39));
        let read: Vec<Vec<i64>> = lines.map(|l| l.split(',').map(atoi).collect()).collect();
        assert_eq!(read, [[5, 6, -2], [7, 9, 1]]);
    }

    #[test]
    fn errors_name_the_line() {
        for (text, says) in [
            ("", "line 1"),
            ("x\n", "number of curves"),
            ("-1\n", "number of curves"),
            ("3\n1,2\n", "line 2"),
            ("3\n1,2,3,4\n", "line 2"),
            ("3\n\n2,1,1\n", "line 3"),
            ("3\n0,3,1\n", "i < j < 3"),
            ("3\n0,1,1\n0,1,2\n", "listed twice"),
            ("3\n0,1,99999999999999999999\n", "line 2"),
            ("3\n0,1,1,\n", "line 2"),
            ("3\n0,1,unknown\n", "i,j,undefined"),
            ("3\n0,,1\n", "line 2"),
            ("3\n3,,undefined\n", "curve 3 of 3 curves"),
            ("3\n1,0,undefined\n", "i < j < 3"),
            ("3\n0,1,1\n0,1,undefined\n", "pair 0,1 is listed twice"),
            ("3\n2,,undefined\n2,,undefined\n", "pair 2, is listed twice"),
            ("3 # some rings\n0,1,1\n", "line 1"),
            ("3 # lines: 1\n0,1,1\n1,2,1\n", "found 2"),
        ] {
            let e = Certificate::parse(text).unwrap_err().to_string();
            assert!(e.contains(says), "{text:?}: {e}");
        }
    }
}
