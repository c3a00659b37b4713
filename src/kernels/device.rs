//! Choice of the CPU or of a GPU adapter, and the list of the adapters.

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
    /// The adapter with this index in the list of [`devices`].
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

#[cfg_attr(
    not(any(feature = "gpu", test)),
    expect(dead_code, reason = "this build lists no adapters")
)]
impl Device {
    /// Returns the index of the chosen adapter in `all`, whose order is that of the indices.
    /// Returns the first one if the choice admits any adapter.
    ///
    /// Errors: a message, if no adapter or more than one matches.
    pub(crate) fn choose(&self, all: &[DeviceInfo]) -> Result<usize, String> {
        if all.is_empty() {
            return Err("no adapter found (Vulkan, Metal or DX12)".into());
        }
        let list = |indices: &mut dyn Iterator<Item = usize>| {
            let names = indices.map(|k| format!("{k}: {} ({})", all[k].name, all[k].backend));
            names.collect::<Vec<_>>().join(", ")
        };
        let there_are = || format!("there are: {}", list(&mut (0..all.len())));
        let words = match self {
            Device::Auto | Device::Cpu | Device::Gpu => return Ok(0),
            Device::Index(index) if *index < all.len() => return Ok(*index),
            Device::Index(index) => return Err(format!("no adapter {index}; {}", there_are())),
            Device::Named(words) => words.to_lowercase(),
        };
        let with = |fits: &dyn Fn(&str) -> bool| -> Vec<usize> {
            let fits = |k: &usize| fits(&all[*k].name.to_lowercase());
            (0..all.len()).filter(fits).collect()
        };
        let mut found = with(&|name| name == words);
        if found.is_empty() {
            found = with(&|name| name.contains(&words));
        }
        match found[..] {
            [one] => Ok(one),
            [] => Err(format!("no adapter is called {self}; {}", there_are())),
            _ => Err(format!(
                "several adapters are called {self}; give the index of one: {}",
                list(&mut found.into_iter())
            )),
        }
    }
}

/// A GPU adapter and its properties.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
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

/// Returns all adapters. Opens each of them and tests its arithmetic.
pub fn devices() -> Vec<DeviceInfo> {
    #[cfg(feature = "gpu")]
    return super::gpu::devices();
    #[cfg(not(feature = "gpu"))]
    Vec::new()
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

    fn adapters(names: &[(&str, &str)]) -> Vec<DeviceInfo> {
        let names = names.iter().enumerate();
        let info = |(index, &(name, backend)): (usize, &(&str, &str))| DeviceInfo {
            index,
            name: name.into(),
            backend: backend.into(),
            kind: "DiscreteGpu".into(),
            driver: "1".into(),
            software: false,
            double_precision: true,
            max_buffer_bytes: 1 << 30,
            max_binding_bytes: 1 << 30,
            unusable: None,
        };
        names.map(info).collect()
    }

    fn choose(all: &[DeviceInfo], text: &str) -> Result<usize, String> {
        text.parse::<Device>().unwrap().choose(all)
    }

    #[test]
    fn an_exact_name_wins_over_a_longer_name() {
        let names = ["RTX 3080 Ti", "RTX 3080", "llvmpipe"].map(|name| (name, "Vulkan"));
        let all = adapters(&names);
        assert_eq!(choose(&all, "RTX 3080"), Ok(1));
        assert_eq!(choose(&all, "rtx 3080 ti"), Ok(0));
        assert_eq!(choose(&all, "pipe"), Ok(2));
        assert_eq!(choose(&all, "gpu"), Ok(0));
        let none = "no adapter is called RTX 4090; there are: 0: RTX 3080 Ti (Vulkan), \
                    1: RTX 3080 (Vulkan), 2: llvmpipe (Vulkan)";
        assert_eq!(choose(&all, "RTX 4090"), Err(none.into()));
        // A number is an index, not a part of a name.
        assert_eq!(choose(&all, "1"), Ok(1));
        assert!(
            choose(&all, "3080")
                .unwrap_err()
                .contains("no adapter 3080")
        );
    }

    /// Regression test: with two adapters of one name, the second one was never used.
    #[test]
    fn an_index_distinguishes_adapters_of_the_same_name() {
        let all = adapters(&[
            ("RTX 3080", "Vulkan"),
            ("RTX 3080", "Vulkan"),
            ("RTX 3080", "Dx12"),
            ("llvmpipe", "Vulkan"),
        ]);
        for index in 0..4 {
            assert_eq!(choose(&all, &index.to_string()), Ok(index));
        }
        for name in ["RTX 3080", "rtx"] {
            assert_eq!(
                choose(&all, name),
                Err(format!(
                    "several adapters are called {name}; give the index of one: \
                     0: RTX 3080 (Vulkan), 1: RTX 3080 (Vulkan), 2: RTX 3080 (Dx12)"
                ))
            );
        }
        assert_eq!(choose(&all, "llvm"), Ok(3));
        assert!(
            choose(&all, "4")
                .unwrap_err()
                .contains("no adapter 4; there are: 0:")
        );
        assert!(choose(&[], "0").unwrap_err().contains("no adapter found"));
    }
}
