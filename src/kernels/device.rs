//! Where kernels run, and on what they could.

use std::fmt;
use std::str::FromStr;

/// Where kernels run.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Device {
    /// On a graphics processor where that is predicted to be faster, else on the processor.
    #[default]
    Auto,
    /// On the processor.
    Cpu,
    /// On the first graphics processor that there is, of the fastest kind; software Vulkan counts as one.
    Gpu,
    /// On the graphics processor whose name has these words in it.
    Named(String),
}

impl fmt::Display for Device {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Device::Auto => "auto",
            Device::Cpu => "cpu",
            Device::Gpu => "gpu",
            Device::Named(name) => name,
        })
    }
}

impl FromStr for Device {
    type Err = String;
    fn from_str(s: &str) -> Result<Self, String> {
        Ok(match s {
            "" => return Err("expected auto, cpu, gpu or the name of an adapter".into()),
            "auto" => Device::Auto,
            "cpu" => Device::Cpu,
            "gpu" => Device::Gpu,
            name => Device::Named(name.into()),
        })
    }
}

/// An adapter, and what it can do.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct DeviceInfo {
    /// Its name, as [`Device::Named`] takes it.
    pub name: String,
    /// The interface that it is reached by: `Vulkan`, `Metal` or `Dx12`.
    pub backend: String,
    /// `DiscreteGpu`, `IntegratedGpu`, `VirtualGpu`, `Cpu` or `Other`.
    pub kind: String,
    /// Its driver.
    pub driver: String,
    /// Whether it is the processor in disguise: right, and not fast.
    pub software: bool,
    /// Whether it computes in double precision.
    pub double_precision: bool,
    /// Bytes of a buffer, at most.
    pub max_buffer_bytes: u64,
    /// Bytes of a buffer that a program sees, at most.
    pub max_binding_bytes: u64,
    /// Why it cannot be used, where it cannot.
    pub trouble: Option<String>,
}

/// All adapters, each opened and its arithmetic tested.
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
    fn words_on_the_command_line_come_back() {
        for device in [
            Device::Auto,
            Device::Cpu,
            Device::Gpu,
            Device::Named("H100".into()),
        ] {
            assert_eq!(device.to_string().parse(), Ok(device));
        }
        assert!("".parse::<Device>().is_err());
    }
}
