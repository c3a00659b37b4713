//! linkwatch verifies the topology of loopy structures (yarn-level cloth, chainmail, rope) frame by frame:
//! the matrix of linking numbers between all closed curves, exactly.
//!
//! ```text
//! simulator ──shared memory──▶ bus ─▶ ingest ─▶ pairs ─▶ discretize ─▶ kernels ─▶ certificate ─▶ verdict ─┬▶ bus
//!             (iceoryx2)        │                                                                          ├▶ recording
//! recording, model file ────────┘                                                                          └▶ viewer
//! ```

mod certificate;
mod curve;
mod error;
mod sinks;
mod verdict;

pub use certificate::{Certificate, Change, ChangeKind, Comparison, Link};
pub use curve::{Basis, Box3, Curve, CurveSet, CurveSetBuilder, Point, Positions, Precision};
pub use error::{Error, Result};
pub use sinks::{BaselineRecord, FrameRecord, Overflow, Sink, SinkQueue, SinkSummary};
#[cfg(feature = "mcap")]
pub use sinks::{
    Ending, Progress, RecordedFrame, RecordedItem, RecordedVerdict, RecordingReader, RecordingSink,
};
#[cfg(feature = "rerun")]
pub use sinks::{ViewerSink, ViewerTarget};
pub use verdict::{AbortOn, Defect, DefectKind, Place, Report, Stats, Verdict};
