//! Last frame that is known to be intact.

use crate::verdict::{Report, Verdict};
use serde::{Deserialize, Serialize};

/// Knowledge about the last intact frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Intactness {
    /// Last frame that is known to be intact.
    pub last_intact: Option<u64>,
    /// True if that frame is the last verified one.
    pub intact: bool,
    /// True if a curve was pulled through another one since that frame, or may have been. Then no
    /// later frame is known to be intact, even if it has the expected linking numbers.
    broken: bool,
}

impl Intactness {
    /// Adds to a complete report the last frame that is known to be intact. `unknown` is true if a
    /// curve may have been pulled through another one for a reason that the report does not have.
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

    /// Forgets what happened before the next frame.
    pub(super) fn cut(&mut self) {
        self.broken = false;
    }

    /// Continues after frames that are not known but for the last intact one; `intact` is true if
    /// it was the last one.
    pub(super) fn doubt(&mut self, last_intact: Option<u64>, intact: bool) {
        self.last_intact = last_intact;
        self.broken = !intact;
        self.intact = false;
    }
}
