//! `linkwatch measure thickness`: measures how sharply curves bend and how close they come.

use crate::cli::Outcome;
use crate::cli::clearance_args::{StrandRadius, strand_radius};
use crate::cli::frames::{FrameArgs, Picked};
use crate::cli::number::positive;
use crate::cli::output::{list, percent, plural};
use linkwatch::{Error, MinRad, Result, Strut, Thickness, struts};
use serde_json::{Value, json};

/// Maximum number of struts or overlaps that are printed; the rest is counted.
const SENTENCES: usize = 20;

/// Measure thickness and ropelength of curves: how sharply they bend, and how close they come
///
/// The thickness is the diameter of the thickest tube around all curves that neither bends too
/// sharply nor overlaps: min{2 minRad, POCA}, as in Ashton and Cantarella 2005. liboctrope returns
/// its radius, half of that. The ropelength is the length divided by the thickness. Values of
/// splines have bounds of their errors.
///
/// With a periodic cell (`--cell`, or that of the frame), the tube is around all images of the
/// curves, too.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// List the struts (places of closest approach) that are longer than the shortest one by at
    /// most this share, for example 0.01
    #[arg(long, value_name = "F", value_parser = positive)]
    struts: Option<f64>,
    /// Radius of the strands, or `published`: those that the file has. Lists the places
    /// where two strands, or one and itself, overlap
    #[arg(long, value_name = "R|published", value_parser = strand_radius)]
    radius: Option<StrandRadius>,
    /// Count control points of splines that repeat the one before them once: a Catmull-Rom curve
    /// turns back there
    #[arg(long)]
    skip_doubled: bool,
    #[command(flatten)]
    frames: FrameArgs,
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
    /// Struts that are shorter than the sum of the radii of their curves, and these sums.
    overlaps: Option<Vec<(Strut, f64)>>,
    /// Radii of the curves.
    radii: Vec<f64>,
}

/// Runs the command.
pub fn run(args: &Args, json: bool) -> Result<Outcome> {
    let models = args.frames.models()?;
    args.frames.for_each(&models, None, |frame| {
        let measured = measure(&frame, args)?;
        match json {
            true => frame.print_json(to_json(&measured, args)),
            false => print(&frame, &measured, args),
        }
        Ok(Outcome::Fine)
    })
}

fn measure(frame: &Picked, args: &Args) -> Result<Measured> {
    let (name, mut set, cell) = (&frame.name, &frame.curves, frame.cell.as_ref());
    if cell.is_some() && frame.is_first {
        let cells = args.frames.cell_args;
        cells.warn_of_segments(name, set, frame.cell);
    }
    let without;
    if let [(curve, point), others @ ..] = &set.doubled_points()[..] {
        let count = plural(1 + others.len() as u64, "doubled control point");
        let place = format!("{count}, first point {point} of curve {curve}");
        if args.skip_doubled {
            tracing::warn!("{name}: {place}: counted once; segments are numbered without");
            without = set.without_doubled_points()?;
            set = &without;
        } else {
            tracing::warn!("{name}: {place}: --skip-doubled counts it once");
        }
    }
    let published: Vec<f64> = frame.radii.iter().copied().map(f64::from).collect();
    let radii = match args.radius {
        None => Vec::new(),
        Some(Some(radius)) => vec![radius; set.len()],
        Some(None) if published.len() == set.len() => published,
        Some(None) => return Err(usage!("{name}: the curves have no radii")),
    };
    let found = Thickness::of(set, cell)?;
    let shortest = found.poca.map(|strut| strut.length);
    let listed = args.struts.zip(shortest);
    let listed = listed.map(|(share, shortest)| struts(set, cell, (1.0 + share) * shortest));
    let largest = radii.iter().copied().reduce(f64::max);
    let overlaps = largest.map(|radius| {
        let reach = |strut: &Strut| {
            let [a, b] = strut.ends.map(|end| radii[end.curve as usize]);
            a + b
        };
        let all = struts(set, cell, 2.0 * radius)?.into_iter();
        let all = all.map(|strut| (strut, reach(&strut)));
        let mut all: Vec<(Strut, f64)> = all.filter(|(s, sum)| s.length < *sum).collect();
        all.sort_by(|(a, p), (b, q)| (a.length / p).total_cmp(&(b.length / q)));
        Ok::<_, Error>(all)
    });
    Ok(Measured {
        found,
        extent: set.extent(),
        struts: listed.transpose()?,
        overlaps: overlaps.transpose()?,
        radii,
    })
}

/// Prints the results of a frame: one line for each of several frames, and the requested struts.
fn print(frame: &Picked, measured: &Measured, args: &Args) {
    let Measured { found, extent, .. } = measured;
    let (name, length) = (&frame.name, found.length);
    let thickness = found.thickness(args.stiffness);
    let ropelength = found.ropelength(args.stiffness);
    out!("{name}: thickness {thickness}, ropelength {ropelength}, length {length}");
    if !frame.several {
        let bend = found.min_rad.map(|m| m.sentence(*extent));
        out!("  {}", bend.as_deref().unwrap_or("no curve bends"));
        let strut = found.poca.map(|s| s.sentence(*extent));
        let none = "no strut: the distance between the curves has no local minimum";
        out!("  {}", strut.as_deref().unwrap_or(none));
    }
    if let Some(struts) = &measured.struts {
        out!("  {}", plural(struts.len(), "strut"));
        let struts: Vec<String> = struts.iter().map(|s| s.sentence(*extent)).collect();
        list("    ", &struts, SENTENCES);
    }
    if let Some(overlaps) = &measured.overlaps {
        let places = plural(overlaps.len(), "overlap");
        let strands = match args.radius {
            Some(Some(radius)) => format!("of radius {radius}"),
            _ => "with the published radii".into(),
        };
        out!("  {places} of strands {strands}");
        let overlaps = overlaps.iter().map(|(strut, sum)| {
            let share = percent((sum - strut.length) / sum);
            format!("{share} of the diameter: {}", strut.sentence(*extent))
        });
        list("    ", &overlaps.collect::<Vec<_>>(), SENTENCES);
        let radius = |bend: &MinRad| measured.radii[bend.curve as usize];
        if let Some(bend) = found.min_rad.filter(|bend| bend.radius < radius(bend)) {
            let share = percent(bend.radius / radius(&bend));
            out!("  a strand bends too sharply: its radius of curvature is {share} of its radius");
        }
    }
}

fn to_json(measured: &Measured, args: &Args) -> Value {
    let found = &measured.found;
    let mut line = json!({
        "length": found.length,
        // Infinite values are null.
        "min_rad": found.min_rad.map(|m| m.radius),
        "poca": found.poca.map(|strut| strut.length),
        "thickness": found.thickness(args.stiffness),
        "ropelength": found.ropelength(args.stiffness),
        "stiffness": args.stiffness,
        // Upper bounds of the errors.
        "min_rad_error": found.min_rad.map(|m| m.error),
        "poca_error": found.poca.map(|strut| strut.error),
        "min_rad_at": found.min_rad,
        "poca_at": found.poca,
    });
    if let Some(struts) = &measured.struts {
        line["struts"] = json!(struts);
    }
    if let Some(overlaps) = &measured.overlaps {
        let json =
            |(strut, sum): &(Strut, f64)| json!({ "depth": sum - strut.length, "strut": strut });
        line["overlaps"] = overlaps.iter().map(json).collect();
    }
    line
}
