//! `linkwatch diagram`: computes planar diagrams of curves, and invariants of knots and links.

use super::Outcome;
use super::frames::{FrameArgs, Picked};
use super::output::plural;
use linkwatch::{Diagram, Result, diagrams};
use serde_json::json;

/// Compute planar diagrams of closed curves, and invariants that tell knots and links apart
///
/// The diagram of each curve, and of each connected group of curves, is exact: every crossing, and
/// which strand is above, is decided on the input coordinates. Reidemeister moves I and II reduce
/// it. The invariants are exact integers: v2 and v3 (Vassiliev), the determinant, linking numbers,
/// and mu (Milnor's triple linking number). Curves without crossings are unknots; groups that are
/// not listed are splittable.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Codes to print for diagrams with crossings: `pd` (KnotTheory, SnapPy), `gauss` and `dt`, or
    /// `none`
    #[arg(long, value_delimiter = ',', default_value = "pd")]
    code: Vec<Code>,
    /// Diagrams of each curve by itself only, not of groups of curves
    #[arg(long)]
    each: bool,
    #[command(flatten)]
    frames: FrameArgs,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Code {
    Pd,
    Gauss,
    Dt,
    None,
}

/// Runs the command.
pub fn run(args: &Args, as_json: bool) -> Result<Outcome> {
    let models = args.frames.models()?;
    args.frames.for_each(&models, None, |frame| {
        check(&frame)?;
        let name = &frame.name;
        let mut outcome = Outcome::Fine;
        let mut unknots = 0_u64;
        for (curves, diagram) in diagrams(&frame.curves, !args.each) {
            match diagram {
                Ok(diagram) => {
                    let most = match curves.len() {
                        1 => Diagram::MOST_FOR_V3,
                        _ => Diagram::MOST_FOR_DETERMINANT,
                    };
                    if diagram.crossings() > most {
                        let crossings = plural(diagram.crossings(), "crossing");
                        tracing::warn!("{name}: not all invariants of {crossings} computed");
                        outcome = Outcome::Undecided;
                    }
                    if as_json {
                        frame.print_json(diagram.to_json());
                    } else if diagram.crossings() == 0 {
                        unknots += 1;
                    } else {
                        print(name, &diagram, &args.code);
                    }
                }
                Err(defect) => {
                    outcome = Outcome::Undecided;
                    let sentence = defect.sentence_named(frame.curves.extent(), &[]);
                    tracing::warn!("{name}: no diagram: {sentence}");
                    if as_json {
                        frame.print_json(json!({ "curves": curves, "defect": defect }));
                    }
                }
            }
        }
        if unknots > 0 && !as_json {
            let curves = plural(unknots, "unknot");
            out!("{name}: {curves}: no crossings are left");
        }
        Ok(outcome)
    })
}

/// Refuses frames without closed curves, and curves that run through a periodic cell.
fn check(frame: &Picked) -> Result<()> {
    let (name, open) = (&frame.name, frame.curves.open_curves());
    if frame.cell.is_some() && frame.is_first {
        tracing::warn!(
            "{name}: diagrams do not consider the periodic images of curves, only the curves \
             themselves"
        );
    }
    if let Some(i) = frame.yarn() {
        return Err(usage!(
            "{name}: curve {i} runs through the periodic cell, so it does not close; a diagram is \
             one of closed curves"
        ));
    }
    if open == frame.curves.len() {
        return Err(frame.nothing_closed());
    }
    if open > 0 && frame.is_first {
        let curves = plural(open, "open curve");
        tracing::warn!("{name}: {curves} skipped: diagrams are those of closed curves");
    }
    Ok(())
}

/// Prints a diagram with crossings.
fn print(name: &str, diagram: &Diagram, codes: &[Code]) {
    out!("{name}: {diagram}");
    for code in codes {
        let text = match code {
            Code::Pd => diagram.pd_text(),
            Code::Gauss => diagram.gauss_text(),
            Code::Dt => diagram.dt_text(),
            Code::None => continue,
        };
        out!("  {text}");
    }
}
