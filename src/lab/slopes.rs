//! Rate at which errors fall with beta.

use super::kernels::KernelRow;

/// Errors of this size are rounding errors, and fall no further.
const ROUNDING: f64 = 1e-12;

/// Power of beta to which the mean error of an expansion is proportional.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slope {
    /// Name of the order of the expansion.
    pub order: &'static str,
    /// Fitted power.
    pub power: f64,
    /// Published power (Qu & James 2021, section 4.1.1).
    pub published: i32,
    /// Number of betas of the fit.
    betas: usize,
}

impl Slope {
    /// Returns the slopes of both orders, each only if at least three betas have an error above
    /// rounding.
    pub fn all(rows: &[KernelRow]) -> Vec<Slope> {
        let of = |(order, published)| {
            let points = points(rows, order);
            let points: Vec<_> = points.into_iter().filter(|p| p.1 > ROUNDING).collect();
            Some(Slope {
                order,
                power: fitted(&points)?,
                published,
                betas: points.len(),
            })
        };
        [("dipole", -3), ("quadrupole", -4)]
            .into_iter()
            .filter_map(of)
            .collect()
    }
}

impl std::fmt::Display for Slope {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{}: the mean error is proportional to beta^{:.1} (least squares over {} betas; \
             published: beta^{})",
            self.order, self.power, self.betas, self.published
        )
    }
}

/// Returns the betas of an expansion, and its mean errors.
pub(super) fn points(rows: &[KernelRow], order: &str) -> Vec<(f64, f64)> {
    let point = |row: &KernelRow| {
        let fits = row.setting.is_by_beta() && row.setting.order().as_deref() == Some(order);
        let beta = row.setting.accuracy.beta.filter(|_| fits)?;
        Some((beta, row.mean_error()?))
    };
    rows.iter().filter_map(point).collect()
}

/// Returns the power of x to which y is proportional, by least squares over the logarithms. `None`
/// for fewer than three points, or if all have the same x.
fn fitted(points: &[(f64, f64)]) -> Option<f64> {
    if points.len() < 3 {
        return None;
    }
    let n = points.len() as f64;
    let logs = || points.iter().map(|&(x, y)| (x.ln(), y.ln()));
    let (x, y) = logs().fold((0.0, 0.0), |a, p| (a.0 + p.0 / n, a.1 + p.1 / n));
    let spread: f64 = logs().map(|p| (p.0 - x) * (p.0 - x)).sum();
    let slope = logs().map(|p| (p.0 - x) * (p.1 - y)).sum::<f64>() / spread;
    slope.is_finite().then_some(slope)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fits_the_power_of_a_power_law() {
        let points = |power| [1.5, 2.0, 4.0, 8.0].map(|x: f64| (x, 0.1 * x.powi(power)));
        for power in [-4, -3, 0, 2] {
            let found = fitted(&points(power)).unwrap();
            assert!((found - f64::from(power)).abs() < 1e-12);
        }
        assert_eq!(fitted(&points(-3)[..2]), None);
        assert_eq!(fitted(&[(2.0, 0.1); 3]), None);
    }
}
