//! `linkwatch measure writhe`: computes the writhe of curves, and linking number, twist and writhe
//! of ribbons.

use crate::cli::Outcome;
use crate::cli::frames::{FrameArgs, Picked};
use crate::cli::number::positive;
use crate::cli::output::{millis, milliseconds};
use linkwatch::kernels::Estimate;
use linkwatch::{
    Axis, CurveSet, GaussIntegrals, Image, Pairing, PairingReason, Result, Ribbon, RibbonOptions,
    beside,
};
use serde_json::json;
use std::time::Instant;

/// Compute the writhe of curves, and linking number, twist and writhe of ribbons such as DNA
///
/// The writhe is the mean number of signed self-crossings that is seen from all directions, a real
/// number: it is printed with a proven bound of its error. For ribbons, Lk is counted exactly, Tw
/// and Wr are computed independently, and Lk - Tw - Wr = 0 within the bound is a proof that the
/// ribbon does not pass through itself between its strands.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Two closed curves with the same number of vertices that are the strands of a ribbon, counted
    /// from 0 (may be repeated); or `pairs`: curves 0 and 1, 2 and 3, and so on
    #[arg(long, value_name = "I,J|pairs", value_parser = ribbon)]
    ribbon: Vec<Strands>,
    /// Vertices of the strands that belong together: `parallel` (k with k), `antiparallel` (k with
    /// n - 1 - k, as in files of DNA), or one of these with a shift (`antiparallel:1`); or `auto`:
    /// the order of the vertices if paired vertices are close, else the pairing with the most
    /// constant distances
    #[arg(long, requires = "ribbon", default_value = "auto", value_parser = pairing)]
    pairing: Choice,
    /// The first curve of each ribbon is its axis, the second one an edge. Otherwise the axis is
    /// the centre line of both
    #[arg(long, requires = "ribbon")]
    axis_first: bool,
    /// Error bound to reach, if possible. A smaller one takes longer
    #[arg(long, value_name = "BOUND", default_value_t = 1e-4, value_parser = positive)]
    tolerance: f64,
    #[command(flatten)]
    frames: FrameArgs,
}

/// Requested pairing. `None`: found automatically.
type Choice = Option<Pairing>;

fn pairing(text: &str) -> Result<Choice> {
    match text {
        "auto" => Ok(None),
        other => other.parse().map(Some),
    }
}

/// Curves that are the strands of a ribbon; `None`: curves 0 and 1, 2 and 3, and so on.
type Strands = Option<[usize; 2]>;

/// Parses two curves, or `pairs`.
fn ribbon(text: &str) -> Result<Strands, &'static str> {
    let two = text.split_once(',');
    let two = two.map(|(i, j)| (i.trim().parse(), j.trim().parse()));
    match two {
        _ if text == "pairs" => Ok(None),
        Some((Ok(i), Ok(j))) => Ok(Some([i, j])),
        _ => Err("expected two curves, `0,1` for example, or `pairs`"),
    }
}

/// Runs the command.
pub fn run(args: &Args, as_json: bool) -> Result<Outcome> {
    let models = args.frames.models()?;
    args.frames.for_each(&models, None, |frame| {
        let (name, set) = (&frame.name, &frame.curves);
        if frame.cell.is_some() && frame.is_first {
            let cells = args.frames.cell_args;
            cells.warn_of_segments(name, set, frame.cell);
        }
        // The writhe of other curves does not depend on their images.
        if let Some(i) = frame.yarn() {
            return Err(usage!(
                "{name}: curve {i} runs through the periodic cell: it stands for an infinite \
                 curve, and the writhe of one period would depend on where it begins"
            ));
        }
        match args.ribbon.is_empty() {
            true => curves(&frame, args, as_json),
            false => ribbons(&frame, args, as_json),
        }
    })
}

/// Prints the writhe of every curve.
fn curves(frame: &Picked, args: &Args, as_json: bool) -> Result<Outcome> {
    let set = &frame.curves;
    let integrals = GaussIntegrals::new(set)?;
    let mut outcome = Outcome::Fine;
    for i in 0..set.len() {
        let start = Instant::now();
        let writhe = integrals.writhe(i, args.tolerance);
        let took = start.elapsed();
        let name = format!("{}: curve {i}", frame.name);
        if as_json {
            frame.print_json(json!({
                "curve": i,
                "closed": set.curve(i).closed,
                "segments": set.curve(i).segments,
                "writhe": writhe,
                "ms": milliseconds(took),
            }));
        } else {
            out!("{name}: writhe {writhe} ({})", millis(took));
        }
        if writhe.bound > args.tolerance {
            outcome = Outcome::Undecided;
            warn_of_bound(&name, writhe, args.tolerance);
        }
    }
    Ok(outcome)
}

/// Prints linking number, twist and writhe of every ribbon.
fn ribbons(frame: &Picked, args: &Args, as_json: bool) -> Result<Outcome> {
    let set = &frame.curves;
    let mut outcome = Outcome::Fine;
    let first = args.axis_first;
    let axis = if first { Axis::First } else { Axis::Centre };
    let options = RibbonOptions {
        axis,
        pairing: args.pairing,
        tolerance: args.tolerance,
    };
    for [i, j] in strands(&frame.name, set, &args.ribbon)? {
        let of_image = match frame.cell {
            Some(cell) if i.max(j) < set.len() => Some(beside(set, [i, j], &cell)?),
            _ => None,
        };
        let ribbon = match &of_image {
            Some((strands, _)) => Ribbon::of(strands, [0, 1], options)?,
            None => Ribbon::of(set, [i, j], options)?,
        };
        let residual = ribbon.residual();
        let passages = ribbon.passages();
        let name = format!("{}: ribbon {i},{j}", frame.name);
        if as_json {
            frame.print_json(json!({
                "strands": [i, j],
                "image": of_image.as_ref().map(|(_, image)| image),
                "axis": axis,
                "pairing": ribbon.pairing.to_string(),
                "pairing_by": ribbon.reason,
                "linking": ribbon.linking,
                "twist": ribbon.twist,
                "writhe": ribbon.writhe,
                "residual": residual,
                "passages": passages,
                "ms": ribbon.times.map(milliseconds),
            }));
        } else {
            let linking = ribbon.linking.map_or("undefined".into(), |n| n.to_string());
            let [lk, tw, wr] = ribbon.times.map(millis);
            let (twist, writhe, pairing) = (ribbon.twist, ribbon.writhe, ribbon.pairing.words());
            let why = match ribbon.reason {
                PairingReason::Given => "given",
                PairingReason::Order => "by the order of the vertices",
                PairingReason::Distances => "by the smallest variation of the distances",
            };
            out!(
                "{name}: Lk {linking} ({lk}), Tw {twist} ({tw}), Wr {writhe} ({wr}), Lk - Tw - Wr \
                 {residual}; {pairing} ({why})"
            );
        }
        let rivals = ribbon.rivals.iter();
        let rivals = rivals.map(|(rival, twist)| format!("--pairing {rival} gives Tw {twist}"));
        let rivals = rivals.collect::<Vec<String>>().join(", ");
        if !rivals.is_empty() {
            tracing::warn!(
                "{name}: another pairing of the vertices fits nearly as well, and has another \
                 twist: {rivals}"
            );
        }
        if let Some((_, image)) = &of_image
            && *image != Image::default()
        {
            let [n1, n2, n3] = image;
            tracing::info!(
                "{name}: with the image {n1},{n2},{n3} of curve {j}, nearest to curve {i}"
            );
        }
        if let Some((_, place)) = ribbon.contact {
            let [s, t] = place.segments;
            tracing::warn!("{name}: segments {s} and {t} touch, so there is no linking number");
        }
        if passages != Some(0) {
            outcome = Outcome::Undecided;
            match passages {
                Some(n) => tracing::warn!(
                    "{name}: not a ribbon: the surface between the strands passes through itself \
                     (by {n} in Lk); check that vertex k of one strand belongs to that of the other"
                ),
                None => tracing::warn!(
                    "{name}: Lk - Tw - Wr is undecided: its bound is {:.1e}; the axis or the \
                     ribbon touches itself, or needs a smaller --tolerance",
                    residual.bound
                ),
            }
        }
    }
    Ok(outcome)
}

/// Returns the strands of all ribbons of a set.
fn strands(name: &str, set: &CurveSet, asked: &[Strands]) -> Result<Vec<[usize; 2]>> {
    let mut all = Vec::new();
    for strands in asked {
        match *strands {
            Some(strands) => all.push(strands),
            None if set.len() % 2 == 1 => {
                let n = set.len();
                return Err(usage!(
                    "{name}: --ribbon pairs needs an even number of curves, not {n}"
                ));
            }
            None => all.extend((0..set.len() / 2).map(|k| [2 * k, 2 * k + 1])),
        }
    }
    Ok(all)
}

/// Warns of a number whose bound is larger than requested.
pub fn warn_of_bound(name: &str, found: Estimate, tolerance: f64) {
    tracing::warn!(
        "{name}: undecided: the error bound is {:.1e}, above the tolerance of {tolerance:.1e}; \
         segments touch or nearly touch, or are too many for this tolerance",
        found.bound
    );
}
