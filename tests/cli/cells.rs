//! Commands on files with a periodic cell.

use crate::support::command::{Run, linkwatch, text};
use linkwatch::model::{Format, FrameWriter, ModelFrame};
use linkwatch::{Basis, CurveSet, Positions};
use std::path::{Path, PathBuf};
use tempfile::TempDir;

type Point = [f64; 3];

/// Returns a closed polygon with `parts` points on each side.
fn polygon<const N: usize>(corners: [Point; N], parts: usize) -> Vec<Point> {
    let side = |k: usize| {
        let [p, q] = [k, (k + 1) % N].map(|k| corners[k]);
        (0..parts).map(move |n| {
            let share = n as f64 / parts as f64;
            [0, 1, 2].map(|x| p[x] + (q[x] - p[x]) * share)
        })
    };
    (0..N).flat_map(side).collect()
}

/// Writes frames of two closed curves in a cell. Frame `k` has the number `k` and the time
/// `0.5 k`.
fn write(folder: &Path, name: &str, cell: &str, frames: &[[Vec<Point>; 2]]) -> PathBuf {
    let path = folder.join(name);
    let mut writer = FrameWriter::create(&path, Format::of(&path).unwrap()).unwrap();
    for (k, curves) in frames.iter().enumerate() {
        let counts = curves.each_ref().map(|curve| -(curve.len() as i32));
        let xyz = curves.concat().concat();
        let set = CurveSet::from_counts(Basis::Polyline, &counts, Positions::F64(&xyz)).unwrap();
        let mut frame = ModelFrame::new(k as u64, Ok(set));
        frame.time = 0.5 * k as f64;
        frame.cell = Some(cell.parse().unwrap());
        writer.frame(&frame).unwrap();
    }
    writer.finish().unwrap();
    path
}

/// Writes a ring that is longer than the cell and one that moves along it. In frame 2 the second
/// ring leaves the first one and links with an image of it, from frame 5 on with none.
fn two_images(folder: &Path) -> PathBuf {
    let long = [
        [-1.5, -1.0, 0.0],
        [3.5, -1.0, 0.0],
        [3.5, 1.0, 0.0],
        [-1.5, 1.0, 0.0],
    ];
    let frame = |shift: f64| {
        let [near, far] = [2.9 + shift, 3.9 + shift];
        let ring = [[near, -1.0], [far, -1.0], [far, 1.0], [near, 1.0]];
        [polygon(long, 6), polygon(ring.map(|[x, z]| [x, 0.0, z]), 6)]
    };
    let shifts = [0.0, 0.0, -0.6, -0.6, -0.6, -1.7, -1.7];
    write(folder, "two.npz", "4,10,10", &shifts.map(frame))
}

#[test]
fn images_of_one_pair_are_findings_of_their_own() {
    let folder = TempDir::new().unwrap();
    let (model, recording) = (two_images(folder.path()), folder.path().join("two.mcap"));
    let pairs = folder.path().join("pairs.csv");
    let options = ["--record", text(&recording), "--diff-pairs", text(&pairs)];
    let run = linkwatch(&[&["check", text(&model)], &options[..]].concat());
    assert_eq!(run.code, 1, "{}", run.stderr);
    let gained = "curve 0 and the image -1,0,0 of curve 1 became linked: linking number was 0";
    assert_eq!(run.stdout.matches(gained).count(), 1, "{}", run.stdout);
    let lost = "curves 0 and 1 came apart: linking number was -1, is 0";
    assert_eq!(run.stdout.matches(lost).count(), 1, "{}", run.stdout);
    let pairs = std::fs::read_to_string(&pairs).unwrap();
    assert_eq!(pairs, "0,1,-1,0,0,0,1\n0,1,0,0,0,-1,0\n");
    let report = linkwatch(&["report", text(&recording), "--text"]);
    let rows = [
        "frame 2 at 1 s: curve 0 and the image -1,0,0 of curve 1: link gained: expected 0, found 1",
        "frame 2 at 1 s: curves 0 and 1: link lost: expected -1, found 0",
    ];
    for (row, frames) in rows.into_iter().zip(["3 frames, to 4", "5 frames, to 6"]) {
        let line = report.stdout.lines().find(|line| line.contains(row));
        let line = line.unwrap_or_else(|| panic!("{row}: {}", report.stdout));
        assert!(line.ends_with(frames), "{line}");
    }
    let report = linkwatch(&["report", text(&recording), "--json"]);
    let report: serde_json::Value = serde_json::from_str(&report.stdout).unwrap();
    let images = report["pairs"].as_array().unwrap().iter();
    let images: Vec<_> = images.map(|pair| pair["image"].to_string()).collect();
    assert_eq!(images, ["[-1,0,0]", "[0,0,0]"]);
}
