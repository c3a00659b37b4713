//! Which kernel computes linking numbers, and how finely.

use super::barnes_hut::{Accept, BarnesHut, Options, Order};
use super::direct::{Direct, Formula};
use super::fmm::{self, Fmm};
use super::interval::{Interval, enclose};
use super::{Accelerator, Estimate, Summation};
use crate::curve::CurveSet;
use crate::pairs::Pair;
use std::fmt;
use std::str::FromStr;

/// A kernel. All but the first sum angles, with a bound; what the bound does not decide is left to the first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// The fast multipole method on pairs where it is predicted to be done sooner than counting ([`Plan`](crate::Plan));
    /// counting on all others.
    #[default]
    Auto,
    /// Counting crossings, exactly (Qu & James 2021, section 3.4.1).
    Crossings,
    /// The Gauss integral over all pairs of segments, an arctangent each (Arai 2013).
    Direct,
    /// The same without arctangents (Bertolazzi et al. 2019; Qu & James 2021, algorithm 7).
    AngleSum,
    /// Barnes-Hut with two trees (Qu & James 2021, section 3.4.4), by a proven bound.
    BarnesHut,
    /// A fast multipole method (Qu & James 2021, section 3.4.3), by a proven bound.
    Fmm,
    /// Arai's sum in interval arithmetic (Arai 2013, algorithms 1 and 3).
    Interval,
}

/// How finely Barnes-Hut and the fast multipole method sum.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Accuracy {
    /// Node pairs are expanded where they are further apart than this times the sum of their radii. Without it, as the
    /// proven bound asks for.
    pub beta: Option<f64>,
    /// With `beta`: where the error is above this by the published estimate, sum once more, with the beta that is
    /// estimated to suffice (Qu & James 2021, equations 14 and 15), 16 at most.
    pub target: Option<f64>,
    /// Whether expansions stop at the dipole.
    pub dipole: bool,
    /// The order of the fast multipole method, 2 to 20. Without it, as the proven bound asks for.
    pub order: Option<u32>,
}

impl Method {
    /// Every kernel.
    pub const ALL: [Method; 7] = [
        Method::Auto,
        Method::Crossings,
        Method::Direct,
        Method::AngleSum,
        Method::BarnesHut,
        Method::Fmm,
        Method::Interval,
    ];

    /// The word on the command line.
    pub fn word(self) -> &'static str {
        match self {
            Method::Auto => "auto",
            Method::Crossings => "crossings",
            Method::Direct => "direct",
            Method::AngleSum => "angle-sum",
            Method::BarnesHut => "barnes-hut",
            Method::Fmm => "fmm",
            Method::Interval => "interval",
        }
    }

    /// The kernel that sums, ready for some pairs of a set of polylines; none where crossings are counted or it is not known yet
    /// what is. Both direct sums are one on an adapter.
    pub(crate) fn summation<'a>(
        self,
        polylines: &'a CurveSet,
        accuracy: Accuracy,
        accelerator: &'a Accelerator,
        pairs: &[Pair],
    ) -> Option<Box<dyn Summation + 'a>> {
        let direct = |formula| {
            let processor =
                move || -> Box<dyn Summation + 'a> { Box::new(Direct::new(polylines, formula)) };
            accelerator.direct_sum(polylines, pairs, processor)
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
                let options = move |accept| Options {
                    order,
                    accept,
                    ..Options::default()
                };
                let Accuracy { beta, target, .. } = accuracy;
                let processor = move || -> Box<dyn Summation + 'a> {
                    match (beta, target) {
                        (Some(beta), None) => {
                            Box::new(BarnesHut::new(polylines, options(Accept::Beta(beta))))
                        }
                        (Some(beta), Some(target)) => {
                            let most = beta.max(16.0);
                            let accept = Accept::Estimated { beta, target, most };
                            Box::new(BarnesHut::new(polylines, options(accept)))
                        }
                        (None, _) => {
                            let by_beta = BarnesHut::new(polylines, options(Accept::Beta(4.0)));
                            let by_bound = by_beta.with(options(Options::default().accept));
                            Box::new(FirstByBeta([by_beta, by_bound]))
                        }
                    }
                };
                match (target, accuracy.dipole) {
                    (None, false) => accelerator.barnes_hut(polylines, pairs, beta, processor),
                    _ => processor(),
                }
            }
            Method::Fmm => {
                let options = fmm::Options {
                    order: accuracy.order,
                    ..fmm::Options::default()
                };
                Box::new(Fmm::new(polylines, options))
            }
            Method::Interval => Box::new(Enclosures(polylines)),
        })
    }
}

impl fmt::Display for Method {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.word())
    }
}

impl FromStr for Method {
    type Err = String;
    fn from_str(s: &str) -> Result<Self, String> {
        let found = Self::ALL.into_iter().find(|m| m.word() == s);
        found.ok_or_else(|| {
            "expected auto, crossings, direct, angle-sum, barnes-hut, fmm or interval".into()
        })
    }
}

/// One pass by distance, which proves most pairs of a garment for a third of the time; by the bound where it does not.
struct FirstByBeta<'a>([BarnesHut<'a>; 2]);

impl Summation for FirstByBeta<'_> {
    fn linking_number(&self, pair: Pair) -> Estimate {
        let [by_beta, by_bound] = &self.0;
        let first = by_beta.linking_number(pair);
        match first.integer() {
            Some(_) => first,
            None => by_bound.linking_number(pair),
        }
    }
}

/// Arai's intervals, as estimates.
struct Enclosures<'a>(&'a CurveSet);

impl Summation for Enclosures<'_> {
    fn linking_number(&self, pair: Pair) -> Estimate {
        let Interval { lo, hi } = enclose(self.0, pair, 0.0);
        if !(lo.is_finite() && hi.is_finite()) {
            return Estimate::UNKNOWN;
        }
        let value = lo + 0.5 * (hi - lo);
        let bound = (hi - value).max(value - lo).next_up();
        Estimate { value, bound }
    }
}
