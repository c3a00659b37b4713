// Lists of node pairs: those to look into next, and those of the bottom, which are tiles. src/kernels/gpu/descent.rs has the
// words.

// What to look into: a pair of curves and two of their nodes, the one that counts when on top first. The axis of
// projection is in the highest bits of the pair.
struct NodePair {
    pair: u32,
    first: u32,
    second: u32,
}

@group(0) @binding(1) var<storage, read> nodes: array<BoxNode>;
@group(0) @binding(2) var<storage, read_write> next: array<NodePair>;
@group(0) @binding(3) var<storage, read_write> tiles: array<NodePair>;
@group(0) @binding(4) var<storage, read_write> counts: array<atomic<u32>, COUNTS>;

// Of this workgroup, node pairs to look into and tiles: how many, and where they go.
var<workgroup> added: array<atomic<u32>, 2>;
var<workgroup> places: array<u32, 2>;

// Which of the lists two nodes belong to: 1 is that of tiles.
fn list_of(first: u32, second: u32) -> u32 {
    return select(0u, 1u, nodes[first].below < LEVEL && nodes[second].below < LEVEL);
}

// Makes room in both lists for what the workgroup has added: all of its threads at once.
fn reserve(thread: u32, level: u32) {
    workgroupBarrier();
    if thread < 2u {
        let count = atomicExchange(&added[thread], 0u);
        let counter = select(TILES, level, thread == 0u);
        var place = 0xffffffffu;
        // Beyond all room, and the count must not come back to 0.
        if count > 0u && atomicLoad(&counts[counter]) < TOO_MANY {
            place = atomicAdd(&counts[counter], count);
        }
        places[thread] = place;
    }
    workgroupBarrier();
}

// Writes what was added as number `own` of a list, where there is room.
fn put(list: u32, own: u32, item: NodePair) {
    let place = places[list];
    if place >= TOO_MANY {
        return;
    }
    if list == 1u {
        if place + own < arrayLength(&tiles) {
            tiles[place + own] = item;
        }
    } else if place + own < arrayLength(&next) {
        next[place + own] = item;
    }
}
