//! The studies as a process: their tables, files, exit codes and messages.

use std::path::Path;
use std::process::Command;

struct Run {
    code: i32,
    stdout: String,
    stderr: String,
}

/// Runs a study in a folder.
fn study_in(folder: &Path, args: &[&str]) -> Run {
    let mut command = Command::new(env!("CARGO_BIN_EXE_study"));
    let output = command.args(args).current_dir(folder).output();
    let output = output.expect("the command starts");
    let text = |bytes| String::from_utf8(bytes).expect("UTF-8");
    Run {
        code: output.status.code().expect("no signal ended the command"),
        stdout: text(output.stdout),
        stderr: text(output.stderr),
    }
}

/// Runs a study that must end as expected. Returns its output.
fn study(args: &[&str]) -> String {
    let run = study_in(Path::new("."), args);
    let (code, stderr) = (run.code, run.stderr.as_str());
    assert_eq!((code, stderr), (0, ""), "{args:?}: {}", run.stdout);
    run.stdout
}

fn text(path: &Path) -> &str {
    path.to_str().expect("UTF-8")
}

/// A scene that has a diameter.
const KNIT: &str = "knit:rows=3,stitches=16,segments=576";

#[test]
fn frames_have_a_row_for_each_motion_and_amplitude() {
    let motions = [
        "--motions",
        "iid,rotate,smooth+translate",
        "--amplitudes",
        "0,0.05",
    ];
    let out = study(&[&["frames", KNIT, "--frames", "7"][..], &motions].concat());
    let rows = out.lines().filter(|line| line.ends_with(" 7/7"));
    let rows: Vec<Vec<&str>> = rows
        .map(|l| l.split_whitespace().take(2).collect())
        .collect();
    // A motion without an amplitude is measured once.
    let expected = [
        ["iid", "0"],
        ["iid", "0.05"],
        ["rotate", "0"],
        ["smooth+translate", "0"],
        ["smooth+translate", "0.05"],
    ];
    assert_eq!(rows, expected, "{out}");
    assert!(
        out.contains("; 35 of 35 verdicts as in the full run"),
        "{out}"
    );
    // Both sessions report the same pull-throughs, and there are some if all points move far.
    let far = [
        "--motions",
        "iid",
        "--amplitudes",
        "2",
        "--self",
        "--radius",
        "0.1",
    ];
    let out = study(&[&["frames", KNIT, "--frames", "6"][..], &far].concat());
    assert!(out.contains("pull-throughs\n  clearance: "), "{out}");
    assert!(out.contains(" 6 of 6 verdicts"), "{out}");
}

#[test]
fn frames_may_be_those_of_a_recording() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../recordings");
    // Frame 15 has a NaN, and is skipped.
    let out = study(&["frames", "--recording", text(&root.join("squares.mcap"))]);
    assert!(out.contains("not intact"), "{out}");
    study(&[
        "frames",
        "--recording",
        text(&root.join("flight.mcap")),
        "--events",
    ]);
}

#[test]
fn kernels_have_exact_certificates_errors_that_fall_with_beta_and_plots() {
    let folder = tempfile::tempdir().unwrap();
    let plots = folder.path().join("new/plots");
    // Straight sides: the terms of odd degree cancel.
    let scene = "square_link:loops=16,segments=3200";
    let short = [
        "--repeat",
        "1",
        "--limit",
        "1",
        "--threads",
        "2",
        "--sizes",
        "400,3200",
        "--plot",
    ];
    let out = study(&[&["kernels", scene][..], &short, &[text(&plots)]].concat());
    assert!(out.contains("78 potential links"), "{out}");
    assert_eq!(out.matches(" equal\n").count(), 24 + 6 - 1, "{out}");
    assert!(out.contains("\n400 segments:\ncrossings "), "{out}");
    let power = |order: &str| -> f64 {
        let line = out.lines().find(|line| line.starts_with(order)).unwrap();
        let (_, power) = line.split_once("beta^").unwrap();
        power.split_whitespace().next().unwrap().parse().unwrap()
    };
    assert!((-3.2..-1.9).contains(&power("dipole:")), "{out}");
    assert!((-4.8..-3.7).contains(&power("quadrupole:")), "{out}");
    for name in ["error-time.svg", "error-beta.svg", "time-size.svg"] {
        let svg = std::fs::read_to_string(plots.join(name)).unwrap();
        assert!(svg.starts_with("<svg") && !svg.contains("NaN"), "{name}");
    }
    // No potential link, and so no error.
    let alone = ["kernels", "rubber_bands:bands=1", "--repeat", "1", "--plot"];
    study(&[&alone[..], &[text(&plots)]].concat());
    let svg = std::fs::read_to_string(plots.join("error-beta.svg")).unwrap();
    assert!(!svg.contains("NaN"));
}

#[test]
fn table1_prints_the_published_values_below_the_measured_ones() {
    let short = [
        "--repeat",
        "1",
        "--limit",
        "1",
        "--segments",
        "3e5",
        "--only",
    ];
    let out = study(&[&["table1"][..], &short, &["rubber,lambda 10,glove"]].concat());
    let words = |name: &str, by: &str| -> Vec<String> {
        let mut lines = out.lines().skip_while(|line| !line.starts_with(name));
        let found = lines.find(|line| line.contains(by)).unwrap();
        found.split_whitespace().map(String::from).collect()
    };
    assert_eq!(words("Rubber Bands", "here")[3..5], ["51,200", "1,024"]);
    let published = words("Rubber Bands", "published");
    assert_eq!(published[..4], ["published", "51,200", "1,024", "20,520"]);
    for says in [
        "not generated; --models DIR reads DIR/glove.bcc",
        "20,000,000 segments are above --segments",
        "  rubber_bands: a generated pile",
    ] {
        assert!(out.contains(says), "{says}: {out}");
    }
}

#[test]
fn sizes_have_results_as_constructed_and_leave_no_file_of_frames() {
    let folder = tempfile::tempdir().unwrap();
    let args = [
        "sizes",
        "chainmail",
        "--sizes",
        "3000,1000",
        "--frames",
        "3",
        "--diameter",
        "0.2",
        "--events",
        "--plot",
        "plots",
    ];
    let run = study_in(folder.path(), &args);
    assert_eq!((run.code, run.stderr.as_str()), (0, ""), "{}", run.stdout);
    assert_eq!(
        run.stdout.matches(" as constructed\n").count(),
        2,
        "{}",
        run.stdout
    );
    let names = std::fs::read_dir(folder.path()).unwrap();
    let names: Vec<_> = names.map(|e| e.unwrap().file_name()).collect();
    assert_eq!(names, ["plots"]);
    assert!(folder.path().join("plots/sizes-time.svg").exists());
}

/// The pull-throughs of this knit cancel, because it is symmetric: its rows have linking number 0
/// in every step, and only the motion from step to step shows that it breaks.
#[test]
fn a_sweep_names_the_step_that_breaks_and_its_curves() {
    let folder = tempfile::tempdir().unwrap();
    let knit = ["sweep", "knit:rows=3,stitches=16,segments=1152"];
    let args = [&knit[..], &["--resample", "1.0..0.1", "--plot", "plot.svg"]].concat();
    let run = study_in(folder.path(), &args);
    assert_eq!(run.code, 1, "{}", run.stderr);
    for says in [
        "intact down to ",
        "3 curves: 0, 1, 2",
        "passed through one another",
    ] {
        assert!(run.stdout.contains(says), "{says}: {}", run.stdout);
    }
    assert!(!run.stdout.contains("became linked"), "{}", run.stdout);
    let svg = std::fs::read_to_string(folder.path().join("plot.svg")).unwrap();
    assert!(svg.contains("broken at ") && !svg.contains("NaN"));
    let out = study(&[&knit[..], &["--quantize", "16..12", "--step", "2"]].concat());
    assert!(out.ends_with(": intact down to 12 bits\n"), "{out}");
    // Coordinates on a coarse grid make curves touch, which is no proof of a change.
    let touching = ["sweep", "chainmail:rows=2,columns=2", "--quantize", "8..2"];
    let run = study_in(folder.path(), &touching);
    assert_eq!(run.code, 3, "{}", run.stdout);
    assert!(run.stdout.contains(" touch, near "), "{}", run.stdout);
}

#[test]
fn stages_are_measured_and_predicted() {
    let out = study(&["stages", "ribbon:segments=2000", "--repeat", "1"]);
    for row in ["\nfirst ", "\nlater ", "\npredicted "] {
        assert!(out.contains(row), "{out}");
    }
}

#[test]
fn bad_input_is_named_in_plain_words_and_exits_with_2() {
    let folder = tempfile::tempdir().unwrap();
    let hopf = folder.path().join("hopf.obj");
    std::fs::write(&hopf, "v 0 0 0\nv 1 0 0\nv 0 1 0\nl 1 2 3 1\n").unwrap();
    let periodic = folder.path().join("ring.xyz");
    let ring = "3\nLattice=\"9 0 0 0 9 0 0 0 9\" Properties=species:S:1:pos:R:3:molecule:I:1\n\
                C 1 1 0 1\nC 2 1 0 1\nC 2 2 1 1\n";
    std::fs::write(&periodic, ring).unwrap();
    let (hopf, periodic) = (text(&hopf), text(&periodic));
    for (args, says) in [
        (&["kernels", "none.bcc"][..], "none.bcc: No such file"),
        (&["stages", "rope"], "scene rope: unknown (known: chainmail"),
        (&["stages", "rope"], "no file has this name"),
        (&["kernels", periodic], "`linkwatch convert` writes them"),
        (
            &["kernels", hopf, "--sizes", "10"],
            "hopf.obj is not a generated scene",
        ),
        (
            &["kernels", "ribbon", "--betas", "0.5"],
            "expected numbers of at least 1",
        ),
        (
            &["kernels", "ribbon:segments=200", "--plot", "/dev/null/x"],
            "/dev/null/x: ",
        ),
        (&["kernels", "ribbon", "--repeat", "0"], "0 is not in 1.."),
        (&["frames", "ribbon"], "ribbon has no diameter"),
        (
            &["frames", KNIT, "--motions", "iid,jump"],
            "unknown motion 'jump'",
        ),
        (&["frames", "--recording", hopf], "not a valid"),
        (&["frames"], "MODEL|SCENE"),
        (
            &["sizes", "chainmail", "--sizes", "1000"],
            "chainmail has no diameter",
        ),
        (
            &["sizes", "chainmail", "--sizes", "0"],
            "expected numbers of segments",
        ),
        (
            &["table1", "--only", "rope"],
            "no model has 'rope' in its name (known: Alien",
        ),
        (&["table1", "--kernels", "fast"], "expected auto, crossings"),
        (&["sweep", KNIT, "--quantize", "8..24"], "fine to coarse"),
        (&["sweep", KNIT, "--quantize", "60..8"], "from 1 to 52"),
        (&["sweep", KNIT, "--resample", "0.001"], "leaves 0 of"),
        (
            &["sweep", KNIT, "--resample", "1.0..0.5", "--step", "0"],
            "above 0",
        ),
        (&["sweep", KNIT], "--quantize"),
        (
            &["devices", "--device", "cpu"],
            "--device must name an adapter",
        ),
    ] {
        let run = study_in(folder.path(), args);
        assert_eq!((run.code, run.stdout.as_str()), (2, ""), "{args:?}");
        assert!(run.stderr.contains(says), "{args:?}: {}", run.stderr);
    }
}
