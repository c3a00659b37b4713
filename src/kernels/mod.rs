//! Kernels: two closed curves in, their linking number out.
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

pub(crate) mod crossings;
pub mod oracle;

use crate::verdict::{DefectKind, Place};

/// What a kernel says of one pair.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Linking {
    /// The linking number, proven.
    Number(i64),
    /// There is none, or it could not be proven.
    Undefined(DefectKind, Place),
}
