//! Files with known numbers of curves and of other elements. Every element that may be a curve must
//! be read, or counted as skipped, or the file must be refused.

use super::support::random::Random;
use super::units;
use linkwatch::formats::{Frames, ModelFrame, ReadOptions};
use std::fmt::Write;
use tempfile::TempDir;

/// Text of a file, and the numbers of curves that a reader must read and skip.
struct Given {
    name: &'static str,
    text: String,
    read: usize,
    left_out: u64,
    /// True if the reader may also refuse the file.
    refused: bool,
}

/// Returns 2 to 6 points, with first coordinates `first`, `first + 1`, and so on.
fn points(random: &mut Random, first: usize) -> Vec<String> {
    let n = 4 + random.below(4_usize);
    let at = |k: usize| format!("{} {} {}", first + k, k * k % 5, random.below(9));
    (0..n).map(at).collect()
}

fn obj(random: &mut Random) -> Given {
    let (mut text, mut first) = (String::new(), 1);
    let (mut read, mut left_out) = (0, 0);
    for _ in 0..random.below(8) {
        let vertices = points(random, first);
        let n = vertices.len();
        let weights = random.below(2);
        for (k, p) in vertices.iter().enumerate() {
            writeln!(text, "v {p} {}", 1 + weights * k).expect("memory");
        }
        let mut range: Vec<String> = (first..first + n).map(|k| k.to_string()).collect();
        if random.one_in(2) {
            range
                .iter_mut()
                .enumerate()
                .for_each(|(k, i)| *i = format!("{}", k as i64 - n as i64));
        }
        let list = range.join(if random.one_in(3) { " \\\n" } else { " " });
        let knots = |clamped: bool, degree: usize| -> String {
            let knot = |k: usize| match clamped {
                true => k.clamp(degree, n) as f64 * 0.25,
                false => k as f64,
            };
            (0..n + degree + 1)
                .map(|k| format!(" {}", knot(k)))
                .collect()
        };
        let curve = |kind: &str, degree: usize, parm: &str| {
            let [from, to] = [-100, 100];
            let parm = if parm.is_empty() {
                String::new()
            } else {
                format!("parm u{parm}\n")
            };
            format!("cstype {kind}\ndeg {degree}\ncurv {from} {to} {list}\n{parm}end\n")
        };
        let (statement, is_read) = match random.below(13) {
            0 => (format!("l {list}\n"), true),
            1 => (curve("bspline", 1, ""), true),
            2 => (curve("rat bspline", 1, &knots(true, 1)), true),
            3 => (curve("bspline", 1, &knots(false, 1)), true),
            4 => (curve("bspline", 1, &knots(true, 2)), true),
            5 => (curve("bezier", 1, ""), true),
            6 => (curve("bezier", 3, ""), false),
            7 => (curve("bspline", 3, &knots(true, 3)), false),
            8 => (curve("rat bspline", 2, &knots(true, 2)), false),
            9 => (curve("cardinal", 3, ""), false),
            10 => (format!("curv2 {list}\n"), false),
            11 => (format!("polyline {list}\n"), false),
            _ => (curve("bspline", 4, &knots(true, 4)), false),
        };
        text += &statement;
        read += usize::from(is_read);
        left_out += u64::from(!is_read);
        if random.one_in(3) {
            text += "# a comment\ng group\nf 1 2 3\np 1\n";
        }
        first += n;
    }
    Given {
        name: "a.obj",
        text,
        read,
        left_out,
        refused: false,
    }
}

fn lammps(random: &mut Random) -> Given {
    let (mut atoms, mut bonds) = (String::new(), String::new());
    let (mut n, mut joined) = (0, 0);
    let (mut read, mut left_out) = (0, 0);
    for _ in 0..random.below(6) {
        let size = 4 + random.below(4);
        let ids: Vec<u64> = (n + 1..=n + size).collect();
        for id in &ids {
            writeln!(atoms, "{id} 1 1 {id} {} 0", random.below(3)).expect("memory");
        }
        let mut bond = |a: u64, b: u64| {
            joined += 1;
            writeln!(bonds, "{joined} 1 {a} {b}").expect("memory");
        };
        let kind = random.below(4);
        if kind < 3 {
            ids.windows(2).for_each(|w| bond(w[0], w[1]));
        }
        match kind {
            // Atoms without bonds are no curves.
            3 => {}
            0 => {
                bond(ids[1], ids[3]);
                left_out += 1;
            }
            kind => {
                if kind == 1 {
                    bond(ids[0], ids[ids.len() - 1]);
                }
                read += 1;
            }
        }
        n += size;
    }
    let edges = match random.one_in(2) {
        true => "0 999 xlo xhi\n0 999 ylo yhi\n0 999 zlo zhi\n",
        false => "0 999 0 avec\n-999 0 0 bvec\n0 0 999 cvec\n0 0 0 abc origin\n",
    };
    let text = format!(
        "title\n\n{n} atoms\n{joined} bonds\n1 atom types\n{edges}\nAtoms # bond\n\n{atoms}\n\
         Bonds\n\n{bonds}"
    );
    Given {
        name: "a.txt",
        text,
        read,
        left_out,
        refused: false,
    }
}

fn plain(random: &mut Random) -> Given {
    let mut text = String::from(random.pick(&["", "# rings\n", "x, y, z\n", "z y x\n"]));
    let (read, mut refused) = (1 + random.below(5_usize), false);
    for k in 0..read {
        let label = random.pick(&["\n", "# next\n", "Component:\n", "\n\nring 7\n"]);
        if k > 0 || random.one_in(2) {
            text += label;
        }
        let comma = if random.one_in(2) { ", " } else { "\t" };
        for p in points(random, 10 * k) {
            text += &(p.replace(' ', comma) + "\n");
        }
        match random.below(12) {
            // A lost column, a count and a column without a name are refused.
            0 => text += "1 2\n",
            1 => text += "3\n",
            2 => text += "1 2 3 4\n",
            _ => continue,
        }
        refused = true;
    }
    Given {
        name: "a.dat",
        text,
        read,
        left_out: 0,
        refused,
    }
}

fn xyz(random: &mut Random) -> Given {
    let (mut atoms, read) = (Vec::new(), 1 + random.below(5_usize));
    for k in 0..read {
        for p in points(random, 10 * k) {
            atoms.push(format!("C {p} {k}"));
        }
    }
    let keys = "Properties=species:S:1:pos:R:3:molecule:I:1";
    Given {
        name: random.pick(&["a.xyz", "a.any"]),
        text: format!("{}\n{keys}\n{}\n", atoms.len(), atoms.join("\n")),
        read,
        left_out: 0,
        refused: false,
    }
}

#[test]
fn every_curve_of_a_file_is_read_or_counted() {
    let folder = TempDir::new().expect("a folder");
    units(
        "left_out::every_curve_of_a_file_is_read_or_counted",
        2000,
        |random| {
            let given = random.pick(&[obj, lammps, plain, xyz])(random);
            let mut options = ReadOptions::default();
            // Columns of points do not say which curves are closed.
            options.closed = (given.name == "a.dat").then_some(true);
            let path = folder.path().join(given.name);
            std::fs::write(&path, &given.text).expect("a file");
            let frames = Frames::open(&path, &options).and_then(|frames| frames.collect());
            let frames: Vec<ModelFrame> = match frames {
                Ok(frames) => frames,
                Err(e) => {
                    let empty = given.read == 0;
                    assert!(given.refused || empty, "{e}\n{}", given.text);
                    return;
                }
            };
            assert!(!given.refused, "not refused:\n{}", given.text);
            let [frame] = &frames[..] else {
                panic!("{} frames:\n{}", frames.len(), given.text);
            };
            let curves = frame.curves.as_ref().expect("a valid frame");
            let left_out: u64 = frame.info.left_out.iter().map(|found| found.count).sum();
            assert_eq!(
                (curves.len(), left_out),
                (given.read, given.left_out),
                "{}",
                given.text
            );
        },
    );
}
