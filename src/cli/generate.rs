//! `linkwatch generate`: writes scenes with known linking numbers as model files.

use super::Outcome;
use super::files::{Content, Files, Overwrite, write_text, write_whole};
use super::live::Live;
use super::number::{not_negative, number, positive};
use super::output::{self, count, millis, plural};
use super::settings::{parsed, split};
use linkwatch::formats::{Format, FrameWriter, ModelFrame};
use linkwatch::scenes::{KINDS, Motion, MotionKind, MovingScene, Scene};
use linkwatch::{CurveSet, Error, Result, formats};
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
    ///
    /// Settings follow: `100,motion=iid,amplitude=0.1`. motion: still, smooth (unless given), iid,
    /// translate, rotate, stretch, scale, or several joined by `+`; amplitude: in diameters (0.05);
    /// diameter: of the yarn, in units of the scene (that of the scene, if it has one); pull=SEQ:
    /// from this frame on, the two nearest curves that pass crosswise are pulled through one
    /// another
    #[arg(long, value_name = "N[,..]", requires = "scene", value_parser = moving)]
    frames: Option<Moving>,
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
    let (moving, content) = match &args.frames {
        Some(frames) => (
            Some((frames.of(scene)?, frame_format(path)?)),
            Content::Model,
        ),
        None => (None, Content::Scene),
    };
    files.writes("-o", [path], content)?;
    files.writes("--certificate", &args.certificate, Content::Text)?;
    let start = Instant::now();
    let generated = scene.build()?;
    let (curves, links) = (generated.curves, generated.certificate.links.len());
    if let Some(file) = &args.certificate {
        write_text(file, args.overwrite, &generated.certificate.to_string())?;
    }
    let (sizes, basis) = ([curves.len(), curves.segments()], curves.basis());
    write_whole(path, args.overwrite, |part| match &moving {
        Some((moving, format)) => write_frames(part, *format, moving, curves),
        None => formats::write_bcc(part, &curves),
    })?;
    let frames = moving.map(|(moving, _)| moving.frames);
    tracing::info!(
        "{}: wrote {}{} of {}, {} ({})",
        path.display(),
        frames.map_or(String::new(), |n| format!("{} of ", plural(n, "frame"))),
        plural(sizes[0], "curve"),
        plural(sizes[1], "segment"),
        plural(links, "link"),
        millis(start.elapsed()),
    );
    if let Some(file) = &args.certificate {
        tracing::info!("{}: written", file.display());
    }
    if as_json {
        output::json(&json!({
            "scene": scene.to_string(),
            "model": path.to_string_lossy(),
            "basis": basis,
            "curves": sizes[0],
            "segments": sizes[1],
            "frames": frames,
            "links": links,
            "certificate": args.certificate.as_ref().map(|path| path.to_string_lossy()),
            "ms": output::milliseconds(start.elapsed()),
        }));
    }
    Ok(Outcome::Fine)
}

/// Frames of a scene that moves.
#[derive(Clone, Debug)]
struct Moving {
    frames: u64,
    motion: Motion,
    /// Amplitude of the motion, in diameters.
    amplitude: f64,
    diameter: Option<f64>,
    pull: Option<u64>,
}

/// Parses a number of frames, and the settings of the motion.
fn moving(text: &str) -> Result<Moving, String> {
    let (frames, settings) = split(text, &["motion", "amplitude", "diameter", "pull"])?;
    let frames = number(frames, "a number of frames, at least 1", |n: &u64| *n > 0)?;
    // The error of a motion needs no name.
    let motion = parsed(&settings, "motion", |text| Ok(text.parse()))?;
    let motion = motion.unwrap_or(Ok(MotionKind::Smooth.into()));
    let expected = format!("a frame from 1 to {}", frames - 1);
    let pull = |text: &str| number(text, &expected, |n: &u64| (1..frames).contains(n));
    Ok(Moving {
        frames,
        motion: motion.map_err(|e: Error| e.to_string())?,
        amplitude: parsed(&settings, "amplitude", not_negative)?.unwrap_or(0.05),
        diameter: parsed(&settings, "diameter", positive)?,
        pull: parsed(&settings, "pull", pull)?,
    })
}

impl Moving {
    /// Returns the motion of a scene.
    fn of(&self, scene: &Scene) -> Result<MovingScene> {
        let length = self.diameter.or(scene.value("diameter")).ok_or_else(|| {
            let name = scene.kind().name;
            let what =
                "has no diameter, the unit of the motion: give it, `--frames 9,diameter=0.2`";
            usage!("{name} {what}")
        })?;
        Ok(MovingScene {
            motion: self.motion.clone(),
            length,
            amplitude: self.amplitude * length,
            frames: self.frames,
            pull: self.pull,
        })
    }
}

/// Returns the format of a file that can hold several frames.
fn frame_format(path: &Path) -> Result<Format> {
    let format = Format::to_write(path)?;
    if format.holds_frames() {
        return Ok(format);
    }
    let what = "holds one frame: name it .npz or .npy";
    Err(usage!("-o {}: {what}", path.display()))
}

/// Writes the frames one by one.
fn write_frames(path: &Path, format: Format, moving: &MovingScene, curves: CurveSet) -> Result<()> {
    let mut writer = FrameWriter::create(path, format)?;
    let (live, frames) = (Live::default(), moving.frames);
    moving.play(curves, |seq, curves| {
        let mut frame = ModelFrame::new(seq, Ok(curves));
        frame.info.time = seq as f64;
        writer.frame(&frame)?;
        live.status(format_args!("frame {seq} of {frames}"));
        frame.curves
    })?;
    live.clear();
    writer.finish()
}

fn list(as_json: bool) {
    for kind in &KINDS {
        if as_json {
            output::json(&json!(kind));
            continue;
        }
        out!("{}: {}", kind.name, kind.purpose);
        for p in kind.parameters {
            let default = format!("{}={}", p.name, p.default);
            let show = |x: f64| if p.integer { signed(x) } else { x.to_string() };
            let [min, max] = [p.min, p.max].map(show);
            out!("  {default:20} {} ({min} to {max})", p.meaning);
        }
    }
}

/// Formats an integer with separators, `-1,000,000`.
fn signed(x: f64) -> String {
    let sign = if x < 0.0 { "-" } else { "" };
    format!("{sign}{}", count(x.abs() as u64))
}
