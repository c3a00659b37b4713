//! Model files and certificates with changed bytes.

use super::bytes::changed;
use super::memory::peak;
use super::support::command::{linkwatch, text};
use super::units;
use linkwatch::model::{self, Format, FrameWriter, Frames, ModelFrame, ReadOptions};
use linkwatch::{Cell, Certificate, Result};
use std::path::Path;
use tempfile::TempDir;

/// Maximum number of bytes that a reader may allocate for a file of some kilobytes.
const MEMORY: usize = 4 << 20;

/// Reads all frames of a file. Returns an error if one is invalid.
fn read_frames(file: &Path, options: &ReadOptions) -> Result<()> {
    for frame in Frames::open(file, options)? {
        frame?.curves.map_err(|e| e.in_file(file))?;
    }
    Ok(())
}

#[test]
fn model_files_and_certificates() {
    let folder = TempDir::new().expect("a folder");
    let path = |name: &str| folder.path().join(name);
    let names = [
        "a.bcc", "a.obj", "a.vect", "a.data", "a.dump", "a.npy", "a.npz", "b.npz", "a.xyz",
    ];
    let scene = "chainmail:rows=2,columns=3";
    let run = linkwatch(&["generate", scene, "-o", text(&path(names[0]))]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    let squares = [[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]];
    let points = squares.map(|[x, y]| format!("{x} {y} 0.5"));
    let obj = points.each_ref().map(|p| format!("v {p}\n")).concat() + "l 1 2 3 4 1\n";
    std::fs::write(path(names[1]), obj).expect("a file");
    let vect = format!("VECT\n1 4 1\n-4\n1\n{}\n1 1 1 1\n", points.join("\n"));
    std::fs::write(path(names[2]), vect).expect("a file");
    let fixture = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/models/numpy/compressed.npz");
    std::fs::copy(fixture, path("b.npz")).expect("a copy");
    for name in ["a.dump", "a.npy", "a.npz", "a.xyz"] {
        let mut writer =
            FrameWriter::create(&path(name), Format::of(&path(name)).expect("a format"))
                .expect("a file");
        for seq in 0..2 {
            let curves = model::read(&path("a.vect"));
            let mut frame = ModelFrame::new(seq, curves);
            if name != "a.npy" {
                frame.cell = Some(Cell::orthogonal([0.0; 3], [9.0, 9.0, 0.0]));
            }
            writer.frame(&frame).expect("a frame");
        }
        writer.finish().expect("a complete file");
    }
    let mut options = ReadOptions::default();
    options.bonds = Some(path("a.data"));
    for name in names {
        read_frames(&path(name), &options).expect("a valid model");
    }
    let certificate = path("a.cert");
    let run = linkwatch(&["certify", text(&path("a.bcc")), "-o", text(&certificate)]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    let valid = Certificate::read(&certificate).expect("a valid certificate");
    assert!(!valid.links.is_empty());
    let mut files = [&names[..], &["a.cert"]].concat();
    if cfg!(feature = "usd") {
        for name in ["apart.usda", "apart.usdc", "many.usdc"] {
            let sample = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/models");
            std::fs::copy(sample.join(name), path(name)).expect("a file");
            files.push(name);
        }
    }
    let contents: Vec<Vec<u8>> = (files.iter())
        .map(|name| std::fs::read(path(name)).expect("a file"))
        .collect();
    let (mut read, mut failed) = (0, 0);
    units("models::model_files_and_certificates", 3000, |random| {
        let k = random.below(files.len());
        let file = path(&format!("changed-{}", files[k]));
        std::fs::write(&file, changed(&contents[k], random)).expect("a file");
        let (result, most) = peak(|| match k {
            _ if files[k] == "a.cert" => Certificate::read(&file).map(drop),
            _ => read_frames(&file, &options),
        });
        assert!(most <= MEMORY, "{most} bytes for {}", files[k]);
        match result {
            Ok(()) => read += 1,
            Err(e) => {
                // The message names the file.
                assert!(e.to_string().contains("changed-"), "{e}");
                failed += 1;
            }
        }
    });
    println!("models: {read} still valid, {failed} refused");
}
