//! Chainmail.
fn main() {}
