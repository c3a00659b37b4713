//! Which kernel computes linking numbers, and how finely.

use super::barnes_hut::{BarnesHut, Options};
use super::direct::{Direct, Formula};
use super::interval::{Interval, enclose};
use super::{Estimate, Summation};
use crate::curve::CurveSet;
use crate::pairs::Pair;
use std::fmt;
use std::str::FromStr;

/// A kernel. All but the first sum angles, with a bound; what the bound does not decide is left to the first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Counting crossings, exactly (Qu & James 2021, section 3.4.1).
    #[default]
    Crossings,
    /// The Gauss integral over all pairs of segments, an arctangent each (Arai 2013).
    Direct,
    /// The same without arctangents (Bertolazzi et al. 2019; Qu & James 2021, algorithm 7).
    AngleSum,
    /// Barnes-Hut with two trees (Qu & James 2021, section 3.4.4), by a proven bound.
    BarnesHut,
    /// Arai's sum in interval arithmetic (Arai 2013, algorithms 1 and 3).
    Interval,
}

impl Method {
    /// Every kernel.
    pub const ALL: [Method; 5] = [
        Method::Crossings,
        Method::Direct,
        Method::AngleSum,
        Method::BarnesHut,
        Method::Interval,
    ];

    /// The word on the command line.
    pub fn word(self) -> &'static str {
        match self {
            Method::Crossings => "crossings",
            Method::Direct => "direct",
            Method::AngleSum => "angle-sum",
            Method::BarnesHut => "barnes-hut",
            Method::Interval => "interval",
        }
    }

    /// The kernel that sums, ready for a set of polylines; none where crossings are counted.
    pub(crate) fn summation(self, polylines: &CurveSet) -> Option<Box<dyn Summation + '_>> {
        Some(match self {
            Method::Crossings => return None,
            Method::Direct => Box::new(Direct::new(polylines, Formula::Arctangent)),
            Method::AngleSum => Box::new(Direct::new(polylines, Formula::AngleSum)),
            Method::BarnesHut => Box::new(BarnesHut::new(polylines, Options::default())),
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
        found.ok_or_else(|| "expected crossings, direct, angle-sum, barnes-hut or interval".into())
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
