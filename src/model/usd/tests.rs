//! Files that Pixar's library wrote (`tests/models/usd.py`), and files that are written here.

use super::*;
use crate::curve::{Basis, CurveLabels, CurveSet, Point, Positions};
use crate::model::tests::curves;
use crate::model::{FrameWriter, Frames, ReadOptions};
use crate::verifier::Verifier;
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
    let mut verifier = Verifier::default();
    let (certificate, _) = verifier.certify(set);
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
fn linked_rings_of_every_basis_are_linked() {
    for (name, basis) in [
        ("linear.usda", Basis::Polyline),
        ("bezier.usdc", Basis::Bezier),
        ("bspline.usdc", Basis::BSpline),
        ("catmull-rom.usda", Basis::CatmullRom),
    ] {
        let (set, labels) = only(&sample(name));
        assert_eq!(set.basis(), basis);
        assert_eq!(set.precision(), Precision::F32);
        assert_eq!(set.counts().collect::<Vec<_>>(), [-12, -12]);
        assert_eq!(links(&set), "0 1 -1;", "{name}");
        assert_eq!(labels.names, ["/rings[0]", "/rings[1]"]);
        assert_eq!(labels.radii, [0.125, 0.25]);
    }
}

#[test]
fn a_chain_in_compressed_arrays_has_its_links() {
    let (set, labels) = only(&sample("many.usdc"));
    assert_eq!(set.len(), 24);
    let lambda = |k: usize| if k % 2 == 0 { "-1" } else { "+1" };
    let expected: String = (0..23)
        .map(|k| format!("{k} {} {};", k + 1, lambda(k)))
        .collect();
    assert_eq!(links(&set), expected);
    let radius = |k: usize| if k % 3 > 0 { 0.0625 } else { 0.125 };
    assert_eq!(labels.radii, (0..24).map(radius).collect::<Vec<f32>>());
}

#[test]
fn samples_of_several_prims_are_frames_in_all_forms() {
    for name in ["apart.usda", "apart.usdc", "apart.usdz"] {
        let frames = frames(&sample(name));
        let seqs: Vec<u64> = frames.iter().map(|frame| frame.seq).collect();
        assert_eq!(seqs, [10, 12, 14, 15, 16], "{name}");
        for frame in &frames {
            assert_eq!(frame.time, frame.seq as f64 / 30.0);
            assert_eq!(frame.labels.names, ["/yarn/a", "/yarn/b"]);
            assert_eq!(frame.labels.radii, [0.125, 0.25]);
        }
        let sets: Vec<&CurveSet> = frames.iter().map(|f| f.curves.as_ref().unwrap()).collect();
        let found: Vec<String> = sets.iter().map(|set| links(set)).collect();
        assert_eq!(found, ["0 1 -1;", "0 1 -1;", "", "", ""]);
        // Between its samples at 14 and 16, the first ring is moved by 2.25, and the second one by
        // 0.1 per time code up to 15.
        assert_eq!(sets[3].point(0, 0), [1.0 - 2.25, 0.0, 0.0]);
        assert_eq!(sets[3].point(1, 0), [2.0, 0.0, 0.5]);
        assert_close(&[sets[1].point(1, 0)], &[[2.0, 0.0, 0.2]], 1e-15);
        assert_eq!(sets[4].point(1, 0), [2.0, 0.0, 0.5]);
    }
}

#[test]
fn transforms_are_those_of_pixars_library() {
    let [moved, flat] =
        ["transforms.usda", "transforms-flat.usdc"].map(|name| frames(&sample(name)));
    assert_eq!(moved.len(), 4);
    for (moved, flat) in moved.iter().zip(&flat) {
        assert_eq!((moved.seq, moved.time), (flat.seq, flat.time));
        let paths = [
            "/top/a",
            "/top/b[0]",
            "/top/b[1]",
            "/top/b/world",
            "/top/turn_XZY",
        ];
        assert_eq!(moved.labels.names[..5], paths);
        let [moved, flat] = [moved, flat].map(|frame| frame.curves.as_ref().unwrap());
        assert_eq!(moved.precision(), Precision::F64);
        let [moved, flat] = [moved, flat].map(curves);
        assert_eq!(moved.len(), 8);
        for (found, expected) in moved.iter().zip(&flat) {
            // The file has its rotations and expected points in single precision.
            assert_close(&found.1, &expected.1, 2e-6);
        }
    }
}

#[test]
fn pinned_splines_begin_and_end_at_their_points() {
    for (name, basis) in [
        ("pinned-bspline.usda", Basis::BSpline),
        ("pinned-catmull-rom.usdc", Basis::CatmullRom),
    ] {
        let (set, labels) = only(&sample(name));
        assert_eq!(set.basis(), basis);
        assert_eq!(set.counts().collect::<Vec<_>>(), [6, 4, 7]);
        let angle = |k: usize| k as f64 * std::f64::consts::FRAC_PI_6;
        for (i, (first, last)) in [(0, 3), (4, 5), (6, 10)].into_iter().enumerate() {
            let ends = [0, set.curve(i).segments as usize].map(|s| set.knot(i, s));
            let expected = [first, last].map(|k| [angle(k).cos(), angle(k).sin(), 0.0]);
            assert_close(&ends, &expected, 1e-7);
        }
        assert_eq!(labels.radii, [0.2, 0.25, 0.35]);
    }
    // Bezier curves reach their ends anyway.
    let (set, _) = only(&sample("open.usdc"));
    assert_eq!(set.precision(), Precision::F32);
    assert_eq!(set.counts().collect::<Vec<_>>(), [7, 4, 4]);
}

#[test]
fn a_file_that_needs_composition_is_refused_with_the_way_out() {
    let e = crate::model::read(&sample("composed.usda"))
        .unwrap_err()
        .to_string();
    assert!(
        e.contains("composed.usda: unsupported USD: /copy with references"),
        "{e}"
    );
    assert!(e.contains("usdcat --flatten"), "{e}");
    let text = |metadata: &str, prim: &str| {
        format!("#usda 1.0\n({metadata})\ndef X \"a\" ({prim}) {{}}\n")
    };
    for (metadata, arc) in [
        (
            "subLayers = [@a.usd@ (offset = 1)]",
            "a layer with sublayers",
        ),
        ("relocates = { </a>: </b> }", "a layer with relocates"),
    ] {
        assert!(error(&text(metadata, "")).contains(arc));
    }
    for (metadata, arc) in [
        (
            "prepend payload = @a.usd@</P> (scale = 2)\nkind = \"x\"",
            "/a with a payload",
        ),
        ("inherits = </c>", "/a with inherits"),
        ("specializes = </c>", "/a with specializes"),
        ("prepend variantSets = \"v\"", "/a with variants"),
        ("clips = { dictionary default = {} }", "/a with value clips"),
        (
            "add references = [@@@a@b@@@, </c{v=w}d>]",
            "/a with references",
        ),
    ] {
        let e = error(&text("", metadata));
        assert!(e.contains(arc), "{e}");
    }
    // Nothing is added.
    for metadata in [
        "references = []",
        "payload = None",
        "delete references = @a@",
    ] {
        assert!(error(&text("subLayers = [ ]", metadata)).contains("no BasisCurves"));
    }
}

/// A triangle in a prim with these properties.
fn triangle(properties: &str) -> String {
    format!(
        "#usda 1.0\ndef BasisCurves \"a\" {{\n uniform token type = \"linear\"\n uniform token wrap \
         = \"periodic\"\n int[] curveVertexCounts = [3]\n {properties}\n point3f[] points = \
         [(0, 0, 0), (1, 0, 0), (0, 1, 0)]\n}}\n"
    )
}

#[test]
fn errors_name_prim_and_numbers() {
    for (properties, expected) in [
        (
            "int[] curveVertexCounts = [2]",
            "/a, time code 0): curveVertexCounts add up to 2, points has 3",
        ),
        (
            "int[] curveVertexCounts = [4, -1]",
            "curve 1 of curveVertexCounts has -1 points",
        ),
        (
            "int[] curveVertexCounts = None",
            "curveVertexCounts has no value, expected int[]",
        ),
        (
            "uniform token type = \"round\"",
            "/a: type \"round\"; linear and cubic are read",
        ),
        (
            "uniform token type = \"cubic\" uniform token basis = \"hermite\"",
            "basis \"hermite\"",
        ),
        ("uniform token wrap = \"odd\"", "/a: wrap \"odd\""),
        (
            "token wrap.timeSamples = { 0: \"pinned\" }",
            "wrap of a changes over time",
        ),
        (
            "float[] widths = [1, 2]",
            "2 widths with the interpolation vertex, expected 3",
        ),
        (
            "float[] widths = [1, 2] (interpolation = \"odd\")",
            "interpolation \"odd\"",
        ),
        (
            "float[] widths = [-1]",
            "a width of -1, expected at least 0",
        ),
        ("float[] widths = [nan]", "a width of NaN"),
        (
            "double[] widths = [1]",
            "widths has 1 double precision numbers an element",
        ),
        (
            "uniform token[] xformOpOrder = [\"xformOp:skew\"]",
            "transform \"xformOp:skew\" of /a",
        ),
        (
            "uniform token[] xformOpOrder = [\"xformOp:scale\"]",
            "xformOp:scale, which is missing",
        ),
        (
            "float3 xformOp:scale = (0, 1, 1) uniform token[] xformOpOrder = [\"!invert!xformOp:scale\"]",
            "(/a): xformOp:scale: a value that cannot be inverted",
        ),
        (
            "double3 xformOp:translate.spline = {} uniform token[] xformOpOrder = [\"xformOp:translate\"]",
            "xformOp:translate of /a as a spline",
        ),
        (
            "int[] primvars:skel:jointIndices = [0]",
            "a skeleton moves its points",
        ),
    ] {
        let e = error(&triangle(properties));
        assert!(e.contains(expected), "{e:?} lacks {expected:?}");
    }
    let e = error(&triangle("").replace("(1, 0, 0)", "(1, inf, 0)"));
    assert_eq!(e, "curve 0, point 1: coordinate y is inf");
    let e = error(&triangle("").replace("(1, 0, 0)", "(1, 0)"));
    assert!(
        e.contains("not a valid USD (line 7): '), (0, 1, 0)]', expected ','"),
        "{e}"
    );
    let e = error(&triangle("").replace("point3f", "point3d"));
    assert!(
        e.contains("points has 3 double precision numbers an element, expected point3f[]"),
        "{e}"
    );
    let mixed =
        triangle("") + &triangle("uniform token type = \"cubic\"")[10..].replace("\"a\"", "\"b\"");
    let e = error(&mixed);
    assert!(
        e.contains("/a has closed polyline curves, /b has closed Bezier curves"),
        "{e}"
    );
    let e = error(&(triangle("").replace("BasisCurves", "NurbsCurves")));
    assert!(e.contains("/a of type NurbsCurves"), "{e}");
    let e = error(&triangle("uniform token purpose = \"guide\""));
    assert!(
        e.contains("the 1 prims with curves have the purpose proxy or guide"),
        "{e}"
    );
    let e = error("#usda 1.0\ndef PointInstancer \"i\" {\n def BasisCurves \"c\" {} }\n");
    assert!(e.contains("/i/c, which a PointInstancer copies"), "{e}");
    for (text, expected) in [
        (
            "#usda 1.0\ndef \"a\" {\n",
            "line 3): the file ends inside of /a",
        ),
        (
            "#usda 1.0\n\nfloat x = 1\n",
            "line 3): \"float\", expected def, over or class",
        ),
        (
            "#usda 1.0\ndef \"a\" { token x = 'b }\n",
            "a string does not end",
        ),
        ("#usda 1.0\n(timeCodesPerSecond = 0)\n", "whole file"),
        (
            "solid x",
            "'solid x', expected '#usda', 'PXR-USDC' or a package",
        ),
        ("", "'', expected"),
    ] {
        let e = error(text);
        assert!(e.contains(expected), "{e:?} lacks {expected:?}");
    }
    let e = error(&triangle("").replace("1.0\n", "1.0\n(timeCodesPerSecond = -1)\n"));
    assert!(e.contains("-1 time codes per second"), "{e}");
}

#[test]
fn an_invalid_frame_does_not_hide_later_ones() {
    let points = "point3f[] points.timeSamples = { 0: [(0,0,0), (1,0,0), (0,1,0)],\n\
                  2.5: [(0, 0, 0)], 3: None, 4: [(0,0,0), (1,0,0), (0,2,0)] }";
    let frames = parse(triangle(points).as_bytes()).unwrap();
    let found: Vec<_> = frames
        .iter()
        .map(|f| (f.seq, f.time, f.curves.is_ok()))
        .collect();
    let time = |code: f64| code / 24.0;
    // A time code that is no integer: frames are counted.
    let expected = [
        (0, 0.0, true),
        (1, time(2.5), false),
        (2, time(3.0), false),
        (3, time(4.0), true),
    ];
    assert_eq!(found, expected);
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
    matrix4d xformOp:transform:a:b = ( (1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1) )
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
    let set = frames[2].curves.as_ref().unwrap();
    assert_eq!(set.precision(), Precision::F32);
    let last = f64::from(0.001_f32);
    let expected = vec![[0.0, last, 0.5], [1.0, 250.0, -3.0], [0.0, 0.0, 1.0]];
    assert_eq!(curves(set)[1], (true, expected));
}

/// Returns curves of a basis: closed, open, open, closed.
fn mixed(basis: Basis, shift: f32) -> CurveSet {
    let counts = [-12, 13, 7, -9];
    let xyz: Vec<f32> = (0..3 * 41)
        .map(|k| (k as f32 * 0.7).sin() * 1e3 + shift)
        .collect();
    CurveSet::from_counts(basis, &counts, Positions::F32(&xyz)).unwrap()
}

fn write(path: &Path, frames: &[ModelFrame]) {
    let mut writer = FrameWriter::create(path).unwrap();
    for frame in frames {
        writer.frame(frame).unwrap();
    }
    writer.finish().unwrap();
}

fn frame(seq: u64, time: f64, labels: CurveLabels, curves: CurveSet) -> ModelFrame {
    let mut frame = ModelFrame::new(seq, Ok(curves));
    (frame.time, frame.labels) = (time, labels.into());
    frame
}

#[test]
fn written_frames_are_read_back_with_all_that_they_have() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.usda");
    let names = CurveLabels::named(["sleeve/0", "with \"quotes\" \\ and [1]", "", "ä"]);
    let mut names = names;
    names.names[2] = "c".into();
    for basis in Basis::ALL {
        for labels in [CurveLabels::default(), names.clone()] {
            let radii = |k: u64| [0.1, 0.5, k as f32, 1e-30];
            let same = labels.clone().with_radii(radii(0));
            let single = [frame(0, 0.0, labels.clone(), mixed(basis, 0.0))];
            // The radii change in the fourth frame only.
            let motion = [3, 4, 7, 100, 101].map(|k| {
                let labels = match k < 100 {
                    true => same.clone(),
                    false => labels.clone().with_radii(radii(k)),
                };
                frame(k, 0.1 * k as f64 - 1.0, labels, mixed(basis, k as f32))
            });
            for written in [&single[..], &motion[..1], &motion] {
                write(&path, written);
                let read = frames(&path);
                assert_eq!(read.len(), written.len());
                for (found, expected) in read.iter().zip(written) {
                    assert_eq!((found.seq, found.time), (expected.seq, expected.time));
                    assert_eq!(found.labels, expected.labels);
                    let [found, expected] =
                        [found, expected].map(|frame| frame.curves.as_ref().unwrap());
                    assert_eq!(found.basis(), basis);
                    assert_eq!(found.precision(), Precision::F32);
                    assert_eq!(curves(found), curves(expected));
                }
            }
        }
    }
}

#[test]
fn every_single_precision_number_is_written_exactly() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.usd");
    let mut xyz: Vec<f32> = vec![f32::MAX, f32::MIN_POSITIVE, -0.0, 1e-45, 1e16, 16_777_217.0];
    let bits = (0..3000_u32).map(|k| f32::from_bits(k.wrapping_mul(0x9e37_79b9)));
    xyz.extend(bits.filter(|x| x.is_finite()));
    xyz.truncate(xyz.len() / 3 * 3);
    let counts = [-(xyz.len() as i32 / 3)];
    let set = CurveSet::from_counts(Basis::Polyline, &counts, Positions::F32(&xyz)).unwrap();
    write(&path, &[ModelFrame::new(0, Ok(set.clone()))]);
    let bits = |set: &CurveSet| {
        curves(set)[0]
            .1
            .concat()
            .iter()
            .map(|x| x.to_bits())
            .collect::<Vec<_>>()
    };
    assert_eq!(bits(&only(&path).0), bits(&set));
}

#[test]
fn the_writer_refuses_what_the_format_cannot_hold() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.usda");
    let set = mixed(Basis::Polyline, 0.0);
    let labels = CurveLabels::default();
    let fails = |frames: &[ModelFrame]| {
        let mut writer = FrameWriter::create(&path).unwrap();
        let mut results = frames.iter().map(|frame| writer.frame(frame));
        let e = results.find_map(Result::err).unwrap().to_string();
        assert!(e.contains("a.usda: "), "{e}");
        e
    };
    let first = || frame(1, 0.0, labels.clone(), set.clone());
    let doubles = CurveSet::from_counts(Basis::Polyline, &[2], Positions::F64(&[0.1; 6])).unwrap();
    let e = fails(&[ModelFrame::new(0, Ok(doubles))]);
    assert!(e.contains("single precision would round"), "{e}");
    let e = fails(&[first(), first()]);
    assert!(e.contains("frame 1 after frame 1"), "{e}");
    for (labels, curves) in [
        (CurveLabels::named(["a", "b", "c", "d"]), set.clone()),
        (CurveLabels::default().with_radii([1.0; 4]), set.clone()),
        (labels.clone(), mixed(Basis::CatmullRom, 0.0)),
    ] {
        let e = fails(&[first(), frame(2, 0.0, labels, curves)]);
        assert!(
            e.contains("frame 2 has other curves, names or radii"),
            "{e}"
        );
    }
    let e = fails(&[ModelFrame::new(u64::MAX, Ok(set.clone()))]);
    assert!(e.contains("time codes are exact up to 2^53"), "{e}");
    let mut writer = FrameWriter::create(&path).unwrap();
    let e = writer
        .frame(&ModelFrame::new(0, Err(Error::Cancelled)))
        .unwrap_err();
    assert!(e.to_string().contains("cancelled"), "{e}");
    let binary = folder.path().join("a.usdc");
    let e = FrameWriter::create(&binary).err().unwrap().to_string();
    assert!(e.contains("write a text file (.usda)"), "{e}");
    assert!(!binary.exists());
}

/// Files of a few kilobytes in both forms.
const SMALL: [&str; 6] = [
    "apart.usda",
    "transforms.usda",
    "apart.usdc",
    "apart.usdz",
    "many.usdc",
    "pinned-catmull-rom.usdc",
];

/// Reads damaged bytes. Points cannot be more than the file may hold.
fn survives(bytes: &[u8], context: std::fmt::Arguments<'_>) {
    for frame in parse(bytes).into_iter().flatten() {
        if let Ok(set) = frame.curves {
            assert!(set.points() <= bytes.len(), "{context}");
            assert!(set.max_abs().is_finite(), "{context}");
        }
    }
}

#[test]
fn no_panic_on_truncated_files() {
    for name in SMALL {
        let bytes = std::fs::read(sample(name)).unwrap();
        assert!(!parse(&bytes).unwrap().is_empty());
        for n in 0..bytes.len() {
            survives(&bytes[..n], format_args!("{name}, {n} bytes"));
        }
    }
}

#[test]
fn no_panic_on_one_wrong_byte_anywhere() {
    for name in ["apart.usda", "apart.usdc", "many.usdc"] {
        let mut bytes = std::fs::read(sample(name)).unwrap();
        for at in 0..bytes.len() {
            let valid = bytes[at];
            // Each bit, and characters that open, end or continue something.
            let bits = (0..8).map(|k| valid ^ 1 << k);
            for value in bits.chain([0, 255, b'"', b'(', b'[', b'}', b'@', b'#', b'9', b'.']) {
                bytes[at] = value;
                survives(&bytes, format_args!("{name}, byte {at} = {value}"));
            }
            bytes[at] = valid;
        }
    }
}

#[test]
fn deep_nesting_does_not_overflow_the_stack() {
    let deep = |open: &str, close: &str| {
        let n = 100_000;
        format!(
            "#usda 1.0\ndef \"a\" {{ int[] x = {}{} }}",
            open.repeat(n),
            close.repeat(n)
        )
    };
    for (open, close) in [("[", "]"), ("(", ")"), ("{", "}")] {
        assert!(error(&deep(open, close)).contains("no BasisCurves"));
        assert!(error(&deep(open, "")).contains("does not end"));
    }
    let prims = format!(
        "#usda 1.0\n{}{}",
        "def \"a\" {".repeat(100_000),
        "}".repeat(100_000)
    );
    assert!(error(&prims).contains("no BasisCurves"));
}
