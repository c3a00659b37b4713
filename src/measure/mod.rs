//! Measures of curves: thickness, ropelength and clearance; writhe, twist and Gauss integrals.

mod ribbon;
mod thickness;

pub use self::ribbon::{Axis, GaussIntegrals, Pairing, PairingReason, Ribbon, RibbonOptions};
pub(crate) use self::thickness::ClearanceMonitor;
pub use self::thickness::{ClearanceOptions, CurvePoint, MinRad, Strut, Thickness, struts};
#[cfg(feature = "rerun")]
pub(crate) use self::thickness::{CloseBlock, REACH, close_blocks};
