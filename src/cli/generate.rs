//! `linkwatch generate`: writes scenes with known linking numbers as model files.

use super::Outcome;
use super::files::{Content, Files, Overwrite, write_text, write_whole};
use super::output::{self, count, millis, plural};
use linkwatch::scenes::{KINDS, Kind, Scene};
use linkwatch::{Result, model};
use serde_json::json;
use std::path::PathBuf;
use std::time::Instant;

/// Generate a scene of any size, with its exact certificate
///
/// A scene is a name, followed by the parameters that differ from their defaults, for example
/// `ribbon:segments=2e7,lambda=1000`. The same scene always gives the same file.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The scene; without one, all scenes are listed
    #[arg(value_name = "SCENE", requires = "output")]
    scene: Option<Scene>,
    /// List all scenes with their parameters
    #[arg(long, conflicts_with = "scene")]
    list: bool,
    /// Write the model, a .bcc file
    #[arg(short, long, help_heading = super::WRITE, value_name = "FILE", requires = "scene")]
    output: Option<PathBuf>,
    /// Write the certificate that follows from the construction
    #[arg(long, value_name = "CERT", requires = "scene", help_heading = super::WRITE)]
    certificate: Option<PathBuf>,
    #[command(flatten)]
    overwrite: Overwrite,
}

/// Runs the command.
pub fn run(args: &Args, as_json: bool) -> Result<Outcome> {
    let (Some(scene), Some(path)) = (&args.scene, &args.output) else {
        list(as_json);
        return Ok(Outcome::Fine);
    };
    let mut files = Files::new(args.overwrite);
    files.writes("-o", path, Content::Scene)?;
    if let Some(file) = &args.certificate {
        files.writes("--certificate", file, Content::Text)?;
    }
    let start = Instant::now();
    let generated = scene.build()?;
    write_whole(path, args.overwrite, |part| {
        model::write_bcc(part, &generated.curves)
    })?;
    if let Some(file) = &args.certificate {
        write_text(file, args.overwrite, &generated.certificate.to_string())?;
    }
    let (curves, links) = (&generated.curves, &generated.certificate.links);
    tracing::info!(
        "{}: wrote {} of {}, {} ({})",
        path.display(),
        plural(curves.len() as u64, "curve"),
        plural(curves.segments() as u64, "segment"),
        plural(links.len() as u64, "link"),
        millis(start.elapsed()),
    );
    if let Some(file) = &args.certificate {
        tracing::info!("{}: written", file.display());
    }
    if as_json {
        output::json(&json!({
            "scene": scene.to_string(),
            "model": path,
            "basis": curves.basis(),
            "curves": curves.len(),
            "segments": curves.segments(),
            "links": links.len(),
            "certificate": args.certificate,
            "ms": start.elapsed().as_secs_f64() * 1e3,
        }));
    }
    Ok(Outcome::Fine)
}

fn list(as_json: bool) {
    for Kind {
        name,
        purpose,
        parameters,
        ..
    } in &KINDS
    {
        if as_json {
            let parameters: Vec<_> = parameters
                .iter()
                .map(|p| {
                    json!({
                        "name": p.name,
                        "meaning": p.meaning,
                        "default": p.default,
                        "min": p.min,
                        "max": p.max,
                        "integer": p.integer,
                    })
                })
                .collect();
            output::json(&json!({ "name": name, "purpose": purpose, "parameters": parameters }));
            continue;
        }
        output::line(format_args!("{name}: {purpose}"));
        for p in *parameters {
            let default = format!("{}={}", p.name, p.default);
            let (min, max) = match p.integer {
                true => (signed(p.min), signed(p.max)),
                false => (p.min.to_string(), p.max.to_string()),
            };
            output::line(format_args!(
                "  {default:20} {} ({min} to {max})",
                p.meaning
            ));
        }
    }
}

/// Formats an integer with separators, `-1,000,000`.
fn signed(x: f64) -> String {
    let sign = if x < 0.0 { "-" } else { "" };
    format!("{sign}{}", count(x.abs() as u64))
}
