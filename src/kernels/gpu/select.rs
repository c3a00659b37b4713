//! Selection of an adapter by kind, name or index.

use crate::kernels::device::{Device, DeviceInfo};

/// Returns the index of the chosen adapter in `all`, whose order is that of the indices.
/// Returns the first one if the choice admits any adapter.
///
/// # Errors
///
/// A message, if no adapter or more than one matches.
pub(super) fn select(device: &Device, all: &[DeviceInfo]) -> Result<usize, String> {
    if all.is_empty() {
        return Err("no adapter found (Vulkan, Metal or DX12)".into());
    }
    let list = |indices: &mut dyn Iterator<Item = usize>| {
        let names = indices.map(|k| format!("{k}: {} ({})", all[k].name, all[k].backend));
        names.collect::<Vec<_>>().join(", ")
    };
    let there_are = || format!("there are: {}", list(&mut (0..all.len())));
    let words = match device {
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
        [] => Err(format!("no adapter is called {device}; {}", there_are())),
        _ => Err(format!(
            "several adapters are called {device}; give the index of one: {}",
            list(&mut found.into_iter())
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
        select(&text.parse().unwrap(), all)
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
