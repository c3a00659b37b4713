// Lists of node pairs: those to visit next, and those of the lowest level, which are tiles. The
// constants are defined in src/kernels/gpu/descent.rs and counters.rs. Of a node pair, the node of
// the upper curve comes first, and the axis of projection is in the highest bits of the pair.

@group(0) @binding(1) var<storage, read> nodes: array<BoxNode>;
@group(0) @binding(2) var<storage, read_write> next: array<NodePair>;
@group(0) @binding(3) var<storage, read_write> tiles: array<NodePair>;
@group(0) @binding(4) var<storage, read_write> counts: array<atomic<u32>, COUNTS>;

// Number of node pairs and of tiles that this workgroup appends, and their first indices in the
// lists.
var<workgroup> added: array<atomic<u32>, 2>;
var<workgroup> places: array<u32, 2>;

// Returns the list that two nodes belong to: 0 for node pairs, 1 for tiles.
fn list_of(first: u32, second: u32) -> u32 {
    return select(0u, 1u, nodes[first].below < LEVEL && nodes[second].below < LEVEL);
}

// Reserves space in both lists for the items of the workgroup. All of its threads must call it.
fn reserve(thread: u32, level: u32) {
    workgroupBarrier();
    if thread < 2u {
        let count = atomicExchange(&added[thread], 0u);
        let counter = select(TILES, level, thread == 0u);
        var place = 0xffffffffu;
        // Above TOO_MANY the counter is not incremented any more, because it would wrap to 0.
        if count > 0u && atomicLoad(&counts[counter]) < TOO_MANY {
            place = atomicAdd(&counts[counter], count);
        }
        places[thread] = place;
    }
    workgroupBarrier();
}

// Writes item number `own` of the workgroup to a list, if the list has the capacity.
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
