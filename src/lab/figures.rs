//! Plots of rows: error against time, error against beta, time and memory against size.

use super::kernels::KernelRow;
use super::plot::{Plot, Series};
use super::scaling::ScalingRow;
use super::slopes;
use crate::kernels::Method;

/// Errors below this are drawn here, because the axis is logarithmic.
const LEAST_ERROR: f64 = 1e-16;

/// Times below this are drawn here, in milliseconds, because the axis is logarithmic.
const LEAST_TIME: f64 = 1e-4;

/// Groups points into series, in the order of their first points.
fn series(points: impl Iterator<Item = (String, (f64, f64))>) -> Vec<Series> {
    let mut all: Vec<Series> = Vec::new();
    for (name, point) in points {
        match all.iter_mut().find(|s| s.name == name) {
            Some(series) => series.points.push(point),
            None => all.push(Series::marks(name, vec![point])),
        }
    }
    all
}

/// Plots error against time. Counting has no error that a logarithmic axis could show, so it is
/// drawn as a line at its time.
pub fn error_against_time(model: &str, rows: &[KernelRow]) -> Plot {
    let point = |row: &KernelRow| {
        let ms = row.ms()?.max(LEAST_TIME);
        let error = row.largest_error()?.max(LEAST_ERROR);
        Some((row.setting.series(), (ms, error)))
    };
    let mut series = series(rows.iter().filter_map(point));
    let counted = rows.iter().find(|r| r.setting.method == Method::Crossings);
    if let Some(ms) = counted.and_then(KernelRow::ms) {
        let errors = || series.iter().flat_map(|s| &s.points).map(|p| p.1);
        let lo = errors().fold(LEAST_ERROR, f64::min);
        let hi = errors().fold(1.0, f64::max);
        let ms = ms.max(LEAST_TIME);
        let name = "crossings (exact)".into();
        series.push(Series::guide(name, vec![(ms, lo), (ms, hi)]));
    }
    Plot {
        title: format!("Error against time: {model}"),
        x: "time of the sums (ms)".into(),
        y: "largest error of a linking number (0 drawn at 10⁻¹⁶)".into(),
        series,
    }
}

/// Plots the mean error against beta, with the published estimate beside it.
pub fn error_against_beta(model: &str, rows: &[KernelRow]) -> Plot {
    let mut series = Vec::new();
    let mut guides = Vec::new();
    for (order, name, power) in [("dipole", "β⁻³", -3), ("quadrupole", "β⁻⁴", -4)] {
        let mut points = slopes::points(rows, order);
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        for p in &mut points {
            p.1 = p.1.max(LEAST_ERROR);
        }
        if points.is_empty() {
            continue;
        }
        // Through the middle of the points, because single points scatter.
        let n = points.len() as f64;
        let scales = points
            .iter()
            .map(|p| p.1.ln() - f64::from(power) * p.0.ln());
        let scale = (scales.sum::<f64>() / n).exp();
        let at = |&(beta, _): &(f64, f64)| (beta, scale * beta.powi(power));
        guides.push(Series::guide(name.into(), points.iter().map(at).collect()));
        series.push(Series::marks(order.into(), points));
    }
    series.extend(guides);
    Plot {
        title: format!("Error against β: {model}"),
        x: "β: distance of expanded nodes over the sum of their radii".into(),
        y: "mean error of a linking number".into(),
        series,
    }
}

/// Plots the total time, from points to proven linking numbers, against the number of segments.
pub fn time_against_size<'a>(model: &str, rows: impl Iterator<Item = &'a KernelRow>) -> Plot {
    let mut rows: Vec<&KernelRow> = rows.filter(|row| row.segments > 0).collect();
    rows.sort_by_key(|row| row.segments);
    // Names in the order of the smallest size, which has all of them.
    let point = |row: &&KernelRow| {
        let ms = row.run()?.times.total_ms.max(LEAST_TIME);
        let name = match row.setting.accuracy.beta {
            Some(beta) => format!("{} β {beta}", row.setting.method),
            None => row.setting.series(),
        };
        Some((name, (row.segments as f64, ms)))
    };
    let mut series = series(rows.iter().filter_map(point));
    let sizes = rows.first().zip(rows.last());
    if let Some((first, last)) = sizes.map(|(a, b)| (a.segments as f64, b.segments as f64)) {
        let least = series.iter().filter_map(|s| s.points.first());
        let least = least.map(|p| p.1).fold(f64::INFINITY, f64::min);
        if last > first && least < f64::INFINITY {
            let grown = vec![(first, least), (last, least * last / first)];
            series.push(Series::guide("∝ segments".into(), grown));
        }
    }
    Plot {
        title: format!("Time against size: {model}"),
        x: "segments".into(),
        y: "total time (ms)".into(),
        series,
    }
}

/// A value of a row, if it has it.
type RowValue<'a> = &'a dyn Fn(&ScalingRow) -> Option<f64>;

/// Returns a plot of one quantity of growing scenes against their size: series with a name and a
/// value of each row that has one. A guide grows with the number of segments, from the first point
/// of the first series.
fn scaling_plot(
    (title, y): (String, &str),
    rows: &[ScalingRow],
    all: &[(String, RowValue<'_>)],
) -> Plot {
    let mut series = Vec::new();
    for (name, value) in all {
        let point = |row: &ScalingRow| Some((row.segments as f64, value(row)?));
        let points: Vec<_> = rows.iter().filter_map(point).collect();
        if !points.is_empty() {
            series.push(Series::marks(name.clone(), points));
        }
    }
    let guide = series.first().and_then(|s| match s.points[..] {
        [(first, least), .., (last, _)] => Some(vec![(first, least), (last, least * last / first)]),
        _ => None,
    });
    series.extend(guide.map(|points| Series::guide("∝ segments".into(), points)));
    Plot {
        title,
        x: "segments of a frame".into(),
        y: y.into(),
        series,
    }
}

/// Plots the CPU times of growing scenes against their size. Other programs on the machine change
/// them less than the elapsed times.
pub fn scaling_time(scene: &str, rows: &[ScalingRow]) -> Plot {
    let title = format!("CPU time against size: {scene}");
    let certify = |row: &ScalingRow| Some(row.certificate_cpu_ms);
    let first = |row: &ScalingRow| row.check.map(|c| c.cpu_ms[0]);
    let later = |row: &ScalingRow| row.check.map(|c| c.cpu_ms[1]);
    scaling_plot(
        (title, "CPU time (ms), without reading the file"),
        rows,
        &[
            ("certify".into(), &certify),
            ("first frame".into(), &first),
            ("later frames".into(), &later),
        ],
    )
}

/// Plots the peak memory of growing scenes against their size.
pub fn scaling_memory(scene: &str, rows: &[ScalingRow]) -> Plot {
    let title = format!("Peak memory against size: {scene}");
    let frame = |row: &ScalingRow| Some(row.frame_mb);
    let generate = |row: &ScalingRow| row.generate.peak_mb;
    let certify = |row: &ScalingRow| row.certify.peak_mb;
    let check = |row: &ScalingRow| row.check.and_then(|c| c.all.peak_mb);
    scaling_plot(
        (title, "peak memory of the process (MB)"),
        rows,
        &[
            ("positions of a frame".into(), &frame),
            ("generate".into(), &generate),
            ("certify".into(), &certify),
            ("check".into(), &check),
        ],
    )
}
