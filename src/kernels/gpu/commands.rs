//! Commands for an adapter, as a plain list. The stages create them, [`super::device`] executes
//! them.
//!
//! No wgpu type appears here, so a list can be created, printed and tested without an adapter.

use super::error::Error;
use super::layout::Parameters;
use bytemuck::NoUninit;

/// A buffer, named by its contents and its stage. It grows if a command needs more capacity, and is
/// kept for later frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Buffer(pub &'static str, pub &'static str);

/// A stage and its shader. The name is that of the `.rs` file and of the `.wgsl` file.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stage {
    /// Name of the stage.
    pub name: &'static str,
    /// Returns the source of the shader, with the shared parts.
    pub source: fn() -> String,
}

/// A range of a buffer that is bound to a shader.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Binding {
    /// The buffer.
    pub buffer: Buffer,
    /// Offset of the first byte: a multiple of [`ALIGNMENT`].
    pub offset: u64,
    /// Size in bytes.
    pub size: u64,
}

impl Binding {
    /// Binds the first `size` bytes.
    pub const fn whole(buffer: Buffer, size: u64) -> Binding {
        Binding {
            buffer,
            offset: 0,
            size,
        }
    }

    /// Binds entry `k` of the buffer that [`Command::parameters`] writes.
    pub const fn parameters(buffer: Buffer, k: u32) -> Binding {
        Binding {
            buffer,
            offset: k as u64 * ALIGNMENT,
            size: size_of::<Parameters>() as u64,
        }
    }
}

/// Bindings start at multiples of this: the largest alignment that an adapter may require.
pub(crate) const ALIGNMENT: u64 = 256;

/// A single command.
#[derive(Clone, Debug)]
pub(crate) enum Command {
    /// Grows a buffer to this size in bytes, if it is smaller. Growing loses the contents.
    Reserve(Buffer, u64),
    /// Writes bytes to the start of a buffer.
    Upload(Buffer, Vec<u8>),
    /// Fills the first bytes of a buffer with zeros.
    Clear(Buffer, u64),
    /// Runs a shader. The first binding has its parameters.
    Dispatch {
        /// Stage of the shader.
        stage: Stage,
        /// Buffers that the shader accesses, in the order of its bindings.
        bindings: Vec<Binding>,
        /// Number of workgroups.
        groups: u32,
    },
    /// Submits the commands recorded so far, so that no submission takes so long that the system
    /// considers the adapter hung.
    Submit,
    /// Reads the first bytes of a buffer after all previous commands.
    Download(Buffer, u64),
}

impl Command {
    /// Returns a command that writes items to the start of a buffer.
    pub fn upload<T: NoUninit>(buffer: Buffer, items: &[T]) -> Command {
        Command::Upload(buffer, bytemuck::cast_slice(items).to_vec())
    }

    /// Returns a command that writes the parameters of dispatches, each at an offset where a
    /// binding may start.
    pub fn parameters(buffer: Buffer, all: impl IntoIterator<Item = Parameters>) -> Command {
        let mut bytes = Vec::new();
        for own in all {
            bytes.extend_from_slice(bytemuck::bytes_of(&own));
            bytes.resize(bytes.len().next_multiple_of(ALIGNMENT as usize), 0);
        }
        Command::Upload(buffer, bytes)
    }
}

/// Returns a grid of at least `groups` workgroups, because one dimension has at most `limit`.
/// Shaders skip the surplus.
pub(crate) fn grid(groups: u32, limit: u32) -> Result<[u32; 2], Error> {
    let rows = groups.div_ceil(limit.max(1));
    if rows > limit {
        return Err(Error::limit(
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
    fn a_grid_holds_all_groups_within_the_limit() {
        for groups in [1, 7, 65535, 65536, 1 << 20, 1 << 31] {
            let [x, y] = grid(groups, 65535).unwrap();
            assert!(x <= 65535 && y <= 65535);
            assert!(u64::from(x) * u64::from(y) >= u64::from(groups));
        }
        assert!(grid(10, 3).is_err());
    }
}
