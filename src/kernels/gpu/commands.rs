//! What a processor is to do, as a plain list: stages say it, [`super::device`] does it.
//!
//! No type of the graphics interface appears here, so a list can be made, printed and tested without an adapter.

use super::error::Trouble;
use super::layout::Parameters;
use bytemuck::NoUninit;

/// A buffer, by what it holds and for which stage. It grows where a command needs more room, and stays for the frames to come.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Buffer(pub &'static str, pub &'static str);

/// A program: a stage by its name, which is that of its `.rs` and of its `.wgsl` file.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stage {
    /// The name.
    pub name: &'static str,
    /// Its program, with what it shares with others in front.
    pub source: fn() -> String,
}

/// A part of a buffer, as a program sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Binding {
    /// The buffer.
    pub buffer: Buffer,
    /// First byte: a multiple of [`ALIGNMENT`].
    pub offset: u64,
    /// Bytes.
    pub size: u64,
}

impl Binding {
    /// So many bytes from the start.
    pub const fn whole(buffer: Buffer, size: u64) -> Binding {
        Binding {
            buffer,
            offset: 0,
            size,
        }
    }

    /// Number `k` of what [`Command::parameters`] writes.
    pub const fn parameters(buffer: Buffer, k: u32) -> Binding {
        Binding {
            buffer,
            offset: k as u64 * ALIGNMENT,
            size: size_of::<Parameters>() as u64,
        }
    }
}

/// Parts of buffers start at multiples of this: the largest alignment that an adapter may ask for.
pub(crate) const ALIGNMENT: u64 = 256;

/// One step.
#[derive(Clone, Debug)]
pub(crate) enum Command {
    /// Makes room for so many bytes. What was in the buffer is lost where it grows.
    Reserve(Buffer, u64),
    /// Writes bytes to the start of a buffer.
    Upload(Buffer, Vec<u8>),
    /// Fills the first bytes of a buffer with zeros.
    Clear(Buffer, u64),
    /// Runs a program. The first binding is its parameters.
    Dispatch {
        /// The program.
        stage: Stage,
        /// What it reads and writes, in the order of its bindings.
        bindings: Vec<Binding>,
        /// Workgroups.
        groups: u32,
    },
    /// Hands over what is listed so far, so that no piece of work is so long that the system takes the adapter for hung.
    Submit,
    /// Reads the first bytes of a buffer, once everything before is done.
    Download(Buffer, u64),
}

impl Command {
    /// Writes items to the start of a buffer.
    pub fn upload<T: NoUninit>(buffer: Buffer, items: &[T]) -> Command {
        Command::Upload(buffer, bytemuck::cast_slice(items).to_vec())
    }

    /// Writes what dispatches are told, each where a binding may start.
    pub fn parameters(buffer: Buffer, all: &[Parameters]) -> Command {
        let mut bytes = vec![0; all.len() * ALIGNMENT as usize];
        for (own, to) in all.iter().zip(bytes.chunks_mut(ALIGNMENT as usize)) {
            to[..size_of::<Parameters>()].copy_from_slice(bytemuck::bytes_of(own));
        }
        Command::Upload(buffer, bytes)
    }
}

/// Workgroups as a grid, since one dimension has at most `limit`. It may have more than asked for; programs skip the rest.
pub(crate) fn grid(groups: u32, limit: u32) -> Result<[u32; 2], Trouble> {
    let rows = groups.div_ceil(limit.max(1));
    if rows > limit {
        return Err(Trouble::limit(
            "workgroups",
            groups.into(),
            u64::from(limit).pow(2),
        ));
    }
    Ok([groups.min(limit), rows])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_grid_has_room_for_all_groups_within_the_limit() {
        for groups in [1, 7, 65535, 65536, 1 << 20, 1 << 31] {
            let [x, y] = grid(groups, 65535).unwrap();
            assert!(x <= 65535 && y <= 65535);
            assert!(u64::from(x) * u64::from(y) >= u64::from(groups));
        }
        assert!(grid(10, 3).is_err());
    }
}
