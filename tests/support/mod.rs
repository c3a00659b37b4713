//! Support that the test programs share.

#![allow(dead_code, reason = "each test program uses a part")]

#[cfg(feature = "cli")]
pub mod command;
#[path = "../../src/kernels/tests/oracle.rs"]
pub mod oracle;
pub mod polygons;
#[path = "../../src/random.rs"]
pub mod random;
#[cfg(feature = "bus")]
pub mod raw_bus;
#[cfg(feature = "verify")]
pub mod session;
pub mod time;
pub mod trial;
