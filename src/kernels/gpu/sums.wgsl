// Sums of 96 bits in a list of words: low, middle, high.

@group(0) @binding(3) var<storage, read_write> sums: array<atomic<u32>>;

// Adds a signed number of 64 bits. Each carry is computed from the previous value of a word, so the
// sum is right in any order of the concurrent additions.
fn add96(at: u32, v: vec2<u32>) {
    let low = atomicAdd(&sums[at], v.x);
    let carry = select(0u, 1u, low + v.x < low);
    let middle = v.y + carry;
    let before = atomicAdd(&sums[at + 1u], middle);
    let carried = select(0u, 1u, before + middle < before || middle < carry);
    let high = select(0u, 0xffffffffu, (v.y >> 31u) > 0u) + carried;
    if high != 0u {
        atomicAdd(&sums[at + 2u], high);
    }
}
