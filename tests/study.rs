//! Tests of `linkwatch study` as a process.

mod support;

use serde_json::{Value, json};
use support::command::{Run, linkwatch};

/// Runs `linkwatch study frames`.
fn frames(args: &[&str]) -> Run {
    study("frames", args)
}

/// Runs `linkwatch study`.
fn study(what: &str, args: &[&str]) -> Run {
    linkwatch(&[&["study", what], args].concat())
}

/// A scene that has a diameter.
const KNIT: &str = "knit:rows=3,stitches=16,segments=576";

#[test]
fn prints_a_table_of_motions_and_amplitudes() {
    let Run {
        code,
        stdout,
        stderr,
    } = frames(&[
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
fn prints_the_result_as_json() {
    let scene = "chainmail:rows=3,columns=3";
    let Run { code, stdout, .. } = frames(&[
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
    // Noise of 8 diameters breaks a mail; that is not an error of the study.
    assert_eq!(rows[0]["not_intact"], 0);
    assert!(rows[6]["not_intact"].as_u64().unwrap() > 20, "{stdout}");
}

#[test]
fn bad_arguments_exit_with_2() {
    for (args, says) in [
        (&["ribbon"][..], "ribbon has no diameter"),
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
            "expected numbers of at least 0",
        ),
        (&[KNIT, "--motions", "iid,jump"], "unknown motion 'jump'"),
        (&[KNIT, "--frames", "0"], "0 is not in 1.."),
        (&[], "MODEL|SCENE"),
    ] {
        let Run {
            code,
            stdout,
            stderr,
        } = frames(args);
        assert_eq!((code, stdout.as_str()), (2, ""), "{args:?}");
        assert!(stderr.contains(says), "{stderr}");
    }
}

/// Both verifiers report the same pull-throughs, and there are some if all points move far.
#[test]
fn compares_pull_throughs_as_well() {
    let Run {
        code,
        stdout,
        stderr,
    } = frames(&[
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

/// Returns the only JSON document that a study prints.
fn json_of(what: &str, args: &[&str]) -> Value {
    let Run {
        code,
        stdout,
        stderr,
    } = study(what, &[args, &["--json"]].concat());
    assert_eq!((code, stderr.as_str()), (0, ""), "{stdout}");
    serde_json::from_str(&stdout).unwrap()
}

#[test]
fn errors_fall_with_beta() {
    // Straight sides: the terms of odd degree cancel, and the errors of both orders fall as beta^-2
    // and beta^-4. If nodes are leaves, they fall faster.
    let scene = "square_link:loops=16,segments=3200";
    let out = json_of("kernels", &[scene, "--repeat", "1", "--limit", "1"]);
    let slope = |order: &str| out["slopes"][order].as_f64().unwrap();
    assert!((-3.2..-1.9).contains(&slope("dipole")), "{}", out["slopes"]);
    let quadrupole = slope("quadrupole");
    assert!((-4.8..-3.7).contains(&quadrupole), "{quadrupole}");
    let rows = out["rows"].as_array().unwrap();
    assert_eq!(out["potential_links"], 78);
    assert_eq!(out["sizes"], Value::Array(vec![]));
    for row in rows {
        if row["skipped_s"].is_number() {
            continue;
        }
        assert_eq!(row["equal"], true, "{row}");
        let decided = row["summed"].as_u64().unwrap() + row["counted"].as_u64().unwrap();
        assert_eq!(decided, 78, "{row}");
        let error = |name: &str| row[name].as_f64();
        assert!(error("mean_error") <= error("largest_error"), "{row}");
        // The bound is proven.
        if row["counted"] == 0 {
            assert!(error("largest_error") <= error("largest_bound"), "{row}");
        }
    }
}

#[test]
fn measures_times_at_several_sizes() {
    let folder = tempfile::tempdir().unwrap();
    let csv = folder.path().join("kernels.csv");
    let plots = folder.path().join("new/plots");
    let Run {
        code,
        stdout,
        stderr,
    } = study(
        "kernels",
        &[
            "ribbon:segments=4000,lambda=3",
            "--sizes",
            "100,4e2,4000",
            "--betas",
            "2,4",
            "--repeat",
            "1",
            "--limit",
            "0.5",
            "--csv",
            csv.to_str().unwrap(),
            "--plot",
            plots.to_str().unwrap(),
        ],
    );
    assert_eq!((code, stderr.as_str()), (0, ""), "{stdout}");
    assert!(stdout.contains("\n400 segments:\ncrossings "), "{stdout}");
    // Two betas are too few to fit a power.
    assert!(!stdout.contains("proportional to"), "{stdout}");
    let text = std::fs::read_to_string(csv).unwrap();
    let mut lines = text.lines();
    let fields: Vec<&str> = lines.next().unwrap().split(',').collect();
    let kernel = fields.iter().position(|&f| f == "kernel").unwrap();
    let rows: Vec<Vec<&str>> = lines.map(|line| line.split(',').collect()).collect();
    let of = |size: &str| {
        let rows = rows.iter().filter(|row| row[0] == size);
        rows.map(|row| row[kernel]).collect::<Vec<_>>()
    };
    // Its own size is already in the table.
    assert_eq!(of("4000").len(), 16);
    let sums = [
        "crossings",
        "direct",
        "angle-sum",
        "barnes-hut",
        "fmm",
        "barnes-hut",
    ];
    assert_eq!((of("100"), of("400")), (sums.to_vec(), sums.to_vec()));
    assert!(rows.iter().all(|row| row.len() == fields.len()));
    for name in ["error-time", "error-beta", "time-size"] {
        let svg = std::fs::read_to_string(plots.join(name).with_extension("svg")).unwrap();
        assert!(svg.starts_with("<svg") && !svg.contains("NaN"), "{name}");
        let png = std::fs::read(plots.join(name).with_extension("png")).unwrap();
        assert!(png.starts_with(b"\x89PNG"), "{name}");
    }
}

#[test]
fn scenes_without_potential_links_have_no_errors() {
    let folder = tempfile::tempdir().unwrap();
    let plots = folder.path().to_str().unwrap();
    let out = json_of(
        "kernels",
        &["rubber_bands:bands=1", "--repeat", "1", "--plot", plots],
    );
    assert_eq!(
        (&out["potential_links"], &out["slopes"]),
        (&0.into(), &json!({}))
    );
    for row in out["rows"].as_array().unwrap() {
        assert_eq!(
            (&row["mean_error"], &row["equal"]),
            (&Value::Null, &true.into())
        );
    }
    let svg = std::fs::read_to_string(folder.path().join("error-beta.svg")).unwrap();
    assert!(!svg.contains("NaN"));
}

#[test]
fn bad_studies_of_kernels_exit_with_2() {
    let scene = "ribbon:segments=200";
    for (args, says) in [
        (&[scene, "--sizes", ""][..], "expected numbers of segments"),
        (&[scene, "--sizes", "0"], "expected numbers of segments"),
        (&[scene, "--sizes", "10,x"], "expected numbers of segments"),
        (&[scene, "--sizes", "3"], "segments is '3'"),
        (
            &["ribbon:segments=200,lambda=9", "--sizes", "20"],
            "take more segments",
        ),
        (
            &[scene, "--betas", "0.5"],
            "expected a number of at least 1",
        ),
        (
            &[scene, "--csv", "/dev/null/x.csv"],
            "error: --csv /dev/null/x.csv: its folder does not exist",
        ),
        (&[scene, "--plot", "/dev/null/x"], "error: /dev/null/x: "),
        (&[scene, "--repeat", "0"], "0 is not in 1.."),
        (&["none.bcc"], "none.bcc: No such file"),
    ] {
        let Run {
            code,
            stdout,
            stderr,
        } = study("kernels", args);
        assert_eq!((code, stdout.as_str()), (2, ""), "{args:?}");
        assert!(stderr.contains(says), "{args:?}: {stderr}");
    }
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("hopf.obj");
    std::fs::write(&model, "v 0 0 0\nv 1 0 0\nv 0 1 0\nl 1 2 3 1\n").unwrap();
    let Run { code, stderr, .. } = study("kernels", &[model.to_str().unwrap(), "--sizes", "10"]);
    assert_eq!(code, 2);
    assert!(
        stderr.contains("hopf.obj is not a generated scene"),
        "{stderr}"
    );
}

#[test]
fn prints_the_published_values_beside_the_measured_ones() {
    let folder = tempfile::tempdir().unwrap();
    let csv = folder.path().join("table.csv");
    let short = ["--repeat", "1", "--limit", "1", "--segments", "3e5"];
    let only = [
        "--only",
        "rubber,lambda 10,glove",
        "--csv",
        csv.to_str().unwrap(),
    ];
    let Run {
        code,
        stdout,
        stderr,
    } = study("table1", &[&short[..], &only].concat());
    assert_eq!((code, stderr.as_str()), (0, ""), "{stdout}");
    let line = |name: &str, by: &str| {
        let mut lines = stdout.lines().skip_while(|line| !line.starts_with(name));
        let found = lines.find(|line| line.contains(by)).unwrap();
        found
            .split_whitespace()
            .map(String::from)
            .collect::<Vec<_>>()
    };
    let here = line("Rubber Bands", "here");
    assert_eq!(here[3..5], ["51,200", "1,024"]);
    let published = line("Rubber Bands", "published");
    assert_eq!(published[..4], ["published", "51,200", "1,024", "20,520"]);
    assert!(
        stdout.contains("not generated; --models DIR reads DIR/glove.bcc"),
        "{stdout}"
    );
    assert!(
        stdout.contains("20,000,000 segments are above --segments"),
        "{stdout}"
    );
    let text = std::fs::read_to_string(csv).unwrap();
    assert!(
        text.starts_with("model,input,differs,segments,curves,"),
        "{text}"
    );
    // Five kernels of three models; lambda 10 is also the start of lambda 10^3 and of lambda 10^6.
    assert_eq!(text.lines().count(), 1 + 5 * 3);
    assert!(text.contains("\"Double Helix Ribbon, lambda 10^3\",ribbon:lambda=1000,,200000,2,1,"));

    let out = json_of(
        "table1",
        &[&short[..], &["--only", "rubber", "--kernels", "barnes-hut"]].concat(),
    );
    assert_eq!(out["models"].as_array().unwrap().len(), 1);
    let model = &out["models"][0];
    assert_eq!(model["published"]["crossings_s"], 0.05);
    assert_eq!(model["published"]["potential_links"], 20_520);
    assert_eq!(
        (&model["as_constructed"], &model["left_out"]),
        (&true.into(), &Value::Null)
    );
    let kernels = model["kernels"].as_array().unwrap();
    assert_eq!(kernels.len(), 3);
    assert_eq!(kernels[2]["published_error"], 7e-4);
    for kernel in kernels {
        assert_eq!(kernel["equal"], true);
        assert!(kernel["s"].as_f64().unwrap() > 0.0);
    }
}

#[test]
fn rows_without_their_published_model_have_others_that_say_what_differs() {
    let folder = tempfile::tempdir().unwrap();
    let quick = ["--kernels", "crossings", "--repeat", "1", "--only"];
    let models = ["--models", folder.path().to_str().unwrap()];
    let run = study(
        "table1",
        &[&quick[..], &["chevron,final"], &models].concat(),
    );
    assert_eq!((run.code, run.stderr.as_str()), (0, ""), "{}", run.stdout);
    for says in [
        "  knit:rows=32,stitches=46,segments=11776: a generated tube, plain stitches",
        "  chainmail:crumple=1: a generated crumpled sheet",
        "here: not generated; --models has no DIR/knittubebroken.bcc or \
         DIR/tube-39x39-final.bcc of examples/table1.sh",
    ] {
        assert!(run.stdout.contains(says), "{says}: {}", run.stdout);
    }

    // A simulated file beside the generated scene, and then the published one alone.
    let generate = |name: &str, scene: &str| {
        let file = folder.path().join(name);
        let run = linkwatch(&["generate", scene, "-o", file.to_str().unwrap()]);
        assert_eq!(run.code, 0, "{}", run.stderr);
    };
    let inputs = || {
        let args = [&quick[..], &["chevron", "--json"], &models].concat();
        let out: Value = serde_json::from_str(&study("table1", &args).stdout).unwrap();
        let models = out["models"].as_array().unwrap();
        let input = |m: &Value| m["input"].as_str().unwrap().to_owned();
        models.iter().map(input).collect::<Vec<_>>()
    };
    generate("tube-32x31.bcc", "knit:rows=3,stitches=16,segments=576");
    let scene = "knit:rows=32,stitches=46,segments=11776";
    assert_eq!(inputs(), ["tube-32x31.bcc", scene]);
    generate("chevron.bcc", "knit:rows=3,stitches=16,segments=576");
    assert_eq!(inputs(), ["chevron.bcc"]);
}

#[test]
fn bad_studies_of_the_table_exit_with_2() {
    for (args, says) in [
        (
            &["--only", "rope"][..],
            "no model has 'rope' in its name (known: Alien",
        ),
        (&["--only", ""], "no model has '' in its name"),
        (&["--kernels", "fast"], "expected auto, crossings"),
        (&["--segments", "0"], "expected numbers of segments"),
        (
            &["--only", "rubber", "--csv", "/dev/null/x"],
            "error: --csv /dev/null/x: its folder does not exist",
        ),
        (&["ribbon"], "unexpected argument"),
    ] {
        let Run {
            code,
            stdout,
            stderr,
        } = study("table1", args);
        assert_eq!((code, stdout.as_str()), (2, ""), "{args:?}");
        assert!(stderr.contains(says), "{args:?}: {stderr}");
    }
}

#[cfg(feature = "mcap")]
#[test]
fn measures_the_motion_of_a_recording() {
    // Frames 1 to 14 and 16 on: frame 15 has a NaN.
    let run = frames(&["--recording", "recordings/squares.mcap", "--json"]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    let found: Value = serde_json::from_str(&run.stdout).unwrap();
    let row = &found["rows"][0];
    assert_eq!(row["motion"], "recorded");
    assert_eq!(row["compared"], row["equal"]);
    assert!(row["compared"].as_u64() > Some(10), "{row}");
    assert!(row["not_intact"].as_u64() > Some(0), "{row}");
    // Four pull-throughs in one step.
    let run = frames(&[
        "--recording",
        "recordings/flight.mcap",
        "--events",
        "--json",
    ]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    let found: Value = serde_json::from_str(&run.stdout).unwrap();
    assert!(found["rows"][0]["compared"].as_u64() > Some(0), "{found}");
}

#[cfg(feature = "mcap")]
#[test]
fn a_recording_excludes_the_options_of_generated_motions() {
    for args in [&[KNIT][..], &["--frames", "3"], &["--motions", "iid"]] {
        let run = frames(&[&["--recording", "recordings/flight.mcap"], args].concat());
        assert_eq!(run.code, 2, "{args:?}: {}", run.stdout);
    }
    assert_eq!(frames(&[]).code, 2);
    let run = frames(&["--recording", "README.md"]);
    assert_eq!(run.code, 2, "{}", run.stdout);
}

/// Options of a short study of sizes, with its files in a folder.
fn sizes(folder: &std::path::Path, args: &[&str]) -> Run {
    let scratch = folder.to_str().unwrap();
    let short = ["chainmail", "--diameter", "0.2", "--scratch", scratch];
    study("sizes", &[&short[..], args].concat())
}

#[test]
fn sizes_have_time_memory_and_verdicts() {
    let folder = tempfile::tempdir().unwrap();
    let [plots, csv] = ["plots", "sizes.csv"].map(|name| folder.path().join(name));
    let args = [
        "--sizes",
        "3000,1000",
        "--frames",
        "3",
        "--pull",
        "1",
        "--events",
        "--plot",
        plots.to_str().unwrap(),
        "--csv",
        csv.to_str().unwrap(),
    ];
    let run = sizes(folder.path(), &args);
    assert_eq!((run.code, run.stderr.as_str()), (0, ""), "{}", run.stdout);
    let results = run.stdout.matches("as expected, 2 changed").count();
    assert_eq!(results, 2, "{}", run.stdout);
    let text = std::fs::read_to_string(csv).unwrap();
    assert_eq!(text.lines().count(), 3);
    assert!(text.starts_with("scene,curves,segments,"), "{text}");
    for plot in ["sizes-time.svg", "sizes-memory.png"] {
        assert!(plots.join(plot).metadata().unwrap().len() > 1000, "{plot}");
    }

    let json = sizes(
        folder.path(),
        &["--sizes", "1000", "--frames", "1", "--json"],
    );
    let out: Value = serde_json::from_str(&json.stdout).unwrap();
    let row = &out["rows"][0];
    assert_eq!(
        (&row["as_constructed"], &row["check"]),
        (&true.into(), &Value::Null)
    );
    // No file of frames remains.
    let entries = std::fs::read_dir(folder.path()).unwrap();
    let mut names: Vec<_> = entries.map(|e| e.unwrap().file_name()).collect();
    names.sort();
    assert_eq!(names, ["plots", "sizes.csv"]);
}

#[test]
fn bad_studies_of_sizes_exit_with_2() {
    let folder = tempfile::tempdir().unwrap();
    for (args, says) in [
        (
            &["--pull", "6"][..],
            "--pull 6: there are 6 frames, numbered from 0",
        ),
        (&["--sizes", "0"], "expected numbers of segments"),
    ] {
        let run = sizes(folder.path(), args);
        assert_eq!((run.code, run.stdout.as_str()), (2, ""), "{args:?}");
        assert!(run.stderr.contains(says), "{args:?}: {}", run.stderr);
    }
    let run = study("sizes", &["chainmail"]);
    assert!(
        run.stderr.contains("chainmail has no diameter"),
        "{}",
        run.stderr
    );
}
