//! Parsing of the command line, with errors in plain words.

use super::Cli;
use clap::error::{ContextKind, ErrorKind};
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
    if error.kind() == ErrorKind::UnknownArgument {
        error.remove(ContextKind::Suggested);
    }
    if error.kind() != ErrorKind::ValueValidation {
        return error;
    }
    let text = error.render().to_string();
    match IN_WORDS
        .iter()
        .find(|(technical, _)| text.contains(*technical))
    {
        Some((technical, words)) => {
            let text = text.replace(technical, words);
            let text = text.strip_prefix("error: ").unwrap_or(&text);
            Error::raw(ErrorKind::ValueValidation, text)
        }
        None => error,
    }
}
