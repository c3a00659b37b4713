// Choice of the direction of projection of each pair of curves, and the initial node pairs: see
// src/kernels/gpu/directions.rs. Each pair of curves has a workgroup.

struct Roots {
    first: u32,
    count: u32,
}

@group(0) @binding(5) var<storage, read> roots: array<Roots>;
@group(0) @binding(6) var<storage, read> pairs: array<vec2<u32>>;

// Number of node pairs that remain in each direction.
var<workgroup> left: array<atomic<u32>, 6>;
var<workgroup> chosen: u32;

// Returns the mask of the directions in which two nodes may cross: bit 2 w for axis w with the
// first node above, bit 2 w + 1 with the second node above.
fn directions(a: u32, b: u32) -> u32 {
    let a_below = beyond3(nodes[a].high, nodes[b].low);
    let b_below = beyond3(nodes[b].high, nodes[a].low);
    let apart = a_below | b_below;
    var mask = 0u;
    for (var w = 0u; w < 3u; w++) {
        if !(apart[(w + 1u) % 3u] || apart[(w + 2u) % 3u]) {
            mask |= select(1u, 0u, a_below[w]) << (2u * w);
            mask |= select(2u, 0u, b_below[w]) << (2u * w);
        }
    }
    return mask;
}

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) grid: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let number = group.y * grid.x + group.x;
    if number >= parameters.items {
        return;
    }
    if thread < 6u {
        atomicStore(&left[thread], 0u);
    }
    if thread < 2u {
        atomicStore(&added[thread], 0u);
    }
    workgroupBarrier();
    let a = roots[pairs[number].x];
    let b = roots[pairs[number].y];
    var masks: array<u32, SHARE>;
    for (var k = 0u; k < SHARE; k++) {
        let at = k * THREADS + thread;
        if at < a.count * b.count {
            masks[k] = directions(a.first + at / b.count, b.first + at % b.count);
        }
    }
    for (var d = 0u; d < 6u; d++) {
        var own = 0u;
        for (var k = 0u; k < SHARE; k++) {
            own += (masks[k] >> d) & 1u;
        }
        if own > 0u {
            atomicAdd(&left[d], own);
        }
    }
    workgroupBarrier();
    if thread == 0u {
        var best = 0u;
        for (var d = 1u; d < 6u; d++) {
            if atomicLoad(&left[d]) < atomicLoad(&left[best]) {
                best = d;
            }
        }
        if atomicLoad(&left[best]) == 0u {
            atomicAdd(&counts[SEPARATED], 1u);
        }
        chosen = best;
    }
    let direction = workgroupUniformLoad(&chosen);
    let axis = direction / 2u;
    let second_over = direction % 2u > 0u;
    var places_of: array<u32, SHARE>;
    for (var k = 0u; k < SHARE; k++) {
        let at = k * THREADS + thread;
        if ((masks[k] >> direction) & 1u) > 0u {
            let list = list_of(a.first + at / b.count, b.first + at % b.count);
            places_of[k] = atomicAdd(&added[list], 1u);
        }
    }
    reserve(thread, 0u);
    for (var k = 0u; k < SHARE; k++) {
        let at = k * THREADS + thread;
        if ((masks[k] >> direction) & 1u) > 0u {
            let s = a.first + at / b.count;
            let t = b.first + at % b.count;
            let node_pair = NodePair(
                number | (axis << AXIS),
                select(s, t, second_over),
                select(t, s, second_over),
            );
            put(list_of(s, t), places_of[k], node_pair);
        }
    }
    if thread == 0u {
        atomicAdd(&counts[DONE], 1u);
    }
}
