//! Lines of a certificate file with the invariants of curves and of triples.
//!
//! ```text
//! 39 # lines: 5
//! 5,6,-2
//! invariants 1 self
//! self 5 1 -1 3
//! invariants 1 triple
//! triple 0 1 2 1 0
//! ```
//!
//! A line `invariants` has the version of this extension, and a kind that was computed. It is
//! before the other lines of its kind. A line `self i v2 v3 determinant` has the invariants of
//! curve `i`, with `-` for a number that was not computed; curves without a line have those of the
//! unknot. A line `triple i j k mu modulus` has a triple linking number, with `i < j < k`; triples
//! without a line have 0. `self i undefined` and `triple i undefined` stand for a curve whose
//! invariants, or triples, are not known.
//!
//! The lines have no commas, so that verifycurves skips them.

use super::file::UNDEFINED;
use crate::diagram::{HigherInvariants, InvariantKind, UNCOMPUTED};
use std::collections::BTreeSet;

/// Start of the lines that name the kinds, with the version.
const HEADER: [&str; 2] = ["invariants", "1"];

/// Returns the lines.
pub(crate) fn invariant_lines(all: &[HigherInvariants]) -> Vec<String> {
    let mut lines = Vec::new();
    for found in all {
        let kind = found.kind;
        lines.push(format!("{} {kind}", HEADER.join(" ")));
        lines.extend(found.numbers.iter().map(|(curves, numbers)| {
            let curves: Vec<String> = curves.iter().map(u32::to_string).collect();
            format!("{kind} {} {}", curves.join(" "), numbers.join(" "))
        }));
        let unknown = found.unknown.iter();
        lines.extend(unknown.map(|i| format!("{kind} {i} {UNDEFINED}")));
    }
    lines
}

/// Parses a line, and adds its invariants to `to`. `curves` is the number of curves of the
/// certificate. Returns `None` for a line of another kind, and an error text for a malformed
/// one.
pub(crate) fn parse_invariant(
    line: &str,
    curves: usize,
    to: &mut Vec<HigherInvariants>,
) -> Option<Result<(), String>> {
    let fields: Vec<&str> = line.split_whitespace().collect();
    let (first, rest) = fields.split_first()?;
    if *first == HEADER[0] {
        let kind = match rest {
            [version, kind] if *version == HEADER[1] => kind.parse::<InvariantKind>().ok(),
            _ => None,
        };
        let kind = kind.filter(|kind| to.iter().all(|other| other.kind != *kind));
        let expected = "expected `invariants 1 self` or `invariants 1 triple`, once each";
        return Some(kind.ok_or_else(|| expected.into()).map(|kind| {
            to.push(HigherInvariants {
                kind,
                numbers: Vec::new(),
                unknown: BTreeSet::new(),
            });
        }));
    }
    let kind: InvariantKind = first.parse().ok()?;
    let found = to.iter_mut().find(|found| found.kind == kind);
    let added = found.and_then(|found| add(found, rest, curves));
    let expected = match kind {
        InvariantKind::Curve => {
            "expected `invariants 1 self`, then `self i v2 v3 determinant`, once for each curve"
        }
        InvariantKind::Triple => {
            "expected `invariants 1 triple`, then `triple i j k mu modulus`, once for each triple"
        }
    };
    Some(added.ok_or_else(|| expected.into()))
}

/// Adds a line of one kind, or returns `None` if it is malformed.
fn add(to: &mut HigherInvariants, fields: &[&str], curves: usize) -> Option<()> {
    let curve = |text: &&str| text.parse().ok().filter(|&i: &u32| (i as usize) < curves);
    if let [i, UNDEFINED] = fields {
        return to.unknown.insert(curve(i)?).then_some(());
    }
    let (of, count) = match to.kind {
        InvariantKind::Curve => (1, 4),
        InvariantKind::Triple => (3, 5),
    };
    let (names, numbers) = fields
        .split_at_checked(of)
        .filter(|_| fields.len() == count)?;
    let names: Vec<u32> = names.iter().map(curve).collect::<Option<_>>()?;
    let is_number = |n: &&str| {
        let digits = n.strip_prefix('-').unwrap_or(n);
        *n == UNCOMPUTED || !digits.is_empty() && digits.bytes().all(|b| b.is_ascii_digit())
    };
    if !names.array_windows().all(|[a, b]| a < b) || !numbers.iter().all(is_number) {
        return None;
    }
    let at = to.numbers.partition_point(|(other, _)| *other < names);
    if to.numbers.get(at).is_some_and(|(other, _)| *other == names) {
        return None;
    }
    let numbers = numbers.iter().map(|&n| n.to_owned()).collect();
    to.numbers.insert(at, (names, numbers));
    Some(())
}

#[cfg(test)]
mod tests {
    use crate::certificate::Certificate;

    #[test]
    fn invariants_round_trip() {
        let text = "9 # lines: 8\n0,1,-2\ninvariants 1 self\nself 2 1 -1 3\n\
                    self 3 7 - 12345678901234567890123\nself 4 undefined\n\
                    invariants 1 triple\ntriple 0 1 2 -1 0\ntriple 5 undefined\n";
        let certificate = Certificate::parse(text).unwrap();
        assert_eq!(certificate.to_string(), text);
        assert_eq!(certificate.invariants().count(), 2);
        let plain = Certificate::parse("9\n0,1,-2\n").unwrap();
        assert_eq!(plain.invariants().count(), 0);
        assert!(certificate.compare(&plain).unwrap().changes.is_empty());
    }

    #[test]
    fn malformed_invariants_are_refused() {
        for (text, says) in [
            ("3\ninvariants 2 self\n", "expected `invariants 1"),
            ("3\ninvariants 1 other\n", "expected `invariants 1"),
            ("3\nself 0 1 1 3\n", "expected `invariants 1"),
            ("3\ninvariants 1 self\ninvariants 1 self\n", "once"),
            ("3\ninvariants 1 self\nself 3 1 1 3\n", "line 3"),
            ("3\ninvariants 1 self\nself 0 1 1 x\n", "line 3"),
            ("3\ninvariants 1 triple\ntriple 0 2 1 1 0\n", "line 3"),
            (
                "3\ninvariants 1 self\nself 0 1 1 3\nself 0 0 0 1\n",
                "once for",
            ),
        ] {
            let e = Certificate::parse(text).unwrap_err().to_string();
            assert!(e.contains(says), "{text:?}: {e}");
        }
    }
}
