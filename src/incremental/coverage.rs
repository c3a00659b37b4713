//! Pairs of segments that a reference frame or a ledger covers.

/// Pairs of segments that are covered in addition to those of two different closed curves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Coverage {
    /// True if pairs of segments of the same curve are covered, for its self-crossings.
    pub self_crossings: bool,
    /// True if open curves are covered.
    pub open_curves: bool,
}
