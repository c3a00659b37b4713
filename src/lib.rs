//! linkwatch verifies the topology of loopy structures (yarn-level cloth, chainmail, rope, ring
//! polymers) frame by frame: the matrix of linking numbers between all closed curves, exactly.
//!
//! # Start here
//!
//! - A simulator that is watched by the command `linkwatch watch` publishes its frames with a
//!   [`Client`](./struct.Client.html) (feature `bus`). In other languages:
//!   [the wire format](./wire_format/index.html).
//! - A program that verifies its own frames calls [`Verifier::step`] with a [`CurveSet`], and gets
//!   a [`Report`].
//! - [`model::read`] reads curves from BCC, OBJ and VECT files; [`scenes`] generates some with known
//!   linking numbers.
//! - The README has the command, the verdicts, and which curves to publish.
//!
//! ```
//! use linkwatch::{AbortOn, Basis, CurveSet, Positions, Verdict, Verifier};
//!
//! # fn main() -> linkwatch::Result<()> {
//! // Two closed polylines of 4 points: a square at z = 0, and one at y = 0 through the first.
//! let mut points = [
//!     [-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0],
//!     [0.0, 0.0, -1.0], [2.0, 0.0, -1.0], [2.0, 0.0, 1.0], [0.0, 0.0, 1.0],
//! ];
//! let closed = [-4, -4]; // numbers of points; minus: closed
//! let positions = Positions::F64(points.as_flattened());
//! let mut curves = CurveSet::from_counts(Basis::Polyline, &closed, positions)?;
//!
//! let mut verifier = Verifier::new(AbortOn::Any); // the first frame is the baseline
//! assert_eq!(verifier.step(0, 0.0, &curves)?.verdict, Verdict::Intact);
//! let linked = verifier.baseline().expect("the first frame was verified").links[0];
//! assert_eq!((linked.i, linked.j, linked.lambda.abs()), (0, 1, 1));
//!
//! for point in &mut points[4..] {
//!     point[0] += 5.0; // the second square jumps out of the first
//! }
//! curves.update(Positions::F64(points.as_flattened()))?;
//! let report = verifier.step(1, 0.01, &curves)?;
//! assert_eq!(report.verdict, Verdict::Changed);
//! assert!(report.abort);
//! assert_eq!((report.changes[0].expected.abs(), report.changes[0].found), (1, 0));
//! for sentence in report.findings() {
//!     println!("{sentence}"); // curves 0 and 1 came apart: ..
//! }
//! # Ok(())
//! # }
//! ```
//!
//! # Features
//!
//! All are on by default. Without any, the library still computes every linking number exactly.
//!
//! | feature | adds | main dependency |
//! |---|---|---|
//! | `cli` | the command `linkwatch`; nothing in the library | clap |
//! | `bus` | live frames and verdicts over shared memory: `Client`, `Sidecar` | iceoryx2 |
//! | `gpu` | kernels on a GPU: `Verifier::set_device` | wgpu |
//! | `mcap` | recordings: `RecordingSink`, `RecordingReader` | mcap |
//! | `rerun` | the viewer: `ViewerSink` | rerun |
//!
//! A simulator that publishes frames takes `default-features = false, features = ["bus"]`.
//!
//! # The way of a frame
//!
//! ```text
//! simulator ──shared memory──▶ bus ─▶ ingest ─▶ pairs ─▶ discretize ─▶ kernels ─▶ certificate ─▶ verdict ─┬▶ bus
//!             (iceoryx2)        │        ▲                                                                 ├▶ recording
//! recording, model file ────────┘        └── incremental: what moved, what it may have broken,             └▶ viewer
//!                                            and what passed through what
//! ```

#![cfg_attr(docsrs, feature(doc_cfg))]

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
#[cfg(all(doc, feature = "bus"))]
#[doc = include_str!("../docs/wire.md")]
pub mod wire_format {}

#[cfg(feature = "bus")]
pub use bus::{
    Attached, Client, ClientOptions, Counters, Departure, Event, Finding, Frame, FrameLoan,
    MessageKind, Outcome, ServiceInfo, Sidecar, SidecarOptions, VerdictMessage, services,
};
pub use certificate::{Certificate, Change, ChangeKind, Comparison, Link};
pub use curve::{
    Basis, Curve, CurveSet, CurveSetBuilder, LongSegment, Point, Positions, Precision,
};
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

/// Compiles the examples of the README.
#[cfg(all(doctest, feature = "bus"))]
#[doc = include_str!("../README.md")]
struct Readme;
