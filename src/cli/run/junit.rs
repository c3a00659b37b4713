//! The option `--junit`: verdicts as JUnit XML, for continuous integration.
//!
//! Every frame is a test case. A change is a failure; a frame that could not be verified is an
//! error. Frames of a violation that was rolled back, or accepted by the simulator, are skipped. If
//! the run is incomplete, an additional test case is an error, so that the run does not look like a
//! success.

use crate::cli::files::{Content, Files, Overwrite, write_text};
use linkwatch::{Report, Result, Verdict};
use maud::{PreEscaped, html};
use std::path::PathBuf;
use std::time::Duration;

/// The option of a command.
#[derive(Clone, Debug, Default, clap::Args)]
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
        files.writes("--junit", [path], Content::Text)?;
        if path.is_file() {
            // If this run fails early, the file must not show the verdicts of an earlier run.
            std::fs::remove_file(path)?;
        }
        Ok(Some(Junit::new(path.clone(), title)))
    }
}

/// A report under construction.
#[derive(Default)]
pub struct Junit {
    path: PathBuf,
    title: String,
    cases: Vec<Case>,
    /// First frame of the current violation. A frame of another run does not end the violation.
    pub violation: Option<usize>,
}

/// A test case: a frame.
struct Case {
    name: String,
    check: Duration,
    problem: Option<Problem>,
}

struct Problem {
    /// Name of the element: failure, error or skipped.
    element: &'static str,
    kind: &'static str,
    message: String,
    text: String,
}

impl Junit {
    fn new(path: PathBuf, title: &str) -> Junit {
        Junit {
            path,
            title: legal(title),
            ..Junit::default()
        }
    }

    /// Adds a frame. `names` has the names of its curves, or is empty; `model` is its file, if any.
    pub fn add(&mut self, report: &Report, names: &[String], model: Option<&str>, check: Duration) {
        if report.abort || report.verdict == Verdict::Changed {
            self.violation.get_or_insert(self.cases.len());
        }
        let problem = (report.verdict != Verdict::Intact).then(|| {
            let findings = report.findings_named(names);
            let findings = findings.chain(report.missing.clone());
            let findings = findings.chain(report.rejected.clone());
            // Skipped for model files, because the advice names frames by number.
            let roll_back = report.roll_back().filter(|_| model.is_none());
            let lines: Vec<String> = findings.chain(roll_back).collect();
            Problem {
                element: match report.verdict {
                    Verdict::Changed => "failure",
                    _ => "error",
                },
                kind: report.verdict.word(),
                message: legal(&report.headline()),
                text: legal(&lines.join("\n")),
            }
        });
        self.cases.push(Case {
            name: legal(&model.map_or_else(|| report.frame(), str::to_owned)),
            check,
            problem,
        });
    }

    /// Marks the frames of the current violation as skipped: the simulator rolled them back, or
    /// accepted them.
    pub fn end_violation(&mut self) {
        let first = self.violation.take().unwrap_or(self.cases.len());
        let problems = self.cases[first..].iter_mut();
        for problem in problems.filter_map(|case| case.problem.as_mut()) {
            problem.element = "skipped";
            problem.message += "; rolled back or accepted by the simulator";
        }
    }

    /// Writes the file. `complete` is false if frames are missing, or differ from those recorded.
    pub fn write(self, complete: bool, overwrite: Overwrite) -> Result<()> {
        write_text(&self.path.clone(), overwrite, &self.xml(complete))
    }

    fn xml(mut self, complete: bool) -> String {
        self.cases.push(Case {
            name: "the run is complete".into(),
            check: Duration::ZERO,
            problem: (!complete).then(|| Problem {
                element: "error",
                kind: "incomplete",
                message: "the run is incomplete: see the messages of linkwatch".into(),
                text: String::new(),
            }),
        });
        let (cases, title) = (&self.cases, &self.title);
        let of = |element: &str| {
            let problems = cases.iter().filter_map(|case| case.problem.as_ref());
            problems.filter(|p| p.element == element).count()
        };
        let [failures, errors, skipped] = ["failure", "error", "skipped"].map(of);
        let time: Duration = cases.iter().map(|case| case.check).sum();
        let (tests, time) = (cases.len(), time.as_secs_f64());
        html! {
            (PreEscaped("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"))
            testsuites name="linkwatch" tests=(tests) failures=(failures) errors=(errors)
                skipped=(skipped) time=(time)
            {
                "\n"
                testsuite name=(title) tests=(tests) failures=(failures) errors=(errors)
                    skipped=(skipped) time=(time)
                {
                    "\n"
                    @for Case { name, check, problem } in cases {
                        testcase classname=(title) name=(name) time=(check.as_secs_f64()) {
                            @if let Some(Problem { element, kind, message, text }) = problem {
                                @match *element {
                                    "failure" => failure type=(kind) message=(message) { (text) },
                                    "error" => error type=(kind) message=(message) { (text) },
                                    // The schema of JUnit gives this element no type.
                                    _ => skipped message=(message) { (text) },
                                }
                            }
                        }
                        "\n"
                    }
                }
                "\n"
            }
            "\n"
        }
        .into_string()
    }
}

/// Replaces characters that XML 1.0 excludes.
fn legal(text: &str) -> String {
    let control = |c: char| c.is_ascii_control() && !matches!(c, '\n' | '\t');
    let excluded = |c: char| control(c) || matches!(c, '\u{fffe}' | '\u{ffff}');
    text.replace(excluded, "\u{fffd}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_suite_counts_failures_and_errors_and_escapes_names() {
        let mut suite = Junit::new(PathBuf::new(), "check of <a & b>");
        for (seq, verdict) in Verdict::ALL.into_iter().enumerate() {
            let report = Report::new(seq as u64, 0.0, verdict);
            suite.add(
                &report,
                &[],
                (seq == 1).then_some("\"x\"\u{1}.obj"),
                Duration::from_millis(1),
            );
        }
        let text = suite.xml(true);
        let counts = "tests=\"7\" failures=\"1\" errors=\"4\" skipped=\"0\" time=\"0.006\"";
        assert_eq!(text.matches(counts).count(), 2, "{text}");
        let suite = format!("<testsuite name=\"check of &lt;a &amp; b&gt;\" {counts}>");
        assert!(text.contains(&suite), "{text}");
        assert!(
            text.contains("name=\"&quot;x&quot;\u{fffd}.obj\" time=\"0.001\"><"),
            "{text}"
        );
        let failure = "<failure type=\"changed\" message=\"frame 1: changed\"></failure>";
        assert!(text.contains(failure), "{text}");
        assert!(
            text.contains("name=\"frame 0\" time=\"0.001\"></testcase>"),
            "{text}"
        );
    }

    #[test]
    fn frames_of_a_recovered_violation_are_skipped() {
        let mut suite = Junit::new(PathBuf::new(), "replay");
        let verdicts = [
            Verdict::Undecided,
            Verdict::Changed,
            Verdict::Changed,
            Verdict::Intact,
        ];
        for (seq, verdict) in verdicts.into_iter().enumerate() {
            if verdict == Verdict::Intact {
                suite.end_violation();
            }
            suite.add(
                &Report::new(seq as u64, 0.0, verdict),
                &[],
                None,
                Duration::ZERO,
            );
        }
        let text = suite.xml(true);
        // The run is a test as well. The counts are there for all suites and for the one.
        let counts = "tests=\"5\" failures=\"0\" errors=\"1\" skipped=\"2\"";
        assert_eq!(text.matches(counts).count(), 2, "{text}");
        let skipped = "<skipped message=\"frame 1: changed; rolled back or accepted by";
        assert!(text.contains(skipped), "{text}");
    }

    #[test]
    fn an_incomplete_run_has_an_error() {
        let text = Junit::new(PathBuf::new(), "replay").xml(false);
        assert!(
            text.contains("tests=\"1\" failures=\"0\" errors=\"1\""),
            "{text}"
        );
        assert!(text.contains("<error type=\"incomplete\""), "{text}");
    }
}
