//! `linkwatch devices`: lists the GPU adapters, their capabilities, and the time of kernels on
//! them.

#[cfg(all(feature = "lab", feature = "gpu"))]
mod measure;

#[cfg(feature = "lab")]
use super::number::positive;
use super::{Outcome, output};
use linkwatch::Result;
#[cfg(feature = "lab")]
use linkwatch::kernels::Device;
use linkwatch::kernels::{DeviceInfo, devices};
#[cfg(feature = "lab")]
use std::path::PathBuf;

/// List the GPU adapters that kernels can run on; measure them
///
/// Without options, the adapters are listed. `linkwatch devices --calibrate` measures one of them
/// and stores the costs, which `--device auto` needs to choose it. `--measure` reports from which
/// size of a scene on each kernel is faster on the adapter than on the CPU.
#[derive(Debug, clap::Args)]
#[cfg_attr(
    not(feature = "lab"),
    command(
        after_help = "This build only lists adapters; build with the feature `lab` to measure them."
    )
)]
pub struct Args {
    #[cfg(feature = "lab")]
    #[command(flatten)]
    measure: MeasureArgs,
}

#[cfg(feature = "lab")]
/// Options that measure an adapter.
#[derive(Debug, clap::Args)]
#[command(group(clap::ArgGroup::new("measured").multiple(true)))]
struct MeasureArgs {
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
    #[arg(
        long,
        value_name = "N",
        default_value_t = 5,
        value_parser = clap::value_parser!(u32).range(1..),
        requires = "measure"
    )]
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
#[cfg_attr(
    not(feature = "lab"),
    expect(unused_variables, reason = "the options measure")
)]
pub fn run(args: &Args, json: bool) -> Result<Outcome> {
    #[cfg(feature = "lab")]
    if let Some(outcome) = measure(&args.measure, json)? {
        return Ok(outcome);
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

/// Runs the requested measurements. Returns `None` if there are none.
#[cfg(all(feature = "lab", feature = "gpu"))]
fn measure(args: &MeasureArgs, json: bool) -> Result<Option<Outcome>> {
    if args.calibrate {
        measure::calibrate(&args.device, json)?;
    }
    match &args.measure {
        Some(inputs) => measure::measure(args, inputs, json).map(Some),
        None => Ok(args.calibrate.then_some(Outcome::Fine)),
    }
}

/// Refuses to measure, with the error of a build that cannot open the adapter.
#[cfg(all(feature = "lab", not(feature = "gpu")))]
fn measure(args: &MeasureArgs, _: bool) -> Result<Option<Outcome>> {
    if args.calibrate || args.measure.is_some() {
        linkwatch::Certifier::new(&linkwatch::SessionOptions {
            device: args.device.clone(),
            ..Default::default()
        })?;
        let what = "--device must name an adapter";
        return Err(linkwatch::Error::Device(what.into()));
    }
    Ok(None)
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
