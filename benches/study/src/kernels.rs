//! `study kernels`: speed against error of every kernel, on one scene.
//!
//! The exact certificate is computed first, and every sum is compared with it. Each certificate
//! must be the exact one whatever the error of its sums, because only sums that their proven bound
//! decides are used.

use crate::input::{self, at_least, count, plural, positive, segments, threads, usage};
use crate::measure::{Run, Subject, Table, certifier, repeat};
use crate::plot::{Plot, Series};
use linkwatch::kernels::{Accuracy, Device, Method};
use linkwatch::scenes::Scene;
use linkwatch::{Certifier, Result, SessionOptions};
use std::path::PathBuf;

/// Measure the kernels: speed against error
///
/// Measures counting crossings, direct sums, interval arithmetic, the fast multipole method, and
/// Barnes-Hut by beta, by the proven bound and as published. The exit code is 1 if a certificate is
/// not the exact one.
#[derive(clap::Args)]
pub struct Args {
    /// A model, or a scene as `linkwatch generate` takes it
    #[arg(value_name = "MODEL|SCENE")]
    input: String,
    /// Betas of Barnes-Hut (distance of expanded nodes, in radii), separated by commas
    #[arg(
        long, value_name = "LIST", value_delimiter = ',', default_value = "1.5,2,3,4,6,8",
        value_parser = beta
    )]
    betas: Vec<f64>,
    /// Kernels to measure, separated by commas [default: all]
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    kernels: Vec<Method>,
    /// Also measure a generated scene at these sizes: numbers of segments, separated by commas
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = segments)]
    sizes: Vec<u64>,
    /// Device that runs the kernels: auto, cpu, gpu, or the index or name of an adapter (`linkwatch
    /// devices`)
    #[arg(long, value_name = "DEVICE", default_value_t = Device::Cpu)]
    device: Device,
    #[command(flatten)]
    effort: Effort,
    /// Write plots to a folder, as SVG: error against time and beta, time against size
    #[arg(long, value_name = "DIR")]
    plot: Option<PathBuf>,
}

/// Limits of the measurement of a kernel.
#[derive(Clone, clap::Args)]
pub struct Effort {
    /// Number of runs of each kernel; the median is printed
    #[arg(
        long, value_name = "N", default_value_t = 3,
        value_parser = clap::value_parser!(u32).range(1..)
    )]
    pub repeat: u32,
    /// Skip sums over all pairs of segments that would take longer than this; run anything longer
    /// only once
    #[arg(long, value_name = "SECONDS", default_value_t = 30.0, value_parser = positive)]
    pub limit: f64,
}

fn beta(text: &str) -> Result<f64, String> {
    at_least(1.0, text)
}

/// A kernel at some accuracy.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setting {
    pub method: Method,
    pub accuracy: Accuracy,
}

impl Setting {
    /// Barnes-Hut as published: with this initial beta and target (Qu & James 2021, section 4.1).
    pub const PUBLISHED: Setting = Setting {
        method: Method::BarnesHut,
        accuracy: Accuracy {
            beta: Some(2.0),
            target: Some(0.2),
            dipole: false,
            order: None,
        },
    };

    /// Returns a kernel with its default accuracy.
    pub fn of(method: Method) -> Setting {
        let accuracy = Accuracy::default();
        Setting { method, accuracy }
    }

    fn by_beta(beta: f64, dipole: bool) -> Setting {
        let accuracy = Accuracy {
            beta: Some(beta),
            dipole,
            ..Accuracy::default()
        };
        let method = Method::BarnesHut;
        Setting { method, accuracy }
    }

    /// Returns every kernel; the fast multipole method by order; Barnes-Hut by these betas, by the
    /// bound, and as published.
    fn all(betas: &[f64]) -> Vec<Setting> {
        let kernels = Method::ALL.into_iter().filter(|&m| m != Method::BarnesHut);
        let by_order = [3, 6, 10, 16].map(|order| Setting {
            method: Method::Fmm,
            accuracy: Accuracy {
                order: Some(order),
                ..Accuracy::default()
            },
        });
        let by_beta = [true, false].into_iter().flat_map(|dipole| {
            betas
                .iter()
                .map(move |&beta| Setting::by_beta(beta, dipole))
        });
        let others = [Setting::of(Method::BarnesHut), Setting::PUBLISHED];
        let all = kernels.map(Setting::of).chain(by_order);
        all.chain(by_beta).chain(others).collect()
    }

    /// Returns the kernels to measure at several sizes. Skips interval arithmetic, which is the
    /// direct sum some hundred times slower, and the method that chooses one of the others.
    fn for_sizes() -> Vec<Setting> {
        let skipped = |m: &Method| matches!(m, Method::Auto | Method::Interval);
        let kernels = Method::ALL.into_iter().filter(|m| !skipped(m));
        let by_beta = [Setting::by_beta(4.0, false)];
        kernels.map(Setting::of).chain(by_beta).collect()
    }

    /// Returns the approximate cost per pair of segments, in nanoseconds of one thread, of a kernel
    /// that visits all of them.
    fn ns_a_pair(&self, fast_device: bool) -> f64 {
        match self.method {
            Method::Direct | Method::AngleSum if fast_device => 0.1,
            Method::Direct => 6.0,
            Method::AngleSum => 5.0,
            Method::Interval => 1500.0,
            Method::Auto | Method::Crossings | Method::BarnesHut | Method::Fmm => 0.0,
        }
    }

    /// Returns the order of the expansions of Barnes-Hut.
    fn order(&self) -> &'static str {
        match self.accuracy.dipole {
            true => "dipole",
            false => "quadrupole",
        }
    }

    /// Returns the name of the curve in a plot that joins several accuracies of a kernel.
    fn series(&self) -> String {
        let text = self.to_string();
        text.trim_end_matches(|c: char| c.is_numeric() || " .".contains(c))
            .into()
    }

    /// Returns true if expansions are accepted by beta alone.
    fn is_by_beta(&self) -> bool {
        self.accuracy.beta.is_some() && self.accuracy.target.is_none()
    }
}

impl std::fmt::Display for Setting {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (method, order) = (self.method, self.order());
        let text = match (method, self.accuracy) {
            (Method::Fmm, Accuracy { order: Some(p), .. }) => format!("{method}, order {p}"),
            (Method::BarnesHut, Accuracy { beta: None, .. }) => {
                format!("{method} {order}, by bound")
            }
            (_, Accuracy { beta: None, .. }) => method.to_string(),
            (
                _,
                Accuracy {
                    beta: Some(b),
                    target: None,
                    ..
                },
            ) => {
                format!("{method} {order}, beta {b}")
            }
            (
                _,
                Accuracy {
                    beta: Some(b),
                    target: Some(e),
                    ..
                },
            ) => {
                format!("{method} beta {b}, target {e}")
            }
        };
        f.pad(&text)
    }
}

/// Measurement of a kernel on a subject.
pub struct Row {
    pub setting: Setting,
    /// Number of segments of the subject.
    pub segments: usize,
    /// The measurement, or the predicted seconds if it was skipped.
    pub measured: Result<Run, f64>,
}

impl Row {
    /// Runs a kernel several times, each time with a new certifier, unless that would take too
    /// long. `adapter` is true for a hardware adapter, false for a software renderer, and `None`
    /// for the CPU.
    ///
    /// Errors: the device cannot be used, or failed.
    pub fn measure(
        setting: Setting,
        subject: &Subject,
        effort: &Effort,
        (device, adapter): (&Device, Option<bool>),
    ) -> Result<Row> {
        let ns = setting.ns_a_pair(adapter == Some(true));
        let expected_s = ns * 1e-9 * subject.segment_pairs as f64 / threads() as f64;
        let run = || {
            let mut certifier = Certifier::new(&SessionOptions {
                kernel: setting.method,
                accuracy: setting.accuracy,
                device: device.clone(),
                ..SessionOptions::default()
            })?;
            let run = Run::of(&mut certifier, &subject.curves, &subject.exact);
            match adapter.is_some() && certifier.device().is_none() {
                true => Err(linkwatch::Error::Device("the adapter failed".into())),
                false => Ok(run),
            }
        };
        let measured = if expected_s > effort.limit {
            Err(expected_s)
        } else {
            if adapter.is_some() {
                // An adapter compiles its shaders once, so the first run is not measured.
                run()?;
            }
            let runs: Result<Vec<Run>> = repeat(effort.repeat, effort.limit, run)
                .into_iter()
                .collect();
            Ok(Run::median(&runs?))
        };
        Ok(Row {
            setting,
            segments: subject.curves.segments(),
            measured,
        })
    }

    /// Returns the measurement, unless it was skipped.
    pub fn run(&self) -> Option<&Run> {
        self.measured.as_ref().ok()
    }

    /// Returns the milliseconds of the sums alone, discretization included; for crossings those of
    /// all stages.
    fn ms(&self) -> Option<f64> {
        let times = self.run()?.times;
        Some(match self.counts() {
            true => times.total_ms,
            false => times.summing_ms,
        })
    }

    /// Returns the milliseconds of the linking numbers: the sums, or the counting, which
    /// discretizes pair by pair.
    pub fn linking_ms(&self) -> Option<f64> {
        let times = self.run()?.times;
        Some(match self.counts() {
            true => times.links_ms,
            false => times.summing_ms - times.discretizing_ms,
        })
    }

    /// Returns true if the kernel counts crossings.
    pub fn counts(&self) -> bool {
        matches!(self.setting.method, Method::Auto | Method::Crossings)
    }

    /// Returns the largest error of the sums, if there are any.
    pub fn largest_error(&self) -> Option<f64> {
        let ladder = self.run()?.ladder;
        (ladder.known > 0).then_some(ladder.largest_error)
    }

    /// Returns the mean error of the sums, if there are any.
    fn mean_error(&self) -> Option<f64> {
        let ladder = self.run()?.ladder;
        (ladder.known > 0).then_some(ladder.mean_error)
    }

    /// Returns the largest bound of the sums that decided a pair, if any did.
    fn largest_bound(&self) -> Option<f64> {
        let ladder = self.run()?.ladder;
        (ladder.summed > 0).then_some(ladder.largest_bound)
    }

    /// Returns true if the certificate differs from the exact one.
    pub fn differs(&self) -> bool {
        self.run().is_some_and(|run| !run.equal)
    }
}

/// Runs the command.
pub fn run(args: &Args) -> Result<u8> {
    if let Some(folder) = &args.plot {
        input::create_folder(folder)?;
    }
    let adapter = certifier(&args.device)?.device();
    let device = (&args.device, adapter.as_ref().map(|d| !d.software));
    let subject = Subject::new(&args.input, input::read(&args.input)?)?;
    let own = subject.curves.segments();
    let others = other_sizes(args)?;
    println!(
        "{}: {} of {}, {} of {}, {}{}; median of {}",
        args.input,
        plural(subject.curves.len(), "curve"),
        plural(own, "segment"),
        plural(subject.stats.potential_links as usize, "potential link"),
        plural(subject.segment_pairs as usize, "segment pair"),
        plural(threads(), "thread"),
        adapter
            .as_ref()
            .map_or(String::new(), |d| format!(", {}", d.name)),
        args.effort.repeat,
    );
    let table = table();
    println!("{}", table.header());
    let mut rows = Vec::new();
    let mut measure = |subject: &Subject, settings: &[Setting]| {
        let wanted = |s: &&Setting| args.kernels.is_empty() || args.kernels.contains(&s.method);
        for &setting in settings.iter().filter(wanted) {
            let row = Row::measure(setting, subject, &args.effort, device)?;
            println!("{}", line(&table, &row));
            rows.push(row);
        }
        Ok::<(), linkwatch::Error>(())
    };
    let at_sizes = Setting::for_sizes();
    measure(&subject, &Setting::all(&args.betas))?;
    for scene in &others {
        let subject = Subject::new(&scene.to_string(), scene.build()?.curves)?;
        println!("{} segments:", count(subject.curves.segments() as u64));
        measure(&subject, &at_sizes)?;
    }
    let of_own: Vec<&Row> = rows.iter().filter(|row| row.segments == own).collect();
    for (order, published) in [("dipole", -3), ("quadrupole", -4)] {
        let points = mean_errors(&of_own, order);
        if let Some(power) = power(&points) {
            println!(
                "{order}: the mean error is proportional to beta^{power:.1} (least squares; \
                 published: beta^{published})"
            );
        }
    }
    if let Some(folder) = &args.plot {
        error_against_time(&args.input, &of_own).write(&folder.join("error-time.svg"))?;
        error_against_beta(&args.input, &of_own).write(&folder.join("error-beta.svg"))?;
        if !others.is_empty() {
            let rows = rows.iter().filter(|row| at_sizes.contains(&row.setting));
            let plot = time_against_size(&args.input, rows.collect());
            plot.write(&folder.join("time-size.svg"))?;
        }
    }
    for row in rows.iter().filter(|row| row.differs()) {
        let segments = plural(row.segments, "segment");
        eprintln!(
            "error: {}, {segments}: the certificate differs from the exact one",
            row.setting
        );
    }
    Ok(u8::from(rows.iter().any(Row::differs)))
}

/// Returns the scene at the other sizes.
fn other_sizes(args: &Args) -> Result<Vec<Scene>> {
    if args.sizes.is_empty() {
        return Ok(Vec::new());
    }
    let scene = input::as_scene(&args.input).ok_or_else(|| {
        usage(format!(
            "--sizes: {} is not a generated scene, so its size cannot be changed",
            args.input
        ))
    })?;
    let resized = args.sizes.iter().map(|&size| input::resized(&scene, size));
    let mut scenes: Vec<Scene> = resized.collect::<Result<_>>()?;
    scenes.retain(|s| *s != scene);
    Ok(scenes)
}

fn table() -> Table {
    Table::new([
        ("kernel", -33),
        ("sums ms", 9),
        ("total ms", 10),
        ("cpu ms", 10),
        ("mean error", 13),
        ("largest error", 13),
        ("proven bound", 13),
        ("decided", 9),
        ("counted", 9),
        ("certificate", 12),
    ])
}

fn line(table: &Table, row: &Row) -> String {
    let run = match &row.measured {
        Ok(run) => run,
        Err(s) => return format!("{:33} skipped: about {s:.0} s", row.setting),
    };
    let ms = |ms: f64| format!("{ms:.2}");
    table.row([
        row.setting.to_string(),
        ms(row.ms().unwrap_or(f64::NAN)),
        ms(run.times.total_ms),
        ms(run.times.cpu_ms),
        brief(row.mean_error()),
        brief(row.largest_error()),
        brief(row.largest_bound()),
        run.ladder.summed.to_string(),
        run.ladder.counted.to_string(),
        if run.equal { "equal" } else { "DIFFERS" }.into(),
    ])
}

/// Formats a number with two digits, or a dash.
pub fn brief(x: Option<f64>) -> String {
    x.map_or("-".into(), |x| format!("{x:.1e}"))
}

/// Returns the betas of an expansion, and its mean errors.
fn mean_errors(rows: &[&Row], order: &str) -> Vec<(f64, f64)> {
    let of_order = |row: &&&Row| row.setting.is_by_beta() && row.setting.order() == order;
    let point = |row: &&Row| Some((row.setting.accuracy.beta?, row.mean_error()?));
    rows.iter().filter(of_order).filter_map(point).collect()
}

/// Returns the power of x to which y is proportional, by least squares over the logarithms.
/// Rounding errors do not count. `None` for fewer than three points, or if all have the same x.
fn power(points: &[(f64, f64)]) -> Option<f64> {
    const ROUNDING: f64 = 1e-12;
    let points = points.iter().filter(|p| p.1 > ROUNDING);
    let logs: Vec<(f64, f64)> = points.map(|p| (p.0.ln(), p.1.ln())).collect();
    if logs.len() < 3 {
        return None;
    }
    let n = logs.len() as f64;
    let (x, y) = logs
        .iter()
        .fold((0.0, 0.0), |a, p| (a.0 + p.0 / n, a.1 + p.1 / n));
    let spread: f64 = logs.iter().map(|p| (p.0 - x) * (p.0 - x)).sum();
    let slope = logs.iter().map(|p| (p.0 - x) * (p.1 - y)).sum::<f64>() / spread;
    slope.is_finite().then_some(slope)
}

/// Errors and times below these are drawn here, because the axes are logarithmic.
const LEAST_ERROR: f64 = 1e-16;
const LEAST_TIME: f64 = 1e-4;

/// Plots error against time. Counting has no error that a logarithmic axis could show, so it is
/// drawn as a line at its time.
fn error_against_time(model: &str, rows: &[&Row]) -> Plot {
    let point = |row: &&Row| {
        let ms = row.ms()?.max(LEAST_TIME);
        let error = row.largest_error()?.max(LEAST_ERROR);
        Some((row.setting.series(), (ms, error)))
    };
    let mut series = Series::grouped(rows.iter().filter_map(point));
    let counted = rows.iter().find(|r| r.setting.method == Method::Crossings);
    if let Some(ms) = counted.and_then(|row| row.ms()) {
        let errors = || series.iter().flat_map(|s| &s.points).map(|p| p.1);
        let (lo, hi) = (
            errors().fold(LEAST_ERROR, f64::min),
            errors().fold(1.0, f64::max),
        );
        let ms = ms.max(LEAST_TIME);
        series.push(Series::guide("crossings (exact)", vec![(ms, lo), (ms, hi)]));
    }
    Plot {
        title: format!("Error against time: {model}"),
        x: "time of the sums (ms)",
        y: "largest error of a linking number (0 drawn at 10⁻¹⁶)",
        series,
    }
}

/// Plots the mean error against beta, with the published estimate beside it.
fn error_against_beta(model: &str, rows: &[&Row]) -> Plot {
    let (mut series, mut guides) = (Vec::new(), Vec::new());
    for (order, name, power) in [("dipole", "β⁻³", -3), ("quadrupole", "β⁻⁴", -4)] {
        let mut points = mean_errors(rows, order);
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        for p in &mut points {
            p.1 = p.1.max(LEAST_ERROR);
        }
        if points.is_empty() {
            continue;
        }
        // Through the middle of the points, because single points scatter.
        let scales = points
            .iter()
            .map(|p| p.1.ln() - f64::from(power) * p.0.ln());
        let scale = (scales.sum::<f64>() / points.len() as f64).exp();
        let at = |&(beta, _): &(f64, f64)| (beta, scale * beta.powi(power));
        guides.push(Series::guide(name, points.iter().map(at).collect()));
        series.push(Series::marks(order, points));
    }
    series.extend(guides);
    Plot {
        title: format!("Error against β: {model}"),
        x: "β: distance of expanded nodes over the sum of their radii",
        y: "mean error of a linking number",
        series,
    }
}

/// Plots the total time, from points to proven linking numbers, against the number of segments.
fn time_against_size(model: &str, mut rows: Vec<&Row>) -> Plot {
    rows.sort_by_key(|row| row.segments);
    // Names in the order of the smallest size, which has all of them.
    let point = |row: &&Row| {
        let ms = row.run()?.times.total_ms.max(LEAST_TIME);
        Some((row.setting.to_string(), (row.segments as f64, ms)))
    };
    let mut series = Series::grouped(rows.iter().filter_map(point));
    series.extend(Series::proportional(&series));
    Plot {
        title: format!("Time against size: {model}"),
        x: "segments",
        y: "total time (ms)",
        series,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kernel_and_every_beta_has_a_row() {
        let all = Setting::all(&[2.0, 4.0]);
        let others = Method::ALL.len() - 1 + 4;
        assert_eq!(all.len(), others + 2 * 2 + 2);
        assert_eq!(all.iter().filter(|s| s.is_by_beta()).count(), 4);
        assert_eq!(all[others - 4].to_string(), "fmm, order 3");
        assert_eq!(all[others].to_string(), "barnes-hut dipole, beta 2");
        assert_eq!(
            all[others + 4].to_string(),
            "barnes-hut quadrupole, by bound"
        );
        assert_eq!(all[others].series(), "barnes-hut dipole, beta");
        assert_eq!(Setting::of(Method::Fmm).series(), "fmm");
    }

    #[test]
    fn fits_the_power_of_a_power_law() {
        let points = |power| [1.5, 2.0, 4.0, 8.0].map(|x: f64| (x, 0.1 * x.powi(power)));
        for of in [-4, -3, 0, 2] {
            let found = power(&points(of)).unwrap();
            assert!((found - f64::from(of)).abs() < 1e-12);
        }
        assert_eq!(power(&points(-3)[..2]), None);
        assert_eq!(power(&[(2.0, 0.1); 3]), None);
    }
}
