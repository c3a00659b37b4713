//! Capacity of the lists that shaders write. Only the adapter finds out how long they get.

use super::commands::{Binding, Buffer};
use super::counters::TOO_MANY;
use super::error::Error;
use super::layout::NodePair;
use super::{State, Tile};

/// Size of a node pair in bytes.
const NODE_PAIR: u64 = size_of::<NodePair>() as u64;

/// Number of items that the lists can hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Capacity {
    /// Node pairs of a level.
    pub node_pairs: u32,
    /// Number of tiles.
    pub tiles: u32,
}

impl Capacity {
    /// Initial capacity. It grows if a frame needs more.
    pub const START: Capacity = Capacity {
        node_pairs: 1 << 20,
        tiles: 1 << 20,
    };

    /// Returns the binding of a list of node pairs.
    pub fn agenda(self, buffer: Buffer) -> Binding {
        Binding::whole(buffer, u64::from(self.node_pairs) * NODE_PAIR)
    }

    /// Returns the binding of a list of tiles that are node pairs.
    pub fn tiles(self, buffer: Buffer) -> Binding {
        Binding::whole(buffer, u64::from(self.tiles) * NODE_PAIR)
    }

    /// Returns a larger capacity, for buffers of at most `most` bytes. Returns `None` at the limit.
    fn grown(self, most: u64) -> Option<Capacity> {
        let grown = |items: u32, bytes: usize| {
            let limit = (most / bytes as u64).min(u64::from(TOO_MANY) / 2);
            let more = u64::from(items) * 4;
            (more <= limit).then_some(more as u32)
        };
        Some(Capacity {
            node_pairs: grown(self.node_pairs, size_of::<NodePair>())?,
            tiles: grown(self.tiles, size_of::<Tile>())?,
        })
    }
}

/// Processes some items; returns `None` if the capacity was too small.
type Pass<'a, T, R> = dyn FnMut(&mut State, &[T]) -> Result<Option<R>, Error> + 'a;

/// Runs a pass on batches of at most `most` items. If the capacity was too small, the lists are
/// grown and the batch is repeated; at the limit of the adapter the batch is halved. Returns the
/// results in order, each with the length of its batch; `None` for an item for which the capacity
/// is too small even alone.
pub(super) fn in_batches<T, R>(
    state: &mut State,
    asked: &[T],
    most: usize,
    capacity: fn(&mut State) -> &mut Capacity,
    pass: &mut Pass<'_, T, R>,
) -> Result<Vec<(usize, Option<R>)>, Error> {
    if asked.is_empty() {
        return Ok(Vec::new());
    }
    while asked.len() <= most.max(1) {
        if let Some(found) = pass(state, asked)? {
            return Ok(vec![(asked.len(), Some(found))]);
        }
        let bytes = state.adapter.max_buffer_bytes;
        match capacity(state).grown(bytes) {
            Some(grown) => *capacity(state) = grown,
            None if asked.len() == 1 => return Ok(vec![(1, None)]),
            None => break,
        }
    }
    let (first, second) = asked.split_at(asked.len() / 2);
    let mut found = in_batches(state, first, most, capacity, pass)?;
    found.extend(in_batches(state, second, most, capacity, pass)?);
    Ok(found)
}
