//! Geomview VECT files, read as polylines in double precision.
//!
//! Words are separated by white space; `#` starts a comment to the end of the line. The words are:
//! `VECT`, the numbers of polylines, vertices and colours, the number of vertices of each polyline
//! (negative if closed), the number of colours of each, the vertices `x y z`, the colours `r g b
//! a`, and nothing more. Colours are checked to be numbers, and discarded.

use super::lines::{Lines, integer};
use super::write::{check_polylines, create};
use super::{Input, number, quote};
use crate::curve::{Basis, CurveSet, Positions};
use crate::error::{Error, Result};
use std::fmt::{Arguments, Display};
use std::ops::Range;
use std::path::Path;
use std::str::FromStr;

const FORMAT: &str = "VECT";

/// Reads a file.
pub(super) fn read(input: Input<'_>) -> Result<CurveSet> {
    let mut words = Words {
        lines: Lines::new(FORMAT, input)?.with_long_lines(),
        word: 0..0,
    };
    if words.next(format_args!("the word VECT"))? != b"VECT" {
        return Err(words.unexpected("VECT"));
    }
    if words.next(format_args!("the number of polylines"))? == b"BINARY" {
        let what = "binary files; only text files are supported";
        return Err(Error::unsupported(FORMAT, what));
    }
    let polylines: u64 = words.parse("the number of polylines")?;
    let vertices: u64 = words.integer(format_args!("the number of vertices"))?;
    let colours: u64 = words.integer(format_args!("the number of colours"))?;
    // Each number takes at least a digit and, except for the last, a space.
    let numbers = 2 * u128::from(polylines) + 3 * u128::from(vertices) + 4 * u128::from(colours);
    let left = words.lines.left + (words.lines.line.len() - words.word.end) as u64;
    if 2 * numbers > u128::from(left) + 1 {
        return Err(words.lines.bad(format_args!(
            "{polylines} polylines, {vertices} vertices and {colours} colours \
             take {numbers} numbers, too many for {left} bytes"
        )));
    }

    let mut counts: Vec<i32> = Vec::with_capacity(polylines as usize);
    let mut sum = 0;
    for k in 0..polylines {
        let count: i32 = words.integer(format_args!("the vertices of polyline {k}"))?;
        sum += u64::from(count.unsigned_abs());
        // The layout on the bus cannot represent the negative of the smallest integer.
        if count == i32::MIN || sum > vertices {
            return Err(words.lines.bad(format_args!(
                "{sum} vertices up to polyline {k}, but {vertices} promised"
            )));
        }
        counts.push(count);
    }
    words.expect_sum("vertices", sum, vertices)?;
    let mut sum = 0;
    for k in 0..polylines {
        sum += u64::from(words.integer::<u32>(format_args!("the colours of polyline {k}"))?);
    }
    words.expect_sum("colours", sum, colours)?;

    let mut xyz = Vec::with_capacity(3 * vertices as usize);
    for (i, &count) in counts.iter().enumerate() {
        for k in 0..count.unsigned_abs() {
            for axis in ['x', 'y', 'z'] {
                xyz.push(words.number(format_args!("{axis} of vertex {k} of polyline {i}"))?);
            }
        }
    }
    for k in 0..4 * colours {
        words.number(format_args!("colour {}", k / 4))?;
    }
    if words.advance()? {
        return Err(words.unexpected("the end"));
    }
    CurveSet::from_counts(Basis::Polyline, &counts, Positions::F64(&xyz))
}

/// Writes polylines, without colours.
///
/// # Errors
///
/// Splines.
pub(super) fn write(path: &Path, set: &CurveSet) -> Result<()> {
    check_polylines(FORMAT, set)?;
    create(path, |out| {
        writeln!(out, "VECT\n{} {} 0", set.len(), set.points())?;
        for count in set.counts() {
            writeln!(out, "{count}")?;
        }
        for _ in 0..set.len() {
            writeln!(out, "0")?;
        }
        for [x, y, z] in (0..set.len()).flat_map(|i| set.points_in(i)) {
            writeln!(out, "{x:?} {y:?} {z:?}")?;
        }
        Ok(())
    })
}

/// Words of a file, one at a time.
struct Words<'a> {
    lines: Lines<'a>,
    /// Word in the current line.
    word: Range<usize>,
}

impl Words<'_> {
    fn word(&self) -> &[u8] {
        &self.lines.line[self.word.clone()]
    }

    /// Steps to the next word; false at the end of the file.
    fn advance(&mut self) -> Result<bool> {
        loop {
            let rest = &self.lines.line[self.word.end..];
            let text = rest.trim_ascii_start();
            let between = |b: &u8| b.is_ascii_whitespace() || *b == b'#';
            let len = text.iter().position(between).unwrap_or(text.len());
            if len > 0 {
                let start = self.word.end + rest.len() - text.len();
                self.word = start..start + len;
                return Ok(true);
            }
            // The rest is a comment, or nothing.
            self.word = 0..0;
            if !self.lines.advance()? {
                return Ok(false);
            }
        }
    }

    fn next(&mut self, expected: Arguments<'_>) -> Result<&[u8]> {
        match self.advance()? {
            true => Ok(self.word()),
            false => Err((self.lines).bad(format_args!("the file ends, expected {expected}"))),
        }
    }

    /// Creates an error that quotes the word.
    fn unexpected(&self, expected: &str) -> Error {
        let word = quote(self.word());
        self.lines.bad(format_args!("{word}, expected {expected}"))
    }

    /// Parses the word as an integer.
    fn parse<T: FromStr>(&self, expected: impl Display) -> Result<T> {
        integer(self.word(), expected).map_err(|what| self.lines.bad(what))
    }

    fn integer<T: FromStr>(&mut self, expected: Arguments<'_>) -> Result<T> {
        self.next(expected)?;
        self.parse(expected)
    }

    fn number(&mut self, expected: Arguments<'_>) -> Result<f64> {
        self.next(expected)?;
        number(self.word()).map_err(|what| self.lines.bad(format_args!("{expected}: {what}")))
    }

    fn expect_sum(&self, what: &str, sum: u64, promised: u64) -> Result<()> {
        if sum == promised {
            return Ok(());
        }
        Err(self.lines.bad(format_args!(
            "the polylines have {sum} {what}, but {promised} promised"
        )))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::Precision;
    use crate::formats::tests::{assert_error_contains, curves};
    use proptest::prelude::*;

    fn parse(text: &str) -> Result<CurveSet> {
        read(text.as_bytes().into())
    }

    #[test]
    fn reads_open_and_closed_polylines() {
        let text = "VECT\n2 5 1\n-3 2\n1 0\n0 0 0  1 0 0\n0.1 1e0 -0\n5 5 5 6 6 6\n1 0 0 1\n";
        let set = parse(text).unwrap();
        assert_eq!(set.basis(), Basis::Polyline);
        assert_eq!(set.precision(), Precision::F64);
        assert_eq!(
            curves(&set),
            [
                (true, vec![[0.; 3], [1., 0., 0.], [0.1, 1., 0.]]),
                (false, vec![[5.; 3], [6.; 3]]),
            ]
        );
        assert!(parse("VECT 0 0 0").unwrap().is_empty());
    }

    #[test]
    fn ignores_white_space_and_comments() {
        let text = "# a comment 7\n VECT#no space\r\n1\t2 # VECT\n0 2\n0 1 2 3 # 9\n# 9\n4 5 6";
        let set = parse(text).unwrap();
        assert_eq!(curves(&set), [(false, vec![[1., 2., 3.], [4., 5., 6.]])]);
    }

    #[test]
    fn reads_long_polylines() {
        let n = 2049;
        let vertices: String = (0..n).map(|k| format!("{k} 0.5 -{k}\n")).collect();
        let set = parse(&format!("VECT 1 {n} 0 -{n} 0 {vertices}")).unwrap();
        assert_eq!(set.points(), n);
        assert_eq!(set.point(0, n - 1), [2048.0, 0.5, -2048.0]);
    }

    #[test]
    fn errors_name_the_line() {
        let two = "VECT\n1 2 0\n2\n0\n0 0 0\n";
        for (text, expected) in [
            (
                String::new(),
                "line 1): the file ends, expected the word VECT",
            ),
            ("OFF 1".into(), "'OFF', expected VECT"),
            ("VECT BINARY 1 2".into(), "unsupported VECT: binary"),
            (
                "VECT\n-1 0 0".into(),
                "line 2): '-1', expected the number of polylines",
            ),
            (
                "VECT\n1 2.5 0".into(),
                "'2.5', expected the number of vertices",
            ),
            ("VECT\n1 2".into(), "expected the number of colours"),
            (
                "VECT 1 99999999999999999999 0".into(),
                "the number of vertices",
            ),
            (
                format!("{two}1 1 x"),
                "line 6): z of vertex 1 of polyline 0: 'x'",
            ),
            (format!("{two}1 nan 1"), "'nan' is not a finite number"),
            (format!("{two}1 -inf 1"), "'-inf' is not a finite number"),
            (format!("{two}1 1e999 1"), "'1e999' is not a finite number"),
            (format!("{two}1 1 1\n\n7"), "line 8): '7', expected the end"),
            (
                format!("{two}1 1{}", " ".repeat(9)),
                "the file ends, expected z",
            ),
            (
                "VECT 1 2 0 3 0 0 0 0 1 1 1".into(),
                "3 vertices up to polyline 0",
            ),
            (
                "VECT 1 2 0 1 0 0 0 0 1 1 1".into(),
                "1 vertices, but 2 promised",
            ),
            (
                "VECT 1 2 0 2 1 0 0 0 1 1 1".into(),
                "1 colours, but 0 promised",
            ),
            (
                "VECT 1 2 0 2 -1 0 0 0 1 1 1".into(),
                "'-1', expected the colours",
            ),
            ("VECT 1 1 0 1 0 0 0 0".into(), "curve 0: 1 control points"),
            (
                "VECT 2 2 0 2 0 0 0 0 0 0 1 1 1".into(),
                "curve 1: 0 control points",
            ),
            (
                format!("VECT {}", "1".repeat(5000)),
                "expected the number of polylines",
            ),
        ] {
            assert_error_contains(parse(&text), expected);
        }
    }

    #[test]
    fn rejects_wrong_counts_before_allocating() {
        let huge = [1 << 30, 1 << 40, u64::MAX];
        for n in huge {
            assert_error_contains(parse(&format!("VECT {n} 0 0 1 1")), "too many for 4 bytes");
            assert_error_contains(parse(&format!("VECT 1 {n} 0 1 1")), "too many for 4 bytes");
            assert_error_contains(parse(&format!("VECT 1 0 {n} 1 1")), "too many for 4 bytes");
        }
        for n in ["-2147483648", "2147483647", "-2147483647"] {
            assert_error_contains(parse(&format!("VECT 1 1 0 {n} 0 0 0 0")), "1 promised");
        }
        assert_error_contains(
            parse("VECT 1 1 0 2147483648 0 0 0 0"),
            "expected the vertices",
        );
    }

    proptest! {
        #[test]
        fn any_polylines_round_trip(
            lines in prop::collection::vec((2..20usize, any::<bool>()), 0..5),
            bits in prop::collection::vec(any::<u64>(), 1..40),
        ) {
            let finite = bits.iter().map(|&b| f64::from_bits(b)).filter(|x| x.is_finite());
            let mut values = finite.chain([1.0]).cycle();
            let expected: Vec<_> = lines
                .iter()
                .map(|&(n, closed)| {
                    let point = |_| [0; 3].map(|_| values.next().unwrap());
                    (closed, (0..n).map(point).collect::<Vec<_>>())
                })
                .collect();
            let total: usize = lines.iter().map(|l| l.0).sum();
            let mut text = format!("VECT {} {total} 0\n", lines.len());
            for (n, closed) in lines {
                text += &format!("{}{n} ", if closed { "-" } else { "" });
            }
            text += &"0 ".repeat(expected.len());
            for [x, y, z] in expected.iter().flat_map(|c| &c.1) {
                text += &format!("{x} {y:e} {z:?}\n");
            }
            prop_assert_eq!(curves(&parse(&text).unwrap()), expected);
        }
    }
}
