//! A simulator that publishes its frames: a sheet of chainmail is dropped into a box and crumples.
//!
//! It simulates rigid rings with `rapier3d` and does not check their topology. A sidecar,
//! `linkwatch watch`, runs as a separate process (started from here unless `--no-sidecar`),
//! verifies every frame, and asks this simulator to stop if a ring was pulled through another. The
//! default time step is too large on purpose; `--substeps 16` keeps the sheet intact. With `--pack`
//! a lid then presses the sheet into the lower part of the box, as in Qu and James 2021, section
//! 4.3.6. With `--roll-back` the simulator returns to the last intact frame after a violation and
//! continues with smaller time steps.
//!
//! `run` and `simulate` contain all calls of linkwatch: open, describe, loan, publish, poll,
//! finish.

mod lid;
mod scene;

use clap::Parser;
use linkwatch::{Basis, Client, ClientOptions, CurveLabels, Outcome, Precision, Result};
use scene::{FRAME_DT, FRAMES, Options, PACKED_FRAMES, Sheet, WIRE_RADIUS};
use sidecar::{DEADLINE, Sidecar, SidecarArgs, step_safely, wait_for_watcher};
use std::process::ExitCode;
use std::time::{Duration, Instant};

/// Drops a sheet of chainmail into a box, with time steps that are too large.
#[derive(Debug, Parser)]
struct Args {
    /// Time steps per frame: 1 breaks the sheet, 16 keeps it intact
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..))]
    substeps: u16,
    /// Publish every time step as a frame of its own
    #[arg(long)]
    every_step: bool,
    /// Then pack the sheet: a lid presses it into the lower part of the box
    #[arg(long)]
    pack: bool,
    /// Return to the last intact frame after a violation, and go on with smaller time steps
    /// (implies --lockstep)
    #[arg(long, conflicts_with_all = ["every_step", "go_on"])]
    roll_back: bool,
    /// Go on after a violation, and report when a person would see it (implies --lockstep)
    #[arg(long)]
    go_on: bool,
    /// Frames to simulate [default: 72, with --pack 120]
    #[arg(long)]
    frames: Option<usize>,
    /// Seconds to wait for a watcher before the first frame
    #[arg(long, default_value = "60", value_name = "SECONDS", value_parser = seconds)]
    wait: Duration,
    /// Wait for the verdict on every frame before the next step
    #[arg(long)]
    lockstep: bool,
    #[command(flatten)]
    sidecar: SidecarArgs,
    /// Number of flat rings per side of the sheet (19 makes 1,045 rings in all)
    #[arg(long, default_value_t = 19, value_parser = clap::value_parser!(u16).range(2..200))]
    side: u16,
}

impl Args {
    /// Returns the number of frames to simulate.
    fn frames(&self) -> usize {
        let whole = if self.pack { PACKED_FRAMES } else { FRAMES };
        self.frames.unwrap_or(whole)
    }

    /// Returns true if the simulator waits for each verdict.
    fn waits(&self) -> bool {
        self.lockstep || self.roll_back || self.go_on
    }
}

/// Parses a time in seconds. Rejects NaN, infinite and negative numbers.
fn seconds(text: &str) -> Result<Duration, String> {
    match text.parse().map(Duration::try_from_secs_f64) {
        Ok(Ok(time)) => Ok(time),
        _ => Err("expected seconds, a finite number of at least 0".into()),
    }
}

/// End of the simulation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum End {
    /// All frames were simulated.
    Done,
    /// The watcher asked to stop.
    Aborted,
}

fn main() -> ExitCode {
    sidecar::exit_code(run(&Args::parse()))
}

fn run(args: &Args) -> Result<ExitCode> {
    let mut sidecar = args.sidecar.start("chainmail.mcap")?;
    let options = match args.waits() {
        true => ClientOptions::lockstep(),
        false => ClientOptions::default(),
    };
    let side = usize::from(args.side);
    let mut sheet = Sheet::new(&Options {
        rows: side,
        columns: side,
        lid: args.pack,
        ..Options::default()
    });
    let mut client = Client::open(&args.sidecar.service, &options)?;
    // The count is negative, because every ring is a closed polygon.
    let counts = vec![-(Sheet::vertices_per_ring() as i32); sheet.rings()];
    // With the radii of the rings, a watcher can measure how close they come.
    let radii = CurveLabels::default().with_radii(vec![WIRE_RADIUS; sheet.rings()]);
    client.describe_labelled(Basis::Polyline, Precision::F32, &counts, radii)?;
    if !wait_for_watcher(
        &mut client,
        sidecar.as_mut(),
        &args.sidecar.service,
        args.wait,
    )? {
        println!("simulator: no watcher connected; running without verification");
    }
    if args.roll_back {
        return roll_back(args, client, sheet, sidecar);
    }
    let end = simulate(args, &mut client, &mut sheet)?;
    // The goodbye of the watcher has the counts of all frames.
    let last = client.finish_within(DEADLINE)?;
    match &last {
        Some(m) => println!(
            "simulator: of the published frames, {} were verified, {} skipped, {} rejected",
            m.counters.verified, m.counters.skipped, m.counters.rejected
        ),
        None => {
            println!("simulator: the watcher ended; the number of verified frames is unknown")
        }
    }
    // The goodbye repeats an abort for one of the last frames.
    let aborted = end == End::Aborted || last.as_ref().is_some_and(|m| m.abort);
    let watched = last.is_some_and(|m| m.counters.verified > 0);
    let verdict = join(sidecar)?;
    Ok(match verdict {
        _ if aborted => ExitCode::from(1),
        Some(code) if code != 0 => ExitCode::from(code),
        _ if !watched => {
            println!("simulator: this run was not verified to its end");
            ExitCode::from(3)
        }
        _ => {
            println!("simulator: every verified frame is intact");
            ExitCode::SUCCESS
        }
    })
}

/// Waits for the watcher to end. Returns its exit code.
fn join(sidecar: Option<Sidecar>) -> Result<Option<u8>> {
    let code = sidecar.map(Sidecar::join_and_draw).transpose()?;
    Ok(code.flatten())
}

/// Runs the simulation with roll back: every frame of the result is intact.
fn roll_back(
    args: &Args,
    mut client: Client,
    sheet: Sheet,
    sidecar: Option<Sidecar>,
) -> Result<ExitCode> {
    let start = Instant::now();
    let plan = (args.frames(), FRAME_DT, usize::from(args.substeps));
    let work = step_safely(&mut client, sheet, plan)?;
    let seconds = start.elapsed().as_secs_f64();
    println!("simulator: {work}");
    println!(
        "simulator: {} frames done in {seconds:.1} s: every frame is intact",
        args.frames()
    );
    client.finish_within(DEADLINE)?;
    // The watcher ends with exit code 1, because of the frames that were taken back.
    join(sidecar)?;
    Ok(ExitCode::SUCCESS)
}

/// Runs the simulation, with all its calls of linkwatch.
fn simulate(args: &Args, client: &mut Client, sheet: &mut Sheet) -> Result<End> {
    println!(
        "simulator: {} rings, {} frames, {} time steps per frame",
        sheet.rings(),
        args.frames(),
        args.substeps
    );
    let (mut violated, mut seen) = (None, None);
    let start = Instant::now();
    let mut watched = true;
    let substeps = usize::from(args.substeps);
    // Published frames per frame of the simulation, and time steps per published frame.
    let (frames, steps) = match args.every_step {
        true => (substeps, 1),
        false => (1, substeps),
    };
    let dt = FRAME_DT / frames as f32;
    let count = match args.frames() {
        0 => 0,
        n => (n - 1) * frames + 1,
    };
    for frame in 0..count {
        if frame > 0 {
            sheet.step(dt, steps);
        }
        let mut loan = client.loan(frame as f64 * f64::from(dt))?;
        sheet.write_positions(loan.positions_f32()?);
        let seq = loan.publish()?;
        if args.waits() {
            match client.wait(seq, DEADLINE)? {
                Outcome::Verdict(_) => watched = true,
                Outcome::Stale => {
                    println!("simulator: no verdict on frame {seq} within {DEADLINE:?}");
                }
                // Printed once: the simulation continues, and another watcher may start.
                Outcome::NoWatcher(how) => {
                    if std::mem::replace(&mut watched, false) {
                        println!("simulator: {how}; not verified from frame {seq} on");
                    }
                }
            }
        }
        while client.poll()?.is_some() {}
        if let Some(abort) = client.aborted() {
            if !args.go_on {
                println!("simulator: stopped after frame {seq}. {abort}");
                return Ok(End::Aborted);
            }
            violated.get_or_insert(frame);
        }
        if args.go_on && sheet.torn() > 0 {
            seen.get_or_insert(frame);
        }
    }
    if let Some(first) = violated {
        match seen {
            Some(frame) => println!(
                "simulator: first violation in frame {first}; seen in frame {frame}, {} frames \
                 later: a gap between two rings that were linked; {} such links in the last frame",
                frame.saturating_sub(first),
                sheet.torn()
            ),
            None => println!("simulator: first violation in frame {first}; never seen"),
        }
    }
    println!(
        "simulator: {} frames done in {:.1} s",
        args.frames(),
        start.elapsed().as_secs_f64()
    );
    // Verdicts on the last frames may still be pending: the watcher sends them before its goodbye.
    Ok(End::Done)
}
