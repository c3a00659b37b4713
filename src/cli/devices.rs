//! `linkwatch devices`: the graphics processors that there are, what each can do, and what kernels take there.

use super::{Outcome, output};
use linkwatch::Result;
use linkwatch::kernels::{Device, DeviceInfo, devices};
use std::path::PathBuf;

/// List the graphics processors that kernels can run on; measure them
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Measure every kernel on these models or scenes, whole frames and frames that are on the device already, beside
    /// the processor
    #[arg(
        long,
        value_name = "MODEL|SCENE",
        num_args = 0..,
        default_missing_values = DEFAULT_SCENES,
    )]
    measure: Option<Vec<PathBuf>>,
    /// Measure what a direct sum takes there and here, and keep it: `--device auto` goes by that
    #[arg(long)]
    calibrate: bool,
    /// The one to measure: gpu, or the name of an adapter
    #[arg(long, value_name = "DEVICE", default_value_t = Device::Gpu)]
    device: Device,
    /// Runs of each kernel, for a median
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..))]
    repeat: u32,
    /// Leave out sums on the processor that would take longer than this
    #[arg(long, value_name = "SECONDS", default_value_t = 30.0)]
    limit: f64,
}

/// What a device is measured on where nothing is named.
const DEFAULT_SCENES: [&str; 3] = [
    "ribbon:segments=200000,lambda=10",
    "chainmail",
    "square_link",
];

/// Runs the command.
pub fn run(args: &Args, json: bool) -> Result<Outcome> {
    if args.calibrate {
        calibrate(&args.device, json)?;
    }
    let mut outcome = Outcome::Fine;
    for input in args.measure.iter().flatten() {
        outcome = outcome.max(measure(args, input, json)?);
    }
    if args.calibrate || args.measure.is_some() {
        return Ok(outcome);
    }
    let all = devices();
    if json {
        for device in &all {
            output::json(&serde_json::json!(device))?;
        }
        return Ok(Outcome::Fine);
    }
    if all.is_empty() {
        output::line("no adapters: everything runs on the processor")?;
    }
    for device in &all {
        output::line(&device.name)?;
        for line in lines(device) {
            output::line(format_args!("  {line}"))?;
        }
    }
    Ok(Outcome::Fine)
}

fn lines(d: &DeviceInfo) -> Vec<String> {
    let mib = |bytes: u64| bytes >> 20;
    let kind = match d.software {
        true => "software: right, and not fast",
        false => &d.kind,
    };
    vec![
        format!("{}, {kind}; driver {}", d.backend, d.driver.trim()),
        format!(
            "buffers up to {} MiB, {} MiB of them at once; double precision: {}",
            mib(d.max_buffer_bytes),
            mib(d.max_binding_bytes),
            if d.double_precision { "yes" } else { "no" },
        ),
        match &d.trouble {
            None => "can be used: its arithmetic passed the test".into(),
            Some(trouble) => format!("cannot be used: {trouble}"),
        },
    ]
}

#[cfg(feature = "gpu")]
fn calibrate(device: &Device, json: bool) -> Result<()> {
    let c = linkwatch::kernels::calibrate(device)?;
    let file = c.keep()?;
    if json {
        return output::json(&serde_json::json!({
            "adapter": c.adapter,
            "driver": c.driver,
            "threads": c.threads,
            "round_trip_ms": c.round_trip_ms,
            "pair_ns": c.pair_ns,
            "processor_pair_ns": c.processor_pair_ns,
            "file": file,
        }));
    }
    output::line(format_args!(
        "{}: {:.3} ms and {:.4} ns a pair of segments; the processor, {}: {:.4} ns; kept in {}",
        c.adapter,
        c.round_trip_ms,
        c.pair_ns,
        output::plural(c.threads as u64, "thread"),
        c.processor_pair_ns,
        file.display(),
    ))
}

#[cfg(feature = "gpu")]
fn measure(args: &Args, input: &std::path::Path, json: bool) -> Result<Outcome> {
    let set = super::input::read(input)?;
    let all = linkwatch::kernels::measure_device(&args.device, &set, args.repeat, args.limit)?;
    if json {
        output::json(&serde_json::json!({ "model": input, "kernels": all }))?;
    } else {
        output::line(format_args!(
            "{}: kernel, precision, whole frame, vertices on the device, processor (ms); largest error, undecided",
            input.display()
        ))?;
    }
    let mut outcome = Outcome::Fine;
    for t in &all {
        if !t.equal {
            let precision = t.precision.word();
            tracing::error!("{}, {precision}: not the exact numbers", t.kernel);
            outcome = Outcome::Changed;
        }
        if !json {
            let processor = t.processor_ms.map_or("-".into(), |ms| format!("{ms:.2}"));
            output::line(format_args!(
                "  {:12} {:6} {:>10.2} {:>10.2} {processor:>10} {:>9.1e} {:>9}  {}",
                t.kernel,
                t.precision.word(),
                t.whole_ms,
                t.resident_ms,
                t.largest_error,
                t.undecided,
                if t.equal { "equal" } else { "DIFFERS" },
            ))?;
        }
    }
    Ok(outcome)
}

#[cfg(not(feature = "gpu"))]
fn calibrate(_: &Device, _: bool) -> Result<()> {
    Err(no_kernels())
}

#[cfg(not(feature = "gpu"))]
fn measure(_: &Args, _: &std::path::Path, _: bool) -> Result<Outcome> {
    Err(no_kernels())
}

#[cfg(not(feature = "gpu"))]
fn no_kernels() -> linkwatch::Error {
    linkwatch::Error::Device("this build has no kernels for graphics processors".into())
}
