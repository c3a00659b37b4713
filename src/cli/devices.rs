//! `linkwatch devices`: lists the GPU adapters and their capabilities.

use super::{Outcome, output};
use linkwatch::Result;
use linkwatch::kernels::{Calibration, DeviceInfo, devices};

/// Runs the command.
pub fn run(json: bool) -> Result<Outcome> {
    let all = devices();
    if all.is_empty() && !json {
        output::line("no GPU adapter found: all work runs on the CPU");
    }
    for device in &all {
        let calibration = Calibration::of(device);
        if json {
            let calibration = serde_json::json!({ "calibration": calibration });
            output::json(&output::joined(&serde_json::json!(device), calibration));
            continue;
        }
        out!("{}: {}", device.index, device.name);
        for line in lines(device, calibration.as_ref()) {
            out!("  {line}");
        }
    }
    Ok(Outcome::Fine)
}

fn lines(d: &DeviceInfo, calibration: Option<&Calibration>) -> Vec<String> {
    let mib = |bytes: u64| bytes >> 20;
    let kind = match d.software {
        true => "software renderer: correct, but slow",
        false => &d.kind,
    };
    let mut lines = vec![
        format!("{}, {kind}; driver {}", d.backend, d.driver.trim()),
        format!(
            "buffers up to {} MiB, bindings up to {} MiB; double precision: {}",
            mib(d.max_buffer_bytes),
            mib(d.max_binding_bytes),
            if d.double_precision { "yes" } else { "no" },
        ),
    ];
    if let Some(why) = &d.unusable {
        lines.push(format!("not usable: {why}"));
        return lines;
    }
    lines.push("usable: its arithmetic passed the test".into());
    lines.push(match calibration {
        Some(c) => format!(
            "calibrated for {}: --device auto uses it if it is faster",
            output::plural(c.threads, "thread")
        ),
        None => "not calibrated: --device auto does not use it (in a clone of linkwatch: cargo \
                 run --release -p study -- devices)"
            .into(),
    });
    lines
}
