//! Runs of the command `linkwatch`.

use std::path::Path;
use std::process::{Command, Output, Stdio};

/// A finished run.
#[derive(Debug)]
pub struct Run {
    pub code: i32,
    pub stdout: String,
    pub stderr: String,
}

impl From<Output> for Run {
    fn from(output: Output) -> Run {
        let text = |bytes| String::from_utf8(bytes).expect("the output is UTF-8");
        Run {
            code: output.status.code().expect("no signal ended the command"),
            stdout: text(output.stdout),
            stderr: text(output.stderr),
        }
    }
}

/// Returns the command of this build, without arguments.
pub fn command() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_linkwatch"));
    command.stdin(Stdio::null());
    command
}

/// Runs the command.
pub fn linkwatch(args: &[&str]) -> Run {
    let output = command().args(args).output();
    output.expect("the command starts").into()
}

/// Returns a path as an argument.
pub fn text(path: &Path) -> &str {
    path.to_str().expect("the path is UTF-8")
}
