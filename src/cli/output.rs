//! Output of the command: results on stdout, everything else on stderr.

use super::stream::{self, Lost, Target};
pub use crate::words::{count, if_any, millis, milliseconds, percent, plural, plural_of};
use linkwatch::{Events, Progress, Stats};
use std::io::{self, Write};
use std::sync::{Arc, mpsc};
use std::time::{Duration, Instant};
use tracing::Level;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;

/// Time limit at the end of the run for results that nobody reads.
const FINISH: Duration = Duration::from_secs(5);

/// Interval at which the progress of a frame is shown.
const INTERVAL: Duration = Duration::from_millis(700);

/// Sends log messages to stderr. `RUST_LOG` overrides the level.
pub fn init(quiet: bool, verbose: bool) {
    let level = match (quiet, verbose) {
        (true, _) => Level::WARN,
        (_, true) => Level::DEBUG,
        _ => Level::INFO,
    };
    // `re_log_encoding` warns of files without an index, which linkwatch writes on purpose.
    let levels = std::env::var("RUST_LOG")
        .ok()
        .and_then(|levels| levels.parse::<Targets>().ok());
    let levels = levels.unwrap_or_else(|| {
        let others = Targets::new().with_default(Level::WARN);
        others
            .with_target("re_log_encoding", Level::ERROR)
            .with_target("linkwatch", level)
    });
    let is_set = |key| std::env::var_os(key).is_some_and(|value| !value.is_empty());
    let is_plain =
        is_set("NO_COLOR") || std::env::var_os("TERM").is_some_and(|term| term == "dumb");
    let lines = tracing_subscriber::fmt::layer()
        .with_writer(|| Log)
        .with_ansi(stream::is_terminal() && !is_plain)
        .without_time()
        .with_target(false);
    tracing_subscriber::registry()
        .with(levels)
        .with(lines)
        .init();
}

/// Writer of log messages, each in one piece. Never fails, because the subscriber would report an
/// error to stderr, and panic if stderr cannot be written either.
struct Log;

impl Write for Log {
    fn write(&mut self, message: &[u8]) -> io::Result<usize> {
        stream::put(Target::Err, with_dashes(&String::from_utf8_lossy(message)));
        Ok(message.len())
    }
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Writes the names of options as the command takes them: messages of the library name the option
/// `closed` where the command has `--closed` and Python `closed=True`.
fn with_dashes(message: &str) -> Vec<u8> {
    message.replace("option `", "option `--").into_bytes()
}

/// Writes a line, or several, to stdout. If it is lost, [`finish`] reports that. The work
/// continues, because a watched simulation still needs its verdicts, and the exit code still gives
/// the outcome.
pub fn line(text: impl std::fmt::Display) {
    stream::put(Target::Out, with_dashes(&format!("{text}\n")));
}

/// Returns the first `most` lines, indented, and the number of the others.
pub fn listed(indent: &str, lines: &[String], most: usize) -> Vec<String> {
    let more = lines.len().saturating_sub(most);
    let first = lines.iter().take(most);
    let mut listed: Vec<String> = first.map(|line| format!("{indent}{line}")).collect();
    if more > 0 {
        listed.push(format!("{indent}and {} more", count(more)));
    }
    listed
}

/// Writes the first `most` lines to stdout, indented, and the number of the others.
pub fn list(indent: &str, lines: &[String], most: usize) {
    listed(indent, lines, most).iter().for_each(line);
}

/// Writes a value as one line of JSON to stdout.
pub fn json(value: &serde_json::Value) {
    stream::put(Target::Out, format!("{value}\n").into_bytes());
}

/// Returns a JSON object with the fields of two.
pub fn joined(first: &serde_json::Value, second: serde_json::Value) -> serde_json::Value {
    let mut all = first.clone();
    if let (Some(all), serde_json::Value::Object(second)) = (all.as_object_mut(), second) {
        all.extend(second);
    }
    all
}

/// Writes the error that ends the command to stderr.
pub fn error(e: impl std::fmt::Display) {
    stream::put(Target::Err, with_dashes(&format!("error: {e}\n")));
}

/// Writes the pending text. Returns false, and reports it, if results were lost.
pub fn finish() -> bool {
    stream::status(String::new());
    let lost = stream::finish(Target::Out, FINISH);
    if let Some(Lost { lines, why }) = &lost {
        let lines = plural(*lines, "line");
        error(format_args!("standard output: {why}; {lines} lost"));
    }
    stream::finish(Target::Err, FINISH);
    lost.is_none()
}

/// Runs `work`, with its progress on the status line of the terminal if it takes longer than
/// [`INTERVAL`].
pub fn with_progress<T>(what: &str, progress: Arc<Progress>, work: impl FnOnce() -> T) -> T {
    if !stream::is_terminal() {
        return work();
    }
    let (done, ended) = mpsc::channel::<()>();
    std::thread::scope(|scope| {
        scope.spawn(move || {
            let start = Instant::now();
            while ended.recv_timeout(INTERVAL) == Err(mpsc::RecvTimeoutError::Timeout) {
                stream::status(format!("{what}: {}", words_of(&progress, start)));
            }
            stream::status(String::new());
        });
        let result = work();
        // The thread removes the status line and ends.
        drop(done);
        result
    })
}

/// Returns the progress of a frame as text.
pub fn words_of(progress: &Progress, start: Instant) -> String {
    let (done, total) = progress.pairs();
    let work = match total {
        0 => "finding pairs that come close".to_owned(),
        _ => format!("{} of {}", count(done), plural(total, "pair")),
    };
    format!("{work} in {:.0} s", start.elapsed().as_secs_f64())
}

/// Warns of open curves. `events` is the setting for pull-throughs, if the command sees several
/// frames.
pub fn warn_of_open_curves(name: &str, stats: &Stats, events: Option<Events>) {
    if stats.open_curves == 0 {
        return;
    }
    let curves = plural(stats.open_curves, "open curve");
    match remedy(events) {
        Some(remedy) => tracing::warn!(
            "{name}: {curves} skipped: linking numbers are defined for closed curves only; \
             {remedy} pull-throughs of open curves"
        ),
        None => tracing::info!(
            "{name}: {curves}, verified for pull-throughs; linking numbers are defined for closed \
             curves only"
        ),
    }
}

/// Returns what verifies pull-throughs, with a verb, or `None` if this command does.
fn remedy(events: Option<Events>) -> Option<&'static str> {
    match events {
        Some(Events::Off) => Some("--events=between verifies"),
        Some(_) => None,
        None => Some("`check` and `watch` verify"),
    }
}

/// Tells which linking numbers curves that run through the cell have, and warns of what is not
/// verified. `events` is the setting for pull-throughs, if the command sees several frames.
pub fn tell_of_yarns(name: &str, yarns: usize, events: Option<Events>) {
    let words = match yarns {
        0 => return,
        1 => "1 curve runs through the cell: it has linking numbers with closed curves".into(),
        n => format!(
            "{} curves run through the cell: they have linking numbers with closed curves, but \
             not with one another",
            count(n)
        ),
    };
    match remedy(events).filter(|_| yarns > 1) {
        Some(remedy) => tracing::warn!("{name}: {words}; {remedy} their pull-throughs"),
        None => tracing::info!("{name}: {words}"),
    }
}
