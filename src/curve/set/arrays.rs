//! The coordinates of a set in three arrays, which are built when they are needed.
//!
//! A frame in which nothing moved far needs no arrays. Its positions are only compared.

use super::basis::Basis;
use super::coordinates::Coordinates;
use super::curve::{Curve, slots_of_all};
use super::received::Received;
use std::sync::{Mutex, OnceLock, PoisonError};

/// Three arrays, and the largest magnitude of their coordinates.
#[derive(Debug)]
pub(super) struct Arrays {
    pub coordinates: Coordinates,
    pub max_abs: f64,
}

/// The arrays of a set, if they are built.
#[derive(Debug, Default)]
pub(super) struct LazyArrays {
    arrays: OnceLock<Arrays>,
    /// Memory for the arrays. The layout of a set does not change once it has arrays.
    spare: Mutex<Option<Coordinates>>,
}

impl Clone for LazyArrays {
    /// Returns no arrays: a copy of a set builds its own.
    fn clone(&self) -> LazyArrays {
        LazyArrays::default()
    }
}

impl LazyArrays {
    /// Returns the arrays of these curves.
    #[inline(always)]
    pub fn get(&self, curves: &[Curve], basis: Basis, received: &Received) -> &Arrays {
        match self.arrays.get() {
            Some(arrays) => arrays,
            None => self.build(curves, basis, received),
        }
    }

    #[cold]
    #[inline(never)]
    fn build(&self, curves: &[Curve], basis: Basis, received: &Received) -> &Arrays {
        self.arrays.get_or_init(|| {
            let (slots, positions) = (slots_of_all(curves, basis), received.positions());
            let mut spare = self.spare.lock().unwrap_or_else(PoisonError::into_inner);
            let new = || Coordinates::new(positions.precision(), slots);
            let mut coordinates = spare.take().unwrap_or_else(new);
            let max_abs = coordinates.write_curves(curves, basis, positions);
            Arrays {
                coordinates,
                max_abs,
            }
        })
    }

    /// Forgets the arrays, because the positions change. Keeps their memory.
    pub fn outdate(&mut self) {
        if let Some(arrays) = self.arrays.take() {
            self.spare = Some(arrays.coordinates).into();
        }
    }

    /// Returns true if the arrays are built.
    #[cfg(test)]
    pub fn are_built(&self) -> bool {
        self.arrays.get().is_some()
    }
}
