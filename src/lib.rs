//! linkwatch verifies the topology of loopy structures (yarn-level cloth, chainmail, rope, ring
//! polymers) frame by frame: the matrix of linking numbers between all closed curves, exactly.
//!
//! # Start here
//!
//! - A simulator that is watched by the command `linkwatch watch` publishes its frames with a
//!   [`Client`](./struct.Client.html) (feature `client`). In other languages:
//!   [attaching a simulator](./attaching/index.html).
//! - A program that verifies its own frames feeds them to a [`Session`], and gets a [`Report`] on
//!   each.
//! - [`formats`] reads and writes curves and frames: BCC, OBJ, VECT, LAMMPS and NumPy
//!   files; [`scenes`] generates some with known linking numbers.
//! - The README has the first run and the verdicts, the book in `docs` everything else: a guide, a
//!   reference of the command, and the design.
//!
#![cfg_attr(feature = "verify", doc = "```")]
#![cfg_attr(not(feature = "verify"), doc = "```ignore")]
//! use linkwatch::{Basis, FrameInfo, Positions, RawFrame, Session, SessionOptions, Verdict};
//!
//! # fn main() -> linkwatch::Result<()> {
//! // Two closed polylines of 4 points: a square at z = 0, and one at y = 0 through the first.
//! let mut points = [
//!     [-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0],
//!     [0.0, 0.0, -1.0], [2.0, 0.0, -1.0], [2.0, 0.0, 1.0], [0.0, 0.0, 1.0],
//! ];
//! let first = RawFrame {
//!     basis: Basis::Polyline,
//!     counts: &[-4, -4], // numbers of points; minus: closed
//!     positions: Positions::F64(points.as_flattened()),
//! };
//! let mut session = Session::new(SessionOptions::default())?; // the first frame is the baseline
//! assert_eq!(session.feed(FrameInfo::at(0, 0.0), first)?.verdict, Verdict::Intact);
//! let linked = session.baseline().expect("the first frame was verified").links()[0];
//! assert_eq!((linked.i, linked.j, linked.lambda.abs()), (0, 1, 1));
//!
//! for point in &mut points[4..] {
//!     point[0] += 5.0; // the second square jumps out of the first
//! }
//! let positions = Positions::F64(points.as_flattened());
//! let second = RawFrame { basis: Basis::Polyline, counts: &[-4, -4], positions };
//! let report = session.feed(FrameInfo::at(1, 0.01), second)?;
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
//! # The library by purpose
//!
//! | purpose | items |
//! |---|---|
//! | curves of a frame | [`CurveSet`], [`Basis`], [`Positions`]; from files: [`formats`] |
//! | frames in memory of others | [`RawFrame`], for [`Session::receive`] |
//! | verification | [`Session`] with [`FrameInfo`], [`SessionOptions`], [`Strategy`], [`Events`] |
//! | single frames | [`Certifier`] |
//! | closed and open curves | [`Closing`] |
//! | periodic scenes | [`Cell`], [`SessionOptions::cell`], [`Unwrap`], [`period`] |
//! | findings | [`Report`] with [`Verdict`], [`Change`], [`PullThrough`], [`Defect`], [`Place`] |
//! | expected topology | [`Certificate`], [`Comparison`], [`Link`] |
//! | DNA, polymers | [`Ribbon`], [`GaussIntegrals`]: writhe, twist, linking of open curves |
//! | knots, triples of curves | [`Diagram`], [`diagrams`], [`Invariants`], [`TripleLink`] |
//! | thickness | [`Thickness`], [`struts`], [`Strut`], [`MinRad`] |
//! | cost of a frame | [`Stats`], [`Work`], [`Timings`], [`Progress`]; before the run: [`Plan`] |
//! | kernels and devices | [`kernels::Method`], [`kernels::Device`], [`homotopic_polylines`] |
//! | outputs | [`Sink`] behind a [`SinkQueue`]; the recording and the viewer |
//! | simulators | the bus: `Client`, and `Sidecar` for a watcher of your own |
//! | pictures of models and their links | [`picture`] |
//! | test scenes | [`scenes`] |
//!
//! # Features
//!
//! All are on by default. A feature turns on those that it needs: `bus`, `gpu`, `mcap` and `rerun`
//! turn on `verify`, and `cli` turns on `bus` and `mcap`. Without any feature the library has only
//! the vocabulary that all features share: [`Basis`], [`Positions`], [`Verdict`], [`Report`],
//! [`Error`].
//!
//! | feature | adds | main dependency |
//! |---|---|---|
//! | `client` | a simulator's end of the bus: `Client`, `services` | iceoryx2 |
//! | `verify` | the exact core: `Session`, which computes every linking number | rayon |
//! | `bus` | `client`, `verify` and the watcher's end: `Sidecar` | iceoryx2 |
//! | `cli` | the command `linkwatch`; no API | clap |
//! | `gpu` | kernels on a GPU: `SessionOptions::device` | wgpu |
//! | `mcap` | recordings: `RecordingSink`, `RecordingReader` | mcap |
//! | `rerun` | the viewer: `ViewerSink` | rerun |
//!
//! A simulator that publishes frames takes `default-features = false, features = ["client"]`, and
//! compiles no kernels. A program that verifies its own frames takes `features = ["verify"]`.
//!
//! # The way of a frame
//!
//! ```text
//! simulator ──shared memory──▶ bus ─▶ ingest ─▶ pairs ─▶ discretize ─▶ kernels ─▶ certificate ─┐
//!             (iceoryx2)        │        ▲                                                     │
//! recording, model file ────────┘        └── incremental: what moved, what it may have broken, │
//!                                            and what passed through what                      │
//! bus, recording, viewer ◀── verdict ◀─────────────────────────────────────────────────────────┘
//! ```

#![cfg_attr(docsrs, feature(doc_cfg))]
#![deny(clippy::missing_errors_doc)]

// The command names the public API as other programs do.
#[cfg(feature = "cli")]
extern crate self as linkwatch;

#[macro_use]
mod vocabulary;

#[cfg(feature = "client")]
mod bus;
#[cfg(feature = "verify")]
mod cancel;
#[cfg(feature = "verify")]
mod certificate;
#[cfg(feature = "cli")]
mod cli;
mod curve;
#[cfg(feature = "verify")]
mod diagram;
#[cfg(feature = "verify")]
mod discretize;
#[cfg(feature = "verify")]
mod engine;
#[cfg_attr(
    not(feature = "verify"),
    allow(dead_code, reason = "for the exact core")
)]
mod error;
#[cfg(feature = "verify")]
mod exact;
#[cfg(feature = "client")]
mod fork;
#[cfg(feature = "verify")]
pub mod formats;
#[cfg(feature = "verify")]
mod incremental;
#[cfg(feature = "verify")]
mod ingest;
#[cfg(feature = "verify")]
pub mod kernels;
#[cfg(feature = "verify")]
mod measure;
#[cfg(feature = "verify")]
mod pairs;
#[cfg(feature = "verify")]
mod periodic;
#[cfg(feature = "verify")]
pub mod picture;
#[cfg(feature = "verify")]
mod pool;
#[cfg(feature = "verify")]
mod random;
#[cfg(feature = "mcap")]
mod record;
#[cfg(feature = "cli")]
mod report;
#[cfg(feature = "verify")]
mod scene;
#[cfg(feature = "verify")]
pub mod scenes;
#[cfg(feature = "verify")]
mod session;
#[cfg(feature = "verify")]
mod simd;
#[cfg(feature = "verify")]
mod sinks;
mod verdict;
#[cfg(feature = "rerun")]
mod viewer;
#[cfg(feature = "verify")]
mod words;
#[cfg(all(doc, feature = "client"))]
#[doc = include_str!("../docs/reference/bus.md")]
pub mod attaching {}

#[cfg(feature = "client")]
pub use bus::{
    Attached, Client, ClientOptions, Counters, Departure, Finding, FrameLoan, FrameMemory,
    MessageKind, Outcome, ServiceInfo, VerdictMessage, WaitMode, services,
};
#[cfg(feature = "bus")]
pub use bus::{Event, Frame, LastLabels, Sidecar, SidecarOptions, SidecarState};
#[cfg(feature = "cli")]
#[doc(hidden)] // For the binary and the Python package of this repository only.
pub use cli::{FileReader, run_command, sort_by_number};
pub use curve::{Basis, Cell, CurveLabels, Image, Point, Positions, Precision};
pub use error::{Error, Result};
#[cfg(feature = "mcap")]
pub use record::{
    Ending, RecordedFrame, RecordedItem, RecordedVerdict, RecordingOptions, RecordingReader,
    RecordingSink, Retention,
};
#[cfg(feature = "cli")]
use report::{Conclusion, RunReport};
pub use verdict::{
    AbortOn, Change, ChangeKind, Clearance, CloseStrands, Defect, DefectKind, ImageLink,
    InvariantChange, LeftOut, Link, LoopPair, Place, PullThrough, Report, Stats, Verdict,
};
#[cfg(feature = "rerun")]
pub use viewer::{ViewerSink, ViewerTarget};
#[cfg(feature = "verify")]
pub use {
    certificate::{Certificate, Comparison},
    curve::{Curve, CurveSet},
    diagram::{Diagram, InvariantKind, Invariants, KnotName, TripleLink, diagrams},
    discretize::{Braid, BraidLoops, Braids, End, Polylines, chords, homotopic_polylines},
    engine::{Certifier, Ladder, Plan, Progress, SessionOptions, Strategy, Timings},
    incremental::{Events, Route, Work},
    ingest::{Closing, ClosingKind, ClosingNote, CurveSource, FrameInfo, RawFrame},
    measure::{
        Axis, ClearanceOptions, CurvePoint, GaussIntegrals, MinRad, Pairing, PairingReason, Ribbon,
        RibbonOptions, Strut, Thickness, struts,
    },
    periodic::{Unwrap, beside, period},
    session::{Continuation, Given, Received, Session, SessionState, VerifiedFrame},
    sinks::{
        BaselineRecord, FrameRecord, FrameTimes, LiveTimes, Overflow, RunProgress, Sink, SinkQueue,
        SinkSummary,
    },
};

/// Compiles the examples of the README and of the book. `tests/book` compares this list with the
/// pages that have some.
#[cfg(all(doctest, feature = "client", feature = "verify"))]
mod book {
    #[doc = include_str!("../README.md")]
    struct Readme;
    #[doc = include_str!("../docs/guide/attach.md")]
    struct Attach;
    #[doc = include_str!("../docs/guide/in-process.md")]
    struct InProcess;
}
