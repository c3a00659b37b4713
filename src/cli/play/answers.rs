//! Verdicts of the watcher on published frames, compared with the recorded ones.

use crate::cli::Outcome;
use crate::cli::output::{self, count, plural};
use linkwatch::{ChangeKind, MessageKind, Report, Verdict, VerdictMessage};
use serde::Serialize;
use std::collections::VecDeque;

/// Maximum number of verdicts that wait for the one they are compared with. The watcher may skip
/// frames, or not answer at all.
const WAITING: usize = 4096;

/// A verdict, and the numbers of its findings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
struct Brief {
    #[serde(skip)]
    seq: u64,
    verdict: Verdict,
    lost: u64,
    gained: u64,
    changed: u64,
    pull_throughs: u64,
    unresolved: u64,
    defects: u64,
}

impl From<&Report> for Brief {
    fn from(report: &Report) -> Brief {
        let count = |kind| report.count(kind) as u64;
        Brief {
            seq: report.seq,
            verdict: report.verdict,
            lost: count(ChangeKind::Lost),
            gained: count(ChangeKind::Gained),
            changed: count(ChangeKind::Changed),
            pull_throughs: report.events.len() as u64,
            unresolved: report.unresolved.len() as u64,
            defects: report.defects.len() as u64,
        }
    }
}

impl From<&VerdictMessage> for Brief {
    fn from(message: &VerdictMessage) -> Brief {
        Brief {
            seq: message.seq,
            verdict: message.verdict,
            lost: message.lost.into(),
            gained: message.gained.into(),
            changed: message.changed.into(),
            pull_throughs: message.events.into(),
            unresolved: message.unresolved.into(),
            defects: message.defects.into(),
        }
    }
}

impl Brief {
    /// Returns the verdict in words.
    fn words(&self) -> String {
        let counts = [
            (self.lost, "lost"),
            (self.gained, "gained"),
            (self.changed, "changed"),
        ];
        let counts = counts.iter().filter(|(n, _)| *n > 0);
        let links = counts.map(|(n, word)| format!(", {} {word}", plural(*n, "link")));
        let others = [
            (self.pull_throughs, "pull-through"),
            (self.unresolved, "unresolved pull-through"),
            (self.defects, "undecided pair"),
        ];
        let others = others.iter().filter(|(n, _)| *n > 0);
        let others = others.map(|(n, noun)| format!(", {}", plural(*n, noun)));
        format!(
            "{}{}",
            self.verdict,
            links.chain(others).collect::<String>()
        )
    }
}

/// Numbers of verdicts of the watcher that equal the recorded ones, and that do not.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Compared {
    equal: u64,
    different: u64,
}

/// Verdicts of the watcher, and the recorded ones.
pub struct Answers {
    json: bool,
    recorded: VecDeque<Brief>,
    answered: VecDeque<Brief>,
    last: Option<Brief>,
    compared: Compared,
    worst: Outcome,
    /// Verdicts that asked to stop.
    pub aborts: u64,
    /// Frames with a recorded verdict, but without curves.
    pub rejected: u64,
}

impl Answers {
    pub fn new(json: bool) -> Answers {
        Answers {
            json,
            recorded: VecDeque::new(),
            answered: VecDeque::new(),
            last: None,
            compared: Compared::default(),
            worst: Outcome::Fine,
            aborts: 0,
            rejected: 0,
        }
    }

    /// Returns true if the results are printed as JSON.
    pub fn as_json(&self) -> bool {
        self.json
    }

    /// Returns the number of the last frame with a verdict of the watcher.
    pub fn last(&self) -> Option<u64> {
        self.last.map(|last| last.seq)
    }

    /// Adds a recorded verdict.
    pub fn recorded(&mut self, report: &Report) {
        if report.verdict == Verdict::Rejected {
            self.rejected += 1;
            return;
        }
        push(&mut self.recorded, report.into());
        self.compare();
    }

    /// Adds a verdict of the watcher, and prints it if it differs from the last one.
    pub fn add(&mut self, message: &VerdictMessage) {
        if message.kind != MessageKind::Verdict {
            return;
        }
        let answer = Brief::from(message);
        self.worst = self.worst.max(Outcome::of(answer.verdict));
        if message.abort && self.aborts == 0 {
            tracing::warn!(
                "frame {}: the watcher asks the simulator to stop",
                message.seq
            );
        }
        self.aborts += u64::from(message.abort);
        let intact = Brief {
            verdict: Verdict::Intact,
            ..Brief::from(&Report::new(answer.seq, 0.0, Verdict::Intact))
        };
        let last = Brief {
            seq: answer.seq,
            ..self.last.unwrap_or(intact)
        };
        if self.json {
            output::json(&serde_json::json!({
                "frame": message.seq,
                "time": message.time,
                "watcher": answer,
                "abort": message.abort,
            }));
        } else if answer != last {
            output::line(message);
        }
        self.last = Some(answer);
        push(&mut self.answered, answer);
        self.compare();
    }

    /// Compares the verdicts on frames that have both. Both queues are in the order of the frames.
    fn compare(&mut self) {
        while let (Some(recorded), Some(answer)) = (self.recorded.front(), self.answered.front()) {
            if recorded.seq == answer.seq {
                if recorded == answer {
                    self.compared.equal += 1;
                } else {
                    self.compared.different += 1;
                    tracing::error!(
                        "frame {}: the watcher says {}; recorded was {}",
                        answer.seq,
                        answer.words(),
                        recorded.words()
                    );
                }
            }
            let (r, a) = (recorded.seq, answer.seq);
            if r <= a {
                self.recorded.pop_front();
            }
            if a <= r {
                self.answered.pop_front();
            }
        }
    }

    pub fn compared(&self) -> Compared {
        self.compared
    }

    /// Returns a sentence about the comparison.
    pub fn words(&self, has_verdicts: bool) -> String {
        let Compared { equal, different } = self.compared;
        match (has_verdicts, equal + different, different) {
            (false, ..) => "verdicts: the file has none to compare with".into(),
            (true, 0, _) => "verdicts: the watcher sent none to compare".into(),
            (true, _, 0) => format!("verdicts: {} equal to the recorded ones", count(equal)),
            (true, _, n) => format!(
                "verdicts: {} equal to the recorded ones, {} different",
                count(equal),
                count(n)
            ),
        }
    }

    /// Returns the outcome of the run: that of the worst verdict of the watcher, or undecided if
    /// verdicts differ or the run is incomplete.
    pub fn outcome(&self, complete: bool) -> Outcome {
        match complete && self.compared.different == 0 {
            true => self.worst,
            false => self.worst.max(Outcome::Undecided),
        }
    }
}

fn push(queue: &mut VecDeque<Brief>, brief: Brief) {
    if queue.len() == WAITING {
        queue.pop_front();
    }
    queue.push_back(brief);
}
