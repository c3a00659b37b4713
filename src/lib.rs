//! linkwatch verifies the topology of loopy structures (yarn-level cloth, chainmail, rope) frame by frame:
//! the matrix of linking numbers between all closed curves, exactly.
//!
//! ```text
//! simulator ──shared memory──▶ bus ─▶ ingest ─▶ pairs ─▶ discretize ─▶ kernels ─▶ certificate ─▶ verdict ─┬▶ bus
//!             (iceoryx2)        │        ▲                                                                 ├▶ recording
//! recording, model file ────────┘        └── incremental: what moved, what it may have broken,             └▶ viewer
//!                                            and what passed through what
//! ```

#[cfg(feature = "bus")]
mod bus;
mod cancel;
mod certificate;
mod curve;
mod discretize;
mod error;
mod exact;
mod incremental;
#[cfg(any(feature = "bus", feature = "mcap"))]
mod ingest;
pub mod kernels;
pub mod model;
mod pairs;
pub mod plan;
pub mod scenes;
mod sinks;
mod verdict;
mod verifier;

#[cfg(feature = "bus")]
pub use bus::{
    Attached, Client, ClientOptions, Counters, Departure, Event, Finding, Frame, FrameLoan,
    MessageKind, Outcome, ServiceInfo, Sidecar, SidecarOptions, VerdictMessage, services,
};
pub use certificate::{Certificate, Change, ChangeKind, Comparison, Link};
pub use curve::{Basis, Curve, CurveSet, CurveSetBuilder, Point, Positions, Precision};
pub use discretize::{Polylines, homotopic_polylines};
pub use error::{Error, Result};
pub use incremental::{Events, PullThrough, Route, Work};
pub use plan::Plan;
pub use sinks::{BaselineRecord, FrameRecord, Overflow, Sink, SinkQueue, SinkSummary};
#[cfg(feature = "mcap")]
pub use sinks::{
    Ending, RecordedFrame, RecordedItem, RecordedProgress, RecordedVerdict, RecordingReader,
    RecordingSink,
};
#[cfg(feature = "rerun")]
pub use sinks::{ViewerSink, ViewerTarget};
pub use verdict::{AbortOn, Defect, DefectKind, Place, Report, Stats, Verdict};
pub use verifier::{Ladder, Progress, Timings, Verifier};

/// Compiles the README's example.
#[cfg(all(doctest, feature = "bus"))]
#[doc = include_str!("../README.md")]
struct Readme;
