//! Hierarchy of bounding boxes around runs of segments. A box of the lowest level holds [`LEAF`]
//! segments, every other one up to [`FAN`] boxes, until a curve has at most [`ROOTS`] boxes.
//!
//! The structure of the hierarchy follows from the numbers of segments alone, so it is uploaded
//! once and kept while these stay the same. The adapter computes the boxes of each frame, level by
//! level. They are exact: coordinates are compared, never computed.

use super::State;
use super::commands::{Binding, Buffer, Command, Stage};
use super::frame::Frame;
use super::layout::{BoxNode, Parameters, Roots, named};
use std::ops::Range;

/// Maximum number of segments of a box of the lowest level.
pub(super) const LEAF: u32 = 16;

/// Maximum number of children of any other box.
pub(super) const FAN: u32 = 4;

/// Maximum number of root boxes of a curve.
pub(super) const ROOTS: u32 = 16;

/// Threads of a workgroup.
const THREADS: u32 = 64;

/// The last word of a node is its level times this constant, plus the number of its children.
pub(super) const LEVEL: u32 = 256;

/// The shader that computes the boxes of one level.
pub(super) const STAGE: Stage = Stage {
    name: "boxes",
    source: || {
        let parts = [NODES_SHADER, include_str!("boxes.wgsl")];
        super::shader::<f32>(&named![THREADS, LEVEL], &[], &parts)
    },
};

/// Shader code that reads and compares nodes.
pub(super) const NODES_SHADER: &str = include_str!("nodes.wgsl");

const NODES: Buffer = Buffer("nodes", STAGE.name);
const ROOTS_OF: Buffer = Buffer("roots", STAGE.name);
const PARAMETERS: Buffer = Buffer("parameters", STAGE.name);

/// Counter of the workgroups of this stage that ran since the hierarchy was uploaded.
pub(super) const MADE: Binding = Binding::whole(Buffer("made", STAGE.name), 4);

/// Structure of the hierarchy. The boxes of a level are consecutive, ordered by curve.
#[derive(Debug, Default)]
pub(super) struct Hierarchy {
    /// Range of vertices of each curve.
    curves: Vec<Range<u32>>,
    /// Range of nodes of each level, from the bottom.
    levels: Vec<Range<u32>>,
}

impl Hierarchy {
    /// Builds the hierarchy of a frame: the nodes, without their bounds, and the roots of each
    /// curve.
    fn new(frame: &Frame) -> (Hierarchy, Vec<BoxNode>, Vec<Roots>) {
        let mut hierarchy = Hierarchy {
            curves: frame.curves.clone(),
            levels: Vec::new(),
        };
        let mut nodes: Vec<BoxNode> = Vec::new();
        // Nodes of the level below, for each curve.
        let mut below: Vec<Range<u32>> = Vec::new();
        for range in &frame.curves {
            let first = nodes.len() as u32;
            let segments = (range.len() as u32).saturating_sub(1);
            for from in (0..segments).step_by(LEAF as usize) {
                nodes.push(BoxNode {
                    first: range.start + from,
                    below: LEAF.min(segments - from),
                    ..BoxNode::default()
                });
            }
            below.push(first..nodes.len() as u32);
        }
        hierarchy.levels.push(0..nodes.len() as u32);
        while below.iter().any(|own| own.len() as u32 > ROOTS) {
            let level = hierarchy.levels.len() as u32;
            let start = nodes.len() as u32;
            for own in below.iter_mut().filter(|own| own.len() as u32 > ROOTS) {
                let first = nodes.len() as u32;
                for from in own.clone().step_by(FAN as usize) {
                    nodes.push(BoxNode {
                        first: from,
                        below: FAN.min(own.end - from) + LEVEL * level,
                        ..BoxNode::default()
                    });
                }
                *own = first..nodes.len() as u32;
            }
            hierarchy.levels.push(start..nodes.len() as u32);
        }
        let roots = below.iter().map(|own| Roots {
            first: own.start,
            count: own.len() as u32,
        });
        (hierarchy, nodes, roots.collect())
    }

    /// Returns the number of levels of the longest curve.
    pub fn levels(&self) -> u32 {
        self.levels.len() as u32
    }

    /// Returns the binding of the boxes.
    pub fn nodes(&self) -> Binding {
        let count = self.levels.last().map_or(0, |l| l.end);
        Binding::whole(NODES, u64::from(count) * size_of::<BoxNode>() as u64)
    }

    /// Returns the binding of the roots of the curves.
    pub fn roots(&self) -> Binding {
        let bytes = self.curves.len() * size_of::<Roots>();
        Binding::whole(ROOTS_OF, bytes as u64)
    }
}

/// Returns the commands that compute the boxes of a frame: the uploads, and the dispatches that
/// follow them. Both are empty if the boxes are computed already.
pub(super) fn fit(state: &mut State, frame: &Frame) -> [Vec<Command>; 2] {
    let mut uploads = Vec::new();
    if state.hierarchy.curves != frame.curves {
        let (hierarchy, nodes, roots) = Hierarchy::new(frame);
        uploads.push(Command::upload(NODES, &nodes));
        uploads.push(Command::upload(ROOTS_OF, &roots));
        uploads.push(Command::upload(MADE.buffer, &[0u32]));
        state.boxes_made = 0;
        state.hierarchy = hierarchy;
        state.boxes_of = None;
    }
    let hierarchy = &state.hierarchy;
    if state.boxes_of == Some(frame.id) || hierarchy.nodes().size == 0 {
        return [uploads, Vec::new()];
    }
    let own = |nodes: &Range<u32>| Parameters::new(frame.radius, nodes.start, nodes.len() as u32);
    let parameters = hierarchy.levels.iter().map(own);
    uploads.push(Command::parameters(PARAMETERS, parameters));
    let groups = |nodes: &Range<u32>| (nodes.len() as u32).div_ceil(THREADS);
    let fit = |(level, nodes): (u32, &Range<u32>)| Command::Dispatch {
        stage: STAGE,
        bindings: vec![
            Binding::parameters(PARAMETERS, level),
            state.vertices(frame),
            hierarchy.nodes(),
            MADE,
        ],
        groups: groups(nodes),
    };
    let steps = (0..).zip(&hierarchy.levels).map(fit).collect();
    let more: u32 = hierarchy.levels.iter().map(groups).sum();
    state.boxes_made = state.boxes_made.wrapping_add(more);
    [uploads, steps]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(segments: &[u32]) -> Frame {
        let mut frame = Frame::default();
        let mut at = 0;
        for &n in segments {
            let vertices = if n == 0 { 0 } else { n + 1 };
            frame.curves.push(at..at + vertices);
            at += vertices;
        }
        frame
    }

    #[test]
    fn every_segment_is_in_one_box_of_each_level() {
        let segments = [3, 0, 16, 17, 256, 257, 1024, 1025, 40_000];
        let frame = frame(&segments);
        let (hierarchy, nodes, roots) = Hierarchy::new(&frame);
        assert_eq!(hierarchy.levels(), 5);
        assert_eq!(hierarchy.nodes().size, 32 * nodes.len() as u64);
        // Collects the segments below a node and checks that they are in order.
        fn walk(nodes: &[BoxNode], levels: &[Range<u32>], n: u32, seen: &mut Vec<u32>) {
            let node = nodes[n as usize];
            let (level, count) = (node.below / LEVEL, node.below % LEVEL);
            assert!(levels[level as usize].contains(&n) && count > 0);
            for k in node.first..node.first + count {
                match level {
                    0 => seen.push(k),
                    _ => walk(nodes, levels, k, seen),
                }
            }
        }
        for ((range, n), roots) in frame.curves.iter().zip(segments).zip(&roots) {
            assert!(roots.count <= ROOTS && (roots.count == 0) == (n == 0));
            let mut seen = Vec::new();
            for root in roots.first..roots.first + roots.count {
                walk(&nodes, &hierarchy.levels, root, &mut seen);
            }
            assert_eq!(seen, (range.start..range.start + n).collect::<Vec<_>>());
        }
    }
}
