//! Choice of the CPU or of a GPU adapter, and the properties of adapters.

use crate::error::{Error, Result};
use std::fmt;
use std::str::FromStr;

/// Device on which kernels run.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Device {
    /// A GPU if it is predicted to be faster, else the CPU.
    #[default]
    Auto,
    /// The CPU.
    Cpu,
    /// The first adapter of the fastest kind. Software Vulkan counts as an adapter.
    Gpu,
    /// The adapter with this name, or else the one whose name contains this text. No match, or
    /// several, is an error; its message lists the indices.
    Named(String),
    /// The adapter with this index in the list of [`devices`](super::devices).
    Index(usize),
}

impl fmt::Display for Device {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Device::Auto => "auto",
            Device::Cpu => "cpu",
            Device::Gpu => "gpu",
            Device::Named(name) => name,
            Device::Index(index) => return index.fmt(f),
        })
    }
}

impl FromStr for Device {
    type Err = Error;

    fn from_str(s: &str) -> Result<Self> {
        Ok(match s {
            "" => {
                let all = "expected auto, cpu, gpu, or the index or name of an adapter";
                return Err(Error::Usage(all.into()));
            }
            "auto" => Device::Auto,
            "cpu" => Device::Cpu,
            "gpu" => Device::Gpu,
            // A number is never a name, however large, because many names contain `1`.
            text => match text.parse() {
                Ok(index) => Device::Index(index),
                Err(_) => Device::Named(text.into()),
            },
        })
    }
}

/// A GPU adapter and its properties.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
#[non_exhaustive]
pub struct DeviceInfo {
    /// Index of the adapter, for [`Device::Index`]: from 0, the fastest kinds first. It is the same
    /// in every process until an adapter or a driver is added or removed.
    pub index: usize,
    /// Name of the adapter, for [`Device::Named`]. Several adapters may have the same name.
    pub name: String,
    /// Graphics interface: `Vulkan`, `Metal` or `Dx12`.
    pub backend: String,
    /// Kind: `DiscreteGpu`, `IntegratedGpu`, `VirtualGpu`, `Cpu` or `Other`.
    pub kind: String,
    /// Name and version of the driver.
    pub driver: String,
    /// True for a software adapter, which runs on the CPU: its results are right, but it is slow.
    pub software: bool,
    /// True if the adapter computes in double precision.
    pub double_precision: bool,
    /// Maximum size of a buffer in bytes.
    pub max_buffer_bytes: u64,
    /// Maximum size of a storage buffer binding in bytes.
    pub max_binding_bytes: u64,
    /// Reason why the adapter cannot be used; `None` if it can.
    pub unusable: Option<String>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn command_line_words_survive_a_round_trip() {
        for device in [
            Device::Auto,
            Device::Cpu,
            Device::Gpu,
            Device::Named("H100".into()),
            Device::Index(1),
        ] {
            assert_eq!(device.to_string().parse().ok(), Some(device));
        }
        assert!("".parse::<Device>().is_err());
    }
}
