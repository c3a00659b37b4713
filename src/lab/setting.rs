//! Kernels and accuracies to measure.

use crate::kernels::{Accuracy, Method};

/// A kernel at some accuracy.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setting {
    /// The kernel.
    pub method: Method,
    /// Its accuracy.
    pub accuracy: Accuracy,
}

/// Orders of the fast multipole method to measure, in addition to its default.
const ORDERS: [u32; 4] = [3, 6, 10, 16];

impl Setting {
    /// Barnes-Hut as published: with this initial beta and target (Qu & James 2021, section 4.1).
    pub const PUBLISHED: Setting = Setting {
        method: Method::BarnesHut,
        accuracy: Accuracy {
            beta: Some(2.0),
            target: Some(0.2),
            dipole: false,
            order: None,
        },
    };

    /// Returns a kernel with its default accuracy.
    pub fn of(method: Method) -> Setting {
        let accuracy = Accuracy::default();
        Setting { method, accuracy }
    }

    fn by_beta(beta: f64, dipole: bool) -> Setting {
        Setting {
            method: Method::BarnesHut,
            accuracy: Accuracy {
                beta: Some(beta),
                target: None,
                dipole,
                order: None,
            },
        }
    }

    /// Returns every kernel; Barnes-Hut by these betas, by the bound, and as published.
    pub fn all(betas: &[f64]) -> Vec<Setting> {
        let exactly = Method::ALL
            .into_iter()
            .filter(|&m| m != Method::BarnesHut)
            .map(Setting::of);
        let by_order = ORDERS.map(|order| Setting {
            method: Method::Fmm,
            accuracy: Accuracy {
                order: Some(order),
                ..Accuracy::default()
            },
        });
        let by_beta = [true, false].into_iter().flat_map(|dipole| {
            let by_beta = move |&beta: &f64| Setting::by_beta(beta, dipole);
            betas.iter().map(by_beta)
        });
        let others = [Setting::of(Method::BarnesHut), Setting::PUBLISHED];
        exactly
            .chain(by_order)
            .chain(by_beta)
            .chain(others)
            .collect()
    }

    /// Returns the kernels to measure at several sizes. Skips interval arithmetic, which is the
    /// direct sum some hundred times slower, and methods that choose one of the others.
    pub fn for_sizes() -> Vec<Setting> {
        let kernels = Method::ALL.into_iter();
        let left_out = |m: &Method| matches!(m, Method::Auto | Method::Interval);
        let default = kernels.filter(|m| !left_out(m)).map(Setting::of);
        default.chain([Setting::by_beta(4.0, false)]).collect()
    }

    /// Returns the approximate cost per pair of segments, in nanoseconds of one thread, of a kernel
    /// that visits all of them.
    pub fn ns_a_pair(&self, fast_device: bool) -> Option<f64> {
        match self.method {
            Method::Direct | Method::AngleSum if fast_device => Some(0.1),
            Method::Direct => Some(6.0),
            Method::AngleSum => Some(5.0),
            Method::Interval => Some(1500.0),
            Method::Auto | Method::Crossings | Method::BarnesHut | Method::Fmm => None,
        }
    }

    /// Returns the order of the expansions, in words.
    pub fn order(&self) -> Option<String> {
        match (self.method, self.accuracy.dipole) {
            (Method::BarnesHut, true) => Some("dipole".into()),
            (Method::BarnesHut, false) => Some("quadrupole".into()),
            _ => self.accuracy.order.map(|p| p.to_string()),
        }
    }

    /// Returns the name of the curve in a plot that joins several accuracies of a kernel.
    pub fn series(&self) -> String {
        match (self.order(), self.accuracy) {
            (None, _) => self.method.to_string(),
            (Some(_), Accuracy { order: Some(_), .. }) => format!("{} by order", self.method),
            (Some(_), Accuracy { beta: None, .. }) => format!("{} by bound", self.method),
            (Some(order), _) if self.is_by_beta() => format!("{order} by β"),
            (Some(_), _) => "two passes".into(),
        }
    }

    /// Returns true if expansions are accepted by beta alone.
    pub fn is_by_beta(&self) -> bool {
        self.accuracy.beta.is_some() && self.accuracy.target.is_none()
    }
}

impl std::fmt::Display for Setting {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Accuracy { beta, target, .. } = self.accuracy;
        let text = match (self.order(), beta, target) {
            (None, ..) => self.method.to_string(),
            (Some(order), ..) if self.method == Method::Fmm => {
                format!("{}, order {order}", self.method)
            }
            (Some(order), None, _) => format!("{} {order}, by bound", self.method),
            (Some(order), Some(beta), None) => format!("{} {order}, beta {beta}", self.method),
            (Some(_), Some(beta), Some(target)) => {
                format!("{} beta {beta}, target {target}", self.method)
            }
        };
        f.pad(&text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kernel_and_every_beta_has_a_row() {
        let all = Setting::all(&[2.0, 4.0]);
        let kernels = Method::ALL.len() - 1;
        let others = kernels + ORDERS.len();
        assert_eq!(all.len(), others + 2 * 2 + 2);
        assert_eq!(all.iter().filter(|s| s.is_by_beta()).count(), 4);
        assert_eq!(all[kernels].to_string(), "fmm, order 3");
        assert_eq!(all[others].to_string(), "barnes-hut dipole, beta 2");
        assert_eq!(all[others + 5].series(), "two passes");
    }
}
