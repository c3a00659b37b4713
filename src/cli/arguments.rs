//! Parsing of the command line, with errors in plain words.

use super::Cli;
use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{Command, CommandFactory, Error, FromArgMatches};
use std::ffi::OsString;

/// Errors of the standard library for numbers, and what they mean.
const IN_WORDS: &str = "\
invalid digit found in string: expected a whole number
cannot parse integer from empty string: expected a whole number
number too large to fit in target type: the number is too large
number too small to fit in target type: the number is too small
invalid float literal: expected a number
cannot parse float from empty string: expected a number
";

/// Commands and options of earlier versions, and what to use instead.
const GONE: &str = "\
plan: `linkwatch certify --explain MODEL` prints the plan
study, sweep, --repeat, --measure, --calibrate: a command for developers, `cargo run --release -p \
    study -- --help` in a clone
--against: --baseline
--amplitude: --frames N,amplitude=A
--beta: --kernel barnes-hut,beta=B, of `linkwatch certify`
--bisect: `linkwatch replay FILE.mcap`, whose summary names the first violation
--bonds, --closed, --counts, --one-motion, --topic: `linkwatch check`, which has this option
--by-time: `linkwatch diff FIRST.mcap SECOND.mcap --by-time`
--connect: --show HOST:PORT
--device: `linkwatch certify --device`; other commands choose it
--diameter: --frames N,diameter=D
--diff: `linkwatch diff FIRST.mcap SECOND.mcap`
--diff-curves, --diff-pairs: --json, which prints all changes
--discretize: `linkwatch convert MODEL OUT.obj`, then `linkwatch certify OUT.obj`
--kernel: `linkwatch certify --kernel`; other commands choose it
--motion: --frames N,motion=MOTION
--order: --kernel fmm,order=P, of `linkwatch certify`
--paranoid: Strategy::Paranoid, in a program that uses the library
--publish: `linkwatch play FILE --service NAME`
--pull: --frames N,pull=SEQ
--record-every: --record FILE.mcap,every=N
--record-for: `linkwatch replay FILE.mcap --show FILE.rrd`
--record-keep: --record FILE.mcap,window=SECONDS, or a program that deletes old files
--record-max: --record FILE.mcap,max=SIZE
--record-window: --record FILE.mcap,window=SECONDS
--record-window-memory: --record FILE.mcap,window=SECONDS,memory=SIZE
--rrd: --show FILE.rrd
--self: --events=all
--serve: --show web
--target: --kernel barnes-hut,beta=B,target=E, of `linkwatch certify`
--thickness: --radius
--unwrapped: --wrapped=false
--view: --show live
--view-every: --show WHERE,every=N
--view-only: hide the curves without findings in the viewer (curves/intact)
--wait-mode: nothing: a watch sleeps until a frame arrives
--write-loops: BraidLoops, in a program that uses the library
";

/// Returns the rows of a table: a key and its text.
fn rows(table: &'static str) -> impl Iterator<Item = (&'static str, &'static str)> {
    table.lines().filter_map(|row| row.split_once(": "))
}

/// Parses the arguments, the first of which is the name of the program.
pub fn parse(args: impl IntoIterator<Item = OsString>) -> Result<Cli, Error> {
    let args: Vec<OsString> = args.into_iter().collect();
    let is_events = |word: &str| word.parse::<linkwatch::Events>().is_ok();
    let value =
        |pair: &&[OsString]| pair[0] == "--events" && pair[1].to_str().is_some_and(is_events);
    if let Some(value) = args.windows(2).find(value) {
        // It would be taken as the name of a file.
        let value = value[1].display();
        let words = format!("write --events={value}, with an equals sign\n");
        return Err(Error::raw(ErrorKind::ValueValidation, words));
    }
    let command = with_negative_numbers(Cli::command());
    let parsed = command.try_get_matches_from(args);
    let parsed = parsed.and_then(|matches| Cli::from_arg_matches(&matches));
    parsed.map_err(in_words)
}

/// Lets all options take a negative number, so that the error names the option and its range.
fn with_negative_numbers(command: Command) -> Command {
    let command = command.mut_args(|arg| {
        let takes_values = arg.get_action().takes_values() && !arg.is_positional();
        let is_limited = takes_values && !arg.is_allow_hyphen_values_set();
        arg.allow_negative_numbers(is_limited)
    });
    command.mut_subcommands(with_negative_numbers)
}

/// Rewrites an error that only a programmer understands, and removes a tip that never helps: to
/// pass an unknown option as a file name.
fn in_words(mut error: Error) -> Error {
    if let Some((name, instead)) = gone(&error) {
        let words = format!("{name} is gone; instead: {instead}\n");
        return Error::raw(error.kind(), words);
    }
    if error.kind() == ErrorKind::UnknownArgument {
        error.remove(ContextKind::Suggested);
    }
    if error.kind() != ErrorKind::ValueValidation {
        return error;
    }
    let text = error.render().to_string();
    match rows(IN_WORDS).find(|(technical, _)| text.contains(technical)) {
        Some((technical, words)) => {
            let text = text.replace(technical, words);
            let text = text.strip_prefix("error: ").unwrap_or(&text);
            Error::raw(ErrorKind::ValueValidation, text)
        }
        None => error,
    }
}

/// Returns the removed command or option that an error names, and its replacement.
fn gone(error: &Error) -> Option<(&str, &'static str)> {
    let unknown = match error.kind() {
        ErrorKind::InvalidSubcommand => error.get(ContextKind::InvalidSubcommand),
        ErrorKind::UnknownArgument => error.get(ContextKind::InvalidArg),
        _ => None,
    };
    match unknown? {
        ContextValue::String(unknown) => {
            let mut rows = rows(GONE);
            let row = rows.find(|(names, _)| names.split(", ").any(|name| name == unknown));
            row.map(|(_, instead)| (unknown.as_str(), instead))
        }
        _ => None,
    }
}
