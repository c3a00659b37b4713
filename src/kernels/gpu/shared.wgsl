// Shared parts of all shaders, in both precisions. layout.rs has the same structs in Rust.

struct Parameters {
    radius: f32,
    zero: u32,
    first: u32,
    items: u32,
}

struct Tile {
    pair: u32,
    first_row: u32,
    rows: u32,
    first_column: u32,
    columns: u32,
    padding: array<u32, 3>,
}

// A node pair to visit: a pair of curves, and a node of each.
struct NodePair {
    pair: u32,
    first: u32,
    second: u32,
}

@group(0) @binding(0) var<uniform> parameters: Parameters;

// Returns the same number. `parameters.zero` is 0, but the compiler does not know that, so it can
// neither cancel nor regroup across it.
fn pinned(x: real) -> real {
    return bitcast<real>(bitcast<bits>(x) ^ bits(parameters.zero));
}

fn pinned3(v: vec3<real>) -> vec3<real> {
    return bitcast<vec3<real>>(bitcast<vec3<bits>>(v) ^ vec3<bits>(bits(parameters.zero)));
}

// Integers of 64 bits: low half, high half. Their sums are exact in any order.
fn add64(a: vec2<u32>, b: vec2<u32>) -> vec2<u32> {
    let low = a.x + b.x;
    return vec2<u32>(low, a.y + b.y + select(0u, 1u, low < a.x));
}

fn widened(x: i32) -> vec2<u32> {
    return vec2<u32>(u32(x), u32(x >> 31u));
}

// Converts a number of magnitude at most 2^10 to units of 2^-44, rounded towards 0: the error is
// less than one unit. The whole part and the rest are exact.
//
// On CPUs without AVX-512, `trunc` of the software adapter takes doubles above 2^24 for integers.
// The compiler makes a `trunc` of a conversion to an integer and back, unless it is hidden.
fn fixed64(x: real) -> vec2<u32> {
    let scaled = x * 1048576.0;
    let millionths = bitcast<i32>(bitcast<u32>(i32(scaled)) ^ parameters.zero);
    let rest = i32((scaled - real(millionths)) * 16777216.0);
    return add64(vec2<u32>(u32(millionths) << 24u, u32(millionths >> 8u)), widened(rest));
}
