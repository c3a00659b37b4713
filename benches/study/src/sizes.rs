//! `study sizes`: time and memory of a moving scene against its size. Its frames are on disk, one
//! is read at a time.
//!
//! The frames of each size are generated and written. Two stages follow, each with its own peak
//! memory of this process: the first frame is read and certified; all frames are read and compared
//! with the first one. The certificate is compared with the one that follows from the construction.
//!
//! Limits: peak memory is measured on Linux only. Memory that the allocator kept from an earlier
//! stage counts, so small sizes after large ones would look larger; they are measured in growing
//! order.

use crate::input::{self, count, plural, positive, segments, threads, usage};
use crate::measure::{Table, median, timed};
use crate::plot::{Plot, Series};
use linkwatch::formats::{self, Format, FrameWriter, ModelFrame, ReadOptions};
use linkwatch::scenes::{MotionKind, MovingScene, Scene};
use linkwatch::{
    Certificate, Certifier, Events, FrameInfo, Received, Result, Session, SessionOptions, Strategy,
    Verdict,
};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Measure a moving scene in growing sizes: time and peak memory of each stage
///
/// The frames of each size are written to a file in the current folder and read one at a time; the
/// file is removed after each size. The exit code is 1 if a result is not the one that follows from
/// the construction.
#[derive(clap::Args)]
pub struct Args {
    /// A scene as `linkwatch generate` takes it
    #[arg(value_name = "SCENE")]
    scene: Scene,
    /// Numbers of segments, separated by commas
    #[arg(
        long, value_name = "LIST", value_delimiter = ',', value_parser = segments, required = true
    )]
    sizes: Vec<u64>,
    /// Number of frames
    #[arg(
        long, value_name = "N", default_value_t = 6,
        value_parser = clap::value_parser!(u64).range(2..)
    )]
    frames: u64,
    /// Diameter of the yarn, in units of the scene [default: that of the scene, if it has one]
    #[arg(long, value_name = "D", value_parser = positive)]
    diameter: Option<f64>,
    /// Search for pull-throughs between successive frames
    #[arg(long)]
    events: bool,
    /// Write a plot of the time against the size to a folder, as SVG
    #[arg(long, value_name = "DIR")]
    plot: Option<PathBuf>,
}

/// Amplitude of the smooth motion, in diameters.
const AMPLITUDE: f64 = 0.05;

/// Measurement of one size.
struct Row {
    curves: usize,
    segments: usize,
    /// Size of the positions of a frame, in MB.
    frame_mb: f64,
    /// CPU time of the certificate of the first frame, without reading it, in milliseconds.
    certify_ms: f64,
    /// CPU time of the verification of the first frame, and the median of that of the later ones,
    /// in milliseconds.
    frames_ms: [f64; 2],
    /// Peak memory of the process in MB while one frame is read and certified, and while all are
    /// read and verified, if the system reports it.
    peak_mb: [Option<f64>; 2],
    /// True if the certificate and the verdicts are those that follow from the construction.
    as_constructed: bool,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<u8> {
    let name = args.scene.kind().name;
    let length = input::diameter(args.diameter, Some(&args.scene), name)?;
    let moving = MovingScene {
        motion: MotionKind::Smooth.into(),
        length,
        amplitude: AMPLITUDE * length,
        frames: args.frames,
        pull: None,
    };
    let events = match args.events {
        true => Events::Between,
        false => Events::Off,
    };
    let mut sizes = args.sizes.clone();
    sizes.sort_unstable();
    let scenes = sizes.iter().map(|&size| input::resized(&args.scene, size));
    let scenes: Vec<Scene> = scenes.collect::<Result<_>>()?;
    if let Some(folder) = &args.plot {
        input::create_folder(folder)?;
    }
    println!(
        "{}: {}, {}, events {events}; CPU times without reading the file, peak memory of the \
         process",
        args.scene,
        plural(args.frames as usize, "frame"),
        plural(threads(), "thread"),
    );
    let table = table();
    println!("{}", table.header());
    let file = Scratch(format!("linkwatch-sizes-{}.npz", std::process::id()).into());
    let mut rows = Vec::new();
    for scene in &scenes {
        let row = measure(scene, &moving, events, &file.0)?;
        println!("{}", table.row(cells(&row)));
        rows.push(row);
    }
    if let Some(folder) = &args.plot {
        plot(name, &rows).write(&folder.join("sizes-time.svg"))?;
    }
    Ok(u8::from(rows.iter().any(|row| !row.as_constructed)))
}

/// File that is removed when it is dropped.
struct Scratch(PathBuf);

impl Drop for Scratch {
    fn drop(&mut self) {
        // A file that could not be created need not be removed.
        std::fs::remove_file(&self.0).ok();
    }
}

/// Runs a stage. Returns its peak memory as well, if the system reports it.
fn stage<T>(work: impl FnOnce() -> Result<T>) -> Result<(T, Option<f64>)> {
    // Forgets the peak memory so far.
    let measurable = std::fs::write("/proc/self/clear_refs", "5").is_ok();
    let found = work()?;
    Ok((found, peak_mb().filter(|_| measurable)))
}

/// Returns the peak memory of this process in MB, if the system reports it.
fn peak_mb() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with("VmHWM:"))?;
    let kb: f64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kb / 1024.0)
}

/// Measures one size of a scene.
///
/// Errors: those of the scene, of the file, and of the session.
fn measure(scene: &Scene, moving: &MovingScene, events: Events, file: &Path) -> Result<Row> {
    let (known, sizes) = write_frames(scene, moving, file)?;
    let ((found, certifying), certify_mb) = stage(|| {
        let set = formats::read(file)?;
        let mut certifier = Certifier::default();
        let (found, elapsed) = timed(|| certifier.certify(&set).0.clone());
        Ok((found, elapsed))
    })?;
    let mut as_constructed = found == known;
    drop(found);
    let mut times = Vec::new();
    let (baseline, check_mb) = stage(|| {
        let mut session = Session::new(SessionOptions {
            strategy: Strategy::Incremental,
            events,
            keep_open: true,
            ..SessionOptions::default()
        })?;
        for frame in formats::Frames::open(file, &ReadOptions::default())? {
            let frame = frame?;
            let curves = frame.curves.map_err(|e| e.in_file(file))?;
            let info = FrameInfo::at(frame.info.seq, frame.info.time);
            let frame = Received::new(info, Ok(Arc::new(curves)));
            let (verified, elapsed) = timed(|| session.verify(frame));
            times.push(elapsed.cpu_ms);
            as_constructed &= verified?.report.verdict == Verdict::Intact;
        }
        Ok(session.baseline().cloned())
    })?;
    as_constructed &= baseline.as_ref() == Some(&known);
    let (first, later) = times
        .split_first()
        .ok_or_else(|| usage(format!("{}: no frames", file.display())))?;
    let [curves, segments, points] = sizes;
    Ok(Row {
        curves,
        segments,
        // Generated scenes are in single precision.
        frame_mb: 12e-6 * points as f64,
        certify_ms: certifying.cpu_ms,
        frames_ms: [*first, median(later.iter().copied())],
        peak_mb: [certify_mb, check_mb],
        as_constructed,
    })
}

/// Writes the frames. Returns the certificate of the construction, and the numbers of curves,
/// segments and points.
fn write_frames(
    scene: &Scene,
    moving: &MovingScene,
    file: &Path,
) -> Result<(Certificate, [usize; 3])> {
    let built = scene.build()?;
    let curves = &built.curves;
    let sizes = [curves.len(), curves.segments(), curves.points()];
    let mut writer = FrameWriter::create(file, Format::Npz)?;
    moving.play(built.curves, |seq, curves| {
        let frame = ModelFrame::new(seq, Ok(curves));
        writer.frame(&frame)?;
        frame.curves
    })?;
    writer.finish()?;
    Ok((built.certificate, sizes))
}

fn table() -> Table {
    Table::new([
        ("\ncurves", 10),
        ("\nsegments", 12),
        ("frame\nMB", 8),
        ("certify\nms", 10),
        ("\nMB", 7),
        ("check:\nfirst", 10),
        ("\nlater", 10),
        ("\nMB", 7),
        ("\n results", -1),
    ])
}

fn cells(row: &Row) -> [String; 9] {
    let [certify_mb, check_mb] = row.peak_mb;
    let mb = |mb: Option<f64>| mb.map_or("-".into(), |x| count(x.round() as u64));
    let ms = |ms: f64| format!("{ms:.1}");
    let results = match row.as_constructed {
        true => " as constructed",
        false => " NOT as constructed",
    };
    [
        count(row.curves as u64),
        count(row.segments as u64),
        ms(row.frame_mb),
        ms(row.certify_ms),
        mb(certify_mb),
        ms(row.frames_ms[0]),
        ms(row.frames_ms[1]),
        mb(check_mb),
        results.into(),
    ]
}

/// Plots the CPU times of growing scenes. Other programs on the machine change them less than the
/// elapsed times.
fn plot(scene: &str, rows: &[Row]) -> Plot {
    type Value = fn(&Row) -> f64;
    let all: [(&str, Value); 3] = [
        ("certify", |row| row.certify_ms),
        ("first frame", |row| row.frames_ms[0]),
        ("later frames", |row| row.frames_ms[1]),
    ];
    let points = |value: Value| {
        rows.iter()
            .map(move |row| (row.segments as f64, value(row)))
    };
    let series = |(name, value)| Series::marks(name, points(value).collect());
    let mut series: Vec<Series> = all.into_iter().map(series).collect();
    series.extend(Series::proportional(&series));
    Plot {
        title: format!("CPU time against size: {scene}"),
        x: "segments of a frame",
        y: "CPU time (ms), without reading the file",
        series,
    }
}
