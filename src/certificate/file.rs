//! The text file of a certificate, in the layout of verifycurves (Qu & James 2021): the number of curves on
//! the first line, then `i,j,lambda` for every non-zero pair, 0-based, sorted.
//!
//! ```text
//! 39 # lines: 2
//! 5,6,-2
//! 7,9,1
//! ```
//!
//! The comment states how many lines the file has after the first. Without it, a file that was
//! truncated at a line end would be a valid certificate with fewer links. It is in the first line,
//! because readers that do not know it most likely ignore it there: verifycurves reads the number
//! with `atoi`, and table readers skip the first line. Files without it are read as before.

use super::{Certificate, Link};
use crate::error::{Error, Result};
use std::fmt;
use std::path::Path;

impl fmt::Display for Certificate {
    /// The text of the file. Pairs without a number are listed as `i,j,undefined` (`i,,undefined` for all pairs
    /// of a curve), which no reader takes for a certificate: left out, they would read as 0.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let lines = self.links.len() + self.undefined.len();
        writeln!(f, "{} {}", self.curves, promise(lines))?;
        for l in &self.links {
            writeln!(f, "{},{},{}", l.i, l.j, l.lambda)?;
        }
        for d in &self.undefined {
            let j = d.j.map_or(String::new(), |j| j.to_string());
            writeln!(f, "{},{j},undefined", d.i)?;
        }
        Ok(())
    }
}

impl Certificate {
    /// Parses the text of a certificate. Lines may be in any order. If the first line states their
    /// number, all of them must be there.
    pub fn parse(text: &str) -> Result<Certificate> {
        let bad = |line: usize, what: String| {
            Error::format("certificate", format_args!("line {}", line + 1), what)
        };
        let mut lines = text
            .lines()
            .enumerate()
            .filter(|(_, l)| !l.trim().is_empty());
        let (at, first) = lines
            .next()
            .ok_or_else(|| bad(0, "empty; expected the number of curves".into()))?;
        let (number, comment) = match first.split_once('#') {
            Some((number, _)) => (number, Some(&first[number.len()..])),
            None => (first, None),
        };
        let curves: usize = number.trim().parse().map_err(|_| {
            bad(
                at,
                format!("'{}', expected the number of curves", clip(first)),
            )
        })?;
        let mut links = Vec::new();
        let mut found = 0;
        for (at, line) in lines {
            found += 1;
            let mut fields = line.split(',').map(str::trim);
            let parsed = (|| {
                let (i, j) = (fields.next()?.parse().ok()?, fields.next()?.parse().ok()?);
                let lambda = fields.next()?.parse().ok()?;
                fields.next().is_none().then_some(Link { i, j, lambda })
            })();
            let Some(link) = parsed else {
                return Err(bad(at, format!("'{}', expected i,j,lambda", clip(line))));
            };
            if link.i >= link.j || link.j as usize >= curves {
                let what = format!(
                    "pair {},{} of {curves} curves; expected i < j < {curves}",
                    link.i, link.j
                );
                return Err(bad(at, what));
            }
            if link.lambda != 0 {
                links.push(link);
            }
        }
        // The last line may be truncated within its number.
        let whole = comment.is_none_or(|c| text.ends_with('\n') && c.trim_end() == promise(found));
        if !whole {
            return Err(Error::format(
                "certificate",
                format_args!("line {}", at + 1),
                format_args!(
                    "'{}', found {found}: the file was cut or edited (without this comment all is read)",
                    clip(first)
                ),
            ));
        }
        links.sort_unstable();
        if let Some(w) = links
            .windows(2)
            .find(|w| (w[0].i, w[0].j) == (w[1].i, w[1].j))
        {
            return Err(Error::format(
                "certificate",
                "whole file",
                format_args!("pair {},{} is listed twice", w[0].i, w[0].j),
            ));
        }
        Ok(Certificate {
            curves,
            links,
            undefined: Vec::new(),
        })
    }

    /// Reads a certificate file.
    pub fn read(path: &Path) -> Result<Certificate> {
        let text = std::fs::read_to_string(path).map_err(Error::file(path))?;
        Self::parse(&text)
    }

    /// Writes a certificate file; see [`Certificate::to_text`].
    pub fn write(&self, path: &Path) -> Result<()> {
        std::fs::write(path, self.to_text()?).map_err(Error::file(path))
    }

    /// Returns the text of a certificate file.
    ///
    /// Errors: [`Error::Incomplete`] if a pair has no linking number, because the file would read
    /// as 0.
    pub fn to_text(&self) -> Result<String> {
        if let Some(d) = self.undefined.first() {
            return Err(Error::Incomplete {
                undefined: self.undefined.len(),
                first: d.to_string(),
            });
        }
        Ok(self.to_string())
    }
}

/// Returns the comment of the first line.
fn promise(lines: usize) -> String {
    format!("# lines: {lines}")
}

/// A piece of somebody's file, short enough for a message.
fn clip(s: &str) -> String {
    s.chars().take(40).collect()
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
        // The format that verifycurves and earlier versions write.
        for plain in ["39\n5,6,-2\n7,9,1\n", "39\n 7, 9, 1\n5,6,-2\n1,2,0"] {
            assert_eq!(Certificate::parse(plain).unwrap(), c);
        }
        let empty = Certificate::parse("70").unwrap();
        assert_eq!(empty.to_string(), "70 # lines: 0\n");
        assert_eq!(Certificate::parse(&empty.to_string()).unwrap(), empty);
    }

    #[test]
    fn a_certificate_that_was_cut_anywhere_is_refused() {
        for text in ["39 # lines: 2\n5,6,-2\n7,9,12\n", "70 # lines: 0\n"] {
            // The number of curves alone is a complete file of an earlier version.
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
    fn the_reader_of_verifycurves_is_not_disturbed() {
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
    fn bad_text_is_named_by_line() {
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
            ("3 # some rings\n0,1,1\n", "line 1"),
            ("3 # lines: 1\n0,1,1\n1,2,1\n", "found 2"),
        ] {
            let e = Certificate::parse(text).unwrap_err().to_string();
            assert!(e.contains(says), "{text:?}: {e}");
        }
    }
}
