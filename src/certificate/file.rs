//! The text file of a certificate, in the layout of verifycurves (Qu & James 2021): the number of curves on
//! the first line, then `i,j,lambda` for every non-zero pair, 0-based, sorted.

use super::{Certificate, Link};
use crate::error::{Error, Result};
use std::fmt;
use std::path::Path;

impl fmt::Display for Certificate {
    /// The text of the file. Pairs without a number are listed as `i,j,undefined` (`i,,undefined` for all pairs
    /// of a curve), which no reader takes for a certificate: left out, they would read as 0.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.curves)?;
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
    /// Reads the text of a certificate. Lines may come in any order.
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
        let curves: usize = first.trim().parse().map_err(|_| {
            bad(
                at,
                format!("'{}', expected the number of curves", clip(first)),
            )
        })?;
        let mut links = Vec::new();
        for (at, line) in lines {
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

    /// Writes a certificate file. Refused where a pair has no linking number: in the file it would read as 0.
    pub fn write(&self, path: &Path) -> Result<()> {
        if let Some(d) = self.undefined.first() {
            return Err(Error::Incomplete {
                undefined: self.undefined.len(),
                first: d.to_string(),
            });
        }
        std::fs::write(path, self.to_string()).map_err(Error::file(path))
    }
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
        let text = "39\n5,6,-2\n7,9,1\n";
        let c = Certificate::parse(text).unwrap();
        assert_eq!(c.curves, 39);
        assert_eq!(c.to_string(), text);
        assert_eq!(Certificate::parse("70").unwrap().to_string(), "70\n");
        assert_eq!(
            Certificate::parse("9\n 7, 8, 1\n5,6,-2\n1,2,0\n")
                .unwrap()
                .to_string(),
            "9\n5,6,-2\n7,8,1\n"
        );
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
        ] {
            let e = Certificate::parse(text).unwrap_err().to_string();
            assert!(e.contains(says), "{text:?}: {e}");
        }
    }
}
