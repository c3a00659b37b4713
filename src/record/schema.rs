//! Messages of a recording, which `cargo run -p schemas` generates from `schemas/linkwatch.proto`.

#![allow(clippy::all, dead_code, reason = "generated")]

include!("../../schemas/linkwatch.rs");
