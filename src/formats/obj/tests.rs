//! OBJ files.

use super::*;
use crate::formats::tests::{assert_error_contains, curves};

fn parse(text: &str) -> Result<CurveSet> {
    curves_in(text.as_bytes().into()).map(|(set, _)| set)
}

/// Returns vertex `n` of [`with_vertices`], from 1.
fn p(n: usize) -> Point {
    [n as f64, 0.1 * n as f64, -1e-3]
}

/// Returns `lines` after ten vertices.
fn with_vertices(lines: &str) -> String {
    let v = |n| format!("v {} {} {}\n", p(n)[0], p(n)[1], p(n)[2]);
    (1..=10).map(v).collect::<String>() + lines
}

/// Asserts the curves of `lines`: true if closed, and the vertices.
fn expect(lines: &str, expected: &[(bool, &[usize])]) {
    let set = parse(&with_vertices(lines)).unwrap();
    let expected: Vec<_> = expected
        .iter()
        .map(|&(closed, ns)| (closed, ns.iter().map(|&n| p(n)).collect()))
        .collect();
    assert_eq!(curves(&set), expected, "{lines}");
    assert_eq!(set.basis(), Basis::Polyline);
    assert_eq!(set.precision(), Precision::F64);
}

#[test]
fn a_long_line_is_one_curve() {
    expect(
        "l 1 2 3 4 1\nl 5 6 7\n",
        &[(true, &[1, 2, 3, 4]), (false, &[5, 6, 7])],
    );
    // A vertex that long polylines share does not join them.
    expect(
        "l 1 2 3\nl 3 4 5\n",
        &[(false, &[1, 2, 3]), (false, &[3, 4, 5])],
    );
}

/// The ring was two open curves.
#[test]
fn the_edge_from_the_end_of_a_long_line_to_its_start_closes_it() {
    expect(
        "l 1 2 3\nl 3 1\nl 4 5 6\n",
        &[(true, &[1, 2, 3]), (false, &[4, 5, 6])],
    );
    // An edge after another long line does not.
    expect(
        "l 1 2 3\nl 4 5 6\nl 3 1\n",
        &[(false, &[1, 2, 3]), (false, &[4, 5, 6]), (false, &[3, 1])],
    );
}

#[test]
fn a_backslash_continues_a_long_line() {
    expect("l 1 2 \\\n  3 4\\\r\n 1", &[(true, &[1, 2, 3, 4])]);
    expect("l 1 2 3 \\", &[(false, &[1, 2, 3])]);
    // A comment is not continued: the next line is read.
    expect(
        "# C:\\models\\\nl 1 2 3 # \\\nl 4 5 6",
        &[(false, &[1, 2, 3]), (false, &[4, 5, 6])],
    );
}

#[test]
fn short_lines_in_order_become_curves() {
    expect(
        "l 1 2\nl 2 3\nl 3 1\nl 4 5\nl 5 6\nl 7 8\n",
        &[(true, &[1, 2, 3]), (false, &[4, 5, 6]), (false, &[7, 8])],
    );
}

#[test]
fn short_lines_out_of_order_become_curves() {
    // The second curve is continued, also at its start, after the first one is closed.
    expect(
        "l 1 2\nl 5 6\nl 3 1\nl 2 3\nl 4 5\nl 7 6\n",
        &[(true, &[1, 2, 3]), (false, &[4, 5, 6, 7])],
    );
    expect("l 2 1\nl 1 2\n", &[(true, &[2, 1])]);
}

#[test]
fn curves_come_in_the_order_of_their_first_lines() {
    expect(
        "l 1 2 3\nl 4 5\nl 6 7 8 6\nl 6 5\nl 9 10\nl 1 3 2\n",
        &[
            (false, &[1, 2, 3]),
            (false, &[4, 5, 6]),
            (true, &[6, 7, 8]),
            (false, &[9, 10]),
            (false, &[1, 3, 2]),
        ],
    );
}

#[test]
fn reads_negative_textured_and_forward_indices() {
    expect("l -1 -2 -10\n", &[(false, &[10, 9, 1])]);
    expect(
        "l 1/4 2/ 3/1/1\nl -3 5\n",
        &[(false, &[1, 2, 3]), (false, &[8, 5])],
    );
    let set = parse("l 1 3 2\nv 0 0 0\nl -1 2\nv 1 1 1\nv 2 2 2").unwrap();
    assert_eq!(set.point(0, 1), [2.0; 3]);
    assert_eq!(set.point(1, 0), [0.0; 3]);
}

#[test]
fn ignores_other_statements() {
    let text = "mtllib \u{e4}.mtl\n\no name\nvt 0 0\nvn x y z\nf 1 2 99\n g\n\
                v 1 2 3 0.5\n\tv 4 5 6 0.1 0.2 0.3 # red\nusemtl #\nl 1 2#3\n";
    // A Latin-1 byte, as old exporters write it.
    let bytes: Vec<u8> = text.chars().map(|c| c as u8).collect();
    let (set, left_out) = curves_in((&bytes[..]).into()).unwrap();
    assert_eq!(left_out, []);
    assert_eq!(curves(&set), [(false, vec![[1., 2., 3.], [4., 5., 6.]])]);
}

#[test]
fn errors_name_the_line() {
    for (lines, expected) in [
        ("", "whole file): no curves"),
        ("f 1 2 3\n", "no statement l or curv"),
        ("l\n", "line 11): a line with fewer than two"),
        ("l 1\n", "fewer than two"),
        ("l 4 4\n", "vertex 4 to itself"),
        ("\nl 1 0\n", "line 12): vertex 0"),
        ("l 1 x\n", "'x', expected the number of a vertex"),
        ("l 1 /2\n", "'/2', expected"),
        ("l 1 2.0\n", "'2.0', expected"),
        ("l 1 -11\n", "vertex -11, but there are 10"),
        (
            "l 1 11\nl 12 2 3\nl 1 2 3\n",
            "line 12): vertex 12, but the file has 10",
        ),
        ("l 4294967296 2\n", "vertex 4294967296, but the file has 10"),
        ("l 4294967297 2\n", "vertex 4294967297, but"),
        ("l 99999999999999999999 2\n", "expected the number"),
        ("l -9223372036854775808 2\n", "but there are 10"),
        (
            "l 1 2\nl 3 2\nl 5 6\nl 2 4\n",
            "line 14): a third line at vertex 2, where the lines 11 and 12",
        ),
        ("v 1 2\n", "line 11): a vertex with 2 coordinates"),
        ("v 1 2 z\n", "'z', expected a number"),
        ("v 1 2 3 w\n", "'w', expected a number"),
        ("v 1 2 1e999\n", "'1e999' is not a finite number"),
        ("v NaN 2 1\n", "'NaN' is not a finite number"),
        ("v 1 inf 1\n", "'inf' is not a finite number"),
        ("l 1 \\\n2 \\\n\u{1b}[2J\n", "line 11): '\\u{1b}[2J'"),
    ] {
        assert_error_contains(parse(&with_vertices(lines)), expected);
    }
}

#[test]
fn reads_long_curves_in_chunks() {
    let n = 2049;
    let mut text: String = (0..n).map(|k| format!("v {k} 0 0\n")).collect();
    text += "l";
    (1..=n).for_each(|k| text += &format!(" {k}"));
    let set = parse(&format!("{text} 1\n")).unwrap();
    assert_eq!((set.len(), set.points()), (1, n));
    assert!(set.curve(0).closed);
    assert_eq!(set.point(0, n - 1), [2048.0, 0.0, 0.0]);
}

/// Returns the text of vertices, with their weights.
fn vertices(points: &[Point], weight: f64) -> String {
    let line = |[x, y, z]: &Point| format!("v {x:?} {y:?} {z:?} {weight}\n");
    points.iter().map(line).collect()
}

/// Returns `n` points without a symmetry.
fn points(n: usize) -> Vec<Point> {
    let at = |k: usize| [k as f64, (k * k % 7) as f64, (k * 5 % 3) as f64 - 0.25];
    (0..n).map(at).collect()
}

#[test]
fn a_curv_of_degree_one_is_the_polyline_of_its_vertices() {
    let text = vertices(&points(4), 1.0);
    let open = vec![(false, points(4))];
    let closed = vec![(true, points(4))];
    for (statements, expected) in [
        (
            "cstype bspline\ndeg 1\ncurv 0 1 1 2 3 4\nparm u 0 0 .3 .7 1 1\nend",
            &open,
        ),
        (
            "cstype bspline\ndeg 1\ncurv 0 9 -4 -3 \\\n -2 -1 -4\nparm u 0 1 2 \\\n3 4 5 6",
            &closed,
        ),
        // Exporters that write no knots, and no end.
        ("deg 1\ncstype bspline\ncurv 0 1 1 2 3 4 1\n", &closed),
        // As Blender and others write it: with a knot too many.
        (
            "cstype bspline\ndeg 1\ncurv 0 1 1 2 3 4 1\n\
             parm u 0 .125 .25 .375 .5 .625 .75 .875",
            &closed,
        ),
        (
            "cstype bspline\ndeg 1\ncurv 0 1 1 2 3 4\nparm u 0 0 .5 1 1",
            &open,
        ),
        ("cstype bezier\ndeg 1 1\ncurv 0 3 1 2 3 4\nend", &open),
        ("cstype rat bspline\ndeg 1\ncurv 0 1 1 2 3 4 1", &closed),
    ] {
        let text = format!("{text}{statements}");
        let (set, left_out) = curves_in(text.as_bytes().into()).unwrap();
        assert_eq!(left_out, [], "{statements}");
        assert_eq!(&curves(&set), expected, "{statements}");
    }
}

#[test]
fn other_free_form_curves_are_counted_with_the_first_line() {
    let text = vertices(&points(6), 1.0) + "v 0 0 0 2\nl 1 2 3 1\n";
    for (statements, why) in [
        ("curv 0 1 1 2\nend", "line 9, without cstype"),
        ("cstype bspline\ncurv 0 1 1 2\nend", "line 10, of degree 0"),
        (
            "cstype bezier\ndeg 3\ncurv 0 1 1 2 3 4",
            "line 11, of degree 3",
        ),
        (
            "cstype cardinal\ndeg 1\ncurv 0 1 1 2 3 4",
            "of the cstype 'cardinal'",
        ),
        (
            "cstype bspline\ndeg 1\ncurv 0 1 1 2 3\nparm u 0 0 1 2 2",
            "cut by its range",
        ),
        (
            "cstype bspline\ndeg 1\ncurv 0 2 1 2 3 4\nparm u 0 0 1 1 2 2",
            "broken by its knots",
        ),
        (
            "v 0 0 0 -1\ncstype rat bspline\ndeg 1\ncurv 0 1 1 2 8",
            "weights that are not positive",
        ),
    ] {
        let (set, left_out) = curves_in(format!("{text}{statements}\n").as_bytes().into()).unwrap();
        assert_eq!(set.len(), 1);
        let said = left_out[0].to_string();
        assert!(
            said.starts_with("1 free-form curve (curv in line"),
            "{said}"
        );
        assert!(
            left_out.len() == 1 && said.contains(why),
            "{said:?} lacks {why:?}"
        );
        // If no curve is read, the error names the reason.
        let alone = text.replace("l 1 2 3 1", "f 1 2 3") + statements;
        let error = curves_in(alone.as_bytes().into()).unwrap_err().to_string();
        assert!(
            error.contains("no curves; not read, so not verified: 1 free"),
            "{error}"
        );
    }
}

#[test]
fn other_elements_that_may_be_curves_are_counted_by_kind() {
    let text = vertices(&points(6), 1.0)
        + "polyline 1 2 3\nl 1 2 3 1\ncurv2 1 2\ncall other.obj\ncstype bspline\ndeg 3 3\n\
           surf 0 1 0 1 1 2 3 4\nparm u 0 1\ntrim 0 1 1\nend\ncdc 1 2 3 4\ncurv2 3 4\nsp 1\n";
    let (set, left_out) = curves_in(text.as_bytes().into()).unwrap();
    assert_eq!(set.len(), 1);
    let said: Vec<String> = left_out.iter().map(ToString::to_string).collect();
    let expected = [
        "2 unknown statements (the first one: line 7: 'polyline')",
        "2 curves on surfaces (curv2) (the first one: line 9: 'curv2')",
        "1 free-form curve (line 17: 'cdc')",
    ];
    assert_eq!(said, expected);
}
