//! `linkwatch certify --explain`: the decisions of every stage, and the predicted cost.

use super::Outcome;
use super::frames::Picked;
use super::output::{self, count, plural};
use crate::engine::{DevicePlan, ImagePlan, Prediction};
use linkwatch::kernels::Method;
use linkwatch::{Plan, Result, SessionOptions};
use serde_json::json;

/// Prints the plan of a frame.
pub fn print(frame: &Picked, options: &SessionOptions, json: bool) -> Result<Outcome> {
    let plan = Plan::with(&frame.curves, options)?;
    if json {
        let model = frame.model.to_string_lossy();
        output::json(&json!({ "model": model, "frame": frame.number, "plan": plan }));
        return Ok(Outcome::Fine);
    }
    output::line(&frame.name);
    for line in lines(&plan) {
        out!("  {line}");
    }
    Ok(Outcome::Fine)
}

/// Returns the decisions of the stages as text.
fn lines(plan: &Plan) -> Vec<String> {
    let mut lines = vec![
        potential_links(plan),
        match plan.splines {
            true => format!(
                "discretization: pair by pair, if hulls overlap (splines), {} expected",
                plural(plan.overlaps, "hull test")
            ),
            false => "discretization: none (polylines)".into(),
        },
        direction(plan),
        kernel(plan),
    ];
    lines.extend(plan.device.as_ref().map(device));
    let mut stages: Vec<(&str, Prediction)> = vec![
        ("boxes", plan.boxes),
        ("search", plan.search),
        ("linking numbers", plan.links),
    ];
    if let Some(found) = &plan.images {
        lines.push(images(found));
        stages.push(("images", found.predicted));
    }
    let words = |(stage, cost): &(&str, Prediction)| format!("{stage} {}", millis(cost.ms));
    let stages = stages.iter().map(words).collect::<Vec<String>>().join(", ");
    let (all, alone) = (millis(plan.total.ms), millis(plan.total.one_thread_ms));
    let predicted = format!("predicted: {all} ({alone} on one thread): {stages}");
    lines.push(predicted);
    lines
}

/// Returns the parts whose count is not 0.
fn some<const N: usize>(parts: [(usize, &str); N]) -> impl Iterator<Item = (usize, &str)> {
    parts.into_iter().filter(|(n, _)| *n > 0)
}

fn potential_links(plan: &Plan) -> String {
    let mut words = format!(
        "potential links: {} of {} of {} with {}",
        count(plan.potential_links),
        plural(plan.pairs, "pair"),
        plural(plan.curves, "curve"),
        plural(plan.segments, "segment"),
    );
    for (n, noun) in some([
        (plan.open_curves, "open curve"),
        (plan.degenerate_curves, "degenerate curve"),
    ]) {
        words += &format!(", {} skipped", plural(n, noun));
    }
    if plan.discarded > 0 {
        let discarded = count(plan.discarded);
        words += &format!(", {discarded} discarded by extents along diagonals");
    }
    words
}

fn direction(plan: &Plan) -> String {
    let best = plan.potential_links - plan.discarded - plan.by_formula;
    let choices = some([
        (best, "the best of six directions"),
        (plan.by_formula, "a formula on boxes (small loops)"),
    ]);
    let choices = choices.map(|(n, words)| format!("{words} for {}", plural(n, "link")));
    match choices.collect::<Vec<_>>().join(", ").as_str() {
        "" => "direction: none (no potential link)".into(),
        choices => format!("direction: {choices}"),
    }
}

fn kernel(plan: &Plan) -> String {
    let first = match plan.kernel {
        Method::Fmm => {
            let links = plural(plan.summed, "link");
            format!("fmm first on {links} (unless strands are too close), then ")
        }
        _ => String::new(),
    };
    let place = match plan.device.as_ref().filter(|d| d.chosen) {
        Some(device) => device.adapter.clone(),
        None => {
            let threads = plural(plan.threads, "thread");
            format!("the CPU, {} of {threads} busy", plan.busy_threads)
        }
    };
    let tests = plural(plan.tests, "test");
    let sampled = plural(plan.sampled, "sampled link");
    format!("kernel: {first}crossings (exact) on {place}; {tests} expected, from {sampled}")
}

fn device(device: &DevicePlan) -> String {
    let times = match device.adapter_ms.zip(device.cpu_ms) {
        Some((there, here)) => {
            let (there, here) = (millis(there), millis(here));
            let factor = device.adapter_error_factor.unwrap_or(1.0);
            format!("{there} there within a factor of {factor:.1}, {here} on the CPU")
        }
        None if device.chosen => "not calibrated".into(),
        None => "splines are counted on the CPU".into(),
    };
    let from = |from: Option<u64>, noun: &str| match from {
        Some(0) => "all".to_owned(),
        Some(n) => format!("from {} on", plural(n, noun)),
        None => "never".to_owned(),
    };
    let not = if device.chosen { "" } else { "not " };
    let direct = from(device.direct_from, "segment pair");
    let barnes_hut = from(device.barnes_hut_from, "segment");
    let name = &device.adapter;
    format!("GPU: {name}, {not}chosen, {times}; direct sums: {direct}, Barnes-Hut: {barnes_hut}")
}

fn images(images: &ImagePlan) -> String {
    let links = plural(images.potential_links, "potential link");
    let curves = plural(images.curves, "curve");
    let mut words = format!("periodic images: {links} of {curves} and their images");
    if images.yarns > 0 {
        let pairs = plural(images.yarns, "pair");
        words += &format!(", and {pairs} with yarns (not predicted)");
    }
    words
}

/// Formats a predicted time.
fn millis(ms: f64) -> String {
    output::millis(std::time::Duration::from_secs_f64(ms * 1e-3))
}
