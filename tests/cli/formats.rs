//! Files of other programs: what is read, what is left out, and what the command says.

use crate::support::command::{Run, linkwatch, text};
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// Corners of two linked squares.
const RINGS: [[[i32; 3]; 4]; 2] = [
    [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]],
    [[0, 0, -1], [2, 0, -1], [2, 0, 1], [0, 0, 1]],
];

fn write(folder: &TempDir, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
    let path = folder.path().join(name);
    std::fs::write(&path, content).unwrap();
    path
}

/// Runs a command on a file.
fn run(command: &str, file: &Path, more: &[&str]) -> Run {
    linkwatch(&[&[command, text(file)][..], more].concat())
}

fn says(run: &Run, what: &str) {
    let all = format!("{}{}", run.stdout, run.stderr);
    assert!(all.contains(what), "{all:?} lacks {what:?}");
}

/// Returns the vertices of both rings as lines that begin with `start`.
fn lines(start: &str) -> [String; 2] {
    let line = |[x, y, z]: &[i32; 3]| format!("{start}{x} {y} {z}\n");
    RINGS.each_ref().map(|ring| ring.iter().map(line).collect())
}

#[test]
fn free_form_curves_of_an_obj_are_verified_and_others_end_with_exit_code_3() {
    let folder = TempDir::new().unwrap();
    let vertices = lines("v ").concat();
    let curve = "cstype bspline\ndeg 1\ncurv 0 1 -4 -3 -2 -1 -4\nend\n";
    let mixed = write(&folder, "a.obj", format!("{vertices}l 1 2 3 4 1\n{curve}"));
    let whole = run("certify", &mixed, &[]);
    assert_eq!(whole.code, 0, "{}", whole.stderr);
    says(&whole, "\n0,1,");
    let other = curve.replace("deg 1", "deg 4");
    let part = write(&folder, "b.obj", format!("{vertices}l 1 2 3 4 1\n{other}"));
    for (command, more) in [
        ("certify", &[][..]),
        ("check", &[text(&mixed)]),
        ("thickness", &[]),
    ] {
        let run = run(command, &part, more);
        assert_ne!(run.code, 0, "{command}");
        says(&run, "1 free-form curve (curv in line 12, of degree 4)");
    }
    assert_eq!(run("certify", &part, &[]).code, 3);
}

#[test]
fn points_of_plain_text_need_the_word_closed() {
    let folder = TempDir::new().unwrap();
    let file = write(&folder, "rings.txt", lines("").join("\n"));
    let unknown = run("certify", &file, &[]);
    assert_eq!(unknown.code, 2);
    says(
        &unknown,
        "nothing says if 2 of 2 curves are closed: pass the option `--closed`",
    );
    for option in ["--closed", "--counts=-4,-4"] {
        let certified = run("certify", &file, &[option]);
        assert_eq!(certified.code, 0, "{}", certified.stderr);
        says(&certified, "\n0,1,");
    }
    let open = run("certify", &file, &["--closed=false"]);
    assert!(!open.stdout.contains("\n0,1,"), "{}", open.stdout);
    // A folder does not become one of models by a table of numbers in it.
    write(&folder, "a.vect", "VECT\n1 3 0\n-3\n0\n0 0 0 1 0 0 0 1 0\n");
    assert_eq!(run("check", folder.path(), &[]).code, 2);
    says(
        &run("check", folder.path(), &[]),
        "nothing to compare it with",
    );
}

#[test]
fn a_file_of_an_unknown_kind_is_named_by_every_command() {
    let folder = TempDir::new().unwrap();
    let file = write(
        &folder,
        "rings.vtk",
        "# vtk DataFile Version 3.0\nrings\nBINARY\n",
    );
    for (command, more) in [
        ("certify", &[][..]),
        ("check", &[]),
        ("thickness", &[]),
        ("writhe", &[]),
        ("certify", &["--explain"]),
    ] {
        let run = run(command, &file, more);
        assert_eq!(run.code, 2, "{command}");
        says(&run, "rings.vtk: unknown kind of file (known: .bcc, ");
        assert!(!run.stderr.contains("compare"), "{}", run.stderr);
    }
    let missing = run("check", &folder.path().join("missing.obj"), &[]);
    assert_eq!(missing.code, 2);
    assert!(!missing.stderr.contains("compare"), "{}", missing.stderr);
}

#[test]
fn a_usd_file_is_refused_with_the_way_to_convert_it() {
    let folder = TempDir::new().unwrap();
    let text_file = b"#usda 1.0\ndef BasisCurves \"a\" {}\n";
    for (name, content) in [
        ("a.usd", &text_file[..]),
        ("a.USDA", text_file),
        ("a.usdc", b"PXR-USDC"),
        ("a.usdz", b"PK"),
        ("scene", text_file),
        ("scene.dat", b"PXR-USDC\0"),
    ] {
        let file = write(&folder, name, content);
        for command in ["certify", "check"] {
            let run = run(command, &file, &[]);
            assert_eq!(run.code, 2, "{command}: {}", run.stderr);
            assert_eq!(run.stderr.lines().count(), 1, "{}", run.stderr);
            says(&run, &format!("{name}: unsupported USD: "));
            says(&run, "`pip install usd-core`");
            says(
                &run,
                &format!("`python -m linkwatch convert {} OUT.npz`", text(&file)),
            );
        }
        std::fs::remove_file(&file).unwrap();
    }
    // USD files in a folder are not skipped.
    write(&folder, "a.usda", text_file);
    let run = run("check", folder.path(), &[]);
    assert_eq!(run.code, 2);
    says(&run, "unsupported USD");
}
#[test]
fn an_mcap_file_without_lines_says_what_it_has_in_every_command() {
    let folder = TempDir::new().unwrap();
    let mut writer = mcap::Writer::new(std::io::Cursor::new(Vec::new())).unwrap();
    let schema = writer
        .add_schema("foxglove.SceneUpdate", "jsonschema", b"{}")
        .unwrap();
    let channel = writer
        .add_channel(schema, "/rope", "json", &Default::default())
        .unwrap();
    for k in 1..4 {
        let header = mcap::records::MessageHeader {
            channel_id: channel,
            sequence: k,
            log_time: k.into(),
            publish_time: k.into(),
        };
        let scene = br#"{"entities": [{"id": "a", "spheres": [{}], "cylinders": [{}, {}]}]}"#;
        writer.write_to_known_channel(&header, scene).unwrap();
    }
    writer.finish().unwrap();
    let file = write(&folder, "rope.mcap", writer.into_inner().into_inner());
    let converted = folder.path().join("a.npz");
    for (command, more) in [
        ("check", &[][..]),
        ("check", &["--events"]),
        ("check", &["--json"]),
        ("certify", &[]),
        ("certify", &["--json"]),
        ("convert", &[text(&converted)]),
        ("thickness", &[]),
        ("writhe", &[]),
    ] {
        let run = run(command, &file, more);
        assert!(
            [2, 3].contains(&run.code),
            "{command} {more:?}: {}",
            run.code
        );
        says(&run, "no lines on topic /rope: only cylinders, spheres");
    }
}
