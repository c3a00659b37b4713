//! Curves as numbers that can be stored.

use super::{Basis, CurveSet, Positions, Precision};
use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error as _};
use std::sync::Arc;

/// Curves that can be stored with serde.
#[derive(Clone, Debug)]
pub(crate) struct StoredCurves(pub Arc<CurveSet>);

#[derive(Serialize, Deserialize)]
struct Numbers {
    basis: Basis,
    counts: Vec<i32>,
    is_double: bool,
    /// Coordinates in the precision of the curves; the other list is empty.
    single: Vec<f32>,
    double: Vec<f64>,
}

impl Serialize for StoredCurves {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        let set = &self.0;
        let mut numbers = Numbers {
            basis: set.basis(),
            counts: set.counts().collect(),
            is_double: set.precision() == Precision::F64,
            single: Vec::new(),
            double: Vec::new(),
        };
        match set.positions() {
            Positions::F32(v) => numbers.single = v.to_vec(),
            Positions::F64(v) => numbers.double = v.to_vec(),
        }
        numbers.serialize(to)
    }
}

impl<'a> Deserialize<'a> for StoredCurves {
    fn deserialize<D: Deserializer<'a>>(from: D) -> Result<StoredCurves, D::Error> {
        let numbers = Numbers::deserialize(from)?;
        let positions = match numbers.is_double {
            true => Positions::F64(&numbers.double),
            false => Positions::F32(&numbers.single),
        };
        let set = CurveSet::from_counts(numbers.basis, &numbers.counts, positions);
        set.map(|set| StoredCurves(Arc::new(set)))
            .map_err(D::Error::custom)
    }
}
