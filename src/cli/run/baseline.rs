//! Baseline of a session: the frame with which later frames are compared, and its record for sinks.
//! A file that begins with any frame can then be replayed by itself.

use super::{Judged, Run};
use crate::cli::output::{count, plural, plural_of};
use linkwatch::{
    BaselineRecord, Basis, Certificate, Continuation, CurveSet, Defect, DefectKind, Events,
    FrameInfo, Precision, Verdict,
};
use std::sync::Arc;

/// Frame from which the expected linking numbers come.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub struct Origin {
    words: String,
    /// Sequence number of that frame; `None` if the linking numbers come from a file.
    frame: Option<u64>,
    /// Number of frames that were published before it, but verified by nobody.
    pub unverified: u64,
}

impl Origin {
    /// Splits the record of a baseline into the linking numbers and their origin.
    pub fn of(record: BaselineRecord) -> (Certificate, Origin) {
        let origin = Origin {
            words: record.origin,
            frame: record.frame,
            unverified: record.unverified,
        };
        (Arc::unwrap_or_clone(record.certificate), origin)
    }
}

impl Run {
    /// Restarts the comparison: the next frame does not continue the last one, because the
    /// recording lacks the frames between them. `baseline` replaces the expected linking numbers,
    /// unless the user chose them.
    pub fn begin_again(&mut self, baseline: Option<BaselineRecord>) {
        match baseline {
            Some(b) => {
                let (certificate, origin) = Origin::of(b);
                self.session.begin_recorded_part(certificate);
                self.origin = Some(origin);
                self.news.known.forget();
            }
            None => self.session.cut(),
        }
        self.begun = false;
    }

    /// Same as [`Run::begin_again`] after a gap in the recording, which is counted.
    pub fn begin_after_gap(&mut self) {
        self.begin_again(None);
        self.sum.gaps += 1;
    }

    /// Begins another run, with the given search for pull-throughs: the next frame does not
    /// continue the motion of those before it.
    pub fn begin_run(&mut self, events: Events) {
        self.end_run();
        self.options.events = events;
        self.sum.unsearched_runs += u64::from(events == Events::Off);
        self.session.begin_run_with(events);
        self.news.known.forget();
        self.sum.violations.begin_run();
        if let Some(junit) = &mut self.junit {
            junit.violation = None;
        }
        self.begun = false;
        self.is_new_run = true;
        self.sum.further_runs += 1;
    }

    /// Finds the origin of the baseline at its first verified frame, if it is not known. Call this
    /// before the verdict on the frame is sent.
    pub fn find_origin(&mut self, judged: &Judged) {
        let (seq, info) = (judged.report.seq, &judged.info);
        if self.origin.is_some() || judged.report.verdict == Verdict::Rejected {
            return;
        }
        let from_now = self.setup.from_now && !self.begun;
        // Rejected frames do not count, because an earlier watch has received them.
        let missed = match (self.setup.live, self.begun) {
            (true, false) => self.tally.since(self.before).skipped.min(seq),
            (true, true) => seq.saturating_sub(info.baseline),
            (false, false) => 0,
            // The recorder may have skipped frames for other reasons.
            (false, true) => seq
                .saturating_sub(info.baseline)
                .min(self.rejected_since_verified),
        };
        let begins_with_it = !self.begun && seq > 0 && seq == info.baseline;
        self.origin = Some(Origin {
            words: match judged.step == Continuation::Accepted || begins_with_it {
                true => format!("frame {seq}, accepted by the simulator"),
                false if seq > 0 => format!("frame {seq}"),
                false => "first frame".into(),
            },
            frame: Some(seq),
            unverified: if from_now { 0 } else { missed },
        });
        if missed > 0 {
            let before = before_it(missed);
            let why = match self.begun {
                true => "the frame that the simulator accepted was not verified",
                false => "the watch started late",
            };
            let late = format!("{why}: the baseline is frame {seq}, and {before} not verified");
            match from_now {
                true => tracing::info!("{late}"),
                false => {
                    let hint = " (--from-now accepts this)";
                    let has_hint = self.setup.live && !self.begun;
                    tracing::warn!("{late}{}", if has_hint { hint } else { "" });
                    self.data_lost();
                }
            }
        }
    }

    /// Records the first verified frame of a baseline, and prints what is verified.
    pub(super) fn begin_baseline(&mut self, judged: &Judged) {
        // The first frame after a gap continues the baseline.
        let begins = !self.begun && self.sum.gaps == 0 || self.baseline_changed;
        self.find_origin(judged);
        if self.setup.live
            && begins
            && let (Some(curves), Some(words)) = (&judged.curves, self.baseline_words())
        {
            let none = Certificate::default();
            let certificate = self.session.baseline().unwrap_or(&none);
            let scene = words_of_scene(curves, &judged.info, certificate);
            tracing::info!("watching {scene}; {words}");
        }
    }

    /// Returns a text about the baseline, once it is known.
    pub(super) fn baseline_words(&self) -> Option<String> {
        let origin = self.origin.as_ref()?;
        let mut words = match origin.frame {
            Some(0) => "the baseline is frame 0".to_owned(),
            _ => format!("the baseline is {}", origin.words),
        };
        if let Some(certificate) = self.session.baseline() {
            words += &format!(", with {}", plural(links(certificate), "link"));
        }
        if origin.unverified > 0 {
            words += &format!("; {} not verified", before_it(origin.unverified));
        }
        Some(words)
    }

    /// Returns the baseline for the summary, once it is known.
    pub(super) fn baseline_json(&self) -> Option<serde_json::Value> {
        let origin = self.origin.as_ref()?;
        Some(serde_json::json!({
            "frame": origin.frame,
            "origin": origin.words,
            "links": self.session.baseline().map(links),
            "unverified": origin.unverified,
        }))
    }

    /// Returns true if a frame may have changed the baseline since it was last passed to the sinks.
    pub fn changes_baseline(&self, judged: &Judged) -> bool {
        let other_curves = !self.begun || judged.info.layout != self.sent_layout;
        let changed = self.baseline_changed || judged.curves.is_some() && other_curves;
        let is_fresh = |d: &Defect| d.kind == DefectKind::NoBaseline;
        let report = &judged.report;
        changed || !report.adopted.is_empty() || report.defects.iter().any(is_fresh)
    }

    /// Passes the baseline to the sinks, if it is known: before the first frame, and after each
    /// change.
    pub(super) fn pass_baseline(&mut self, judged: &Judged) {
        if self.begun && !self.changes_baseline(judged) {
            return;
        }
        let certificate = self.session.complete_baseline();
        let (Some(origin), Some(certificate)) = (&self.origin, certificate) else {
            return;
        };
        let record = Arc::new(BaselineRecord {
            certificate: Arc::new(certificate),
            origin: origin.words.clone(),
            frame: origin.frame,
            unverified: origin.unverified,
        });
        for queue in &self.queues {
            match self.begun {
                true => queue.expect(Arc::clone(&record)),
                false => queue.begin(Arc::clone(&record)),
            }
        }
        (self.begun, self.baseline_changed) = (true, false);
        if judged.curves.is_some() {
            self.sent_layout = judged.info.layout;
        }
    }
}

/// Returns the start of a sentence about frames before the baseline.
fn before_it(frames: u64) -> String {
    plural_of(frames, "frame before it was", "frames before it were")
}

/// Returns the number of pairs that are linked, periodic images included.
fn links(certificate: &Certificate) -> u64 {
    (certificate.links.len() + certificate.images.iter().flatten().count()) as u64
}

/// Describes a frame: its curves, their basis and precision, names, radii and the cell.
fn words_of_scene(curves: &CurveSet, info: &FrameInfo, certificate: &Certificate) -> String {
    let closed = curves.counts().filter(|&n| n < 0).count();
    let through = certificate.periods.len();
    let kinds = [
        (closed, "closed"),
        (curves.len().saturating_sub(closed + through), "open"),
        (through, "through the cell"),
    ];
    let kinds = kinds.into_iter().filter(|(n, _)| *n > 0);
    let kinds = kinds.map(|(n, kind)| format!("{} {kind}", count(n)));
    let kinds = kinds.collect::<Vec<String>>().join(", ");
    let basis = match curves.basis() {
        Basis::Polyline => "polylines",
        Basis::CatmullRom => "Catmull-Rom splines",
        Basis::BSpline => "B-splines",
        Basis::Bezier => "Bezier splines",
    };
    let precision = match curves.precision() {
        Precision::F32 => "single",
        Precision::F64 => "double",
    };
    let names = &info.labels.names;
    let with = if names.is_empty() { "without" } else { "with" };
    let radii = info.labels.radii.iter().copied();
    let radii = match (radii.clone().reduce(f32::min), radii.reduce(f32::max)) {
        (Some(least), Some(most)) if least < most => format!("radii of {least} to {most}"),
        (Some(radius), _) => format!("a radius of {radius}"),
        (None, _) => "no radii".into(),
    };
    let cell = match &info.cell {
        Some(cell) => format!("the periodic cell {cell}"),
        None => "no periodic cell".into(),
    };
    let curves = plural(curves.len(), "curve");
    format!("{curves} ({kinds}): {basis} in {precision} precision, {with} names, {radii}, {cell}")
}
