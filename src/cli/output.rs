//! Output of the command: results on stdout, everything else on stderr.

use super::live::Label;
use super::stream::{self, Lost, Target};
pub use crate::words::{count, millis, percent, plural, plural_of};
use indicatif::{HumanDuration, ProgressBar, ProgressState, ProgressStyle};
use linkwatch::LeftOut;
use linkwatch::{Cell, CurveSet, Events, Progress, Stats, Unwrap};
use std::fmt;
use std::io::{self, Write};
use std::path::Path;
use std::sync::Arc;
use std::sync::mpsc;
use std::time::Duration;
use tracing_subscriber::EnvFilter;

/// Time limit at the end of the run for results that nobody reads.
const FINISH: Duration = Duration::from_secs(5);

/// Sends log messages to stderr. `RUST_LOG` overrides the level.
pub fn init(quiet: bool, verbose: bool) {
    let level = match (quiet, verbose) {
        (true, _) => "warn",
        (_, true) => "debug",
        _ => "info",
    };
    let filter = EnvFilter::try_from_default_env()
        .unwrap_or_else(|_| EnvFilter::new(format!("warn,linkwatch={level}")));
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(|| Log)
        .with_ansi(console_on_stderr())
        .without_time()
        .with_target(false)
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

/// Writes the first `most` lines to stdout, indented, and the number of the others.
pub fn first_lines(indent: &str, lines: &[String], most: usize) {
    Label::default().first_lines(indent, lines, most);
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

/// Limits how long a line may block on stdout or stderr from now on.
pub fn detach(overflow: linkwatch::Overflow) -> linkwatch::Result<()> {
    Ok(stream::detach(overflow)?)
}

/// Replaces the status line below the results, on a terminal.
pub fn status(text: String) {
    stream::status(text);
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

/// Runs `work`, with a progress bar on the terminal if it takes longer than 0.7 s.
pub fn with_progress<T>(what: &str, progress: Arc<Progress>, work: impl FnOnce() -> T) -> T {
    if !console_on_stderr() {
        return work();
    }
    let (done, ended) = mpsc::channel::<()>();
    std::thread::scope(|scope| {
        scope.spawn(move || {
            // Most runs end before a bar could be read.
            if ended.recv_timeout(Duration::from_millis(700))
                != Err(mpsc::RecvTimeoutError::Timeout)
            {
                return;
            }
            let bar = ProgressBar::no_length().with_message(what.to_owned());
            while ended.recv_timeout(Duration::from_millis(100))
                == Err(mpsc::RecvTimeoutError::Timeout)
            {
                show_pairs(&bar, progress.pairs());
            }
            bar.finish_and_clear();
        });
        let result = work();
        // The receiver may have ended already; then there is no bar to end.
        drop(done);
        result
    })
}

/// Shows the progress of a frame. There is no bar until its pairs are counted, because a bar
/// without a length looks full.
fn show_pairs(bar: &ProgressBar, (done, total): (u64, u64)) {
    if total == 0 {
        bar.set_style(style("{msg}: finding pairs that come close, {elapsed}"));
    } else if bar.length().is_none() {
        bar.set_style(bar_of("pairs"));
        bar.set_length(total);
    }
    bar.set_position(done);
}

/// Returns a progress bar for a number of frames, rows or the like, hidden if stderr is not a
/// terminal. The caller draws it between two of them.
pub fn bar(length: u64, of: &str) -> ProgressBar {
    ProgressBar::new(length).with_style(bar_of(of))
}

fn bar_of(items: &str) -> ProgressStyle {
    let template = format!("{{msg}} [{{bar:40}}] {{human_pos}}/{{human_len}} {items}{{left}}");
    style(&template).with_key("left", |state: &ProgressState, out: &mut dyn fmt::Write| {
        // Before the first item is done, the time left is unknown.
        if state.pos() > 0 {
            write!(out, ", {:#} left", HumanDuration(state.eta())).ok();
        }
    })
}

fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).expect("the template is valid")
}

/// Returns true if stderr is a terminal.
pub fn console_on_stderr() -> bool {
    stream::is_terminal()
}

/// Warns of elements of a file that were not read, if there are any.
pub fn warn_of_left_out(file: &Path, left_out: &[LeftOut]) {
    if !left_out.is_empty() {
        tracing::warn!("{}: {}", file.display(), LeftOut::sentence(left_out));
    }
}

/// Warns of open curves. `events` is the setting for pull-throughs, if the command sees several
/// frames.
pub fn warn_of_open_curves(name: &str, stats: &Stats, events: Option<Events>) {
    if stats.open_curves == 0 {
        return;
    }
    let curves = plural(stats.open_curves, "open curve");
    match events {
        Some(Events::Off) => tracing::warn!(
            "{name}: {curves} skipped: linking numbers are defined for closed curves only; \
             --events=between verifies pull-throughs of open curves"
        ),
        Some(_) => tracing::info!(
            "{name}: {curves}, verified for pull-throughs; linking numbers are defined for closed \
             curves only"
        ),
        None => tracing::warn!(
            "{name}: {curves} skipped: linking numbers are defined for closed curves only; `check` \
             and `watch` verify pull-throughs of open curves"
        ),
    }
}

/// Tells which linking numbers curves that run through the cell have, and warns of what is not
/// verified. `events` is the setting for pull-throughs, if the command sees several frames.
pub fn tell_of_yarns(name: &str, yarns: usize, events: Option<Events>) {
    let (run, numbers) = match yarns {
        0 => return,
        1 => ("runs", "it has linking numbers with closed curves"),
        _ => (
            "run",
            "they have linking numbers with closed curves, but not with one another",
        ),
    };
    let curves = plural(yarns as u64, "curve");
    let words = format!("{name}: {curves} {run} through the cell: {numbers}");
    match events {
        Some(Events::Off) if yarns > 1 => {
            tracing::warn!("{words}; --events=between verifies their pull-throughs");
        }
        None if yarns > 1 => {
            tracing::warn!("{words}; `check` and `watch` verify their pull-throughs")
        }
        _ => tracing::info!("{words}"),
    }
}

/// Warns of segments that span more than half of the scene, as wrapped curves of a periodic box do.
pub fn warn_of_long_segment(name: &str, curves: &CurveSet) {
    let Some(long) = curves.long_segment() else {
        return;
    };
    let others = match long.count {
        1 => String::new(),
        n => format!(", and so do {}", plural_of(n as u64 - 1, "other", "others")),
    };
    tracing::warn!(
        "{name}: {long}{others}; if the box is periodic and the coordinates are wrapped into it, \
         links across its boundary are not detected: give --cell and --wrapped"
    );
}

/// Warns if curves with a periodic cell look as if their coordinates were wrapped into it.
pub fn warn_of_wrapped(name: &str, curves: &CurveSet, cell: &Cell) {
    if let Err(why) = Unwrap::default().unwrap(curves, cell) {
        tracing::warn!(
            "{name}: {why}; if the coordinates are wrapped into the cell, give --wrapped: \
             otherwise the curves are taken as they are"
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Regression test: a bar of length 0 is drawn full.
    #[test]
    fn a_progress_bar_does_not_start_full() {
        let bar = ProgressBar::no_length();
        show_pairs(&bar, (0, 0));
        assert_eq!((bar.position(), bar.length()), (0, None));
        show_pairs(&bar, (0, 12));
        assert_eq!((bar.position(), bar.length()), (0, Some(12)));
        show_pairs(&bar, (5, 12));
        assert_eq!((bar.position(), bar.length()), (5, Some(12)));
    }
}
