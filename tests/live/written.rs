//! Recordings of constructed motions, written without a simulator.

use crate::support::session::Step;
use linkwatch::scenes::{Frames, Motion, Pull, Scene, pull_throughs};
use linkwatch::{
    BaselineRecord, CurveLabels, CurveSet, Events, FrameInfo, FrameRecord, RecordingSink,
    RunProgress, Session, SessionOptions, Sink, Strategy,
};
use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

/// Time between the frames, in seconds.
pub const INTERVAL: f64 = 0.004;

/// Motion of chainmail in which a ring is pulled through another one.
pub struct Chainmail {
    pub scene: String,
    pub frames: u64,
    /// First frame of the pull.
    pub pulled: u64,
    /// Frame that ends it.
    pub released: u64,
}

impl Chainmail {
    /// Calls `with` for each frame: its number and its curves.
    pub fn each(&self, mut with: impl FnMut(u64, &CurveSet)) {
        let mut set = self.scene.parse::<Scene>().unwrap().build().unwrap().curves;
        let pulls = pull_throughs(&set);
        let pull: &Pull = &pulls[pulls.len() / 2];
        let motion: Motion = "smooth".parse().unwrap();
        let mut frames = Frames::new(&set, 0.1);
        for k in 0..self.frames {
            if k == self.pulled {
                frames.pull(pull);
            }
            if k == self.released {
                frames.release();
            }
            set.update(frames.at(&motion, 0.02, k)).unwrap();
            with(k, &set);
        }
    }

    /// Writes a recording as `watch` does, with its verdicts or without. Frames are received one
    /// millisecond apart.
    pub fn record(&self, path: &Path, events: Events, with_verdicts: bool) {
        let mut session = Session::new(SessionOptions {
            strategy: Strategy::Incremental,
            events,
            ..SessionOptions::default()
        })
        .unwrap();
        let metadata = BTreeMap::from([("events".to_owned(), events.to_string())]);
        let mut sink = Box::new(RecordingSink::create(path, &metadata).unwrap());
        let received = SystemTime::now();
        let mut labels = None;
        self.each(|seq, set| {
            let names = (0..set.len()).map(|i| format!("ring/{i}"));
            let labels = labels.get_or_insert_with(|| Arc::new(CurveLabels::named(names)));
            let time = seq as f64 * INTERVAL;
            let info = FrameInfo {
                time_step: INTERVAL,
                ..FrameInfo::at(seq, time).with_labels(0, Arc::clone(labels))
            };
            let verified = session.step_at(info, set);
            if seq == 0 {
                sink.begin(&BaselineRecord {
                    certificate: Arc::new(session.baseline().unwrap().clone()),
                    origin: "first frame".into(),
                    frame: Some(0),
                    unverified: 0,
                })
                .unwrap();
            }
            sink.frame(&FrameRecord {
                curves: verified.curves,
                info: verified.info,
                report: Arc::new(verified.report),
                progress: RunProgress {
                    verified: seq + 1,
                    work: verified.work,
                    ..RunProgress::default()
                }
                .received(received + Duration::from_millis(seq)),
            })
            .unwrap();
        });
        sink.finish().unwrap();
        if !with_verdicts {
            drop_verdicts(path);
        }
    }
}

/// Rewrites a recording without its verdicts, as a program that knows only frames does.
pub fn drop_verdicts(path: &Path) {
    let bytes = std::fs::read(path).unwrap();
    let mut writer = mcap::Writer::new(Cursor::new(Vec::new())).unwrap();
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        if message.channel.topic != "/linkwatch/verdicts" {
            writer.write(&message).unwrap();
        }
    }
    writer.finish().unwrap();
    std::fs::write(path, writer.into_inner().into_inner()).unwrap();
}
