//! Live frames and verdicts over shared memory: the only module that knows iceoryx2.
//!
//! ```text
//! Client (in the simulator) ──<name>/frames───▶ Sidecar (in `linkwatch watch`)
//!                           ◀─<name>/verdicts──
//! ```
//!
//! `docs/reference/bus.md` describes services, layouts and codes for programs in other languages;
//! tests compare its tables with the code.
//!
//! Both directions are publish-subscribe with safe overflow: no process ever waits for a slow,
//! stopped or dead peer. An event service beside each of them wakes the other side early. Both
//! sides also check on a timer, because an event may be lost (always over a bridge between hosts,
//! occasionally elsewhere).
//!
//! Either side may start first, die and come back. The next process that opens the service removes
//! the files that a killed process left behind.
//!
//! Processes of the same user are trusted with the shared memory, but not with its content. An
//! invalid frame is rejected. A process of the same user that tampers with the shared memory itself
//! (for example, shrinks a segment while it is read) can still crash the sidecar. Therefore the
//! sidecar is a process of its own, and a simulator must decide by itself what silence means.
//!
//! The sidecar reads frames as slices (`&[f32]`) in shared memory. That is sound, because nobody
//! writes to them: a publisher gives up the memory of a frame when it sends it
//! ([`Client::send`] takes it by value), and iceoryx2 lends the same memory again only after every
//! subscriber has released it. Only a program that keeps the pointer and writes through it breaks
//! this rule. Values are copied before they are checked, so that even then the curves that are
//! verified are valid ones.

#![cfg_attr(
    not(feature = "bus"),
    allow(dead_code, reason = "for the watcher's end")
)]

mod client;
#[cfg(feature = "bus")]
mod event;
mod frames;
mod ipc;
mod message;
mod remains;
mod room;
mod service;
mod services;
#[cfg(feature = "bus")]
mod sidecar;
mod wait_mode;
mod watcher;
mod wire;

pub use client::{Client, ClientOptions, FrameLoan, Outcome};
#[cfg(feature = "bus")]
pub use event::{Event, Frame, LastLabels};
pub use frames::FrameMemory;
pub use message::{Counters, Finding, MessageKind, VerdictMessage};
pub use services::{Attached, ServiceInfo, services};
#[cfg(feature = "bus")]
pub use sidecar::{Sidecar, SidecarOptions, SidecarState};
pub use wait_mode::WaitMode;
pub use watcher::Departure;

#[cfg(test)]
mod tests;
