//! Times and results of certificates, and tables of them. The benches of the stages share this
//! file.

use linkwatch::kernels::Device;
use linkwatch::scenes::Scene;
use linkwatch::{
    Certificate, Certifier, CurveSet, Ladder, Result, SessionOptions, Stats, homotopic_polylines,
};
use std::time::{Duration, Instant};

/// Time of some work, in milliseconds.
#[derive(Clone, Copy)]
pub struct Elapsed {
    pub wall_ms: f64,
    /// CPU time of all threads of this process; on systems without such a clock, the wall-clock
    /// time.
    pub cpu_ms: f64,
}

/// Runs `work` and measures its time.
pub fn timed<T>(work: impl FnOnce() -> T) -> (T, Elapsed) {
    let (start, cpu) = (Instant::now(), cpu_ms());
    let found = work();
    let wall_ms = ms(start.elapsed());
    let cpu_ms = match (cpu, cpu_ms()) {
        (Some(before), Some(after)) => after - before,
        _ => wall_ms,
    };
    (found, Elapsed { wall_ms, cpu_ms })
}

/// Returns the CPU time of this process so far, in milliseconds, if the system has such a clock.
fn cpu_ms() -> Option<f64> {
    #[cfg(unix)]
    {
        use rustix::time::{ClockId, clock_gettime};
        let t = clock_gettime(ClockId::ProcessCPUTime);
        Some(t.tv_sec as f64 * 1e3 + t.tv_nsec as f64 * 1e-6)
    }
    #[cfg(not(unix))]
    None
}

pub fn ms(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

/// Runs `work` at most `runs` times, and at least once. No run starts after `limit_s` seconds.
pub fn repeat<T>(runs: u32, limit_s: f64, mut work: impl FnMut() -> T) -> Vec<T> {
    let start = Instant::now();
    let mut results = vec![work()];
    while results.len() < runs as usize && start.elapsed().as_secs_f64() < limit_s {
        results.push(work());
    }
    results
}

/// Returns the median of some values: the larger one of two in the middle. NaN if there are none.
pub fn median(values: impl IntoIterator<Item = f64>) -> f64 {
    let mut sorted: Vec<f64> = values.into_iter().collect();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Times of the stages of a certificate, in milliseconds.
#[derive(Clone, Copy, Debug)]
pub struct StageTimes {
    /// Boxes of all segments, and the trees over them.
    pub boxes_ms: f64,
    /// Search for potential links.
    pub pairs_ms: f64,
    /// Discretization and linking numbers.
    pub links_ms: f64,
    pub total_ms: f64,
    /// CPU time of all threads, for all stages.
    pub cpu_ms: f64,
    /// Sums, discretization included: a part of `links_ms`.
    pub summing_ms: f64,
    /// Part of `summing_ms` that converts splines to polylines.
    pub discretizing_ms: f64,
}

impl StageTimes {
    /// Returns the median of each time separately.
    pub fn median(all: &[StageTimes]) -> StageTimes {
        let median = |time: fn(&StageTimes) -> f64| median(all.iter().map(time));
        StageTimes {
            boxes_ms: median(|t| t.boxes_ms),
            pairs_ms: median(|t| t.pairs_ms),
            links_ms: median(|t| t.links_ms),
            total_ms: median(|t| t.total_ms),
            cpu_ms: median(|t| t.cpu_ms),
            summing_ms: median(|t| t.summing_ms),
            discretizing_ms: median(|t| t.discretizing_ms),
        }
    }
}

/// A measured certificate.
#[derive(Clone, Copy, Debug)]
pub struct Run {
    pub times: StageTimes,
    pub stats: Stats,
    pub ladder: Ladder,
    /// True if the certificate is the exact one.
    pub equal: bool,
}

impl Run {
    /// Certifies curves once, and compares the result with the exact one.
    pub fn of(certifier: &mut Certifier, curves: &CurveSet, exact: &Certificate) -> Run {
        let ((found, stats), elapsed) = timed(|| certifier.certify(curves));
        let equal = found == exact;
        let (timings, ladder) = (certifier.timings(), certifier.ladder());
        Run {
            times: StageTimes {
                boxes_ms: ms(timings.boxes),
                pairs_ms: ms(timings.pairs),
                links_ms: ms(timings.links),
                total_ms: ms(timings.total),
                cpu_ms: elapsed.cpu_ms,
                summing_ms: ms(ladder.summing),
                discretizing_ms: ms(ladder.discretizing),
            },
            stats,
            ladder,
            equal,
        }
    }

    /// Certifies curves with a new certifier, which allocates its buffers, and again with the same
    /// one.
    pub fn first_and_later(subject: &Subject) -> [Run; 2] {
        let mut certifier = Certifier::default();
        [(); 2].map(|()| Run::of(&mut certifier, &subject.curves, &subject.exact))
    }

    /// Returns the medians of all times. All other results are those of the last run; they do not
    /// depend on the run.
    pub fn median(runs: &[Run]) -> Run {
        let times: Vec<StageTimes> = runs.iter().map(|run| run.times).collect();
        Run {
            times: StageTimes::median(&times),
            equal: runs.iter().all(|run| run.equal),
            ..runs[runs.len() - 1]
        }
    }
}

/// Returns a certifier of a device with its default kernel.
pub fn certifier(device: &Device) -> Result<Certifier> {
    Certifier::new(&SessionOptions {
        device: device.clone(),
        ..SessionOptions::default()
    })
}

/// Curves to measure, with their exact certificate.
#[derive(Clone, Debug)]
pub struct Subject {
    /// Name of the model or description of the scene.
    pub name: String,
    pub curves: CurveSet,
    /// Certificate of the curves, by counting crossings.
    pub exact: Certificate,
    /// Work counters of that certificate.
    pub stats: Stats,
    /// Number of segment pairs in the potential links, of the polylines: the work of sums without
    /// trees.
    pub segment_pairs: u64,
    /// True if the certificate is the known one of a scene or a model, or none is known.
    pub as_expected: bool,
}

impl Subject {
    /// Certifies curves as a reference.
    ///
    /// Errors: those of the discretization of splines.
    pub fn new(name: &str, curves: CurveSet) -> Result<Subject> {
        let mut certifier = Certifier::default();
        let (exact, stats) = certifier.certify(&curves);
        let exact = exact.clone();
        let segment_pairs = match curves.basis().is_polyline() {
            true => certifier.segment_pairs(&curves),
            false => certifier.segment_pairs(&homotopic_polylines(&curves)?.curves),
        };
        Ok(Subject {
            name: name.into(),
            curves,
            exact,
            stats,
            segment_pairs,
            as_expected: true,
        })
    }

    /// Builds a scene, and compares its certificate with the one that follows from its
    /// construction.
    pub fn scene(text: &str) -> Result<Subject> {
        let scene = text.parse::<Scene>()?.build()?;
        Ok(Subject::new(text, scene.curves)?.expecting(&scene.certificate))
    }

    /// Compares the certificate with a known one.
    pub fn expecting(mut self, known: &Certificate) -> Subject {
        self.as_expected = self.exact == *known;
        self
    }
}

/// Columns of a table of text. Rows are printed one by one, so the columns have fixed widths.
pub struct Table {
    columns: Vec<(String, isize)>,
}

impl Table {
    /// Creates a table from the title and the width of each column. A negative width aligns the
    /// cells to the left. A title may have several lines.
    pub fn new<T: Into<String>>(columns: impl IntoIterator<Item = (T, isize)>) -> Table {
        let columns = columns.into_iter();
        Table {
            columns: columns
                .map(|(title, width)| (title.into(), width))
                .collect(),
        }
    }

    /// Returns the titles.
    pub fn header(&self) -> String {
        let titles = || self.columns.iter().map(|(title, _)| title);
        let lines = titles().map(|title| title.lines().count()).max();
        let line = |k| self.row(titles().map(move |title| title.lines().nth(k).unwrap_or("")));
        let lines: Vec<String> = (0..lines.unwrap_or(0)).map(line).collect();
        lines.join("\n")
    }

    /// Returns a row. A cell that is wider than its column shifts the others.
    pub fn row<T: AsRef<str>>(&self, cells: impl IntoIterator<Item = T>) -> String {
        let mut row = String::new();
        for (cell, (_, width)) in cells.into_iter().zip(&self.columns) {
            let (cell, room) = (cell.as_ref(), width.unsigned_abs());
            row += &match width {
                ..0 => format!("{cell:room$} "),
                _ => format!("{cell:>room$} "),
            };
        }
        row.truncate(row.trim_end().len());
        row
    }
}
