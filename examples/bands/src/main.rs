//! A simulator that publishes its frames: rubber bands fall on an incline and slide to the floor.
//!
//! After Qu and James 2021, section 4.3.7. No two of the 1,024 bands are linked at the start. With
//! 20 time steps per frame it stays so. With 4, bands move by more than their thickness in a time
//! step and pass through one another, and linked bands are the result. The simulator does not check
//! that: a sidecar, `linkwatch watch`, verifies every frame in lockstep.

mod contact;
mod scene;
#[cfg(test)]
mod tests;

use clap::Parser;
use linkwatch::{Basis, Client, ClientOptions, CurveLabels, Precision, Result, Verdict};
use scene::{Bands, FRAME_DT, FRAMES, POINTS, THICKNESS};
use sidecar::{DEADLINE, Scene, Sidecar, SidecarArgs, publish, step_safely, wait_for_watcher};
use std::process::ExitCode;
use std::time::{Duration, Instant};

/// Stretch of a band, in lengths at rest, from which on a person would see that something pulls.
const SEEN: f32 = 1.25;

/// Time to wait for a watcher before the first frame.
const WAIT: Duration = Duration::from_secs(60);

/// Drops rubber bands on an incline, with time steps that are too large.
#[derive(Debug, Parser)]
struct Args {
    /// Time steps per frame: 4 link bands, 20 keep them apart
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u16).range(1..))]
    substeps: u16,
    /// Number of bands
    #[arg(long, default_value_t = 1024, value_parser = clap::value_parser!(u16).range(2..))]
    bands: u16,
    /// Frames to simulate
    #[arg(long, default_value_t = FRAMES)]
    frames: usize,
    /// Return to the last intact frame after a violation, and go on with smaller time steps
    #[arg(long, conflicts_with = "go_on")]
    roll_back: bool,
    /// Go on after a violation, and report when a person would see it
    #[arg(long)]
    go_on: bool,
    #[command(flatten)]
    sidecar: SidecarArgs,
}

fn main() -> ExitCode {
    sidecar::exit_code(run(&Args::parse()))
}

fn run(args: &Args) -> Result<ExitCode> {
    let mut sidecar = args.sidecar.start("bands.mcap")?;
    let bands = Bands::new(usize::from(args.bands));
    let mut client = Client::open(&args.sidecar.service, &ClientOptions::lockstep())?;
    // The count is negative, because every band is closed.
    let counts = vec![-(POINTS as i32); bands.bands()];
    let radii = CurveLabels::default().with_radii(vec![0.5 * THICKNESS; bands.bands()]);
    client.describe_labelled(Basis::Polyline, Precision::F32, &counts, radii)?;
    if !wait_for_watcher(&mut client, sidecar.as_mut(), &args.sidecar.service, WAIT)? {
        println!("simulator: no watcher connected within {WAIT:?}");
        return Ok(ExitCode::from(3));
    }
    println!(
        "simulator: {} bands, {} frames, {} time steps per frame",
        args.bands, args.frames, args.substeps
    );
    let start = Instant::now();
    let intact = match args.roll_back {
        true => {
            let plan = (args.frames, FRAME_DT, usize::from(args.substeps));
            println!("simulator: {}", step_safely(&mut client, bands, plan)?);
            true
        }
        false => simulate(args, &mut client, bands)?,
    };
    let seconds = start.elapsed().as_secs_f64();
    match intact {
        true => println!(
            "simulator: {} frames done in {seconds:.1} s: no two bands are linked",
            args.frames
        ),
        false => println!("simulator: ended after {seconds:.1} s"),
    }
    client.finish_within(DEADLINE)?;
    let code = sidecar.map(Sidecar::join_and_draw).transpose()?.flatten();
    // The watcher says if the topology changed or could not be decided.
    Ok(match (intact, code) {
        (true, _) => ExitCode::SUCCESS,
        (false, Some(code)) if code != 0 => ExitCode::from(code),
        (false, _) => ExitCode::from(1),
    })
}

/// Simulates until a frame is not intact, or with `--go-on` all frames. Returns true if every frame
/// is intact.
fn simulate(args: &Args, client: &mut Client, mut bands: Bands) -> Result<bool> {
    let (mut first, mut seen) = (None, None);
    let (mut longest, mut links) = (0.0_f32, 0);
    for frame in 0..args.frames {
        if frame > 0 {
            bands.advance(usize::from(args.substeps));
        }
        let verdict = publish(client, &bands, frame as f64 * f64::from(FRAME_DT))?;
        links = verdict.gained;
        longest = longest.max(bands.stretch());
        if longest >= SEEN {
            seen.get_or_insert(frame);
        }
        if verdict.verdict != Verdict::Intact && first.is_none() {
            println!("simulator: {verdict}");
            first = Some(frame);
            if !args.go_on {
                return Ok(false);
            }
        }
    }
    let Some(first) = first else {
        return Ok(true);
    };
    println!("simulator: first violation in frame {first}; {links} links in the last frame");
    match seen {
        Some(frame) => println!(
            "simulator: seen in frame {frame}, {} frames later: a band is {SEEN} times as long as \
             at rest",
            frame.saturating_sub(first)
        ),
        None => println!(
            "simulator: never seen: no band was more than {longest:.3} times as long as at rest"
        ),
    }
    Ok(false)
}
