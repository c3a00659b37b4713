//! Verifies one frame in process, again and again, as a simulator in Rust would. Prints the median
//! time in milliseconds. `examples/python/in_process_cost.py` compares it with Python.
//!
//! ```sh
//! cargo run --release --example in_process_cost -- MODEL [REPEAT]
//! ```

use linkwatch::{FrameInfo, Positions, RawFrame, Session, SessionOptions, Strategy, Verdict};
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut args = std::env::args().skip(1);
    let model = args.next().ok_or("expected a model")?;
    let repeat: usize = args.next().map_or(Ok(25), |n| n.parse())?;
    let curves = linkwatch::formats::read(model.as_ref())?;
    let counts: Vec<i32> = curves.counts().collect();
    let mut points: Vec<f32> = Vec::new();
    for (i, curve) in curves.curves().iter().enumerate() {
        let curve = (0..curve.points as usize).map(|k| curves.point(i, k));
        points.extend(curve.flatten().map(|x| x as f32));
    }
    let mut session = Session::new(SessionOptions {
        strategy: Strategy::Full,
        ..SessionOptions::default()
    })?;
    let mut times = Vec::new();
    for seq in 0..=repeat as u64 {
        let frame = RawFrame {
            basis: curves.basis(),
            counts: &counts,
            positions: Positions::F32(&points),
        };
        let start = Instant::now();
        let report = session.feed(FrameInfo::at(seq, 0.0), frame)?;
        times.push(start.elapsed());
        assert_eq!(report.verdict, Verdict::Intact);
    }
    // The first frame allocates, and makes the baseline.
    times.remove(0);
    times.sort();
    println!("{}", times[times.len() / 2].as_secs_f64() * 1e3);
    Ok(())
}
