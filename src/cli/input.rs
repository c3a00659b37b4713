//! Curves of arguments: model files, folders and patterns of them, recordings, generated scenes.

use super::{Outcome, order, output};
use linkwatch::model::{Frames, LeftOut, ModelFrame, ReadOptions};
use linkwatch::scenes::Scene;
use linkwatch::{Cell, CurveLabels, CurveSet, Error, FrameInfo, Result, model};
#[cfg(feature = "mcap")]
use linkwatch::{Ending, RecordingReader};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Information on curves that some formats lack.
#[derive(Clone, Debug, Default, clap::Args)]
#[command(next_help_heading = super::INPUT)]
pub struct FormatArgs {
    /// LAMMPS data file with the bonds of a dump
    #[arg(long, value_name = "FILE", hide_short_help = true)]
    bonds: Option<PathBuf>,
    /// Number of points of each curve of a .npy file, below 0 if the curve is closed
    #[arg(
        long,
        value_name = "N,..",
        value_delimiter = ',',
        allow_hyphen_values = true,
        hide_short_help = true
    )]
    counts: Option<Vec<i32>>,
    /// Topic to read of an MCAP file of another program, if several have curves
    #[arg(long, value_name = "TOPIC", hide_short_help = true)]
    topic: Option<String>,
    /// Set by the command: curves that are torn at a periodic boundary are not refused.
    #[arg(skip)]
    wrapped: bool,
}

impl FormatArgs {
    /// Returns the arguments for frames whose coordinates are wrapped, or not.
    pub fn wrapped(&self, wrapped: bool) -> FormatArgs {
        FormatArgs {
            wrapped,
            ..self.clone()
        }
    }

    /// Returns the other files that are read.
    pub fn files(&self) -> impl Iterator<Item = &PathBuf> {
        self.bonds.iter()
    }

    fn options(&self) -> ReadOptions {
        let mut options = ReadOptions::default();
        options.bonds.clone_from(&self.bonds);
        options.counts.clone_from(&self.counts);
        options.topic.clone_from(&self.topic);
        options.wrapped = self.wrapped;
        options
    }
}

/// Reads a model file if the argument has the extension of one or names an existing file. Otherwise
/// builds the scene that the argument describes. Warns if the file has several frames, of which
/// the first one is read. For commands that do not consider periodic images.
///
/// Errors: [`Error::Usage`] if the frame has a periodic cell, besides those of reading.
#[cfg(feature = "lab")]
pub fn read(argument: &Path) -> Result<CurveSet> {
    let args = FormatArgs::default();
    let picked = read_frame(argument, &args, Pick::First)?;
    if let Some(cell) = picked.cell {
        return Err(Error::Usage(format!(
            "{}: the frame has a periodic cell ({cell}), but this command considers the curves \
             alone, without their images: `linkwatch convert` writes them to a format without a \
             cell, .bcc for example",
            argument.display()
        )));
    }
    warn_of_frames(argument, &args, &picked)?;
    Ok(picked.curves)
}

/// Warns if a file has several frames, of which only one was read.
pub fn warn_of_frames(argument: &Path, args: &FormatArgs, picked: &Picked) -> Result<()> {
    let Some(number) = picked.number else {
        return Ok(());
    };
    let frames = frames_of(argument, args)?.filter(Result::is_ok).count();
    if frames > 1 {
        tracing::warn!(
            "{}: {frames} frames; only the first one is used, frame {number} (`linkwatch convert \
             --frame` writes another one to a file)",
            argument.display(),
        );
    }
    Ok(())
}

/// The frame of a file with several.
#[derive(Clone, Copy, Debug)]
pub enum Pick {
    First,
    Last,
    /// The one with this number.
    Number(u64),
}

/// One frame of an argument.
pub struct Picked {
    pub curves: CurveSet,
    /// Radii of the curves, or none.
    pub radii: Vec<f32>,
    /// Number of the frame, if the file may have several.
    pub number: Option<u64>,
    /// Periodic cell of the frame, if it has one.
    pub cell: Option<Cell>,
    /// Elements of the file that may be curves of this frame, and were not read.
    pub left_out: Vec<LeftOut>,
}

impl Picked {
    /// Returns the best possible outcome of a command that considers this frame.
    pub fn outcome(&self) -> Outcome {
        outcome_without(&self.left_out)
    }
}

/// Returns the best possible outcome for curves without these elements of their file.
pub fn outcome_without(left_out: &[LeftOut]) -> Outcome {
    match left_out.is_empty() {
        true => Outcome::Fine,
        false => Outcome::Undecided,
    }
}

/// Reads one frame of a model file or of a recording, or builds a scene as [`read`] does.
pub fn read_frame(argument: &Path, args: &FormatArgs, pick: Pick) -> Result<Picked> {
    let frames = match frames_of(argument, args) {
        Err(Error::UnknownModel { .. }) if !argument.exists() => {
            return Ok(Picked {
                curves: scene(argument)?,
                radii: Vec::new(),
                number: None,
                cell: None,
                left_out: Vec::new(),
            });
        }
        frames => frames?,
    };
    let mut found = None;
    for frame in frames {
        let frame = match frame {
            Err(e) if matches!(pick, Pick::Last) && found.is_some() => {
                tracing::warn!("{e}; the last frame before that is used");
                break;
            }
            frame => frame?,
        };
        match pick {
            Pick::Number(seq) if seq != frame.seq => continue,
            Pick::Last => found = Some(frame),
            _ => {
                found = Some(frame);
                break;
            }
        }
    }
    let frame = found.ok_or_else(|| {
        let what = match pick {
            Pick::Number(seq) => format!("no frame {seq}"),
            _ => "no frame".into(),
        };
        Error::Usage(format!("{}: {what}", argument.display()))
    })?;
    output::warn_of_left_out(argument, &frame.left_out);
    Ok(Picked {
        curves: frame.curves.map_err(|e| e.in_file(argument))?,
        radii: frame.labels.radii.clone(),
        cell: frame.cell,
        left_out: frame.left_out,
        number: holds_frames(argument).then_some(frame.seq),
    })
}

/// Builds the scene that an argument describes.
fn scene(argument: &Path) -> Result<CurveSet> {
    let scene: Scene = argument.to_string_lossy().parse().map_err(|e| match e {
        Error::Scene { scene, what } => Error::Scene {
            scene,
            what: format!(
                "{what}; and no file has this name (known: {})",
                model::MODEL_FILES
            ),
        },
        other => other,
    })?;
    Ok(scene.build()?.curves)
}

/// Replaces folders by the models in them, and patterns (`frames/*.bcc`, for shells that do not
/// expand them) by the files that match. Unless the order is to be kept, files whose names differ
/// in numbers only are sorted by these numbers.
pub fn expand(arguments: &[PathBuf], keep_order: bool) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for argument in arguments {
        if argument.is_dir() {
            let models = models_in(argument)?;
            check_one_format(argument, &models)?;
            files.extend(models);
        } else if !argument.exists() && argument.to_string_lossy().contains(['*', '?', '[']) {
            files.extend(matches(argument)?);
        } else {
            files.push(argument.clone());
        }
    }
    if !keep_order && order::sort(&mut files) {
        tracing::warn!(
            "models are sorted by the numbers in their names: {} .. {} (--keep-order keeps the \
             given order)",
            files[0].display(),
            files[files.len() - 1].display(),
        );
    }
    Ok(files)
}

/// Same as [`expand`] for models that are no frames of one motion: they keep their order, and a
/// folder may hold several formats.
pub fn expand_models(arguments: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for argument in arguments {
        match argument.is_dir() {
            true => files.extend(models_in(argument)?),
            false => files.extend(expand(std::slice::from_ref(argument), true)?),
        }
    }
    Ok(files)
}

fn models_in(folder: &Path) -> Result<Vec<PathBuf>> {
    let refuse = |why: String| Error::Usage(format!("{}: {why}", folder.display()));
    let entries = std::fs::read_dir(folder).map_err(|e| refuse(e.to_string()))?;
    let files = entries.flatten().map(|entry| entry.path());
    let mut models: Vec<PathBuf> = files
        .filter(|file| file.is_file() && model::Format::of(file).is_ok())
        .collect();
    models.sort();
    if models.is_empty() {
        let known = model::MODEL_FILES;
        return Err(refuse(format!("the folder holds no models ({known})")));
    }
    order::sort(&mut models);
    Ok(models)
}

/// Checks that the models of a folder may be frames of one motion.
fn check_one_format(folder: &Path, models: &[PathBuf]) -> Result<()> {
    let extension = |file: &Path| file.extension().unwrap_or_default().to_ascii_lowercase();
    let different = models
        .windows(2)
        .find(|m| extension(&m[0]) != extension(&m[1]));
    match different {
        None => Ok(()),
        Some(pair) => Err(Error::Usage(format!(
            "{}: models of several formats ({}, {}): give a pattern, or the files",
            folder.display(),
            pair[0].display(),
            pair[1].display()
        ))),
    }
}

fn matches(pattern: &Path) -> Result<Vec<PathBuf>> {
    let text = pattern.to_string_lossy();
    let found = glob::glob(&text).map_err(|e| Error::Usage(format!("{text}: {e}")))?;
    let mut files: Vec<PathBuf> = found.flatten().filter(|file| file.is_file()).collect();
    if files.is_empty() {
        return Err(Error::Usage(format!("{text}: no file has such a name")));
    }
    order::sort(&mut files);
    Ok(files)
}

/// Returns true if the file is a recording, or an MCAP file of another program.
pub fn is_mcap(path: &Path) -> bool {
    let extension = path.extension();
    extension.is_some_and(|e| e.eq_ignore_ascii_case("mcap"))
}

/// Returns true if a file of this name may hold several frames.
pub fn holds_frames(path: &Path) -> bool {
    is_mcap(path) || model::Format::of(path).is_ok_and(model::Format::holds_frames)
}

/// Returns true if a file is to be read as a recording of linkwatch: it is one, or no model by its
/// name.
#[cfg(feature = "mcap")]
pub fn is_recording(path: &Path) -> Result<bool> {
    if !path.is_file() {
        return Ok(is_mcap(path));
    }
    if !is_mcap(path) {
        let format = model::Format::of(path);
        return Ok(matches!(format, Err(Error::UnknownModel { .. })));
    }
    let mut reader = RecordingReader::open(path).map_err(|e| e.in_file(path))?;
    // The metadata is complete once the first item was read. An error is that of a recording.
    let first = reader.next_item();
    // A file without messages may be a recording that was cut off at its start.
    Ok(!matches!(first, Ok(None)) || !reader.metadata().is_empty() || reader.skipped() == 0)
}

/// Frames of a file, in the order of the file.
type FileFrames = Box<dyn Iterator<Item = Result<ModelFrame>>>;

/// Opens a model file or a recording.
fn frames_of(path: &Path, args: &FormatArgs) -> Result<FileFrames> {
    #[cfg(feature = "mcap")]
    if is_mcap(path) && is_recording(path)? {
        return Ok(Box::new(Recorded {
            reader: Some(RecordingReader::open(path).map_err(|e| e.in_file(path))?),
            path: path.to_owned(),
        }));
    }
    Ok(Box::new(Frames::open(path, &args.options())?))
}

/// Frames of a recording.
#[cfg(feature = "mcap")]
struct Recorded {
    path: PathBuf,
    /// `None` after an error.
    reader: Option<RecordingReader<std::io::BufReader<std::fs::File>>>,
}

#[cfg(feature = "mcap")]
impl Iterator for Recorded {
    type Item = Result<ModelFrame>;

    fn next(&mut self) -> Option<Result<ModelFrame>> {
        use linkwatch::RecordedItem;
        loop {
            let frame = match self.reader.as_mut()?.next_item() {
                Ok(Some(RecordedItem::Frame(frame))) => frame,
                Ok(Some(RecordedItem::Baseline(_) | RecordedItem::Verdict(_))) => continue,
                Ok(None) => {
                    let cut = match self.reader.take()?.ending() {
                        Some(Ending::Cut { at, what }) => Error::Usage(format!(
                            "the recording was cut off at byte {}, in {what}; all complete frames \
                             before that were read",
                            output::count(*at)
                        )),
                        _ => return None,
                    };
                    return Some(Err(cut.in_file(&self.path)));
                }
                Err(e) => {
                    self.reader = None;
                    return Some(Err(e.in_file(&self.path)));
                }
            };
            let mut set = None;
            let curves = frame.ingest(&mut set);
            let curves = curves.map(|()| set.expect("set by a frame without errors"));
            let mut read = ModelFrame::new(frame.seq, curves);
            read.time = frame.time;
            read.labels = frame.info.labels;
            return Some(Ok(read));
        }
    }
}

/// Frames of several files, one after the other.
pub struct Sequence {
    args: FormatArgs,
    files: std::vec::IntoIter<PathBuf>,
    /// True if frames have numbers of their own: there is one file.
    numbered: bool,
    current: Option<(PathBuf, FileFrames)>,
    /// Elements that were not read of the current file.
    left_out: Vec<LeftOut>,
    /// Number of the last frame.
    last: Option<u64>,
    /// Names and radii of the last valid frame, and the number of points of each of its curves.
    info: FrameInfo,
    counts: Vec<i32>,
}

/// A frame of a [`Sequence`].
pub struct Frame {
    /// Name of the file, with the number of the frame if the file may hold several.
    pub name: String,
    pub path: PathBuf,
    /// Number of the frame in its file; or counted from 0 if there are several files.
    pub seq: u64,
    /// Simulation time in seconds; 0 if it is unknown.
    pub time: f64,
    pub info: FrameInfo,
    /// Elements of the file that may be curves of this frame, and were not read.
    pub left_out: Vec<LeftOut>,
    /// The curves, or the reason why the frame is invalid.
    pub curves: Result<CurveSet>,
}

impl Sequence {
    /// Prepares to read files, which [`expand`] returned.
    pub fn new(files: Vec<PathBuf>, args: &FormatArgs) -> Sequence {
        Sequence {
            args: args.clone(),
            numbered: files.len() == 1,
            files: files.into_iter(),
            current: None,
            left_out: Vec::new(),
            last: None,
            info: FrameInfo::default(),
            counts: Vec::new(),
        }
    }

    /// Notes the labels of a frame. Named curves may change from frame to frame; radii alone do
    /// not: the first ones are kept.
    fn note(&mut self, curves: &CurveSet, labels: &Arc<CurveLabels>) {
        let same_counts = curves.counts().eq(self.counts.iter().copied());
        if same_counts && labels.names == self.info.labels.names {
            return;
        }
        if !self.counts.is_empty() && !labels.names.is_empty() {
            self.info.layout += 1;
        }
        self.info.labels = Arc::clone(labels);
        self.counts = curves.counts().collect();
    }

    fn next_of_file(&mut self) -> Option<Result<(PathBuf, ModelFrame)>> {
        loop {
            if let Some((path, frames)) = &mut self.current {
                match frames.next() {
                    Some(frame) => return Some(frame.map(|frame| (path.clone(), frame))),
                    None => self.current = None,
                }
            }
            let path = self.files.next()?;
            match frames_of(&path, &self.args) {
                Ok(frames) => {
                    self.current = Some((path, frames));
                    self.left_out.clear();
                }
                Err(e) => return Some(Err(e)),
            }
        }
    }
}

impl Iterator for Sequence {
    type Item = Result<Frame>;

    /// Returns the next frame. A file whose content is invalid gives an invalid frame.
    ///
    /// Errors: a file that cannot be read, or is no model. The next call goes on with the next
    /// file.
    fn next(&mut self) -> Option<Result<Frame>> {
        let (path, frame) = match self.next_of_file()? {
            Ok(read) => read,
            Err(Error::InFile { path, source }) => {
                let seq = self.last.map_or(0, |seq| seq + 1);
                (path, ModelFrame::new(seq, Err(*source)))
            }
            Err(e) => return Some(Err(e)),
        };
        let seq = match self.numbered {
            true => frame.seq,
            false => self.last.map_or(0, |seq| seq + 1),
        };
        self.last = Some(seq);
        if let Ok(curves) = &frame.curves {
            self.note(curves, &frame.labels);
        }
        // Once for each kind of a file.
        let mut new = frame.left_out.clone();
        new.retain(|found| self.left_out.iter().all(|known| known.kind != found.kind));
        LeftOut::merge(&mut self.left_out, &new);
        output::warn_of_left_out(&path, &new);
        let name = match holds_frames(&path) {
            true => format!("{}, frame {}", path.display(), frame.seq),
            false => path.display().to_string(),
        };
        Some(Ok(Frame {
            name,
            path,
            seq,
            time: frame.time,
            info: FrameInfo {
                cell: frame.cell,
                ..self.info.clone()
            },
            left_out: frame.left_out,
            curves: frame.curves,
        }))
    }
}
