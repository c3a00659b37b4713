//! Coordinates of a set: as received, or in three arrays that are built when they are needed.
//!
//! A frame in which nothing moved far needs no arrays. Its positions are only compared.

use super::basis::Basis;
use super::coordinates::Coordinates;
use super::set::{Curve, slots_of_all};
use super::tile::Bad;
use super::{Positions, Precision};
use std::sync::{Mutex, OnceLock, PoisonError};

/// A private copy of positions, `x y z x y z ..`, in the order of the input.
#[derive(Clone, Debug)]
pub(crate) enum Received {
    F32(Vec<f32>),
    F64(Vec<f64>),
}

impl From<Positions<'_>> for Received {
    fn from(positions: Positions<'_>) -> Received {
        match positions {
            Positions::F32(v) => Received::F32(v.to_vec()),
            Positions::F64(v) => Received::F64(v.to_vec()),
        }
    }
}

impl Received {
    fn new(precision: Precision) -> Received {
        match precision {
            Precision::F32 => Received::F32(Vec::new()),
            Precision::F64 => Received::F64(Vec::new()),
        }
    }

    /// Returns the positions.
    pub fn positions(&self) -> Positions<'_> {
        match self {
            Received::F32(v) => Positions::F32(v),
            Received::F64(v) => Positions::F64(v),
        }
    }

    fn resize(&mut self, len: usize) {
        match self {
            Received::F32(v) => v.resize(len, 0.0),
            Received::F64(v) => v.resize(len, 0.0),
        }
    }

    /// Copies positions of the same precision.
    pub fn copy_from(&mut self, source: Positions<'_>) {
        match (self, source) {
            (Received::F32(to), Positions::F32(from)) => from.clone_into(to),
            (Received::F64(to), Positions::F64(from)) => from.clone_into(to),
            _ => unreachable!("callers compare the precision first"),
        }
    }
}

/// Three arrays, and the largest magnitude of their coordinates.
#[derive(Debug)]
pub(super) struct Arrays {
    pub coordinates: Coordinates,
    pub max_abs: f64,
}

/// Coordinates of a set, in at least one of two forms.
#[derive(Debug)]
pub(super) struct LazyCoordinates {
    arrays: OnceLock<Arrays>,
    /// Memory for the arrays.
    spare: Mutex<Option<Arrays>>,
    received: Received,
    /// True if `received` holds the positions.
    is_received: bool,
}

impl Arrays {
    /// Returns empty arrays with capacity for `slots` points.
    fn with_capacity(precision: Precision, slots: usize) -> Self {
        Arrays {
            coordinates: Coordinates::with_capacity(precision, slots),
            max_abs: 0.0,
        }
    }

    /// Copies other arrays of the same precision to the first slots.
    pub fn copy_first(&mut self, source: &Arrays) {
        self.coordinates.copy_first(&source.coordinates);
        self.max_abs = self.max_abs.max(source.max_abs);
    }

    /// Replaces all points of some curves; see [`Coordinates::write_curves`].
    pub fn write_curves(
        &mut self,
        curves: &[Curve],
        basis: Basis,
        positions: Positions<'_>,
        limit: f64,
    ) -> Result<(), Bad> {
        let written = self
            .coordinates
            .write_curves(curves, basis, positions, limit);
        self.max_abs = self.max_abs.max(written?);
        Ok(())
    }

    /// Writes points from slot `at` on; see [`Coordinates::write`].
    pub fn write(&mut self, at: usize, positions: Positions<'_>, limit: f64) -> Result<(), Bad> {
        let largest = self.coordinates.write(at, positions, limit)?;
        self.max_abs = self.max_abs.max(largest);
        Ok(())
    }
}

impl LazyCoordinates {
    /// Returns empty arrays with capacity for `slots` points.
    pub fn with_capacity(precision: Precision, slots: usize) -> Self {
        LazyCoordinates {
            arrays: Arrays::with_capacity(precision, slots).into(),
            spare: Mutex::default(),
            received: Received::new(precision),
            is_received: false,
        }
    }

    pub fn precision(&self) -> Precision {
        self.received.positions().precision()
    }

    /// Returns the arrays. Builds them if only the received positions are known.
    #[inline(always)]
    pub fn get(&self, curves: &[Curve], basis: Basis) -> &Arrays {
        match self.arrays.get() {
            Some(arrays) => arrays,
            None => self.build(curves, basis),
        }
    }

    #[cold]
    #[inline(never)]
    fn build(&self, curves: &[Curve], basis: Basis) -> &Arrays {
        self.arrays.get_or_init(|| {
            let mut spare = self.spare.lock().unwrap_or_else(PoisonError::into_inner);
            let mut arrays = self.memory(spare.take(), slots_of_all(curves, basis));
            arrays.max_abs = 0.0;
            // The positions were checked when they were received.
            let positions = self.received.positions();
            let written = arrays.write_curves(curves, basis, positions, f64::INFINITY);
            debug_assert!(written.is_ok());
            arrays
        })
    }

    /// Returns arrays of `slots` slots with any content, in `spare` if it fits.
    fn memory(&self, spare: Option<Arrays>, slots: usize) -> Arrays {
        let precision = self.precision();
        let fits = |c: &Coordinates| c.precision() == precision && c.len() == slots;
        spare.filter(|a| fits(&a.coordinates)).unwrap_or_else(|| {
            let mut arrays = Arrays::with_capacity(precision, slots);
            arrays.coordinates.grow(slots);
            arrays
        })
    }

    /// Returns arrays of `slots` slots with any content, to write all coordinates.
    pub fn arrays_mut(&mut self, slots: usize) -> &mut Arrays {
        self.is_received = false;
        let spare = self.spare.get_mut();
        let spare = spare.unwrap_or_else(PoisonError::into_inner).take();
        let old = self.arrays.take().or(spare);
        let arrays = self.memory(old, slots);
        self.arrays = arrays.into();
        self.arrays.get_mut().expect("set above")
    }

    /// Moves all points to the origin.
    pub fn clear(&mut self, len: usize) {
        self.received.resize(0);
        self.received_mut(len);
    }

    /// Returns memory for `len` coordinates, to receive positions.
    pub fn received_mut(&mut self, len: usize) -> &mut Received {
        if let Some(arrays) = self.arrays.take() {
            self.spare = Some(arrays).into();
        }
        self.received.resize(len);
        self.is_received = true;
        &mut self.received
    }

    /// Returns the arrays if they are built.
    pub fn built(&self) -> Option<&Arrays> {
        self.arrays.get()
    }

    /// Returns the positions as received, or `None` if there are only arrays.
    pub fn received(&self) -> Option<Positions<'_>> {
        self.is_received.then(|| self.received.positions())
    }
}

impl Clone for LazyCoordinates {
    fn clone(&self) -> Self {
        let mut copy = LazyCoordinates::with_capacity(self.precision(), 0);
        copy.clone_from(self);
        copy
    }

    /// Copies one form: the arrays if they are built.
    fn clone_from(&mut self, source: &Self) {
        if self.precision() != source.precision() {
            *self = LazyCoordinates::with_capacity(source.precision(), 0);
        }
        match source.arrays.get() {
            Some(source) => {
                let arrays = self.arrays_mut(source.coordinates.len());
                arrays.coordinates.clone_from(&source.coordinates);
                arrays.max_abs = source.max_abs;
            }
            None => self.received_mut(0).copy_from(source.received.positions()),
        }
    }
}
