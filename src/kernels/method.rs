//! Choice of the kernel that computes linking numbers, and its accuracy.

use super::sums::barnes_hut::{Accept, BarnesHut, Options, Order};
use super::sums::direct::{Direct, Formula};
use super::sums::fmm::{self, Fmm};
use super::sums::interval::enclose;
use super::{GpuUse, Summation};
use crate::curve::CurveSet;
use crate::pairs::Pair;

vocabulary! {
    /// A kernel. All but [`Method::Crossings`] sum angles, with an error bound; pairs that the
    /// bound does not decide are counted by [`Method::Crossings`].
    #[derive(Default)]
    pub enum Method {
        /// The fast multipole method for pairs on which it is predicted to be faster than counting
        /// ([`Plan`](crate::Plan)); counting for all others.
        #[default]
        Auto = "auto",
        /// Exact count of the crossings (Qu & James 2021, section 3.4.1).
        Crossings = "crossings",
        /// The Gauss integral over all segment pairs, one arctangent for each (Arai 2013).
        Direct = "direct",
        /// The Gauss integral over all segment pairs, without arctangents (Bertolazzi et al. 2019;
        /// Qu & James 2021, algorithm 7).
        AngleSum = "angle-sum",
        /// Barnes-Hut with two trees (Qu & James 2021, section 3.4.4), with a proven error bound.
        BarnesHut = "barnes-hut",
        /// A fast multipole method (Qu & James 2021, section 3.4.3), with a proven error bound.
        Fmm = "fmm",
        /// Arai's sum in interval arithmetic (Arai 2013, algorithms 1 and 3).
        Interval = "interval",
    }
}

/// Accuracy of Barnes-Hut and of the fast multipole method.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Accuracy {
    /// A node pair is expanded if its distance is above `beta` times the sum of the radii. `None`:
    /// the proven error bound decides which node pairs are expanded.
    pub beta: Option<f64>,
    /// Used with `beta`: if the published estimate of the error is above this, the sum is repeated
    /// with the beta that is estimated to suffice (Qu & James 2021, equations 14 and 15), at most
    /// 16.
    pub target: Option<f64>,
    /// True if expansions stop at the dipole.
    pub dipole: bool,
    /// Order of the fast multipole method, 2 to 20. `None`: the proven error bound decides.
    pub order: Option<u32>,
}

impl Method {
    /// Returns the summation kernel, prepared for `pairs` of a set of polylines. Returns `None` if
    /// crossings are counted, or if the kernel is not chosen yet ([`Method::Auto`]). On a GPU both
    /// direct sums are the same kernel.
    pub(crate) fn summation<'a>(
        self,
        polylines: &'a CurveSet,
        accuracy: Accuracy,
        gpu: &'a GpuUse,
        pairs: &[Pair],
    ) -> Option<Box<dyn Summation + 'a>> {
        let direct = |formula| {
            gpu.direct_sum(polylines, pairs, move || {
                Box::new(Direct::new(polylines, formula))
            })
        };
        Some(match self {
            Method::Auto | Method::Crossings => return None,
            Method::Direct => direct(Formula::Arctangent),
            Method::AngleSum => direct(Formula::AngleSum),
            Method::BarnesHut => {
                let order = match accuracy.dipole {
                    true => Order::Dipole,
                    false => Order::Quadrupole,
                };
                let Accuracy { beta, target, .. } = accuracy;
                let cpu = move || -> Box<dyn Summation + 'a> {
                    let accept = match (beta, target) {
                        (Some(beta), None) => Accept::Beta(beta),
                        (Some(beta), Some(target)) => Accept::Estimated {
                            beta,
                            target,
                            most: beta.max(16.0),
                        },
                        (None, _) => Accept::Beta(4.0),
                    };
                    let by_bound = Options {
                        order,
                        ..Options::default()
                    };
                    let kernel = BarnesHut::new(polylines, Options { accept, ..by_bound });
                    if beta.is_some() {
                        return Box::new(kernel);
                    }
                    // The first pass accepts node pairs by distance; it proves most pairs of a
                    // garment in a third of the time. The second pass accepts by the error bound,
                    // for pairs that the first one leaves undecided.
                    let finer = kernel.with(by_bound);
                    Box::new(move |pair| {
                        let first = kernel.linking_number(pair);
                        match first.integer() {
                            Some(_) => first,
                            None => finer.linking_number(pair),
                        }
                    })
                };
                match (target, accuracy.dipole) {
                    (None, false) => gpu.barnes_hut(polylines, pairs, beta, cpu),
                    _ => cpu(),
                }
            }
            Method::Fmm => {
                let options = fmm::Options {
                    order: accuracy.order,
                    ..fmm::Options::default()
                };
                Box::new(Fmm::new(polylines, options))
            }
            Method::Interval => Box::new(move |pair| enclose(polylines, pair, 0.0).estimate()),
        })
    }
}
