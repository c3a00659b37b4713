//! Tests of the command as a process: its output, its streams and its exit codes.

mod arguments;
mod cells;
mod certify;
mod check;
mod closing;
mod convert;
mod diagram;
mod explain;
mod formats;
mod frames;
mod messages;
mod output;
mod sequences;
#[path = "../support/mod.rs"]
mod support;
mod viewer;
mod writhe;

use linkwatch::formats::write_bcc;
use linkwatch::{Basis, CurveSet, Positions};
use std::path::{Path, PathBuf};
use support::polygons::square;

/// Three squares. The first two are linked if `at` is 1, touch if it is 2, and are apart if it is
/// 5. The third one is linked with the second.
fn chain(folder: &Path, name: &str, at: f32) -> PathBuf {
    let xyz: Vec<f32> = [
        square([at - 1.0, 0., 0.], [0, 1]),
        square([1., 0., 0.], [0, 2]),
        square([2., 0., 0.5], [0, 1]),
    ]
    .concat();
    let set = CurveSet::from_counts(Basis::Polyline, &[-4, -4, -4], Positions::F32(&xyz)).unwrap();
    let path = folder.join(name);
    write_bcc(&path, &set).unwrap();
    path
}
