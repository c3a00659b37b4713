//! The command `linkwatch`.
fn main() {}
