//! `linkwatch generate`: writes scenes with known linking numbers as model files.

use super::Outcome;
use super::files::{Content, Files, Overwrite, write_text, write_whole};
use super::motion_args::MotionArgs;
use super::output::{self, count, millis, plural};
use linkwatch::model::{Format, FrameWriter, ModelFrame};
use linkwatch::scenes::{KINDS, Kind, MovingScene, Scene};
use linkwatch::{CurveSet, Error, Result, model};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Generate a scene of any size, with its exact certificate
///
/// A scene is a name, followed by the parameters that differ from their defaults, for example
/// `ribbon:segments=2e7,lambda=1000`. The same scene always gives the same file. With --frames it
/// moves, and the file has all frames; memory is that of a few frames, however many there are.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The scene; without one, all scenes are listed
    #[arg(value_name = "SCENE", requires = "output")]
    scene: Option<Scene>,
    /// List all scenes with their parameters
    #[arg(long, conflicts_with = "scene")]
    list: bool,
    /// Write the model, a .bcc file; with --frames a file that holds several frames, .npz for
    /// example
    #[arg(short, long, help_heading = super::WRITE, value_name = "FILE", requires = "scene")]
    output: Option<PathBuf>,
    /// Write the certificate that follows from the construction
    #[arg(long, value_name = "CERT", requires = "scene", help_heading = super::WRITE)]
    certificate: Option<PathBuf>,
    /// Write this number of frames, in which the scene moves
    #[arg(
        long, value_name = "N", requires = "scene",
        value_parser = clap::value_parser!(u64).range(1..)
    )]
    frames: Option<u64>,
    #[command(flatten)]
    motion: MotionArgs,
    /// From this frame on, the two nearest curves that pass crosswise are pulled through one
    /// another
    #[arg(long, value_name = "SEQ", requires = "frames")]
    pull: Option<u64>,
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
    let moving = moving(args, scene)?;
    let format = moving.as_ref().map(|_| frame_format(path)).transpose()?;
    let content = match moving {
        Some(_) => Content::Model,
        None => Content::Scene,
    };
    files.writes("-o", path, content)?;
    if let Some(file) = &args.certificate {
        files.writes("--certificate", file, Content::Text)?;
    }
    let start = Instant::now();
    let generated = scene.build()?;
    let (curves, links) = (generated.curves, generated.certificate.links.len());
    if let Some(file) = &args.certificate {
        write_text(file, args.overwrite, &generated.certificate.to_string())?;
    }
    let (sizes, basis) = ([curves.len(), curves.segments()], curves.basis());
    let sizes = sizes.map(|n| n as u64);
    let mut frames = None;
    match moving.zip(format) {
        Some((moving, format)) => {
            frames = Some(moving.frames);
            write_whole(path, args.overwrite, |part| {
                write_frames(part, format, &moving, curves)
            })?;
        }
        None => write_whole(path, args.overwrite, |part| model::write_bcc(part, &curves))?,
    }
    tracing::info!(
        "{}: wrote {}{} of {}, {} ({})",
        path.display(),
        frames.map_or(String::new(), |n| format!("{} of ", plural(n, "frame"))),
        plural(sizes[0], "curve"),
        plural(sizes[1], "segment"),
        plural(links as u64, "link"),
        millis(start.elapsed()),
    );
    if let Some(file) = &args.certificate {
        tracing::info!("{}: written", file.display());
    }
    if as_json {
        output::json(&json!({
            "scene": scene.to_string(),
            "model": path,
            "basis": basis,
            "curves": sizes[0],
            "segments": sizes[1],
            "frames": frames,
            "links": links,
            "certificate": args.certificate,
            "ms": start.elapsed().as_secs_f64() * 1e3,
        }));
    }
    Ok(Outcome::Fine)
}

/// Returns the motion of the scene, if it has several frames.
fn moving(args: &Args, scene: &Scene) -> Result<Option<MovingScene>> {
    let Some(frames) = args.frames else {
        return match args.motion.are_given() {
            true => {
                let what = "--motion, --amplitude and --diameter move frames: give --frames N";
                Err(Error::Usage(what.into()))
            }
            false => Ok(None),
        };
    };
    if let Some(pull) = args.pull.filter(|&pull| pull >= frames) {
        let what = format!("--pull {pull}: there are {}", plural(frames, "frame"));
        return Err(Error::Usage(format!("{what}, numbered from 0")));
    }
    Ok(Some(MovingScene {
        pull: args.pull,
        ..args.motion.moving(scene, frames)?
    }))
}

/// Returns the format of a file that can hold several frames.
fn frame_format(path: &Path) -> Result<Format> {
    let format = Format::to_write(path)?;
    if format.holds_frames() {
        return Ok(format);
    }
    let what = "holds one frame: name it .npz or .npy";
    Err(Error::Usage(format!("-o {}: {what}", path.display())))
}

/// Writes the frames one by one.
fn write_frames(path: &Path, format: Format, moving: &MovingScene, curves: CurveSet) -> Result<()> {
    let mut writer = FrameWriter::create(path, format)?;
    let bar = output::bar(moving.frames, "frames");
    moving.play(curves, |seq, curves| {
        let mut frame = ModelFrame::new(seq, Ok(curves));
        frame.time = seq as f64;
        writer.frame(&frame)?;
        bar.inc(1);
        frame.curves
    })?;
    bar.finish_and_clear();
    writer.finish()
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
