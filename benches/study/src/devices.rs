//! `study devices`: costs of the kernels on an adapter and on the CPU, for `--device auto`.

use crate::fit::{Counts, fit};
use crate::input::{self, count, plural, threads, usage};
use crate::measure::{Run, StageTimes, Subject, certifier, repeat};
use linkwatch::kernels::{Calibration, CountingCost, Device, DeviceInfo, Method, SumCost};
use linkwatch::{Certifier, Error, Plan, Result, SessionOptions, homotopic_polylines};

/// Measure an adapter, and store its costs, so that `--device auto` of linkwatch may choose it
///
/// Measures the costs of counting crossings, direct sums and Barnes-Hut for whole frames on the
/// adapter and on the CPU, and stores them for this user.
#[derive(clap::Args)]
pub struct Args {
    /// Adapter to measure: gpu, or the index or name of an adapter (`linkwatch devices`)
    #[arg(long, value_name = "DEVICE", default_value_t = Device::Gpu)]
    device: Device,
}

/// Limits of each median.
const RUNS: u32 = 5;
const LIMIT_S: f64 = 0.5;

/// Scenes that measure sums: the smallest, which gives the round trip, and one that gives the
/// speed, for a hardware adapter and for a software renderer.
const SMALLEST: &str = "ribbon:segments=200,lambda=1";
const DIRECT: [&str; 2] = [
    "ribbon:segments=100000,lambda=10",
    "ribbon:segments=6000,lambda=10",
];
/// Scene that measures direct sums on the CPU.
const DIRECT_HERE: &str = "ribbon:segments=6000,lambda=10";
const BARNES_HUT: [&str; 2] = [
    "knit:rows=40,stitches=100,segments=48000",
    "knit:rows=10,stitches=40,segments=4000",
];

/// Scene that measures the round trip of counting: it has hardly any work.
const COUNTED_FIRST: &str = "ribbon:segments=60,lambda=1";
/// Scenes that measure the costs of counting: many small links, many segments, many crossings of
/// long curves and of short ones. For a hardware adapter, and for a software renderer.
const COUNTED: [[&str; 7]; 2] = [
    [
        "chainmail:rows=8,columns=8",
        "chainmail:rows=40,columns=40",
        "chainmail:rows=160,columns=160",
        "ribbon:segments=2000000,lambda=10",
        "woundball:segments=400000,crossings=300",
        "torus_link:segments=200000,toroidal=200,poloidal=200",
        "square_link:loops=300,segments=100000",
    ],
    [
        "chainmail:rows=4,columns=4",
        "chainmail:rows=20,columns=20",
        "chainmail:rows=50,columns=50",
        "ribbon:segments=100000,lambda=10",
        "woundball:segments=20001,crossings=100",
        "torus_link:segments=4000,toroidal=30,poloidal=20",
        "square_link:loops=60,segments=6000",
    ],
];

/// Runs the command.
pub fn run(args: &Args) -> Result<u8> {
    // Opened once for all measurements.
    let keeper = certifier(&args.device)?;
    let adapter = keeper.device();
    let adapter = &adapter.ok_or_else(|| usage("--device must name an adapter".into()))?;
    let software = usize::from(adapter.software);
    let smallest = polylines(SMALLEST)?;
    let sum_ms = |t: StageTimes| t.summing_ms;
    let sum_cost = |method, large: &Subject, work: u64, cpu_ns: f64| {
        let round_trip_ms = on_adapter(method, &smallest, adapter, sum_ms)?;
        let ms = on_adapter(method, large, adapter, sum_ms)?;
        Ok::<_, Error>(SumCost {
            round_trip_ms,
            adapter_ns: (ms - round_trip_ms).max(SHORTEST_MS) * 1e6 / work as f64,
            cpu_ns,
        })
    };
    let (large, here) = (polylines(DIRECT[software])?, polylines(DIRECT_HERE)?);
    let cpu_ns = 1e6 * on_cpu(Method::Direct, &here, sum_ms)? / here.segment_pairs as f64;
    let direct = sum_cost(Method::Direct, &large, large.segment_pairs, cpu_ns)?;
    let large = polylines(BARNES_HUT[software])?;
    let work = segments_of_links(&large);
    let cpu_ns = 1e6 * on_cpu(Method::BarnesHut, &large, sum_ms)? / work as f64;
    let barnes_hut = sum_cost(Method::BarnesHut, &large, work, cpu_ns)?;
    let count_ms = |t: StageTimes| t.links_ms;
    let method = Method::Crossings;
    let round_trip_ms = on_adapter(method, &polylines(COUNTED_FIRST)?, adapter, count_ms)?;
    let (mut rows, mut factors) = (Vec::new(), 0.0);
    for text in COUNTED[software] {
        let subject = polylines(text)?;
        let plan = Plan::of(&subject.curves);
        let counts = Counts {
            segments: subject.curves.segments() as u64,
            links: (plan.potential_links - plan.discarded) as u64,
            tests: subject.stats.tests,
        };
        rows.push((counts, on_adapter(method, &subject, adapter, count_ms)?));
        // With the search for repeated vertices, as predicted.
        let after_pairs = |t: StageTimes| t.total_ms - t.boxes_ms - t.pairs_ms;
        factors += (on_cpu(method, &subject, after_pairs)? / plan.links.ms).ln();
    }
    let cpu_factor = (factors / rows.len() as f64).exp();
    let calibration = Calibration {
        direct,
        barnes_hut,
        crossings: fit(&rows, round_trip_ms, cpu_factor),
        ..always_chosen(adapter)
    };
    let file = calibration.keep()?;
    println!(
        "{}, compared with the CPU on {}; stored in {}",
        calibration.adapter,
        plural(calibration.threads, "thread"),
        file.display(),
    );
    print(&calibration);
    Ok(0)
}

fn print(c: &Calibration) {
    let sum = |name: &str, unit: &str, cost: SumCost| {
        let from = match cost.break_even() {
            Some(n) => format!("faster from {} on", count(n)),
            None => "never faster".into(),
        };
        println!(
            "  {name}: {:.3} ms and {:.4} ns per {unit}; CPU {:.4} ns; {from}",
            cost.round_trip_ms, cost.adapter_ns, cost.cpu_ns,
        );
    };
    sum("direct sums", "pair of segments", c.direct);
    sum("Barnes-Hut", "segment of a pair of curves", c.barnes_hut);
    let k = c.crossings;
    println!(
        "  counting crossings: {:.3} ms and {:.2} ns per segment, {:.1} ns per potential link, \
         {:.2} ns per test, within a factor of {:.1}; CPU {:.2} times its prediction",
        k.round_trip_ms, k.segment_ns, k.link_ns, k.test_ns, k.error_factor, k.cpu_factor,
    );
}

/// Minimum of a measured time after the round trip is subtracted.
const SHORTEST_MS: f64 = 1e-3;

/// Builds a scene, and certifies its polylines.
fn polylines(text: &str) -> Result<Subject> {
    let mut curves = input::read(text)?;
    if !curves.basis().is_polyline() {
        curves = homotopic_polylines(&curves)?.curves;
    }
    Subject::new(text, curves)
}

/// Returns the number of segments, counted once for each potential link: the work of Barnes-Hut.
/// The curves must be equally long, as the rows of a knitted tube are.
fn segments_of_links(subject: &Subject) -> u64 {
    let curves = &subject.curves;
    let plan = Plan::of(curves);
    let links = plan.potential_links - plan.discarded;
    (2 * links * curves.segments() / curves.len().max(1)) as u64
}

/// Returns the median time of a kernel on an adapter, in milliseconds, after a run that compiles
/// shaders and allocates buffers.
fn on_adapter(
    method: Method,
    subject: &Subject,
    adapter: &DeviceInfo,
    time: fn(StageTimes) -> f64,
) -> Result<f64> {
    let mut certifier = Certifier::new(&SessionOptions {
        kernel: method,
        device: Device::Auto,
        calibration: Some(always_chosen(adapter)),
        ..SessionOptions::default()
    })?;
    let ms = time(measured(&mut certifier, subject).times);
    match certifier.device() {
        Some(_) => Ok(ms),
        None => Err(Error::Device(format!("{} failed", adapter.name))),
    }
}

/// Returns the median time of a kernel on the CPU, in milliseconds.
fn on_cpu(method: Method, subject: &Subject, time: fn(StageTimes) -> f64) -> Result<f64> {
    let mut certifier = Certifier::new(&SessionOptions {
        kernel: method,
        ..SessionOptions::default()
    })?;
    Ok(time(measured(&mut certifier, subject).times))
}

fn measured(certifier: &mut Certifier, subject: &Subject) -> Run {
    let mut run = || Run::of(certifier, &subject.curves, &subject.exact);
    run();
    Run::median(&repeat(RUNS, LIMIT_S, run))
}

/// Returns costs with which an adapter is always predicted to be faster.
fn always_chosen(adapter: &DeviceInfo) -> Calibration {
    let sum = SumCost {
        round_trip_ms: 1e-9,
        adapter_ns: 1e-9,
        cpu_ns: 1e9,
    };
    Calibration {
        adapter: adapter.name.clone(),
        backend: adapter.backend.clone(),
        driver: adapter.driver.clone(),
        threads: threads(),
        direct: sum,
        barnes_hut: sum,
        crossings: CountingCost {
            round_trip_ms: 1e-9,
            segment_ns: 0.0,
            link_ns: 0.0,
            test_ns: 0.0,
            error_factor: 1.0,
            cpu_factor: 1e9,
        },
    }
}
