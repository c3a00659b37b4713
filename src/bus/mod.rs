//! Live frames and verdicts over shared memory: the only module that knows iceoryx2.
//!
//! ```text
//! Client (in the simulator) ──<name>/frames───▶ Sidecar (in `linkwatch watch`)
//!                           ◀─<name>/verdicts──
//! ```
//!
//! `docs/wire.md` describes services, layouts and codes for programs in other languages; `page`
//! compares its tables with the code.
//!
//! Both directions are publish-subscribe with safe overflow: nobody ever waits for a slow, stopped or dead
//! peer. An event beside each is a hint to look sooner; both sides look on a timer as well, since an event
//! may be lost (always over a bridge between hosts, now and then elsewhere).
//!
//! Either side may start first, die and come back. What a killed process leaves behind is removed by the
//! next one that opens the service.
//!
//! Trust ends at the user id. A frame that lies is refused; a process of the same user that tampers with the
//! shared memory itself (shrinks a segment under its reader, say) can still crash the sidecar, which is why
//! it is a process of its own, and why a simulator has to have its own opinion about silence.

mod client;
#[cfg(feature = "bus")]
mod event;
mod loan;
#[cfg_attr(
    not(feature = "bus"),
    allow(dead_code, reason = "for the watcher's end")
)]
mod message;
#[cfg(all(test, feature = "bus"))]
mod page;
#[cfg_attr(
    not(feature = "bus"),
    allow(dead_code, reason = "for the watcher's end")
)]
mod service;
mod services;
#[cfg(feature = "bus")]
mod sidecar;
#[cfg_attr(
    not(feature = "bus"),
    allow(dead_code, reason = "for the watcher's end")
)]
mod wire;

pub use client::{Client, ClientOptions, Departure, Outcome};
#[cfg(feature = "bus")]
pub use event::{Event, Frame};
pub use loan::FrameLoan;
pub use message::{Counters, Finding, MessageKind, VerdictMessage};
pub use services::{Attached, ServiceInfo, services};
#[cfg(feature = "bus")]
pub use sidecar::{Sidecar, SidecarOptions};
