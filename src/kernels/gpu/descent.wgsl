// Descent by one level in two box hierarchies at once, for all pairs of curves: see
// src/kernels/gpu/descent.rs. Each node pair has FAN * FAN threads.

@group(0) @binding(5) var<storage, read> agenda: array<NodePair>;

var<workgroup> total: u32;

// Returns true if the projections along the axis w overlap and the upper box is not wholly below.
fn may_cross(upper: u32, lower: u32, w: u32) -> bool {
    let upper_below = beyond3(nodes[upper].high, nodes[lower].low);
    let apart = upper_below | beyond3(nodes[lower].high, nodes[upper].low);
    return !(upper_below[w] || apart[(w + 1u) % 3u] || apart[(w + 2u) % 3u]);
}

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) grid: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let level = parameters.items;
    if thread == 0u {
        total = min(atomicLoad(&counts[level]), arrayLength(&agenda));
    }
    if thread < 2u {
        atomicStore(&added[thread], 0u);
    }
    let count = workgroupUniformLoad(&total);
    let each = THREADS / (FAN * FAN);
    let own = thread % (FAN * FAN);
    var done = 0u;
    let stride = grid.x * grid.y * each;
    for (var begin = (group.y * grid.x + group.x) * each; begin < count; begin += stride) {
        let at = begin + thread / (FAN * FAN);
        var crosses = false;
        var item = NodePair(0u, 0u, 0u);
        var place = 0u;
        if at < count {
            item = agenda[at];
            let axis = item.pair >> AXIS;
            let s = nodes[item.first];
            let t = nodes[item.second];
            // The node of the higher level is replaced by its children; both are if the levels are
            // equal.
            let s_splits = s.below / LEVEL >= t.below / LEVEL;
            let t_splits = t.below / LEVEL >= s.below / LEVEL;
            let i = own / FAN;
            let j = own % FAN;
            if i < select(1u, s.below % LEVEL, s_splits)
                && j < select(1u, t.below % LEVEL, t_splits) {
                item.first = select(item.first, s.first + i, s_splits);
                item.second = select(item.second, t.first + j, t_splits);
                crosses = may_cross(item.first, item.second, axis);
            }
        }
        if crosses {
            place = atomicAdd(&added[list_of(item.first, item.second)], 1u);
        }
        reserve(thread, level + 1u);
        if crosses {
            put(list_of(item.first, item.second), place, item);
        }
        done += min(each, count - begin);
    }
    if thread == 0u {
        atomicAdd(&counts[DONE], done);
    }
}
