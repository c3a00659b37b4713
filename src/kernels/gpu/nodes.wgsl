// Bounding boxes of runs of segments and their comparison. src/kernels/gpu/boxes.rs describes the
// hierarchy.

struct BoxNode {
    low: vec3<f32>,
    // First child: a vertex at the bottom, else a node.
    first: u32,
    high: vec3<f32>,
    // Number of children, plus the level times LEVEL.
    below: u32,
}

// Returns for each axis true if two intervals are disjoint for all positions of the vertices within
// the radius.
fn beyond3(high: vec3<f32>, low: vec3<f32>) -> vec3<bool> {
    return pinned3(low - high) > vec3<f32>(2.01 * parameters.radius);
}
