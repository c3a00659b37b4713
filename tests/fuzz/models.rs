//! Model files and certificates with changed bytes.

use super::bytes::changed;
use super::memory::peak;
use super::support::command::{linkwatch, text};
use super::support::random::Random;
use super::units;
use linkwatch::formats::{self, Format, FrameWriter, Frames, ModelFrame, ReadOptions};
use linkwatch::{Cell, Certificate, Result};
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// Maximum number of bytes that a reader may allocate for a file of some kilobytes.
const MEMORY: usize = 4 << 20;

/// Corners of a square.
const SQUARE: [[f64; 2]; 4] = [[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]];

/// Reads all frames of a file. Returns an error if one is invalid.
fn read_frames(file: &Path, options: &ReadOptions) -> Result<()> {
    for frame in Frames::open(file, options)? {
        frame?.curves.map_err(|e| e.in_file(file))?;
    }
    Ok(())
}

/// Valid files of all formats.
struct Corpus {
    folder: TempDir,
    /// For each file: its name, its content, and the options to read it.
    files: Vec<(&'static str, Vec<u8>, ReadOptions)>,
}

impl Corpus {
    fn new() -> Corpus {
        let folder = TempDir::new().expect("a folder");
        let mut corpus = Corpus {
            folder,
            files: Vec::new(),
        };
        let path = |name: &str| corpus.folder.path().join(name);
        let scene = "chainmail:rows=2,columns=3";
        let run = linkwatch(&["generate", scene, "-o", text(&path("a.bcc"))]);
        assert_eq!(run.code, 0, "{}", run.stderr);
        let certificate = path("a.cert");
        let run = linkwatch(&["certify", text(&path("a.bcc")), "-o", text(&certificate)]);
        assert_eq!(run.code, 0, "{}", run.stderr);
        let valid = Certificate::read(&certificate).expect("a valid certificate");
        assert!(!valid.links().is_empty());
        let points = SQUARE.map(|[x, y]| format!("{x} {y} 0.5"));
        let vertices = points.each_ref().map(|p| format!("v {p}\n")).concat();
        let write = |name: &str, text: String| std::fs::write(path(name), text).expect("a file");
        write("a.obj", format!("{vertices}l 1 2 3 4 1\n"));
        let curve = "cstype bspline\ndeg 3\ncurv 0 1 1 2 3 4 1\nparm u 0 0 0 0 .5 1 1 1 1\nend\n\
                     cstype rat bezier\ncurv 0 1 4 3 \\\n 2 1\nend\ndeg 5\ncurv 0 1 1 2\n\
                     curv2 1 2\nl -1 -2\n";
        write("b.obj", vertices + curve);
        let lines = points.join("\n");
        write("a.vect", format!("VECT\n1 4 1\n-4\n1\n{lines}\n1 1 1 1\n"));
        write("a.txt", format!("x, y, z\n{lines}\n\nring 2:\n{lines}\n"));
        write("b.txt", format!("4\n{lines}\n4\n{lines}\n"));
        let atoms: String = (1..)
            .zip(&points)
            .map(|(k, p)| format!("{k} 1 {p}\n"))
            .collect();
        let dump = "ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n4\n\
                    ITEM: BOX BOUNDS abc origin pp pp ff\n\
                    9 0 0 0\n1 9 0 0\n0 2 9 0\nITEM: ATOMS id mol xu yu zu\n";
        write(
            "mol.dump",
            format!("{dump}{atoms}{}{atoms}", dump.replacen("\n0\n", "\n1\n", 1)),
        );
        let data = "title\n4 atoms\n2 bonds\n1 atom types\n9 0 0 avec\n1 9 0 bvec\n0 2 9 cvec\n\
                    0 0 0 abc origin\n\nAtoms # bond\n\n";
        let frames = std::fs::read(path("mol.dump")).expect("a file");
        std::fs::write(path("a.dump"), frames).expect("a file");
        let xyz = points.each_ref().map(|p| format!("C {p} 1 T\n")).concat();
        let keys = "Lattice=\"9 0 0 0 9 0 0 0 0\" pbc=\"T T F\" \
                    Properties=species:S:1:pos:R:3:molecule:I:1:closed:L:1 Timestep=";
        write("a.xyz", format!("4\n{keys}0\n{xyz}4\n{keys}1\n{xyz}"));
        let atoms = atoms.replace(" 1 ", " 1 1 ");
        for (name, bonds) in [
            ("a.data", "1 1 1 2\n2 1 2 3\n3 1 3 4\n4 1 4 1\n"),
            ("b.dat", "1 1 1 2\n2 1 3 2\n"),
        ] {
            let count = bonds.lines().count();
            write(
                name,
                format!("{data}{atoms}\nBonds\n\n{bonds}")
                    .replace("2 bonds", &format!("{count} bonds")),
            );
        }
        let source = Path::new(env!("CARGO_MANIFEST_DIR"));
        let copy = |folder: &str, name: &str| {
            std::fs::copy(source.join(folder).join(name), path(name)).expect("a copy");
        };
        copy("tests/models/numpy", "compressed.npz");
        for name in ["a.npy", "a.npz"] {
            let format = Format::of(&path(name)).expect("a format");
            let mut writer = FrameWriter::create(&path(name), format).expect("a file");
            for seq in 0..2 {
                let mut frame = ModelFrame::new(seq, formats::read(&path("a.vect")));
                if name != "a.npy" {
                    frame.info.cell = Some(Cell::orthogonal([0.0; 3], [9.0, 9.0, 0.0]));
                }
                writer.frame(&frame).expect("a frame");
            }
            writer.finish().expect("a complete file");
        }
        let mut files = vec![
            "a.bcc",
            "a.obj",
            "b.obj",
            "a.vect",
            "a.data",
            "b.dat",
            "a.dump",
            "mol.dump",
            "a.npy",
            "a.npz",
            "compressed.npz",
            "a.xyz",
            "a.txt",
            "b.txt",
            "a.cert",
        ];
        if cfg!(feature = "mcap") {
            for name in ["scene.mcap", "json.mcap", "markers.mcap", "marker.mcap"] {
                copy("recordings/others", name);
                files.push(name);
            }
        }
        let bonds = path("a.data");
        for name in files {
            let mut options = ReadOptions::default();
            options.bonds = Some(bonds.clone()).filter(|_| name == "a.dump");
            options.closed = (name == "a.dump" || name.ends_with(".txt")).then_some(true);
            let file = corpus.folder.path().join(name);
            if name != "a.cert" {
                read_frames(&file, &options).expect("a valid model");
            }
            let content = std::fs::read(&file).expect("a file");
            corpus.files.push((name, content, options));
        }
        corpus
    }

    /// Changes one of the files, and reads it. Returns true if it is still valid.
    fn unit(&self, random: &mut Random) -> bool {
        let (name, content, options) = &self.files[random.below(self.files.len())];
        let file: PathBuf = self.folder.path().join(format!("changed-{name}"));
        std::fs::write(&file, changed(content, random)).expect("a file");
        let (result, most) = peak(|| match *name {
            "a.cert" => Certificate::read(&file).map(drop),
            _ => read_frames(&file, options),
        });
        assert!(most <= MEMORY, "{most} bytes for {name}");
        // The message names the file.
        if let Err(e) = &result {
            assert!(e.to_string().contains("changed-"), "{e}");
        }
        result.is_ok()
    }
}

#[test]
fn model_files_and_certificates() {
    let corpus = Corpus::new();
    let mut valid = 0;
    units("models::model_files_and_certificates", 3000, |random| {
        valid += u64::from(corpus.unit(random));
    });
    println!("models: {valid} still valid, the others are refused");
}

#[test]
#[ignore = "takes some minutes"]
fn ten_thousand_files_of_each_format() {
    let corpus = Corpus::new();
    let count = 10_000 * corpus.files.len() as u64;
    let mut valid = 0;
    units(
        "models::ten_thousand_files_of_each_format",
        count,
        |random| {
            valid += u64::from(corpus.unit(random));
        },
    );
    println!("models: {valid} of {count} still valid, the others are refused");
}
