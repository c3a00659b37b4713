//! Recordings on a disk that freezes.

use super::super::super::writer::{Output, RecordingSink};
use super::*;
use crate::sinks::{Overflow, SinkQueue};
use std::io::{self, Cursor, Write};
use std::sync::{Mutex, RwLock};

/// A disk that freezes at one of its calls, until the test thaws it.
#[derive(Clone)]
struct Disk {
    files: Arc<Mutex<Vec<Vec<u8>>>>,
    /// Held by the test while the disk is frozen.
    frozen: Arc<RwLock<()>>,
    /// Number of calls before the disk freezes.
    calls: Arc<Mutex<usize>>,
}

impl Disk {
    fn call(&self) {
        let mut calls = self.calls.lock().unwrap();
        match calls.checked_sub(1) {
            Some(left) => *calls = left,
            None => drop(self.frozen.read().unwrap()),
        }
    }
}

/// A file on this disk.
struct OnDisk {
    disk: Disk,
    number: usize,
}

impl Write for OnDisk {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.disk.call();
        self.disk.files.lock().unwrap()[self.number].extend(bytes);
        Ok(bytes.len())
    }
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Output for OnDisk {
    fn sync(&self) -> io::Result<()> {
        self.disk.call();
        Ok(())
    }
}

/// A disk that freezes while a file is created, written or closed delays no caller, whatever the
/// recording keeps. After it works again, every frame that was not counted as dropped is recorded.
#[test]
fn a_frozen_disk_delays_no_caller_whatever_is_kept() {
    const LONG: Duration = Duration::from_secs(60);
    let window = Retention::Window {
        span: LONG,
        memory: MEMORY,
    };
    for (retention, calls) in [
        (Retention::All, 0),
        (Retention::All, 5),
        // From the creation of the second file on, or while the first one is closed.
        (Retention::All, 14),
        (every(3), 7),
        (window, 0),
        (window, 2),
    ] {
        let frozen = Arc::new(RwLock::new(()));
        let disk = Disk {
            files: Arc::default(),
            frozen: Arc::clone(&frozen),
            calls: Arc::new(Mutex::new(calls)),
        };
        let on = disk.clone();
        let create: files::Create = Box::new(move |path, metadata| {
            on.call();
            let mut files = on.files.lock().unwrap();
            files.push(Vec::new());
            let number = files.len() - 1;
            drop(files);
            let disk = on.clone();
            RecordingSink::on(path, Box::new(OnDisk { disk, number }), metadata)
        });
        let mut options = RecordingOptions::new("run.mcap");
        options.max_bytes = Some(1_000_000);
        let queue = SinkQueue::spawn("recording", 4, Overflow::Wait(Duration::from_millis(5)), {
            move || sink(Files::created_by(options, create), retention)
        });
        let queue = queue.unwrap();
        let thaw = frozen.write().unwrap();
        let start = std::time::Instant::now();
        queue.begin(Arc::new(baseline(3000)));
        for seq in 0..40 {
            let changed = (seq == 20).then_some(1);
            queue.frame(Arc::new(frame(seq, 3000, changed)));
        }
        assert!(start.elapsed() < LONG / 2, "{retention:?}");
        drop(thaw);
        let summary = queue.finish(LONG);
        assert_eq!(summary.failed, None);
        assert_eq!(summary.written + summary.dropped, 40);
        let files = disk.files.lock().unwrap();
        let contents = files
            .iter()
            .map(|bytes| read_from(RecordingReader::new(Cursor::new(bytes)).unwrap()));
        let contents: Vec<Content> = contents.collect();
        let seqs: Vec<u64> = contents.iter().flat_map(Content::seqs).collect();
        assert!(seqs.is_sorted_by(|a, b| a < b), "{seqs:?}");
        assert_eq!(seqs.len() as u64, summary.written, "{retention:?} {calls}");
        let missing: u64 = contents.iter().map(|c| c.missing).sum();
        assert_eq!(missing, summary.dropped, "{retention:?} {calls}");
    }
}
