//! Parts shared by the benches of the stages: options, scenes with their expected counts, and runs
//! that alternate between one thread and all.

// Every bench is a separate program and uses a part of this module.
#![allow(dead_code)]

#[path = "../study/src/measure.rs"]
pub mod measure;

use linkwatch::{Certificate, Stats, formats};
use measure::{Run, StageTimes, Subject, Table};
use rayon::{ThreadPool, ThreadPoolBuilder};
use serde_json::{Value, json};
use std::path::PathBuf;

/// A generated scene: its description, and its number of potential links if that follows from its
/// construction.
type Text = (&'static str, Option<u64>);

/// Generated scenes of an ordinary run, of a smoke run and of a large one.
struct Entry {
    usual: Text,
    smoke: Text,
    large: Option<Text>,
}

const fn entry(usual: Text, smoke: Text) -> Entry {
    Entry {
        usual,
        smoke,
        large: None,
    }
}

const SCENES: [Entry; 10] = [
    entry(("chainmail", None), ("chainmail:rows=4,columns=5", None)),
    entry(
        ("chainmail:crumple=1", None),
        ("chainmail:rows=4,columns=5,crumple=1", None),
    ),
    entry(
        ("ribbon:lambda=10", Some(1)),
        ("ribbon:segments=2000", Some(1)),
    ),
    entry(
        ("ribbon:lambda=1000", Some(1)),
        ("ribbon:segments=20000,lambda=-100", Some(1)),
    ),
    // All pairs across both bundles, and those that nest in one plane: 25 squares in each of 25
    // planes, twice.
    entry(
        ("square_link", Some(625 * 625 + 50 * 25 * 24 / 2)),
        ("square_link:loops=8,segments=100", Some(4 * 4 + 4)),
    ),
    Entry {
        usual: ("torus_link:segments=2e6", Some(1)),
        smoke: ("torus_link:segments=2000,toroidal=-2,poloidal=3", Some(1)),
        large: Some(("torus_link:segments=2e7", Some(1))),
    },
    entry(
        ("torus_zero", Some(6)),
        ("torus_zero:segments=4000,periods=4", Some(6)),
    ),
    entry(
        ("woundball", Some(1)),
        ("woundball:segments=2000,crossings=11", Some(1)),
    ),
    entry(("rubber_bands", None), ("rubber_bands:bands=40", None)),
    entry(
        ("knit", None),
        ("knit:rows=3,stitches=16,segments=576", None),
    ),
];

/// A real model, which is not part of the project, and its known counts.
struct Model {
    name: &'static str,
    potential_links: u64,
    /// Numbers of overlaps and segments of Algorithm 3, as published.
    algorithm_3: Option<(usize, usize)>,
}

const MODELS: [Model; 3] = [
    Model {
        name: "glove",
        potential_links: 1022,
        algorithm_3: Some((3867, 65_933)),
    },
    Model {
        name: "knittubeinit",
        potential_links: 234,
        algorithm_3: None,
    },
    Model {
        name: "knittubebroken",
        potential_links: 181,
        algorithm_3: None,
    },
];

const USAGE: &str = "\
usage: cargo bench --bench BENCH -- [NAME..] [--repeat N] [--smoke] [--large] [--json]
                                    [--models FOLDER]
  NAME             only scenes whose name contains it
  --repeat N       runs, of which medians are given [default: 21]
  --smoke          once through, small scenes
  --large          the largest scenes, too: some gigabytes
  --json           a line of JSON a scene
  --models FOLDER  where real models are [default: ../shared/models beside the project]";

/// Options of a bench.
pub struct Options {
    pub repeat: usize,
    smoke: bool,
    large: bool,
    json: bool,
    models: PathBuf,
    names: Vec<String>,
}

impl Options {
    /// Parses the command line. Ends the program if it is invalid.
    pub fn parse() -> Options {
        let mut options = Options {
            repeat: 21,
            // `cargo test` does not pass this argument.
            smoke: !std::env::args().any(|a| a == "--bench"),
            large: false,
            json: false,
            models: PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/models"),
            names: Vec::new(),
        };
        let mut args = std::env::args().skip(1);
        let usage = || -> ! {
            eprintln!("{USAGE}");
            std::process::exit(2)
        };
        while let Some(arg) = args.next() {
            match arg.as_str() {
                "--bench" => {}
                "--smoke" => options.smoke = true,
                "--large" => options.large = true,
                "--json" => options.json = true,
                "--repeat" => match args.next().and_then(|n| n.parse().ok()) {
                    Some(n) if n > 0 => options.repeat = n,
                    _ => usage(),
                },
                "--models" => match args.next() {
                    Some(folder) => options.models = folder.into(),
                    None => usage(),
                },
                _ if arg.starts_with('-') => usage(),
                _ => options.names.push(arg),
            }
        }
        if options.smoke {
            options.repeat = 1;
        }
        options
    }

    /// Iterates over all cases; each is built in its turn.
    pub fn cases(&self) -> impl Iterator<Item = Case> + '_ {
        let asked =
            |name: &str| self.names.is_empty() || self.names.iter().any(|n| name.contains(&**n));
        let scenes = SCENES.iter().flat_map(|entry| match self.smoke {
            true => vec![entry.smoke],
            false => {
                let large = entry.large.filter(|_| self.large);
                [Some(entry.usual), large].into_iter().flatten().collect()
            }
        });
        let scenes = scenes
            .filter(move |&(name, _)| asked(name))
            .map(Case::scene);
        let models = MODELS.iter().filter(move |model| asked(model.name));
        scenes.chain(models.filter_map(|model| Case::model(model, self)))
    }
}

/// A subject with the counts that follow from its construction.
pub struct Case {
    pub subject: Subject,
    potential_links: Option<u64>,
    /// Numbers of overlaps and segments of Algorithm 3, if they are known.
    pub algorithm_3: Option<(usize, usize)>,
}

impl Case {
    fn scene((text, potential_links): Text) -> Case {
        Case {
            subject: Subject::scene(text).expect("a scene of the table"),
            potential_links,
            algorithm_3: None,
        }
        .checked()
    }

    /// Reads the model, if it exists.
    fn model(model: &Model, options: &Options) -> Option<Case> {
        let path = options.models.join(format!("{}.bcc", model.name));
        if !path.exists() {
            eprintln!("skipped: {} does not exist", path.display());
            return None;
        }
        let certificate = path.with_file_name(format!("{}.certificate.txt", model.name));
        let certificate = Certificate::read(&certificate).expect("its certificate");
        let curves = formats::read(&path).expect("a readable model");
        let subject = Subject::new(model.name, curves).expect("a model that can be discretized");
        let case = Case {
            subject: subject.expecting(&certificate),
            potential_links: Some(model.potential_links),
            algorithm_3: model.algorithm_3,
        };
        Some(case.checked())
    }

    /// Panics unless the certificate is the known one and the counts follow from it.
    fn checked(self) -> Case {
        let (subject, stats) = (&self.subject, &self.subject.stats);
        let (name, links) = (&subject.name, &subject.exact.links());
        assert!(subject.as_expected, "{name}: {} links found", links.len());
        let twists: u64 = links.iter().map(|l| l.lambda.unsigned_abs()).sum();
        let found = stats.potential_links;
        assert_eq!(stats.curves as usize, subject.curves.len(), "{name}");
        assert_eq!(stats.segments as usize, subject.curves.segments(), "{name}");
        assert_eq!(stats.open_curves, 0, "{name}");
        assert!(
            self.potential_links.is_none_or(|n| n == found),
            "{name}: {found}"
        );
        assert!(found - stats.separated >= links.len() as u64, "{name}");
        assert!(
            twists <= stats.crossings && stats.crossings <= stats.tests,
            "{name}"
        );
        assert!(stats.exact <= stats.tests, "{name}");
        assert!(self.is_spline() || stats.refined == 0, "{name}");
        self
    }

    /// Returns true if its curves need discretization.
    pub fn is_spline(&self) -> bool {
        !self.subject.curves.basis().is_polyline()
    }
}

/// A pool of one thread, and one of all threads.
pub struct Pools([ThreadPool; 2]);

impl Pools {
    pub fn new() -> Pools {
        // By default, one thread per CPU core.
        let pool = |threads| ThreadPoolBuilder::new().num_threads(threads).build();
        Pools([1, 0].map(|threads| pool(threads).expect("threads")))
    }

    /// Number of threads of the larger pool.
    pub fn threads(&self) -> usize {
        self.0[1].current_num_threads()
    }

    /// Runs `work` in one pool and the other, `repeat` times.
    pub fn alternate<T: Send>(
        &self,
        repeat: usize,
        mut work: impl FnMut() -> T + Send,
    ) -> [Vec<T>; 2] {
        let mut out = [Vec::new(), Vec::new()];
        for _ in 0..repeat {
            for (pool, out) in self.0.iter().zip(&mut out) {
                out.push(pool.install(&mut work));
            }
        }
        out
    }
}

/// Cost of certifying a case, with one thread and with all.
pub struct Measured {
    pub stats: Stats,
    /// Cost of a new verifier, which allocates its buffers.
    pub first: [StageTimes; 2],
    /// Cost of the same verifier again.
    pub later: [StageTimes; 2],
}

/// Certifies a case. Panics if anything except the cost differs between runs, or from the expected
/// result.
pub fn measure(case: &Case, pools: &Pools, repeat: usize) -> Measured {
    let Subject { name, stats, .. } = &case.subject;
    let runs = pools.alternate(repeat, || {
        let runs = Run::first_and_later(&case.subject);
        for run in &runs {
            assert!(
                run.equal && run.stats == *stats,
                "{name}: a run differs: {run:?}"
            );
        }
        runs.map(|run| run.times)
    });
    let medians = |k: usize| {
        let each = runs.each_ref();
        each.map(|runs| StageTimes::median(&runs.iter().map(|r| r[k]).collect::<Vec<_>>()))
    };
    Measured {
        stats: *stats,
        first: medians(0),
        later: medians(1),
    }
}

/// Returns the share of the time in which a single thread ran on a CPU.
pub fn on_cpu(times: StageTimes) -> f64 {
    times.cpu_ms / times.total_ms
}

/// Returns nanoseconds per item, of this many milliseconds; NaN if there are no items.
pub fn ns_each(ms: f64, n: u64) -> f64 {
    ratio(ms * 1e6, n)
}

/// Returns the ratio; NaN if the divisor is 0.
pub fn ratio(x: f64, n: u64) -> f64 {
    if n == 0 { f64::NAN } else { x / n as f64 }
}

/// Content of a column.
pub enum Cell {
    Count(u64),
    /// A number, and its number of decimals.
    Real(f64, usize),
    Percent(f64),
}

impl Cell {
    fn text(&self) -> String {
        match self {
            Cell::Count(n) => separated(*n),
            Cell::Real(x, _) | Cell::Percent(x) if x.is_nan() => "-".to_owned(),
            Cell::Real(x, digits) => format!("{x:.digits$}"),
            Cell::Percent(share) => format!("{:.2} %", share * 100.0),
        }
    }

    fn json(&self) -> Value {
        match self {
            Cell::Count(n) => json!(n),
            // JSON has null for NaN.
            Cell::Real(x, _) | Cell::Percent(x) => json!(x),
        }
    }
}

/// Formats a count with separators, `211,680`.
fn separated(n: u64) -> String {
    match n {
        0..1000 => n.to_string(),
        _ => format!("{},{:03}", separated(n / 1000), n % 1000),
    }
}

/// Column of a row: its title (two lines, N for the number of threads), its name in JSON, its
/// content.
pub type Column = (&'static str, &'static str, Cell);

/// Rows of a bench: a table, or lines of JSON.
pub struct Rows {
    bench: &'static str,
    json: bool,
    repeat: usize,
    threads: usize,
    table: Option<Table>,
}

impl Rows {
    pub fn new(bench: &'static str, options: &Options, pools: &Pools) -> Rows {
        Rows {
            bench,
            json: options.json,
            repeat: options.repeat,
            threads: pools.threads(),
            table: None,
        }
    }

    /// Prints a row.
    pub fn row(&mut self, case: &Case, columns: Vec<Column>) {
        let name = &case.subject.name;
        if self.json {
            let mut line = json!({
                "bench": self.bench,
                "case": name,
                "repeat": self.repeat,
                "threads": self.threads,
            });
            for (_, name, cell) in &columns {
                line[*name] = cell.json();
            }
            return println!("{line}");
        }
        let table = self.table.get_or_insert_with(|| {
            let titles = columns.iter().map(|(title, ..)| {
                let title = title.replace('N', &self.threads.to_string());
                let width = title.lines().map(str::len).max().unwrap_or(0);
                (title, width.max(9) as isize)
            });
            let table = Table::new([("case".to_owned(), -24)].into_iter().chain(titles));
            println!(
                "{}, median of {}\n{}",
                self.bench,
                self.repeat,
                table.header()
            );
            table
        });
        let cells = columns.iter().map(|(_, _, cell)| cell.text());
        println!("{}", table.row([name.clone()].into_iter().chain(cells)));
    }
}

impl Drop for Rows {
    fn drop(&mut self) {
        if self.table.is_none() && !self.json {
            println!("{}: no case is selected", self.bench);
        }
    }
}
