// Results of single operations, in either precision; src/kernels/gpu/self_test.rs compares them.

@group(0) @binding(1) var<storage, read> operands: array<vec2<real>>;
@group(0) @binding(2) var<storage, read_write> results: array<real>;
@group(0) @binding(3) var<storage, read_write> halves: array<vec2<u32>>;

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) grid: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let k = (group.y * grid.x + group.x) * 64u + thread;
    if k >= parameters.items {
        return;
    }
    let x = operands[k].x;
    let y = operands[k].y;
    let size = abs(x);
    let difference = pinned(x - y);
    results[8u * k] = x + y;
    results[8u * k + 1u] = difference;
    results[8u * k + 2u] = x * y;
    results[8u * k + 3u] = quotient(x, y);
    results[8u * k + 4u] = inverse_root(size);
    results[8u * k + 5u] = rough_root(size);
    // Differs from y, unless a compiler regroups across the difference.
    results[8u * k + 6u] = x - difference;
    results[8u * k + 7u] = difference * (x + y);
    halves[2u * k] = fixed64(x);
    halves[2u * k + 1u] = add64(fixed64(x), fixed64(y));
}
