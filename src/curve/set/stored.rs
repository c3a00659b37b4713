//! Curves as numbers that can be stored.

use super::received::Received;
use super::{Basis, CurveSet};
use crate::error::Error;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Curves that can be stored with serde.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(into = "Numbers", try_from = "Numbers")]
pub(crate) struct StoredCurves(pub Arc<CurveSet>);

#[derive(Serialize, Deserialize)]
struct Numbers {
    basis: Basis,
    counts: Vec<i32>,
    positions: Received,
}

impl From<StoredCurves> for Numbers {
    fn from(StoredCurves(set): StoredCurves) -> Numbers {
        Numbers {
            basis: set.basis(),
            counts: set.counts().collect(),
            positions: set.positions().into(),
        }
    }
}

impl TryFrom<Numbers> for StoredCurves {
    type Error = Error;

    fn try_from(numbers: Numbers) -> Result<StoredCurves, Error> {
        let positions = numbers.positions.positions();
        let set = CurveSet::from_counts(numbers.basis, &numbers.counts, positions)?;
        Ok(StoredCurves(Arc::new(set)))
    }
}
