//! Options of a session, and the check that they fit together.

use crate::certificate::Certificate;
use crate::curve::Cell;
use crate::diagram::InvariantKind;
use crate::discretize::Braids;
use crate::error::{Error, Result};
use crate::incremental::{Events, MOTION_LIMIT};
use crate::kernels::{Accuracy, Calibration, Device, Method};
use crate::measure::ClearanceOptions;
use crate::verdict::AbortOn;

/// Options of a [`Session`](crate::Session).
///
/// Set the fields that differ from the defaults. Later versions may have more fields.
///
/// ```
/// use linkwatch::{Events, Session, SessionOptions, Strategy};
///
/// # fn main() -> linkwatch::Result<()> {
/// let session = Session::new(SessionOptions {
///     strategy: Strategy::Incremental,
///     events: Events::Between,
///     ..SessionOptions::default()
/// })?;
/// # let _ = session;
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct SessionOptions {
    /// Findings that ask the simulator to stop. The default is [`AbortOn::Any`].
    pub abort_on: AbortOn,
    /// Expected linking numbers. `None`, the default: those of the first frame.
    pub baseline: Option<Certificate>,
    /// Part of each frame that is computed. The default is [`Strategy::Full`].
    pub strategy: Strategy,
    /// True if a full run ends at the first change, the most suspect pairs first. A broken frame is
    /// then detected long before all numbers are known; an intact one takes as long as without.
    /// Excludes incremental verification, [`SessionOptions::events`] and kernels that sum, because
    /// they need all linking numbers. The default is false.
    pub early_exit: bool,
    /// Pull-throughs to report, from one frame to the next
    /// ([`Report::events`](crate::Report::events)). The default is [`Events::Off`].
    ///
    /// A frame with a pull-through is [`Verdict::Changed`](crate::Verdict::Changed), whatever its
    /// linking numbers. The sum of the signs of the pull-throughs of two closed curves is always
    /// compared with the change of their linking number. If the two differ, the frame has a defect
    /// ([`DefectKind::Unaccounted`](crate::DefectKind::Unaccounted)). The first frame has no
    /// previous frame, and so no pull-throughs.
    pub events: Events,
    /// Motion between two frames, in segment lengths, up to which pull-throughs that cancel count
    /// as real ([`PullThrough::lengths`](crate::PullThrough::lengths)). `None`, the default:
    /// [`SessionOptions::MOTION_LIMIT`].
    ///
    /// Pull-throughs assume that points move on straight lines from frame to frame. If frames are
    /// far apart in time, curves that went around one another seem to pass through one another and
    /// back. So two pull-throughs are [unresolved](crate::Report::unresolved) if they cancel within
    /// their pair of curves and both moved further than the limit. With an infinite limit there are
    /// none.
    pub motion_limit: Option<f64>,
    /// Invariants that are compared in each frame beside linking numbers
    /// ([`Report::invariants`](crate::Report::invariants)), with those of the baseline, or of the
    /// first frame if it has none. They tell frames apart without the motion between them: a curve
    /// that was knotted or unknotted, or Borromean rings that came apart. Computed in full for each
    /// frame. None by default. Excludes braids. Images of a cell are in no triple.
    pub invariants: Vec<InvariantKind>,
    /// Strands whose clearance is measured in each frame ([`Report::clearance`]). `None`, the
    /// default: clearance is not measured.
    ///
    /// [`Report::clearance`]: crate::Report::clearance
    pub clearance: Option<ClearanceOptions>,
    /// Open curves between two rigid ends, which are verified as virtual closed loops: see
    /// [`Braids`]. `None`, the default: open curves have no linking numbers.
    ///
    /// The linking number of the pair `i, j` is that of the loops of the curves `i` and `j`, each
    /// with the next curve of its braid ([`Report::loops`](crate::Report::loops)). If a frame
    /// breaks a condition of the braids (a curve enters an end, an end is not rigid, ends overlap),
    /// it is not intact, and [`Report::missing`](crate::Report::missing) tells why. The curves must
    /// be the same in all frames. Certificates of other runs
    /// ([`SessionOptions::baseline`]) must have been made with the same ends.
    pub braids: Option<Braids>,
    /// Periodic cell of all frames. `None`, the default: each frame has its own
    /// ([`FrameInfo::cell`](crate::FrameInfo::cell)), or the scene does not repeat.
    ///
    /// Each curve then stands for all its images, and linking numbers with images of other curves
    /// and with its own are verified, and pull-throughs between them. The curves must be the same
    /// in all frames. Excludes braids, kernels that sum, and GPUs.
    pub cell: Option<Cell>,
    /// Relation of coordinates to the periodic cell. `None`, the default: curves are whole. A frame
    /// with a segment of more than half of the cell is refused, and a curve that jumps by a lattice
    /// vector from one frame to the next is followed ([`VerifiedFrame::jumps`]). `Some(true)`:
    /// coordinates are wrapped into the cell, and curves are unwrapped ([`Unwrap`]). `Some(false)`:
    /// coordinates are unwrapped, and taken as they are.
    ///
    /// [`VerifiedFrame::jumps`]: crate::VerifiedFrame::jumps
    /// [`Unwrap`]: crate::Unwrap
    pub wrapped: Option<bool>,
    /// True if the cells of the frames are ignored: the images of curves are not verified. Wrapped
    /// coordinates are unwrapped all the same. The default is false.
    pub ignore_cell: bool,
    /// True if curves stay open that end where they start. The default is false: they are closed
    /// ([`Closing`](crate::Closing)).
    pub keep_open: bool,
    /// Maximum number of pairs of curves whose boxes overlap, in a frame or in the motion since the
    /// previous one. A frame with more is not verified ([`Error::TooManyPairs`]), because the
    /// memory for them, up to 200 bytes each, may not be there. The default is
    /// [`SessionOptions::MAX_PAIRS`].
    pub max_pairs: usize,
    /// Kernel that computes all linking numbers of a frame. The default is [`Method::Auto`].
    ///
    /// A kernel that sums runs first; pairs that its error bound does not decide are decided by
    /// counting crossings ([`Certifier::ladder`](crate::Certifier::ladder)). Certificates and
    /// verdicts are the same for all kernels; the work differs. The parts of a frame that
    /// incremental verification computes are always counted.
    pub kernel: Method,
    /// Accuracy of the kernel. The default is the one that its error bound requires.
    pub accuracy: Accuracy,
    /// Device that runs kernels. The default is [`Device::Cpu`].
    ///
    /// A GPU counts the crossings of polylines in full runs, and computes direct and Barnes-Hut
    /// sums. A requested GPU is always used. With [`Device::Auto`], it is used if it is predicted
    /// to be faster than the CPU, from [`SessionOptions::calibration`]. If the GPU fails, the
    /// session logs a warning and continues on the CPU. The results are the same; only the time
    /// differs.
    pub device: Device,
    /// Measured costs, from which [`Device::Auto`] predicts the times of a GPU and of the CPU.
    /// `None`, the default: those that are stored for the user ([`Calibration::keep`]). Without
    /// either, the CPU is chosen.
    pub calibration: Option<Calibration>,
}

/// Part of each frame that a [`Session`](crate::Session) computes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub enum Strategy {
    /// All linking numbers.
    #[default]
    Full,
    /// Linking numbers that may differ from an earlier frame. The others are proven to be
    /// unchanged.
    ///
    /// The verdicts are those of a full run. [`Report::stats`](crate::Report::stats) has the sizes
    /// of the scene alone, because the work depends on earlier frames
    /// ([`VerifiedFrame::work`](crate::VerifiedFrame::work)).
    Incremental,
    /// Both: the incremental result is compared with that of a full run. This is a test of the
    /// session itself.
    ///
    /// If the results differ, the report is the one of the full run,
    /// [`Work::disagreed`](crate::Work::disagreed) is set, and every later frame is computed in
    /// full.
    Paranoid,
}

impl Strategy {
    /// Returns true if earlier frames are used.
    pub(crate) fn is_incremental(self) -> bool {
        matches!(self, Strategy::Incremental | Strategy::Paranoid)
    }
}

impl Default for SessionOptions {
    fn default() -> Self {
        SessionOptions {
            abort_on: AbortOn::default(),
            baseline: None,
            strategy: Strategy::default(),
            early_exit: false,
            events: Events::default(),
            motion_limit: None,
            invariants: Vec::new(),
            clearance: None,
            braids: None,
            cell: None,
            wrapped: None,
            ignore_cell: false,
            keep_open: false,
            max_pairs: SessionOptions::MAX_PAIRS,
            kernel: Method::default(),
            accuracy: Accuracy::default(),
            device: Device::Cpu,
            calibration: None,
        }
    }
}

impl SessionOptions {
    /// Default of [`SessionOptions::motion_limit`], in segment lengths.
    pub const MOTION_LIMIT: f64 = MOTION_LIMIT;

    /// Default of [`SessionOptions::max_pairs`]: 8,192 curves, all of which overlap.
    pub const MAX_PAIRS: usize = 1 << 25;

    /// Checks that every option has an effect.
    ///
    /// # Errors
    ///
    /// [`Error::Usage`], with the names of both options if two exclude one another.
    pub(crate) fn check(&self) -> Result<()> {
        fn refuse(why: impl Into<String>) -> Result<()> {
            Err(Error::Usage(why.into()))
        }
        let searches = self.events != Events::Off;
        let sums = !matches!(self.kernel, Method::Auto | Method::Crossings);
        if self.early_exit && self.strategy != Strategy::Full {
            return refuse("early exit ends a full run, and excludes incremental verification");
        }
        if self.early_exit && searches {
            return refuse(
                "early exit excludes events: the search for pull-throughs needs all linking \
                 numbers",
            );
        }
        if self.early_exit && sums {
            return refuse(format!(
                "early exit excludes the kernel {}: it counts the crossings of few pairs at a time",
                self.kernel
            ));
        }
        if let Some(cell) = &self.cell {
            cell.check()?;
            let excluded = [
                ("braids", self.braids.is_some()),
                ("kernels that sum", sums),
                ("a GPU", !matches!(self.device, Device::Auto | Device::Cpu)),
            ];
            if let Some((what, _)) = excluded.iter().find(|(_, given)| *given) {
                return refuse(format!(
                    "a periodic cell excludes {what} (the option `cell=none` verifies the \
                     curves without their images)"
                ));
            }
        }
        if self.braids.is_some() && !self.invariants.is_empty() {
            return refuse("invariants exclude braids: virtual loops are not the curves");
        }
        if self.abort_on == AbortOn::Event && !searches {
            return refuse("abort on event needs events, which are off");
        }
        match &self.clearance {
            Some(clearance) => clearance.check()?,
            None if self.abort_on == AbortOn::Clearance => {
                return refuse("abort on clearance needs the radius of the strands");
            }
            None => {}
        }
        if let Some(limit) = self.motion_limit {
            if limit.is_nan() || limit < 0.0 {
                return refuse(format!(
                    "a motion limit of {limit} segment lengths, expected 0 or more"
                ));
            }
            if !searches {
                return refuse("a motion limit needs a search for pull-throughs (events)");
            }
        }
        let (accuracy, chosen) = (self.accuracy, self.kernel);
        let needed = [
            ("beta", accuracy.beta.is_some(), Method::BarnesHut),
            ("dipole", accuracy.dipole, Method::BarnesHut),
            ("order", accuracy.order.is_some(), Method::Fmm),
        ];
        let unused = |&&(_, set, kernel): &&(_, bool, _)| set && kernel != chosen;
        if let Some((name, _, kernel)) = needed.iter().find(unused) {
            return refuse(format!("{name} needs the kernel {kernel}, not {chosen}"));
        }
        match (accuracy.target, accuracy.beta) {
            (Some(_), None) => refuse("target needs beta"),
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::Engine;

    /// Asserts that an engine is refused, and that the error contains these words.
    fn assert_refused(options: SessionOptions, words: [&str; 2]) {
        match Engine::new(options.clone()) {
            Err(Error::Usage(why)) => {
                assert!(words.iter().all(|word| why.contains(word)), "{why}");
            }
            other => panic!("{options:?}: {other:?}"),
        }
    }

    fn of(kernel: Method, accuracy: Accuracy) -> SessionOptions {
        SessionOptions {
            kernel,
            accuracy,
            ..SessionOptions::default()
        }
    }

    #[test]
    fn early_exit_excludes_events() {
        for events in [Events::Between, Events::All] {
            let options = SessionOptions {
                early_exit: true,
                events,
                ..SessionOptions::default()
            };
            assert_refused(options, ["early exit", "events"]);
        }
    }

    #[test]
    fn early_exit_excludes_kernels_that_sum() {
        for kernel in Method::ALL {
            let options = SessionOptions {
                early_exit: true,
                ..of(kernel, Accuracy::default())
            };
            match kernel {
                Method::Auto | Method::Crossings => assert!(Engine::new(options).is_ok()),
                _ => assert_refused(options, ["early exit", kernel.word()]),
            }
        }
    }

    #[test]
    fn abort_on_event_needs_events() {
        let options = SessionOptions {
            abort_on: AbortOn::Event,
            ..SessionOptions::default()
        };
        assert_refused(options, ["abort on event", "events"]);
    }

    #[test]
    fn abort_on_clearance_needs_a_radius() {
        let options = |clearance| SessionOptions {
            abort_on: AbortOn::Clearance,
            clearance,
            ..SessionOptions::default()
        };
        assert_refused(options(None), ["abort on clearance", "radius"]);
        assert!(Engine::new(options(Some(ClearanceOptions::new(Some(1.0))))).is_ok());
    }

    #[test]
    fn rejects_a_radius_that_is_not_a_length_and_a_level_that_is_no_share() {
        let refused = |radius, low, words| {
            let mut clearance = ClearanceOptions::new(radius);
            clearance.low = low;
            let options = SessionOptions {
                clearance: Some(clearance),
                ..SessionOptions::default()
            };
            assert_refused(options, words);
        };
        for radius in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            refused(Some(radius), 0.5, ["radius", "length"]);
        }
        for low in [-0.1, 1.1, f64::NAN] {
            refused(None, low, ["clearance", "0 to 1"]);
        }
    }

    #[test]
    fn a_motion_limit_needs_events() {
        let options = SessionOptions {
            motion_limit: Some(2.0),
            ..SessionOptions::default()
        };
        assert_refused(options, ["motion limit", "events"]);
    }

    #[test]
    fn rejects_a_motion_limit_that_is_not_a_length() {
        for limit in [f64::NAN, -1.0] {
            let options = SessionOptions {
                events: Events::Between,
                motion_limit: Some(limit),
                ..SessionOptions::default()
            };
            assert_refused(options, ["motion limit", "0 or more"]);
        }
    }

    #[test]
    fn beta_and_dipole_need_barnes_hut() {
        let none = Accuracy::default();
        let beta = Accuracy {
            beta: Some(2.0),
            ..none
        };
        let dipole = Accuracy {
            dipole: true,
            ..none
        };
        for (name, accuracy) in [("beta", beta), ("dipole", dipole)] {
            assert_refused(of(Method::Fmm, accuracy), [name, "barnes-hut"]);
            assert!(Engine::new(of(Method::BarnesHut, accuracy)).is_ok());
        }
    }

    #[test]
    fn an_order_needs_the_fast_multipole_method() {
        let accuracy = Accuracy {
            order: Some(3),
            ..Accuracy::default()
        };
        assert_refused(of(Method::Auto, accuracy), ["order", "fmm"]);
        assert!(Engine::new(of(Method::Fmm, accuracy)).is_ok());
    }

    #[test]
    fn a_target_needs_beta() {
        let accuracy = Accuracy {
            target: Some(0.1),
            ..Accuracy::default()
        };
        assert_refused(of(Method::BarnesHut, accuracy), ["target", "beta"]);
    }
}
