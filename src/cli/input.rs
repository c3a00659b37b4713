//! Curves of arguments: model files, folders and patterns of them, recordings, generated scenes.

use super::cell_args::CellArgs;
use super::order;
use super::recorded::Recorded;
use linkwatch::formats::{Format, Frames, ModelFrame, ReadOptions, without_compression};
use linkwatch::scenes::Scene;
use linkwatch::{CurveSet, Error, LeftOut, RecordingReader, Result, formats};
use std::fs::DirEntry;
use std::path::{Path, PathBuf};

/// Information on curves that some formats lack.
#[derive(Clone, Debug, Default, clap::Args)]
#[command(next_help_heading = super::INPUT)]
pub struct FormatArgs {
    /// LAMMPS data file with the bonds of a dump
    #[arg(long, value_name = "FILE", hide_short_help = true)]
    bonds: Option<PathBuf>,
    /// Number of points of each curve of a .npy or text file, below 0 if the curve is closed
    #[arg(
        long,
        value_name = "N,..",
        value_delimiter = ',',
        allow_hyphen_values = true,
        hide_short_help = true
    )]
    counts: Option<Vec<i32>>,
    /// All curves of a text file, or of a LAMMPS dump without bonds, are closed (=false: open)
    #[arg(
        long,
        value_name = "true|false",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "true",
        hide_short_help = true
    )]
    closed: Option<bool>,
    /// Topic to read of an MCAP file of another program, if several have curves
    #[arg(long, value_name = "TOPIC", hide_short_help = true)]
    topic: Option<String>,
    /// Atoms of molecules to read, in the language of MDAnalysis: 'name CA'
    #[arg(long, value_name = "ATOMS", hide_short_help = true)]
    select: Option<String>,
    /// Format of the files, if their names do not tell it: a name of `linkwatch.io.FORMATS`
    #[arg(long, value_name = "NAME", hide_short_help = true)]
    pub format: Option<String>,
}

impl FormatArgs {
    /// Returns the files with the bonds of these models.
    pub fn bonds(&self, models: &[PathBuf]) -> impl Iterator<Item = PathBuf> {
        let options = ReadOptions {
            bonds: self.bonds.clone(),
            ..ReadOptions::default()
        };
        let models = models.iter().map(|model| without_compression(model));
        models.filter_map(move |model| options.bonds_of(&model))
    }

    /// Returns the options of a reader.
    pub fn options(&self, cells: &CellArgs) -> ReadOptions {
        ReadOptions {
            bonds: self.bonds.clone(),
            counts: self.counts.clone(),
            closed: self.closed,
            topic: self.topic.clone(),
            wrapped: cells.wrapped,
            cell: cells.given(),
            keep_open: cells.keep_open,
            keep_order: false,
            one_motion: true,
            select: self.select.clone(),
            format: self.format.clone(),
        }
    }
}

/// Divides files into those that are read together, such as a topology and its trajectories.
/// `format` is the option of this name.
pub fn groups(files: &[PathBuf], format: Option<&str>) -> Result<Vec<Vec<PathBuf>>> {
    let sizes = match formats::reader() {
        Some(reader) if format.is_some() || !files.iter().all(|file| Format::is_certain(file)) => {
            reader.groups(files, format)?
        }
        _ => vec![1; files.len()],
    };
    let mut files = files.iter().cloned();
    let sizes = sizes.into_iter();
    Ok(sizes.map(|n| files.by_ref().take(n).collect()).collect())
}

/// Warns of elements of a file that were not read, once for each kind. `known` has the kinds that
/// the user knows already.
pub fn warn_of_new(file: &Path, known: &mut Vec<LeftOut>, found: &[LeftOut]) {
    let mut new = found.to_vec();
    new.retain(|found| known.iter().all(|known| known.kind != found.kind));
    LeftOut::merge(known, &new);
    if !new.is_empty() {
        tracing::warn!("{}: {}", file.display(), LeftOut::sentence(&new));
    }
}

/// Builds the scene that an argument describes.
fn scene(argument: &Path) -> Result<CurveSet> {
    let scene = argument.to_string_lossy().parse::<Scene>();
    let scene = scene.map_err(|e| match e {
        Error::Scene { scene, what } => {
            let known = formats::MODEL_FILES;
            let what = format!("{what}; and no file has this name (kinds of files: {known})");
            Error::Scene { scene, what }
        }
        other => other,
    })?;
    Ok(scene.build()?.curves)
}

/// Replaces folders by the models in them, and patterns (`frames/*.bcc`, for shells that do not
/// expand them) by the files that match. Unless the order is to be kept, files whose names differ
/// in numbers only are sorted by these numbers, with a warning if that is not clear.
pub fn expand(arguments: &[PathBuf], keep_order: bool) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for argument in arguments {
        if argument.is_dir() {
            let models = models_in(argument)?;
            check_one_format(argument, &models)?;
            files.extend(models);
        } else {
            files.extend(listed(argument)?);
        }
    }
    let is_sorted = !keep_order && order::sort(&mut files);
    if is_sorted || !keep_order && order::is_unclear(&files) {
        let shown = files.iter().map(|file| file.display().to_string());
        let shown: Vec<String> = shown.collect();
        let shown = match &shown[..] {
            [first, second, third, .., last] => format!("{first}, {second}, {third} .. {last}"),
            all => all.join(", "),
        };
        match is_sorted {
            true => tracing::warn!(
                "models are sorted by the numbers in their names: {shown} (--keep-order keeps the \
                 given order)"
            ),
            false => tracing::warn!(
                "digits after a point in the names of models are decimals: {shown} (if they are \
                 not, give the files in their order, with --keep-order)"
            ),
        }
    }
    Ok(files)
}

/// Same as [`expand`] for models that are no frames of one motion: they keep their order, and a
/// folder may hold several formats.
pub fn expand_models(arguments: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let files = arguments.iter().map(|argument| match argument.is_dir() {
        true => models_in(argument),
        false => listed(argument),
    });
    Ok(files.collect::<Result<Vec<_>>>()?.concat())
}

/// Extensions of files with curves that only the Python package reads, and that hold nothing else.
const OF_PACKAGE: [&str; 24] = [
    "dcd", "gsd", "h5md", "hair", "ncdf", "pdb", "poly", "pvd", "pvtp", "pvtu", "tg3", "tng",
    "trr", "trz", "usd", "usda", "usdc", "usdz", "vtk", "vtm", "vtp", "vtu", "xdmf", "xtc",
];

/// Returns true if a file has one of these extensions.
pub fn has_extension(file: &Path, extensions: &[&str]) -> bool {
    let extension = file.extension().unwrap_or_default();
    extensions.iter().any(|e| extension.eq_ignore_ascii_case(e))
}

fn models_in(folder: &Path) -> Result<Vec<PathBuf>> {
    let refuse = |why: String| usage!("{}: {why}", folder.display());
    let entries = std::fs::read_dir(folder).map_err(|e| refuse(e.to_string()))?;
    // MDAnalysis writes hidden archives beside trajectories.
    let is_hidden = |entry: &DirEntry| entry.file_name().as_encoded_bytes().starts_with(b".");
    let entries = entries.flatten().filter(|entry| !is_hidden(entry));
    let is_plain = |file: &PathBuf| without_compression(file) == *file;
    let (files, packed): (Vec<_>, Vec<_>) = entries.map(|entry| entry.path()).partition(is_plain);
    let is_model = |file: &PathBuf| match Format::of(file) {
        // A folder may have tables of numbers, which are no points.
        Ok(Format::Points) => false,
        Ok(Format::External) => has_extension(file, &OF_PACKAGE),
        Ok(_) => file.is_file(),
        // USD, which is refused when it is opened.
        Err(e) => matches!(e, Error::InFile { .. }),
    };
    let (mut models, mut others): (Vec<_>, Vec<_>) = files.into_iter().partition(is_model);
    if models.is_empty() {
        let is_external = |file: &mut PathBuf| matches!(Format::of(file), Ok(Format::External));
        models.extend(others.extract_if(.., is_external));
    }
    others.extend(packed);
    models.sort();
    let format = models.first().map(|model| Format::of(model));
    if let Some(file) = others.iter().find(|file| is_compressed(file, &format)) {
        let advice = "is compressed: decompress it, or give a pattern or the files";
        return Err(refuse(format!("{} {advice}", file.display())));
    }
    if let Some(file) = others.iter().find(|file| has_extension(file, &OF_PACKAGE)) {
        let advice = "is read by the Python package alone: give a pattern, or the files";
        return Err(refuse(format!("{} {advice}", file.display())));
    }
    if models.is_empty() {
        let known = formats::MODEL_FILES;
        return Err(refuse(format!("the folder holds no models ({known})")));
    }
    order::sort(&mut models);
    Ok(models)
}

/// Returns true if a file is a compressed model, of the same format as the others if there are any.
fn is_compressed(file: &Path, others: &Option<Result<Format>>) -> bool {
    const SUFFIXES: [&str; 7] = ["gz", "xz", "bz2", "zst", "lz4", "zip", "z"];
    let plain = file.with_extension("");
    let fits = |format| match others {
        Some(Ok(other)) => format == *other,
        _ => true,
    };
    let is_model = || has_extension(&plain, &OF_PACKAGE) || Format::of(&plain).is_ok_and(fits);
    has_extension(file, &SUFFIXES) && !plain.exists() && is_model()
}

/// Checks that the models of a folder may be frames of one motion.
fn check_one_format(folder: &Path, models: &[PathBuf]) -> Result<()> {
    let extension = |file: &Path| file.extension().unwrap_or_default().to_ascii_lowercase();
    let mut pairs = models.array_windows::<2>();
    match pairs.find(|[a, b]| extension(a) != extension(b)) {
        None => Ok(()),
        Some([a, b]) => {
            let [folder, a, b] = [folder, a, b].map(Path::display);
            let what = format!("models of several formats ({a}, {b})");
            Err(usage!("{folder}: {what}: give a pattern, or the files"))
        }
    }
}

/// Returns the files that a pattern matches, or the argument.
fn listed(argument: &Path) -> Result<Vec<PathBuf>> {
    match !argument.exists() && argument.to_string_lossy().contains(['*', '?', '[']) {
        true => matches(argument),
        false => Ok(vec![argument.into()]),
    }
}

fn matches(pattern: &Path) -> Result<Vec<PathBuf>> {
    let text = pattern.to_string_lossy();
    let found = glob::glob(&text).map_err(|e| usage!("{text}: {e}"))?;
    let mut files: Vec<PathBuf> = found.flatten().filter(|file| file.is_file()).collect();
    if files.is_empty() {
        return Err(usage!("{text}: no file has such a name"));
    }
    order::sort(&mut files);
    Ok(files)
}

/// Returns true if the file is a recording, or an MCAP file of another program.
pub fn is_mcap(path: &Path) -> bool {
    let is_unpacked = formats::reader().is_some();
    has_extension(path, &["mcap"])
        || is_unpacked && has_extension(&without_compression(path), &["mcap"])
}

/// Returns true if a file begins as an MCAP file, whatever its name.
fn begins_as_mcap(path: &Path) -> bool {
    use std::io::Read;
    let mut start = [0; 8];
    let read = std::fs::File::open(path).and_then(|mut file| file.read_exact(&mut start));
    read.is_ok() && start == *b"\x89MCAP0\r\n"
}

/// Returns true if a file of this name may hold several frames.
pub fn holds_frames(path: &Path) -> bool {
    is_mcap(path) || Format::of(path).is_ok_and(Format::holds_frames)
}

/// Returns true if the name of a frame of these files has its number. `has_several` is true if they
/// may have several frames, which the names of other formats do not tell.
pub fn are_numbered(files: &[PathBuf], options: &ReadOptions, has_several: bool) -> bool {
    let is_numbered = |file: &PathBuf| match Format::of(file) {
        Ok(Format::External) => has_several,
        Ok(format) => format.holds_frames(),
        Err(_) => is_mcap(file),
    };
    files.len() > 1 || options.format.is_some() || files.iter().any(is_numbered)
}

/// Returns true if a file is to be read as a recording of linkwatch: it is one by its content, or
/// does not exist and has its extension.
pub fn is_recording(path: &Path) -> Result<bool> {
    if !path.is_file() {
        return Ok(is_mcap(path));
    }
    formats::unpacked(path, |path| {
        if !is_mcap(path) && !begins_as_mcap(path) {
            return Ok(false);
        }
        let mut reader = RecordingReader::open(path).map_err(|e| e.in_file(path))?;
        // The metadata is complete once the first item was read. An error is that of a recording.
        let first = reader.next_item();
        // A file without messages may be a recording that was cut off at its start.
        Ok(!matches!(first, Ok(None)) || !reader.metadata().is_empty() || reader.skipped() == 0)
    })
}

/// Fails if a file is no recording of linkwatch.
pub fn check_recording(path: &Path) -> Result<()> {
    if !path.is_file() || is_recording(path)? {
        return Ok(());
    }
    let path = path.display();
    Err(usage!(
        "{path}: not a recording: `linkwatch check {path} --record RUN.mcap` verifies its frames \
         and writes one"
    ))
}

/// Frames of a file, in the order of the file.
pub enum FileFrames {
    Model(Frames),
    Recording(Box<Recorded>),
    /// A generated scene, or what is left of it.
    Scene(Option<Box<ModelFrame>>),
}

impl FileFrames {
    /// Returns the name of the file in which a recorded run continues, once all frames were read.
    pub fn continues_in(&self) -> Option<&str> {
        match self {
            FileFrames::Recording(recorded) => recorded.continues_in.as_deref(),
            _ => None,
        }
    }
}

impl Iterator for FileFrames {
    type Item = Result<ModelFrame>;

    fn next(&mut self) -> Option<Result<ModelFrame>> {
        match self {
            FileFrames::Model(frames) => frames.next(),
            FileFrames::Recording(recorded) => recorded.next(),
            FileFrames::Scene(frame) => frame.take().map(|frame| Ok(*frame)),
        }
    }
}

/// Opens a model file, a recording, or files that are read together.
pub fn open(files: &[PathBuf], options: &ReadOptions) -> Result<FileFrames> {
    let [path] = files else {
        return Ok(FileFrames::Model(Frames::open_together(files, options)?));
    };
    if options.format.is_none() && is_mcap(path) && is_recording(path)? {
        return Ok(FileFrames::Recording(Box::new(Recorded::open(path)?)));
    }
    Ok(FileFrames::Model(Frames::open(path, options)?))
}

/// Same as [`open`]; an argument that is no file is a scene of one frame.
pub fn open_or_build(files: &[PathBuf], options: &ReadOptions) -> Result<FileFrames> {
    match open(files, options) {
        Err(Error::UnknownModel { path }) if !path.exists() => {
            let frame = ModelFrame::new(0, Ok(scene(&path)?));
            Ok(FileFrames::Scene(Some(Box::new(frame))))
        }
        frames => frames,
    }
}
