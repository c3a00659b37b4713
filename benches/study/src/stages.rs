//! `study stages`: times of the stages of a certificate, with those that the library predicts.
//!
//! "First" is a new certifier, which allocates its buffers. "Later" is the same certifier again, to
//! which predictions apply.

use crate::input::{self, plural, threads};
use crate::measure::{Run, StageTimes, Subject, Table};
use linkwatch::{Plan, Result};

/// Measure the stages of a certificate, next to their predicted times
///
/// Measures the work from control points in memory to the sorted linking numbers. Times are median
/// milliseconds; `cpu` is the time of all threads.
#[derive(clap::Args)]
pub struct Args {
    /// Models, or scenes as `linkwatch generate` takes them
    #[arg(required = true, value_name = "MODEL|SCENE")]
    inputs: Vec<String>,
    /// Number of runs; medians are printed
    #[arg(
        long, value_name = "N", default_value_t = 11,
        value_parser = clap::value_parser!(u32).range(1..)
    )]
    repeat: u32,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<u8> {
    for input in &args.inputs {
        let subject = Subject::new(input, input::read(input)?)?;
        let runs: Vec<[Run; 2]> = (0..args.repeat)
            .map(|_| Run::first_and_later(&subject))
            .collect();
        let stats = subject.stats;
        println!(
            "{input}: {} of {}, {}, {}, {}; {}, median of {}",
            plural(subject.curves.len(), "curve"),
            plural(subject.curves.segments(), "segment"),
            plural(stats.potential_links as usize, "potential link"),
            plural(stats.tests as usize, "test"),
            plural(stats.crossings as usize, "crossing"),
            plural(threads(), "thread"),
            args.repeat,
        );
        let titles = ["boxes", "pairs", "links", "total", "cpu"].map(|title| (title, 10));
        let table = Table::new([("", -12)].into_iter().chain(titles));
        println!("{}", table.header());
        for (k, name) in ["first", "later"].into_iter().enumerate() {
            let all: Vec<StageTimes> = runs.iter().map(|run| run[k].times).collect();
            let t = StageTimes::median(&all);
            let times = [t.boxes_ms, t.pairs_ms, t.links_ms, t.total_ms, t.cpu_ms];
            println!("{}", row(&table, name, &times));
        }
        let plan = Plan::of(&subject.curves);
        let stages = [plan.boxes, plan.search, plan.links, plan.total];
        let mut times: Vec<f64> = stages.iter().map(|stage| stage.ms).collect();
        times.push(plan.total.one_thread_ms);
        println!("{}", row(&table, "predicted", &times));
    }
    Ok(0)
}

fn row(table: &Table, name: &str, times: &[f64]) -> String {
    let times = times.iter().map(|ms| format!("{ms:.3}"));
    table.row([name.to_owned()].into_iter().chain(times))
}
