//! `linkwatch report`: what a recorded run showed, for people without a viewer.

use super::files::{Content, Files, Overwrite, write_text};
use super::output::{self, count, plural};
use super::{Outcome, input};
use linkwatch::{Conclusion, Error, Result, RunReport};
use std::path::{Path, PathBuf};

/// Write what happened in a recording to an HTML page: a sentence, a timeline, tables, plots, and
/// pictures of the worst violations and of the lowest clearance
///
/// The page is one file without scripts and external resources. It reports the recorded verdicts;
/// `linkwatch replay` verifies them again. A recording that was cut off is reported up to its end.
/// The exit code is that of the recorded verdicts: 0 intact, or every violation was rolled back or
/// accepted; 1 changed; 3 undecided, or frames are missing from the recording or were not verified.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// A recording, as written by `linkwatch watch --record`
    #[arg(value_name = "FILE.mcap")]
    recording: PathBuf,
    /// The page [default: the name of the recording with .html, in the current folder; none with
    /// --text, --svg or --json]
    #[arg(short, long, value_name = "FILE.html", help_heading = super::WRITE)]
    output: Option<PathBuf>,
    /// Draw the violations with pictures, each before, at and after its frame, as
    /// `violation-1.svg`, .. in a folder, which is created
    #[arg(long, value_name = "FOLDER", help_heading = super::WRITE)]
    svg: Option<PathBuf>,
    /// Print the report as plain text
    #[arg(long, help_heading = super::WRITE, conflicts_with = "json")]
    text: bool,
    #[command(flatten)]
    overwrite: Overwrite,
}

/// Runs the command.
pub fn run(args: &Args, json: bool) -> Result<Outcome> {
    let has_other = args.text || json || args.svg.is_some();
    let name = Path::new(args.recording.file_name().unwrap_or_default());
    let of_name = || (!has_other).then(|| name.with_extension("html"));
    let page = args.output.clone().or_else(of_name);
    if !input::is_mcap(&args.recording) {
        input::check_recording(&args.recording)?;
    }
    let mut files = Files::new(args.overwrite);
    files.reads([&args.recording]);
    if let Some(path) = &page {
        files.writes("-o", [path], Content::Text)?;
        if path.extension().is_none_or(|e| e != "html" && e != "htm") {
            let path = path.display();
            return Err(usage!(
                "-o {path}: the page is HTML: name it .html (--text prints words)"
            ));
        }
    }
    let report = RunReport::read(&args.recording)?;
    if json {
        output::json(&report.json());
    } else if args.text {
        output::line(&report);
    } else {
        output::line(report.sentence());
    }
    let drawn = plural(report.figures(), "violation");
    if let Some(path) = &page {
        let html = report.html();
        write_text(path, args.overwrite, &html)?;
        let size = count(html.len().div_ceil(1000));
        tracing::info!("{}: {size} kB, pictures of {drawn}", path.display());
    }
    if let Some(folder) = &args.svg {
        std::fs::create_dir_all(folder).map_err(Error::file(folder))?;
        for (k, picture) in report.pictures().enumerate() {
            let path = folder.join(format!("violation-{}.svg", k + 1));
            write_text(&path, args.overwrite, &picture)?;
        }
        tracing::info!("{}: pictures of {drawn}", folder.display());
    }
    Ok(match report.conclusion() {
        Conclusion::Intact | Conclusion::Recovered | Conclusion::Accepted => Outcome::Fine,
        Conclusion::Changed => Outcome::Changed,
        _ => Outcome::Undecided,
    })
}
