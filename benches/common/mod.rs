//! Parts shared by the benches of the stages: scenes with their exact certificates, runs that
//! alternate between one thread and all, medians, and a table.

// Every bench is a separate program and uses a part of this module.
#![allow(dead_code)]

use linkwatch::scenes::Scene;
use linkwatch::{Certificate, CurveSet, Stats, Verifier, model};
use rayon::{ThreadPool, ThreadPoolBuilder};
use rustix::time::{ClockId, clock_gettime};
use serde_json::{Value, json};
use std::path::PathBuf;
use std::time::Instant;

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

/// Curves with known linking numbers.
pub struct Case {
    pub name: String,
    pub curves: CurveSet,
    certificate: Certificate,
    potential_links: Option<u64>,
    /// Numbers of overlaps and segments of Algorithm 3, if they are known.
    pub algorithm_3: Option<(usize, usize)>,
}

impl Case {
    fn scene((text, potential_links): Text) -> Case {
        let scene: Scene = text.parse().expect("a scene of the table");
        let generated = scene.build().expect("a scene that can be built");
        Case {
            name: text.to_owned(),
            curves: generated.curves,
            certificate: generated.certificate,
            potential_links,
            algorithm_3: None,
        }
    }

    /// Reads the model, if it exists.
    fn model(model: &Model, options: &Options) -> Option<Case> {
        let name = model.name;
        let path = options.models.join(format!("{name}.bcc"));
        if !path.exists() {
            eprintln!("skipped: {} does not exist", path.display());
            return None;
        }
        let certificate = path.with_file_name(format!("{name}.certificate.txt"));
        Some(Case {
            name: name.to_owned(),
            curves: model::read(&path).expect("a readable model"),
            certificate: Certificate::read(&certificate).expect("its certificate"),
            potential_links: Some(model.potential_links),
            algorithm_3: model.algorithm_3,
        })
    }

    /// Returns true if its curves need discretization.
    pub fn is_spline(&self) -> bool {
        !self.curves.basis().is_polyline()
    }

    /// Panics unless a certificate of these curves equals the expected one.
    pub fn check(&self, certificate: &Certificate) {
        assert!(
            *certificate == self.certificate,
            "{}: {} links found, {} expected; {} pairs undefined",
            self.name,
            certificate.links.len(),
            self.certificate.links.len(),
            certificate.undefined.len(),
        );
    }

    /// Panics unless the counts follow from the curves and their certificate.
    fn check_stats(&self, stats: &Stats) {
        let links = &self.certificate.links;
        let twists: u64 = links.iter().map(|l| l.lambda.unsigned_abs()).sum();
        let Stats {
            curves,
            segments,
            potential_links,
            ..
        } = *stats;
        let name = &self.name;
        assert_eq!(curves as usize, self.curves.len(), "{name}");
        assert_eq!(segments as usize, self.curves.segments(), "{name}");
        assert_eq!(stats.open_curves, 0, "{name}");
        if let Some(n) = self.potential_links {
            assert_eq!(potential_links, n, "{name}");
        }
        assert!(
            potential_links - stats.separated >= links.len() as u64,
            "{name}"
        );
        assert!(
            twists <= stats.crossings && stats.crossings <= stats.tests,
            "{name}"
        );
        assert!(stats.exact <= stats.tests, "{name}");
        assert!(self.is_spline() || stats.refined == 0, "{name}");
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

/// Milliseconds of one run, or medians of several.
#[derive(Clone, Copy, Debug)]
pub struct Cost {
    pub boxes: f64,
    pub pairs: f64,
    pub links: f64,
    pub total: f64,
    /// CPU time of all threads, of the whole run.
    pub cpu: f64,
}

impl Cost {
    /// Returns the median of each number separately.
    fn median(costs: &[Cost]) -> Cost {
        let of = |f: fn(&Cost) -> f64| median(costs.iter().map(f));
        Cost {
            boxes: of(|c| c.boxes),
            pairs: of(|c| c.pairs),
            links: of(|c| c.links),
            total: of(|c| c.total),
            cpu: of(|c| c.cpu),
        }
    }

    /// Returns the share of the time in which the single thread ran on a CPU.
    pub fn on_cpu(&self) -> f64 {
        self.cpu / self.total
    }
}

/// Cost of certifying a case, with one thread and with all.
pub struct Measured {
    pub stats: Stats,
    /// Cost of a new verifier, which allocates its buffers.
    pub first: [Cost; 2],
    /// Cost of the same verifier again.
    pub later: [Cost; 2],
}

/// Certifies a case. Panics if anything except the cost differs between runs, or from the expected
/// result.
pub fn measure(case: &Case, pools: &Pools, repeat: usize) -> Measured {
    let runs = pools.alternate(repeat, || {
        let mut verifier = Verifier::default();
        let mut certify = || {
            let start = cpu_ms();
            let (certificate, stats) = verifier.certify(&case.curves);
            let cpu = cpu_ms() - start;
            case.check(certificate);
            case.check_stats(&stats);
            let t = verifier.timings();
            let [boxes, pairs, links, total] =
                [t.boxes, t.pairs, t.links, t.total].map(|d| d.as_secs_f64() * 1e3);
            let cost = Cost {
                boxes,
                pairs,
                links,
                total,
                cpu,
            };
            (stats, cost)
        };
        let (first, later) = (certify(), certify());
        assert_eq!(first.0, later.0, "{}", case.name);
        (first.0, first.1, later.1)
    });
    let stats = runs[0][0].0;
    let same = runs.iter().flatten().all(|run| run.0 == stats);
    assert!(same, "{}: counts depend on the run", case.name);
    let medians = |of: fn(&(Stats, Cost, Cost)) -> Cost| {
        runs.each_ref()
            .map(|runs| Cost::median(&runs.iter().map(of).collect::<Vec<_>>()))
    };
    Measured {
        stats,
        first: medians(|r| r.1),
        later: medians(|r| r.2),
    }
}

/// Returns the wall-clock and CPU time of some work, in milliseconds.
pub fn time<T>(work: impl FnOnce() -> T) -> (T, f64, f64) {
    let (start, cpu) = (Instant::now(), cpu_ms());
    let out = work();
    (out, start.elapsed().as_secs_f64() * 1e3, cpu_ms() - cpu)
}

/// Returns the CPU time of this process.
fn cpu_ms() -> f64 {
    let t = clock_gettime(ClockId::ProcessCPUTime);
    t.tv_sec as f64 * 1e3 + t.tv_nsec as f64 * 1e-6
}

pub fn median(values: impl IntoIterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.into_iter().collect();
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
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
    Text(String),
    Count(u64),
    /// A number, and its number of decimals.
    Real(f64, usize),
    Percent(f64),
}

impl Cell {
    fn text(&self) -> String {
        match self {
            Cell::Text(text) => text.clone(),
            Cell::Count(n) => separated(*n),
            Cell::Real(x, _) | Cell::Percent(x) if x.is_nan() => "-".to_owned(),
            Cell::Real(x, digits) => format!("{x:.digits$}"),
            Cell::Percent(share) => format!("{:.2} %", share * 100.0),
        }
    }

    fn json(&self) -> Value {
        match self {
            Cell::Text(text) => json!(text),
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

/// A table with columns as wide as their content, or lines of JSON.
pub struct Table {
    bench: &'static str,
    json: bool,
    repeat: usize,
    threads: usize,
    rows: Vec<Vec<String>>,
}

impl Table {
    pub fn new(bench: &'static str, options: &Options, pools: &Pools) -> Table {
        Table {
            bench,
            json: options.json,
            repeat: options.repeat,
            threads: pools.threads(),
            rows: Vec::new(),
        }
    }

    pub fn row(&mut self, case: &Case, columns: Vec<Column>) {
        if self.json {
            let mut line = json!({
                "bench": self.bench,
                "case": case.name,
                "repeat": self.repeat,
                "threads": self.threads,
            });
            for (_, name, cell) in &columns {
                line[*name] = cell.json();
            }
            return println!("{line}");
        }
        if self.rows.is_empty() {
            for line in 0..2 {
                let titles = columns.iter().map(|(title, ..)| {
                    let part = title.split('\n').nth(line).unwrap_or_default();
                    part.replace('N', &self.threads.to_string())
                });
                let first = ["case", ""][line].to_owned();
                self.rows.push([first].into_iter().chain(titles).collect());
            }
        }
        let cells = columns.iter().map(|(_, _, cell)| cell.text());
        let first = case.name.clone();
        self.rows.push([first].into_iter().chain(cells).collect());
        if self.repeat > 1 {
            // The table is printed last, and this may take minutes.
            eprintln!("{} {}", self.bench, case.name);
        }
    }

    /// Prints the table, unless its lines were printed before.
    pub fn finish(self) {
        if self.json {
            return;
        }
        println!("{}, median of {}", self.bench, self.repeat);
        let Some(first) = self.rows.first() else {
            return println!("no case is selected");
        };
        let width = |k: usize| self.rows.iter().map(|row| row[k].len()).max().unwrap_or(0);
        let widths: Vec<usize> = (0..first.len()).map(width).collect();
        for row in &self.rows {
            let mut line = format!("{:w$}", row[0], w = widths[0]);
            for (cell, w) in row.iter().zip(&widths).skip(1) {
                line += &format!("  {cell:>w$}");
            }
            println!("{}", line.trim_end());
        }
    }
}
