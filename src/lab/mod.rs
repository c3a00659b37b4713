//! Laboratory: measures the stages, the kernels and the GPU adapters.
//!
//! Every measurement compares its results with the exact ones. A time is a median over runs
//! ([`Effort`]), in milliseconds. CPU time counts the work of all threads ([`timed`]).
//!
//! | question | measurement |
//! |---|---|
//! | time of each stage of a certificate | [`Run`] |
//! | speed of a kernel against its error | [`KernelRow`], [`Slope`], [`Plot`] |
//! | cost of moving frames | [`MotionRow`], of a [`FrameSource`] |
//! | adapter or CPU | `AdapterTimes`, `calibrate` (feature `gpu`); [`GrowingScenes`] |
//! | time and memory against size, frames on disk | [`ScalingStudy`] |
//! | published times | [`TABLE_1`] |
//!
//! ```
//! use linkwatch::kernels::Device;
//! use linkwatch::lab::{Run, Subject};
//!
//! let subject = Subject::scene("ribbon:segments=2000,lambda=10")?;
//! let [first, later] = Run::first_and_later(&Device::Cpu, &subject.curves, Some(&subject.exact))?;
//! assert!(first.equal && later.equal);
//! println!("{}", later.times);
//! # Ok::<(), linkwatch::Error>(())
//! ```

#[cfg(feature = "gpu")]
mod adapter;
#[cfg(feature = "gpu")]
mod calibrate;
mod certify;
mod clock;
mod figures;
mod growing;
mod inputs;
mod kernels;
mod motion;
mod plot;
mod published;
#[cfg(feature = "mcap")]
mod recorded;
mod scaling;
mod setting;
mod sizes;
mod slopes;
mod statistics;
mod subject;
mod table;

#[cfg(feature = "gpu")]
pub use adapter::{AdapterTimes, measure_adapter};
#[cfg(feature = "gpu")]
pub use calibrate::calibrate;
pub use certify::{Run, StageTimes};
pub use clock::{Elapsed, peak_mb, reset_peak, timed};
pub use figures::{
    error_against_beta, error_against_time, scaling_memory, scaling_time, time_against_size,
};
pub use growing::{GrowingScenes, faster_from};
pub use inputs::Input;
pub use kernels::{KernelEffort, KernelRow};
pub use motion::{FrameSource, GeneratedMotion, MotionRow, MotionStudy, MovedFrame};
pub use plot::{Plot, Series};
pub use published::{MACHINE, Published, Source, TABLE_1};
#[cfg(feature = "mcap")]
pub use recorded::RecordedMotion;
pub use scaling::{FramesCost, ScalingRow, ScalingStudy, StageCost};
pub use setting::Setting;
pub use sizes::{at_sizes, resized};
pub use slopes::Slope;
pub use statistics::{Effort, median, percentile};
pub use subject::Subject;
pub use table::Table;
