//! Plain text: lines `x y z`, separated by spaces, tabs, commas or semicolons, as tools for knots,
//! DNA and polymers write them (KnotPlot, KymoKnot, calc_writhe, spreadsheets).
//!
//! | line | meaning |
//! |---|---|
//! | `1.0 2.0 3.0` | a point |
//! | empty; `# text`, `% text`, `// text`; a label, `Component 1 of 2:` | the curve ends here |
//! | an integer | number of points of a frame, which begins here (KymoKnot) |
//! | `x,y,z`, `id,x,y,z,curve` | names of the columns |
//!
//! A file without counts is one frame. A file with counts is a motion: each of them begins a frame,
//! and all points of the file belong to one. That is said if there are several frames, as another
//! program may mean the curves of one frame.
//!
//! # Columns
//!
//! Without a header there are three columns. A header must name `x`, `y` and `z` (or `Points:0` to
//! `Points:2`, as ParaView does). A column `curve` (or another of [`GROUPS`]) separates curves
//! where its value changes, which is their name. Columns of other names are ignored if it is known
//! that they do not divide the points ([`OTHERS`], and a first column without a name, as pandas
//! writes its index), and refused else: ignored, they would join curves. Names of three other
//! columns are refused, not taken for a label: `theta,r,z` are no coordinates.
//!
//! # Closed and open curves
//!
//! A curve that ends where it starts is read as it is, and closed by [`Closing`]. Otherwise text
//! does not say if a curve is closed, and neither does this reader: the caller decides
//! ([`ReadOptions::closed`]), or gives the number of points of each curve
//! ([`ReadOptions::counts`], below 0 if it is closed; the points are then divided by them alone).
//! Without both the file is refused. Curves that the caller closes have no repeated point.
//!
//! [`Closing`]: crate::Closing
//!
//! Cost: one pass, with the memory of a frame.

use super::frames::{FrameSource, ModelFrame, ReadOptions, Source};
use super::lines::{Lines, integer, parsed, words};
use super::{Input, divided, is_in, number, quote};
use crate::curve::{CurveLabels, CurveSet, Point, Positions, count_of};
use crate::error::{Error, Result};
use crate::ingest::{Closing, FrameInfo};
use std::borrow::Cow;
use std::collections::HashSet;
use std::io::BufRead;
use std::path::Path;

const FORMAT: &str = "text file of points";
/// Shortest line of a point, `0 0 0`, with the line break.
const POINT_BYTES: u64 = 6;

/// Names of columns that say to which curve a point belongs.
const GROUPS: &str = "\
    curve component strand chain molecule mol polyline line ring loop filament";

/// Names of columns that do not divide the points.
const OTHERS: &str = "\
    arclength curvature diameter fx fy fz i id index length mass n nx ny nz point r radius s \
    species temperature torsion tx ty tz type vertex vx vy vz w weight width";

/// Names of those columns that number the points. So does a first column without a name, the index
/// that pandas writes.
const NUMBERS: &str = "i id index n point vertex";

/// Names of coordinates, of any system.
const COORDINATES: &str = "phi r rho theta x y z";

/// Words for numbers that are missing.
const MISSING: &str = "inf infinity n/a na nan nil none null";

/// Starts before the first frame of a file.
pub(super) fn read<'a>(input: Input<'a>, options: &ReadOptions) -> Result<Source<'a>> {
    Ok(Box::new(Points {
        lines: Lines::new(FORMAT, input)?,
        options: options.clone(),
        columns: PLAIN,
        count: None,
        frames: 0,
        decided: false,
    }))
}

/// Returns true if a text has points in lines of this format, and nothing else.
pub(super) fn begins(text: &[u8]) -> bool {
    let mut columns = PLAIN;
    let (mut points, mut labels) = (0, 0);
    for line in text.split(|&b| b == b'\n') {
        match columns.line(line) {
            Ok(Line::Point(..)) => points += 1,
            Ok(Line::Break { label: true }) => labels += 1,
            Ok(_) => {}
            Err(_) => return false,
        }
    }
    points > 1 && labels < points
}

/// Returns true if the extension of a text file fits, and at least half of the nonempty lines in
/// its first block contain two numbers. Some lines may be malformed; the reader reports them.
pub(super) fn is_table(path: &Path) -> bool {
    let extension = path.extension().unwrap_or_default();
    let tables = ["txt", "csv", "tsv", "dat", "raw"];
    if !tables.iter().any(|e| extension.eq_ignore_ascii_case(e)) {
        return false;
    }
    let start = super::open_text(path).and_then(|mut input| Ok(input.bytes.fill_buf()?.to_vec()));
    let start = start.unwrap_or_default();
    let (mut all, mut numbers) = (0, 0);
    for line in start.split(|&b| b == b'\n').map(with_plain_spaces) {
        let fields = fields(&line);
        all += usize::from(fields.iter().any(|field| !field.is_empty()));
        numbers += usize::from(fields.iter().filter(|field| is_number(field)).count() > 1);
    }
    2 * numbers >= all && numbers > 0
}

/// A line of a file.
#[derive(Debug, PartialEq)]
enum Line {
    /// A point, its value in the column that groups the points into curves, and those in columns
    /// that number them.
    Point(Point, Option<Vec<u8>>, Vec<Vec<u8>>),
    Count(u64),
    /// The curve ends. True if the line is neither empty nor a comment.
    Break {
        label: bool,
    },
}

/// Columns of the points.
#[derive(Clone, Debug, PartialEq)]
struct Columns {
    all: usize,
    /// Columns of x, y and z.
    at: [usize; 3],
    group: Option<usize>,
    /// Columns that number the points. None if a column groups the points.
    numbers: Vec<usize>,
}

/// Columns of a file without a header.
const PLAIN: Columns = Columns {
    all: 3,
    at: [0, 1, 2],
    group: None,
    numbers: Vec::new(),
};

/// Returns a line with spaces in place of no-break spaces, in UTF-8 or Latin-1.
fn with_plain_spaces(line: &[u8]) -> Cow<'_, [u8]> {
    match std::str::from_utf8(line) {
        _ if line.is_ascii() => line.into(),
        Ok(text) => text
            .replace(['\u{A0}', '\u{202F}'], " ")
            .into_bytes()
            .into(),
        Err(_) => line
            .iter()
            .map(|&b| if b == 0xA0 { b' ' } else { b })
            .collect(),
    }
}

/// Returns the fields of a line, without quotes. Between commas, semicolons or tabs there may be
/// spaces.
fn fields(line: &[u8]) -> Vec<&[u8]> {
    let separator = [b';', b',', b'\t'].into_iter().find(|b| line.contains(b));
    let mut fields: Vec<&[u8]> = match separator {
        Some(separator) => {
            let fields = line.split(|&b| b == separator);
            fields.map(<[u8]>::trim_ascii).map(unquoted).collect()
        }
        None => words(line).collect(),
    };
    // A separator at the end of a line.
    if fields.len() > 1 && fields.last().is_some_and(|field| field.is_empty()) {
        fields.pop();
    }
    fields
}

/// Returns a field of a table without its quotes.
fn unquoted(field: &[u8]) -> &[u8] {
    let inside = field
        .strip_prefix(b"\"")
        .and_then(|rest| rest.strip_suffix(b"\""));
    inside.unwrap_or(field)
}

fn is_number(field: &&[u8]) -> bool {
    parsed(field).is_some()
}

/// Returns true if a field is a number, or stands for one that is missing or does not fit.
fn is_value(field: &&[u8]) -> bool {
    let word = String::from_utf8_lossy(field).to_ascii_lowercase();
    let begins = |c: char| c.is_ascii_digit() || "+-−.*".contains(c);
    word.is_empty() || word.starts_with(begins) || is_in(MISSING, &word)
}

impl Columns {
    /// Parses a line. A header sets the columns.
    fn line(&mut self, line: &[u8]) -> Result<Line, String> {
        let line = with_plain_spaces(line);
        let line = line.trim_ascii();
        let starts = [b"#".as_slice(), b"%", b"//"];
        let comment = starts.iter().find_map(|start| line.strip_prefix(*start));
        // Some programs write the names of the columns as a comment.
        let named = comment.map(|comment| Columns::named(&fields(comment.trim_ascii())));
        if let Some(Ok(Some(columns))) = named {
            *self = columns;
        }
        if comment.is_some() || line.is_empty() {
            return Ok(Line::Break { label: false });
        }
        let fields = fields(line);
        let numbers = fields.iter().filter(|field| is_number(field)).count();
        // The last field may be empty.
        let is_complete = self.all >= fields.len() && fields.len() + 1 >= self.all;
        let may_be = |&column: &usize| fields.get(column).is_none_or(is_value);
        let is_row = is_complete && self.at.iter().all(may_be) || fields.iter().all(is_value);
        let is_row = is_row && fields.len() > 1;
        let few = self.all > numbers && 2 * numbers <= fields.len();
        if !is_number(&fields[0]) && few && !is_row {
            match Columns::named(&fields)? {
                Some(columns) => *self = columns,
                None if self.may_be_names(line, &fields) => {
                    return Err(format!(
                        "the columns {}: name the coordinates x, y and z; if this is a title, \
                         begin it with `#`",
                        quote(line)
                    ));
                }
                None => {}
            }
            return Ok(Line::Break { label: true });
        }
        if fields.len() == 1 && self.all > 1 {
            let expected = "the number of points of a frame, or x y z";
            return integer(fields[0], expected).map(Line::Count);
        }
        if fields.len() != self.all {
            let (found, all) = (fields.len(), self.all);
            return Err(format!(
                "{found} columns, expected {all}; a header names others: `x,y,z,curve`"
            ));
        }
        let [x, y, z] = self.at.map(|column| number(fields[column]));
        let value = |column: usize| fields[column].to_vec();
        let numbers = self.numbers.iter().map(|&column| value(column));
        Ok(Line::Point(
            [x?, y?, z?],
            self.group.map(value),
            numbers.collect(),
        ))
    }

    /// Returns true if a line without numbers names all columns, and none of x, y and z.
    fn may_be_names(&self, line: &[u8], fields: &[&[u8]]) -> bool {
        let is_coordinate =
            |field: &&[u8]| is_in(COORDINATES, &String::from_utf8_lossy(field).to_lowercase());
        let is_table = line.iter().any(|b| b";,\t".contains(b));
        fields.len() == self.all && (is_table || fields.iter().any(is_coordinate))
    }

    /// Returns the columns of a header. `None` if it does not name the coordinates.
    fn named(fields: &[&[u8]]) -> Result<Option<Columns>, String> {
        let name = |field: &&[u8]| {
            let text = String::from_utf8_lossy(field).to_ascii_lowercase();
            // A unit.
            let name = text.trim_matches('"').split(['(', '[']).next();
            name.unwrap_or_default().trim().to_owned()
        };
        let names: Vec<String> = fields.iter().map(name).collect();
        let find = |wanted: [&str; 3]| {
            let [x, y, z] = wanted.map(|wanted| names.iter().position(|name| name == wanted));
            Some([x?, y?, z?])
        };
        let known = find(["x", "y", "z"]).or_else(|| find(["points:0", "points:1", "points:2"]));
        let Some(at) = known else {
            return Ok(None);
        };
        let (mut group, mut numbers) = (None, Vec::new());
        for (k, name) in names.iter().enumerate() {
            match name.as_str() {
                _ if at.contains(&k) => {}
                _ if is_in(GROUPS, name) && group.is_none() => group = Some(k),
                // The index of pandas has no name.
                "" | "unnamed: 0" if k == 0 => numbers.push(k),
                _ if is_in(NUMBERS, name) => numbers.push(k),
                _ if is_in(OTHERS, name) => {}
                _ => {
                    return Err(format!(
                        "a column {}, which may say which points belong together: name it curve \
                         if it does, and remove it if not",
                        quote(name.as_bytes())
                    ));
                }
            }
        }
        if group.is_some() {
            numbers.clear();
        }
        let all = names.len();
        Ok(Some(Columns {
            all,
            at,
            group,
            numbers,
        }))
    }
}

/// Points of a frame, and the number of points of each curve.
#[derive(Default)]
struct Curves {
    points: Vec<Point>,
    sizes: Vec<usize>,
    /// True if the next point begins a curve.
    begins: bool,
    /// Value of the column that groups the points, and the values of the previous curves.
    group: Option<Vec<u8>>,
    groups: HashSet<Vec<u8>>,
    /// Values of that column, in the order of the curves.
    names: Vec<String>,
    /// First and last values of the current curve in the columns that number the points.
    numbers: [Vec<Vec<u8>>; 2],
    /// First line of the frame that is no point, although the frame has its number of lines.
    bad: Option<Error>,
}

impl Curves {
    fn push(
        &mut self,
        point: Point,
        group: Option<Vec<u8>>,
        numbers: Vec<Vec<u8>>,
    ) -> Result<(), String> {
        if group != self.group || self.sizes.is_empty() {
            if let Some(group) = &group {
                if !self.groups.insert(group.clone()) {
                    let group = quote(group);
                    return Err(format!(
                        "a point of curve {group} after those of another curve"
                    ));
                }
                self.names.push(match std::str::from_utf8(group) {
                    Ok(name) if !name.is_empty() && !name.contains(char::is_control) => name.into(),
                    _ => format!("'{}'", group.escape_ascii()),
                });
            }
            self.begins = true;
            self.group = group;
        }
        if std::mem::take(&mut self.begins) {
            self.sizes.push(0);
        }
        self.check_numbers(numbers, point)?;
        *self.sizes.last_mut().expect("a curve was begun") += 1;
        self.points.push(point);
        Ok(())
    }

    /// Checks the values of a point in the columns that number points: they differ from those
    /// before.
    ///
    /// # Errors
    ///
    /// A column numbers curves, or begins again for each of them.
    fn check_numbers(&mut self, numbers: Vec<Vec<u8>>, point: Point) -> Result<(), String> {
        let [first, last] = &mut self.numbers;
        let size = self.sizes.last().copied().unwrap_or(0);
        if size == 0 {
            first.clone_from(&numbers);
        } else if !numbers.is_empty() {
            let start = self.points.len() - size;
            // The first point may be repeated at the end.
            let is_first = self.points.get(start) == Some(&point);
            let mut all = numbers.iter().zip(first.iter().zip(&*last));
            let again = all.find(|(now, (first, last))| now == last || now == first && !is_first);
            if let Some((number, _)) = again {
                let number = quote(number);
                return Err(format!(
                    "{number} again in a column that numbers points: name the column curve if it \
                     says which points belong together; if it begins again with each curve, add a \
                     column curve, or an empty line between curves"
                ));
            }
        }
        *last = numbers;
        Ok(())
    }

    /// Returns the curves.
    ///
    /// # Errors
    ///
    /// The text does not say which of them are closed, and this is the first frame, which
    /// decides for all.
    fn finish(mut self, options: &ReadOptions, is_first: bool) -> Result<CurveSet> {
        if let Some(bad) = self.bad.take() {
            return Err(bad);
        }
        let counts = match &options.counts {
            Some(counts) => counts.clone(),
            None => self.counts(options.closed, is_first)?,
        };
        divided(FORMAT, "points", &self.points, &counts)
    }

    /// Returns the number of points of each curve, below 0 if it is closed, and removes points that
    /// repeat the first one of a closed curve.
    fn counts(&mut self, closed: Option<bool>, is_first: bool) -> Result<Vec<i32>> {
        let sizes = self.sizes.iter().map(|&size| count_of(size, false));
        let sizes: Vec<i32> = sizes.collect::<Result<_>>()?;
        let meet = Closing::ends_meet(&sizes, Positions::F64(self.points.as_flattened()));
        let (mut counts, mut undecided) = (Vec::with_capacity(sizes.len()), 0);
        let (mut first, mut kept) = (0, 0);
        let is_closed = closed.unwrap_or(false);
        for (&size, repeats) in self.sizes.iter().zip(meet) {
            undecided += u64::from(is_first && closed.is_none() && !repeats);
            let size_of_curve = size - usize::from(is_closed && repeats);
            self.points.copy_within(first..first + size_of_curve, kept);
            first += size;
            kept += size_of_curve;
            counts.push(count_of(size_of_curve, is_closed)?);
        }
        self.points.truncate(kept);
        if undecided == 0 {
            return Ok(counts);
        }
        let (n, first) = (self.sizes.len(), self.sizes[0]);
        let what = format!(
            "nothing says if {undecided} of {n} curves are closed: pass the option `closed` if all \
             are, the option `closed=false` if none is, or the number of points of each curve, \
             negative if it is closed (option `counts=-{first}`)"
        );
        Err(Error::unsupported(FORMAT, what))
    }
}

/// Reader of the frames.
struct Points<'a> {
    lines: Lines<'a>,
    options: ReadOptions,
    columns: Columns,
    /// Number of points of the next frame, if it was read.
    count: Option<u64>,
    /// Number of frames before the next one.
    frames: u64,
    /// True after a valid frame, which decides which curves are closed.
    decided: bool,
}

impl Points<'_> {
    /// Reads the points of a frame, up to the count of the next one. `None` at the end of the file.
    fn curves(&mut self) -> Result<Option<Curves>> {
        let mut curves = Curves::default();
        let mut count = self.count.take();
        while self.lines.advance()? {
            let line = match self.columns.line(&self.lines.line) {
                // The next frame begins after the promised number of lines.
                Err(what) if count > Some(curves.points.len() as u64) => {
                    curves.bad.get_or_insert(self.lines.bad(what));
                    curves.points.push([0.0; 3]);
                    continue;
                }
                line => line.map_err(|what| self.lines.bad(what))?,
            };
            match line {
                Line::Break { .. } => curves.begins = true,
                Line::Count(0) => return Err(self.lines.bad("a frame of 0 points")),
                Line::Count(n) => {
                    self.lines.check_room(n, POINT_BYTES, "points")?;
                    if count.is_none() && self.frames == 0 && curves.points.is_empty() {
                        count = Some(n);
                        continue;
                    }
                    self.count = Some(n);
                    self.check_complete(&curves, count)?;
                    return Ok(Some(curves));
                }
                Line::Point(point, group, mut numbers) => {
                    if let Some(n) = count.filter(|&n| n == curves.points.len() as u64) {
                        let what = format!("a point after the {n} of its frame");
                        return Err(self.lines.bad(what));
                    }
                    // The caller divides the points.
                    if self.options.counts.is_some() {
                        numbers.clear();
                    }
                    let pushed = curves.push(point, group, numbers);
                    pushed.map_err(|what| self.lines.bad(what))?;
                }
            }
        }
        self.check_complete(&curves, count)?;
        Ok((count.is_some() || !curves.points.is_empty()).then_some(curves))
    }

    /// Fails if points are missing at the end of a frame, or it has no count.
    fn check_complete(&self, curves: &Curves, count: Option<u64>) -> Result<()> {
        let found = curves.points.len() as u64;
        let what = match count {
            Some(count) if count != found => format!("{found} points, {count} promised"),
            None if self.count.is_some() => {
                format!("the number of points of a frame after {found} points without a number")
            }
            _ => return Ok(()),
        };
        Err(self.lines.bad(what))
    }
}

impl FrameSource for Points<'_> {
    fn next_frame(&mut self) -> Result<Option<ModelFrame>> {
        let Some(mut curves) = self.curves()? else {
            return Ok(None);
        };
        if self.frames == 1 {
            tracing::warn!(
                "{}: each line with a number of points begins a frame; if the file has curves of \
                 one frame, separate them by empty lines in place of the numbers",
                self.lines.name
            );
        }
        let seq = self.frames;
        self.frames += 1;
        // Lines without points may divide the points of a name.
        let named = self.options.counts.is_none() && curves.names.len() == curves.sizes.len();
        let names = named.then(|| std::mem::take(&mut curves.names));
        let set = curves.finish(&self.options, !self.decided);
        self.decided |= set.is_ok();
        let info =
            FrameInfo::at(seq, 0.0).with_labels(0, CurveLabels::named(names.unwrap_or_default()));
        Ok(Some(ModelFrame::of(info, set)))
    }
}

#[cfg(test)]
mod tests;
