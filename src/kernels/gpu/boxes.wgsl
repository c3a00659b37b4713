// Bounding boxes of one level, from the vertices or from the level below: see
// src/kernels/gpu/boxes.rs.

@group(0) @binding(1) var<storage, read> vertices: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> nodes: array<BoxNode>;
@group(0) @binding(3) var<storage, read_write> made: atomic<u32>;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) grid: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let k = (group.y * grid.x + group.x) * THREADS + thread;
    if k >= parameters.items {
        return;
    }
    let n = parameters.first + k;
    let first = nodes[n].first;
    let count = nodes[n].below % LEVEL;
    var low: vec3<f32>;
    var high: vec3<f32>;
    if nodes[n].below < LEVEL {
        low = vertices[first].xyz;
        high = low;
        for (var i = 1u; i <= count; i++) {
            let p = vertices[first + i].xyz;
            low = min(low, p);
            high = max(high, p);
        }
    } else {
        low = nodes[first].low;
        high = nodes[first].high;
        for (var i = 1u; i < count; i++) {
            low = min(low, nodes[first + i].low);
            high = max(high, nodes[first + i].high);
        }
    }
    nodes[n].low = low;
    nodes[n].high = high;
    if thread == 0u {
        atomicAdd(&made, 1u);
    }
}
