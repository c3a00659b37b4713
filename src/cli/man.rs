//! `linkwatch man`: the help as manual pages.

use super::{Cli, Outcome, output};
use clap::{Command, CommandFactory};
use clap_mangen::Man;
use linkwatch::Result;

/// Runs the command.
pub fn run() -> Result<Outcome> {
    let mut command = complete(Cli::command()).disable_help_subcommand(true);
    command.build();
    let mut page = Vec::new();
    Man::new(command.clone()).render(&mut page)?;
    // The exit codes are the only text after the options.
    let mut page = text(page)?.replace(".SH EXTRA", ".SH \"EXIT STATUS\"");
    for command in descendants(&command) {
        page += &section(command)?;
    }
    output::line(page.trim_end());
    Ok(Outcome::Fine)
}

/// Returns a command whose pages contain all options, including those that `-h` hides.
fn complete(command: Command) -> Command {
    let command = command.mut_args(|arg| arg.hide_short_help(false));
    command.mut_subcommands(complete)
}

/// Returns the subcommands of a command, each followed by its own.
fn descendants(command: &Command) -> Vec<&Command> {
    let own = command.get_subcommands();
    let all = own.flat_map(|c| std::iter::once(c).chain(descendants(c)));
    all.collect()
}

/// Returns a command as a section of a page. Its headings become those of subsections.
fn section(command: &Command) -> Result<String> {
    let man = Man::new(command.clone());
    let mut parts = Vec::new();
    man.render_synopsis_section(&mut parts)?;
    man.render_description_section(&mut parts)?;
    // Options that all commands share are already on the page.
    let own = command.clone().mut_args(|arg| {
        let shared = arg.is_global_set();
        arg.hide(shared)
    });
    Man::new(own).render_options_section(&mut parts)?;
    let name = command.get_bin_name().unwrap_or_default().to_uppercase();
    let parts = text(parts)?.replace("\n.SH ", "\n.SS ");
    let parts = parts.replacen(".SH ", ".SS ", 1);
    Ok(format!(".SH \"{name}\"\n{parts}"))
}

fn text(page: Vec<u8>) -> Result<String> {
    String::from_utf8(page).map_err(|e| usage!("the page is not valid UTF-8: {e}"))
}
