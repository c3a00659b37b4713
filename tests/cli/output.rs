//! Output streams and files: what is lost is reported, and nothing is overwritten by accident.

use super::chain;
use crate::support::command::{Run, command, linkwatch, text};
use std::path::Path;
use tempfile::TempDir;

/// A closed pipe does not change the exit code from changed to success.
#[test]
fn a_closed_pipe_keeps_the_exit_code() {
    let folder = TempDir::new().unwrap();
    let broken = chain(folder.path(), "broken.bcc", -5.0);
    let certificate = folder.path().join("c.txt");
    std::fs::write(&certificate, "3\n0,1,1\n").unwrap();
    let mut process = command()
        .args(["check", text(&broken), "--baseline", text(&certificate)])
        .stdout(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    drop(process.stdout.take());
    assert_eq!(process.wait().unwrap().code(), Some(1));
}

/// Runs the command with streams that are not pipes.
#[cfg(target_os = "linux")]
fn with_streams(args: &[&str], stdout: Option<&str>, stderr: Option<&str>) -> Run {
    use std::process::Stdio;
    let open = |path: Option<&str>| match path {
        Some(path) => Stdio::from(std::fs::File::options().write(true).open(path).unwrap()),
        None => Stdio::piped(),
    };
    let process = command()
        .args(args)
        .stdout(open(stdout))
        .stderr(open(stderr))
        .spawn()
        .unwrap();
    process.wait_with_output().unwrap().into()
}

/// Regression test: the command panicked (exit code 101 or 134), or returned 2 as for bad input.
#[test]
#[cfg(target_os = "linux")]
fn a_full_standard_output_loses_results_and_reports_it() {
    let folder = TempDir::new().unwrap();
    let whole = chain(folder.path(), "whole.bcc", 0.5);
    let broken = chain(folder.path(), "broken.bcc", -5.0);
    let certificate = folder.path().join("c.txt");
    linkwatch(&["certify", text(&whole), "-o", text(&certificate)]);
    let check = ["check", text(&whole), "--baseline", text(&certificate)];
    for args in [&["certify", text(&whole)][..], &check, &["generate"]] {
        let run = with_streams(args, Some("/dev/full"), None);
        assert_eq!(run.code, 3, "{args:?}: {}", run.stderr);
        let reported = run
            .stderr
            .matches("error: standard output: No space left")
            .count();
        assert_eq!(reported, 1, "{args:?}: {}", run.stderr);
        assert!(run.stderr.trim_end().ends_with("lost"), "{}", run.stderr);
        // A log that cannot be written is ignored.
        let run = with_streams(args, None, Some("/dev/full"));
        assert_eq!(run.code, 0, "{args:?}");
        assert_eq!(run.stdout, linkwatch(args).stdout);
    }
    // The exit code still reports the finding.
    let check = ["check", text(&broken), "--baseline", text(&certificate)];
    assert_eq!(with_streams(&check, Some("/dev/full"), None).code, 1);
    let none = ["certify", "no such model"];
    assert_eq!(
        with_streams(&none, Some("/dev/full"), Some("/dev/full")).code,
        2
    );
}

/// Regression test: each of these commands destroyed a file, under its own name, a hard link or a
/// symbolic link.
#[test]
fn no_output_overwrites_an_input_or_another_output() {
    let folder = TempDir::new().unwrap();
    let at = |name: &str| text(&folder.path().join(name)).to_owned();
    chain(folder.path(), "m.bcc", 0.5);
    linkwatch(&["certify", &at("m.bcc"), "-o", &at("c.txt")]);
    std::fs::hard_link(at("m.bcc"), at("hard.txt")).unwrap();
    std::fs::hard_link(at("c.txt"), at("c-hard.txt")).unwrap();
    let mut names = vec!["m.bcc"];
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink(at("m.bcc"), at("soft.txt")).unwrap();
        names.push("soft.txt");
    }
    let before = ["m.bcc", "c.txt"].map(|name| std::fs::read(at(name)).unwrap());
    let refused = |args: &[&str], says: &[&str]| {
        for force in [&[][..], &["--force"]] {
            let run = linkwatch(&[args, force].concat());
            assert_eq!(run.code, 2, "{args:?}: {}", run.stderr);
            let reported = says.iter().all(|&word| run.stderr.contains(word));
            assert!(reported, "{args:?}: {}", run.stderr);
            let after = ["m.bcc", "c.txt"].map(|name| std::fs::read(at(name)).unwrap());
            assert!(after == before, "{args:?} destroyed a file");
        }
    };
    let (model, certificate) = (&at("m.bcc")[..], &at("c.txt")[..]);
    for name in names {
        let output = &at(name)[..];
        let same: &[&str] = match name {
            "m.bcc" => &["a model"],
            _ => &["same file", name, "m.bcc"],
        };
        refused(&["certify", model, "-o", output], same);
        let check = ["check", model, "--baseline", certificate];
        refused(&[&check[..], &["--junit", output]].concat(), same);
    }
    let check = ["check", model, "--baseline", certificate];
    // A hard link is another file: it is replaced, and the input keeps its content.
    for hard in ["hard.txt", "c-hard.txt"] {
        let run = linkwatch(&[&check[..], &["--junit", &at(hard), "--force"]].concat());
        assert_eq!(run.code, 0, "{}", run.stderr);
        let after = ["m.bcc", "c.txt"].map(|name| std::fs::read(at(name)).unwrap());
        assert!(after == before, "{hard} destroyed a file");
    }
    let (new, again) = (&at("new.txt")[..], &at("./new.txt")[..]);
    let both = ["--junit", new, "--record", again];
    refused(&[&check[..], &both].concat(), &["a recording"]);
    let scene = "chainmail:rows=2,columns=2";
    let (bcc, other) = (&at("n.bcc")[..], &at("./n.bcc")[..]);
    let both = ["generate", scene, "-o", bcc, "--certificate", other];
    refused(&both, &["a model"]);
    assert!(!Path::new(new).exists() && !Path::new(bcc).exists());
}

#[test]
fn an_existing_output_is_overwritten_only_with_force() {
    let folder = TempDir::new().unwrap();
    let at = |name: &str| text(&folder.path().join(name)).to_owned();
    let model = chain(folder.path(), "m.bcc", 0.5);
    let model = text(&model);
    linkwatch(&["certify", model, "-o", &at("c.txt")]);
    let scene = "chainmail:rows=2,columns=2";
    let [out, bcc, against] = ["out.txt", "out.bcc", "c.txt"].map(at);
    let commands: [(&[&str], &str); 3] = [
        (&["certify", model, "-o", &out], &out),
        (
            &["check", model, "--baseline", &against, "--junit", &out],
            &out,
        ),
        (&["generate", scene, "-o", &bcc], &bcc),
    ];
    for (args, file) in commands {
        std::fs::write(file, "mine").unwrap();
        let run = linkwatch(args);
        assert_eq!(run.code, 2, "{args:?}: {}", run.stderr);
        assert!(
            run.stderr.contains("exists; --force overwrites it"),
            "{}",
            run.stderr
        );
        assert!(run.stderr.contains(file), "{}", run.stderr);
        assert_eq!(std::fs::read(file).unwrap(), b"mine");
        let run = linkwatch(&[args, &["--force"]].concat());
        assert_eq!(run.code, 0, "{args:?}: {}", run.stderr);
        assert_ne!(std::fs::read(file).unwrap(), b"mine", "{args:?}");
    }
    let names = std::fs::read_dir(folder.path()).unwrap();
    let parts = names.filter(|e| e.as_ref().unwrap().path().extension() == Some("part".as_ref()));
    assert_eq!(parts.count(), 0);
}

/// Text is written to its destination: a pipe, `/dev/null`, or appended to an existing file.
#[test]
#[cfg(target_os = "linux")]
fn text_may_be_written_to_devices_and_to_standard_output() {
    let folder = TempDir::new().unwrap();
    let model = chain(folder.path(), "m.bcc", 0.5);
    let expected = linkwatch(&["certify", text(&model)]).stdout;
    let run = linkwatch(&["certify", text(&model), "-o", "/dev/stdout"]);
    assert_eq!(
        (run.code, run.stdout),
        (0, expected.clone()),
        "{}",
        run.stderr
    );
    assert_eq!(
        linkwatch(&["certify", text(&model), "-o", "/dev/null"]).code,
        0
    );
    let log = folder.path().join("log.txt");
    std::fs::write(&log, "before\n").unwrap();
    let append = std::fs::File::options().append(true).open(&log).unwrap();
    let status = command()
        .args(["-q", "certify", text(&model), "-o", "/dev/stdout"])
        .stdout(append)
        .status()
        .unwrap();
    assert!(status.success());
    let written = std::fs::read_to_string(&log).unwrap();
    assert_eq!(written, format!("before\n{expected}"));
}

/// The model does not exist either. The output is checked first, because a certificate may take
/// hours.
#[test]
fn an_invalid_output_is_reported_before_the_work() {
    for args in [
        &["certify", "none.bcc", "-o", "/no/such/folder/c.txt"][..],
        &[
            "check",
            "none.bcc",
            "--baseline",
            "c",
            "--junit",
            "/no/such/folder/c.txt",
        ],
    ] {
        let run = linkwatch(args);
        assert_eq!(run.code, 2);
        assert!(
            run.stderr.contains("/no/such/folder/c.txt"),
            "{}",
            run.stderr
        );
    }
}
