//! The options `--kernel` and `--device` of `linkwatch certify`.

use super::number::{one_or_more, positive};
use super::settings::{named, split};
use linkwatch::SessionOptions;
use linkwatch::kernels::{Accuracy, Device, Method};

/// Kernel that computes linking numbers, and its settings.
#[derive(Clone, Debug, Default, clap::Args)]
#[command(next_help_heading = super::KERNELS)]
pub struct KernelArgs {
    /// Kernel that computes linking numbers: auto, crossings, direct, angle-sum, barnes-hut, fmm or
    /// interval. All give the same numbers: pairs that the error bound of a sum does not decide are
    /// decided by counting crossings
    ///
    /// Settings follow the name: `barnes-hut,beta=B` expands nodes that are further apart than B
    /// times their radii, and `,target=E` sums again if the published estimate of the error is
    /// above E; `fmm,order=P` sets the order of the expansions, 2 to 20. Without them the error
    /// bound decides
    #[arg(long, value_name = "KERNEL[,..]", default_value = "auto", value_parser = kernel)]
    kernel: Kernel,
    /// Device that runs the kernel: auto, cpu, gpu, or the index or name of an adapter (`linkwatch
    /// devices`)
    #[arg(long, value_name = "DEVICE", default_value_t)]
    pub device: Device,
}

/// A kernel and its accuracy.
#[derive(Clone, Copy, Debug, Default)]
struct Kernel {
    method: Method,
    accuracy: Accuracy,
}

/// Parses the name of a kernel, and its settings.
fn kernel(text: &str) -> Result<Kernel, String> {
    let (name, settings) = split(text, &["beta", "target", "order"])?;
    let method: Method = name.parse().map_err(|e| format!("{e}"))?;
    let mut accuracy = Accuracy::default();
    for (key, value) in settings {
        let of = match key {
            "order" => Method::Fmm,
            _ => Method::BarnesHut,
        };
        if method != of {
            return Err(format!("{key} is a setting of {of}, not of {method}"));
        }
        match key {
            "beta" => accuracy.beta = Some(named(key, one_or_more(value))?),
            "target" => accuracy.target = Some(named(key, positive(value))?),
            _ => accuracy.order = Some(named(key, order(value))?),
        }
    }
    match (accuracy.target, accuracy.beta) {
        (Some(_), None) => Err("target needs beta".into()),
        _ => Ok(Kernel { method, accuracy }),
    }
}

impl KernelArgs {
    /// Returns the kernel.
    pub fn method(&self) -> Method {
        self.kernel.method
    }

    /// Returns the options of a session with this kernel and device.
    pub fn options(&self) -> SessionOptions {
        SessionOptions {
            kernel: self.kernel.method,
            accuracy: self.kernel.accuracy,
            device: self.device.clone(),
            ..SessionOptions::default()
        }
    }
}

/// Parses the order of the fast multipole method.
fn order(text: &str) -> Result<u32, String> {
    match text.parse() {
        Ok(order) if (2..=20).contains(&order) => Ok(order),
        _ => Err("expected a whole number from 2 to 20".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_belong_to_their_kernel() {
        let found = kernel("barnes-hut,beta=2,target=0.01").unwrap();
        assert_eq!(found.method, Method::BarnesHut);
        assert_eq!(
            (found.accuracy.beta, found.accuracy.target),
            (Some(2.0), Some(0.01))
        );
        assert_eq!(kernel("fmm,order=3").unwrap().accuracy.order, Some(3));
        for (bad, word) in [
            (
                "auto,beta=2",
                "beta is a setting of barnes-hut, not of auto",
            ),
            ("fmm,beta=2", "not of fmm"),
            ("direct,order=3", "order is a setting of fmm"),
            ("fmm,order=1", "from 2 to 20"),
            ("barnes-hut,beta=0.5", "at least 1"),
            ("barnes-hut,target=0.1", "target needs beta"),
            ("guess", "expected auto, crossings"),
        ] {
            let error = kernel(bad).unwrap_err();
            assert!(error.contains(word), "{bad}: {error}");
        }
    }
}
