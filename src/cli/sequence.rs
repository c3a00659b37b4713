//! Frames of several files in sequence: of one motion, or of several runs.

use super::input::{self, FileFrames};
use super::recorded::{self, Part, Recorded};
use linkwatch::formats::{Format, ModelFrame, ReadOptions, name_of};
use linkwatch::{CurveSet, Error, FrameInfo, LeftOut, Received, Result};
use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::Arc;

/// Frames of several files, one after the other.
///
/// Files of one frame each are the frames of one motion. Files of several frames each are runs of
/// their own: each begins a run, unless all files are one motion, or it is the next file of a
/// recording. (A file of one frame continues the files before it. The first file of several frames
/// continues those of one frame before it.)
#[derive(Default)]
pub struct Sequence {
    options: ReadOptions,
    /// Files that are read together.
    files: VecDeque<Vec<PathBuf>>,
    /// True if there is one file (or one group), whose frames keep their numbers.
    single: bool,
    /// True if all files are one motion.
    one_motion: bool,
    /// True if a file so far had several frames.
    had_several: bool,
    current: Option<File>,
    /// The last file, if it is a recording that was read to its end.
    last: Option<LastFile>,
    /// For each run before the last one whose last files are missing, a text that says so.
    unfinished: Vec<String>,
    /// Elements that were not read of the current file.
    left_out: Vec<LeftOut>,
    /// Number of the next frame, if the file gives it none.
    next_seq: u64,
    /// Information about the last valid frame, and the number of points of each of its curves.
    info: FrameInfo,
    counts: Vec<i32>,
    /// Number of cuts of that frame in its file; the maximum if the next frame begins a run.
    cuts_in_file: Option<u32>,
}

/// A file that is being read.
struct File {
    path: PathBuf,
    /// True if the name of a frame has its number.
    is_numbered: bool,
    /// Its place in a recorded run.
    part: Option<Part>,
    /// Frames that were read ahead.
    ahead: VecDeque<Result<ModelFrame>>,
    frames: FileFrames,
    /// True until its first frame was taken, if that begins a run.
    begins_run: bool,
    /// True until its first valid frame was taken, if frames before it are missing.
    after_gap: bool,
    /// Likewise, if whole files are: what is missing, in the singular and in the plural.
    lacks_files: Option<[&'static str; 2]>,
    /// Number of cuts and layout number of its last valid frame.
    last_seen: Option<(u32, u32)>,
}

/// A recording that was read.
struct LastFile {
    path: PathBuf,
    part: Part,
    recorded: Box<Recorded>,
}

impl LastFile {
    fn ends_in_gap(&self) -> bool {
        self.part.has_window || self.recorded.after_gap
    }

    /// Returns a text that says in which other file the run continues, if it does.
    fn unfinished(&self) -> Option<String> {
        let (path, next) = (self.path.display(), self.recorded.continues_in.as_ref()?);
        Some(format!(
            "{path}: the run continues in {next}, which was not given"
        ))
    }
}

/// A frame of a [`Sequence`].
pub struct Frame {
    /// Name of the file, with the number of the frame if the file may hold several.
    pub name: String,
    pub path: PathBuf,
    /// Its number is that in the file; or counted from 0 if there are several files.
    pub info: FrameInfo,
    /// True if the frame does not belong to the motion of the frames before it.
    pub begins_run: bool,
    /// True if frames before it are not in the file.
    pub after_gap: bool,
    /// The curves, or the reason why the frame is invalid.
    pub curves: Result<CurveSet>,
}

impl Frame {
    /// Returns the frame, to be verified.
    pub fn received(self) -> Received {
        Received::new(self.info, self.curves.map(Arc::new))
    }
}

impl Sequence {
    /// Prepares to read files, which [`input::expand`] returned.
    pub fn new(files: &[PathBuf], options: ReadOptions) -> Result<Sequence> {
        let files = input::groups(files, options.format.as_deref())?;
        Ok(Sequence {
            single: files.len() == 1,
            one_motion: options.one_motion,
            options,
            files: files.into(),
            ..Sequence::default()
        })
    }

    /// Returns true if frames after the last one are not in its file.
    pub fn ends_in_gap(&self) -> bool {
        self.last.as_ref().is_some_and(LastFile::ends_in_gap)
    }

    /// Warns of the runs whose last files are missing, once all frames were read. Returns true if
    /// there are any.
    pub fn warn_of_unfinished(&self) -> bool {
        let last = self.last.as_ref().and_then(LastFile::unfinished);
        let all = self.unfinished.iter().chain(&last);
        all.inspect(|what| tracing::warn!("{what}")).count() > 0
    }

    /// Opens the next file. Its first two frames show if it has several.
    fn open(&mut self, files: &[PathBuf]) -> Result<File> {
        let mut frames = input::open(files, &self.options)?;
        let path = name_of(files);
        let part = input::is_mcap(&path).then(|| recorded::part(&path));
        let ends_in_gap = self.ends_in_gap();
        let (part, last) = (part.flatten(), self.last.take());
        let number = part.as_ref().map_or(1, |part| part.number);
        let of_run = |last: &&LastFile| {
            let same_run = |part: &Part| part.run == last.part.run;
            number > 1 && (self.one_motion || part.as_ref().is_some_and(same_run))
        };
        let before = last.as_ref().filter(of_run);
        let is_next = before.is_some_and(|last| number == last.part.number + 1);
        let lacks_files = match before {
            Some(_) if !is_next => {
                Some(["gap between files of a run", "gaps between files of a run"])
            }
            None if number > 1 => Some([
                "run without its first file",
                "runs without their first file",
            ]),
            _ => None,
        };
        // Frames between two files may have been skipped, or dropped.
        let after_gap = ends_in_gap || before.is_some() && !is_next;
        match (before, &mut frames) {
            (Some(last), FileFrames::Recording(recorded)) if is_next => {
                recorded.missing = last.recorded.missing;
            }
            (None, _) => {
                let unfinished = last.as_ref().and_then(LastFile::unfinished);
                self.unfinished.extend(unfinished);
            }
            _ => {}
        }
        let most_ahead = if self.single { 0 } else { 2 };
        let ahead: VecDeque<_> = frames.by_ref().take(most_ahead).collect();
        let has_several = ahead.len() > 1;
        let may_have_several = has_several || self.single;
        let is_numbered = input::are_numbered(files, &self.options, may_have_several);
        let begins_run = has_several && self.had_several && !self.one_motion && !is_next;
        self.had_several |= has_several;
        Ok(File {
            path,
            is_numbered,
            part,
            ahead,
            frames,
            begins_run,
            after_gap,
            lacks_files,
            last_seen: None,
        })
    }

    /// Returns true if the next frame begins a run, and the frame with its file.
    fn read(&mut self) -> Option<(bool, Result<(PathBuf, ModelFrame)>)> {
        loop {
            if let Some(file) = &mut self.current {
                let begins_run = std::mem::take(&mut file.begins_run);
                if let Some(frame) = file.ahead.pop_front().or_else(|| file.frames.next()) {
                    let with_path = |frame| (file.path.clone(), frame);
                    return Some((begins_run, frame.map(with_path)));
                }
            }
            if let Some(File {
                path,
                part: Some(part),
                frames: FileFrames::Recording(recorded),
                ..
            }) = self.current.take()
            {
                self.last = Some(LastFile {
                    path,
                    part,
                    recorded,
                });
            }
            let files = self.files.pop_front()?;
            match self.open(&files) {
                Ok(file) => {
                    self.current = Some(file);
                    self.left_out.clear();
                }
                Err(Error::UnknownModel { path }) => {
                    let e = match std::fs::metadata(&path) {
                        Err(source) => Error::File { path, source },
                        Ok(_) => Error::UnknownModel {
                            path: self.with_unknown(path),
                        },
                    };
                    return Some((false, Err(e)));
                }
                Err(e) => return Some((false, Err(e))),
            }
        }
    }

    /// Returns a path with the next ones behind it that are of an unknown kind as well: a topology
    /// and its trajectories are converted together.
    fn with_unknown(&mut self, path: PathBuf) -> PathBuf {
        let mut all = path.into_os_string();
        let is_unknown = |files: &mut Vec<PathBuf>| {
            matches!(Format::of(&files[0]), Err(Error::UnknownModel { .. }))
        };
        for next in std::iter::from_fn(|| self.files.pop_front_if(is_unknown)).flatten() {
            all.push(" ");
            all.push(next);
        }
        all.into()
    }

    /// Notes what is known about a valid frame. Named curves, and their radii, may change from
    /// frame to frame. The first radii of others are kept, unless the simulator described its
    /// curves again.
    fn note(&mut self, curves: &CurveSet, info: &FrameInfo) {
        let now = (info.cuts, info.layout);
        let last_seen = self.current.as_mut().and_then(|f| f.last_seen.replace(now));
        let is_earlier = |cuts: u32| cuts < info.cuts;
        let (cut, described) = match last_seen {
            Some((cuts, layout)) => (cuts != info.cuts, layout != info.layout),
            // A file either counts on from the one before it, or from 0.
            None => (self.cuts_in_file.is_some_and(is_earlier), false),
        };
        self.info.cuts = match self.cuts_in_file.replace(info.cuts) {
            None => info.cuts,
            Some(_) => self.info.cuts.wrapping_add(u32::from(cut)),
        };
        self.info.time_step = info.time_step;
        let same_counts = curves.counts().eq(self.counts.iter().copied());
        let (labels, known) = (&info.labels, &self.info.labels);
        let same_radii = labels.names.is_empty() || labels.radii == known.radii;
        if !described && same_counts && same_radii && labels.names == known.names {
            return;
        }
        if described || !self.counts.is_empty() && !info.labels.names.is_empty() {
            self.info.layout = self.info.layout.wrapping_add(1);
        }
        self.info.labels = Arc::clone(&info.labels);
        self.counts = curves.counts().collect();
    }
}

impl Iterator for Sequence {
    type Item = Result<Frame>;

    /// Returns the next frame. A file whose content is invalid gives an invalid frame.
    ///
    /// # Errors
    ///
    /// A file that cannot be read, or is not a model. The next call continues with the next file.
    fn next(&mut self) -> Option<Result<Frame>> {
        let (begins_run, read) = self.read()?;
        let (path, mut frame) = match read {
            Ok(read) => read,
            Err(Error::InFile { path, source }) => {
                (path, ModelFrame::new(self.next_seq, Err(*source)))
            }
            Err(e) => return Some(Err(e)),
        };
        let seq = match self.single {
            true => frame.info.seq,
            false => self.next_seq,
        };
        self.next_seq = seq.wrapping_add(1);
        if begins_run {
            // Its curves have nothing to do with those before.
            self.info.layout = self.info.layout.wrapping_add(1);
            self.info.labels = Arc::default();
            self.counts.clear();
            self.cuts_in_file = self.cuts_in_file.map(|_| u32::MAX);
        }
        if let Ok(curves) = &frame.curves {
            self.note(curves, &frame.info);
            if let Some(file) = &mut self.current {
                frame.after_gap |= std::mem::take(&mut file.after_gap);
                if let Some(kind) = file.lacks_files.take() {
                    let gap = LeftOut::new(1, kind, path.display().to_string());
                    LeftOut::merge(&mut frame.info.left_out, &[gap]);
                }
            }
        }
        input::warn_of_new(&path, &mut self.left_out, &frame.info.left_out);
        let is_numbered = match &self.current {
            Some(file) => file.is_numbered,
            None => input::holds_frames(&path),
        };
        let name = match is_numbered {
            true => format!("{}, frame {}", path.display(), frame.info.seq),
            false => path.display().to_string(),
        };
        Some(Ok(Frame {
            name,
            path,
            info: FrameInfo {
                seq,
                time: frame.info.time,
                cell: frame.info.cell,
                closed_by_default: frame.info.closed_by_default,
                left_out: frame.info.left_out,
                ..self.info.clone()
            },
            begins_run,
            after_gap: frame.after_gap,
            curves: frame.curves,
        }))
    }
}
