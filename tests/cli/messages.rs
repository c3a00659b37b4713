//! Messages on wrong input: what is wrong, with what, and what to do.

use super::chain;
use crate::support::command::{Run, linkwatch, text};
use tempfile::TempDir;

/// Runs the command, which fails with exit code 2. Returns its message.
fn refused(args: &[&str]) -> String {
    let Run {
        code,
        stdout,
        stderr,
    } = linkwatch(args);
    assert_eq!((code, stdout.as_str()), (2, ""), "{args:?}: {stderr}");
    stderr
}

#[test]
fn check_names_what_is_wrong_with_a_single_file() {
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    for name in ["none.bcc", "none", "none.foo"] {
        let said = refused(&["check", &path(name)]);
        assert!(said.contains(&format!("{name}: No such file")), "{said}");
        assert!(!said.contains("nothing to compare"), "{said}");
    }
    let model = chain(folder.path(), "m.bcc", 0.5);
    let said = refused(&["check", text(&model)]);
    assert!(
        said.contains("one frame and nothing to compare it with"),
        "{said}"
    );
    std::fs::write(path("empty.xyz"), "").unwrap();
    let said = refused(&["check", &path("empty.xyz")]);
    assert!(said.contains("empty.xyz: no frame"), "{said}");
    // Nothing else is said about a file without a valid frame.
    for name in ["empty.obj", "empty.npz"] {
        std::fs::write(path(name), "").unwrap();
        let said = refused(&["check", &path(name)]);
        assert!(said.contains(&format!("{name}: not a valid ")), "{said}");
        assert_eq!(said.lines().count(), 1, "{said}");
    }
}

#[test]
fn a_file_of_an_unknown_kind_is_no_recording() {
    let folder = TempDir::new().unwrap();
    let file = folder.path().join("a.vtx");
    std::fs::write(&file, "not a model").unwrap();
    for missing in ["none", "none.rrd"] {
        let said = refused(&["replay", "-q", missing]);
        assert!(
            said.contains("none") && said.contains("No such file"),
            "{said}"
        );
    }
    let model = chain(folder.path(), "m.bcc", 0.5);
    for file in [&file, &model] {
        for command in ["report", "replay"] {
            let said = refused(&[command, text(file)]);
            let words = format!("{}: not a recording: `linkwatch check", file.display());
            assert!(said.contains(&words), "{said}");
        }
    }
}

#[test]
fn wrong_values_name_the_option_and_what_it_expects() {
    const FRAME: &str = "--frame <SEQ|FROM..TO|last|all>";
    for (args, option, expected) in [
        (&["--frame", "x"], FRAME, "expected the number of a frame"),
        (&["--frame", "-1"], FRAME, "expected the number of a frame"),
        (&["--frame", ""], FRAME, "expected the number of a frame"),
        (
            &["--threads", "x"],
            "--threads <N>",
            "expected a whole number",
        ),
        (
            &["--threads", "-1"],
            "--threads <N>",
            "-1 is not in 1..=1024",
        ),
    ] {
        let said = refused(&[&["certify", "m.bcc"], &args[..]].concat());
        assert!(said.contains(option) && said.contains(expected), "{said}");
        assert_eq!(said.matches("error:").count(), 1, "{said}");
    }
    let said = refused(&["check", "m.bcc", "--motion-limit", "x"]);
    assert!(
        said.contains("'--motion-limit <LENGTHS>': expected a number\n"),
        "{said}"
    );
}

#[test]
fn an_unknown_option_is_not_taken_for_a_file() {
    let said = refused(&["check", "m.bcc", "--frobnicate"]);
    assert!(
        said.contains("unexpected argument '--frobnicate'"),
        "{said}"
    );
    assert!(!said.contains("as a value"), "{said}");
    let said = refused(&["check", "m.bcc", "--event"]);
    assert!(
        said.contains("a similar argument exists: '--events'"),
        "{said}"
    );
}

#[test]
fn an_output_that_cannot_be_written_is_named() {
    let folder = TempDir::new().unwrap();
    let model = chain(folder.path(), "m.bcc", 0.5);
    let output = folder.path().join("none/c.txt");
    let said = refused(&["certify", text(&model), "-o", text(&output)]);
    assert!(
        said.contains("none/c.txt: its folder does not exist"),
        "{said}"
    );
    if cfg!(target_os = "linux") {
        let run = linkwatch(&["certify", "-q", text(&model), "-o", "/dev/full"]);
        assert_eq!(run.code, 2, "{run:?}");
        assert!(run.stderr.contains("/dev/full: No space left"), "{run:?}");
    }
}
