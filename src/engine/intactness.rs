//! Last frame that is known to be intact.

use crate::verdict::{Report, Verdict};
use serde::{Deserialize, Serialize};

/// Knowledge about the last intact frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Intactness {
    /// Last frame that is known to be intact.
    pub last_intact: Option<u64>,
    /// True if the last verified frame is known to be intact.
    pub intact: bool,
    /// True if a curve was pulled through another one since that frame, or may have been. Then no
    /// later frame is known to be intact, even if it has the expected linking numbers.
    broken: bool,
}

impl Intactness {
    /// Sets the last intact frame of a complete report. `unknown` is true if a curve may have been
    /// pulled through another one for a reason that the report does not contain.
    pub(super) fn conclude(&mut self, report: &mut Report, unknown: bool) {
        let of_step = report.defects.iter().any(|d| d.kind.is_of_step());
        let changed = report.verdict == Verdict::Changed;
        self.broken |= unknown || of_step || changed || !report.unresolved.is_empty();
        self.intact = report.verdict == Verdict::Intact && !self.broken;
        if self.intact {
            self.last_intact = Some(report.seq);
        }
        report.last_intact = self.last_intact;
    }

    /// Forgets a possible pull-through, because the next frame does not continue the last one.
    pub(super) fn cut(&mut self) {
        self.broken = false;
    }

    /// Continues after frames that are no longer available, except that `last_intact` is known to
    /// be the last intact one. `intact` is true if it was the last one verified.
    pub(super) fn doubt(&mut self, last_intact: Option<u64>, intact: bool) {
        self.last_intact = last_intact;
        self.broken = !intact;
        self.intact = false;
    }
}
