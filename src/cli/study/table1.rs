//! `linkwatch study table1`: measures the models of a published table, and prints the published
//! values next to them.

use super::csv::Csv;
use super::kernels::{brief, row_json};
use crate::cli::Outcome;
use crate::cli::files::{Content, Files, Overwrite};
use crate::cli::number::{positive, segments};
use crate::cli::output::{self, count, plural};
use linkwatch::kernels::{Device, Method};
use linkwatch::lab::{
    Input, KernelEffort, KernelRow, MACHINE, Published, Setting, Source, Subject, TABLE_1, Table,
};
use linkwatch::{Error, Result, model};
use serde_json::{Map, Value, json};
use std::path::PathBuf;

/// Measure the models of a published table, next to the published values
///
/// Table 1 of Qu & James 2021. Models that can be generated have the published sizes; the others
/// are read from the folder of --models. If the published model is not there, others of about its
/// size are measured: files of that folder which `examples/table1.sh` makes, and generated scenes;
/// a line says what differs. Each model has two lines: measured here, and published, on another
/// machine. Times are in seconds. The exit code is 1 if a certificate is not the one that follows
/// from the construction.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Only models whose names contain one of these, separated by commas
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    only: Vec<String>,
    /// Kernels beside counting crossings, separated by commas
    #[arg(
        long,
        value_name = "LIST",
        value_delimiter = ',',
        default_value = "angle-sum,barnes-hut,fmm"
    )]
    kernels: Vec<Method>,
    /// Folder with files of the models that cannot be generated, such as glove.bcc, and of those
    /// that examples/table1.sh makes
    #[arg(long, value_name = "DIR")]
    models: Option<PathBuf>,
    /// Skip models of more segments: on some of them Barnes-Hut takes minutes, which --limit does
    /// not prevent, and gigabytes of memory
    #[arg(long, value_name = "N", default_value = "6e5", value_parser = segments)]
    segments: u64,
    /// Number of runs of each kernel; the median is printed
    #[arg(
        long,
        value_name = "N",
        default_value_t = 3,
        value_parser = clap::value_parser!(u32).range(1..)
    )]
    repeat: u32,
    /// Skip sums over all pairs of segments that would take longer than this; run anything longer
    /// only once
    #[arg(long, value_name = "SECONDS", default_value_t = 30.0, value_parser = positive)]
    limit: f64,
    /// Write the table to a file, a line for each model and kernel
    #[arg(long, value_name = "FILE", help_heading = crate::cli::WRITE)]
    csv: Option<PathBuf>,
    #[command(flatten)]
    overwrite: Overwrite,
}

/// A kernel, with its published values.
struct Column {
    setting: Setting,
    title: &'static str,
    time: fn(&Published) -> Option<f64>,
    error: fn(&Published) -> Option<f64>,
}

impl Column {
    /// Returns true if the kernel sums.
    fn sums(&self) -> bool {
        self.setting.method != Method::Crossings
    }
}

/// Returns all selectable kernels. Counting crossings is the first.
fn columns() -> Vec<Column> {
    let column = |method, title, time, error| Column {
        setting: Setting::of(method),
        title,
        time,
        error,
    };
    let none = |_: &Published| None;
    vec![
        column(Method::Crossings, "crossings", |p| p.crossings_s, none),
        column(Method::Direct, "direct", |p| p.direct_s, none),
        column(Method::AngleSum, "angle sum", |p| p.direct_s, none),
        column(Method::Interval, "interval", none, none),
        column(Method::BarnesHut, "BH, bound", none, none),
        column(Method::Fmm, "FMM, bound", |p| p.fmm_s, |p| p.fmm_error),
        Column {
            setting: Setting::PUBLISHED,
            title: "BH, beta 2",
            time: |p| p.barnes_hut_s,
            error: |p| p.barnes_hut_error,
        },
    ]
}

/// Fields of the file: names of [`Measurement::kernels`].
const FIELDS: &[&str] = &[
    "model",
    "input",
    "differs",
    "segments",
    "curves",
    "potential_links",
    "threads",
    "search_s",
    "discretization_s",
    "kernel",
    "beta",
    "target",
    "s",
    "cpu_s",
    "mean_error",
    "largest_error",
    "largest_bound",
    "summed",
    "counted",
    "equal",
    "skipped_s",
    "published_s",
    "published_error",
];

/// Measurement of a model.
struct Measurement<'a> {
    published: &'a Published,
    input: &'a Input,
    subject: Subject,
    /// Rows in the order of the columns.
    rows: Vec<KernelRow>,
}

/// Runs the command.
pub fn run(args: &Args, as_json: bool) -> Result<Outcome> {
    let chosen = chosen(&args.only)?;
    let mut columns = columns();
    columns.retain(|c| {
        let method = c.setting.method;
        method == Method::Crossings || args.kernels.contains(&method)
    });
    let mut files = Files::new(args.overwrite);
    for input in chosen.iter().flat_map(|published| published.inputs) {
        if let (Source::File(name), Some(folder)) = (input.source, &args.models) {
            files.reads(&folder.join(name));
        }
    }
    if let Some(file) = &args.csv {
        files.writes("--csv", file, Content::Text)?;
    }
    let mut csv = Csv::create(args.csv.as_deref(), FIELDS)?;
    let say = |line: &dyn std::fmt::Display| match as_json {
        true => {}
        false => output::line(line),
    };
    let threads = plural(rayon::current_num_threads() as u64, "thread");
    say(&format_args!("here: {threads}, median of {}", args.repeat));
    say(&format_args!(
        "published (Qu & James 2021, table 1): {MACHINE}"
    ));
    say(
        &"other machines, other programs: compare orders of magnitude. Times in seconds; each \
           error is the largest of a linking number",
    );
    let table = table(&columns);
    say(&table.header());
    let effort = KernelEffort {
        device: Device::Cpu,
        fast_device: false,
        repeat: args.repeat,
        limit_s: args.limit,
    };
    let rows: Vec<_> = chosen.iter().map(|p| (*p, inputs(p, args))).collect();
    let measured = rows.iter().flat_map(|(_, inputs)| inputs).flatten().count();
    let bar = output::bar((measured * columns.len()) as u64, "kernels");
    let mut outcome = Outcome::Fine;
    let mut models = Vec::new();
    for (published, inputs) in rows {
        let mut object = |mut object: Map<String, Value>, left_out: Option<String>| {
            object.insert("model".into(), published.model.into());
            object.insert("left_out".into(), json!(left_out));
            object.insert("published".into(), json!(published));
            models.push(Value::Object(object));
        };
        match inputs {
            Ok(inputs) => {
                for input in inputs {
                    let mut m = Measurement {
                        published,
                        input,
                        subject: subject(input, args)?,
                        rows: Vec::new(),
                    };
                    for column in &columns {
                        bar.set_message(format!("{}, {}", published.model, column.title));
                        let row = KernelRow::measure(column.setting, &m.subject, &effort)?;
                        m.rows.push(row);
                        bar.inc(1);
                    }
                    bar.suspend(|| {
                        say(&table.row(m.cells(&columns)));
                        if let Some(differs) = input.differs {
                            say(&format_args!("  {}: {differs}", m.subject.name));
                        }
                    });
                    if !m.subject.as_expected || m.rows.iter().any(KernelRow::differs) {
                        tracing::error!(
                            "{}: a certificate differs from the exact one",
                            published.model
                        );
                        outcome = Outcome::Changed;
                    }
                    let kernels = m.kernels(&columns);
                    for kernel in &kernels {
                        csv.row(kernel)?;
                    }
                    object(m.json(kernels), None);
                }
            }
            Err(why) => {
                let text = format!("{:38} here: {why}", published.model);
                bar.suspend(|| say(&text));
                object(Map::new(), Some(why));
            }
        }
        bar.suspend(|| say(&table.row(published_cells(published, &columns))));
    }
    bar.finish_and_clear();
    if as_json {
        output::json(&json!({
            "threads": rayon::current_num_threads(),
            "repeat": args.repeat,
            "published_machine": MACHINE,
            "models": models,
        }));
    }
    Ok(outcome)
}

/// Returns the models whose names contain one of these words, or all.
fn chosen(only: &[String]) -> Result<Vec<&'static Published>> {
    let says = |p: &Published, word: &String| {
        let name = p.model.to_lowercase();
        !word.is_empty() && name.contains(&word.to_lowercase())
    };
    if let Some(word) = only.iter().find(|w| !TABLE_1.iter().any(|p| says(p, w))) {
        let names: Vec<&str> = TABLE_1.iter().map(|p| p.model).collect();
        return Err(Error::Usage(format!(
            "--only: no model has '{word}' in its name (known: {})",
            names.join("; ")
        )));
    }
    let fits = |p: &&Published| only.is_empty() || only.iter().any(|w| says(p, w));
    Ok(TABLE_1.iter().filter(fits).collect())
}

/// Returns the inputs of a row that are measured: the published model if it is there, and otherwise
/// all others that are. If there are none, returns the reason why the row is skipped.
fn inputs(p: &'static Published, args: &Args) -> Result<Vec<&'static Input>, String> {
    if p.segments > args.segments {
        let segments = count(p.segments);
        return Err(format!("skipped: {segments} segments are above --segments"));
    }
    let is_there = |input: &&Input| match (input.source, &args.models) {
        (Source::Scene(_), _) => true,
        (Source::File(name), Some(folder)) => folder.join(name).exists(),
        (Source::File(_), None) => false,
    };
    let there: Vec<&Input> = p.inputs.iter().filter(is_there).collect();
    if there.is_empty() {
        let files = p
            .inputs
            .iter()
            .map(|input| match (input.source, input.differs) {
                (Source::File(name), None) => format!("DIR/{name}"),
                (Source::File(name) | Source::Scene(name), _) => {
                    format!("DIR/{name} of examples/table1.sh")
                }
            });
        let files = files.collect::<Vec<_>>().join(" or ");
        return Err(match args.models {
            Some(_) => format!("not generated; --models has no {files}"),
            None => format!("not generated; --models DIR reads {files}"),
        });
    }
    Ok(match there.iter().find(|input| input.differs.is_none()) {
        Some(own) => vec![own],
        None => there,
    })
}

/// Reads or builds an input, and certifies it.
fn subject(input: &Input, args: &Args) -> Result<Subject> {
    match (input.source, &args.models) {
        (Source::File(name), Some(folder)) => Subject::new(name, model::read(&folder.join(name))?),
        (Source::File(name) | Source::Scene(name), _) => Subject::scene(name),
    }
}

impl Measurement<'_> {
    /// Returns the time of boxes and of the search for potential links, from the runs that count
    /// crossings.
    fn search_s(&self) -> Option<f64> {
        let times = self.rows.iter().find_map(KernelRow::run)?.times;
        Some((times.boxes_ms + times.pairs_ms) * 1e-3)
    }

    /// Returns the time to convert splines to polylines, if some kernel needs that.
    fn discretization_s(&self) -> Option<f64> {
        let runs = self.rows.iter().filter_map(KernelRow::run);
        let mut s = runs.map(|run| run.times.discretizing_ms * 1e-3);
        s.find(|&s| s > 0.0)
    }

    fn cells(&self, columns: &[Column]) -> Vec<String> {
        let curves = &self.subject.curves;
        let potential_links = self.subject.stats.potential_links;
        let sizes = [
            curves.segments() as u64,
            curves.len() as u64,
            potential_links,
        ];
        let mut cells = start(self.published.model, "here", sizes);
        cells.extend([self.search_s(), self.discretization_s()].map(dash_or_seconds));
        cells.extend(self.rows.iter().map(|row| match &row.measured {
            Ok(_) => dash_or_seconds(linking_s(row)),
            Err(s) => format!("~{}", seconds(*s)),
        }));
        for (row, _) in self.rows.iter().zip(columns).filter(|(_, c)| c.sums()) {
            cells.extend([row.largest_error(), row.largest_bound()].map(brief));
        }
        cells
    }

    /// Returns an object for each kernel.
    fn kernels(&self, columns: &[Column]) -> Vec<Value> {
        let object = |(row, column): (&KernelRow, &Column)| {
            let mut object = row_json(row);
            object["model"] = self.published.model.into();
            object["input"] = self.subject.name.as_str().into();
            object["differs"] = json!(self.input.differs);
            object["curves"] = self.subject.curves.len().into();
            object["potential_links"] = self.subject.stats.potential_links.into();
            object["threads"] = rayon::current_num_threads().into();
            object["search_s"] = json!(self.search_s());
            object["discretization_s"] = json!(self.discretization_s());
            object["s"] = json!(linking_s(row));
            object["cpu_s"] = json!(row.run().map(|run| run.times.cpu_ms * 1e-3));
            object["published_s"] = json!((column.time)(self.published));
            object["published_error"] = json!((column.error)(self.published));
            object
        };
        self.rows.iter().zip(columns).map(object).collect()
    }

    fn json(&self, kernels: Vec<Value>) -> Map<String, Value> {
        let fields = [
            ("input", self.subject.name.as_str().into()),
            ("differs", json!(self.input.differs)),
            ("segments", self.subject.curves.segments().into()),
            ("curves", self.subject.curves.len().into()),
            ("potential_links", self.subject.stats.potential_links.into()),
            ("search_s", json!(self.search_s())),
            ("discretization_s", json!(self.discretization_s())),
            ("as_constructed", self.subject.as_expected.into()),
            ("kernels", kernels.into()),
        ];
        fields
            .map(|(name, value)| (name.to_owned(), value))
            .into_iter()
            .collect()
    }
}

/// Returns the seconds of the linking numbers alone, as published.
fn linking_s(row: &KernelRow) -> Option<f64> {
    row.linking_ms().map(|ms| ms * 1e-3)
}

fn table(columns: &[Column]) -> Table {
    let mut all = vec![
        ("model", -37),
        ("", -9),
        ("segments", 10),
        ("curves", 7),
        ("pairs", 9),
        ("search", 10),
        ("splines", 10),
    ];
    all.extend(columns.iter().map(|column| (column.title, 10)));
    for column in columns.iter().filter(|c| c.sums()) {
        all.extend([(column.title, 10), ("bound", 8)]);
    }
    Table::new(all)
}

fn published_cells(p: &Published, columns: &[Column]) -> Vec<String> {
    let mut cells = start("", "published", [p.segments, p.curves, p.potential_links]);
    cells.extend([p.search_s, p.discretization_s].map(|s| dash_or_seconds(Some(s))));
    cells.extend(
        columns
            .iter()
            .map(|column| dash_or_seconds((column.time)(p))),
    );
    for column in columns.iter().filter(|c| c.sums()) {
        cells.extend([brief((column.error)(p)), String::new()]);
    }
    cells
}

fn start(model: &str, by: &str, sizes: [u64; 3]) -> Vec<String> {
    let mut cells = vec![model.to_owned(), by.to_owned()];
    cells.extend(sizes.map(count));
    cells
}

fn dash_or_seconds(s: Option<f64>) -> String {
    s.map_or("-".into(), seconds)
}

/// Formats seconds with three digits.
fn seconds(s: f64) -> String {
    match s {
        s if s < 0.1 => format!("{s:.4}"),
        s if s < 10.0 => format!("{s:.3}"),
        s if s < 1000.0 => format!("{s:.1}"),
        s => format!("{s:.0}"),
    }
}
