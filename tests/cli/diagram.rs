//! `linkwatch diagram`, and `--invariants` of `certify` and `check`.

use crate::support::command::{linkwatch, text};
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// Writes closed curves as text, a block each.
fn write(folder: &Path, name: &str, curves: &[Vec<[f64; 3]>]) -> PathBuf {
    let block = |curve: &Vec<[f64; 3]>| {
        let lines = curve.iter().map(|[x, y, z]| format!("{x} {y} {z}\n"));
        lines.collect::<String>()
    };
    let blocks: Vec<String> = curves.iter().map(block).collect();
    let path = folder.join(name);
    std::fs::write(&path, blocks.join("\n")).unwrap();
    path
}

/// Returns a torus knot of two strands. It is right-handed if `twists` is positive.
fn torus_knot(twists: f64) -> Vec<[f64; 3]> {
    let point = |k: u32| {
        let t = f64::from(k) * std::f64::consts::TAU / 60.0;
        let r = 2.0 + (twists * t).cos();
        [
            r * (2.0 * t).cos(),
            r * (2.0 * t).sin(),
            -(twists * t).sin(),
        ]
    };
    (0..60).map(point).collect()
}

/// Borromean rings: rectangles in the planes of the axes, the first one moved.
fn rings(moved: f64) -> Vec<Vec<[f64; 3]>> {
    let ring = |turn: usize| {
        let corners = [[-1.0, -2.0], [1.0, -2.0], [1.0, 2.0], [-1.0, 2.0]];
        let by = if turn == 0 { moved } else { 0.0 };
        let point = |[x, y]: [f64; 2]| {
            let mut p = [x, y, 0.0];
            p.rotate_right(turn);
            [p[0] + 30.0, p[1], p[2] + by]
        };
        corners.map(point).to_vec()
    };
    (0..3).map(ring).collect()
}

#[test]
fn names_knots_and_prints_codes() {
    let folder = TempDir::new().unwrap();
    let curves = [&[torus_knot(3.0)][..], &rings(0.0)].concat();
    let path = write(folder.path(), "knots.txt", &curves);
    let run = linkwatch(&["diagram", text(&path), "--closed", "--code", "pd,gauss,dt"]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    for expected in [
        "curve 0: 3 crossings",
        "; v2 1, v3 1, determinant 3: right-handed 3_1\n  PD[X[",
        "\n  GaussCode[",
        "\n  DT: [(4, 6, 2)]\n",
        "curves 1, 2, 3: 8 crossings",
        "; determinant 16, no linking numbers, mu(1,2,3) = ",
        "3 unknots: no crossings are left\n",
    ] {
        assert!(run.stdout.contains(expected), "{expected}: {}", run.stdout);
    }
    let each = linkwatch(&[
        "diagram",
        text(&path),
        "--closed",
        "--each",
        "--code",
        "none",
    ]);
    assert_eq!(each.stdout.lines().count(), 2, "{}", each.stdout);
    let json = linkwatch(&["diagram", text(&path), "--closed", "--json"]);
    assert_eq!(json.stdout.lines().count(), 5, "{}", json.stdout);
    let first: serde_json::Value =
        serde_json::from_str(json.stdout.lines().next().unwrap()).unwrap();
    assert_eq!(first["pd"].as_array().unwrap().len(), 3);
    assert_eq!(first["knots"][0]["name"]["symbol"], "3_1");
}

#[test]
fn curves_that_touch_or_are_open_have_no_diagram() {
    let folder = TempDir::new().unwrap();
    let touching = torus_knot(0.0);
    let path = write(folder.path(), "touching.txt", &[touching, torus_knot(3.0)]);
    let run = linkwatch(&["diagram", text(&path), "--closed", "--each"]);
    assert_eq!(run.code, 3);
    assert!(
        run.stderr.contains("no diagram: parts of curve 0 touch"),
        "{}",
        run.stderr
    );
    assert!(run.stdout.contains("right-handed 3_1"), "{}", run.stdout);
    let run = linkwatch(&["diagram", text(&path), "--closed=false"]);
    assert_eq!(run.code, 2);
    assert!(
        run.stderr.contains("none of 2 curves is closed"),
        "{}",
        run.stderr
    );
}

#[test]
fn certificates_with_invariants_find_knots_and_rings_that_came_apart() {
    let folder = TempDir::new().unwrap();
    let model = |name: &str, twists: f64, moved: f64| {
        let curves = [&[torus_knot(twists)][..], &rings(moved)].concat();
        write(folder.path(), name, &curves)
    };
    let (before, after) = (model("before.txt", 3.0, 0.0), model("after.txt", 1.0, 9.0));
    let cert = folder.path().join("before.cert");
    let invariants = ["--closed", "--invariants", "self,triple"];
    let certify = [
        &["certify", text(&before), "-o", text(&cert)][..],
        &invariants,
    ]
    .concat();
    let run = linkwatch(&certify);
    assert_eq!(run.code, 0, "{}", run.stderr);
    let written = std::fs::read_to_string(&cert).unwrap();
    let lines: Vec<&str> = written.lines().collect();
    assert_eq!(lines[0], "4 # lines: 4");
    assert_eq!(lines[1..3], ["invariants 1 self", "self 0 1 1 3"]);
    assert_eq!(lines[3], "invariants 1 triple");
    assert!(lines[4].starts_with("triple 1 2 3 "), "{written}");
    // The certificate says what is compared.
    let run = linkwatch(&["check", text(&after), "--closed", "--baseline", text(&cert)]);
    assert_eq!(run.code, 1, "{}", run.stderr);
    for expected in [
        "the knot of curve 0 changed: was v2 1, v3 1, determinant 3, is v2 0, v3 0, determinant 1",
        "curves 1, 2, 3: triple linking number was mu ",
        ", is mu 0",
    ] {
        assert!(run.stdout.contains(expected), "{expected}: {}", run.stdout);
    }
    let frames = [text(&before), text(&after)];
    let check = [&["check", "--events=off"][..], &frames, &invariants].concat();
    let run = linkwatch(&check);
    assert_eq!(run.code, 1, "{}", run.stdout);
    let run = linkwatch(&[&check[..check.len() - 2], &[]].concat());
    assert_eq!(run.code, 0, "{}", run.stdout);
    // A recording keeps the findings, and its replay finds them again.
    let record = folder.path().join("run.mcap");
    linkwatch(&[&check[..], &["--record", text(&record)]].concat());
    let run = linkwatch(&["replay", text(&record)]);
    assert_eq!(run.code, 1, "{}", run.stdout);
    assert!(
        run.stdout.contains("the knot of curve 0 changed"),
        "{}",
        run.stdout
    );
    assert!(!run.stderr.contains("differ"), "{}", run.stderr);
}

#[test]
fn one_knot_alone_is_compared() {
    let folder = TempDir::new().unwrap();
    let knot = write(folder.path(), "a.txt", &[torus_knot(3.0)]);
    let moved = torus_knot(3.0)
        .into_iter()
        .map(|[x, y, z]| [x + 0.01, y, z]);
    let moved = write(folder.path(), "b.txt", &[moved.collect()]);
    let check = ["check", text(&knot), text(&moved), "--closed"];
    let run = linkwatch(&[&check[..], &["--invariants", "self"]].concat());
    assert_eq!(run.code, 0, "{}{}", run.stdout, run.stderr);
    assert_eq!(linkwatch(&check).code, 3);
}

/// Checks a model with these options. The result must be incomplete, for this reason.
fn undecided(model: &Path, more: &[&str], said: &str) {
    let check = ["check", text(model), "--closed"];
    let run = linkwatch(&[&check[..], more].concat());
    assert_eq!(run.code, 3, "{}{}", run.stdout, run.stderr);
    assert!(run.stdout.contains(said), "{}", run.stdout);
}

#[test]
fn invariants_that_are_not_compared_are_said() {
    let folder = TempDir::new().unwrap();
    let curves = [&[torus_knot(3.0)][..], &rings(0.0)].concat();
    let model = write(folder.path(), "a.txt", &curves);
    let cert = folder.path().join("a.cert");
    linkwatch(&["certify", text(&model), "--closed", "-o", text(&cert)]);
    // A certificate of linking numbers alone.
    let more = ["--baseline", text(&cert), "--invariants", "self"];
    undecided(&model, &more, "the certificate has no invariants (`self`)");
    // The images of curves are not considered.
    let more = [text(&model), "--cell", "90,90,90", "--invariants", "triple"];
    undecided(&model, &more, "no invariants (`triple`) in a periodic cell");
}

#[test]
fn the_knot_of_a_yarn_through_a_cell_is_not_verified() {
    let folder = TempDir::new().unwrap();
    let yarn = [0.0, 5.0, 10.0, 15.0].map(|x| [x, 1.0, 1.0]).to_vec();
    let ring = [[5.0, 5.0, 5.0], [8.0, 5.0, 5.0], [5.0, 8.0, 5.0]].to_vec();
    let model = write(folder.path(), "yarn.txt", &[yarn, ring]);
    let more = [
        text(&model),
        "--wrapped",
        "--cell",
        "20,20,20",
        "--invariants",
        "self",
    ];
    let said = "no invariants (`self`) of 1 curve that runs through the periodic cell";
    undecided(&model, &more, said);
}

/// A changed invariant shows that a knot changed in a step, but not at what fraction of the step.
#[test]
fn no_part_of_a_step_is_safe_if_only_a_knot_changed() {
    let folder = TempDir::new().unwrap();
    let frame = |k: u32| {
        let mut knot = torus_knot(3.0);
        // The lower strand of a crossing rises through the upper one.
        for p in &mut knot[3..=7] {
            p[2] += 0.25 * f64::from(k);
        }
        write(folder.path(), &format!("f{k}.txt"), &[knot])
    };
    let frames: Vec<PathBuf> = (0..12).map(frame).collect();
    let frames: Vec<&str> = frames.iter().map(|path| text(path)).collect();
    let safe = |more: &[&str]| {
        let check = ["check", "--closed", "--json", "--invariants", "self"];
        let run = linkwatch(&[&check[..], more, &frames].concat());
        assert_eq!(run.code, 1, "{}{}", run.stdout, run.stderr);
        let lines = run.stdout.lines().map(|line| {
            let line: serde_json::Value = serde_json::from_str(line).unwrap();
            line["report"].clone()
        });
        let changed = lines
            .into_iter()
            .find(|report| report["verdict"] == "changed");
        changed.unwrap()["safe_fraction"].as_f64()
    };
    assert_eq!(safe(&[]), None);
    let found = safe(&["--events=all"]).unwrap();
    assert!((0.0..1.0).contains(&found), "{found}");
}
