#![cfg(feature = "bus")]

mod page;
mod wire;
