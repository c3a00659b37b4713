//! Tables of points: columns, separators, labels and errors.

use super::*;
use crate::formats::tests::{curves, frames_of};

/// Returns the frames of a text.
fn frames(text: &str, closed: Option<bool>, counts: Option<&[i32]>) -> Result<Vec<ModelFrame>> {
    let options = ReadOptions {
        closed,
        counts: counts.map(<[i32]>::to_vec),
        ..ReadOptions::default()
    };
    frames_of(read(text.as_bytes().into(), &options)?)
}

/// Returns the curves of the only frame of a text: true if closed, and x of all points.
fn shape(text: &str, closed: Option<bool>) -> Result<Vec<(bool, Vec<f64>)>> {
    let mut frames = frames(text, closed, None)?;
    assert_eq!(frames.len(), 1, "{text}");
    let xs = |(closed, points): (bool, Vec<Point>)| (closed, points.iter().map(|p| p[0]).collect());
    let set = frames.remove(0).curves?;
    Ok(curves(&set).into_iter().map(xs).collect())
}

#[test]
fn empty_lines_comments_and_labels_separate_curves() {
    let expected = [(true, vec![1.0, 2.0, 3.0]), (true, vec![4.0, 5.0])];
    for text in [
        "1 0 0\n2 0 0\n3 0 0\n\n4 0 0\n5 0 0\n",
        "\n\n1 0 0\n2 0 0\n3 0 0\n \n\n4 0 0\n5 0 0",
        "# a\n1 0 0\n2 0 0\n3 0 0\n# b\n4 0 0\n5 0 0\n\n# end\n",
        "Component 1 of 2:\r\n1, 0, 0\r\n2, 0, 0\r\n3, 0, 0\r\n\
         Component 2 of 2:\r\n4, 0, 0\n5,0,0",
        "1;0;0\n2;0;0\n3;0;0\nring b\n4;0;0\n5;0;0\n",
        "\"1\", \"0\",\"0\"\n\"2\",\"0\",0\n3,0,0\n\n4,0,0\n5,0,0\n",
        "1\t0\t0\t\n2\t0\t0\t\n3\t0\t0\t\n% b\n4\t0\t0\n5\t0\t0\n",
        "x,y,z\n1,0,0\n2,0,0\n3,0,0\n\nx,y,z\n4,0,0\n5,0,0\n",
        "id,\"X (mm)\",Y [mm],z,curve\n1,1,0,0,7\n2,2,0,0,7\n3,3,0,0,7\n4,4,0,0,9\n5,5,0,0,9",
        "Points:0,Points:1,Points:2,radius\n1,0,0,9\n2,0,0,9\n3,0,0,9\n\n4,0,0,9\n5,0,0,9",
        ",x,y,z,curve\n0,1,0,0,7\n1,2,0,0,7\n2,3,0,0,7\n0,4,0,0,9\n1,5,0,0,9\n",
        "Unnamed: 0,x,y,z\n0,1,0,0\n1,2,0,0\n2,3,0,0\n\n0,4,0,0\n1,5,0,0\n",
        "# z y x\n0 0 1\n0 0 2\n0 0 3\n\n0 0 4\n0 0 5\n",
        "5\n1 0 0\n2 0 0\n3 0 0\n\n4 0 0\n5 0 0\n",
        "1.0D+00 0d0 0\n2 0 0\n0.3D1 0 0\n\n4 0 0\n5 0 0\n",
        // Regression test: points with no-break spaces were skipped.
        "1 0 0\n2 0 0\n3\u{A0}0\u{A0}0\n\n4\u{202F}0\u{202F}0\n\u{A0}5 0 0\n",
    ] {
        assert_eq!(shape(text, Some(true)).unwrap(), expected, "{text}");
        assert!(begins(text.as_bytes()), "{text}");
    }
}

#[test]
fn a_column_that_numbers_points_cannot_number_curves() {
    for (text, number, counts) in [
        (
            "id,x,y,z\n1,1,0,0\n1,2,0,0\n2,3,0,0\n2,4,0,0\n",
            "1",
            [2, 2],
        ),
        (
            "x y z index\n1 0 0 7\n2 0 0 8\n3 0 0 7\n4 0 0 8\n",
            "7",
            [2, 2],
        ),
        (
            "id,n,x,y,z\n8,1,1,0,0\n8,2,2,0,0\n9,3,3,0,0\n9,4,4,0,0\n",
            "8",
            [2, 2],
        ),
        (
            ",x,y,z\n0,1,0,0\n1,2,0,0\n\n0,3,0,0\n1,4,0,0\n0,5,0,0\n",
            "0",
            [2, 3],
        ),
    ] {
        let e = shape(text, Some(true)).unwrap_err().to_string();
        assert!(e.contains(&format!("'{number}' again in a column")), "{e}");
        let given = frames(text, None, Some(&counts)).unwrap();
        assert!(given.iter().all(|frame| frame.curves.is_ok()), "{text}");
    }
    let divided = "curve,n,x,y,z\n7,9,1,0,0\n7,9,2,0,0\n8,,3,0,0\n8,,4,0,0\n";
    assert_eq!(shape(divided, Some(true)).unwrap().len(), 2);
    let closed = "id,x,y,z\n1,1,0,0\n2,2,0,0\n3,3,0,0\n1,1,0,0\n";
    assert_eq!(
        shape(closed, Some(true)).unwrap(),
        [(true, vec![1.0, 2.0, 3.0])]
    );
}

#[test]
fn counts_begin_the_frames_of_a_motion() {
    let text = "3\n1 0 0\n2 0 0\n3 0 0\n3\n4 0 0\n5 0 0\n6 0 0\n";
    let found = frames(text, Some(true), None).unwrap();
    let first = |frame: &ModelFrame| {
        (
            frame.info.seq,
            frame.curves.as_ref().unwrap().point(0, 0)[0],
        )
    };
    assert_eq!(
        found.iter().map(first).collect::<Vec<_>>(),
        [(0, 1.0), (1, 4.0)]
    );
    for (text, says) in [
        ("3\n1 0 0\n2 0 0\n", "3 points, too many for 12 bytes"),
        (
            "2\n1 0 0\n2 0 0\n3 0 0\n",
            "line 4): a point after the 2 of its frame",
        ),
        ("2\n2\n1 0 0\n2 0 0\n", "line 2): 0 points, 2 promised"),
        (
            "3\n1 0 0\n2 0 0\n2\n3 0 0\n4 0 0\n",
            "line 4): 2 points, 3 promised",
        ),
        (
            "1 0 0\n2 0 0\n2\n3 0 0\n4 0 0\n",
            "line 3): the number of points of a frame after 2",
        ),
        ("0\n", "a frame of 0 points"),
        ("9999999999\n1 0 0\n", "too many for 6 bytes"),
    ] {
        let error = frames(text, Some(true), None).unwrap_err().to_string();
        assert!(error.contains(says), "{error}");
    }
}

/// Regression test: the frames after a bad line were skipped.
#[test]
fn a_bad_line_of_a_frame_with_a_count_makes_that_frame_invalid() {
    let text = "3\n1 0 0\n2 0 0\n3 1 0\n3\n1 0 0\n2 nan 0\n3 1 0\n3\n4 0 0\n5 0 0\n6 1 0\n";
    let found = frames(text, Some(true), None).unwrap();
    let valid: Vec<bool> = found.iter().map(|frame| frame.curves.is_ok()).collect();
    assert_eq!(valid, [true, false, true]);
    let error = found[1].curves.as_ref().unwrap_err().to_string();
    assert!(
        error.contains("line 7): 'nan' is not a finite number"),
        "{error}"
    );
}

#[test]
fn text_that_does_not_say_which_curves_are_closed_is_refused() {
    let open = "1 0 0\n2 0 0\n3 1 0\n";
    let repeated = "1 0 0\n2 0 0\n3 1 0\n1 0 0\n";
    let error = shape(open, None).unwrap_err().to_string();
    let says = "nothing says if 1 of 1 curves are closed: pass the option `closed`";
    assert!(
        error.contains(says) && error.contains("option `counts=-3`"),
        "{error}"
    );
    let both = format!("{repeated}\n{open}");
    let error = shape(&both, None).unwrap_err().to_string();
    assert!(
        error.contains("nothing says if 1 of 2 curves are closed"),
        "{error}"
    );
    let ring = vec![1.0, 2.0, 3.0];
    let rounded = repeated.replace("3 1 0\n1 0 0", "3 1 0\n1.00001 0 5e-15");
    for repeated in [repeated, rounded.as_str()] {
        let found = shape(repeated, None).unwrap();
        let [(false, xs)] = found.as_slice() else {
            panic!("{found:?}");
        };
        assert_eq!(xs.len(), 4);
        let both = format!("{repeated}\n{open}");
        assert_eq!(
            shape(&both, Some(true)).unwrap(),
            [(true, ring.clone()), (true, ring.clone())]
        );
    }
    // The first frame decides whether curves are closed in later ones.
    let motion = format!("4\n{repeated}4\n{repeated}4\n{open}9 9 9\n");
    let found = frames(&motion, None, None).unwrap();
    let counts = |frame: &ModelFrame| frame.curves.as_ref().unwrap().counts().collect();
    let counts: Vec<Vec<i32>> = found.iter().map(counts).collect();
    assert_eq!(counts, [[4], [4], [4]]);
    assert_eq!(shape(open, Some(false)).unwrap(), [(false, ring)]);
    // Regression test: later frames were read as open curves.
    let motion = format!("3\n{open}3\n{open}");
    let found = frames(&motion, None, None).unwrap();
    assert_eq!(found.len(), 2);
    assert!(found.iter().all(|frame| frame.curves.is_err()));
    // Counts divide the points whatever separates them.
    let counted = frames(&both, None, Some(&[-3, 4]))
        .unwrap()
        .remove(0)
        .curves
        .unwrap();
    assert_eq!(counted.counts().collect::<Vec<_>>(), [-3, 4]);
    let error = frames(open, None, Some(&[-4]))
        .unwrap()
        .remove(0)
        .curves
        .unwrap_err();
    assert!(
        error
            .to_string()
            .contains("3 points do not fit 1 curves with 4 points"),
        "{error}"
    );
}

#[test]
fn what_may_divide_or_lose_points_is_refused_with_the_line() {
    for (text, says) in [
        ("1 0 0\n2 0\n", "line 2): 2 columns, expected 3"),
        (
            "1 0 0 4\n",
            "line 1): 4 columns, expected 3; a header names others",
        ),
        ("1 0 0\n2 0 x\n", "line 2): 'x', expected a number"),
        ("1 0 0\n2 nan 0\n", "'nan' is not a finite number"),
        ("1 0 0\nl.0 2.0 3.0\n", "'l.0', expected a number"),
        ("C 1 0 0\nC 2 0 0\n", "line 1): 4 columns, expected 3"),
        ("1,,0\n", "'', expected a number"),
        // Regression tests: these rows of numbers were skipped as labels.
        (
            "x,y,z\n1,0,0\n,,\n2,0,0\n",
            "line 3): 2 columns, expected 3",
        ),
        ("1,0,0\nNA,NA,NA\n2,0,0\n", "'NA', expected a number"),
        (
            "curve,x,y,z\na,1,0,0\na,NA,NA,NA\na,2,0,0\n",
            "'NA', expected a number",
        ),
        (
            "x,y,z,curve\n1,0,0,a\n,,,a\n2,0,0,a\n",
            "'', expected a number",
        ),
        (
            "curve,x,y,z\na,1,0,0\na,,,\na,2,0,0\n",
            "line 3): 3 columns, expected 4",
        ),
        (
            "1 0 0\n******** ******** 0.0\n2 0 0\n",
            "'********', expected a number",
        ),
        (
            "1 0 0\n0.612-100 0.612-101 1.0\n",
            "'0.612-100', expected a number",
        ),
        ("1;0;0\n0,0;1,0;0\n", "'0,0', expected a number"),
        (
            "1 0 0\n2.5\n",
            "'2.5', expected the number of points of a frame",
        ),
        (
            "x,y,z,time\n1,0,0,9\n",
            "line 1): a column 'time', which may say which points",
        ),
        ("x,y,z,curve,ring\n", "a column 'ring'"),
        (
            "x,y,z,curve\n1,0,0,a\n2,0,0,b\n3,0,0,a\n",
            "line 4): a point of curve 'a' after",
        ),
        ("x,y,z,r\n1,0,0\n", "line 2): 3 columns, expected 4"),
        // Regression tests: these columns were read as labels before x, y and z.
        (
            "theta,r,z\n1,0,0\n2,0,0\n",
            "line 1): the columns 'theta,r,z': name the coordinates x, y and z",
        ),
        ("# rod\nr phi z\n1 0 0\n2 0 0\n", "line 2): the columns"),
        ("1,0,0\n2,0,0\na;b;c\n3,0,0\n", "line 3): the columns"),
        ("1 0 0\n−2 −1 −1\n3 0 0\n", "'−2', expected a number"),
    ] {
        let error = frames(text, Some(true), None).unwrap_err().to_string();
        assert!(error.contains(says), "{text:?}: {error}");
        // Only with an error about the order of the curves, every line by itself is valid.
        assert_eq!(begins(text.as_bytes()), says.contains("after"), "{text}");
    }
    assert!(frames("# nothing\n", Some(true), None).unwrap().is_empty());
}

/// Regression test: in Latin-1, a point with no-break spaces was skipped.
#[test]
fn no_break_spaces_of_latin_1_separate_numbers() {
    let text = b"1 0 0\n2\xA00\xA00\n3 0 0\n";
    assert!(begins(text));
    let options = ReadOptions {
        closed: Some(true),
        ..ReadOptions::default()
    };
    let frames = frames_of(read(text[..].into(), &options).unwrap()).unwrap();
    assert_eq!(frames[0].curves.as_ref().unwrap().points(), 3);
}

/// Regression test: the zero bytes of a damaged file were a label, and the curves there missing.
#[test]
fn a_byte_0_is_an_error() {
    for (text, line) in [("1 0 0\n2 0 0\n\0\0\0\0", 3), ("1 0 0\n2 0 \x000\n", 2)] {
        let e = frames(text, Some(true), None).unwrap_err().to_string();
        assert!(e.contains(&format!("line {line}): a byte is 0")), "{e}");
    }
}

#[test]
fn other_texts_do_not_begin_as_points() {
    for text in [
        "",
        "# vtk DataFile Version 3.0\nrings\nASCII\nDATASET POLYDATA\nPOINTS 2 float\n\
         1 0 0\n2 0 0\nLINES 1 3\n2 0 1\n",
        "[package]\nname = \"a\"\nversion = \"1\"\n",
        "ATOM      1  CA  ALA A   1      11.104   6.134  -6.504\n",
        "v 0 0 0\nv 1 0 0\nl 1 2\n",
        "OFF\n8 6 12\n0 0 0\n1 0 0\n4 0 1 2 3\n",
        "a word\nanother\n1 0 0\n2 0 0\n",
    ] {
        assert!(!begins(text.as_bytes()), "{text}");
    }
}
