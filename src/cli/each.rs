//! `linkwatch check --each`: each file is a separate run, verified in a separate process.
//!
//! A run that crashes, or that the system kills because memory is short, costs no other run.

use super::input::has_extension;
use super::{Outcome, output};
use linkwatch::Result;
use linkwatch::formats::without_compression;
use rayon::iter::{ParallelBridge, ParallelIterator};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::HashMap;
use std::fs::File;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::io::{BufRead, BufReader, Read, Write};
use std::num::NonZeroUsize;
#[cfg(unix)]
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::{Instant, SystemTime};

/// The option `--each` and what belongs to it.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Many runs")]
pub struct EachArgs {
    /// Verify each file as a run of its own, in a process of its own: a line of JSON for each
    #[arg(long, conflicts_with_all = ["one_motion", "junit", "record", "show"])]
    pub each: bool,
    /// Number of runs at a time, with --each [default: one per core]
    #[arg(
        long, value_name = "N", requires = "each", hide_short_help = true,
        value_parser = clap::value_parser!(u16).range(1..)
    )]
    jobs: Option<u16>,
    /// Append the lines to a file, with --each
    #[arg(
        short,
        long,
        value_name = "FILE.jsonl",
        requires = "each",
        hide_short_help = true
    )]
    output: Option<PathBuf>,
    /// Skip the runs that the file has, except those that failed
    #[arg(long, requires = "output", hide_short_help = true)]
    resume: bool,
    /// The file to verify, in a process that `--each` started.
    #[arg(long, hide = true)]
    pub only: Option<PathBuf>,
}

/// A line of the output: the result of one run.
#[derive(Debug, Default, Serialize, Deserialize)]
struct Line {
    file: String,
    /// Exit code of the process; `None` if a signal ended it.
    code: Option<i32>,
    /// Reason why there is no verdict.
    error: Option<String>,
    verdict: Option<String>,
    seconds: f64,
    /// Warnings of the process.
    warnings: Vec<String>,
    summary: Option<Value>,
    /// Hash of the options, and of the sizes and the times of change of the files that the run
    /// reads. `--resume` skips a run whose key is the same.
    key: String,
}

/// Formats whose files refer to other files. Which ones is not known here.
const REFERRING: [&str; 11] = [
    "pvd", "pvtp", "pvtu", "vtm", "xdmf", "usd", "usda", "usdc", "usdz", "top", "itp",
];

/// Returns the [`Line::key`] of a run that reads these files, the model first. If the model refers
/// to other files, every call returns another key, because those files are not checked.
fn key(files: &[PathBuf], options: &str) -> String {
    let mut hasher = DefaultHasher::new();
    options.hash(&mut hasher);
    let model = files.first().map(|model| without_compression(model));
    if model.is_some_and(|model| has_extension(&model, &REFERRING)) {
        SystemTime::now().hash(&mut hasher);
    }
    for file in files {
        let file = file.metadata().ok();
        let modified = file.as_ref().and_then(|file| file.modified().ok());
        // A copy may keep the time of the file that it replaces.
        #[cfg(unix)]
        file.as_ref()
            .map(|f| (f.ctime(), f.ctime_nsec()))
            .hash(&mut hasher);
        (file.map(|file| file.len()), modified).hash(&mut hasher);
    }
    format!("{:016x}", hasher.finish())
}

/// Results, which are written while other runs continue.
#[derive(Default)]
struct Lines {
    file: Option<File>,
    /// Exit codes and keys of the runs that the file had before.
    done: HashMap<String, (Option<i32>, String)>,
    /// Numbers of runs: intact, changed, undecided and failed.
    counts: [usize; 4],
}

/// Returns the place of an exit code in [`Lines::counts`].
fn class(code: Option<i32>) -> usize {
    match code {
        Some(0) => 0,
        Some(1) => 1,
        Some(3) => 2,
        _ => 3,
    }
}

impl EachArgs {
    /// Runs the command on these files; `options` are all others, in some form, and `reads` returns
    /// all files that a run reads.
    ///
    /// # Errors
    ///
    /// The output cannot be used; or a run failed, and no topology changed.
    pub fn run(
        &self,
        models: &[PathBuf],
        options: &str,
        reads: impl Fn(&PathBuf) -> Vec<PathBuf> + Sync,
    ) -> Result<Outcome> {
        let mut lines = Lines::default();
        if let Some(path) = &self.output {
            lines.open(path, self.resume).map_err(|e| e.in_file(path))?;
        }
        let mut left = Vec::new();
        for model in models {
            match lines.done.get(&*model.to_string_lossy()) {
                Some((code, known)) if *known == key(&reads(model), options) => {
                    lines.counts[class(*code)] += 1;
                }
                _ => left.push(model),
            }
        }
        let cores = thread::available_parallelism().map_or(1, NonZeroUsize::get);
        let jobs = self.jobs.map_or(cores, usize::from).min(left.len().max(1));
        let threads = (cores / jobs).max(1);
        let lines = Mutex::new(lines);
        let run = |model: &&PathBuf| {
            // The key before the run, because a file may change meanwhile.
            let line = verified(model, threads, key(&reads(model), options));
            let mut lines = lines.lock().unwrap_or_else(PoisonError::into_inner);
            lines.put(&line)
        };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(jobs).build();
        let pool = pool.map_err(|e| usage!("--jobs {jobs}: {e}"))?;
        // One by one, in the order of the files.
        pool.install(|| left.iter().par_bridge().try_for_each(run))?;
        let lines = lines.into_inner().unwrap_or_else(PoisonError::into_inner);
        let [intact, changed, undecided, failed] = lines.counts;
        let runs = output::plural(models.len(), "run");
        tracing::info!(
            "{runs}: {intact} intact, {changed} changed, {undecided} undecided or incomplete, \
             {failed} failed; {} verified now",
            left.len(),
        );
        match (changed, failed, undecided) {
            (0, 0, 0) => Ok(Outcome::Fine),
            (0, 0, _) => Ok(Outcome::Undecided),
            (0, ..) => Err(usage!("{failed} of {runs} failed")),
            _ => Ok(Outcome::Changed),
        }
    }
}

impl Lines {
    /// Opens the output, and reads which runs it has.
    fn open(&mut self, path: &Path, resume: bool) -> Result<()> {
        if !resume && path.exists() {
            return Err(usage!(
                "exists: --resume skips the runs that it has, and appends the others"
            ));
        }
        let mut options = File::options();
        let mut file = options.read(true).append(true).create(true).open(path)?;
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes)?;
        // The last line may have been cut, also within a character.
        let whole = bytes.iter().rposition(|&byte| byte == b'\n');
        let (whole, rest) = bytes.split_at(whole.map_or(0, |at| at + 1));
        let lines = serde_json::Deserializer::from_slice(whole).into_iter::<Line>();
        let lines = lines.collect::<Result<Vec<Line>, _>>().ok();
        let lines = lines.filter(|_| rest.is_empty() || rest.starts_with(b"{"));
        let lines = lines.ok_or_else(|| {
            usage!("the file has lines that --each did not write, so --resume does not change it")
        })?;
        file.set_len(whole.len() as u64)?;
        let done = lines.into_iter().filter(|line| line.error.is_none());
        let done = done.map(|line| (line.file, (line.code, line.key)));
        self.done = done.collect();
        self.file = Some(file);
        Ok(())
    }

    fn put(&mut self, line: &Line) -> Result<()> {
        self.counts[class(line.code)] += 1;
        let json = serde_json::to_value(line).expect("a line is JSON");
        match &mut self.file {
            Some(file) => file.write_all(format!("{json}\n").as_bytes())?,
            None => output::json(&json),
        }
        let file = &line.file;
        match (&line.error, &line.verdict) {
            (Some(why), _) => tracing::error!("{file}: {why}"),
            (_, verdict) => tracing::info!("{file}: {}", verdict.as_deref().unwrap_or_default()),
        }
        Ok(())
    }
}

/// Verifies a file in a new process: this command with the same arguments, and `--only`.
fn verified(model: &Path, threads: usize, key: String) -> Line {
    let start = Instant::now();
    let ran = last_line(model, threads);
    let (code, last, errors) = ran.unwrap_or_else(|e| (None, String::new(), format!("error: {e}")));
    let warnings = errors.lines().map(str::trim);
    let warnings = warnings.filter_map(|line| line.strip_prefix("WARN "));
    let mut line = Line {
        file: model.to_string_lossy().into_owned(),
        code,
        seconds: start.elapsed().as_secs_f64(),
        warnings: warnings.map(str::to_owned).collect(),
        key,
        ..Line::default()
    };
    let mut last: Value = serde_json::from_str(&last).unwrap_or_default();
    if class(code) == 3 {
        let mut lines = errors.lines().rev();
        let why = lines.find_map(|line| line.strip_prefix("error: "));
        let name = format!("{}: ", model.display());
        let why = why.map(|why| why.strip_prefix(&name).unwrap_or(why));
        line.error = Some(why.unwrap_or("a signal ended the process").to_owned());
    } else {
        // If a run failed, its last line is about a frame and is not a summary.
        let of_frame = last["report"]["verdict"].as_str();
        let verdict = last["summary"]["verdict"].as_str().or(of_frame);
        line.verdict = verdict.map(str::to_owned);
        line.summary = last.get_mut("summary").map(Value::take);
    }
    line
}

/// Returns the exit code of the process, its last line on stdout and all on stderr.
fn last_line(model: &Path, threads: usize) -> std::io::Result<(Option<i32>, String, String)> {
    let mut own = std::env::args_os();
    let mut command = Command::new(own.next().unwrap_or_default());
    command.args(own.filter(|arg| arg != "--json"));
    command.args(["--json", "--only"]).arg(model);
    // An option --threads has priority.
    command.env("RAYON_NUM_THREADS", threads.to_string());
    let (out, err) = (Stdio::piped(), Stdio::piped());
    command.stdin(Stdio::null()).stdout(out).stderr(err);
    let mut child = command.spawn()?;
    let (out, mut err) = (child.stdout.take(), child.stderr.take());
    thread::scope(|scope| {
        let errors = scope.spawn(move || {
            let mut errors = Vec::new();
            err.as_mut().map(|err| err.read_to_end(&mut errors));
            String::from_utf8_lossy(&errors).into_owned()
        });
        let mut last = String::new();
        for line in BufReader::new(out.expect("piped")).lines() {
            last = line?;
        }
        let code = child.wait()?.code();
        Ok((code, last, errors.join().expect("a reader never panics")))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Regression test: `--resume` truncated a file that `--each` had not written, and appended to
    /// it.
    #[test]
    fn resume_leaves_files_as_they_are_that_each_did_not_write() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out");
        let line = serde_json::to_string(&Line::default()).unwrap();
        let cut = &line[..9];
        for (text, is_valid) in [
            (String::new(), true),
            (format!("{line}\n"), true),
            (format!("{line}\n{line}\n{cut}"), true),
            (cut.to_owned(), true),
            ("1 0 0\n2 0 0".to_owned(), false),
            ("0 0 1".to_owned(), false),
            (format!("{line}\n0 0 1\n"), false),
        ] {
            std::fs::write(&path, &text).unwrap();
            let opened = Lines::default().open(&path, true);
            assert_eq!(opened.is_ok(), is_valid, "{text}");
            let left = std::fs::read_to_string(&path).unwrap();
            match is_valid {
                true => assert_eq!(left, text.strip_suffix(cut).unwrap_or(&text)),
                false => assert_eq!(left, text),
            }
        }
    }

    /// Regression test: a stage of USD was not verified again after a layer of it had changed.
    #[test]
    fn a_file_that_refers_to_others_is_verified_again() {
        let key = |name: &str| key(&[PathBuf::from(name)], "");
        assert_ne!(key("a.usda"), key("a.usda"));
        assert_ne!(key("a.pvd.gz"), key("a.pvd.gz"));
        assert_eq!(key("a.npz"), key("a.npz"));
    }

    /// Regression test: a file that was truncated within a character was refused.
    #[test]
    fn resume_drops_a_line_that_was_cut_within_a_character() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out");
        let line = serde_json::to_string(&Line::default()).unwrap() + "\n";
        std::fs::write(&path, [line.as_bytes(), b"{\"file\":\"g\xc3"].concat()).unwrap();
        Lines::default().open(&path, true).unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), line);
    }
}
