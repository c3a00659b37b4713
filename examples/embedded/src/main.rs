//! A simulator that publishes its frames: a ball presses into a coarse cage of tetrahedra, which
//! takes a yarn model with it.
//!
//! After Qu and James 2021, section 4.3.3 (embedded deformation). Every control point keeps its
//! barycentric coordinates in its tetrahedron. A tetrahedron that is turned inside out takes yarns
//! through one another. To look for those is not enough: splines do not follow the kinks between
//! tetrahedra exactly, so that yarns may pass through one another before the first one is turned. A
//! sidecar, `linkwatch watch`, verifies every frame in lockstep.

mod cage;
#[cfg(test)]
mod tests;

use cage::{Cage, FRAMES};
use clap::Parser;
use linkwatch::scenes::Scene as Generated;
use linkwatch::{Client, ClientOptions, CurveSet, Precision, Result, Verdict, formats};
use sidecar::{DEADLINE, Scene, SidecarArgs, publish, wait_for_watcher};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

/// Frames per second.
const RATE: f64 = 30.0;

/// Time to wait for a watcher before the first frame.
const WAIT: Duration = Duration::from_secs(60);

/// Presses a ball into a cage of tetrahedra with a yarn model in it.
#[derive(Debug, Parser)]
struct Args {
    /// Depth of the ball, in shares of the thickness of the cage: 0.25 keeps the topology, 1.5
    /// breaks it
    #[arg(long, default_value_t = 0.25, value_parser = depth)]
    depth: f64,
    /// Model of the yarn [default: a generated knit]
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// Go on after a violation
    #[arg(long)]
    go_on: bool,
    #[command(flatten)]
    sidecar: SidecarArgs,
}

/// Parses a depth. Rejects NaN and infinite numbers.
fn depth(text: &str) -> Result<f64, &'static str> {
    let depth = text.parse().ok().filter(|depth: &f64| depth.is_finite());
    depth.ok_or("expected a finite number")
}

fn main() -> ExitCode {
    sidecar::exit_code(run(&Args::parse()))
}

fn run(args: &Args) -> Result<ExitCode> {
    let model = match &args.model {
        Some(path) => formats::read(path)?,
        None => {
            let knit: Generated = "knit:rows=40,stitches=32,segments=12800".parse()?;
            knit.build()?.curves
        }
    };
    let mut sidecar = args.sidecar.start("embedded.mcap")?;
    let mut client = Client::open(&args.sidecar.service, &ClientOptions::lockstep())?;
    let counts: Vec<i32> = model.counts().collect();
    client.describe(model.basis(), Precision::F32, &counts)?;
    if !wait_for_watcher(&mut client, sidecar.as_mut(), &args.sidecar.service, WAIT)? {
        println!("simulator: no watcher connected within {WAIT:?}");
        return Ok(ExitCode::from(3));
    }
    println!(
        "simulator: {FRAMES} frames of {} control points",
        model.points()
    );
    let intact = simulate(args, &mut client, &model)?;
    if intact {
        println!("simulator: every frame is intact");
    }
    client.finish_within(DEADLINE)?;
    let code = sidecar.map(|s| s.join()).transpose()?.flatten();
    // The watcher says if the topology changed or could not be decided.
    Ok(match (intact, code) {
        (true, _) => ExitCode::SUCCESS,
        (false, Some(code)) if code != 0 => ExitCode::from(code),
        (false, _) => ExitCode::from(1),
    })
}

/// Simulates until a frame is not intact, or with `--go-on` all frames. Returns true if every frame
/// is intact.
fn simulate(args: &Args, client: &mut Client, model: &CurveSet) -> Result<bool> {
    let mut cage = Cage::around(model, args.depth);
    let (mut intact, mut turned, mut most) = (true, false, 0);
    for frame in 0..FRAMES {
        if frame > 0 {
            cage.advance(1);
        }
        let inverted = cage.inverted();
        if inverted > 0 && !turned {
            println!("simulator: frame {frame}: tetrahedra that are turned inside out: {inverted}");
            turned = true;
        }
        let verdict = publish(client, &cage, frame as f64 / RATE)?;
        most = most.max(verdict.gained + verdict.lost + verdict.changed);
        if verdict.verdict != Verdict::Intact && intact {
            println!("simulator: {verdict}");
            intact = false;
            if !args.go_on {
                return Ok(false);
            }
        }
    }
    if !intact {
        println!("simulator: up to {most} changed links in a frame");
    }
    Ok(intact)
}
