// Crossings of tiles that single precision decides. The proof of the error bounds and the constants
// in capitals are in src/kernels/gpu/crossings.rs. Rows are segments of the upper curve.

struct Undecided {
    pair: u32,
    upper: u32,
    lower: u32,
}

@group(0) @binding(1) var<storage, read> vertices: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> nodes: array<BoxNode>;
@group(0) @binding(3) var<storage, read> tiles: array<NodePair>;
// Sum of the signs of each pair of curves: low half, high half.
@group(0) @binding(4) var<storage, read_write> sums: array<array<atomic<u32>, 2>>;
@group(0) @binding(5) var<storage, read_write> undecided: array<Undecided>;
@group(0) @binding(6) var<storage, read_write> counts: array<atomic<u32>, COUNTS>;

var<workgroup> rows: array<vec3<f32>, LEAF + 1u>;
var<workgroup> columns: array<vec3<f32>, LEAF + 1u>;
var<workgroup> signs: atomic<i32>;
// Number of tests and of crossings of the workgroup.
var<workgroup> work: array<atomic<u32>, 2>;
var<workgroup> total: u32;

// Returns the coordinates in the frame of the projection, whose last axis is the axis of
// projection.
fn seen(p: vec3<f32>, axis: u32) -> vec3<f32> {
    return select(select(p, p.yzx, axis == 0u), p.zxy, axis == 1u);
}

// Returns a determinant and its error bound.
fn side(a: vec2<f32>, b: vec2<f32>, c: vec2<f32>) -> vec2<f32> {
    let p = pinned(a.x - c.x);
    let q = pinned(b.y - c.y);
    let r = pinned(a.y - c.y);
    let s = pinned(b.x - c.x);
    let left = p * q;
    let right = r * s;
    let off = 2.0 * parameters.radius;
    let moved = off * (abs(p) + abs(q) + abs(r) + abs(s) + 2.0 * off);
    return vec2<f32>(left - right, FLAT * (abs(left) + abs(right)) + 1.01 * moved + TINY);
}

// Returns six times the signed volume of a tetrahedron, and its error bound.
fn volume(a: vec3<f32>, b: vec3<f32>, c: vec3<f32>, d: vec3<f32>) -> vec2<f32> {
    let p = pinned3(a - d);
    let q = pinned3(b - d);
    let r = pinned3(c - d);
    let bc = vec2<f32>(q.x * r.y, r.x * q.y);
    let ca = vec2<f32>(r.x * p.y, p.x * r.y);
    let ab = vec2<f32>(p.x * q.y, q.x * p.y);
    let volume = p.z * (bc.x - bc.y) + q.z * (ca.x - ca.y) + r.z * (ab.x - ab.y);
    let permanent = abs(p.z) * (abs(bc.x) + abs(bc.y)) + abs(q.z) * (abs(ca.x) + abs(ca.y))
        + abs(r.z) * (abs(ab.x) + abs(ab.y));
    let off = 6.0 * parameters.radius;
    let u = abs(p.x) + abs(p.y) + abs(p.z) + off;
    let v = abs(q.x) + abs(q.y) + abs(q.z) + off;
    let w = abs(r.x) + abs(r.y) + abs(r.z) + off;
    let moved = off * (u * v + v * w + w * u);
    return vec2<f32>(volume, SOLID * permanent + 1.01 * moved + TINY);
}

// Returns true if both values have the same proven sign.
fn one_side(p: vec2<f32>, q: vec2<f32>) -> bool {
    return (p.x > p.y && q.x > q.y) || (-p.x > p.y && -q.x > q.y);
}

// Outcomes of a test.
const APART = 0u;
const CROSSES = 1u;
const UNDECIDED = 2u;

struct Test {
    outcome: u32,
    sign: i32,
}

// Tests if the first of two segments crosses above the second. The boxes of their projections
// overlap.
fn crossing(a: vec3<f32>, b: vec3<f32>, c: vec3<f32>, d: vec3<f32>) -> Test {
    let c_side = side(a.xy, b.xy, c.xy);
    let d_side = side(a.xy, b.xy, d.xy);
    let a_side = side(c.xy, d.xy, a.xy);
    let b_side = side(c.xy, d.xy, b.xy);
    if one_side(c_side, d_side) || one_side(a_side, b_side) {
        return Test(APART, 0);
    }
    let height = volume(a, b, c, d);
    let sure = abs(c_side.x) > c_side.y && abs(d_side.x) > d_side.y && abs(a_side.x) > a_side.y
        && abs(b_side.x) > b_side.y && abs(height.x) > height.y;
    if !sure {
        return Test(UNDECIDED, 0);
    }
    let left = d_side.x > 0.0;
    if (height.x < 0.0) == left {
        return Test(CROSSES, select(-1, 1, left));
    }
    return Test(APART, 0);
}

// Adds to a count of 64 bits.
fn count64(at: u32, more: u32) {
    let before = atomicAdd(&counts[at], more);
    if before + more < before {
        atomicAdd(&counts[at + 1u], 1u);
    }
}

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) grid: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    if thread == 0u {
        let listed = min(atomicLoad(&counts[TILES]), arrayLength(&tiles));
        total = min(listed, parameters.first + parameters.items);
        atomicStore(&signs, 0);
        atomicStore(&work[0], 0u);
        atomicStore(&work[1], 0u);
    }
    let end = workgroupUniformLoad(&total);
    var tested = 0u;
    var crossed = 0u;
    var done = 0u;
    let first = parameters.first + group.y * grid.x + group.x;
    for (var number = first; number < end; number += grid.x * grid.y) {
        let tile = tiles[number];
        let pair = tile.pair & ((1u << AXIS) - 1u);
        let axis = tile.pair >> AXIS;
        let upper = nodes[tile.first].first;
        let lower = nodes[tile.second].first;
        let upper_count = nodes[tile.first].below;
        let lower_count = nodes[tile.second].below;
        workgroupBarrier();
        for (var k = thread; k <= LEAF; k += THREADS) {
            if k <= upper_count {
                rows[k] = seen(vertices[upper + k].xyz, axis);
            }
            if k <= lower_count {
                columns[k] = seen(vertices[lower + k].xyz, axis);
            }
        }
        workgroupBarrier();
        var sum = 0;
        for (var k = thread; k < LEAF * LEAF; k += THREADS) {
            done += 1u;
            let s = k / LEAF;
            let t = k % LEAF;
            if s >= upper_count || t >= lower_count {
                continue;
            }
            let a = rows[s];
            let b = rows[s + 1u];
            let c = columns[t];
            let d = columns[t + 1u];
            let a_high = max(a, b);
            let c_low = min(c, d);
            // Disjoint in projection, or the upper segment is wholly below.
            if any(beyond3(a_high, c_low)) || any(beyond3(max(c, d), min(a, b)).xy) {
                continue;
            }
            tested += 1u;
            let test = crossing(a, b, c, d);
            if test.outcome == CROSSES {
                sum += test.sign;
                crossed += 1u;
            }
            // Above TOO_MANY the counter is not incremented any more, because it would wrap to 0.
            // No list has that capacity.
            if test.outcome == UNDECIDED && atomicLoad(&counts[OPEN_TESTS]) < TOO_MANY {
                let at = atomicAdd(&counts[OPEN_TESTS], 1u);
                if at < arrayLength(&undecided) {
                    undecided[at] = Undecided(tile.pair, upper + s, lower + t);
                }
            }
        }
        if sum != 0 {
            atomicAdd(&signs, sum);
        }
        workgroupBarrier();
        if thread == 0u {
            let more = widened(atomicExchange(&signs, 0));
            if more.x != 0u {
                let before = atomicAdd(&sums[pair][0], more.x);
                let high = more.y + select(0u, 1u, before + more.x < before);
                if high != 0u {
                    atomicAdd(&sums[pair][1], high);
                }
            }
        }
    }
    if tested > 0u {
        atomicAdd(&work[0], tested);
        atomicAdd(&work[1], crossed);
    }
    workgroupBarrier();
    if thread == 0u {
        count64(TESTS, atomicLoad(&work[0]));
        count64(CROSSINGS, atomicLoad(&work[1]));
        atomicAdd(&counts[DONE], done);
    }
}
