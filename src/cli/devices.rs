//! `linkwatch devices`: the graphics processors that there are, and what each can do.

use super::{Outcome, output};
use linkwatch::Result;
use linkwatch::kernels::{DeviceInfo, devices};

/// List the graphics processors that kernels can run on
#[derive(Debug, clap::Args)]
pub struct Args {}

/// Runs the command.
pub fn run(_: &Args, json: bool) -> Result<Outcome> {
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
        true => "software: right, and not fast".to_string(),
        false => d.kind.clone(),
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
