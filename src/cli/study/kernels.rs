//! `linkwatch study kernels`: speed against error of every kernel, on one scene.
//!
//! The exact certificate comes first; every sum is compared with it. Whatever the error of a sum, the certificate must be
//! the exact one, since only what the proven bound decides is taken from the sum.

use super::frames::{median_of, positive};
use super::plots;
use crate::cli::certify::beta;
use crate::cli::measure::cpu_ms;
use crate::cli::output::{self, plural, plural_of};
use crate::cli::{Outcome, input};
use linkwatch::kernels::{Accuracy, Device, DeviceInfo, Method};
use linkwatch::{AbortOn, Certificate, CurveSet, Ladder, Result, Verifier, homotopic_polylines};
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// The published estimate starts from this beta, with this target (Qu & James 2021, section 3.4.4).
const ESTIMATED: Accuracy = Accuracy {
    beta: Some(2.0),
    target: Some(0.1),
    dipole: false,
};

/// Measure the kernels: speed against error
///
/// Counting crossings, the direct sums, interval arithmetic, and Barnes-Hut by beta, by the proven bound and by the
/// published two-pass estimate. The exit code is 1 where a certificate is not the exact one.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// A model (.bcc, .obj, .vect), or a scene as `linkwatch generate` takes it
    #[arg(value_name = "MODEL|SCENE")]
    input: String,
    /// Betas of Barnes-Hut, separated by commas
    #[arg(
        long,
        value_name = "LIST",
        value_delimiter = ',',
        default_value = "1.5,2,3,4,6,8",
        value_parser = beta
    )]
    betas: Vec<f64>,
    /// Where the kernels run: auto, cpu, gpu, or the name of an adapter (`linkwatch devices`)
    #[arg(long, value_name = "DEVICE", default_value_t = Device::Cpu)]
    device: Device,
    /// Runs of each kernel, for a median
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..))]
    repeat: u32,
    /// Skip sums over all pairs of segments that would take longer than this
    #[arg(long, value_name = "SECONDS", default_value_t = 30.0, value_parser = positive)]
    limit: f64,
    /// Write the table to a file
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Write plots into a folder: error against time and against beta, as PNG and SVG
    #[arg(long, value_name = "DIR")]
    plot: Option<PathBuf>,
}

/// Runs the command.
pub fn run(args: &Args, as_json: bool) -> Result<Outcome> {
    let set = input::read(Path::new(&args.input))?;
    let threads = rayon::current_num_threads();
    let mut verifier = Verifier::new(AbortOn::Never);
    let (certificate, stats) = verifier.certify(&set);
    let exact = certificate.clone();
    // Open from here on, so that no run pays for it.
    verifier.set_device(&args.device)?;
    let device = verifier.device();
    let segment_pairs = match set.basis().is_polyline() {
        true => verifier.segment_pairs(&set),
        false => verifier.segment_pairs(&homotopic_polylines(&set)?.curves),
    };
    if !as_json {
        output::line(format_args!(
            "{}: {} of {}, {} of {}, {}{}; median of {}",
            args.input,
            plural(set.len() as u64, "curve"),
            plural(set.segments() as u64, "segment"),
            plural(stats.potential_links, "potential link"),
            plural_of(segment_pairs, "pair of segments", "pairs of segments"),
            plural(threads as u64, "thread"),
            device
                .as_ref()
                .map_or(String::new(), |d| format!(", {}", d.name)),
            args.repeat,
        ))?;
        output::line(HEADER)?;
    }
    // One pair of curves is summed by one thread.
    let busy = stats.potential_links.clamp(1, threads as u64);
    let mut rows = Vec::new();
    for setting in Setting::all(&args.betas) {
        let seconds =
            setting.ns_a_pair(device.as_ref()).unwrap_or(0.0) * 1e-9 * segment_pairs as f64;
        let row = match seconds / busy as f64 {
            s if s > args.limit => Row::skipped(setting, s),
            _ => Row::measure(setting, &set, &exact, args)?,
        };
        if !as_json {
            output::line(row.line())?;
        }
        rows.push(row);
    }
    if as_json {
        output::json(&json!({
            "model": args.input,
            "curves": set.len(),
            "segments": set.segments(),
            "potential_links": stats.potential_links,
            "segment_pairs": segment_pairs,
            "threads": threads,
            "device": device,
            "repeat": args.repeat,
            "rows": rows.iter().map(Row::json).collect::<Vec<_>>(),
        }))?;
    }
    if let Some(file) = &args.csv {
        std::fs::write(file, csv(&rows))?;
    }
    if let Some(folder) = &args.plot {
        std::fs::create_dir_all(folder)?;
        error_against_time(&args.input, &rows).write(&folder.join("error-time"))?;
        error_against_beta(&args.input, &rows).write(&folder.join("error-beta"))?;
    }
    let differs = |row: &&Row| row.measured.as_ref().is_ok_and(|m| !m.equal);
    let mut outcome = Outcome::Fine;
    for row in rows.iter().filter(differs) {
        tracing::error!("{}: the certificate is not the exact one", row.setting);
        outcome = Outcome::Changed;
    }
    Ok(outcome)
}

/// A kernel at some accuracy.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Setting {
    method: Method,
    accuracy: Accuracy,
}

impl Setting {
    fn all(betas: &[f64]) -> Vec<Setting> {
        let barnes_hut = |beta, dipole| Setting {
            method: Method::BarnesHut,
            accuracy: Accuracy {
                beta,
                target: None,
                dipole,
            },
        };
        let exactly = Method::ALL
            .into_iter()
            .filter(|&m| m != Method::BarnesHut)
            .map(|method| Setting {
                method,
                accuracy: Accuracy::default(),
            });
        let by_beta = [true, false].into_iter().flat_map(|dipole| {
            betas
                .iter()
                .map(move |&beta| barnes_hut(Some(beta), dipole))
        });
        let others = [
            barnes_hut(None, false),
            Setting {
                method: Method::BarnesHut,
                accuracy: ESTIMATED,
            },
        ];
        exactly.chain(by_beta).chain(others).collect()
    }

    /// About what a pair of segments costs a kernel that goes through all of them, in nanoseconds.
    fn ns_a_pair(&self, device: Option<&DeviceInfo>) -> Option<f64> {
        match self.method {
            Method::Direct | Method::AngleSum if device.is_some_and(|d| !d.software) => Some(0.1),
            Method::Direct => Some(6.0),
            Method::AngleSum => Some(5.0),
            Method::Interval => Some(1500.0),
            Method::Crossings | Method::BarnesHut => None,
        }
    }

    fn order(&self) -> Option<&'static str> {
        match (self.method, self.accuracy.dipole) {
            (Method::BarnesHut, true) => Some("dipole"),
            (Method::BarnesHut, false) => Some("quadrupole"),
            _ => None,
        }
    }

    /// What rows of the same curve in a plot share.
    fn series(&self) -> String {
        match (self.order(), self.accuracy) {
            (None, _) => self.method.to_string(),
            (Some(_), Accuracy { beta: None, .. }) => "by the bound".into(),
            (Some(_), accuracy) if accuracy == ESTIMATED => "two passes".into(),
            (Some(order), _) => format!("{order} by β"),
        }
    }

    fn is_by_beta(&self) -> bool {
        self.accuracy.beta.is_some() && self.accuracy.target.is_none()
    }
}

impl std::fmt::Display for Setting {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Accuracy { beta, target, .. } = self.accuracy;
        let text = match (self.order(), beta, target) {
            (None, ..) => self.method.to_string(),
            (Some(order), None, _) => format!("{} {order}, by bound", self.method),
            (Some(order), Some(beta), None) => format!("{} {order}, beta {beta}", self.method),
            (Some(_), Some(beta), Some(target)) => {
                format!("{} beta {beta}, target {target}", self.method)
            }
        };
        f.pad(&text)
    }
}

/// What a kernel took, and how well it summed.
struct Row {
    setting: Setting,
    /// Or the seconds that it would take.
    measured: Result<Measured, f64>,
}

/// Times are medians, in milliseconds.
struct Measured {
    /// The sums alone; for crossings all.
    ms: f64,
    /// Boxes, potential links and counting included.
    total_ms: f64,
    /// Of all processors, for all of it.
    cpu_ms: f64,
    ladder: Ladder,
    equal: bool,
}

const HEADER: &str = "kernel                              sums ms   total ms     cpu ms  \
                      largest error  proven bound   decided   counted  certificate";

impl Row {
    fn skipped(setting: Setting, seconds: f64) -> Row {
        let measured = Err(seconds);
        Row { setting, measured }
    }

    fn measure(setting: Setting, set: &CurveSet, exact: &Certificate, args: &Args) -> Result<Row> {
        let Setting { method, accuracy } = setting;
        let (mut sums, mut totals, mut cpus) = (Vec::new(), Vec::new(), Vec::new());
        let (mut last, mut equal) = (Ladder::default(), true);
        // An adapter compiles its programs once.
        let warm_up = i64::from(args.device != Device::Cpu);
        for run in -warm_up..i64::from(args.repeat) {
            // Each run meets the model for the first time.
            let mut verifier = Verifier::new(AbortOn::Never);
            verifier.set_device(&args.device)?;
            let (start, cpu) = (Instant::now(), cpu_ms());
            let (certificate, _, ladder) = verifier.certify_by(set, method, accuracy)?;
            let total = start.elapsed();
            if run < 0 {
                continue;
            }
            cpus.push(cpu_ms() - cpu);
            let sum = match method {
                Method::Crossings => total,
                _ => ladder.summing,
            };
            sums.push(sum.as_secs_f64() * 1e3);
            totals.push(total.as_secs_f64() * 1e3);
            equal &= certificate == exact;
            last = ladder;
        }
        let measured = Ok(Measured {
            ms: median_of(&sums),
            total_ms: median_of(&totals),
            cpu_ms: median_of(&cpus),
            ladder: last,
            equal,
        });
        Ok(Row { setting, measured })
    }

    /// The largest error of the sums, where there are any.
    fn error(&self) -> Option<f64> {
        let sums = self.setting.method != Method::Crossings;
        let measured = self.measured.as_ref().ok().filter(|_| sums);
        measured.map(|m| m.ladder.largest_error)
    }

    /// The largest bound of the sums that decided, where some did.
    fn bound(&self) -> Option<f64> {
        let measured = self.measured.as_ref().ok();
        measured
            .filter(|m| m.ladder.summed > 0)
            .map(|m| m.ladder.largest_bound)
    }

    fn line(&self) -> String {
        let m = match &self.measured {
            Ok(m) => m,
            Err(s) => return format!("{:33} skipped: about {s:.0} s", self.setting),
        };
        let brief = |x: Option<f64>| x.map_or("-".into(), |x| format!("{x:.1e}"));
        format!(
            "{:33} {:>9.2} {:>10.2} {:>10.2}  {:>13}  {:>12} {:>9} {:>9}  {}",
            self.setting,
            m.ms,
            m.total_ms,
            m.cpu_ms,
            brief(self.error()),
            brief(self.bound()),
            m.ladder.summed,
            m.ladder.counted,
            if m.equal { "equal" } else { "DIFFERS" },
        )
    }

    fn json(&self) -> Value {
        let m = self.measured.as_ref().ok();
        let Accuracy { beta, target, .. } = self.setting.accuracy;
        json!({
            "kernel": self.setting.method,
            "order": self.setting.order(),
            "beta": beta,
            "target": target,
            "ms": m.map(|m| m.ms),
            "total_ms": m.map(|m| m.total_ms),
            "cpu_ms": m.map(|m| m.cpu_ms),
            "largest_error": self.error(),
            "largest_bound": self.bound(),
            "summed": m.map(|m| m.ladder.summed),
            "counted": m.map(|m| m.ladder.counted),
            "equal": m.map(|m| m.equal),
            "skipped_s": self.measured.as_ref().err(),
        })
    }
}

/// The rows, with the names of the JSON above them. No field has a comma.
fn csv(rows: &[Row]) -> String {
    const FIELDS: [&str; 13] = [
        "kernel",
        "order",
        "beta",
        "target",
        "ms",
        "total_ms",
        "cpu_ms",
        "largest_error",
        "largest_bound",
        "summed",
        "counted",
        "equal",
        "skipped_s",
    ];
    let mut text = FIELDS.join(",") + "\n";
    for row in rows {
        let json = row.json();
        let field = |name: &&str| match &json[*name] {
            Value::Null => String::new(),
            Value::String(s) => s.clone(),
            other => other.to_string(),
        };
        let fields: Vec<String> = FIELDS.iter().map(field).collect();
        // Writing to a string does not fail.
        let _ = writeln!(text, "{}", fields.join(","));
    }
    text
}

/// What is exact to the last bit is drawn here, for logarithms.
const LEAST_ERROR: f64 = 1e-16;

const ERROR: &str = "largest error of a linking number";

/// Points of the rows in series, which stand in the order of their first rows.
fn series(rows: &[Row], point: impl Fn(&Row) -> Option<(f64, f64)>) -> Vec<plots::Series> {
    let mut all: Vec<plots::Series> = Vec::new();
    for row in rows {
        let Some(point) = point(row) else { continue };
        let name = row.setting.series();
        match all.iter_mut().find(|s| s.name == name) {
            Some(series) => series.points.push(point),
            None => all.push(plots::Series::marks(name, vec![point])),
        }
    }
    all
}

fn error_against_time(model: &str, rows: &[Row]) -> plots::Plot {
    let point = |row: &Row| {
        let ms = row.measured.as_ref().ok()?.ms;
        Some((ms, row.error()?.max(LEAST_ERROR)))
    };
    let mut series = series(rows, point);
    // What counts has no error that a logarithm could show: a line at its time.
    let counted = rows.iter().find(|r| r.setting.method == Method::Crossings);
    if let Some(Ok(m)) = counted.map(|r| &r.measured) {
        let errors = || series.iter().flat_map(|s| &s.points).map(|p| p.1);
        let (lo, hi) = (
            errors().fold(LEAST_ERROR, f64::min),
            errors().fold(1.0, f64::max),
        );
        let name = "crossings (exact)".into();
        series.push(plots::Series::guide(name, vec![(m.ms, lo), (m.ms, hi)]));
    }
    plots::Plot {
        title: format!("Error against time: {model}"),
        x: "time of the sums (ms)".into(),
        y: format!("{ERROR} (0 at 1e-16)"),
        series,
    }
}

fn error_against_beta(model: &str, rows: &[Row]) -> plots::Plot {
    let point = |row: &Row| {
        let beta = row.setting.accuracy.beta?;
        let error = row.error()?.max(LEAST_ERROR);
        row.setting.is_by_beta().then_some((beta, error))
    };
    let mut series = series(rows, point);
    // Expansions that stop at the dipole should fall as the inverse cube, one order more by one more.
    let guides: Vec<plots::Series> = series
        .iter()
        .zip([("β^-3", -3), ("β^-4", -4)])
        .filter_map(|(of, (name, power))| {
            let &(first, error) = of.points.first()?;
            let at = |&(beta, _): &(f64, f64)| (beta, error * (beta / first).powi(power));
            let points = of.points.iter().map(at).collect();
            Some(plots::Series::guide(name.into(), points))
        })
        .collect();
    series.extend(guides);
    plots::Plot {
        title: format!("Error against β: {model}"),
        x: "β: distance of expanded nodes over the sum of their radii".into(),
        y: ERROR.into(),
        series,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kernel_and_every_beta_has_a_row() {
        let all = Setting::all(&[2.0, 4.0]);
        assert_eq!(all.len(), 4 + 2 * 2 + 2);
        assert_eq!(all.iter().filter(|s| s.is_by_beta()).count(), 4);
        assert_eq!(all[4].to_string(), "barnes-hut dipole, beta 2");
        assert_eq!(all[9].series(), "two passes");
    }
}
