//! The options of the viewer.

use crate::sequences::{check, motion};
use crate::support::command::{Run, command};
use std::net::TcpListener;
use std::path::Path;
use tempfile::TempDir;

#[test]
fn a_file_with_fewer_curves_is_smaller() {
    let folder = TempDir::new().unwrap();
    let models = motion(folder.path(), 1.0, true);
    let size = |settings: &str| {
        let path = folder.path().join("run.rrd");
        let show = format!("{}{settings}", path.to_str().unwrap());
        let run = check(&models, &["--force", "--show", &show]);
        assert_eq!(run.code, 1, "{}", run.stderr);
        std::fs::metadata(&path).unwrap().len()
    };
    let all = size("");
    assert!(size(",every=4") < all);
}

#[test]
fn settings_of_a_viewer_are_checked() {
    let folder = TempDir::new().unwrap();
    let models = motion(folder.path(), 1.0, true);
    for (show, word) in [
        ("never.rrd,every=0", "every: expected an integer"),
        ("live,only=violated", "no setting 'only'"),
        ("live,fast=1", "no setting 'fast'"),
        ("screen", "expected live, web"),
    ] {
        let run = check(&models, &["--show", show]);
        assert_eq!(run.code, 2, "{}", run.stdout);
        assert!(run.stderr.contains(word), "{}", run.stderr);
    }
}

/// Runs `check --show web:PORT` with programs of a folder only.
fn serve(models: &[String], programs: &Path) -> Run {
    // Two ports that are free.
    let first = || {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        listener.local_addr().unwrap().port()
    };
    let next_is_free = |&port: &u16| TcpListener::bind(("127.0.0.1", port + 1)).is_ok();
    let port = std::iter::repeat_with(first).find(next_is_free).unwrap();
    let mut command = command();
    command.arg("check").args(models).env("PATH", programs);
    command.args(["--show", &format!("web:{port}")]);
    command.output().unwrap().into()
}

#[test]
fn a_server_for_browsers_needs_the_program() {
    let folder = TempDir::new().unwrap();
    let models = motion(folder.path(), 1.0, true);
    let run = serve(&models, folder.path());
    assert_eq!(run.code, 2, "{}", run.stdout);
    assert!(
        run.stderr.contains("no program `rerun` in PATH"),
        "{}",
        run.stderr
    );
}

#[cfg(unix)]
#[test]
fn a_server_that_ends_at_once_is_an_error() {
    use std::os::unix::fs::PermissionsExt;
    let folder = TempDir::new().unwrap();
    let models = motion(folder.path(), 1.0, true);
    let program = folder.path().join("rerun");
    std::fs::write(&program, "#!/bin/sh\nexit 7\n").unwrap();
    std::fs::set_permissions(&program, std::fs::Permissions::from_mode(0o755)).unwrap();
    let run = serve(&models, folder.path());
    assert_eq!(run.code, 2, "{}", run.stdout);
    let why = "`rerun --serve-web` ended before it listened (exit status: 7)";
    assert!(run.stderr.contains(why), "{}", run.stderr);
}

/// Runs `check --show live` with an empty PATH, and with these variables of a screen only.
fn view(screen: &[(&str, &str)]) -> Run {
    let folder = TempDir::new().unwrap();
    let models = motion(folder.path(), 1.0, true);
    let mut command = command();
    command.arg("check").args(models).args(["--show", "live"]);
    for name in ["WAYLAND_DISPLAY", "WAYLAND_SOCKET", "DISPLAY"] {
        command.env_remove(name);
    }
    command.env("PATH", folder.path());
    command.envs(screen.iter().copied());
    command.output().unwrap().into()
}

#[test]
#[cfg(target_os = "linux")]
fn a_viewer_without_a_screen_fails_at_once_and_names_other_outputs() {
    for screen in [&[][..], &[("DISPLAY", "")]] {
        let run = view(screen);
        assert_eq!((run.code, run.stdout.as_str()), (2, ""));
        assert!(run.stderr.contains("no screen"), "{}", run.stderr);
        assert!(run.stderr.contains("--show FILE.rrd"), "{}", run.stderr);
        assert!(run.stderr.contains("--show web"), "{}", run.stderr);
    }
}

#[test]
fn a_viewer_without_its_program_fails_at_once_and_names_other_outputs() {
    let run = view(&[("DISPLAY", ":1")]);
    assert_eq!((run.code, run.stdout.as_str()), (2, ""));
    let install = "no program `rerun` in PATH to show frames; `pip install rerun-sdk==";
    assert!(run.stderr.contains(install), "{}", run.stderr);
    assert!(run.stderr.contains("--show FILE.rrd"), "{}", run.stderr);
}
