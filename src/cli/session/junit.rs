//! The option `--junit`: verdicts as JUnit XML, for continuous integration.
//!
//! Every frame is a test case. A change is a failure; a frame that could not be verified is an
//! error. A last test case is an error if the run is incomplete, so that it never looks like a
//! success.

use crate::cli::files::{Content, Files, Overwrite, write_text};
use linkwatch::{Report, Result, Verdict};
use std::fmt::Write;
use std::path::PathBuf;
use std::time::Duration;

/// The option of a command.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = crate::cli::WRITE)]
pub struct JunitArgs {
    /// Write the verdict on every frame as a test case of JUnit XML, for continuous integration
    #[arg(long, value_name = "FILE.xml")]
    junit: Option<PathBuf>,
}

impl JunitArgs {
    /// Checks the file, and returns a report for a run with this title. `None` if the option was
    /// not given.
    pub fn open(&self, files: &mut Files, title: &str) -> Result<Option<Junit>> {
        let Some(path) = &self.junit else {
            return Ok(None);
        };
        files.writes("--junit", path, Content::Text)?;
        if path.is_file() {
            // If this run fails early, no verdicts of an earlier run remain.
            std::fs::remove_file(path)?;
        }
        Ok(Some(Junit {
            path: path.clone(),
            suite: Suite::new(title),
        }))
    }
}

/// A report in the making.
pub struct Junit {
    path: PathBuf,
    suite: Suite,
}

impl Junit {
    /// Adds a frame. `names` are those of its curves, or empty; `model` is its file, if it has one.
    pub fn add(&mut self, report: &Report, names: &[String], model: Option<&str>, check: Duration) {
        self.suite.add(report, names, model, check);
    }

    /// Writes the file. `complete` is false if frames are missing, or differ from those recorded.
    pub fn write(self, complete: bool, overwrite: Overwrite) -> Result<()> {
        write_text(&self.path, overwrite, &self.suite.finish(complete))
    }
}

/// Test cases of a run.
struct Suite {
    title: String,
    cases: String,
    tests: u64,
    failures: u64,
    errors: u64,
    time: Duration,
}

impl Suite {
    fn new(title: &str) -> Suite {
        Suite {
            title: escape(title),
            cases: String::new(),
            tests: 0,
            failures: 0,
            errors: 0,
            time: Duration::ZERO,
        }
    }

    fn add(&mut self, report: &Report, names: &[String], model: Option<&str>, check: Duration) {
        let name = model.map_or_else(|| report.frame(), str::to_owned);
        let kind = match report.verdict {
            Verdict::Intact => None,
            Verdict::Changed => Some("failure"),
            _ => Some("error"),
        };
        let problem = kind.map(|kind| {
            let findings = report.findings_named(names);
            let findings = findings.chain(report.missing.clone());
            let findings = findings.chain(report.rejected.clone());
            // Models have names instead of the numbers in these words.
            let roll_back = report.roll_back().filter(|_| model.is_none());
            let lines: Vec<String> = findings.chain(roll_back).collect();
            let verdict = report.verdict.word();
            (kind, verdict, report.headline(), lines.join("\n"))
        });
        self.case(&name, check, problem);
    }

    /// Adds a test case. A problem has an element, a type, a message and a text.
    fn case(&mut self, name: &str, check: Duration, problem: Option<(&str, &str, String, String)>) {
        let seconds = check.as_secs_f64();
        self.tests += 1;
        self.time += check;
        let (classname, name) = (&self.title, escape(name));
        let head =
            format!("<testcase classname=\"{classname}\" name=\"{name}\" time=\"{seconds}\"");
        // Writing to a string cannot fail.
        let _ = match problem {
            None => writeln!(self.cases, "    {head}/>"),
            Some((element, kind, message, text)) => {
                match element {
                    "failure" => self.failures += 1,
                    _ => self.errors += 1,
                }
                let (message, text) = (escape(&message), escape(&text));
                writeln!(
                    self.cases,
                    "    {head}>\n      <{element} type=\"{kind}\" message=\"{message}\">{text}\
                     </{element}>\n    </testcase>"
                )
            }
        };
    }

    fn finish(mut self, complete: bool) -> String {
        let missing = (!complete).then(|| {
            let message = "the run is incomplete: see the messages of linkwatch";
            ("error", "incomplete", message.to_owned(), String::new())
        });
        self.case("the run is complete", Duration::ZERO, missing);
        let Suite {
            title,
            cases,
            tests,
            failures,
            errors,
            time,
        } = self;
        let seconds = time.as_secs_f64();
        let counts = format!(
            "tests=\"{tests}\" failures=\"{failures}\" errors=\"{errors}\" time=\"{seconds}\""
        );
        format!(
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n\
             <testsuites name=\"linkwatch\" {counts}>\n  \
             <testsuite name=\"{title}\" {counts}>\n{cases}  </testsuite>\n</testsuites>\n"
        )
    }
}

/// Escapes text for an attribute or an element of XML 1.0. Replaces characters that it excludes.
fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out += "&amp;",
            '<' => out += "&lt;",
            '>' => out += "&gt;",
            '"' => out += "&quot;",
            '\n' | '\t' => out.push(c),
            '\0'..' ' | '\u{7f}' | '\u{fffe}' | '\u{ffff}' => out.push('\u{fffd}'),
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_suite_counts_failures_and_errors_and_escapes_names() {
        let mut suite = Suite::new("check of <a & b>");
        for (seq, verdict) in Verdict::ALL.into_iter().enumerate() {
            let report = Report::new(seq as u64, 0.0, verdict);
            suite.add(
                &report,
                &[],
                (seq == 1).then_some("\"x\"\u{1}.obj"),
                Duration::from_millis(1),
            );
        }
        let text = suite.finish(true);
        let counts = "tests=\"7\" failures=\"1\" errors=\"4\" time=\"0.006\"";
        assert_eq!(text.matches(counts).count(), 2, "{text}");
        let suite = format!("<testsuite name=\"check of &lt;a &amp; b&gt;\" {counts}>");
        assert!(text.contains(&suite), "{text}");
        assert!(
            text.contains("name=\"&quot;x&quot;\u{fffd}.obj\" time=\"0.001\">\n"),
            "{text}"
        );
        let failure = "<failure type=\"changed\" message=\"frame 1: changed\"></failure>";
        assert!(text.contains(failure), "{text}");
        assert!(text.contains("name=\"frame 0\" time=\"0.001\"/>"), "{text}");
    }

    #[test]
    fn an_incomplete_run_has_an_error() {
        let text = Suite::new("replay").finish(false);
        assert!(
            text.contains("tests=\"1\" failures=\"0\" errors=\"1\""),
            "{text}"
        );
        assert!(text.contains("<error type=\"incomplete\""), "{text}");
    }
}
