//! Parsing of the command line, with errors in plain words.

use super::Cli;
use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{Arg, Command, CommandFactory, Error, FromArgMatches};
use std::ffi::OsString;

/// Errors of the standard library for numbers, and what they mean.
const IN_WORDS: [(&str, &str); 6] = [
    ("invalid digit found in string", "expected a whole number"),
    (
        "cannot parse integer from empty string",
        "expected a whole number",
    ),
    (
        "number too large to fit in target type",
        "the number is too large",
    ),
    (
        "number too small to fit in target type",
        "the number is too small",
    ),
    ("invalid float literal", "expected a number"),
    ("cannot parse float from empty string", "expected a number"),
];

/// Commands and options of earlier versions, and what to use instead.
const GONE: [(&str, &str); 43] = [
    (
        "plan",
        "`linkwatch certify --explain MODEL` prints the plan",
    ),
    ("study", STUDY),
    ("sweep", STUDY),
    ("--repeat", STUDY),
    ("--measure", STUDY),
    ("--calibrate", STUDY),
    ("--against", "--baseline"),
    ("--amplitude", "--frames N,amplitude=A"),
    (
        "--beta",
        "--kernel barnes-hut,beta=B, of `linkwatch certify`",
    ),
    (
        "--by-time",
        "`linkwatch diff FIRST.mcap SECOND.mcap --by-time`",
    ),
    ("--connect", "--show HOST:PORT"),
    (
        "--device",
        "`linkwatch certify --device`; other commands choose it",
    ),
    ("--diff", "`linkwatch diff FIRST.mcap SECOND.mcap`"),
    ("--diameter", "--frames N,diameter=D"),
    ("--diff-curves", "--json, which prints all changes"),
    ("--diff-pairs", "--json, which prints all changes"),
    (
        "--kernel",
        "`linkwatch certify --kernel`; other commands choose it",
    ),
    ("--motion", "--frames N,motion=MOTION"),
    ("--order", "--kernel fmm,order=P, of `linkwatch certify`"),
    (
        "--paranoid",
        "Strategy::Paranoid, in a program that uses the library",
    ),
    ("--publish", "`linkwatch play FILE --service NAME`"),
    ("--pull", "--frames N,pull=SEQ"),
    ("--record-every", "--record FILE.mcap,every=N"),
    (
        "--record-for",
        "`linkwatch replay FILE.mcap --show FILE.rrd`",
    ),
    ("--record-keep", "--record FILE.mcap,max=SIZE,keep=K"),
    ("--record-max", "--record FILE.mcap,max=SIZE"),
    ("--record-window", "--record FILE.mcap,window=SECONDS"),
    (
        "--record-window-memory",
        "--record FILE.mcap,window=SECONDS,memory=SIZE",
    ),
    ("--rrd", "--show FILE.rrd"),
    ("--self", "--events=all"),
    ("--serve", "--show web"),
    (
        "--target",
        "--kernel barnes-hut,beta=B,target=E, of `linkwatch certify`",
    ),
    ("--thickness", "--radius"),
    ("--unwrapped", "--wrapped=false"),
    ("--bonds", CHECK),
    ("--closed", CHECK),
    ("--counts", CHECK),
    ("--one-motion", CHECK),
    ("--topic", CHECK),
    ("--view", "--show live"),
    ("--view-every", "--show WHERE,every=N"),
    ("--view-only", "--show WHERE,only=violated"),
    (
        "--wait-mode",
        "nothing: a watch sleeps until a frame arrives",
    ),
];

const CHECK: &str = "`linkwatch check` reads files that need it";

const STUDY: &str = "measurements are commands for developers, in a clone of linkwatch: `cargo run \
                     --release -p study -- --help` (benches/study)";

/// Parses the arguments, the first of which is the name of the program.
pub fn parse(args: impl IntoIterator<Item = OsString>) -> Result<Cli, Error> {
    let args: Vec<OsString> = args.into_iter().collect();
    let value =
        |pair: &&[OsString]| pair[0] == "--events" && pair[1].to_str().is_some_and(is_events);
    if let Some(value) = args.windows(2).find(value) {
        // It would be taken as the name of a file.
        let words = format!(
            "write --events={}, with an equals sign\n",
            value[1].display()
        );
        return Err(Error::raw(ErrorKind::ValueValidation, words));
    }
    let command = with_negative_numbers(Cli::command());
    let parsed = command.try_get_matches_from(args);
    let parsed = parsed.and_then(|matches| Cli::from_arg_matches(&matches));
    parsed.map_err(in_words)
}

fn is_events(word: &str) -> bool {
    word.parse::<linkwatch::Events>().is_ok()
}

/// Lets all options take a negative number, so that the error names the option and its range.
fn with_negative_numbers(command: Command) -> Command {
    let takes_values = |arg: &Arg| arg.get_action().takes_values() && !arg.is_positional();
    let command =
        command.mut_args(
            |arg| match takes_values(&arg) && !arg.is_allow_hyphen_values_set() {
                true => arg.allow_negative_numbers(true),
                false => arg,
            },
        );
    command.mut_subcommands(with_negative_numbers)
}

/// Rewrites an error that only a programmer understands, and removes a tip that never helps: to
/// pass an unknown option as a file name.
fn in_words(mut error: Error) -> Error {
    if let Some((name, instead)) = gone(&error) {
        return Error::raw(
            error.kind(),
            format!("{name} is gone; instead: {instead}\n"),
        );
    }
    if error.kind() == ErrorKind::UnknownArgument {
        error.remove(ContextKind::Suggested);
    }
    if error.kind() != ErrorKind::ValueValidation {
        return error;
    }
    let text = error.render().to_string();
    let known = IN_WORDS
        .iter()
        .find(|(technical, _)| text.contains(technical));
    match known {
        Some((technical, words)) => {
            let text = text.replace(technical, words);
            let text = text.strip_prefix("error: ").unwrap_or(&text);
            Error::raw(ErrorKind::ValueValidation, text)
        }
        None => error,
    }
}

/// Returns the command or the option of an error that is gone, and what to use instead.
fn gone(error: &Error) -> Option<&'static (&'static str, &'static str)> {
    let unknown = [ContextKind::InvalidSubcommand, ContextKind::InvalidArg];
    let unknown = unknown.into_iter().find_map(|kind| error.get(kind))?;
    let ContextValue::String(unknown) = unknown else {
        return None;
    };
    match error.kind() {
        ErrorKind::InvalidSubcommand | ErrorKind::UnknownArgument => {
            GONE.iter().find(|(name, _)| name == unknown)
        }
        _ => None,
    }
}
