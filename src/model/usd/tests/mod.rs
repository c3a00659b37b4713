//! Tests of the reader and the writer. `tests/models` has the files.

mod damaged;
mod pixar;
mod refused;
mod written;

use super::*;
use crate::curve::{Basis, CurveLabels, CurveSet, Point, Positions};
use crate::engine::Certifier;
use crate::model::tests::curves;
use crate::model::{Frames, ReadOptions};
use std::io::Cursor;
use std::path::{Path, PathBuf};

fn sample(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/models")
        .join(name)
}

/// Reads the frames of a file that are all valid.
fn frames(path: &Path) -> Vec<ModelFrame> {
    let frames = Frames::open(path, &ReadOptions::default()).unwrap();
    frames.map(|frame| frame.unwrap()).collect()
}

fn only(path: &Path) -> (CurveSet, CurveLabels) {
    let mut frames = frames(path);
    assert_eq!(frames.len(), 1);
    let frame = frames.remove(0);
    assert_eq!((frame.seq, frame.time), (0, 0.0));
    (frame.curves.unwrap(), (*frame.labels).clone())
}

fn links(set: &CurveSet) -> String {
    let mut certifier = Certifier::default();
    let (certificate, _) = certifier.certify(set);
    assert_eq!(certificate.undefined, []);
    let links = certificate.links.iter();
    links
        .map(|link| format!("{} {} {:+};", link.i, link.j, link.lambda))
        .collect()
}

/// Opens text or bytes.
fn parse(bytes: &[u8]) -> Result<Vec<ModelFrame>> {
    let mut motion = Motion::open(Cursor::new(bytes.to_vec()), bytes.len() as u64)?;
    let mut frames = Vec::new();
    while let Some(frame) = motion.next_frame()? {
        frames.push(frame);
    }
    Ok(frames)
}

/// Returns the error of a file or of its first frame.
fn error(text: &str) -> String {
    match parse(text.as_bytes()) {
        Err(e) => e.to_string(),
        Ok(frames) => frames[0].curves.as_ref().unwrap_err().to_string(),
    }
}

/// Asserts that two lists of points differ by at most `tolerance`.
fn assert_close(found: &[Point], expected: &[Point], tolerance: f64) {
    assert_eq!(found.len(), expected.len());
    for (p, q) in found.iter().zip(expected) {
        for x in 0..3 {
            assert!((p[x] - q[x]).abs() <= tolerance, "{p:?} {q:?}");
        }
    }
}

#[test]
fn reads_all_of_the_grammar_that_files_use() {
    let text = r##"#usda 1.0
( "A comment" ; doc = """Several
"lines" """
  customLayerData = { string a = "}" ; dictionary b = { asset c = @x}y.png@ } }
  metersPerUnit = 0.01, upAxis = "Z"
)
over "o" { def BasisCurves "ignored" {} }
class Xform "_c" ( doc = 'x' ) { }
def Scope "α" (
    prepend apiSchemas = ["A", "B"]
    kind = "component"
    variants = { string v = "w" }
)
{
    reorder nameChildren = ["b", "a"]
    custom rel target = [ </a.b>, </c[d]> ] # comment ] (
    prepend rel other = </a> ( customData = { int n = 1 } )
    rel none
    float3 color.connect = </m.out>
    asset file = @@@a@b]@@@
    string s = """a\""" # not a comment
    """ ; token t = 'b'
    matrix4d xformOp:transform:a:b = ( (1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (7, 8, 9, 1) )
    uniform token[] xformOpOrder = [ "xformOp:transform:a:b", ]
    def BasisCurves "b" { /* several
        lines **/ // one
        uniform token type = "linear"
        uniform token wrap = "periodic" (
            doc = "x" ; customData = { } )
        custom double[] x = [1, 2
        ]
        int[] curveVertexCounts = [ 3 ,3, ]
        point3f[] points.timeSamples = {
            1: [(0, 0, 0), (1, 0, 0), (0, 1, 0), (-0, 1e-3, .5), (+1, 2.5E2, -3), (0,0,1),],
            -1.5: [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 0), (1, 0, 0), (0, 1, 0)]
        }
        float[] widths (interpolation = "constant")
        float[] widths.timeSamples = { 0: [4] }
    }
}
"##;
    let frames = parse(text.as_bytes()).unwrap();
    assert_eq!(frames.len(), 3);
    assert_eq!(frames[0].labels.names, ["/α/b[0]", "/α/b[1]"]);
    assert_eq!(frames[0].labels.radii, [2.0, 2.0]);
    assert_eq!(frames[0].time, -1.5 / 24.0);
    // A scope has no transform.
    let set = frames[2].curves.as_ref().unwrap();
    assert_eq!(set.precision(), Precision::F32);
    let last = f64::from(0.001_f32);
    let expected = vec![[0.0, last, 0.5], [1.0, 250.0, -3.0], [0.0, 0.0, 1.0]];
    assert_eq!(curves(set)[1], (true, expected));
}
