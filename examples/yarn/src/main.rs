//! A simulator that publishes its frames: knitted yarn, wrung until it breaks, or dropped.
//!
//! It simulates yarn by position-based dynamics and does not check its topology. A sidecar,
//! `linkwatch watch`, runs as a separate process (started from here unless `--no-sidecar`),
//! verifies every frame, and asks this simulator to stop if a strand was pulled through another.
//! The simulator waits for each verdict, so that every run gives the same frames and verdicts.
//!
//! With `--go-on` it does not stop, until the yarn has exploded so that anybody would see it. With
//! `--roll-back` it returns to the last intact frame and continues with smaller time steps.

mod contact;
mod scene;
#[cfg(test)]
mod tests;
mod yarn;

use clap::{Parser, ValueEnum};
use linkwatch::{Basis, Client, ClientOptions, CurveLabels, Error, Precision, Result, Verdict};
use sidecar::{Scene, SidecarArgs, publish, step_safely, wait_for_watcher};
use std::process::ExitCode;
use std::time::{Duration, Instant};
use yarn::{DIAMETER, Yarn};

/// Duration of a frame in seconds.
const FRAME_DT: f32 = 1.0 / 60.0;

/// Ratio of the length of a segment to its length at rest from which on everybody sees that the
/// simulation exploded.
const EXPLODED: f32 = 3.0;

/// Time limit for a watcher to connect.
const WAIT: Duration = Duration::from_secs(60);

/// Name of a scene.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum Name {
    /// A knitted tube; its ends are turned against each other
    Tube,
    /// A garment, a body with two sleeves; it falls on a ball
    Garment,
}

impl Name {
    /// Returns the default number of rows and of stitches.
    fn size(self) -> (usize, usize) {
        match self {
            Name::Tube => (39, 24),
            Name::Garment => (28, 40),
        }
    }
}

/// Wrings a knitted tube until it breaks, or drops a knitted garment on a ball.
#[derive(Debug, Parser)]
struct Args {
    /// Scene to simulate
    #[arg(value_enum)]
    scene: Name,
    /// Time steps per frame of 1/60 s
    #[arg(long, default_value_t = 16, value_parser = clap::value_parser!(u16).range(1..))]
    substeps: u16,
    /// Frames to simulate [default: tube: to the end of the turns; garment: 120]
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..))]
    frames: Option<u32>,
    /// Turns of the ends of the tube against each other, one turn per second
    #[arg(long, default_value_t = 1.0, value_parser = turns)]
    turns: f64,
    /// Rows of the tube, or of the body of the garment [default: tube: 39; garment: 28]
    #[arg(long, value_parser = clap::value_parser!(u16).range(3..1000))]
    rows: Option<u16>,
    /// Stitches of each of these rows [default: tube: 24; garment: 40]
    #[arg(long, value_parser = clap::value_parser!(u16).range(16..1000))]
    stitches: Option<u16>,
    /// Do not stop at a pull-through, but when a segment is three times as long as at rest
    #[arg(long)]
    go_on: bool,
    /// After a pull-through, return to the last intact frame and go on with smaller time steps
    #[arg(long, conflicts_with = "go_on")]
    roll_back: bool,
    #[command(flatten)]
    sidecar: SidecarArgs,
}

/// Parses a number of turns. Rejects NaN, and numbers that no tube survives.
fn turns(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(turns) if (0.01..=100.0).contains(&turns) => Ok(turns),
        _ => Err("expected a number of turns from 0.01 to 100".into()),
    }
}

impl Scene for Yarn {
    fn advance(&mut self, steps: usize) {
        for _ in 0..steps {
            self.step(f64::from(FRAME_DT) / steps as f64);
        }
    }

    fn write_positions(&self, out: &mut [f32]) {
        for (out, x) in out.chunks_exact_mut(3).zip(&self.x) {
            out.copy_from_slice(&x.to_array());
        }
    }
}

fn main() -> ExitCode {
    sidecar::exit_code(run(&Args::parse()))
}

fn run(args: &Args) -> Result<ExitCode> {
    let (rows, stitches) = args.scene.size();
    let rows = args.rows.map_or(rows, usize::from);
    let stitches = args.stitches.map_or(stitches, usize::from);
    let (yarn, frames) = match args.scene {
        Name::Tube => {
            let seconds = args.turns / scene::TURNS_PER_SECOND;
            let frames = (seconds / f64::from(FRAME_DT)).ceil() as usize + 1;
            (scene::tube(rows, stitches, args.turns), frames)
        }
        Name::Garment => (scene::garment(rows, stitches), 120),
    };
    let frames = args.frames.map_or(frames, |n| n as usize);
    let mut sidecar = args.sidecar.start("yarn.mcap")?;
    let mut client = Client::open(&args.sidecar.service, &ClientOptions::lockstep())?;
    // The counts are negative, because every loop is a closed polygon.
    let counts: Vec<i32> = yarn.loops().iter().map(|n| -(*n as i32)).collect();
    let labels = CurveLabels::default().with_radii(vec![DIAMETER / 2.0; counts.len()]);
    client.describe_labelled(Basis::Polyline, Precision::F32, &counts, labels)?;
    if !wait_for_watcher(&mut client, sidecar.as_mut(), &args.sidecar.service, WAIT)? {
        let what = format!(
            "no watcher connected to {} in {WAIT:?}",
            args.sidecar.service
        );
        return Err(Error::Usage(what));
    }
    println!(
        "simulator: {} loops of yarn, {} points, {frames} frames, {} time steps per frame",
        counts.len(),
        yarn.x.len(),
        args.substeps
    );
    let start = Instant::now();
    let end = match args.roll_back {
        true => roll_back(args, &mut client, yarn, frames),
        false => simulate(args, &mut client, yarn, frames),
    };
    let seconds = start.elapsed().as_secs_f64();
    println!("simulator: ended after {seconds:.1} s");
    client.finish_within(sidecar::DEADLINE)?;
    if let Some(sidecar) = sidecar {
        sidecar.join()?;
    }
    end
}

/// Simulates and publishes frames up to the first one that is not intact, or, with `--go-on`, until
/// the yarn explodes.
fn simulate(args: &Args, client: &mut Client, mut yarn: Yarn, frames: usize) -> Result<ExitCode> {
    let steps = usize::from(args.substeps);
    let mut broken = None;
    let mut most = 1.0_f32;
    for frame in 0..frames {
        if frame > 0 {
            yarn.advance(steps);
        }
        let verdict = publish(client, &yarn, frame as f64 * f64::from(FRAME_DT))?.verdict;
        let stretch = yarn.stretch();
        most = most.max(stretch);
        if broken.is_none() && verdict != Verdict::Intact {
            broken = Some((frame, verdict));
            match client.aborted() {
                Some(abort) => println!("simulator: {abort}"),
                None => println!("simulator: frame {frame} is {verdict}"),
            }
            println!("simulator: its longest segment is {stretch:.2} times as long as at rest");
        }
        if broken.is_some() && !args.go_on {
            break;
        }
        if stretch >= EXPLODED {
            println!(
                "simulator: frame {frame} has exploded: a segment is {stretch:.1} times as long as \
                 at rest"
            );
            if let Some((broken, _)) = broken {
                let frames = frame - broken;
                let steps = frames * steps;
                println!("simulator: the watcher knew {frames} frames earlier, {steps} time steps");
            }
            break;
        }
        if frame + 1 == frames {
            println!(
                "simulator: all {frames} frames done; no segment was more than {most:.2} times as \
                 long as at rest"
            );
        }
    }
    Ok(match broken {
        None => {
            println!("simulator: every frame is intact");
            ExitCode::SUCCESS
        }
        Some((_, Verdict::Changed)) => ExitCode::from(1),
        Some(_) => ExitCode::from(3),
    })
}

/// Simulates all frames, and repeats those that are not intact with smaller time steps.
fn roll_back(args: &Args, client: &mut Client, yarn: Yarn, frames: usize) -> Result<ExitCode> {
    let work = step_safely(client, yarn, (frames, FRAME_DT, args.substeps.into()))?;
    println!(
        "simulator: all {frames} frames are intact: {} time steps kept, {} discarded with {} \
         frames; up to {} time steps in a frame",
        work.kept, work.discarded, work.retried_frames, work.most
    );
    Ok(ExitCode::SUCCESS)
}
