//! `study table1`: measures the models of a published table, and prints the published values next
//! to them.

use crate::input::{count, plural, segments, threads, usage};
use crate::kernels::{Effort, Row, Setting, brief};
use crate::measure::{Subject, Table};
use crate::published::{Input, MACHINE, Published, Source, TABLE_1};
use linkwatch::kernels::{Device, Method};
use linkwatch::{Result, formats};
use std::path::PathBuf;

/// Measure the models of a published table, next to the published values
///
/// Table 1 of Qu & James 2021. Models that can be generated have the published sizes; the others
/// are read from the folder of --models. If the published model is not there, others of about its
/// size are measured: files of that folder which `examples/table1.sh` makes, and generated scenes;
/// a line says what differs. Each model has three lines: the elapsed time of the linking numbers
/// here, the CPU time of all stages and threads, and the published time of the linking numbers, on
/// another machine. Times are in seconds. The exit code is 1 if a certificate is not the one that
/// follows from the construction.
#[derive(clap::Args)]
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
    #[command(flatten)]
    effort: Effort,
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
fn columns() -> [Column; 7] {
    let column = |method, title, time, error| Column {
        setting: Setting::of(method),
        title,
        time,
        error,
    };
    let none = |_: &Published| None;
    [
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

/// Runs the command.
pub fn run(args: &Args) -> Result<u8> {
    let chosen = chosen(&args.only)?;
    let wanted = |c: &Column| !c.sums() || args.kernels.contains(&c.setting.method);
    let columns: Vec<Column> = columns().into_iter().filter(wanted).collect();
    println!(
        "here: {}, median of {}",
        plural(threads(), "thread"),
        args.effort.repeat
    );
    println!("published (Qu & James 2021, table 1): {MACHINE}");
    println!(
        "other machines, other programs: compare orders of magnitude. Times in seconds; each \
         error is the largest of a linking number"
    );
    let table = table(&columns);
    println!("{}", table.header());
    let mut code = 0;
    for published in chosen {
        match inputs(published, args) {
            Ok(inputs) => {
                for input in inputs {
                    let subject = subject(input, args)?;
                    let measure = |c: &Column| {
                        let device = (&Device::Cpu, None);
                        Row::measure(c.setting, &subject, &args.effort, device)
                    };
                    let rows: Vec<Row> = columns.iter().map(measure).collect::<Result<_>>()?;
                    println!("{}", table.row(cells(published, &subject, &rows)));
                    println!("{}", table.row(cpu_cells(&rows)));
                    if let Some(differs) = input.differs {
                        println!("  {}: {differs}", subject.name);
                    }
                    if !subject.as_expected || rows.iter().any(Row::differs) {
                        let model = published.model;
                        eprintln!("error: {model}: a certificate differs from the exact one");
                        code = 1;
                    }
                }
            }
            Err(why) => println!("{:38} here: {why}", published.model),
        }
        println!("{}", table.row(published_cells(published, &columns)));
    }
    Ok(code)
}

/// Returns the models whose names contain one of these words, or all.
fn chosen(only: &[String]) -> Result<Vec<&'static Published>> {
    let says = |p: &Published, word: &String| {
        let name = p.model.to_lowercase();
        !word.is_empty() && name.contains(&word.to_lowercase())
    };
    if let Some(word) = only.iter().find(|w| !TABLE_1.iter().any(|p| says(p, w))) {
        let names: Vec<&str> = TABLE_1.iter().map(|p| p.model).collect();
        return Err(usage(format!(
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
    if p.sizes[0] > args.segments {
        let segments = count(p.sizes[0]);
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
        (Source::File(name), Some(folder)) => {
            Subject::new(name, formats::read(&folder.join(name))?)
        }
        (Source::File(name) | Source::Scene(name), _) => Subject::scene(name),
    }
}

fn table(columns: &[Column]) -> Table {
    let mut all = vec![
        ("model", -37),
        ("", -9),
        ("segments", 10),
        ("curves", 7),
        ("pairs", 9),
    ];
    all.extend(columns.iter().map(|column| (column.title, 10)));
    let sums = columns.iter().filter(|c| c.sums());
    all.extend(sums.map(|column| (column.title, 11)));
    Table::new(all)
}

/// Returns the cells of a measured model.
fn cells(p: &Published, subject: &Subject, rows: &[Row]) -> Vec<String> {
    let curves = &subject.curves;
    let sizes = [
        curves.segments(),
        curves.len(),
        subject.stats.potential_links as usize,
    ];
    let mut cells = vec![p.model.into(), "here".into()];
    cells.extend(sizes.map(|n| count(n as u64)));
    cells.extend(rows.iter().map(|row| match &row.measured {
        Ok(_) => seconds(row.linking_ms().map(|ms| 1e-3 * ms)),
        Err(s) => format!("~{}", seconds(Some(*s))),
    }));
    let sums = rows.iter().filter(|row| !row.counts());
    cells.extend(sums.map(|row| brief(row.largest_error())));
    cells
}

/// Returns the cells with the CPU times of all stages, for each kernel.
fn cpu_cells(rows: &[Row]) -> Vec<String> {
    let mut cells = vec![String::new(); 5];
    cells[1] = "cpu".into();
    let cpu_s = |row: &Row| row.run().map(|run| 1e-3 * run.times.cpu_ms);
    cells.extend(rows.iter().map(|row| seconds(cpu_s(row))));
    cells
}

fn published_cells(p: &Published, columns: &[Column]) -> Vec<String> {
    let mut cells = vec![String::new(), "published".into()];
    cells.extend(p.sizes.map(count));
    cells.extend(columns.iter().map(|column| seconds((column.time)(p))));
    let sums = columns.iter().filter(|c| c.sums());
    cells.extend(sums.map(|column| brief((column.error)(p))));
    cells
}

/// Formats seconds with three digits, or a dash.
fn seconds(s: Option<f64>) -> String {
    match s {
        None => "-".into(),
        Some(s) if s < 0.1 => format!("{s:.4}"),
        Some(s) if s < 10.0 => format!("{s:.3}"),
        Some(s) if s < 1000.0 => format!("{s:.1}"),
        Some(s) => format!("{s:.0}"),
    }
}
