//! Lines of a Wavefront OBJ file, read as polylines in double precision.
//!
//! The statements `v`, `l` and `curv` of degree 1 (with `cstype`, `deg`, `parm u`, `end`) are used.
//! The weight or colours of a vertex and the texture index in `a/b` are ignored in an `l`.
//! Exporters write polylines in three forms:
//!
//! - One `l` of many vertices per curve (Houdini, often continued over lines by `\`): each is a
//!   separate curve, closed if it ends at its first vertex, or if the edge from its end to its
//!   start follows.
//! - Many `l` of two vertices (Blender): edges, which are joined if they share a vertex, in any
//!   order. The curve starts with its first edge in the file and keeps the direction of that edge,
//!   so that edges written in order give the curve in order. A vertex with more than two edges is
//!   an error, because the continuation is ambiguous.
//! - A `curv` of degree 1: the polyline of its control points.
//!
//! Vertices are equal if their indices are; coordinates are not compared. Curves have the order of
//! their first lines. An index may precede its vertex; a negative index counts back from the line.
//!
//! # Elements that are left out
//!
//! Other free-form curves, curves on surfaces (`curv2`), and statements with an unknown name are
//! counted ([`LeftOut`]). The Python package converts free-form curves. Faces, points and surfaces
//! are no curves: they are ignored, like everything that concerns the display.

#[cfg(test)]
mod tests;

use super::chains::{Chains, Edge, ThirdEdge};
use super::frames::{ModelFrame, Source};
use super::lines::{Lines, integer, words};
use super::write::{check_polylines, create};
use super::{Input, is_in, number, quote};
use crate::curve::{Basis, CurveSet, Point, Positions, Precision};
use crate::error::{Error, Result};
use crate::verdict::LeftOut;
use std::ops::Range;
use std::path::Path;

const FORMAT: &str = "OBJ";

/// Statements that are no curves.
const IGNORED: &str = "\
    bevel bmat bsp bzp c_interp cdp con csh ctech d_interp f fo g hole lod maplib mg mtllib \
    o p res s scrv shadow_obj sp stech step surf trace_obj trim usemap usemtl vc vn vp vt";

/// Kind of the free-form curves that are left out.
const FREE_FORM: [&str; 2] = ["free-form curve", "free-form curves"];

/// Share of the range of knots up to which a difference is rounding of their decimals.
const ROUNDED: f64 = 1e-5;

/// A polyline, as a range of the indices of the file.
struct Curve {
    indices: Range<usize>,
    closed: bool,
    line: u64,
}

/// Values of `cstype` and `deg`, which hold until they are set again.
#[derive(Default)]
struct CurveType {
    /// `None` without `cstype`.
    name: Option<Vec<u8>>,
    rational: bool,
    degree: u32,
}

impl CurveType {
    /// Reads `cstype rat type`.
    fn set_type(&mut self, tokens: &[&[u8]]) {
        self.rational = tokens.first() == Some(&b"rat".as_slice());
        let name = tokens.get(usize::from(self.rational)).copied();
        self.name = Some(name.unwrap_or_default().to_vec());
    }

    /// Returns the reason why curves of this type are not read, as text.
    fn unread(&self) -> Option<String> {
        match (self.name.as_deref(), self.degree) {
            (None, _) => Some("without cstype".into()),
            (Some(b"bezier" | b"bspline"), 1) => None,
            (Some(b"bezier" | b"bspline"), degree @ (2 | 3)) => Some(format!(
                "of degree {degree}: `python -m linkwatch convert FILE OUT.npz --format obj` reads \
                 it"
            )),
            (Some(b"bezier" | b"bspline"), other) => Some(format!("of degree {other}")),
            (Some(other), _) => Some(format!("of the cstype {}", quote(other))),
        }
    }
}

/// A statement `curv`, up to its `end`.
struct Element {
    line: u64,
    /// Its control points among the indices of the file.
    indices: Range<usize>,
    /// Reason why the element is not read, as text.
    unread: Option<String>,
    rational: bool,
    range: [f64; 2],
    knots: Vec<f64>,
}

impl Element {
    /// Returns true if the range of the curve leaves out no part of it. Some exporters write a
    /// wrong number of knots, which do not matter if the range covers all.
    fn is_whole(&self) -> bool {
        let covers = |knots: &[f64]| {
            let [from, to] = self.range;
            let [first, last] = [knots[0], knots[knots.len() - 1]];
            let tolerance = ROUNDED * (last - first);
            from <= first + tolerance && to >= last - tolerance
        };
        let n = self.indices.len();
        match self.knots.len() {
            0 => true,
            // A knot that is there twice breaks the curve.
            all if all == n + 2 => {
                let inside = &self.knots[1..=n];
                inside.is_sorted_by(|a, b| a < b) && covers(inside)
            }
            _ => covers(&self.knots),
        }
    }
}

/// Statements of a file.
#[derive(Default)]
struct Statements {
    vertices: Vec<Point>,
    /// Weights of vertices that are not 1, in the order of the vertices.
    weights: Vec<(u32, f64)>,
    indices: Vec<u32>,
    curves: Vec<Curve>,
    edges: Vec<Edge>,
    /// Largest index, and its line.
    furthest: (u32, u64),
    curve_type: CurveType,
    elements: Vec<Element>,
    /// True up to the end of the last element.
    in_element: bool,
    left_out: Vec<LeftOut>,
}

/// Reads a file to its end.
pub(super) fn read(input: Input<'_>) -> Result<Source<'static>> {
    let (curves, left_out) = curves_in(input)?;
    let mut frame = ModelFrame::new(0, Ok(curves));
    frame.info.left_out = left_out;
    Ok(Box::new(Some(frame)))
}

/// Reads the curves of a file, and what is left out.
fn curves_in(input: Input<'_>) -> Result<(CurveSet, Vec<LeftOut>)> {
    let mut lines = Lines::new(FORMAT, input)?.with_long_lines();
    let mut found = Statements::default();
    while let Some(line) = next_statement(&mut lines)? {
        let tokens: Vec<&[u8]> = words(&lines.line).collect();
        let read = found.statement(&tokens, line);
        read.map_err(|what| bad(line, what))?;
    }
    let (index, line) = found.furthest;
    if index as usize >= found.vertices.len() && line > 0 {
        let (vertex, all) = (u64::from(index) + 1, found.vertices.len());
        let what = format!("vertex {vertex}, but the file has {all}");
        return Err(bad(line, what));
    }
    found.finish_elements();
    let left_out = std::mem::take(&mut found.left_out);
    if found.edges.is_empty() && found.curves.is_empty() {
        let what = match left_out.is_empty() {
            true => "no curves: the file has no statement l or curv".into(),
            false => format!("no curves; {}", LeftOut::sentence(&left_out)),
        };
        return Err(Error::format(FORMAT, "whole file", what));
    }
    Ok((found.build()?, left_out))
}

fn bad(line: u64, what: impl std::fmt::Display) -> Error {
    Error::format(FORMAT, format_args!("line {line}"), what)
}

fn numbers(tokens: &[&[u8]]) -> Result<Vec<f64>, String> {
    tokens.iter().map(|token| number(token)).collect()
}

/// Steps to the next statement: its comment is removed, and lines that continue it are joined.
/// Returns its first line, from 1, or `None` at the end.
fn next_statement(lines: &mut Lines<'_>) -> Result<Option<u64>> {
    if !lines.advance()? {
        return Ok(None);
    }
    let (first, mut start) = (lines.number, 0);
    loop {
        let statement = &mut lines.line;
        let new = &statement[start..];
        // A comment ends with its line even after a backslash, because it may end with a Windows
        // path.
        if let Some(comment) = new.iter().position(|&b| b == b'#') {
            statement.truncate(start + comment);
            return Ok(Some(first));
        }
        let end = start + new.trim_ascii_end().len();
        if end == start || statement[end - 1] != b'\\' {
            return Ok(Some(first));
        }
        statement.truncate(end - 1);
        statement.push(b' ');
        start = end;
        lines.append()?;
    }
}

impl Statements {
    fn statement(&mut self, tokens: &[&[u8]], line: u64) -> Result<(), String> {
        let &[name, ref tokens @ ..] = tokens else {
            return Ok(());
        };
        self.in_element &= !matches!(name, b"surf" | b"curv2" | b"end");
        let place = || format!("line {line}: {}", quote(name));
        match name {
            b"v" => self.vertex(tokens)?,
            b"l" => self.line(tokens, line)?,
            b"curv" => self.element(tokens, line)?,
            b"cstype" => self.curve_type.set_type(tokens),
            b"deg" => {
                let degree = tokens.first().map(|word| integer(word, "a degree"));
                self.curve_type.degree = degree.and_then(Result::ok).unwrap_or(0);
            }
            b"parm" if self.in_element && tokens.first() == Some(&b"u".as_slice()) => {
                let element = self.elements.last_mut().expect("an element was begun");
                element.knots = numbers(&tokens[1..])?;
            }
            b"parm" | b"end" => {}
            b"curv2" => {
                let kind = ["curve on a surface (curv2)", "curves on surfaces (curv2)"];
                LeftOut::add(&mut self.left_out, kind, place);
            }
            b"cdc" => LeftOut::add(&mut self.left_out, FREE_FORM, place),
            name if std::str::from_utf8(name).is_ok_and(|name| is_in(IGNORED, name)) => {}
            _ => {
                let kind = ["unknown statement", "unknown statements"];
                LeftOut::add(&mut self.left_out, kind, place);
            }
        }
        Ok(())
    }

    fn vertex(&mut self, tokens: &[&[u8]]) -> Result<(), String> {
        let numbers = numbers(tokens)?;
        let [x, y, z, ref more @ ..] = numbers[..] else {
            let n = numbers.len();
            return Err(format!("a vertex with {n} coordinates, expected x y z"));
        };
        // More numbers than a weight are a colour.
        if let &[weight] = more
            && weight != 1.0
        {
            self.weights.push((self.vertices.len() as u32, weight));
        }
        self.vertices.push([x, y, z]);
        Ok(())
    }

    fn line(&mut self, tokens: &[&[u8]], line: u64) -> Result<(), String> {
        let start = self.read_indices(tokens, line)?;
        match self.indices[start..] {
            [] | [_] => return Err("a line with fewer than two vertices".into()),
            [a, b] if a == b => {
                return Err(format!("a line from vertex {} to itself", u64::from(a) + 1));
            }
            [a, b] => {
                self.indices.truncate(start);
                let at = |k: usize| self.indices[k];
                let is_closed_by_it = |last: &&mut Curve| {
                    let Range { start, end } = last.indices;
                    !last.closed && [at(end - 1), at(start)] == [a, b]
                };
                match self.curves.last_mut().filter(is_closed_by_it) {
                    Some(last) => last.closed = true,
                    None => self.edges.push(Edge { ends: [a, b], line }),
                }
            }
            [a, .., b] => {
                if a == b {
                    self.indices.pop();
                }
                self.curves.push(Curve {
                    indices: start..self.indices.len(),
                    closed: a == b,
                    line,
                });
            }
        }
        Ok(())
    }

    /// Appends the indices of a statement. Returns the place of the first one.
    fn read_indices(&mut self, tokens: &[&[u8]], line: u64) -> Result<usize, String> {
        let start = self.indices.len();
        for token in tokens {
            let index = self.index(token)?;
            if index >= self.furthest.0 {
                self.furthest = (index, line);
            }
            self.indices.push(index);
        }
        Ok(start)
    }

    /// Reads `curv u0 u1 v1 v2 ..`.
    fn element(&mut self, tokens: &[&[u8]], line: u64) -> Result<(), String> {
        let &[from, to, ref indices @ ..] = tokens else {
            return Err("a curv without a range".into());
        };
        let range = [number(from)?, number(to)?];
        let start = self.read_indices(indices, line)?;
        let indices = start..self.indices.len();
        if indices.len() < 2 {
            return Err("a curv with fewer than two vertices".into());
        }
        self.elements.push(Element {
            line,
            indices,
            unread: self.curve_type.unread(),
            rational: self.curve_type.rational,
            range,
            knots: Vec::new(),
        });
        self.in_element = true;
        Ok(())
    }

    /// Turns free-form curves into polylines, or counts them as left out.
    fn finish_elements(&mut self) {
        let is_positive = |vertex: u32| match self.weights.binary_search_by_key(&vertex, |w| w.0) {
            Ok(k) => self.weights[k].1 > 0.0,
            Err(_) => true,
        };
        for element in std::mem::take(&mut self.elements) {
            let (line, mut indices) = (element.line, element.indices.clone());
            let control = &self.indices[indices.clone()];
            let unread = match &element.unread {
                Some(why) => Some(&why[..]),
                None if !element.is_whole() => Some("cut by its range or broken by its knots"),
                None if !element.rational || control.iter().all(|&v| is_positive(v)) => None,
                None => Some("rational, with weights that are not positive"),
            };
            if let Some(why) = unread {
                LeftOut::add(&mut self.left_out, FREE_FORM, || {
                    format!("curv in line {line}, {why}")
                });
                continue;
            }
            let closed = control.len() > 2 && control.first() == control.last();
            indices.end -= usize::from(closed);
            self.curves.push(Curve {
                indices,
                closed,
                line,
            });
        }
    }

    /// Returns the index, from 0, of `7`, `-1` or `7/3`.
    fn index(&self, token: &[u8]) -> Result<u32, String> {
        let digits = token.split(|&b| b == b'/').next().unwrap_or_default();
        let given: i64 = std::str::from_utf8(digits)
            .ok()
            .and_then(|t| t.parse().ok())
            .ok_or_else(|| format!("{}, expected the number of a vertex", quote(token)))?;
        let from_zero = match given {
            0 => return Err("vertex 0; vertices are numbered from 1".into()),
            1.. => given - 1,
            _ => given.saturating_add(self.vertices.len() as i64),
        };
        u32::try_from(from_zero).map_err(|_| {
            let n = self.vertices.len();
            format!("vertex {given}, but there are {n} vertices before this line")
        })
    }

    fn build(mut self) -> Result<CurveSet> {
        let chains = Chains::new(&self.edges, self.vertices.len()).map_err(|third| {
            let ThirdEdge { vertex, lines } = third;
            let what = format!(
                "a third line at vertex {}, where the lines {} and {} already meet: \
                 the continuation of the curve is ambiguous",
                u64::from(vertex) + 1,
                lines[0],
                lines[1]
            );
            bad(lines[2], what)
        })?;
        let points = self.indices.len() + self.edges.len();
        let mut builder = CurveSet::builder(Basis::Polyline, Precision::F64, points);
        for chain in chains.curves() {
            let start = self.indices.len();
            self.indices.extend(chain.vertices);
            self.curves.push(Curve {
                indices: start..self.indices.len(),
                closed: chain.closed,
                line: self.edges[chain.first].line,
            });
        }
        self.curves.sort_by_key(|curve| curve.line);
        for curve in self.curves {
            let indices = &self.indices[curve.indices];
            builder.start_curve(indices.len(), curve.closed)?;
            let points: Vec<Point> = indices.iter().map(|&v| self.vertices[v as usize]).collect();
            builder.push(Positions::F64(points.as_flattened()))?;
        }
        builder.finish()
    }
}

/// Writes polylines: all vertices, then one `l` statement a curve, in which a closed curve ends at
/// its first vertex. No two curves share a vertex.
///
/// # Errors
///
/// Splines, and a closed curve of one point.
pub(super) fn write(path: &Path, set: &CurveSet) -> Result<()> {
    check_polylines(FORMAT, set)?;
    if let Some(i) = set.curves().iter().position(|c| c.points < 2) {
        let what = format!("curve {i}, a closed curve of one point");
        return Err(Error::unsupported(FORMAT, what));
    }
    create(path, |out| {
        for [x, y, z] in (0..set.len()).flat_map(|i| set.points_in(i)) {
            writeln!(out, "v {x:?} {y:?} {z:?}")?;
        }
        let mut first = 1;
        for curve in set.curves() {
            write!(out, "l")?;
            for vertex in first..first + u64::from(curve.points) {
                write!(out, " {vertex}")?;
            }
            match curve.closed {
                true => writeln!(out, " {first}")?,
                false => writeln!(out)?,
            }
            first += u64::from(curve.points);
        }
        Ok(())
    })
}
