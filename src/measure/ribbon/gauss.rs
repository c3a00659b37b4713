//! Gauss integrals of all curves of a set.

use crate::curve::CurveSet;
use crate::error::{Error, Result};
use crate::kernels::{Chain, Estimate, sums::direct::Scale};
use crate::pool;
use rayon::prelude::*;

/// Writhes and linking integrals of the polylines of a set, open or closed.
///
/// Both are real numbers with a proven error bound, and are never rounded to integers. A large
/// bound means that segments touch or nearly touch.
///
/// ```
/// use linkwatch::{Basis, CurveSet, GaussIntegrals, Positions};
///
/// // Two open curves: segments that cross at a right angle, at a distance of 1.
/// let points = [-1., 0., 0., 1., 0., 0., 0., -1., 1., 0., 1., 1.];
/// let set = CurveSet::from_counts(Basis::Polyline, &[2, 2], Positions::F64(&points))?;
/// let integrals = GaussIntegrals::new(&set)?;
/// let found = integrals.linking(0, 1, 1e-9);
/// // The solid angle of a square of side 2 at a distance of 1, by 4 pi: that of a side of a cube.
/// assert!((found.value.abs() - 1.0 / 6.0).abs() <= found.bound && found.bound < 1e-9);
/// # Ok::<(), linkwatch::Error>(())
/// ```
#[derive(Debug)]
pub struct GaussIntegrals {
    chains: Vec<Chain>,
}

impl GaussIntegrals {
    /// Copies all curves, which must be polylines.
    ///
    /// # Errors
    ///
    /// [`Error::Forked`] in a process that was forked from one that used linkwatch; splines.
    pub fn new(set: &CurveSet) -> Result<GaussIntegrals> {
        pool::check_process()?;
        check_polylines(set)?;
        let scale = Scale::new(set.max_abs());
        let chains = (0..set.len()).into_par_iter();
        Ok(GaussIntegrals {
            chains: chains.map(|i| Chain::of(set, i, scale)).collect(),
        })
    }

    /// Returns the writhe of a curve. Its bound is at most `tolerance` if possible.
    ///
    /// # Panics
    /// If there is no such curve.
    pub fn writhe(&self, curve: usize, tolerance: f64) -> Estimate {
        self.chains[curve].writhe(tolerance)
    }

    /// Returns the Gauss linking integral of two different curves: their linking number if both are
    /// closed. Its bound is at most `tolerance` if possible.
    ///
    /// # Panics
    /// If there are no such curves, or if they are the same.
    pub fn linking(&self, i: usize, j: usize, tolerance: f64) -> Estimate {
        assert_ne!(i, j, "the integral of a curve and itself is its writhe");
        self.chains[i].integral(&self.chains[j], tolerance)
    }

    /// Returns the linking integrals of curve `i` and all later ones, in their order.
    pub fn row(&self, i: usize, tolerance: f64) -> Vec<Estimate> {
        let integral = |other: &Chain| self.chains[i].integral(other, tolerance);
        self.chains.par_iter().skip(i + 1).map(integral).collect()
    }
}

/// Returns an error for splines.
pub(super) fn check_polylines(set: &CurveSet) -> Result<()> {
    if set.basis().is_polyline() {
        return Ok(());
    }
    Err(Error::Usage(
        "the curves are splines, but Gauss integrals are computed for polylines: convert them \
         first (`linkwatch convert MODEL OUT.vect`, or `linkwatch::chords`)"
            .into(),
    ))
}
