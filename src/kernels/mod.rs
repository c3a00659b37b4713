//! Kernels: compute the linking number of two closed curves.
//!
//! `crossings` counts crossings, exactly. Those in `sums` sum the Gauss integral and return a value
//! with a proven error bound ([`Estimate`]). The certifier accepts a sum if its bound proves
//! the integer, and counts crossings otherwise ([`crate::Ladder`]). So the choice of a kernel
//! changes the time, never the result.
//!
//! ```
//! use linkwatch::kernels::Method;
//! use linkwatch::scenes::Scene;
//! use linkwatch::{Certifier, SessionOptions};
//!
//! let built = "ribbon:segments=2000,lambda=3".parse::<Scene>()?.build()?;
//! let mut certifier = Certifier::new(&SessionOptions {
//!     kernel: Method::Fmm,
//!     ..SessionOptions::default()
//! })?;
//! assert_eq!(*certifier.certify(&built.curves).0, built.certificate);
//! # Ok::<(), linkwatch::Error>(())
//! ```
//!
//! # Contract
//!
//! Every kernel satisfies these properties; the tests refer to them by number:
//!
//! 1. Symmetry: `lambda(i, j) = lambda(j, i)`.
//! 2. Reversing one curve changes the sign; reversing both does not.
//! 3. Cyclic shifts of the vertices do not change the result.
//! 4. Rigid motions and positive scaling do not change the result, provided that they are exact in
//!    floating point.
//! 5. Inserting a vertex on a segment does not change the result.
//! 6. If a plane separates the curves, the result is 0.
//! 7. The sign is that of Arai's sum (Arai 2013).
//! 8. An integer is returned only if it is proven. Otherwise a [`crate::Defect`] names the reason
//!    and the place.

pub(crate) mod calibration;
pub(crate) mod choice;
mod counted;
pub(crate) mod crossings;
pub(crate) mod device;
#[cfg(feature = "gpu")]
pub(crate) mod gpu;
#[cfg(not(feature = "gpu"))]
#[path = "no_gpu.rs"]
pub(crate) mod gpu;
mod gpu_use;
mod lazy;
mod method;
pub(crate) mod sums;
#[cfg(test)]
pub(crate) mod tests;

pub(crate) use calibration::segment_pairs;
pub use calibration::{Calibration, CountingCost, SumCost};
pub(crate) use counted::Counted;
pub use device::{Device, DeviceInfo};
pub use gpu::devices;
pub use gpu_use::Offload;
pub(crate) use gpu_use::{GpuUse, Offer};
pub use method::{Accuracy, Method};
pub use sums::Estimate;
pub(crate) use sums::{Chain, Summation};

use crate::verdict::{DefectKind, Place};

/// Work of linking numbers, in counts. It depends on the curves alone, not on the machine.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct KernelWork {
    /// Node pairs visited breadth first, to choose the direction of projection.
    pub front: u64,
    /// Node pairs visited depth first, down to the segments, whose boxes are stored.
    pub nodes: u64,
    /// Node pairs visited depth first whose boxes are computed from the coordinates.
    pub computed: u64,
    /// Segment pairs tested for a crossing.
    pub tests: u64,
    /// Segment pairs of splines whose boxes overlap in space. Their hulls are compared.
    pub overlaps: u64,
    /// Points that the discretization adds.
    pub refined: u64,
    /// Tests that needed exact arithmetic.
    pub exact: u64,
}

impl KernelWork {
    /// Combines each count with that of other work.
    fn each(self, other: KernelWork, f: impl Fn(u64, u64) -> u64) -> KernelWork {
        KernelWork {
            front: f(self.front, other.front),
            nodes: f(self.nodes, other.nodes),
            computed: f(self.computed, other.computed),
            tests: f(self.tests, other.tests),
            overlaps: f(self.overlaps, other.overlaps),
            refined: f(self.refined, other.refined),
            exact: f(self.exact, other.exact),
        }
    }

    /// Returns `factor` times the work, rounded.
    pub(crate) fn scaled(self, factor: f64) -> KernelWork {
        self.each(self, |count, _| (count as f64 * factor).round() as u64)
    }
}

impl std::ops::Add for KernelWork {
    type Output = KernelWork;

    fn add(self, other: KernelWork) -> KernelWork {
        self.each(other, |a, b| a + b)
    }
}

/// Result of counting the crossings of one pair of curves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Linking {
    /// The linking number, proven.
    Number(i64),
    /// The linking number does not exist or could not be proven.
    Undefined(DefectKind, Place),
}
