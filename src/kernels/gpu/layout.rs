//! Structs that Rust and the shaders share: defined here, and in `shared.wgsl` and other shaders. A
//! test compares the layouts.

use bytemuck::{Pod, Zeroable};

/// Parameters of a dispatch.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub(crate) struct Parameters {
    /// Maximum error of a coordinate: 0 if all coordinates are exact in single precision.
    pub radius: f32,
    /// Always 0, but unknown to the shader compiler.
    pub zero: u32,
    /// Index of the first item.
    pub first: u32,
    /// Number of items, or another number that the stage needs.
    pub items: u32,
}

impl Parameters {
    pub fn new(radius: f32, first: u32, items: u32) -> Parameters {
        Parameters {
            radius,
            zero: 0,
            first,
            items,
        }
    }
}

/// A tile of work: a run of segments of one curve, to be paired with a run of segments of another
/// one.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub(crate) struct Tile {
    /// Index of the pair of curves.
    pub pair: u32,
    /// First vertex of the rows.
    pub first_row: u32,
    /// Number of rows.
    pub rows: u32,
    /// First vertex of the columns.
    pub first_column: u32,
    /// Number of columns.
    pub columns: u32,
    /// Unused. It makes the size 32 bytes, so that a batch of a list can start at an aligned
    /// offset.
    pub padding: [u32; 3],
}

/// Sum of the angles of a pair: fixed-point numbers of three words each, in units of
/// [`super::fixed::UNIT`]. Shaders access it as a list of words, with the offsets as constants.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub(crate) struct AngleSum {
    /// Sum of the angles.
    pub value: [u32; 3],
    /// Sum of the error bounds.
    pub bound: [u32; 3],
    /// Number of segment pairs whose angle is undecided.
    pub doubts: u32,
    /// Not 0 if the uncertainty of the vertices may make segments cross, or if the count of
    /// undecided pairs overflowed.
    pub near: u32,
}

/// Bounding box of a run of segments.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct BoxNode {
    /// Minimum of each coordinate.
    pub low: [f32; 3],
    /// Index of the first child: a vertex at the bottom, else a node.
    pub first: u32,
    /// Maximum of each coordinate.
    pub high: [f32; 3],
    /// Number of children, plus the level times [`super::boxes::LEVEL`].
    pub below: u32,
}

/// Root boxes of a curve.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub(crate) struct Roots {
    /// Index of the first root.
    pub first: u32,
    /// Number of roots.
    pub count: u32,
}

/// A crossing test that single precision does not decide.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Pod, Zeroable)]
pub(crate) struct Undecided {
    /// Index of the pair of curves; the axis is in the highest bits ([`super::descent::AXIS`]).
    pub pair: u32,
    /// First vertex of the upper segment.
    pub upper: u32,
    /// First vertex of the lower segment.
    pub lower: u32,
}

/// A tree node of Barnes-Hut. Upper bounds are rounded up, all other values to the nearest. Moments
/// are about the centre, divided by the length and, for each order, by the radius.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct Node {
    /// Centre, rounded.
    pub centre: [f32; 3],
    /// Upper bound of the distance of its points from the centre.
    pub radius: f32,
    /// Rounding error of `centre`; the sum of both is the centre.
    pub centre_rest: [f32; 3],
    /// Total length of the segments.
    pub length: f32,
    /// Upper bound of the mean of the squared distance from the centre, divided by the squared
    /// radius.
    pub second: f32,
    /// Upper bound of the mean of the fourth power of the distance, divided by that of the radius.
    pub fourth: f32,
    /// Index of the first vertex.
    pub first: u32,
    /// Number of segments.
    pub segments: u32,
    /// Means of the products of the coordinates of the tangent.
    pub tangents: [f32; 6],
    /// Index of the second child; the first child is the next node. 0 for a leaf.
    pub right: u32,
    /// 1 if the node is a leaf, else 0.
    pub leaf: u32,
    /// Moments about the centre.
    pub moments: [f32; 30],
    /// Unused.
    pub padding: [u32; 2],
}

/// A node pair to visit, of Barnes-Hut trees or of box hierarchies.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub(crate) struct NodePair {
    /// Index of the pair of curves; for boxes the axis is in the highest bits
    /// ([`super::descent::AXIS`]).
    pub pair: u32,
    /// Node of the first curve; for boxes, of the upper curve.
    pub first: u32,
    /// Node of the other curve.
    pub second: u32,
}

/// Conditions under which a node pair is expanded. Both must hold.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct Criterion {
    /// Minimum ratio of the distance and the sum of the radii.
    pub beta: f32,
    /// Maximum bound of the remainder.
    pub share: f32,
}

/// Sum of the expansions of a pair, in the format of [`AngleSum`].
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub(crate) struct FarSum {
    /// Sum of the expansions.
    pub value: [u32; 3],
    /// Sum of the error bounds.
    pub bound: [u32; 3],
    /// Sum of the rounding errors alone.
    pub size: [u32; 3],
}

/// Offset of a field, or size of a struct, as text.
macro_rules! word {
    ($struct:ident.$field:ident) => {
        (std::mem::offset_of!($struct, $field) / 4) as u32
    };
    ($struct:ident) => {
        (size_of::<$struct>() / 4) as u32
    };
}

/// Names and values of constants, for shaders.
macro_rules! named {
    ($($constant:ident),+ $(,)?) => {
        [$((stringify!($constant), $constant)),+]
    };
}
pub(crate) use {named, word};
