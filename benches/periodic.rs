//! Cost of a periodic cell: a sheet of chainmail that ends, and the same sheet in a cell whose
//! images continue it, frame by frame.
//!
//! `cargo bench --bench periodic` measures, or with `-- quiet` only quiet frames; with `--smoke`
//! (or under `cargo test`) it measures a small sheet only. Frames are received as from a simulator:
//! a time is that of the copy and of the verdict. The runs with and without a cell alternate; all
//! times are medians. The expected numbers of links are asserted: each ring at the edge has one
//! more link in the cell.

#[allow(dead_code, reason = "shared with the other benches")]
#[path = "study/src/measure.rs"]
mod measure;

use linkwatch::scenes::Scene;
use linkwatch::{
    Cell, ClearanceOptions, CurveSet, Events, FrameInfo, Positions, RawFrame, Result, Route,
    Session, SessionOptions, Strategy, Verdict,
};
use measure::median;
use std::time::Instant;

/// Distance of neighbouring flat rings of the scene.
const PITCH: f64 = 2.6;

/// Radius of the strands whose clearance is measured.
const RADIUS: f64 = 0.2;

/// Number of frames before the measurement.
const WARM_UP: u64 = 12;

fn main() -> Result<()> {
    let args: Vec<String> = std::env::args().collect();
    let has = |word: &str| args.iter().any(|a| a == word);
    let smoke = !has("--bench") || has("--smoke");
    println!("times of a frame in ms, medians; factor: with a cell / without; potential: the same");
    println!("ratio of the numbers of potential links, which full frames have");
    println!(
        "{:>8} {:>9} {:>9} {:>8} {:>9} {:>9} {:>7} {:>9}",
        "rings", "frames", "links", "images", "without", "with", "factor", "potential"
    );
    println!("and the time of the clearance, without and with a cell, which is not contained");
    let sizes: &[(u32, u32)] = match smoke {
        true => &[(8, 10)],
        false => &[(8, 10), (20, 30), (56, 84)],
    };
    for &(rows, columns) in sizes {
        for (name, strategy, amplitude) in [
            ("full", Strategy::Full, 0.0),
            ("quiet", Strategy::Incremental, 1e-3),
            ("partial", Strategy::Incremental, 0.3),
        ] {
            if !["full", "quiet", "partial"].iter().any(|n| has(n)) || has(name) {
                measure((rows, columns), (name, strategy, amplitude), smoke)?;
            }
        }
    }
    Ok(())
}

fn measure(
    (rows, columns): (u32, u32),
    (name, strategy, amplitude): (&str, Strategy, f64),
    smoke: bool,
) -> Result<()> {
    let scene: Scene = format!("chainmail:rows={rows},columns={columns}").parse()?;
    let set = scene.build()?.curves;
    let edges = [columns, rows].map(|n| f64::from(n) * PITCH);
    let cell = Cell::orthogonal([0.0; 3], [edges[0], edges[1], 0.0]);
    let mut sessions = Vec::new();
    for cell in [None, Some(cell)] {
        let mut options = SessionOptions::default();
        (options.strategy, options.events) = (strategy, Events::Between);
        options.cell = cell;
        options.clearance = Some(ClearanceOptions::new(Some(RADIUS)));
        sessions.push(Session::new(options)?);
    }
    let mut times = [Vec::new(), Vec::new()];
    let mut potential = [0; 2];
    let mut clearances = [Vec::new(), Vec::new()];
    let frames = if smoke { WARM_UP + 6 } else { WARM_UP + 60 };
    let counts: Vec<i32> = set.counts().collect();
    for seq in 0..frames {
        let xyz = moved(&set, amplitude, seq);
        let raw = RawFrame {
            basis: set.basis(),
            counts: &counts,
            positions: Positions::F64(&xyz),
        };
        for k in 0..2 {
            let (session, times) = (&mut sessions[k], &mut times[k]);
            let start = Instant::now();
            let received = session.receive(FrameInfo::at(seq, 0.0), |copy| copy(raw));
            let verified = session.verify(received)?;
            let took = start.elapsed();
            assert_eq!(verified.report.verdict, Verdict::Intact);
            potential[k] = potential[k].max(verified.report.stats.potential_links);
            // The first frames make the baseline and the reference frame. Frames that are expected
            // to be quiet count only if they are.
            let quiet = name != "quiet" || verified.work.route == Route::Quiet;
            if seq >= WARM_UP && quiet {
                let clearance = verified.timings.clearance.as_secs_f64() * 1e3;
                times.push(took.as_secs_f64() * 1e3 - clearance);
                clearances[k].push(clearance);
            }
            session.settle();
        }
    }
    let count = |k: usize| sessions[k].baseline().map_or(0, |b| b.links().len());
    let images = sessions[1]
        .baseline()
        .and_then(|b| b.images())
        .map_or(0, <[_]>::len);
    assert_eq!(count(0), count(1));
    assert_eq!(images, (rows + columns) as usize);
    let counted = times.each_ref().map(Vec::len);
    assert!(
        counted.iter().all(|&n| n > 0),
        "no frame is {name}: {counted:?}"
    );
    let [without, with] = times.map(median);
    let clearances = clearances.map(median);
    let potential = match potential {
        [0, _] => "-".to_owned(),
        [without, with] => format!("{:.2}", with as f64 / without as f64),
    };
    println!(
        "{:>8} {name:>9} {:>9} {images:>8} {without:>9.3} {with:>9.3} {:>7.2} {potential:>9}  ({} \
         and {} frames; clearance {:.3} and {:.3})",
        set.len(),
        count(1),
        with / without,
        counted[0],
        counted[1],
        clearances[0],
        clearances[1],
    );
    Ok(())
}

/// Returns the coordinates of the curves, each moved by at most an amplitude.
fn moved(set: &CurveSet, amplitude: f64, seq: u64) -> Vec<f64> {
    let mut xyz = Vec::with_capacity(3 * set.points());
    for (i, curve) in set.curves().iter().enumerate() {
        // Rings move against one another, less than their distance.
        let phase = seq as f64 + i as f64;
        let by = [phase.sin(), (1.7 * phase).cos(), (2.3 * phase).sin()];
        for k in 0..curve.points as usize {
            let p = set.point(i, k);
            xyz.extend((0..3).map(|x| p[x] + 0.5 * amplitude * by[x]));
        }
    }
    xyz
}
