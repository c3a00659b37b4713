// The boxes of one level, from the vertices or from the level below: src/kernels/gpu/boxes.rs.

@group(0) @binding(1) var<storage, read> vertices: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> nodes: array<BoxNode>;

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
    if nodes[n].below < LEVEL {
        var low = vertices[first].xyz;
        var high = low;
        for (var i = 1u; i <= count; i++) {
            let p = vertices[first + i].xyz;
            low = min(low, p);
            high = max(high, p);
        }
        nodes[n].low = low;
        nodes[n].high = high;
        return;
    }
    var low = nodes[first].low;
    var high = nodes[first].high;
    for (var i = 1u; i < count; i++) {
        low = min(low, nodes[first + i].low);
        high = max(high, nodes[first + i].high);
    }
    nodes[n].low = low;
    nodes[n].high = high;
}
