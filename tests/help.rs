//! Tests of the help, the completions and the manual, as a shell and a reader see them.
//!
//! Without bash or groff, the tests that need them are shown as ignored, never as passed.

mod support;

use libtest_mimic::Arguments;
use std::io::Write;
use std::process::{Command, Stdio};
use support::command::linkwatch;
use support::trial::trial;

const COMMANDS: [&str; 7] = [
    "certify",
    "check",
    "generate",
    "measure",
    "devices",
    "completions",
    "man",
];

/// Standard output of a command that must succeed.
fn stdout(args: &[&str]) -> String {
    let run = linkwatch(args);
    assert_eq!(run.code, 0, "{args:?}: {}", run.stderr);
    run.stdout
}

/// Passes a text to a program. Returns its output.
fn give(program: &str, args: &[&str], text: &str) -> Option<String> {
    let mut child = Command::new(program)
        .args(args)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .ok()?;
    let mut stdin = child.stdin.take().expect("a pipe");
    stdin.write_all(text.as_bytes()).expect("it reads");
    drop(stdin);
    let output = child.wait_with_output().expect("it ends");
    let all = [output.stdout, output.stderr].concat();
    let printed = String::from_utf8_lossy(&all).into_owned();
    assert!(output.status.success(), "{program}: {printed}");
    Some(printed)
}

fn exists(program: &str) -> bool {
    let version = Command::new(program).arg("--version").output();
    version.is_ok_and(|output| output.status.success())
}

fn short_help_shows_common_options_and_long_help_all() {
    for command in COMMANDS {
        let [short, long] = ["-h", "--help"].map(|help| stdout(&[command, help]));
        for help in [&short, &long] {
            assert!(
                help.contains(&format!("Usage: linkwatch {command}")),
                "{help}"
            );
            // Options that all commands share come last.
            let general = help.rfind("General:").expect("a heading");
            let last = help.rfind(":\n").expect("a heading");
            assert_eq!(general + "General".len(), last, "{help}");
            for option in ["--json", "--quiet", "--threads", "--help"] {
                assert!(help[general..].contains(option), "{help}");
            }
        }
    }
    let [short, long] = ["-h", "--help"].map(|help| stdout(&["certify", help]));
    assert!(
        long.contains("fmm,order=P") && !short.contains("fmm,order=P"),
        "{short}"
    );
    assert!(short.contains("--kernel"), "{short}");
}
fn options_of_watch_have_headings() {
    let help = stdout(&["watch", "-h"]);
    let mut rest = help.as_str();
    for (heading, options) in [
        (
            "Simulation:",
            &["--service", "--wait", "--keep-watching", "--observe"][..],
        ),
        (
            "Comparison:",
            &["--baseline", "--abort-on", "--events", "--radius"],
        ),
        ("Output:", &["--record", "--force"]),
        ("General:", &["--json", "--quiet", "--threads", "--help"]),
    ] {
        let (_, section) = rest
            .split_once(heading)
            .expect("the headings in this order");
        for option in options {
            let at = section.find(option).expect("an option under this heading");
            assert!(!section[..at].contains(":\n"), "{option} in {section}");
        }
        rest = section;
    }
    assert!(!help.contains("\nOptions:"), "{help}");
    assert!(help.contains("--metrics"));
}

fn completions_contain_commands_and_options() {
    for shell in ["bash", "elvish", "fish", "powershell", "zsh"] {
        let script = stdout(&["completions", shell]);
        for word in COMMANDS.iter().chain(&["kernel", "junit"]) {
            assert!(script.contains(word), "{shell}: {word}");
        }
    }
    assert_eq!(linkwatch(&["completions", "tcsh"]).code, 2);
}

fn bash_completes_a_command_and_an_option() {
    let script = stdout(&["completions", "bash"]);
    give("bash", &["-n"], &script).expect("bash");
    let ask = |words: &str, at: usize| {
        let script = format!(
            "{script}\nCOMP_WORDS=({words})\nCOMP_CWORD={at}\n\
             _linkwatch linkwatch \"${{COMP_WORDS[{at}]}}\" \"\"\n\
             printf '%s\\n' \"${{COMPREPLY[@]}}\"\n"
        );
        give("bash", &["--norc"], &script).expect("bash")
    };
    assert_eq!(ask("linkwatch cert", 1).trim(), "certify");
    assert_eq!(ask("linkwatch check --basel", 2).trim(), "--baseline");
}

fn the_manual_has_every_command_and_every_option() {
    let manual = stdout(&["man"]);
    assert_eq!(manual.matches(".TH ").count(), 1);
    assert!(manual.contains("EXIT STATUS"));
    for command in COMMANDS {
        let heading = format!(".SH \"LINKWATCH {}\"\n", command.to_uppercase());
        let (_, section) = manual.split_once(&heading).expect("a section");
        let section = section.split(".SH \"").next().expect("a section");
        let section = section.replace('\\', "");
        let help = stdout(&[command, "--help"]);
        let (own, _) = help.split_once("\nGeneral:").expect("a heading");
        // The manual has no aliases.
        let lines = own.lines().filter(|line| !line.contains("[alias: "));
        let words = lines.flat_map(str::split_whitespace);
        let words = words.filter(|word| word.starts_with("--"));
        for option in words.filter(|word| word.trim_start_matches('-').len() > 1) {
            let option = option.trim_start_matches('-');
            let (option, _) = option
                .split_once(|c: char| !c.is_alphanumeric() && c != '-')
                .unwrap_or((option, ""));
            let named = section.contains(option);
            assert!(named, "{command}: {option}\n{section}");
        }
    }
    // An option that the short help omits is in the manual, too.
    assert!(manual.contains("further apart than B times their radii"));
}

fn the_manual_formats_without_warnings() {
    let warnings = give("groff", &["-man", "-Tutf8", "-ww", "-z"], &stdout(&["man"]));
    assert_eq!(warnings.expect("groff"), "");
}

fn errors_of_a_folder_and_a_misspelt_scene_give_advice() {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("a.vect"), "VECT").unwrap();
    let path = folder.path().to_str().expect("UTF-8");
    for (args, expected) in [
        (["certify", path], "a.vect: not a valid VECT (line 2)"),
        (["certify", "knti"], "the nearest is 'knit'"),
        (
            ["certify", "ribbon:segmnts=20"],
            "the nearest is 'segments'",
        ),
    ] {
        let run = linkwatch(&args);
        assert_eq!(run.code, 2, "{args:?}");
        assert!(run.stderr.contains(expected), "{}", run.stderr);
    }
}

fn main() {
    let mut trials = Vec::new();
    macro_rules! add {
        ($($name:ident $(needs $program:literal)?),* $(,)?) => {$(
            let present = [$($program)?].into_iter().all(exists);
            trials.push(trial(stringify!($name), present, || {
                $name();
                Ok(())
            }));
        )*};
    }
    add!(
        short_help_shows_common_options_and_long_help_all,
        completions_contain_commands_and_options,
        bash_completes_a_command_and_an_option needs "bash",
        the_manual_has_every_command_and_every_option,
        the_manual_formats_without_warnings needs "groff",
        errors_of_a_folder_and_a_misspelt_scene_give_advice,
    );
    add!(options_of_watch_have_headings);
    libtest_mimic::run(&Arguments::from_args(), trials).exit();
}
