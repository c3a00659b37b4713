//! `linkwatch man`: the help as manual pages.

use super::files::{Content, Files, Overwrite, write_text};
use super::{Cli, Outcome, output};
use clap::{Command, CommandFactory};
use clap_mangen::Man;
use linkwatch::{Error, Result};
use std::path::PathBuf;

/// Print the manual page, with all commands
///
/// `linkwatch man | man -l -` shows it.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Write a page for each command to a folder instead, `linkwatch.1`, `linkwatch-watch.1` ..
    #[arg(long, value_name = "FOLDER", help_heading = super::WRITE)]
    out: Option<PathBuf>,
    #[command(flatten)]
    overwrite: Overwrite,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<Outcome> {
    let mut command = complete(Cli::command()).disable_help_subcommand(true);
    command.build();
    let Some(folder) = &args.out else {
        let mut page = page(&command)?;
        for command in descendants(&command) {
            page += &section(command)?;
        }
        output::line(page.trim_end());
        return Ok(Outcome::Fine);
    };
    std::fs::create_dir_all(folder).map_err(|e| Error::Io(e).in_file(folder))?;
    let mut files = Files::new(args.overwrite);
    let mut pages = Vec::new();
    for command in std::iter::once(&command).chain(descendants(&command)) {
        let file = folder.join(Man::new(command.clone()).get_filename());
        files.writes("--out", [&file], Content::Text)?;
        pages.push((file, page(command)?));
    }
    for (file, page) in &pages {
        write_text(file, args.overwrite, page)?;
    }
    tracing::info!("{}: {} pages written", folder.display(), pages.len());
    Ok(Outcome::Fine)
}

/// Returns a command whose pages contain all options, including those that `-h` hides.
fn complete(command: Command) -> Command {
    command
        .mut_args(|arg| arg.hide_short_help(false))
        .mut_subcommands(complete)
}

/// Returns the subcommands of a command, each followed by its own.
fn descendants(command: &Command) -> Vec<&Command> {
    let own = command.get_subcommands();
    own.flat_map(|c| std::iter::once(c).chain(descendants(c)))
        .collect()
}

/// Returns the page of a command.
fn page(command: &Command) -> Result<String> {
    let mut page = Vec::new();
    Man::new(command.clone()).render(&mut page)?;
    // The exit codes are the only text after the options.
    Ok(text(page)?.replace(".SH EXTRA", ".SH \"EXIT STATUS\""))
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
    Ok(format!(
        ".SH \"{name}\"\n{}",
        parts.replacen(".SH ", ".SS ", 1)
    ))
}

fn text(page: Vec<u8>) -> Result<String> {
    String::from_utf8(page).map_err(|e| Error::Usage(format!("the page is not valid UTF-8: {e}")))
}
