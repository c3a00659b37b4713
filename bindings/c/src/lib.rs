//! The C interface of linkwatch. `include/linkwatch.h` is generated from these sources.
//!
//! Every function catches panics, because they must not cross a C caller. After a failure,
//! [`lw_last_error`] describes it.

#![expect(unsafe_code, reason = "the C ABI passes raw pointers")]
#![allow(non_camel_case_types, reason = "the names of the C interface")]

mod client;
mod curves;
mod error;
mod session;
mod strands;
mod verdict;

pub use client::*;
pub use curves::*;
pub use error::*;
pub use session::*;
pub use strands::*;
pub use verdict::*;

#[cfg(test)]
mod tests;
