// Boxes around runs of segments, and how two of them lie: src/kernels/gpu/boxes.rs says which there are.

struct BoxNode {
    low: vec3<f32>,
    // Of what is below: vertices at the bottom, else nodes.
    first: u32,
    high: vec3<f32>,
    // How many there are below, and the level times LEVEL.
    below: u32,
}

// Whether two intervals are apart, however the vertices are off.
fn beyond(high: f32, low: f32) -> bool {
    return pinned(low - high) > 2.01 * parameters.radius;
}

fn beyond3(high: vec3<f32>, low: vec3<f32>) -> vec3<bool> {
    return pinned3(low - high) > vec3<f32>(2.01 * parameters.radius);
}
