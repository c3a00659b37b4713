//! `linkwatch study` at the boundary of its process.

use std::process::{Command, Output};

/// Runs `linkwatch study frames`: exit code, stdout, stderr.
fn frames(args: &[&str]) -> (i32, String, String) {
    let Output {
        status,
        stdout,
        stderr,
    } = Command::new(env!("CARGO_BIN_EXE_linkwatch"))
        .args(["study", "frames"])
        .args(args)
        .output()
        .unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (status.code().unwrap(), text(stdout), text(stderr))
}

/// A scene that has a diameter.
const KNIT: &str = "knit:rows=3,stitches=16,segments=576";

#[test]
fn a_table_of_motions_and_amplitudes() {
    let (code, stdout, stderr) = frames(&[
        KNIT,
        "--frames",
        "7",
        "--motions",
        "iid,rotate,smooth+translate",
        "--amplitudes",
        "0,0.05",
    ]);
    assert_eq!((code, stderr.as_str()), (0, ""), "{stdout}");
    let lines: Vec<&str> = stdout.lines().collect();
    let says = format!("{KNIT}: 3 curves of 576 segments, 1 across; 7 frames each");
    assert!(lines[0].starts_with(&says), "{stdout}");
    assert!(lines[1].starts_with("motion"), "{stdout}");
    // A motion without an amplitude is measured once.
    let rows: Vec<[&str; 2]> = lines[2..7]
        .iter()
        .map(|line| {
            let mut words = line.split_whitespace();
            assert!(line.ends_with(" 7/7"), "{line}");
            [words.next().unwrap(), words.next().unwrap()]
        })
        .collect();
    let expected = [
        ["iid", "0"],
        ["iid", "0.05"],
        ["rotate", "0"],
        ["smooth+translate", "0"],
        ["smooth+translate", "0.05"],
    ];
    assert_eq!(rows, expected);
    assert!(
        lines[7].contains("; 35 of 35 verdicts as in the full run"),
        "{stdout}"
    );
    assert_eq!(lines.len(), 8);
}

#[test]
fn the_result_as_json() {
    let scene = "chainmail:rows=3,columns=3";
    let (code, stdout, _) = frames(&[
        scene,
        "--diameter",
        "0.2",
        "--frames",
        "60",
        "--amplitudes",
        "0,0.1,8",
        "--motions",
        "smooth,still,iid",
        "--threads",
        "1",
        "--json",
    ]);
    assert_eq!(code, 0, "{stdout}");
    let json: serde_json::Value = serde_json::from_str(&stdout).unwrap();
    assert_eq!(json["model"], scene);
    assert_eq!((&json["frames"], &json["threads"]), (&60.into(), &1.into()));
    let positive = |value: &serde_json::Value| value.as_f64().is_some_and(|x| x > 0.0);
    assert!(["read_ms", "full_ms", "update_ms"].map(|key| positive(&json[key])) == [true; 3]);
    let rows = json["rows"].as_array().unwrap();
    assert_eq!(rows.len(), 7);
    assert_eq!(
        (&rows[2]["motion"], &rows[2]["amplitude"]),
        (&"smooth".into(), &8.0.into())
    );
    assert_eq!(rows[3]["motion"], "still");
    for row in rows {
        assert!(positive(&row["frame_ms"]) && positive(&row["frame_p95_ms"]));
        let routes = ["full", "quiet", "partial"].map(|r| row["routes"][r].as_u64().unwrap());
        assert_eq!(routes.iter().sum::<u64>(), 60);
        // Every second frame.
        assert_eq!((&row["compared"], &row["equal"]), (&30.into(), &30.into()));
    }
    // Noise of 8 diameters tears a mail; that is no error of the study.
    assert_eq!(rows[0]["not_intact"], 0);
    assert!(rows[6]["not_intact"].as_u64().unwrap() > 20, "{stdout}");
}

#[test]
fn bad_arguments_exit_with_2() {
    for (args, says) in [
        (&["ribbon"][..], "ribbon has no diameter of its own"),
        (&["none.bcc", "--diameter", "1"], "none.bcc: No such file"),
        (
            &["Cargo.toml", "--diameter", "1"],
            "Cargo.toml: unknown kind of file",
        ),
        (&["rope"], "scene rope: unknown (known: chainmail"),
        (&["knit:rows=x"], "rows is 'x'"),
        (&[KNIT, "--diameter", "0"], "expected a number above 0"),
        (&[KNIT, "--diameter", "nan"], "expected a number above 0"),
        (
            &[KNIT, "--amplitudes", "0.1,inf"],
            "expected numbers from 0 on",
        ),
        (&[KNIT, "--motions", "iid,jump"], "unknown motion 'jump'"),
        (&[KNIT, "--frames", "0"], "0 is not in 1.."),
        (&[], "MODEL|SCENE"),
    ] {
        let (code, stdout, stderr) = frames(args);
        assert_eq!((code, stdout.as_str()), (2, ""), "{args:?}");
        assert!(stderr.contains(says), "{stderr}");
    }
}

/// With the search for pull-throughs both verifiers tell the same, and there are some where all moves far.
#[test]
fn pull_throughs_are_compared_too() {
    let (code, stdout, stderr) = frames(&[
        KNIT,
        "--frames",
        "6",
        "--motions",
        "iid",
        "--amplitudes",
        "0.01,2",
        "--self",
        "--json",
    ]);
    assert_eq!((code, stderr.as_str()), (0, ""), "{stdout}");
    let out: serde_json::Value = serde_json::from_str(&stdout).unwrap();
    assert_eq!(
        (&out["events"], &out["compared"]),
        (&"all".into(), &12.into())
    );
    assert_eq!(out["rows"][0]["events"], 0);
    assert!(out["rows"][1]["events"].as_u64().unwrap() > 0, "{stdout}");
}
