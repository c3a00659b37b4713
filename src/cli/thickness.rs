//! `linkwatch thickness`: measures how sharply curves bend and how close they come.

use super::number::positive;
use super::output::{self, percent, plural};
use super::{Outcome, input};
use linkwatch::{Result, Strut, Thickness, struts};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Maximum number of struts or overlaps that are printed; the rest is counted.
const SENTENCES: usize = 20;

/// Measure thickness and ropelength of polylines: how sharply they bend, and how close they come
///
/// The thickness is the diameter of the thickest tube around all curves that neither bends too
/// sharply nor overlaps: min{2 minRad, POCA}, as in Ashton and Cantarella 2005. liboctrope returns
/// its radius, half of that. The ropelength is the length divided by the thickness.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Models (.bcc, .obj lines or .vect), or scenes as `linkwatch generate` takes them
    #[arg(required = true, value_name = "MODEL|SCENE")]
    models: Vec<PathBuf>,
    /// List the struts (places of closest approach) that are longer than the shortest one by at
    /// most this share, for example 0.01
    #[arg(long, value_name = "F", value_parser = positive)]
    struts: Option<f64>,
    /// Radius of the strands: list the places where two of them, or one and itself, overlap
    #[arg(long, value_name = "R", value_parser = positive)]
    radius: Option<f64>,
    /// Stiffness of the tube: 2 minRad is divided by it
    #[arg(long, value_name = "LAMBDA", default_value_t = 1.0, value_parser = positive)]
    stiffness: f64,
}

/// Results of one model.
struct Measured {
    found: Thickness,
    extent: f64,
    /// Struts of --struts.
    struts: Option<Vec<Strut>>,
    /// Struts that are shorter than the diameter of --radius.
    overlaps: Option<Vec<Strut>>,
}

/// Runs the command.
pub fn run(args: &Args, json: bool) -> Result<Outcome> {
    for path in &args.models {
        let measured = measure(path, args)?;
        match json {
            true => output::json(&to_json(path, &measured, args)),
            false => print(path, &measured, args),
        }
    }
    Ok(Outcome::Fine)
}

fn measure(path: &Path, args: &Args) -> Result<Measured> {
    let set = input::read(path)?;
    let found = Thickness::of(&set)?;
    let shortest = found.poca.map(|strut| strut.length);
    let listed = args.struts.zip(shortest);
    let listed = listed.map(|(share, shortest)| struts(&set, (1.0 + share) * shortest));
    let overlaps = args.radius.map(|radius| {
        let mut all = struts(&set, 2.0 * radius)?;
        all.retain(|strut| strut.length < 2.0 * radius);
        Ok::<_, linkwatch::Error>(all)
    });
    Ok(Measured {
        found,
        extent: set.extent(),
        struts: listed.transpose()?,
        overlaps: overlaps.transpose()?,
    })
}

fn print(path: &Path, measured: &Measured, args: &Args) {
    let Measured { found, extent, .. } = measured;
    let stiffness = args.stiffness;
    output::line(format_args!(
        "{}: thickness {}, ropelength {}, length {}",
        path.display(),
        found.thickness(stiffness),
        found.ropelength(stiffness),
        found.length
    ));
    let none = || "no curve bends".to_owned();
    let bend = found.min_rad.map_or_else(none, |m| m.sentence(*extent));
    output::line(format_args!("  {bend}"));
    let none = || "no two places are closer than those around them".to_owned();
    let strut = found.poca.map_or_else(none, |s| s.sentence(*extent));
    output::line(format_args!("  {strut}"));
    if let Some(struts) = &measured.struts {
        output::line(format_args!("  {}", plural(struts.len() as u64, "strut")));
        list(struts, |strut| strut.sentence(*extent));
    }
    if let (Some(overlaps), Some(radius)) = (&measured.overlaps, args.radius) {
        let places = plural(overlaps.len() as u64, "overlap");
        output::line(format_args!("  {places} of strands of radius {radius}"));
        list(overlaps, |strut| {
            let depth = 2.0 * radius - strut.length;
            let share = percent(depth / (2.0 * radius));
            format!("{share} of the diameter: {}", strut.sentence(*extent))
        });
        if let Some(bend) = found.min_rad.filter(|bend| bend.radius < radius) {
            let share = bend.radius / radius;
            output::line(format_args!(
                "  the sharpest bend has {} of the radius of the strands",
                percent(share)
            ));
        }
    }
}

/// Prints sentences about struts.
fn list(struts: &[Strut], sentence: impl Fn(&Strut) -> String) {
    for strut in struts.iter().take(SENTENCES) {
        output::line(format_args!("    {}", sentence(strut)));
    }
    if struts.len() > SENTENCES {
        output::line(format_args!("    and {} more", struts.len() - SENTENCES));
    }
}

fn to_json(path: &Path, measured: &Measured, args: &Args) -> Value {
    let Measured {
        found,
        struts,
        overlaps,
        ..
    } = measured;
    let mut line = json!({
        "model": path.display().to_string(),
        "length": found.length,
        // Infinite values are null.
        "min_rad": found.min_rad.map(|m| m.radius),
        "poca": found.poca.map(|strut| strut.length),
        "thickness": found.thickness(args.stiffness),
        "ropelength": found.ropelength(args.stiffness),
        "stiffness": args.stiffness,
        "min_rad_at": found.min_rad,
        "poca_at": found.poca,
    });
    if let Some(struts) = struts {
        line["struts"] = json!(struts);
    }
    if let (Some(overlaps), Some(radius)) = (overlaps, args.radius) {
        let depth = |strut: &Strut| 2.0 * radius - strut.length;
        let overlaps = overlaps
            .iter()
            .map(|s| json!({ "depth": depth(s), "strut": s }));
        line["overlaps"] = overlaps.collect();
    }
    line
}
