// Gauss sum of tiles, in either precision. The formulas, the proof of the error bounds and the
// constants in capitals that are not defined here are in src/kernels/gpu/direct.rs.

@group(0) @binding(1) var<storage, read> vertices: array<vec4<real>>;
@group(0) @binding(2) var<storage, read> tiles: array<Tile>;

// Number of tiles of a workgroup. Each tile has ROWS threads, one for each row.
const SLOTS = THREADS / ROWS;
// Number of vertices of the columns that are loaded at once: one more than segments.
const STRIDE = COLUMNS + 1u;

var<workgroup> columns: array<vec3<real>, SLOTS * STRIDE>;
var<workgroup> values: array<vec2<u32>, THREADS>;
var<workgroup> bounds: array<vec2<u32>, THREADS>;
// Counts of each thread: undecided segment pairs, pairs that may meet, and processed pairs.
var<workgroup> counts: array<vec3<u32>, THREADS>;

// Returns atan(y / x), the argument of a complex number of the upper half plane, for x of any sign.
// The relative error is at most 16 u.
fn argument(x: real, y: real) -> real {
    let size = abs(x);
    let small = min(size, y);
    let large = max(size, y);
    // Tangents above 1/3 are rotated back by atan(1/2).
    let over = 3.0 * small > large;
    let top = select(small, pinned(2.0 * small) - large, over);
    let bottom = select(large, 2.0 * large + small, over);
    let t = quotient(top, bottom);
    let eighth = select(0.0, ATAN_HALF, over) + t * arctangent_series(t * t);
    let quarter = select(eighth, HALF_PI - eighth, y > size);
    return select(quarter, PI - quarter, x < 0.0);
}

// Returns the largest gap along the axes between the boxes of two segments.
fn gap(a0: vec3<real>, a1: vec3<real>, b0: vec3<real>, b1: vec3<real>) -> real {
    let above = pinned3(min(a0, a1)) - pinned3(max(b0, b1));
    let below = pinned3(min(b0, b1)) - pinned3(max(a0, a1));
    let each = max(above, below);
    return max(each.x, max(each.y, each.z));
}

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) grid: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let slot = thread / ROWS;
    let lane = thread % ROWS;
    let number = (group.y * grid.x + group.x) * SLOTS + slot;
    let here = number < parameters.items;
    var tile: Tile;
    if here {
        tile = tiles[number];
    }
    let works = lane < tile.rows;
    var k0 = vec3<real>();
    var k1 = vec3<real>();
    if works {
        k0 = vertices[tile.first_row + lane].xyz;
        k1 = vertices[tile.first_row + lane + 1u].xyz;
    }
    let e = pinned3(k1 - k0);
    let e_length = rough_root(dot(e, e)) + TINY_LENGTH;
    var value = vec2<u32>();
    var bound = vec2<u32>();
    var doubts = 0u;
    var near = 0u;
    var done = 0u;

    for (var step = 0u; step < STEPS; step++) {
        let begin = step * COLUMNS;
        let end = min(begin + COLUMNS, max(tile.columns, begin));
        let count = end - begin;
        workgroupBarrier();
        for (var j = lane; j <= count && begin < tile.columns; j += ROWS) {
            columns[slot * STRIDE + j] = vertices[tile.first_column + begin + j].xyz;
        }
        workgroupBarrier();
        if works && count > 0u {
            var sum: real = 0.0;
            var error: real = 0.0;
            var l0 = columns[slot * STRIDE];
            // Differences, the squares of their lengths, the inverses of the lengths, and the unit
            // vectors.
            let first_a = pinned3(l0 - k0);
            let first_b = pinned3(l0 - k1);
            var aa = dot(first_a, first_a);
            var bb = dot(first_b, first_b);
            var ia = inverse_root(max(aa, TINY_SQUARE));
            var ib = inverse_root(max(bb, TINY_SQUARE));
            var a = first_a * ia;
            var b = first_b * ib;
            var ab = dot(a, b);
            var j = 0u;
            for (; j < count; j++) {
                let l1 = columns[slot * STRIDE + j + 1u];
                let long_c = pinned3(l1 - k1);
                let long_d = pinned3(l1 - k0);
                let f = pinned3(l1 - l0);
                let cc = dot(long_c, long_c);
                let dd = dot(long_d, long_d);
                let ic = inverse_root(max(cc, TINY_SQUARE));
                let id = inverse_root(max(dd, TINY_SQUARE));
                let c = long_c * ic;
                let d = long_d * id;
                let cd = dot(c, d);
                let ac = dot(a, c);
                let d1 = 1.0 + ab + dot(b, c) + ac;
                let d2 = 1.0 + dot(a, d) + cd + ac;
                let crossed = cross(f, e);
                let q = dot(a, crossed) * ic;
                let size = abs(q);
                let w = ib * d2 + id * d1;
                let x = d1 * d2 - q * q * ib * id;
                let y = size * max(w, 0.0);

                let inverse = ib + id;
                let m = min(max(d1, size * ib), max(d2, size * id));
                let edges = e_length * (rough_root(dot(f, f)) + TINY_LENGTH);
                let lever = inverse * (LEVER * edges * ic + HEIGHT * size) + CORNERS;
                let clear = min(min(aa, bb), min(cc, dd)) > TINY_SQUARE;
                let certain = clear && lever * UNIT_ERROR <= DOUBT * m;
                if certain {
                    let over = quotient(1.0, m);
                    let size_of_angle = argument(x, y);
                    sum += select(size_of_angle, -size_of_angle, q < 0.0);
                    let off = inverse * over * (SPAN * edges * ic + (TURN + TILT * over) * size);
                    // A decided angle is off by less than 1, and the fixed-point sum cannot hold
                    // larger bounds.
                    error += min(off, MOST) + abs(sum);
                } else {
                    doubts += 1u;
                }
                if parameters.radius > 0.0 {
                    let reach = REACH * real(parameters.radius);
                    let aside = size > edges * ic * (reach * ia + SKEW);
                    let apart = gap(k0, k1, l0, l1) > reach;
                    if !(clear && (aside || apart)) {
                        near += 1u;
                    }
                }
                l0 = l1;
                aa = dd;
                bb = cc;
                ia = id;
                ib = ic;
                a = d;
                b = c;
                ab = cd;
            }
            done += j;
            value = add64(value, fixed64(sum));
            // Rounded up by more than the rounding errors of both conversions to fixed point and of
            // this sum.
            bound = add64(bound, add64(fixed64(error * ROUNDED_UP), vec2<u32>(8u, 0u)));
        }
    }

    values[thread] = value;
    bounds[thread] = bound;
    counts[thread] = vec3<u32>(doubts, near, done);
    for (var half = ROWS / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if lane < half {
            values[thread] = add64(values[thread], values[thread + half]);
            bounds[thread] = add64(bounds[thread], bounds[thread + half]);
            counts[thread] += counts[thread + half];
        }
    }
    if lane == 0u && here {
        let at = tile.pair * WORDS;
        add96(at + VALUE, values[thread]);
        add96(at + BOUND, bounds[thread]);
        let more = counts[thread].x;
        // A driver may leave a loop early.
        var unknown = counts[thread].y > 0u || counts[thread].z != tile.rows * tile.columns;
        if more > 0u {
            // If the count of undecided pairs exceeds 32 bits, nothing is known of the pair.
            let before = atomicAdd(&sums[at + DOUBTS], more);
            unknown = unknown || before + more < before;
        }
        if unknown {
            // A flag, not a count, which might wrap to 0.
            atomicMax(&sums[at + NEAR], 1u);
        }
        atomicAdd(&sums[arrayLength(&sums) - 1u], 1u);
    }
}
