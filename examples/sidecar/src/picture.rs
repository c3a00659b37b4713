//! Draws the place where a scene broke, from the recording, as an SVG file.

use linkwatch::{CurveSet, Point, RecordedItem, RecordingReader, Report, Result, Verdict};
use std::fmt::Write;
use std::path::Path;

/// Width of the picture in pixels.
const WIDTH: f64 = 800.0;

/// Width of a line in pixels, and of its white border, which shows the lines that pass behind it.
const LINE: f64 = 5.0;
const BORDER: f64 = 13.0;

/// Draws the first frame in which the topology changed, up to the distance `reach` from the place.
/// If there is none, removes the picture of an earlier run, which would contradict this run, and
/// returns false.
pub fn draw(recording: &Path, picture: &Path, reach: f64) -> Result<bool> {
    let drawn = first_change(recording, reach)?;
    match &drawn {
        Some(text) => std::fs::write(picture, text)?,
        None if picture.exists() => std::fs::remove_file(picture)?,
        None => {}
    }
    Ok(drawn.is_some())
}

/// Returns the picture of the first frame in which the topology changed.
fn first_change(recording: &Path, reach: f64) -> Result<Option<String>> {
    let mut reader = RecordingReader::open(recording)?;
    let mut curves = None;
    while let Some(item) = reader.next_item()? {
        match item {
            RecordedItem::Frame(frame) => frame.ingest(&mut curves)?,
            RecordedItem::Verdict(v) if v.report.verdict == Verdict::Changed => {
                return Ok(curves.and_then(|set| svg(&set, &v.report, reach)));
            }
            _ => {}
        }
    }
    Ok(None)
}

/// Draws the surroundings of the first pull-through or changed linking number of a report, seen
/// from a direction in which both curves are open.
fn svg(set: &CurveSet, report: &Report, reach: f64) -> Option<String> {
    let pulled = report.events.first().map(|e| ([e.i, e.j], e.point));
    let changed = report.changes.first();
    let (pair, center) =
        pulled.or_else(|| changed.and_then(|c| Some(([c.i, c.j], c.place?.point))))?;
    let [across, up, towards] = view(pair.map(|i| normal(set, i as usize)));
    // Segments with their depth, colour and ends; the farthest is drawn first.
    let mut segments = Vec::new();
    for i in 0..set.len() {
        let color = match pair.iter().position(|&j| j as usize == i) {
            Some(0) => "#d62728",
            Some(_) => "#e8871e",
            None => "#b5bac2",
        };
        let project = |p: Point| {
            let d = [0, 1, 2].map(|k| p[k] - center[k]);
            [dot(d, across), -dot(d, up), dot(d, towards)]
        };
        let points = set.curve(i).points as usize;
        for k in 0..points {
            let [a, b] = [k, (k + 1) % points].map(|k| project(set.point(i, k)));
            if [a, b].as_flattened().iter().all(|x| x.abs() < 2.0 * reach) {
                segments.push((a[2] + b[2], color, a, b));
            }
        }
    }
    segments.sort_by(|a, b| a.0.total_cmp(&b.0));
    let half = WIDTH / 2.0;
    let pixel = |x: f64| half + x * half / reach;
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{WIDTH}\" height=\"{WIDTH}\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n<g>\n"
    );
    for (_, color, a, b) in segments {
        let ends = format!(
            "x1=\"{:.1}\" y1=\"{:.1}\" x2=\"{:.1}\" y2=\"{:.1}\"",
            pixel(a[0]),
            pixel(a[1]),
            pixel(b[0]),
            pixel(b[1])
        );
        // Writing to a string cannot fail.
        for (color, width, end) in [("white", BORDER, "butt"), (color, LINE, "round")] {
            let _ = writeln!(
                text,
                "<line {ends} stroke=\"{color}\" stroke-width=\"{width}\" \
                 stroke-linecap=\"{end}\"/>"
            );
        }
    }
    let _ = writeln!(
        text,
        "</g>\n<circle cx=\"{half}\" cy=\"{half}\" r=\"14\" fill=\"none\" stroke=\"#1f5fd6\" \
         stroke-width=\"4\"/>\n<g font-family=\"sans-serif\" font-size=\"12\">"
    );
    let title = format!("frame {} at {:.6} s", report.seq, report.time);
    for (k, line) in std::iter::once(title)
        .chain(report.findings())
        .take(3)
        .enumerate()
    {
        let _ = writeln!(text, "<text x=\"12\" y=\"{}\">{line}</text>", 24 + 20 * k);
    }
    text.push_str("</g>\n</svg>\n");
    Some(text)
}

/// Returns the directions to the right, up and towards the viewer, who sees curves with these
/// normals open.
fn view([a, b]: [Point; 2]) -> [Point; 3] {
    let sign = if dot(a, b) < 0.0 { -1.0 } else { 1.0 };
    let towards = unit([0, 1, 2].map(|k| a[k] + sign * b[k]));
    // The axis that is farthest from the direction of view.
    let axis = [0, 1, 2]
        .into_iter()
        .min_by(|&k, &l| towards[k].abs().total_cmp(&towards[l].abs()));
    let mut other = [0.0; 3];
    other[axis.unwrap_or(0)] = 1.0;
    let across = unit(cross(other, towards));
    [across, cross(towards, across), towards]
}

/// Returns the normal of a polygon, of length 1.
fn normal(set: &CurveSet, i: usize) -> Point {
    let points = set.curve(i).points as usize;
    let origin = set.point(i, 0);
    let mut sum = [0.0; 3];
    for k in 0..points {
        let [a, b] = [k, (k + 1) % points].map(|k| {
            let p = set.point(i, k);
            [0, 1, 2].map(|d| p[d] - origin[d])
        });
        let area = cross(a, b);
        (0..3).for_each(|d| sum[d] += area[d]);
    }
    unit(sum)
}

fn dot(a: Point, b: Point) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: Point, b: Point) -> Point {
    [0, 1, 2].map(|k| {
        let (l, m) = ((k + 1) % 3, (k + 2) % 3);
        a[l] * b[m] - a[m] * b[l]
    })
}

fn unit(a: Point) -> Point {
    let length = dot(a, a).sqrt().max(f64::MIN_POSITIVE);
    a.map(|x| x / length)
}
