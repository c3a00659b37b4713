//! The options `--kernel` and `--device`, and the accuracy of sums, of every command that computes
//! linking numbers.

use super::number::positive;
use linkwatch::kernels::{Accuracy, Device, Method};
use linkwatch::{Error, Result, SessionOptions};

/// Kernel that computes linking numbers, and its settings.
#[derive(Clone, Debug, Default, clap::Args)]
#[command(next_help_heading = super::KERNELS)]
pub struct KernelArgs {
    /// Kernel that computes linking numbers: auto, crossings, direct, angle-sum, barnes-hut, fmm or
    /// interval. All give the same numbers: pairs that the error bound of a sum does not decide are
    /// decided by counting crossings
    #[arg(long = "kernel", value_name = "KERNEL", default_value_t)]
    pub method: Method,
    /// barnes-hut: expand nodes that are further apart than B times their radii [default: by the
    /// error bound]
    #[arg(long, hide_short_help = true, value_name = "B", value_parser = beta)]
    beta: Option<f64>,
    /// With --beta: sum again if the published estimate of the error is above E
    #[arg(
        long, hide_short_help = true, value_name = "E", requires = "beta", value_parser = positive
    )]
    target: Option<f64>,
    /// fmm: order of the expansions, 2 to 20 [default: by the error bound]
    #[arg(
        long, hide_short_help = true, value_name = "P",
        value_parser = clap::value_parser!(u32).range(2..=20)
    )]
    order: Option<u32>,
    /// Device that runs the kernel: auto, cpu, gpu, or the index or name of an adapter (`linkwatch
    /// devices`)
    #[arg(long, value_name = "DEVICE", default_value_t)]
    pub device: Device,
}

impl KernelArgs {
    /// Returns the options of a session with this kernel and device.
    pub fn options(&self) -> Result<SessionOptions> {
        for (name, given, method) in [
            ("--beta", self.beta.is_some(), Method::BarnesHut),
            ("--order", self.order.is_some(), Method::Fmm),
        ] {
            if given && self.method != method {
                let why = format!(
                    "{name} needs --kernel {method}, not --kernel {}",
                    self.method
                );
                return Err(Error::Usage(why));
            }
        }
        let accuracy = Accuracy {
            beta: self.beta,
            target: self.target,
            order: self.order,
            ..Accuracy::default()
        };
        Ok(SessionOptions {
            kernel: self.method,
            accuracy,
            device: self.device.clone(),
            ..SessionOptions::default()
        })
    }
}

/// Parses the beta of Barnes-Hut.
fn beta(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(x) if f64::is_finite(x) && x >= 1.0 => Ok(x),
        _ => Err("expected a number of at least 1".into()),
    }
}
