//! Room for lists that programs write: how long they get, only the adapter finds out.

use super::commands::{Binding, Buffer};
use super::descent::TOO_MANY;
use super::error::Trouble;
use super::layout::NodePair;
use super::{Engine, Tile};

/// Items that there is room for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Room {
    /// Node pairs of a level.
    pub node_pairs: u32,
    /// Tiles.
    pub tiles: u32,
}

impl Room {
    /// At first; more where a frame has shown more.
    pub const START: Room = Room {
        node_pairs: 1 << 20,
        tiles: 1 << 20,
    };

    /// What a program sees of a list of node pairs.
    pub fn agenda(self, buffer: Buffer) -> Binding {
        Binding::whole(
            buffer,
            u64::from(self.node_pairs) * size_of::<NodePair>() as u64,
        )
    }

    /// What a program sees of a list of tiles that are node pairs.
    pub fn tiles(self, buffer: Buffer) -> Binding {
        Binding::whole(buffer, u64::from(self.tiles) * size_of::<NodePair>() as u64)
    }

    /// More room, in buffers of so many bytes; none where there is no more.
    fn grown(self, most: u64) -> Option<Room> {
        let grown = |items: u32, bytes: usize| {
            let limit = (most / bytes as u64).min(u64::from(TOO_MANY) / 2);
            let more = u64::from(items) * 4;
            (more <= limit).then_some(more as u32)
        };
        Some(Room {
            node_pairs: grown(self.node_pairs, size_of::<NodePair>())?,
            tiles: grown(self.tiles, size_of::<Tile>())?,
        })
    }
}

/// Work on some items; none where there was too little room.
type Pass<'a, T, R> = dyn FnMut(&mut Engine, &[T]) -> Result<Option<R>, Trouble> + 'a;

/// Runs a pass on some items, `most` at once: with more room where it had too little; in halves where there is no more. Parts come in order, each with its length; nothing came of an item for which there is too
/// little room by itself.
pub(super) fn in_parts<T, R>(
    engine: &mut Engine,
    asked: &[T],
    most: usize,
    room: fn(&mut Engine) -> &mut Room,
    pass: &mut Pass<'_, T, R>,
) -> Result<Vec<(usize, Option<R>)>, Trouble> {
    if asked.is_empty() {
        return Ok(Vec::new());
    }
    while asked.len() <= most.max(1) {
        if let Some(found) = pass(engine, asked)? {
            return Ok(vec![(asked.len(), Some(found))]);
        }
        let bytes = engine.device.most_bytes();
        match room(engine).grown(bytes) {
            Some(grown) => *room(engine) = grown,
            None if asked.len() == 1 => return Ok(vec![(1, None)]),
            None => break,
        }
    }
    let (first, second) = asked.split_at(asked.len() / 2);
    let mut found = in_parts(engine, first, most, room, pass)?;
    found.extend(in_parts(engine, second, most, room, pass)?);
    Ok(found)
}
