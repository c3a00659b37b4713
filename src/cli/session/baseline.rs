//! Baseline of a session, as its sinks need it: a file that begins with any frame can then be
//! replayed by itself.

use super::{Cells, Judged, Session};
use linkwatch::{BaselineRecord, Defect, DefectKind, Result, Verifier};
use std::sync::Arc;

impl Session {
    /// Begins again: the next frame does not continue the last one, because the frames between them
    /// are not in the recording. `baseline` replaces the expected linking numbers, unless the user
    /// chose them.
    #[cfg(feature = "mcap")]
    pub fn begin_again(&mut self, baseline: Option<BaselineRecord>) {
        match baseline {
            Some(b) => {
                self.verifier.restart(Arc::unwrap_or_clone(b.certificate));
                self.origin = Some(b.origin);
                self.last = None;
                self.news.forget();
            }
            None => self.verifier.cut(),
        }
        self.begun = false;
    }

    /// Begins another run: the next frame does not belong to the motion of those before it.
    pub fn begin_run(&mut self) -> Result<()> {
        self.verifier = Verifier::new(self.options.clone())?;
        self.cells = Cells::new(self.cells.args);
        self.last = None;
        self.news.forget();
        self.begun = false;
        self.is_new_run = true;
        self.runs += 1;
        Ok(())
    }

    /// Passes the baseline to the sinks, if it is known: before the first frame, and if it changes.
    pub(super) fn pass_baseline(&mut self, judged: &Judged) {
        let layout = judged.info.layout;
        let other_curves = judged.curves.is_some() && layout != self.sent_layout;
        let is_fresh = |d: &Defect| d.kind == DefectKind::NoBaseline;
        if self.begun && !other_curves && !judged.report.defects.iter().any(is_fresh) {
            return;
        }
        let Some(certificate) = self.baseline() else {
            return;
        };
        let record = Arc::new(BaselineRecord {
            certificate: Arc::new(certificate),
            origin: self.origin.clone().unwrap_or_else(|| "first frame".into()),
        });
        for queue in &self.queues {
            match self.begun {
                true => queue.expect(Arc::clone(&record)),
                false => queue.begin(Arc::clone(&record)),
            }
        }
        self.begun = true;
        if judged.curves.is_some() {
            self.sent_layout = layout;
        }
    }
}
