//! Frames that a recording keeps: all, some, or those around violations; in one file or in several.
//!
//! Every file replays by itself. It has the metadata of the run, and before its first frame the
//! baseline and the names of the curves, and again after skipped frames. Skipped frames are counted
//! in the file ([`RunProgress::left_out`](crate::RunProgress)), so that a reader can distinguish
//! them from lost frames.
//!
//! All of this is single-threaded code on the thread of a [`SinkQueue`](crate::SinkQueue).

mod every;
mod files;
mod window;

use self::every::Every;
use self::files::Files;
use self::window::Window;
use crate::error::{Error, Result};
use crate::sinks::{BaselineRecord, FrameRecord, Sink};
use crate::verdict::{Report, Verdict};
use std::collections::BTreeMap;
use std::num::NonZeroU64;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

/// Frames that a recording keeps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Retention {
    /// All frames.
    #[default]
    All,
    /// All verdicts, and the curves of every N-th frame. The curves of a frame that is not intact,
    /// and of the frame before it, are always kept, and so are those of a frame that does not
    /// continue the previous one.
    Every(NonZeroU64),
    /// Frames around violations: a frame with a finding that the previous frame did not have is
    /// kept, with all frames that arrived this time before it and after it. No file is created
    /// without a violation.
    Window {
        /// Time before and after a violation.
        span: Duration,
        /// Maximum memory of the frames that wait for a violation, in bytes. If it is too small for
        /// the time, the oldest frames are dropped. The last frame is always kept.
        memory: u64,
    },
}

impl Retention {
    /// Default of the memory of [`Retention::Window`], in bytes.
    pub const WINDOW_MEMORY: u64 = 1 << 30;

    /// Key of the number of [`Retention::Every`] in the metadata of a recording.
    pub const EVERY: &str = "record_every";

    /// Key of the seconds of [`Retention::Window`] in the metadata of a recording.
    pub const WINDOW: &str = "record_window";
}

/// Settings of a recording in one or several files.
///
/// ```
/// use linkwatch::{Overflow, RecordingOptions, Retention, SinkQueue};
/// use std::time::Duration;
///
/// # let folder = tempfile::tempdir()?;
/// let mut options = RecordingOptions::new(folder.path().join("run.mcap"));
/// // The last ten seconds before each violation, and ten seconds after it.
/// options.retention = Retention::Window {
///     span: Duration::from_secs(10),
///     memory: Retention::WINDOW_MEMORY,
/// };
/// let wait = Overflow::Wait(Duration::from_secs(1));
/// let queue = SinkQueue::spawn("recording", 64, wait, move || options.open())?;
/// // .. `queue.begin` and `queue.frame` ..
/// # queue.finish(Duration::from_secs(60));
/// # Ok::<(), linkwatch::Error>(())
/// ```
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct RecordingOptions {
    /// The file, or the first one: later ones are named `run-part2.mcap`, `run-part3.mcap`, ..,
    /// except for names that exist.
    pub path: PathBuf,
    /// Description of the run for a later reader.
    pub metadata: BTreeMap<String, String>,
    /// True if existing files may be replaced. Files that another process reads or writes never
    /// are.
    pub overwrite: bool,
    /// Frames to keep.
    pub retention: Retention,
    /// Size from which another file is begun, in bytes; at least
    /// [`RecordingOptions::LEAST_MAX_BYTES`]. A file is larger only if it has a single frame.
    pub max_bytes: Option<u64>,
}

impl RecordingOptions {
    /// Smallest maximum size of a file, in bytes.
    pub const LEAST_MAX_BYTES: u64 = 1_000_000;

    /// Returns the settings of a recording of all frames in one file.
    pub fn new(path: impl Into<PathBuf>) -> RecordingOptions {
        RecordingOptions {
            path: path.into(),
            metadata: BTreeMap::new(),
            overwrite: false,
            retention: Retention::All,
            max_bytes: None,
        }
    }

    /// Creates the file, unless it needs a violation first.
    ///
    /// # Errors
    ///
    /// [`Error::File`] if the file exists and may not be replaced, or cannot be created;
    /// [`Error::Usage`] if the maximum size is too small.
    pub fn open(mut self) -> Result<Box<dyn Sink>> {
        if let Some(bytes) = self.max_bytes.filter(|&b| b < Self::LEAST_MAX_BYTES) {
            let least = Self::LEAST_MAX_BYTES;
            let what = format!("files of at most {bytes} bytes are too small: {least} at least");
            return Err(Error::Usage(what));
        }
        let retention = self.retention;
        let described = match retention {
            Retention::All => None,
            Retention::Every(n) => Some((Retention::EVERY, n.to_string())),
            Retention::Window { span, .. } => {
                Some((Retention::WINDOW, span.as_secs_f64().to_string()))
            }
        };
        let described = described.map(|(key, value)| (key.into(), value));
        self.metadata.extend(described);
        sink(Files::new(self), retention)
    }
}

/// Returns the sink that keeps these frames.
fn sink(mut files: Files, retention: Retention) -> Result<Box<dyn Sink>> {
    if !matches!(retention, Retention::Window { .. }) {
        files.create_first()?;
    }
    Ok(match retention {
        Retention::All => Box::new(Kept::new(files, All)),
        Retention::Every(n) => Box::new(Kept::new(files, Every::new(n))),
        Retention::Window { span, memory } => Box::new(Kept::new(files, Window::new(span, memory))),
    })
}

/// Keys of the metadata of one of several files: its number from 2 on, the file before it, and the
/// one after it.
pub(crate) const PART: &str = "part";
const CONTINUES: &str = "continues";
pub(crate) const CONTINUED: &str = "continued_in";

/// State of the run before a frame.
#[derive(Clone, Debug, Default)]
struct Start {
    /// Baseline with which a replay can begin with this frame; `None` if it is not known yet.
    baseline: Option<Arc<BaselineRecord>>,
    /// Number of frames verified or rejected before this one, as far as this sink has seen them.
    answered: u64,
    /// True if this frame does not continue the previous one, or has other curves.
    new: bool,
    /// True if the baseline differs from that of the previous frame, because the frame has other
    /// curves, or because the simulator accepted it.
    other_baseline: bool,
}

/// Follows the state of a run.
#[derive(Default)]
struct InForce {
    /// Baseline before and after the next frame.
    before: Option<Arc<BaselineRecord>>,
    after: Option<Arc<BaselineRecord>>,
    answered: u64,
    /// Numbers of the layout and of the baseline, and of the cuts, of the last frame with curves.
    last: Option<((u32, u64), u32)>,
}

impl InForce {
    /// Begins with a baseline: the next frame does not continue the previous one.
    fn begin(&mut self, baseline: &BaselineRecord) {
        let baseline = Some(Arc::new(baseline.clone()));
        (self.before, self.after) = (baseline.clone(), baseline);
        self.last = None;
    }

    /// Sets the baseline after the next frame.
    fn expect(&mut self, baseline: &BaselineRecord) {
        self.after = Some(Arc::new(baseline.clone()));
    }

    /// Returns the state before a frame, and advances to the state after it.
    fn pass(&mut self, record: &FrameRecord) -> Start {
        let info = record.curves.as_ref().map(|_| &record.info);
        let now = info.map(|info| ((info.layout, info.baseline), info.cuts));
        let new = now.is_some() && now != self.last;
        let other_baseline = now.is_some_and(|now| Some(now.0) != self.last.map(|last| last.0));
        // The baseline after the frame has the indices of its curves, and its linking numbers if it
        // was accepted.
        let baseline = match &self.before {
            Some(before) if !other_baseline => Some(Arc::clone(before)),
            _ => self.after.clone(),
        };
        let start = Start {
            baseline,
            answered: std::mem::replace(&mut self.answered, answered(record)),
            new,
            other_baseline,
        };
        self.last = now.or(self.last);
        self.before.clone_from(&self.after);
        start
    }
}

/// Number of frames verified or rejected so far, this one included.
fn answered(record: &FrameRecord) -> u64 {
    record.progress.verified + record.progress.rejected
}

fn is_intact(record: &FrameRecord) -> bool {
    record.report.verdict == Verdict::Intact
}

/// Memory of a finding, and its size in a file, in bytes, at most.
const FINDING_BYTES: u64 = 160;

/// Returns the memory of the findings of a frame in bytes.
fn bytes_of_findings(report: &Report) -> u64 {
    let passages = report.events.len() + report.unresolved.len();
    let others = report.changes.len() + report.defects.len() + report.adopted.len();
    let others = others + report.invariants.len();
    FINDING_BYTES * (passages + others) as u64
}

/// Chooses the frames that are written.
trait Keep: Send {
    /// Takes a frame, in the state of the run before it.
    fn frame(&mut self, files: &mut Files, record: &FrameRecord, start: Start) -> Result<()>;

    /// Writes what is due. What else waits has nothing to do with the next frames.
    fn end(&mut self, _files: &mut Files) -> Result<()> {
        Ok(())
    }

    /// See [`Sink::work`].
    fn work(&mut self, _files: &mut Files) -> Result<bool> {
        Ok(false)
    }

    /// Returns the number of frames as text.
    fn note(&self, _files: &Files) -> Option<String> {
        None
    }
}

/// Records the frames that `K` chooses.
struct Kept<K> {
    files: Files,
    state: InForce,
    keep: K,
}

impl<K: Keep> Kept<K> {
    fn new(files: Files, keep: K) -> Kept<K> {
        let state = InForce::default();
        Kept { files, state, keep }
    }
}

impl<K: Keep> Sink for Kept<K> {
    fn begin(&mut self, baseline: &BaselineRecord) -> Result<()> {
        // A frame before the first baseline was rejected, and its window continues.
        if self.state.before.is_some() {
            self.keep.end(&mut self.files)?;
        }
        self.state.begin(baseline);
        self.files.again = true;
        Ok(())
    }

    fn expect(&mut self, baseline: &BaselineRecord) -> Result<()> {
        self.state.expect(baseline);
        Ok(())
    }

    fn frame(&mut self, record: &FrameRecord) -> Result<()> {
        let start = self.state.pass(record);
        self.keep.frame(&mut self.files, record, start)
    }

    fn cut_off(&mut self, why: &str) -> Result<()> {
        self.keep.end(&mut self.files)?;
        self.files.cut_off(why)
    }

    fn flush(&mut self) -> Result<()> {
        self.files.flush()
    }

    fn work(&mut self) -> Result<bool> {
        self.keep.work(&mut self.files)
    }

    fn note(&self) -> Option<String> {
        let notes = [self.keep.note(&self.files), self.files.note()];
        let notes: Vec<String> = notes.into_iter().flatten().collect();
        (!notes.is_empty()).then(|| notes.join("\n"))
    }

    fn finish(mut self: Box<Self>) -> Result<()> {
        self.keep.end(&mut self.files)?;
        self.files.finish()
    }
}

/// Keeps all frames.
struct All;

impl Keep for All {
    fn frame(&mut self, files: &mut Files, record: &FrameRecord, start: Start) -> Result<()> {
        files.write(record, &start)
    }
}

/// Returns the name of a file of a recording in several files.
fn part_of(path: &Path, number: u64) -> PathBuf {
    match number {
        1 => path.to_owned(),
        _ => with_suffix(path, &format!("part{number}")),
    }
}

/// Returns a path with a suffix before its extension: `run.mcap` with `2` is `run-2.mcap`.
pub fn with_suffix(path: &Path, suffix: &str) -> PathBuf {
    let mut name = path.file_stem().unwrap_or_default().to_owned();
    name.push(format!("-{suffix}"));
    if let Some(extension) = path.extension() {
        name.push(".");
        name.push(extension);
    }
    path.with_file_name(name)
}

#[cfg(test)]
mod tests;
