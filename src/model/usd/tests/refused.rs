//! Files and frames that are refused, with the reason.

use super::*;

/// A triangle in a prim with these properties.
fn triangle(properties: &str) -> String {
    format!(
        "#usda 1.0\ndef BasisCurves \"a\" {{\n uniform token type = \"linear\"\n uniform token wrap\
         = \"periodic\"\n int[] curveVertexCounts = [3]\n {properties}\n point3f[] points = \
         [(0, 0, 0), (1, 0, 0), (0, 1, 0)]\n}}\n"
    )
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
    assert!(e.contains("`usdcat --flatten IN --out OUT`"), "{e}");
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
            "float3 xformOp:scale = (0, 1, 1)\n\
             uniform token[] xformOpOrder = [\"!invert!xformOp:scale\"]",
            "(/a): xformOp:scale: a value that cannot be inverted",
        ),
        (
            "double3 xformOp:translate.spline = {}\n\
             uniform token[] xformOpOrder = [\"xformOp:translate\"]",
            "xformOp:translate of /a as a spline",
        ),
        (
            "int[] primvars:skel:jointIndices = [0]",
            "curves that are moved by a skeleton: /a",
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
        e.contains("no curves; not read, so not verified: 1 prim with curves of"),
        "{e}"
    );
    let e = error("#usda 1.0\ndef PointInstancer \"i\" {\n def BasisCurves \"c\" {} }\n");
    assert!(
        e.contains("curves that are copied by a PointInstancer: /i/c"),
        "{e}"
    );
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
fn a_frame_is_limited_by_the_size_of_its_file() {
    let n = (1 << 20) + 17;
    let text = triangle("")
        .replace("[3]", &format!("[{n}]"))
        .replace("(0, 1, 0)", &["(0,1,0)"].repeat(n - 2).join(","));
    // Text needs some bytes a point, so that only points that binary files share reach the limit.
    let mut motion = Motion::open(Cursor::new(&text), text.len() as u64).unwrap();
    for (bytes, read) in [(text.len() as u64, true), (2, true), (1, false)] {
        (motion.bytes, motion.read) = (bytes, 0);
        let curves = motion.next_frame().unwrap().unwrap().curves;
        match curves {
            Ok(curves) => assert!(read && curves.points() == n),
            Err(e) => {
                assert!(!read);
                let expected = "/a, time code 0): more than 1048592 points in a frame";
                assert!(e.to_string().contains(expected), "{e}");
            }
        }
    }
}
