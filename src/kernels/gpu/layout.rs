//! Structs that programs share with us: here as Rust has them, in `shared.wgsl` as programs see them. A test compares the two.

use bytemuck::{Pod, Zeroable};

/// What is the same for a whole dispatch.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub(crate) struct Parameters {
    /// How far each coordinate may be from the true one: 0 where all of them are exact in single precision.
    pub radius: f32,
    /// 0, which a compiler does not know.
    pub zero: u32,
    /// The first item.
    pub first: u32,
    /// How many, or another number that a stage is told.
    pub items: u32,
}

/// A tile of work: some consecutive segments of one curve with some of another.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub(crate) struct Tile {
    /// Which pair of curves it is a part of.
    pub pair: u32,
    /// First vertex of the rows, and how many segments they are.
    pub first_row: u32,
    /// Rows.
    pub rows: u32,
    /// First vertex of the columns.
    pub first_column: u32,
    /// Columns.
    pub columns: u32,
    /// None: parts of the list start at multiples of 32 bytes.
    pub padding: [u32; 3],
}

/// The sum of the angles of a pair: fixed-point numbers of three words each, in units of [`super::fixed::UNIT`]. Programs see
/// a list of words, and are told where each is.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub(crate) struct AngleSum {
    /// The sum.
    pub value: [u32; 3],
    /// The sum of the bounds.
    pub bound: [u32; 3],
    /// Pairs of segments whose angle is in doubt.
    pub doubts: u32,
    /// Not 0 where the uncertainty of vertices may make segments cross, or where doubts are too many to count.
    pub near: u32,
}

/// A box around a run of segments.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct BoxNode {
    /// Least coordinates.
    pub low: [f32; 3],
    /// The first of what is below: vertices at the bottom, else nodes.
    pub first: u32,
    /// Largest coordinates.
    pub high: [f32; 3],
    /// How many there are below; and the level, times [`super::boxes::LEVEL`].
    pub below: u32,
}

/// The topmost boxes of a curve.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub(crate) struct Roots {
    /// The first.
    pub first: u32,
    /// How many.
    pub count: u32,
}

/// A test that single precision does not decide.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Pod, Zeroable)]
pub(crate) struct Undecided {
    /// The pair of curves; the axis is in its highest bits ([`super::descent::AXIS`]).
    pub pair: u32,
    /// First vertex of the segment on top.
    pub upper: u32,
    /// First vertex of the segment below.
    pub lower: u32,
}

/// A node of a tree; see [`crate::kernels::barnes_hut::PackedNode`].
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct Node {
    /// Centre.
    pub centre: [f32; 3],
    /// Distance of its points from the centre, at most.
    pub radius: f32,
    /// What the centre lacks.
    pub centre_rest: [f32; 3],
    /// Length.
    pub length: f32,
    /// Mean of the squared distance from the centre, by that of the radius.
    pub second: f32,
    /// Mean of its fourth power.
    pub fourth: f32,
    /// First vertex.
    pub first: u32,
    /// Segments.
    pub segments: u32,
    /// Mean of the products of the tangent's coordinates.
    pub tangents: [f32; 6],
    /// Second child; the first one comes next.
    pub right: u32,
    /// 1 where there are none.
    pub leaf: u32,
    /// Moments.
    pub moments: [f32; 30],
    /// None.
    pub padding: [u32; 2],
}

/// A pair of nodes to look into, of the trees of Barnes-Hut or of boxes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub(crate) struct NodePair {
    /// The pair of curves; of boxes with the axis in its highest bits ([`super::descent::AXIS`]).
    pub pair: u32,
    /// A node of the first; of boxes of the one on top.
    pub first: u32,
    /// A node of the other one.
    pub second: u32,
}

/// When a node pair is expanded: both have to hold.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct Criterion {
    /// Its distance is above this times the sum of the radii.
    pub beta: f32,
    /// The bound of the remainder is not above this.
    pub share: f32,
}

/// The sum of the expansions of a pair, like [`AngleSum`].
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub(crate) struct FarSum {
    /// The sum.
    pub value: [u32; 3],
    /// The sum of the bounds.
    pub bound: [u32; 3],
    /// That of rounding alone.
    pub size: [u32; 3],
    /// Node pairs expanded.
    pub expanded: u32,
    /// Node pairs looked into.
    pub visited: u32,
}

/// A place in a struct, in words.
macro_rules! word {
    ($struct:ident.$field:ident) => {
        (std::mem::offset_of!($struct, $field) / 4) as u32
    };
    ($struct:ident) => {
        (size_of::<$struct>() / 4) as u32
    };
}
pub(crate) use word;
