//! `linkwatch devices`: lists the GPU adapters, their capabilities, and the time of kernels on
//! them.

use super::number::positive;
use super::{Outcome, output};
use linkwatch::Result;
use linkwatch::kernels::{Device, DeviceInfo, devices};
use std::path::PathBuf;

/// List the GPU adapters that kernels can run on; measure them
///
/// Without options, the adapters are listed. `linkwatch devices --calibrate` measures one of them
/// and stores the costs, which `--device auto` needs to choose it. `--measure` reports from which
/// size of a scene on each kernel is faster on the adapter than on the CPU.
#[derive(Debug, clap::Args)]
#[command(group(clap::ArgGroup::new("measured").multiple(true)))]
pub struct Args {
    /// Measure every kernel on these models or scenes, on the adapter (with and without the upload
    /// of the frame) and on the CPU. Without a name: measure scenes of growing size, and print the
    /// size from which on the adapter is faster
    #[arg(long, value_name = "MODEL|SCENE", num_args = 0.., group = "measured")]
    measure: Option<Vec<PathBuf>>,
    /// Measure the costs of counting crossings, direct sums and Barnes-Hut on the adapter and on
    /// the CPU, and store them for `--device auto`
    #[arg(long, group = "measured")]
    calibrate: bool,
    /// Adapter to measure: gpu, or the index or name of an adapter
    #[arg(long, value_name = "DEVICE", default_value_t = Device::Gpu, requires = "measured")]
    device: Device,
    /// Number of runs of each kernel; the median is printed
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..), requires = "measure")]
    repeat: u32,
    /// Skip sums on the CPU that would take longer than this
    #[arg(
        long,
        value_name = "SECONDS",
        default_value_t = 30.0,
        value_parser = positive,
        requires = "measure"
    )]
    limit: f64,
}

/// Runs the command.
pub fn run(args: &Args, json: bool) -> Result<Outcome> {
    if args.calibrate {
        calibrate(&args.device, json)?;
    }
    if let Some(inputs) = &args.measure {
        return measure(args, inputs, json);
    }
    if args.calibrate {
        return Ok(Outcome::Fine);
    }
    let all = devices();
    if json {
        for device in &all {
            output::json(&serde_json::json!(device));
        }
        return Ok(Outcome::Fine);
    }
    if all.is_empty() {
        output::line("no adapters: everything runs on the CPU");
    }
    for device in &all {
        output::line(format_args!("{}: {}", device.index, device.name));
        for line in lines(device) {
            output::line(format_args!("  {line}"));
        }
    }
    Ok(Outcome::Fine)
}

fn lines(d: &DeviceInfo) -> Vec<String> {
    let mib = |bytes: u64| bytes >> 20;
    let kind = match d.software {
        true => "software renderer: correct, but slow",
        false => &d.kind,
    };
    vec![
        format!("{}, {kind}; driver {}", d.backend, d.driver.trim()),
        format!(
            "buffers up to {} MiB, bindings up to {} MiB; double precision: {}",
            mib(d.max_buffer_bytes),
            mib(d.max_binding_bytes),
            if d.double_precision { "yes" } else { "no" },
        ),
        match &d.unusable {
            None => "usable: its arithmetic passed the test".into(),
            Some(why) => format!("not usable: {why}"),
        },
    ]
}

#[cfg(feature = "gpu")]
use measured::{calibrate, measure};

/// Measurements that need an adapter.
#[cfg(feature = "gpu")]
mod measured {
    use super::{Args, Outcome, output};
    use crate::cli::input;
    use linkwatch::kernels::{Device, DeviceTimes, GpuPrecision, Method, SumCost, measure_device};
    use linkwatch::{Result, Verifier, VerifierOptions};
    use serde_json::json;
    use std::path::{Path, PathBuf};

    /// A scene in growing sizes, for a kernel.
    struct Sizes {
        kernel: Method,
        /// Name of the scene.
        scene: &'static str,
        /// Parameters for a hardware adapter, and smaller ones for a software renderer.
        sizes: [[&'static str; 3]; 2],
    }

    const SIZES: [Sizes; 5] = [
        Sizes {
            kernel: Method::Crossings,
            scene: "chainmail",
            sizes: [
                [
                    "rows=14,columns=21",
                    "rows=56,columns=84",
                    "rows=224,columns=336",
                ],
                [
                    "rows=7,columns=10",
                    "rows=20,columns=30",
                    "rows=56,columns=84",
                ],
            ],
        },
        Sizes {
            kernel: Method::Crossings,
            scene: "square_link",
            sizes: [
                [
                    "loops=60,segments=6000",
                    "loops=300,segments=100000",
                    "loops=1250,segments=500000",
                ],
                [
                    "loops=20,segments=2000",
                    "loops=60,segments=6000",
                    "loops=200,segments=40000",
                ],
            ],
        },
        Sizes {
            kernel: Method::Crossings,
            scene: "torus_link",
            sizes: [
                [
                    "segments=20000,toroidal=50,poloidal=50",
                    "segments=400000,toroidal=200,poloidal=200",
                    "segments=4000000,toroidal=500,poloidal=500",
                ],
                [
                    "segments=2000,toroidal=10,poloidal=10",
                    "segments=10000,toroidal=50,poloidal=50",
                    "segments=40000,toroidal=100,poloidal=100",
                ],
            ],
        },
        Sizes {
            kernel: Method::Direct,
            scene: "ribbon",
            sizes: [
                ["segments=2000", "segments=20000", "segments=200000"],
                ["segments=500", "segments=2000", "segments=10000"],
            ],
        },
        Sizes {
            kernel: Method::BarnesHut,
            scene: "knit",
            sizes: [
                [
                    "rows=10,stitches=40,segments=4000",
                    "rows=40,stitches=100,segments=48000",
                    "rows=250,stitches=90,segments=270000",
                ],
                [
                    "rows=3,stitches=16,segments=480",
                    "rows=10,stitches=40,segments=4000",
                    "rows=20,stitches=60,segments=14400",
                ],
            ],
        },
    ];

    /// Measures an adapter and stores the costs that the automatic choice uses.
    pub fn calibrate(device: &Device, json: bool) -> Result<()> {
        let c = linkwatch::plan::calibrate(device)?;
        let file = c.keep()?;
        if json {
            output::json(&json!({ "calibration": c, "file": file }));
            return Ok(());
        }
        output::line(format_args!(
            "{}, compared with the CPU on {}; stored in {}",
            c.adapter,
            output::plural(c.threads as u64, "thread"),
            file.display(),
        ));
        let sum = |name: &str, unit: &str, cost: SumCost| {
            let from = match cost.break_even() {
                Some(n) => format!("faster from {} on", output::count(n)),
                None => "never faster".into(),
            };
            output::line(format_args!(
                "  {name}: {:.3} ms and {:.4} ns per {unit}; CPU {:.4} ns; {from}",
                cost.round_trip_ms, cost.adapter_ns, cost.cpu_ns,
            ));
        };
        sum("direct sums", "pair of segments", c.direct);
        sum("Barnes-Hut", "segment of a pair of curves", c.barnes_hut);
        let k = c.crossings;
        output::line(format_args!(
            "  counting crossings: {:.3} ms and {:.2} ns per segment, {:.1} ns per potential link, \
             {:.2} ns per test, within a factor of {:.1}; CPU {:.2} times its prediction",
            k.round_trip_ms, k.segment_ns, k.link_ns, k.test_ns, k.error_factor, k.cpu_factor,
        ));
        Ok(())
    }

    /// Measures the given scenes, or else each kernel on scenes of growing size.
    pub fn measure(args: &Args, inputs: &[PathBuf], json: bool) -> Result<Outcome> {
        // Opened once for all measurements.
        let keeper = Verifier::new(VerifierOptions {
            device: args.device.clone(),
            ..VerifierOptions::default()
        })?;
        let Some(device) = keeper.device() else {
            return Err(linkwatch::Error::Device(
                "--device must name an adapter".into(),
            ));
        };
        if !json {
            let threads = output::plural(rayon::current_num_threads() as u64, "thread");
            for line in [
                format!(
                    "{}: median milliseconds, without boxes and potential links",
                    device.name
                ),
                "  whole frame: upload of vertices and lists, the kernel, download of the results"
                    .into(),
                "  resident:    the same with the vertices already uploaded".into(),
                format!("  CPU:         the same kernel on {threads}"),
            ] {
                output::line(line);
            }
            output::line(format_args!(
                "  {:12} {:9} {:>12} {:>10} {:>10} {:>14} {:>10}",
                "kernel",
                "precision",
                "whole frame",
                "resident",
                "CPU",
                "largest error",
                "undecided"
            ));
        }
        let mut outcome = Outcome::Fine;
        for input in inputs {
            let all = [Method::Crossings, Method::Direct, Method::BarnesHut];
            let measured = measure_one(args, input, &all, json)?;
            outcome = outcome.max(measured.outcome);
        }
        if !inputs.is_empty() {
            return Ok(outcome);
        }
        let mut found = Vec::new();
        for Sizes {
            kernel,
            scene,
            sizes,
        } in &SIZES
        {
            let mut from = None;
            for parameters in sizes[usize::from(device.software)] {
                let input = PathBuf::from(format!("{scene}:{parameters}"));
                let measured = measure_one(args, &input, &[*kernel], json)?;
                outcome = outcome.max(measured.outcome);
                // If a larger scene is slower again, the size found so far is discarded.
                let first = |t: &&DeviceTimes| t.precision == GpuPrecision::Single;
                let faster = measured
                    .times
                    .iter()
                    .filter(first)
                    .all(DeviceTimes::is_faster);
                from = from
                    .filter(|_| faster)
                    .or(faster.then_some(measured.segments));
            }
            found.push((kernel, scene, from));
        }
        for (kernel, scene, from) in found {
            if json {
                output::json(
                    &json!({ "kernel": kernel, "scene": scene, "faster_from_segments": from }),
                );
                continue;
            }
            output::line(match from {
                Some(n) => format!(
                    "{kernel}: the adapter is faster from {scene} of {} on",
                    output::plural(n, "segment")
                ),
                None => {
                    format!("{kernel}: the adapter is never faster among these sizes of {scene}")
                }
            });
        }
        Ok(outcome)
    }

    /// Measurements of a scene.
    struct Measured {
        segments: u64,
        times: Vec<DeviceTimes>,
        outcome: Outcome,
    }

    fn measure_one(args: &Args, input: &Path, kernels: &[Method], json: bool) -> Result<Measured> {
        let set = input::read(input)?;
        let times = measure_device(&args.device, &set, kernels, args.repeat, args.limit)?;
        let segments = set.segments() as u64;
        if json {
            output::json(&json!({ "model": input, "segments": segments, "kernels": times }));
        } else {
            output::line(format_args!(
                "{}: {}, {}",
                input.display(),
                output::plural(segments, "segment"),
                output::plural(
                    times.first().map_or(0, |t| t.links as u64),
                    "potential link"
                ),
            ));
        }
        let mut outcome = Outcome::Fine;
        for t in &times {
            if !t.equal {
                let precision = t.precision.word();
                tracing::error!(
                    "{}, {precision}: the linking numbers differ from the exact ones",
                    t.kernel
                );
                outcome = Outcome::Changed;
            }
            if !json {
                let cpu = t.cpu_ms.map_or("-".into(), |ms| format!("{ms:.2}"));
                output::line(format_args!(
                    "  {:12} {:9} {:>12.2} {:>10.2} {cpu:>10} {:>14.1e} {:>10}  {}",
                    t.kernel,
                    t.precision.word(),
                    t.whole_ms,
                    t.resident_ms,
                    t.largest_error,
                    t.undecided,
                    if t.equal { "equal" } else { "DIFFERS" },
                ));
            }
        }
        Ok(Measured {
            segments,
            times,
            outcome,
        })
    }
}

#[cfg(not(feature = "gpu"))]
fn calibrate(_: &Device, _: bool) -> Result<()> {
    Err(no_kernels())
}

#[cfg(not(feature = "gpu"))]
fn measure(_: &Args, _: &[PathBuf], _: bool) -> Result<Outcome> {
    Err(no_kernels())
}

#[cfg(not(feature = "gpu"))]
fn no_kernels() -> linkwatch::Error {
    linkwatch::Error::Device("this build has no GPU kernels".into())
}
