//! `linkwatch certify`, with every kernel and device.

use crate::support::command::{linkwatch, text};
use crate::support::polygons::square;
use linkwatch::{Basis, CurveSet, Positions, formats};
use std::path::Path;
use tempfile::TempDir;

#[test]
fn reports_open_curves_and_repeated_vertices() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("open.obj");
    std::fs::write(
        &path,
        "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 1 1 0\nv 5 5 5\nv 6 6 6\nl 1 2 3 4 1\nl 5 6\n",
    )
    .unwrap();
    let run = linkwatch(&["certify", text(&path)]);
    assert_eq!((run.code, run.stdout.as_str()), (0, "2 # lines: 0\n"));
    assert!(
        run.stderr.contains("1 open curve skipped"),
        "{}",
        run.stderr
    );
    assert!(
        run.stderr.contains("1 repeated vertex merged"),
        "{}",
        run.stderr
    );
}

/// Two degenerate loops, and a link beside them.
#[test]
fn names_degenerate_loops_and_certifies_the_others() {
    let folder = TempDir::new().unwrap();
    let xyz: Vec<f32> = [
        vec![0.0; 12],
        square([0., 0., 0.], [0, 1]),
        square([1., 0., 0.], [0, 2]),
    ]
    .concat();
    let set = CurveSet::from_counts(Basis::Polyline, &[-4, -4, -4], Positions::F32(&xyz)).unwrap();
    let path = folder.path().join("flat.bcc");
    formats::write_bcc(&path, &set).unwrap();
    let run = linkwatch(&["certify", text(&path)]);
    assert_eq!(run.code, 3);
    assert!(
        run.stderr
            .contains("curve 0 has fewer than three distinct vertices"),
        "{}",
        run.stderr
    );
    assert!(
        run.stdout.starts_with("3 # lines: 2\n1,2,"),
        "{}",
        run.stdout
    );
}

/// All kernels give the same certificate, and report how it was decided.
#[test]
fn kernels_agree_and_report_how_pairs_were_decided() {
    let scene = "knit:rows=3,stitches=16,segments=576";
    let certify = |more: &[&str]| {
        let run = linkwatch(&[&["--json", "certify", scene], more].concat());
        assert_eq!(run.code, 0, "{}", run.stderr);
        serde_json::from_str::<serde_json::Value>(&run.stdout).unwrap()
    };
    let expected = certify(&[]);
    assert_eq!(expected["kernel"], "auto");
    assert_eq!(expected["ladder"]["summed"], 0);
    assert_eq!(
        expected["ladder"]["counted"],
        expected["stats"]["potential_links"]
    );
    let pairs = expected["stats"]["potential_links"].as_u64().unwrap();
    for (kernel, more) in [
        ("direct", ""),
        ("angle-sum", ""),
        ("barnes-hut", ""),
        ("barnes-hut", ",beta=2"),
        ("barnes-hut", ",beta=2,target=0.01"),
        ("fmm", ""),
        ("fmm", ",order=3"),
        ("interval", ""),
    ] {
        let found = certify(&["--kernel", &format!("{kernel}{more}")]);
        assert_eq!(found["certificate"], expected["certificate"], "{kernel}");
        let of = |what: &str| found["ladder"][what].as_u64().unwrap();
        assert_eq!(of("summed") + of("counted"), pairs, "{kernel}");
        // With the proven bound, all pairs are proven. With a coarse beta, few pairs are proven,
        // and no wrong number is accepted.
        if more.is_empty() {
            assert_eq!(of("counted"), 0, "{kernel}");
        }
        let error = found["ladder"]["largest_error"].as_f64().unwrap();
        assert!(error < 0.2, "{kernel} {more:?}: {error}");
    }
    let run = linkwatch(&["certify", scene, "--kernel", "guess"]);
    assert_eq!(run.code, 2);
}

/// Two linked squares whose edges are 1 apart in the maximum norm keep their linking number for
/// noise below half of that. With more noise, the segments that may touch are named.
#[test]
fn noise_keeps_the_number_until_segments_may_touch() {
    let folder = TempDir::new().unwrap();
    let xyz = [square([0., 0., 0.], [0, 1]), square([1., 0., 0.], [0, 2])].concat();
    let set = CurveSet::from_counts(Basis::Polyline, &[-4, -4], Positions::F32(&xyz)).unwrap();
    let model = folder.path().join("hopf.bcc");
    formats::write_bcc(&model, &set).unwrap();
    let certify = |noise: &str| linkwatch(&["certify", text(&model), "--noise", noise]);
    let exact = linkwatch(&["certify", text(&model)]).stdout;
    for noise in ["0", "0.1", "0.499"] {
        let run = certify(noise);
        assert_eq!(
            (run.code, &run.stdout),
            (0, &exact),
            "{noise}: {}",
            run.stderr
        );
    }
    for noise in ["0.5", "0.7", "100"] {
        let run = certify(noise);
        assert_eq!(
            (run.code, run.stdout.as_str()),
            (3, "2 # lines: 1\n0,1,undefined\n"),
            "{noise}"
        );
        assert!(
            run.stderr.contains("curves 0 and 1 are too close"),
            "{}",
            run.stderr
        );
        assert!(run.stderr.contains("segments"), "{}", run.stderr);
    }
    assert_eq!(certify("-1").code, 2);
    let run = linkwatch(&[
        "certify",
        "knit:rows=3,stitches=16,segments=576",
        "--noise",
        "0.1",
    ]);
    assert_eq!(run.code, 2);
    assert!(run.stderr.contains("splines"), "{}", run.stderr);
}

/// Devices are listed. The error of an unknown device lists the adapters. The CPU is always
/// available.
#[test]
fn lists_devices_and_rejects_unknown_ones() {
    let run = linkwatch(&["devices"]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert!(!run.stdout.is_empty());
    let names: Vec<String> = linkwatch(&["--json", "devices"])
        .stdout
        .lines()
        .map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap())
        .map(|device| device["name"].as_str().unwrap().to_string())
        .collect();
    let scene = "chainmail:rows=2,columns=2";
    let run = linkwatch(&["certify", scene, "--device", "no such adapter"]);
    assert_eq!(run.code, 2);
    for (index, name) in names.iter().enumerate() {
        let listed = format!("{index}: {name}");
        assert!(run.stderr.contains(&listed), "{}", run.stderr);
    }
    let certify = |device: &str| linkwatch(&["certify", scene, "--device", device]);
    let expected = certify("cpu");
    assert_eq!(expected.code, 0, "{}", expected.stderr);
    assert_eq!(certify("auto").stdout, expected.stdout);
    let on_adapter = certify("gpu");
    match names.is_empty() {
        true => assert_eq!(on_adapter.code, 2),
        false => assert_eq!(on_adapter.stdout, expected.stdout),
    }
    for index in 0..names.len() {
        assert_eq!(certify(&index.to_string()).stdout, expected.stdout);
    }
    assert_eq!(certify(&names.len().to_string()).code, 2);
}

/// Writes a frame with a periodic cell as an archive.
fn periodic(path: &Path, cell: &str, counts: &[i32], points: &[[f64; 3]]) {
    let positions = Positions::F64(points.as_flattened());
    let set = CurveSet::from_counts(Basis::Polyline, counts, positions).unwrap();
    let mut frame = formats::ModelFrame::new(0, Ok(set));
    frame.info.cell = Some(cell.parse().unwrap());
    let mut writer =
        formats::FrameWriter::create(path, formats::Format::of(path).unwrap()).unwrap();
    writer.frame(&frame).unwrap();
    writer.finish().unwrap();
}

/// Regression test: the command claimed that a scene of yarns had nothing to verify.
#[test]
fn a_cell_of_yarns_has_a_certificate_with_their_periods() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("weave.npz");
    let along = |k: usize| (0..5).map(move |i| (k, f64::from(i)));
    let point = |(k, x): (usize, f64)| match k {
        0 => [x, 1.0, 0.2],
        _ => [1.0, x, -0.2],
    };
    let points: Vec<[f64; 3]> = along(0).chain(along(1)).map(point).collect();
    periodic(&path, "4,4,4", &[5, 5], &points);
    let run = linkwatch(&["certify", text(&path)]);
    let periods = "periodic 2 # lines: 2\n0,,1,0,0,period\n1,,0,1,0,period\n";
    assert_eq!((run.code, run.stdout.as_str()), (0, periods));
    let says = "2 curves run through the cell: they have linking numbers with closed curves, but \
                not with one another; `check` and `watch` verify their pull-throughs";
    assert!(run.stderr.contains(says), "{}", run.stderr);
    assert!(!run.stderr.contains("skipped"), "{}", run.stderr);
    // Without pull-throughs, `check` verifies nothing.
    let run = linkwatch(&[
        "check",
        text(&path),
        text(&path),
        "--keep-order",
        "--events=off",
    ]);
    assert_eq!(run.code, 2);
    assert!(
        run.stderr.contains("2 of them run through the cell"),
        "{}",
        run.stderr
    );
    let run = linkwatch(&[
        "check",
        text(&path),
        text(&path),
        "--keep-order",
        "--events",
    ]);
    assert_eq!(run.code, 0, "{} {}", run.stdout, run.stderr);
    // A yarn that does not end at the image of its start.
    let mut torn = points;
    torn[4][2] += 0.01;
    periodic(&folder.path().join("torn.npz"), "4,4,4", &[5, 5], &torn);
    let run = linkwatch(&["certify", text(&folder.path().join("torn.npz"))]);
    let says = "curve 0 almost runs through the cell: its end is 0.01 away from the image 1,0,0";
    assert!(run.stderr.contains(says), "{}", run.stderr);
    assert!(
        run.stderr.contains("1 open curve skipped"),
        "{}",
        run.stderr
    );
}

/// Regression test: a contact with an image gave no warning and exit code 0.
#[test]
fn a_contact_with_an_image_is_told_as_one_of_two_curves() {
    let folder = TempDir::new().unwrap();
    for (name, at, image) in [("inside", 2.0, "curves 0 and 1"), ("across", -8.0, "image")] {
        let path = folder.path().join(format!("{name}.npz"));
        let flat = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
        let ring = |x: f64| flat.map(move |[a, b]| [x + a, b + 0.1 * x, 0.0]);
        periodic(
            &path,
            "10,10,10",
            &[-4, -4],
            &[ring(0.0), ring(at)].concat(),
        );
        let run = linkwatch(&["certify", text(&path)]);
        assert_eq!(run.code, 3, "{name}: {}", run.stderr);
        let warning = run.stderr.lines().find(|line| line.contains("touch"));
        let warning = warning.unwrap_or_default();
        assert!(
            warning.contains(image) && warning.contains("near (1."),
            "{}",
            run.stderr
        );
        assert!(
            run.stderr
                .contains("1 pair or curve without a linking number"),
            "{}",
            run.stderr
        );
        let run = linkwatch(&["certify", "--json", text(&path)]);
        let json: serde_json::Value = serde_json::from_str(&run.stdout).unwrap();
        let undefined = &json["certificate"]["undefined"];
        assert_eq!(undefined[0]["kind"], "contact", "{name}: {undefined}");
        let run = linkwatch(&["check", text(&path), text(&path), "--keep-order"]);
        assert_eq!(run.code, 3, "{name}: {}", run.stdout);
        assert!(run.stdout.contains("touch"), "{name}: {}", run.stdout);
    }
}
