//! Data files (`read_data`, `write_data`): a header of counts and box, then sections.
//!
//! Only the sections `Atoms` and `Bonds` are read; the others are skipped up to the next empty
//! line.
//!
//! A data file does not say in which directions its box is periodic. All are taken as periodic, as
//! is the default of LAMMPS. (If they are not, all atoms are in the box, so no curve is linked with
//! an image, and nothing is wrong.) Files that linkwatch writes have the command `boundary` in
//! their title, which is understood in the title of any file: `boundary p p f`.

use super::cell::{Atom, SimulationBox, atom};
use crate::curve::Point;
use crate::curve::vector::add;
use crate::error::{Error, Result};
use crate::formats::lines::{Lines, integer, words, words_between};
use crate::formats::{number, quote};
use crate::verdict::LeftOut;

pub(super) const FORMAT: &str = "LAMMPS data file";
/// Shortest line of an atom, `1 1 0 0 0`, and of a bond, `1 1 1 2`, with the line break.
const ATOM_BYTES: u64 = 10;
const BOND_BYTES: u64 = 8;

/// Sections that are read.
const SECTIONS: [&str; 2] = ["Atoms", "Bonds"];

/// Sections of a data file to read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Wanted {
    /// Only the bonds, because a dump has the atoms.
    Bonds,
    Everything,
}

/// Content of a file.
#[derive(Debug, Default)]
pub(super) struct Data {
    pub space: SimulationBox,
    /// Id of each atom and its coordinates, unwrapped if there are image flags.
    pub atoms: Vec<(u64, Point)>,
    /// True if there are image flags.
    pub flags: bool,
    /// Ids of the atoms of each bond.
    pub bonds: Vec<[u64; 2]>,
    pub left_out: Vec<LeftOut>,
}

/// Counts and box.
#[derive(Default)]
struct Header {
    atoms: u64,
    bonds: u64,
    types: u64,
    periodic: [bool; 3],
    bounds: [Option<[f64; 2]>; 3],
    tilt: [f64; 3],
    /// Edges of a general triclinic box, and its corner.
    edges: [Option<Point>; 3],
    origin: Point,
    left_out: Vec<LeftOut>,
}

/// Returns true if a text begins as a data file does: after the title, a header that counts atoms.
pub(super) fn begins(text: &[u8]) -> bool {
    /// Maximum number of lines that are searched.
    const LINES: usize = 40;
    let header = text.split(|&b| b == b'\n').skip(1).take(LINES);
    header.map(without_comment).any(|line| {
        let words: Vec<&[u8]> = words(line).take(3).collect();
        matches!(words[..], [count, b"atoms"] if count.iter().all(u8::is_ascii_digit))
    })
}

/// Reads a file to its end.
pub(super) fn read(mut lines: Lines<'_>, wanted: Wanted) -> Result<Data> {
    lines.expect("a data file of LAMMPS")?;
    let mut header = Header {
        periodic: boundary(&lines.line),
        ..Header::default()
    };
    let mut data = Data::default();
    let mut found = [false; 2];
    let mut in_header = true;
    while lines.advance()? {
        let text = without_comment(&lines.line).trim_ascii();
        if text.is_empty() {
            continue;
        }
        if !text[0].is_ascii_alphabetic() {
            if !in_header {
                let what = format!("{}, expected the name of a section", quote(text));
                return Err(lines.bad(what));
            }
            header.line(text).map_err(|what| lines.bad(what))?;
            continue;
        }
        if std::mem::take(&mut in_header) {
            data.left_out = std::mem::take(&mut header.left_out);
            if wanted == Wanted::Everything {
                data.space = header.space().map_err(|what| lines.bad(what))?;
            }
        }
        let section = SECTIONS.iter().position(|name| text == name.as_bytes());
        if section.is_some_and(|k| std::mem::replace(&mut found[k], true)) {
            let what = format!("a second section {}", quote(text));
            return Err(lines.bad(what));
        }
        match section {
            Some(0) if wanted == Wanted::Everything => atoms(&mut lines, &header, &mut data)?,
            Some(1) => {
                data.bonds = read_section(&mut lines, header.bonds, BOND_BYTES, "bonds", bond)?
            }
            _ => skip(&mut lines)?,
        }
    }
    let missing = |name: &str, count: u64| {
        let what = format!("no section {name}, but the header promises {count}");
        Err(Error::format(FORMAT, "whole file", what))
    };
    match found {
        [false, _] if wanted == Wanted::Everything => missing("Atoms", header.atoms),
        [_, false] if header.bonds > 0 => missing("Bonds", header.bonds),
        _ => Ok(data),
    }
}

/// Returns the periodic directions by the title of a file, if it has the command `boundary`.
fn boundary(title: &[u8]) -> [bool; 3] {
    let words = words_between(title, |b| !b.is_ascii_alphanumeric());
    let words: Vec<&[u8]> = words.collect();
    let is_code = |word: &&[u8]| word.len() <= 2 && word.iter().all(|c| b"pfsm".contains(c));
    let mut windows = words.windows(4);
    let named = windows.find(|w| w[0] == b"boundary" && w[1..].iter().all(is_code));
    named.map_or([true; 3], |w| [1, 2, 3].map(|x| w[x].starts_with(b"p")))
}

/// Returns a line up to its comment.
fn without_comment(line: &[u8]) -> &[u8] {
    line.split(|&b| b == b'#').next().unwrap_or_default()
}

impl Header {
    fn line(&mut self, text: &[u8]) -> Result<(), String> {
        let all: Vec<&[u8]> = words(text).take(9).collect();
        let count = || integer(all[0], "a number of atoms or bonds");
        let numbers =
            |y, z| -> Result<Point, String> { Ok([number(all[0])?, number(y)?, number(z)?]) };
        match all[1..] {
            [b"atoms"] => self.atoms = count()?,
            [b"bonds"] => self.bonds = count()?,
            [b"atom", b"types"] => self.types = count()?,
            [y, z, name @ (b"avec" | b"bvec" | b"cvec")] => {
                self.edges[usize::from(name[0] - b'a')] = Some(numbers(y, z)?);
            }
            [y, z, b"abc", b"origin"] => self.origin = numbers(y, z)?,
            // Particles that are segments or chains of them.
            [name @ (b"lines" | b"bodies")] => {
                let kind = match name {
                    b"lines" => ["line particle", "line particles"],
                    _ => ["body particle", "body particles"],
                };
                LeftOut::add_all(&mut self.left_out, kind, count()?, || "header".into());
            }
            [high, low_name, high_name] => {
                for (axis, bounds) in [b'x', b'y', b'z'].into_iter().zip(&mut self.bounds) {
                    if *low_name == [axis, b'l', b'o'] && *high_name == [axis, b'h', b'i'] {
                        *bounds = Some([number(all[0])?, number(high)?]);
                    }
                }
            }
            [xz, yz, b"xy", b"xz", b"yz"] => self.tilt = numbers(xz, yz)?,
            // Counts of angles, velocities and others.
            _ => {}
        }
        Ok(())
    }

    fn space(&self) -> Result<SimulationBox, String> {
        let (low, periodic) = (self.origin, self.periodic);
        match self.edges {
            [Some(a), Some(b), Some(c)] => {
                return Ok(SimulationBox {
                    low,
                    edges: [a, b, c],
                    periodic,
                });
            }
            [None, None, None] => {}
            _ => return Err("the header ends without one of `avec`, `bvec` and `cvec`".into()),
        }
        let mut bounds = [[0.0; 3]; 2];
        for ((x, axis), given) in ['x', 'y', 'z'].into_iter().enumerate().zip(self.bounds) {
            let what = || format!("the header ends without the bounds `{axis}lo {axis}hi`");
            let [low, high] = given.ok_or_else(what)?;
            (bounds[0][x], bounds[1][x]) = (low, high);
        }
        Ok(SimulationBox::new(bounds, self.tilt, periodic))
    }
}

/// Skips a section.
fn skip(lines: &mut Lines<'_>) -> Result<()> {
    let mut inside = false;
    while lines.advance()? {
        let empty = without_comment(&lines.line).trim_ascii().is_empty();
        if inside && empty {
            break;
        }
        inside |= !empty;
    }
    Ok(())
}

/// Reads the `count` lines of a section, which have at least `bytes` bytes. Empty lines may precede
/// the first one.
fn read_section<T>(
    lines: &mut Lines<'_>,
    count: u64,
    bytes: u64,
    what: &str,
    mut parse: impl FnMut(&[u8]) -> Result<T, String>,
) -> Result<Vec<T>> {
    lines.check_room(count, bytes, what)?;
    let mut found = Vec::with_capacity(count as usize);
    while (found.len() as u64) < count {
        let k = found.len();
        lines.expect(format_args!("{count} {what}, found {k}"))?;
        if !without_comment(&lines.line).trim_ascii().is_empty() {
            found.push(lines.parse(|line| parse(without_comment(line)))?);
        } else if k > 0 {
            return Err(lines.bad(format_args!("an empty line after {k} of {count} {what}")));
        }
    }
    Ok(found)
}

/// Parses `id type atom atom`.
fn bond(text: &[u8]) -> Result<[u64; 2], String> {
    let mut words = words(text).skip(2);
    let mut atom = || match words.next() {
        Some(word) => integer(word, "the id of an atom"),
        None => Err("too few words, expected `id type atom atom`".into()),
    };
    match [atom()?, atom()?] {
        [a, b] if a == b => Err(format!("the bond connects atom {a} to itself")),
        atoms => Ok(atoms),
    }
}

/// Columns of the section `Atoms`.
struct Columns {
    /// Number of columns.
    all: usize,
    /// Column of x.
    x: usize,
    /// True if the style was guessed from the number of columns, so that atom types are validated.
    guessed: bool,
    /// True if three image flags follow the coordinates.
    flags: bool,
}

/// Styles of atoms, with the column of x and the number of columns.
const STYLES: [(&str, usize, usize); 8] = [
    ("angle", 3, 6),
    ("atomic", 2, 5),
    ("bond", 3, 6),
    ("bpm/sphere", 5, 8),
    ("charge", 3, 6),
    ("full", 4, 7),
    ("molecular", 3, 6),
    ("sphere", 4, 7),
];

impl Columns {
    /// Returns the columns of the style in the comment of the heading, or of the style that the
    /// number of columns suggests.
    fn new(style: Option<&str>, columns: usize) -> Result<Columns, String> {
        let (x, least) = match style {
            // Only styles with bonds, because other files have no curves.
            None if matches!(columns, 6 | 9) => (3, 6),
            None if matches!(columns, 7 | 10) => (4, 7),
            None => {
                return Err(format!(
                    "atoms of {columns} columns, from which their style cannot be told: name it in \
                     the heading (`Atoms # bond`)"
                ));
            }
            Some(style) => {
                let known = STYLES.iter().find(|(name, ..)| *name == style);
                let &(_, x, least) = known.ok_or_else(|| {
                    let known = STYLES.map(|(name, ..)| name).join(", ");
                    format!(
                        "atoms of style {}, which is not read (known: {known}): give a dump of the \
                         coordinates, and this file for its bonds",
                        quote(style.as_bytes())
                    )
                })?;
                if columns != least && columns != least + 3 {
                    return Err(format!(
                        "{columns} columns, but atoms of style {style} have {least}, or {} with \
                         image flags",
                        least + 3
                    ));
                }
                (x, least)
            }
        };
        Ok(Columns {
            all: columns,
            x,
            guessed: style.is_none(),
            flags: columns > least,
        })
    }

    /// Returns the id of an atom, its coordinates, and its image flags (0 without).
    fn atom(&self, words: &[&[u8]], types: u64) -> Result<Atom, String> {
        if words.len() != self.all {
            let (found, all) = (words.len(), self.all);
            return Err(format!("{found} columns, but the first atom has {all}"));
        }
        if self.guessed {
            let given: u64 = integer(words[2], "the type of an atom: name the style of the atoms")?;
            if !(1..=types).contains(&given) {
                return Err(format!(
                    "type {given} of an atom in column 3, but there are {types} types: name the \
                     style of the atoms in the heading (`Atoms # bond`)"
                ));
            }
        }
        let flags = self.flags.then(|| &words[words.len() - 3..]);
        atom(words[0], &words[self.x..], flags)
    }
}

fn atoms(lines: &mut Lines<'_>, header: &Header, data: &mut Data) -> Result<()> {
    let comment = lines.line.split(|&b| b == b'#').nth(1);
    let style = comment.map(|c| String::from_utf8_lossy(c).trim().to_owned());
    let style = style.as_deref().filter(|style| !style.is_empty());
    let (mut columns, space) = (None, &data.space);
    data.atoms = read_section(lines, header.atoms, ATOM_BYTES, "atoms", |line| {
        let words: Vec<&[u8]> = words(line).collect();
        let columns = match &mut columns {
            Some(known) => known,
            none => none.insert(Columns::new(style, words.len())?),
        };
        let (id, at, flags) = columns.atom(&words, header.types)?;
        Ok((id, add(at, space.shift(flags))))
    })?;
    data.flags = columns.is_some_and(|columns| columns.flags);
    Ok(())
}
