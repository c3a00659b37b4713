//! `linkwatch completions`: prints a completion script for a shell.

use super::{Cli, Outcome, output};
use clap::CommandFactory;
use clap_complete::Shell;
use linkwatch::Result;

/// Print a script that lets a shell complete the commands and options
///
/// For bash: `linkwatch completions bash > ~/.local/share/bash-completion/completions/linkwatch`.
/// For zsh: the file `_linkwatch` in a folder of `$fpath`. For fish:
/// `~/.config/fish/completions/linkwatch.fish`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The shell that reads the script
    #[arg(value_name = "SHELL")]
    shell: Shell,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<Outcome> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut Cli::command(), "linkwatch", &mut script);
    output::line(String::from_utf8_lossy(&script).trim_end());
    Ok(Outcome::Fine)
}
