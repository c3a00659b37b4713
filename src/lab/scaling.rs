//! Time and memory of a moving scene in growing sizes. Its frames are on disk, one is read at a
//! time.
//!
//! Each size has three stages, each with its own peak memory of this process: the frames are
//! generated and written; the first one is read and certified; all frames are read and compared
//! with the first one. The certificate is compared with the one that follows from the construction.
//!
//! Limits: peak memory is measured on Linux only. Memory that the allocator kept from an earlier
//! stage counts, so small sizes after large ones would look larger; measure them in growing order.

use super::clock::{peak_mb, reset_peak, timed};
use super::statistics::median;
use crate::certificate::Certificate;
use crate::curve::CurveSet;
use crate::engine::{Certifier, SessionOptions, Strategy};
use crate::error::{Error, Result};
use crate::incremental::Events;
use crate::ingest::FrameInfo;
use crate::model::{self, Format, FrameWriter, ModelFrame, ReadOptions};
use crate::scenes::{MovingScene, Scene};
use crate::session::{Received, Session};
use crate::verdict::{Report, Verdict};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Settings of all sizes.
#[derive(Clone, Debug)]
pub struct ScalingStudy {
    /// Motion and number of the frames. With one frame, only the certificate is measured.
    pub moving: MovingScene,
    /// Search for pull-throughs.
    pub events: Events,
    /// Folder of the frames. The file of a size is removed after its measurement.
    pub folder: PathBuf,
}

/// Time and memory of a stage.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct StageCost {
    /// Wall-clock time, in seconds.
    pub s: f64,
    /// CPU time of all threads, in seconds.
    pub cpu_s: f64,
    /// Peak memory of the process during the stage, in MB, if the system reports it.
    pub peak_mb: Option<f64>,
}

/// Cost of the verification of all frames.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct FramesCost {
    /// Time of the first frame, in milliseconds, without reading it.
    pub first_ms: f64,
    /// Median time of the later frames, in milliseconds, without reading them.
    pub later_ms: f64,
    /// CPU time of the first frame, and the median of the later ones, in milliseconds: of all
    /// threads, with what is computed in the background.
    pub cpu_ms: [f64; 2],
    /// Cost of all frames, with reading.
    #[serde(flatten)]
    pub all: StageCost,
}

/// Measurement of one size.
#[derive(Clone, Debug, Serialize)]
pub struct ScalingRow {
    /// Description of the scene.
    pub scene: String,
    /// Number of curves.
    pub curves: usize,
    /// Number of segments of a frame.
    pub segments: usize,
    /// Number of linked pairs.
    pub links: usize,
    /// Size of the positions of a frame, in MB.
    pub frame_mb: f64,
    /// Generation and writing of all frames.
    pub generate: StageCost,
    /// Reading and certification of the first frame.
    pub certify: StageCost,
    /// Part of the time of `certify` without reading, in milliseconds.
    pub certificate_ms: f64,
    /// CPU time of that part, in milliseconds.
    pub certificate_cpu_ms: f64,
    /// Verification of all frames, if there are several frames.
    pub check: Option<FramesCost>,
    /// Number of frames with changed topology.
    pub changed: usize,
    /// True if the certificate and the verdicts are those that follow from the construction.
    pub as_constructed: bool,
}

/// File that is removed when it is dropped.
struct Scratch(PathBuf);

impl Drop for Scratch {
    fn drop(&mut self) {
        // A file that could not be created need not be removed.
        std::fs::remove_file(&self.0).ok();
    }
}

/// Runs a stage.
fn stage<T>(work: impl FnOnce() -> Result<T>) -> Result<(T, StageCost)> {
    let measurable = reset_peak();
    let (found, elapsed) = timed(work);
    let cost = StageCost {
        s: elapsed.wall_ms * 1e-3,
        cpu_s: elapsed.cpu_ms * 1e-3,
        peak_mb: peak_mb().filter(|_| measurable),
    };
    Ok((found?, cost))
}

impl ScalingStudy {
    /// Measures one size of a scene.
    ///
    /// Errors: those of the scene, of the file, and of the session.
    pub fn measure(&self, scene: &Scene) -> Result<ScalingRow> {
        let name = format!("linkwatch-sizes-{}.npz", std::process::id());
        let file = Scratch(self.folder.join(name));
        let ((certificate, sizes), generate) = stage(|| self.generate(scene, &file.0))?;
        let [curves, segments, points] = sizes;
        let ((found, certifying), certify) = stage(|| {
            let set = model::read(&file.0)?;
            let mut certifier = Certifier::default();
            let (found, elapsed) = timed(|| certifier.certify(&set).0.clone());
            Ok((found, elapsed))
        })?;
        let mut row = ScalingRow {
            scene: scene.to_string(),
            curves,
            segments,
            links: found.links.len(),
            // Generated scenes are in single precision.
            frame_mb: 12e-6 * points as f64,
            generate,
            certify,
            certificate_ms: certifying.wall_ms,
            certificate_cpu_ms: certifying.cpu_ms,
            check: None,
            changed: 0,
            as_constructed: found == certificate,
        };
        drop(found);
        if self.moving.frames > 1 {
            self.check(&file.0, &certificate, &mut row)?;
        }
        Ok(row)
    }

    /// Writes the frames. Returns the certificate of the construction, and the numbers of curves,
    /// segments and points.
    fn generate(&self, scene: &Scene, path: &Path) -> Result<(Certificate, [usize; 3])> {
        let built = scene.build()?;
        let curves = &built.curves;
        let sizes = [curves.len(), curves.segments(), curves.points()];
        let mut writer = FrameWriter::create(path, Format::Npz)?;
        self.moving.play(built.curves, |seq, curves| {
            let frame = ModelFrame::new(seq, Ok(curves));
            writer.frame(&frame)?;
            frame.curves
        })?;
        writer.finish()?;
        Ok((built.certificate, sizes))
    }

    /// Verifies all frames.
    fn check(&self, path: &Path, certificate: &Certificate, row: &mut ScalingRow) -> Result<()> {
        let mut reports = Vec::new();
        let (baseline, cost) = self.verify(path, |report| reports.push(report))?;
        row.check = Some(cost);
        row.changed = reports
            .iter()
            .filter(|r| r.verdict == Verdict::Changed)
            .count();
        let pull = self.moving.pull.unwrap_or(u64::MAX);
        let expected = |r: &Report| match r.seq < pull {
            true => r.verdict == Verdict::Intact,
            false => r.verdict == Verdict::Changed,
        };
        row.as_constructed &= baseline.as_ref() == Some(certificate);
        row.as_constructed &= reports.iter().all(expected);
        Ok(())
    }

    /// Reads and verifies all frames. Returns the expected linking numbers.
    fn verify(
        &self,
        path: &Path,
        mut take: impl FnMut(Report),
    ) -> Result<(Option<Certificate>, FramesCost)> {
        let mut times = Vec::new();
        let (baseline, all) = stage(|| {
            let mut session = Session::new(SessionOptions {
                strategy: Strategy::Incremental,
                events: self.events,
                keep_open: true,
                ..SessionOptions::default()
            })?;
            for frame in model::Frames::open(path, &ReadOptions::default())? {
                let frame = frame?;
                let curves: CurveSet = frame.curves.map_err(|e| e.in_file(path))?;
                let frame =
                    Received::new(FrameInfo::at(frame.seq, frame.time), Ok(Arc::new(curves)));
                let (verified, elapsed) = timed(|| session.verify(frame));
                times.push(elapsed);
                take(verified?.valid()?.report);
            }
            Ok(session.baseline().cloned())
        })?;
        let (first, later) = times
            .split_first()
            .ok_or_else(|| Error::Usage(format!("{}: no frames", path.display())))?;
        let cost = FramesCost {
            first_ms: first.wall_ms,
            later_ms: median(later.iter().map(|t| t.wall_ms)),
            cpu_ms: [first.cpu_ms, median(later.iter().map(|t| t.cpu_ms))],
            all,
        };
        Ok((baseline, cost))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn study(frames: u64, pull: Option<u64>, folder: &Path) -> ScalingStudy {
        ScalingStudy {
            moving: MovingScene {
                motion: "smooth".parse().unwrap(),
                length: 0.2,
                amplitude: 0.01,
                frames,
                pull,
            },
            events: Events::Between,
            folder: folder.into(),
        }
    }

    #[test]
    fn results_follow_from_the_construction_and_no_file_remains() {
        let folder = tempfile::tempdir().unwrap();
        let scene: Scene = "chainmail:rows=6,columns=7".parse().unwrap();
        for (pull, changed) in [(None, 0), (Some(2), 2)] {
            let row = study(4, pull, folder.path()).measure(&scene).unwrap();
            assert_eq!((row.curves, row.segments), (126, 1890));
            assert!(row.as_constructed, "{row:?}");
            assert_eq!(row.changed, changed);
            if cfg!(target_os = "linux") {
                assert!(row.certify.peak_mb > Some(1.0), "{row:?}");
            }
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn one_frame_is_only_certified() {
        let folder = tempfile::tempdir().unwrap();
        let scene: Scene = "ribbon:segments=2000".parse().unwrap();
        let row = study(1, None, folder.path()).measure(&scene).unwrap();
        assert!(row.check.is_none());
        assert!(row.as_constructed, "{row:?}");
        assert_eq!(row.links, 1);
    }

    #[test]
    fn a_missing_folder_is_an_error_that_names_the_file() {
        let scene: Scene = "ribbon:segments=2000".parse().unwrap();
        let missing = Path::new("/no such folder");
        let e = study(1, None, missing).measure(&scene).unwrap_err();
        assert!(
            e.to_string().contains("/no such folder/linkwatch-sizes"),
            "{e}"
        );
    }
}
