//! Kernels: two closed curves in, their linking number out.
//!
//! `crossings` counts, exactly; the others sum the Gauss integral and say how far off they may be ([`Estimate`]). The
//! verifier takes from a sum what its bound decides and counts the rest ([`crate::Ladder`]), so a kernel costs time, never
//! truth.
//!
//! What every kernel owes, and the tests check by these numbers:
//!
//! 1. Symmetry: `lambda(i, j) = lambda(j, i)`.
//! 2. Reversing one curve changes the sign; reversing both does not.
//! 3. Cyclic shifts of the vertices change nothing.
//! 4. Rigid motions and positive scaling change nothing (as far as they are exact on the input floats).
//! 5. Inserting a vertex on a segment changes nothing.
//! 6. A plane between the curves makes it 0.
//! 7. The sign is that of Arai's sum (Arai 2013).
//! 8. An integer is given only when it is proven; otherwise a [`crate::Defect`] says why, and where.

mod accelerator;
pub(crate) mod barnes_hut;
mod calibration;
#[cfg(test)]
mod conformance;
mod counted;
pub(crate) mod crossings;
pub(crate) mod device;
pub(crate) mod direct;
mod estimate;
pub(crate) mod fmm;
#[cfg(feature = "gpu")]
pub(crate) mod gpu;
pub(crate) mod interval;
mod method;
pub mod oracle;

pub use accelerator::Offload;
pub(crate) use accelerator::{Accelerator, Offer};
#[cfg(feature = "gpu")]
pub(crate) use calibration::segments;
pub use calibration::{Calibration, CountingCost, SumCost};
pub(crate) use calibration::{CountingWork, segment_pairs};
pub(crate) use counted::Counted;
pub use device::{Device, DeviceInfo, devices};
pub use estimate::Estimate;
pub(crate) use estimate::Summation;
#[cfg(feature = "gpu")]
pub use gpu::{DeviceTimes, Precision, measure as measure_device};
pub use method::{Accuracy, Method};

use crate::verdict::{DefectKind, Place};

/// Work that linking numbers take, in counts. It depends on the curves alone, not on the machine.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct KernelWork {
    /// Node pairs looked into for the choice of the direction, breadth first.
    pub front: u64,
    /// Node pairs looked into on the way to the segments, depth first, whose boxes are stored.
    pub nodes: u64,
    /// Those whose boxes are computed from the coordinates.
    pub computed: u64,
    /// Segment pairs tested for a crossing.
    pub tests: u64,
    /// Segment pairs of splines whose boxes overlap in space, and whose hulls are compared.
    pub overlaps: u64,
    /// Points that the discretization adds.
    pub refined: u64,
    /// Tests that exact arithmetic decides.
    pub exact: u64,
}

impl KernelWork {
    /// So many times the work, rounded.
    pub(crate) fn scaled(self, factor: f64) -> KernelWork {
        let scaled = |count: u64| (count as f64 * factor).round() as u64;
        KernelWork {
            front: scaled(self.front),
            nodes: scaled(self.nodes),
            computed: scaled(self.computed),
            tests: scaled(self.tests),
            overlaps: scaled(self.overlaps),
            refined: scaled(self.refined),
            exact: scaled(self.exact),
        }
    }
}

impl std::ops::Add for KernelWork {
    type Output = KernelWork;

    fn add(self, other: KernelWork) -> KernelWork {
        KernelWork {
            front: self.front + other.front,
            nodes: self.nodes + other.nodes,
            computed: self.computed + other.computed,
            tests: self.tests + other.tests,
            overlaps: self.overlaps + other.overlaps,
            refined: self.refined + other.refined,
            exact: self.exact + other.exact,
        }
    }
}

impl std::iter::Sum for KernelWork {
    fn sum<I: Iterator<Item = KernelWork>>(parts: I) -> KernelWork {
        parts.fold(KernelWork::default(), |a, b| a + b)
    }
}

/// What a kernel says of one pair.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Linking {
    /// The linking number, proven.
    Number(i64),
    /// There is none, or it could not be proven.
    Undefined(DefectKind, Place),
}
