//! Frames of files for the Python package.

use super::input;
use super::motion::{Motion, cut_at_gaps};
use super::sequence::Frame;
use linkwatch::formats::ReadOptions;
use linkwatch::{LeftOut, Result};
use std::io::{self, Write};
use std::path::PathBuf;
use std::sync::mpsc::{self, Receiver, Sender};
use tracing::{Dispatch, Level, dispatcher};
use tracing_subscriber::filter::Targets;
use tracing_subscriber::layer::SubscriberExt;

/// Frames of files as `linkwatch convert` reads them. What the command logs goes to the caller.
pub struct FileReader {
    motion: Motion,
    gaps: Vec<LeftOut>,
    /// Elements that were not read so far.
    pub left_out: Vec<LeftOut>,
    messages: Receiver<String>,
    log: Dispatch,
}

/// Writer of log messages, each in one piece.
struct Messages(Sender<String>);

impl Write for Messages {
    fn write(&mut self, message: &[u8]) -> io::Result<usize> {
        let text = String::from_utf8_lossy(message).trim().to_owned();
        // After the reader is gone, nobody wants them.
        self.0.send(text).ok();
        Ok(message.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl FileReader {
    /// Opens files that are the frames of one motion.
    ///
    /// # Errors
    ///
    /// A pattern matches no file, or a folder is not one of models. Errors of the content are those
    /// of frames.
    pub fn open(files: &[PathBuf], options: ReadOptions) -> Result<FileReader> {
        let (to, messages) = mpsc::channel();
        let lines = tracing_subscriber::fmt::layer()
            .with_writer(move || Messages(to.clone()))
            .with_ansi(false)
            .without_time()
            .with_level(false)
            .with_target(false);
        let levels = Targets::new().with_target("linkwatch", Level::INFO);
        let log = Dispatch::new(tracing_subscriber::registry().with(levels).with(lines));
        let motion = dispatcher::with_default(&log, || {
            Motion::new(&input::expand(files, options.keep_order)?, options)
        })?;
        let (gaps, left_out) = (Vec::new(), Vec::new());
        Ok(FileReader {
            motion,
            gaps,
            left_out,
            messages,
            log,
        })
    }

    /// Returns the messages since the last call.
    pub fn take_messages(&self) -> impl Iterator<Item = String> {
        self.messages.try_iter()
    }

    /// Returns the number of the file among those of a recorded run.
    pub fn part(&self) -> Option<u32> {
        self.motion.part
    }

    /// Returns true if frames after the last one are not in the recording. Call this at the end.
    pub fn ends_in_gap(&self) -> bool {
        self.motion.sequence.ends_in_gap()
    }

    /// Returns true if the recorded run continues in another file. Call this at the end.
    pub fn is_unfinished(&self) -> bool {
        dispatcher::with_default(&self.log, || self.motion.sequence.warn_of_unfinished())
    }
}

impl Iterator for FileReader {
    type Item = Result<Frame>;

    fn next(&mut self) -> Option<Result<Frame>> {
        let next = dispatcher::with_default(&self.log, || self.motion.next())?;
        Some(next.map(|mut frame| {
            cut_at_gaps(&mut frame, &mut self.gaps);
            if frame.curves.is_ok() {
                LeftOut::merge(&mut self.left_out, &frame.info.left_out);
            }
            frame
        }))
    }
}
