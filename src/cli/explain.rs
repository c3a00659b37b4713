//! `linkwatch certify --explain`: the decisions of every stage, and the predicted cost.

use super::Outcome;
use super::frames::Picked;
use super::output::{self, count, plural};
use crate::engine::{DevicePlan, ImagePlan, Prediction};
use linkwatch::kernels::Method;
use linkwatch::{Plan, Result, SessionOptions};
use serde_json::json;
use std::path::Path;

/// Prints the plan of a frame.
pub fn print(path: &Path, frame: &Picked, options: &SessionOptions, json: bool) -> Result<Outcome> {
    let plan = Plan::with(&frame.curves, options)?;
    if json {
        output::json(&json!({ "model": path, "frame": frame.number, "plan": plan }));
        return Ok(Outcome::Fine);
    }
    output::line(&frame.name);
    for line in lines(&plan) {
        output::line(format_args!("  {line}"));
    }
    Ok(Outcome::Fine)
}

fn lines(plan: &Plan) -> Vec<String> {
    let mut lines = vec![
        potential_links(plan),
        match plan.splines {
            true => format!(
                "discretization: pair by pair, where hulls overlap (splines), {} expected",
                plural(plan.overlaps, "hull test")
            ),
            false => "discretization: none (polylines)".into(),
        },
        direction(plan),
        kernel(plan),
    ];
    lines.extend(plan.device.as_ref().map(device));
    lines.extend(plan.images.as_ref().map(images));
    let Prediction { one_thread_ms, ms } = plan.total;
    let mut stages = format!(
        "boxes {}, search {}, linking numbers {}",
        millis(plan.boxes.ms),
        millis(plan.search.ms),
        millis(plan.links.ms)
    );
    if let Some(images) = &plan.images {
        stages += &format!(", images {}", millis(images.predicted.ms));
    }
    let alone = match ms == one_thread_ms {
        true => String::new(),
        false => format!(" ({} on one thread)", millis(one_thread_ms)),
    };
    lines.push(format!("predicted: {}{alone}: {stages}", millis(ms)));
    lines
}

fn potential_links(plan: &Plan) -> String {
    let skipped = [
        (plan.open_curves, "open curve"),
        (plan.degenerate_curves, "degenerate curve"),
    ];
    let skipped = skipped.into_iter().filter(|&(n, _)| n > 0);
    let skipped: String = skipped
        .map(|(n, noun)| format!(", {} skipped", number(n, noun)))
        .collect();
    let discarded = match plan.discarded {
        0 => String::new(),
        n => format!(", {} discarded by extents along diagonals", count(n as u64)),
    };
    format!(
        "potential links: {} of {} of {} with {}{skipped}{discarded}",
        count(plan.potential_links as u64),
        plural(plan.pairs, "pair"),
        number(plan.curves, "curve"),
        number(plan.segments, "segment"),
    )
}

fn direction(plan: &Plan) -> String {
    let best = plan.potential_links - plan.discarded - plan.by_formula;
    let choices = [
        (best, "the best of six"),
        (plan.by_formula, "a formula on boxes (small loops)"),
    ];
    let choices = choices.into_iter().filter(|&(n, _)| n > 0);
    let choices: Vec<String> = choices
        .map(|(n, words)| format!("{words} for {}", number(n, "link")))
        .collect();
    match choices.is_empty() {
        true => "direction: none (no potential link)".into(),
        false => format!("direction: {}", choices.join(", ")),
    }
}

fn kernel(plan: &Plan) -> String {
    let first = match plan.kernel {
        Method::Fmm => format!(
            "fmm first on {} (unless strands are too close), then ",
            number(plan.summed, "link")
        ),
        _ => String::new(),
    };
    let place = match plan.device.as_ref().filter(|d| d.chosen) {
        Some(device) => format!(" on {}", device.adapter),
        None => format!(
            " on the CPU, {} of {} busy",
            plan.busy_threads,
            number(plan.threads, "thread")
        ),
    };
    format!(
        "kernel: {first}crossings (exact){place}; {} expected, from {}",
        plural(plan.tests, "test"),
        number(plan.sampled, "sampled link"),
    )
}

fn device(device: &DevicePlan) -> String {
    let adapter = &device.adapter;
    let times = match device.adapter_ms.zip(device.cpu_ms) {
        Some((there, here)) => format!(
            "{} there within a factor of {:.1}, {} on the CPU",
            millis(there),
            device.adapter_error_factor.unwrap_or(1.0),
            millis(here),
        ),
        None if device.chosen => "not calibrated".into(),
        None => "splines are counted on the CPU".into(),
    };
    let from = |from: Option<u64>, noun: &str| match from {
        Some(0) => "all".to_owned(),
        Some(n) => format!("from {} on", plural(n, noun)),
        None => "never".to_owned(),
    };
    format!(
        "GPU: {adapter}, {}, {times}; direct sums: {}, Barnes-Hut: {}",
        if device.chosen {
            "chosen"
        } else {
            "not chosen"
        },
        from(device.direct_from, "segment pair"),
        from(device.barnes_hut_from, "segment"),
    )
}

fn images(images: &ImagePlan) -> String {
    let yarns = match images.yarns {
        0 => String::new(),
        n => format!(
            ", and {} of rings and yarns that run through the cell (not predicted)",
            number(n, "pair")
        ),
    };
    format!(
        "periodic images: {} of {} and their images{yarns}",
        number(images.potential_links, "potential link"),
        number(images.curves, "curve"),
    )
}

/// Formats a number of things, as [`plural`] does.
fn number(n: usize, noun: &str) -> String {
    plural(n as u64, noun)
}

/// Formats milliseconds with two significant digits at most.
fn millis(ms: f64) -> String {
    match ms {
        ms if ms < 0.1 => format!("{ms:.3} ms"),
        ms if ms < 10.0 => format!("{ms:.2} ms"),
        ms => format!("{ms:.0} ms"),
    }
}
