// Crossings of tiles, as far as single precision decides: src/kernels/gpu/crossings.rs has the proof of the bounds. Constants
// in capitals come from there. Rows are segments of the curve that counts when on top.

struct CrossingSum {
    signs: array<atomic<u32>, 2>,
    crossings: atomic<u32>,
    tests: atomic<u32>,
}

struct Undecided {
    pair: u32,
    upper: u32,
    lower: u32,
}

@group(0) @binding(1) var<storage, read> vertices: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> tiles: array<Tile>;
@group(0) @binding(3) var<storage, read_write> sums: array<CrossingSum>;
@group(0) @binding(4) var<storage, read_write> undecided: array<Undecided>;
@group(0) @binding(5) var<storage, read_write> found: atomic<u32>;

var<workgroup> rows: array<vec3<f32>, BLOCK + 1u>;
var<workgroup> columns: array<vec3<f32>, BLOCK + 1u>;
var<workgroup> signs: atomic<i32>;
var<workgroup> crossings: atomic<u32>;
var<workgroup> tests: atomic<u32>;

// The coordinates in the frame of the projection, whose axis is the last.
fn seen(p: vec3<f32>, axis: u32) -> vec3<f32> {
    return select(select(p, p.yzx, axis == 0u), p.zxy, axis == 1u);
}

// A determinant and the bound of its error.
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

// Six times the signed volume of a tetrahedron, and the bound of its error.
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

// Whether two intervals are apart, however the vertices are off.
fn beyond(high: f32, low: f32) -> bool {
    return pinned(low - high) > 2.01 * parameters.radius;
}

// Both surely on one side.
fn one_side(p: vec2<f32>, q: vec2<f32>) -> bool {
    return (p.x > p.y && q.x > q.y) || (-p.x > p.y && -q.x > q.y);
}

@compute @workgroup_size(BLOCK)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) grid: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let number = group.y * grid.x + group.x;
    var tile = Tile(0u, 0u, 0u, 0u, 0u, 0u, vec2<u32>());
    if number < parameters.items {
        tile = tiles[number];
    }
    if thread == 0u {
        atomicStore(&signs, 0);
        atomicStore(&crossings, 0u);
        atomicStore(&tests, 0u);
    }
    for (var k = thread; k <= tile.rows; k += BLOCK) {
        rows[k] = seen(vertices[tile.first_row + k].xyz, tile.axis);
    }
    for (var k = thread; k <= tile.columns; k += BLOCK) {
        columns[k] = seen(vertices[tile.first_column + k].xyz, tile.axis);
    }
    workgroupBarrier();
    var sum = 0;
    var crossed = 0u;
    var tested = 0u;
    for (var k = thread; k < tile.rows * tile.columns; k += BLOCK) {
        let s = k / tile.columns;
        let t = k % tile.columns;
        let a = rows[s];
        let b = rows[s + 1u];
        let c = columns[t];
        let d = columns[t + 1u];
        let a_low = min(a, b);
        let a_high = max(a, b);
        let c_low = min(c, d);
        let c_high = max(c, d);
        // Shadows apart, or the upper one wholly below.
        if beyond(a_high.x, c_low.x) || beyond(c_high.x, a_low.x) || beyond(a_high.y, c_low.y)
            || beyond(c_high.y, a_low.y) || beyond(a_high.z, c_low.z) {
            continue;
        }
        tested += 1u;
        let c_side = side(a.xy, b.xy, c.xy);
        let d_side = side(a.xy, b.xy, d.xy);
        let a_side = side(c.xy, d.xy, a.xy);
        let b_side = side(c.xy, d.xy, b.xy);
        if one_side(c_side, d_side) || one_side(a_side, b_side) {
            continue;
        }
        let height = volume(a, b, c, d);
        let sure = abs(c_side.x) > c_side.y && abs(d_side.x) > d_side.y && abs(a_side.x) > a_side.y
            && abs(b_side.x) > b_side.y && abs(height.x) > height.y;
        if !sure {
            // No list has room for so many, and the count must not come back to 0.
            if atomicLoad(&found) >= TOO_MANY {
                continue;
            }
            let at = atomicAdd(&found, 1u);
            if at < parameters.capacity {
                undecided[at] = Undecided(tile.pair, tile.first_row + s, tile.first_column + t);
            }
            continue;
        }
        let left = d_side.x > 0.0;
        if (height.x < 0.0) == left {
            sum += select(-1, 1, left);
            crossed += 1u;
        }
    }
    if tested > 0u {
        atomicAdd(&signs, sum);
        atomicAdd(&crossings, crossed);
        atomicAdd(&tests, tested);
    }
    workgroupBarrier();
    if thread == 0u {
        let tested_all = atomicLoad(&tests);
        if tested_all > 0u {
            let total = widened(atomicLoad(&signs));
            if total.x != 0u {
                let before = atomicAdd(&sums[tile.pair].signs[0], total.x);
                atomicAdd(&sums[tile.pair].signs[1], total.y + select(0u, 1u, before + total.x < before));
            }
            atomicAdd(&sums[tile.pair].crossings, atomicLoad(&crossings));
            atomicAdd(&sums[tile.pair].tests, tested_all);
        }
    }
}
