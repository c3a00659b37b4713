//! Periodic cells: linking numbers with images and pull-throughs between them, compared with those
//! of a supercell, in which every image within reach is a curve of its own.
//!
//! `cargo test --release --test periodic` compares hundreds of random scenes. Ten thousand of them,
//! for some minutes:
//!
//! ```sh
//! cargo test --release --test periodic -- --ignored --nocapture
//! ```
//!
//! Each scene depends only on its seed, which a failure prints.

mod exact_sums;
mod invariance;
mod jersey;
mod jumps;
mod limits;
mod periods;
mod quiet;
mod rejected;
mod scene;
mod supercell;
#[path = "../support/mod.rs"]
mod support;
mod through;
mod units;
mod yarn;
