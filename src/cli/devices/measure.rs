//! `linkwatch devices --measure` and `--calibrate`: time of the kernels on an adapter and on the
//! CPU.

use super::MeasureArgs;
use crate::cli::{Outcome, input, output};
use linkwatch::kernels::{Device, Method, SumCost};
use linkwatch::lab::{self, AdapterTimes, Effort, GrowingScenes, Table, faster_from};
use linkwatch::{Certifier, Error, Result, SessionOptions};
use serde_json::json;
use std::path::{Path, PathBuf};

/// Measures an adapter and stores the costs that the automatic choice uses.
pub fn calibrate(device: &Device, json: bool) -> Result<()> {
    let c = lab::calibrate(device)?;
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
pub fn measure(args: &MeasureArgs, inputs: &[PathBuf], json: bool) -> Result<Outcome> {
    // Opened once for all measurements.
    let keeper = Certifier::new(&SessionOptions {
        device: args.device.clone(),
        ..SessionOptions::default()
    })?;
    let Some(device) = keeper.device() else {
        return Err(Error::Device("--device must name an adapter".into()));
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
        output::line(format_args!("  {}", table().header()));
    }
    let mut outcome = Outcome::Fine;
    let mut measure = |input: &Path, kernels: &[Method]| {
        let (segments, times) = measure_one(args, input, kernels, json)?;
        if times.iter().any(|t| !t.equal) {
            outcome = Outcome::Changed;
        }
        Ok::<_, Error>((segments, times))
    };
    if !inputs.is_empty() {
        for input in inputs {
            measure(
                input,
                &[Method::Crossings, Method::Direct, Method::BarnesHut],
            )?;
        }
        return Ok(outcome);
    }
    let mut found = Vec::new();
    for scenes in &GrowingScenes::ALL {
        let mut measured = Vec::new();
        for scene in scenes.inputs(device.software) {
            let (segments, times) = measure(Path::new(&scene), &[scenes.kernel])?;
            // Double precision only repeats what single precision leaves undecided.
            let mut single = times.iter().filter(|t| t.precision == "single");
            measured.push((segments, single.all(AdapterTimes::is_faster)));
        }
        found.push((scenes.kernel, scenes.scene, faster_from(&measured)));
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

fn table() -> Table {
    Table::new([
        ("kernel", -12),
        ("precision", -9),
        ("whole frame", 12),
        ("resident", 10),
        ("CPU", 10),
        ("largest error", 14),
        ("undecided", 10),
        ("", 8),
    ])
}

/// Measures kernels on a model or a scene, and prints the times. Returns the number of segments.
fn measure_one(
    args: &MeasureArgs,
    input: &Path,
    kernels: &[Method],
    json: bool,
) -> Result<(u64, Vec<AdapterTimes>)> {
    let set = input::read(input)?;
    let effort = Effort::runs(args.repeat);
    let times = lab::measure_adapter(&args.device, &set, kernels, effort, args.limit)?;
    let segments = set.segments() as u64;
    for t in times.iter().filter(|t| !t.equal) {
        tracing::error!(
            "{}, {}: the linking numbers differ from the exact ones",
            t.kernel,
            t.precision
        );
    }
    if json {
        output::json(&json!({ "model": input, "segments": segments, "kernels": times }));
        return Ok((segments, times));
    }
    let links = times.first().map_or(0, |t| t.links as u64);
    output::line(format_args!(
        "{}: {}, {}",
        input.display(),
        output::plural(segments, "segment"),
        output::plural(links, "potential link"),
    ));
    let ms = |ms: f64| format!("{ms:.2}");
    for t in &times {
        let row = table().row([
            t.kernel.to_string(),
            t.precision.into(),
            ms(t.whole_ms),
            ms(t.resident_ms),
            t.cpu_ms.map_or("-".into(), ms),
            format!("{:.1e}", t.largest_error),
            t.undecided.to_string(),
            if t.equal { "equal" } else { "DIFFERS" }.into(),
        ]);
        output::line(format_args!("  {row}"));
    }
    Ok((segments, times))
}
