//! Words of a plan: one line per stage.

use crate::cli::output::{count, plural};
use linkwatch::Plan;
use linkwatch::plan::{
    Boxes, DevicePlan, Directions, DiscretizationChoice, Images, Parallelism, PotentialLinks,
    Prediction, Search,
};

/// Returns the lines of a plan.
pub fn lines(plan: &Plan) -> Vec<String> {
    let mut lines = vec![
        boxes(plan),
        potential_links(&plan.potential_links),
        direction(plan),
        discretization(plan),
        kernel(plan),
    ];
    let device = plan.kernel.device.as_ref();
    lines.extend(device.map(|plan| format!("device: {}", device_words(plan))));
    lines.extend(plan.images.as_ref().map(images));
    lines.push(format!(
        "total: {} in addition to the curves: {}",
        megabytes(plan.bytes),
        time(plan.predicted)
    ));
    lines
}

fn boxes(plan: &Plan) -> String {
    let Boxes {
        segments,
        levels,
        stored_leaves,
        computed_leaves,
        shared_curves,
        bytes,
        predicted,
    } = plan.boxes;
    let shared = match shared_curves {
        0 => String::new(),
        n => format!(", {} split among threads", number(n, "curve")),
    };
    let leaves = match (plan.discretization.choice, stored_leaves, computed_leaves) {
        (DiscretizationChoice::None, _, 0) => "stored (small curves)".to_owned(),
        (DiscretizationChoice::None, 0, _) => "computed (polylines)".to_owned(),
        (DiscretizationChoice::None, stored, computed) => format!(
            "computed for {}, stored for {}",
            number(computed, "curve"),
            number(stored, "small one"),
        ),
        _ => "stored (splines)".to_owned(),
    };
    format!(
        "boxes: trees of up to {} over {}, leaves {leaves}{shared}, {}: {}",
        plural(levels.into(), "level"),
        number(segments, "segment"),
        megabytes(bytes),
        time(predicted),
    )
}

fn potential_links(links: &PotentialLinks) -> String {
    let search = match links.search {
        Search::Trivial => "no search (one pair at most)",
        _ => "a sweep",
    };
    let skipped = [
        (links.open_curves, "open curve"),
        (links.degenerate_curves, "degenerate curve"),
    ];
    let skipped = skipped.into_iter().filter(|&(n, _)| n > 0);
    let skipped: String = skipped
        .map(|(n, noun)| format!(", {} skipped", number(n, noun)))
        .collect();
    let discarded = match links.discarded {
        0 => String::new(),
        n => format!(", discards {} by extents along diagonals", count(n as u64)),
    };
    format!(
        "potential links: {search}, finds {} of {} of {}{skipped}{discarded}, {}: {}",
        count(links.links as u64),
        plural(links.pairs, "pair"),
        number(links.curves, "curve"),
        megabytes(links.bytes),
        time(links.predicted),
    )
}

fn images(images: &Images) -> String {
    let yarns = match images.yarns {
        0 => String::new(),
        n => format!(
            ", and {} of rings and yarns that run through the cell (not predicted)",
            number(n, "pair")
        ),
    };
    format!(
        "periodic images: {} translated, finds {} with them{yarns}, {}: {}",
        number(images.curves, "curve"),
        number(images.links, "potential link"),
        megabytes(images.bytes),
        time(images.predicted),
    )
}

fn direction(plan: &Plan) -> String {
    let Directions {
        by_formula,
        formula_segments,
        best_of_six,
        predicted,
    } = plan.direction;
    let formula = format!("a formula (loops of at most {formula_segments} segments) for");
    let choice = match (by_formula, best_of_six) {
        (0, 0) => "none (no potential link)".to_owned(),
        (0, n) => format!("the best of six for {}", number(n, "link")),
        (n, 0) => format!("{formula} {}", number(n, "link")),
        (few, many) => format!(
            "the best of six for {}, {formula} {}",
            number(many, "link"),
            count(few as u64),
        ),
    };
    match on_adapter(plan).and_then(|d| d.adapter_ms) {
        Some(_) => format!("direction: {choice}: included in the kernel"),
        None => format!("direction: {choice}: {}", time(predicted)),
    }
}

fn discretization(plan: &Plan) -> String {
    match plan.discretization.choice {
        DiscretizationChoice::None => "discretization: none (polylines)".to_owned(),
        _ => format!(
            "discretization: pair by pair, where hulls overlap (splines), {} and {} expected: {}",
            plural(plan.kernel.work.overlaps, "hull test"),
            plural(plan.kernel.work.refined, "new point"),
            time(plan.discretization.predicted),
        ),
    }
}

fn kernel(plan: &Plan) -> String {
    let kernel = &plan.kernel;
    let parallelism = match kernel.parallelism {
        Parallelism::None => "one thread",
        Parallelism::OverLinks => "links split among threads",
        Parallelism::InsideLinks => "each link split among threads",
    };
    let first = match kernel.summed {
        0 => String::new(),
        n => format!(
            "fmm first on {} (unless strands are too close), then ",
            number(n, "link")
        ),
    };
    let place = match on_adapter(plan) {
        Some(device) => format!(" on {}", device.adapter),
        None => format!(
            ", {parallelism}, {} of {} busy",
            kernel.busy_threads,
            number(plan.threads, "thread")
        ),
    };
    let predicted = match on_adapter(plan) {
        None => time(kernel.predicted),
        Some(DevicePlan {
            adapter_ms: Some(adapter),
            cpu_ms: Some(cpu),
            ..
        }) => format!("{} (CPU: {})", millis(*adapter), millis(*cpu)),
        Some(_) => format!("not calibrated (CPU: {})", time(kernel.predicted)),
    };
    format!(
        "kernel: {first}crossings (exact){place}; \
         {} of {} sampled, {} and {} expected: {predicted}",
        count(kernel.sampled as u64),
        number(plan.potential_links.links, "link"),
        plural(kernel.work.nodes + kernel.work.computed, "node pair"),
        plural(kernel.work.tests, "test"),
    )
}

/// Returns the adapter if it counts the crossings.
fn on_adapter(plan: &Plan) -> Option<&DevicePlan> {
    plan.kernel.device.as_ref().filter(|d| d.chosen)
}

fn device_words(plan: &DevicePlan) -> String {
    let adapter = &plan.adapter;
    let crossings = match (plan.chosen, plan.adapter_ms.zip(plan.cpu_ms)) {
        (true, _) => format!("crossings on {adapter}"),
        (false, Some((there, here))) => format!(
            "crossings on the CPU, in {} ({adapter}: {}, within a factor of {:.1})",
            millis(here),
            millis(there),
            plan.adapter_error_factor.unwrap_or(1.0),
        ),
        (false, None) => "crossings on the CPU".to_owned(),
    };
    let from = |from: Option<u64>, noun: &str| match from {
        Some(0) => "all".to_owned(),
        Some(n) => format!("from {} on", plural(n, noun)),
        None => "never".to_owned(),
    };
    format!(
        "{crossings}; direct sums on the GPU: {}, Barnes-Hut: {}",
        from(plan.direct_from, "segment pair"),
        from(plan.barnes_hut_from, "segment"),
    )
}

/// Formats a number of things, as [`plural`] does.
fn number(n: usize, noun: &str) -> String {
    plural(n as u64, noun)
}

/// Formats a predicted time.
fn time(Prediction { one_thread_ms, ms }: Prediction) -> String {
    match ms == one_thread_ms {
        true => millis(ms),
        false => format!("{} ({} on one thread)", millis(ms), millis(one_thread_ms)),
    }
}

/// Formats milliseconds with two significant digits at most.
fn millis(ms: f64) -> String {
    let digits = if ms < 0.1 {
        3
    } else if ms < 10.0 {
        2
    } else {
        0
    };
    format!("{ms:.digits$} ms")
}

fn megabytes(bytes: usize) -> String {
    format!("{:.1} MB", bytes as f64 * 1e-6)
}

#[cfg(test)]
mod tests {
    use super::*;
    use linkwatch::{Basis, CurveSet, Positions};

    fn planned(scene: &str) -> Plan {
        let scene: linkwatch::scenes::Scene = scene.parse().unwrap();
        Plan::of(&scene.build().unwrap().curves)
    }

    fn words(plan: &Plan) -> String {
        lines(plan).join("\n")
    }

    #[test]
    fn names_missing_links_and_degenerate_curves() {
        let xyz: Vec<f64> = (0..36).map(f64::from).collect();
        let nothing = CurveSet::from_counts(Basis::Polyline, &[], Positions::F64(&[])).unwrap();
        let open = CurveSet::from_counts(Basis::CatmullRom, &[6, 6], Positions::F64(&xyz)).unwrap();
        for set in [nothing, open] {
            let words = words(&Plan::of(&set));
            assert!(words.contains("direction: none"), "{words}");
        }
        let xyz: Vec<f64> = [[0., 0., 0.], [4., 0., 0.], [4., 4., 4.], [0., 4., 0.]]
            .repeat(2)
            .into_iter()
            .chain([[1.0; 3]; 4])
            .flatten()
            .collect();
        let counts = [-4, -4, -4];
        let set = CurveSet::from_counts(Basis::Polyline, &counts, Positions::F64(&xyz)).unwrap();
        let words = words(&Plan::of(&set));
        assert!(words.contains("1 degenerate curve skipped"), "{words}");
    }

    #[test]
    fn names_the_adapter_that_counts_and_the_one_that_does_not() {
        let mut plan = planned("chainmail:rows=2,columns=2");
        for chosen in [true, false] {
            plan.kernel.device = Some(DevicePlan {
                adapter: "made up".into(),
                chosen,
                adapter_ms: Some(0.5),
                adapter_error_factor: Some(1.0),
                cpu_ms: Some(1.0),
                direct_from: Some(0),
                barnes_hut_from: None,
            });
            let words = words(&plan);
            assert_eq!(words.contains("(exact) on made up"), chosen, "{words}");
            assert_eq!(
                words.contains("crossings on the CPU, in"),
                !chosen,
                "{words}"
            );
        }
    }

    #[test]
    fn names_a_missing_calibration() {
        let mut plan = planned("chainmail:rows=3,columns=3");
        for adapter_ms in [Some(0.5), None] {
            plan.kernel.device = Some(DevicePlan {
                adapter: "made up".into(),
                chosen: true,
                adapter_ms,
                adapter_error_factor: adapter_ms,
                cpu_ms: adapter_ms,
                direct_from: Some(0),
                barnes_hut_from: Some(0),
            });
            let words = words(&plan);
            assert_eq!(words.contains("not calibrated"), adapter_ms.is_none());
        }
    }
}
