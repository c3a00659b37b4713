// Descent by one level in two trees at once, for all pairs of curves. The formulas, the proof of
// the error bounds and the constants in capitals are in src/kernels/gpu/barnes_hut.rs.

struct Node {
    centre: vec3<f32>,
    radius: f32,
    centre_rest: vec3<f32>,
    length: f32,
    second: f32,
    fourth: f32,
    first: u32,
    segments: u32,
    tangents: array<f32, 6>,
    right: u32,
    leaf: u32,
    moments: array<f32, 30>,
    padding: array<u32, 2>,
}

struct Criterion {
    beta: f32,
    share: f32,
}

@group(0) @binding(1) var<storage, read> nodes: array<Node>;
@group(0) @binding(2) var<storage, read> criteria: array<Criterion>;
@group(0) @binding(4) var<storage, read> agenda: array<NodePair>;
@group(0) @binding(5) var<storage, read_write> next: array<NodePair>;
@group(0) @binding(6) var<storage, read_write> tiles: array<Tile>;
// Number of node pairs of each level, and the counters of src/kernels/gpu/counters.rs.
@group(0) @binding(7) var<storage, read_write> counts: array<atomic<u32>, COUNTS>;

// Moments of a node, contracted with the direction, as the expansion needs them.
struct Contracted {
    c: vec3<f32>,
    column_x: vec3<f32>,
    column_y: vec3<f32>,
    column_z: vec3<f32>,
    w: vec3<f32>,
    dr: vec3<f32>,
    wr: vec3<f32>,
    trace: vec3<f32>,
    qrr: vec3<f32>,
}

fn moment3(n: u32, k: u32) -> vec3<f32> {
    return vec3<f32>(nodes[n].moments[k], nodes[n].moments[k + 1u], nodes[n].moments[k + 2u]);
}

// Returns the integral of dr x p, from the rows of the integral of dr_i p_j.
fn antisymmetric(x: vec3<f32>, y: vec3<f32>, z: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(y.z - z.y, z.x - x.z, x.y - y.x);
}

// Returns the moments about the centre, multiplied for each order by the ratio of the radius and
// the distance.
fn contracted(n: u32, r: vec3<f32>, ratio: f32) -> Contracted {
    var out: Contracted;
    out.c = moment3(n, 0u);
    let x = ratio * moment3(n, 3u);
    let y = ratio * moment3(n, 6u);
    let z = ratio * moment3(n, 9u);
    out.column_x = vec3<f32>(x.x, y.x, z.x);
    out.column_y = vec3<f32>(x.y, y.y, z.y);
    out.column_z = vec3<f32>(x.z, y.z, z.z);
    out.w = antisymmetric(x, y, z);
    out.dr = vec3<f32>(dot(x, r), dot(y, r), dot(z, r));
    let square = ratio * ratio;
    var rows: array<vec3<f32>, 3>;
    for (var i = 0u; i < 3u; i++) {
        let same = square * moment3(n, 12u + 6u * i);
        // xy, xz, yz.
        let mixed = square * moment3(n, 15u + 6u * i);
        rows[i] = vec3<f32>(
            same.x * r.x + mixed.x * r.y + mixed.y * r.z,
            mixed.x * r.x + same.y * r.y + mixed.z * r.z,
            mixed.y * r.x + mixed.z * r.y + same.z * r.z,
        );
        out.trace[i] = same.x + same.y + same.z;
        out.qrr[i] = dot(rows[i], r);
    }
    out.wr = antisymmetric(rows[0], rows[1], rows[2]);
    return out;
}

// Returns the expansion for a distance of 1 in the direction r and lengths of 1, times 4 pi.
fn expanded(a: Contracted, b: Contracted, r: vec3<f32>) -> f32 {
    let monopole = dot(r, cross(a.c, b.c)) - dot(b.c, a.w) - dot(a.c, b.w);
    let dipole = cross(a.dr, b.c) - cross(a.c, b.dr);
    let traces = cross(a.trace, b.c) + cross(a.c, b.trace);
    let columns = cross(a.column_x, b.column_x) + cross(a.column_y, b.column_y)
        + cross(a.column_z, b.column_z);
    let twice = cross(a.qrr, b.c) + cross(a.c, b.qrr);
    return monopole - 3.0 * dot(r, dipole)
        + 3.0 * (dot(b.c, a.wr) - dot(a.c, b.wr) + dot(r, columns)
            - dot(a.w, b.dr) + dot(b.w, a.dr))
        - 1.5 * dot(r, traces) + 7.5 * dot(r, twice) - 15.0 * dot(r, cross(a.dr, b.dr));
}

// Returns an upper bound of the root mean square of the sine between the tangents of two nodes.
fn parallel(a: u32, b: u32) -> f32 {
    var cosines = 0.0;
    for (var k = 0u; k < 3u; k++) {
        cosines += nodes[a].tangents[k] * nodes[b].tangents[k]
            + 2.0 * nodes[a].tangents[k + 3u] * nodes[b].tangents[k + 3u];
    }
    return sqrt(clamp(1.0 - cosines + PARALLEL, 0.0, 1.0));
}

// Number of node pairs that the workgroup processed.
var<workgroup> done: atomic<u32>;

struct Running {
    pair: u32,
    value: vec2<u32>,
    bound: vec2<u32>,
    size: vec2<u32>,
    // Number of node pairs since the last flush.
    visited: u32,
}

fn flush(r: Running) {
    if r.visited == 0u {
        return;
    }
    let at = r.pair * WORDS;
    add96(at + VALUE, r.value);
    add96(at + BOUND, r.bound);
    add96(at + SIZE, r.size);
}

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) grid: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    if thread == 0u {
        atomicStore(&done, 0u);
    }
    workgroupBarrier();
    let level = parameters.items;
    let count = min(atomicLoad(&counts[level]), arrayLength(&agenda));
    let threads = grid.x * grid.y * THREADS;
    var running: Running;
    var own = 0u;
    for (var k = (group.y * grid.x + group.x) * THREADS + thread; k < count; k += threads) {
        own += 1u;
        let item = agenda[k];
        if item.pair != running.pair || running.visited >= RUN {
            flush(running);
            running = Running(item.pair, vec2<u32>(), vec2<u32>(), vec2<u32>(), 0u);
        }
        running.visited += 1u;
        let t = item.first;
        let u = item.second;
        let apart = pinned3(nodes[t].centre - nodes[u].centre)
            + pinned3(nodes[t].centre_rest - nodes[u].centre_rest);
        let square = dot(apart, apart);
        let inverse = inverseSqrt(max(square, NEAREST_SQUARE));
        let a = nodes[t].radius * inverse;
        let b = nodes[u].radius * inverse;
        let q = a + b;
        var accepted = false;
        if square > NEAREST_SQUARE && q < WIDEST && 1.0 > criteria[item.pair].beta * q
            && (1.0 - q) > REACH * parameters.radius * inverse {
            // Means over both nodes, in units of the distance.
            let second = a * a * nodes[t].second + b * b * nodes[u].second;
            let fourth = sqrt(a * a * a * a * nodes[t].fourth + b * b * b * b * nodes[u].fourth
                + 6.0 * a * a * b * b * nodes[t].second * nodes[u].second);
            let sine = parallel(t, u);
            let w3 = fourth * min(sqrt(second), sine * q);
            let w4 = fourth * min(fourth, sine * q * q);
            let series = 4.0 * w3 + w4 * (5.0 - 4.0 * q) / ((1.0 - q) * (1.0 - q));
            let scale = SPHERE * (nodes[t].length * inverse) * (nodes[u].length * inverse);
            let tail = OUTWARD * scale * series;
            let size = scale * (1.0 + q * (4.0 + 12.0 * q));
            if tail <= criteria[item.pair].share && tail < LARGEST && size < LARGEST {
                accepted = true;
                let r = apart * inverse;
                let value = scale * expanded(contracted(t, r, a), contracted(u, r, b), r);
                running.value = add64(running.value, fixed64(value));
                let rounding = fixed64(tail + OUTWARD * ROUNDING * size);
                running.bound = add64(running.bound, add64(rounding, vec2<u32>(4u, 0u)));
                running.size = add64(running.size, fixed64(ROUNDING * size));
            }
        }
        if accepted {
            continue;
        }
        let t_leaf = nodes[t].leaf > 0u;
        let u_leaf = nodes[u].leaf > 0u;
        if t_leaf && u_leaf {
            // Above TOO_MANY the counter is not incremented any more, because it would wrap to 0.
            if atomicLoad(&counts[TILES]) >= TOO_MANY {
                continue;
            }
            let at = atomicAdd(&counts[TILES], 1u);
            if at < arrayLength(&tiles) {
                tiles[at] = Tile(
                    item.pair,
                    nodes[t].first, nodes[t].segments,
                    nodes[u].first, nodes[u].segments,
                    array<u32, 3>(),
                );
            }
            continue;
        }
        // The larger node is replaced by its children.
        let at = atomicAdd(&counts[level + 1u], 2u);
        if at + 1u < arrayLength(&next) {
            if u_leaf || (!t_leaf && nodes[t].radius > nodes[u].radius) {
                next[at] = NodePair(item.pair, t + 1u, u);
                next[at + 1u] = NodePair(item.pair, nodes[t].right, u);
            } else {
                next[at] = NodePair(item.pair, t, u + 1u);
                next[at + 1u] = NodePair(item.pair, t, nodes[u].right);
            }
        }
    }
    flush(running);
    if own > 0u {
        atomicAdd(&done, own);
    }
    workgroupBarrier();
    if thread == 0u {
        atomicAdd(&counts[DONE], atomicLoad(&done));
    }
}
