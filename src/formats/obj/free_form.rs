//! Free-form curves: `cstype`, `deg`, `curv`, `parm u` and `end`.
//!
//! Read are the types `bspline` and `bezier` of degree 1 to 3. A Bezier curve is the B-spline whose
//! knots have the multiplicity of its degree, so there is one kind of spline. Its cubic pieces
//! follow from the polar form (blossom) of the spline: the control points of the piece between the
//! parameters `a` and `b` are its values at `aaa`, `aab`, `abb` and `bbb`. They are exact if all
//! knots of a piece are its ends, and otherwise rounded by some units in the last place. Source:
//! L. Ramshaw, *Blossoms are polar forms*, Computer Aided Geometric Design 6 (1989).
//!
//! Some exporters write a wrong number of knots. If the range of the curve covers all, they do not
//! matter for a polyline, and equidistant ones mean a uniform spline.
//!
//! Other curves are left out: other types, other degrees, and rational ones whose weights differ.
//! (A rational curve of degree 1 is its polyline.)

use crate::curve::Point;
use crate::formats::{number, quote};
use std::ops::Range;

/// Deviation of decimal knots from equidistant ones, in units of their range, that is taken as
/// rounding.
const ROUNDED: f64 = 1e-5;

/// Type of the curves that follow.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Type {
    Bezier,
    BSpline,
    /// Its name, or what is missing.
    Other(String),
}

/// Values of `cstype` and `deg`, which hold until they are set again.
#[derive(Clone, Debug)]
pub(super) struct State {
    kind: Type,
    rational: bool,
    degree: u32,
}

impl Default for State {
    fn default() -> State {
        State {
            kind: Type::Other("without cstype".into()),
            rational: false,
            degree: 0,
        }
    }
}

impl State {
    /// Reads `cstype rat type`.
    pub fn set_type<'a>(&mut self, tokens: impl Iterator<Item = &'a [u8]>) {
        let mut tokens = tokens.peekable();
        self.rational = tokens.next_if_eq(&b"rat".as_slice()).is_some();
        self.kind = match tokens.next() {
            Some(b"bezier") => Type::Bezier,
            Some(b"bspline") => Type::BSpline,
            other => Type::Other(format!(
                "of the cstype {}",
                quote(other.unwrap_or_default())
            )),
        };
    }

    /// Reads `deg u v`. A degree that is not a number is none that is read.
    pub fn set_degree<'a>(&mut self, mut tokens: impl Iterator<Item = &'a [u8]>) {
        let degree = tokens.next().and_then(|t| std::str::from_utf8(t).ok());
        self.degree = degree.and_then(|t| t.parse().ok()).unwrap_or(0);
    }
}

/// A statement `curv`, up to its `end`.
#[derive(Debug)]
pub(super) struct Element {
    pub line: u64,
    /// Its control points among the indices of the file.
    pub indices: Range<usize>,
    state: State,
    range: [f64; 2],
    knots: Vec<f64>,
}

/// Curve of an element.
#[derive(Debug)]
pub(super) enum Form {
    /// The polyline of the control points.
    Polyline,
    Spline(Spline),
}

/// A B-spline of degree 1 to 3.
#[derive(Debug)]
pub(super) struct Spline {
    degree: usize,
    knots: Vec<f64>,
    range: [f64; 2],
    /// True if it is a uniform cubic B-spline, as [`crate::curve::Basis::BSpline`] is.
    pub uniform: bool,
}

impl Element {
    /// Creates the element of `curv u0 u1`, whose control points are read next, from `start` on.
    pub fn new(line: u64, state: &State, range: [f64; 2], indices: Range<usize>) -> Element {
        Element {
            line,
            indices,
            state: state.clone(),
            range,
            knots: Vec::new(),
        }
    }

    /// Reads `parm u ..`.
    pub fn parameters<'a>(
        &mut self,
        mut tokens: impl Iterator<Item = &'a [u8]>,
    ) -> Result<(), String> {
        if tokens.next() == Some(b"u") {
            for token in tokens {
                self.knots.push(number(token)?);
            }
        }
        Ok(())
    }

    /// Returns the curve, and true if it is closed. `indices` are those of its control points, of
    /// which repeated ones are removed if it is closed. `weights` has those of the control points
    /// that are not 1. The error is the reason, in words, why the curve is left out.
    pub fn finish(
        self,
        indices: &mut Vec<u32>,
        weight: impl Fn(u32) -> f64,
    ) -> Result<(Form, bool), String> {
        let (n, State { kind, rational, .. }) = (indices.len(), &self.state);
        let degree = match self.state.degree {
            degree @ 1..=3 => degree as usize,
            other => return Err(format!("of degree {other}")),
        };
        if let Type::Other(what) = kind {
            return Err(what.clone());
        }
        if *rational {
            let first = weight(indices[0]);
            let differ = indices.iter().any(|&v| weight(v) != first);
            let positive = indices.iter().all(|&v| weight(v) > 0.0);
            if !positive || (differ && degree > 1) {
                return Err("rational, with weights that differ".into());
            }
        }
        let (mut knots, mut given) = match kind {
            Type::Bezier => (bezier_knots(n, degree, self.knots)?, self.range),
            _ => (self.knots, self.range),
        };
        let expected = n + degree + 1;
        if knots.len() != expected && knots.len() > 2 && covers(given, &knots) {
            if degree == 1 {
                return Ok((Form::Polyline, drop_last(indices)));
            }
            if equidistant(&knots) && knots[0] < knots[1] {
                knots = (0..expected).map(|k| k as f64).collect();
                given = [0.0, (expected - 1) as f64];
            }
        }
        // The knots of a polyline matter only if it is cut.
        if degree == 1 && knots.is_empty() {
            return Ok((Form::Polyline, drop_last(indices)));
        }
        check_knots(&knots, n, degree)?;
        let domain = [knots[degree], knots[n]];
        let [from, to] = given;
        let whole = covers(given, &knots[degree..=n]);
        let range = [from.max(domain[0]), to.min(domain[1])];
        let is_valid = range[0] < range[1];
        if !is_valid {
            return Err(format!("with the range {from} to {to}"));
        }
        if degree == 1 && whole {
            return Ok((Form::Polyline, drop_last(indices)));
        }
        // The first and the last knot have no influence on a spline.
        let uniform = degree == 3 && whole && equidistant(&knots[1..knots.len() - 1]);
        let clamped = knots[1] == knots[degree] && knots[n] == knots[n + degree - 1];
        let closed = if uniform {
            let wraps = n >= 6 && indices[..3] == indices[n - 3..];
            if wraps {
                indices.truncate(n - 3);
            }
            wraps
        } else {
            // The first and the last point of the curve are control points.
            whole && clamped && n > 3 && indices[0] == indices[n - 1]
        };
        let range = if whole { domain } else { range };
        let spline = Spline {
            degree,
            knots,
            range,
            uniform,
        };
        Ok((Form::Spline(spline), closed))
    }
}

/// Removes the last control point of a polyline that ends at its first one. Returns true if it
/// does.
fn drop_last(indices: &mut Vec<u32>) -> bool {
    let closed = indices.len() > 2 && indices.first() == indices.last();
    if closed {
        indices.pop();
    }
    closed
}

/// Returns the knots of a Bezier curve with `n` control points, whose pieces begin and end at the
/// parameters `ends`, or at 0, 1, .. if there are none.
fn bezier_knots(n: usize, degree: usize, ends: Vec<f64>) -> Result<Vec<f64>, String> {
    if n <= degree || !(n - 1).is_multiple_of(degree) {
        return Err(format!(
            "with {n} points, of Bezier pieces of degree {degree}"
        ));
    }
    let pieces = (n - 1) / degree;
    let ends = match ends.len() {
        0 => (0..=pieces).map(|k| k as f64).collect(),
        _ => ends,
    };
    if ends.len() != pieces + 1 {
        let found = ends.len();
        return Err(format!(
            "with {found} parameters for {pieces} Bezier pieces"
        ));
    }
    let mut knots = vec![ends[0]];
    for &end in &ends {
        knots.extend(std::iter::repeat_n(end, degree));
    }
    knots.push(ends[pieces]);
    Ok(knots)
}

/// Fails if the knots are not those of a connected spline with `n` control points.
fn check_knots(knots: &[f64], n: usize, degree: usize) -> Result<(), String> {
    let expected = n + degree + 1;
    if n <= degree {
        return Err(format!("with {n} points, too few for degree {degree}"));
    }
    if knots.len() != expected {
        let found = knots.len();
        return Err(format!("with {found} knots (parm u), expected {expected}"));
    }
    if let Some(pair) = knots.windows(2).find(|pair| pair[0] > pair[1]) {
        return Err(format!("with the knot {} after {}", pair[1], pair[0]));
    }
    // Between the ends, a knot of a higher multiplicity than the degree breaks the curve.
    let inside = &knots[1..expected - 1];
    match inside.windows(degree + 1).find(|w| w[0] == w[degree]) {
        Some(same) => Err(format!("with {} knots at {}", degree + 1, same[0])),
        None => Ok(()),
    }
}

/// Returns true if a range contains all knots, up to the rounding of their decimals.
fn covers([from, to]: [f64; 2], knots: &[f64]) -> bool {
    let [first, last] = [knots[0], knots[knots.len() - 1]];
    let tolerance = ROUNDED * (last - first);
    from <= first + tolerance && to >= last - tolerance
}

/// Returns true if knots are equidistant, up to the rounding of their decimals.
fn equidistant(knots: &[f64]) -> bool {
    let (first, steps) = (knots[0], (knots.len() - 1) as f64);
    let range = knots[knots.len() - 1] - first;
    let (step, tolerance) = (range / steps, ROUNDED * range);
    let near = |(k, t): (usize, &f64)| (t - (first + step * k as f64)).abs() <= tolerance;
    tolerance < step / 4.0 && knots.iter().enumerate().all(near)
}

impl Spline {
    /// Writes the cubic Bezier pieces of the spline with these control points: three points each,
    /// and the last point unless the curve is closed.
    pub fn pieces(&self, points: &[Point], closed: bool, out: &mut Vec<Point>) {
        let mut end = points[0];
        for span in self.degree..points.len() {
            let from = self.knots[span].max(self.range[0]);
            let to = self.knots[span + 1].min(self.range[1]);
            if from >= to {
                continue;
            }
            // Values of the polar form of the degree: the control points of the piece.
            let value = |ends: usize| self.blossom(points, span, [from, to], ends);
            let mix = |p: Point, q: Point| [0, 1, 2].map(|x| (p[x] + 2.0 * q[x]) / 3.0);
            let (first, last) = (value(0), value(self.degree));
            let inner = match self.degree {
                1 => [first, last],
                2 => [mix(first, value(1)), mix(last, value(1))],
                _ => [value(1), value(2)],
            };
            out.extend([first, inner[0], inner[1]]);
            end = last;
        }
        if !closed {
            out.push(end);
        }
    }

    /// Evaluates the polar form of the piece of a knot span (de Boor's algorithm). Its arguments
    /// are the second one of `[from, to]`, `seconds` times, and the first one.
    fn blossom(
        &self,
        points: &[Point],
        span: usize,
        [from, to]: [f64; 2],
        seconds: usize,
    ) -> Point {
        let (d, t) = (self.degree, &self.knots);
        let mut values = [[0.0; 3]; 4];
        values[..=d].copy_from_slice(&points[span - d..=span]);
        for round in 1..=d {
            let u = if round <= seconds { to } else { from };
            for k in (round..=d).rev() {
                let j = span - d + k;
                let share = (u - t[j]) / (t[j + d + 1 - round] - t[j]);
                let (p, q) = (values[k - 1], values[k]);
                values[k] = [0, 1, 2].map(|x| (1.0 - share) * p[x] + share * q[x]);
            }
        }
        values[d]
    }
}

#[cfg(test)]
mod tests {
    use super::super::curves_in;
    use crate::curve::{Basis, CurveSet, Point};
    use crate::engine::Certifier;
    use crate::formats::tests::curves;

    /// Returns the text of vertices, with their weights.
    fn vertices(points: &[Point], weight: f64) -> String {
        let line = |[x, y, z]: &Point| format!("v {x:?} {y:?} {z:?} {weight}\n");
        points.iter().map(line).collect()
    }

    /// Returns `n` points without a symmetry.
    fn points(n: usize) -> Vec<Point> {
        let at = |k: usize| [k as f64, (k * k % 7) as f64, (k * 5 % 3) as f64 - 0.25];
        (0..n).map(at).collect()
    }

    fn parse(text: &str) -> CurveSet {
        let (set, left_out) = curves_in(text.as_bytes().into()).unwrap();
        assert_eq!(left_out, []);
        set
    }

    /// Evaluates a B-spline by the recursion of Cox and de Boor.
    fn bspline(points: &[Point], knots: &[f64], degree: usize, t: f64) -> Point {
        fn weight(knots: &[f64], i: usize, d: usize, t: f64) -> f64 {
            if d == 0 {
                return f64::from(knots[i] <= t && t < knots[i + 1]);
            }
            let share = |a: f64, b: f64, w: f64| if w == 0.0 { 0.0 } else { a / b * w };
            share(
                t - knots[i],
                knots[i + d] - knots[i],
                weight(knots, i, d - 1, t),
            ) + share(
                knots[i + d + 1] - t,
                knots[i + d + 1] - knots[i + 1],
                weight(knots, i + 1, d - 1, t),
            )
        }
        let mut sum = [0.0; 3];
        for (i, p) in points.iter().enumerate() {
            let w = weight(knots, i, degree, t);
            (0..3).for_each(|x| sum[x] += w * p[x]);
        }
        sum
    }

    #[test]
    fn a_curv_of_degree_one_is_the_polyline_of_its_vertices() {
        let text = vertices(&points(4), 1.0);
        let open = vec![(false, points(4))];
        let closed = vec![(true, points(4))];
        for (statements, expected) in [
            (
                "cstype bspline\ndeg 1\ncurv 0 1 1 2 3 4\nparm u 0 0 .3 .7 1 1\nend",
                &open,
            ),
            (
                "cstype bspline\ndeg 1\ncurv 0 9 -4 -3 \\\n -2 -1 -4\nparm u 0 1 2 \\\n3 4 5 6",
                &closed,
            ),
            // Exporters that write no knots, and no end.
            ("deg 1\ncstype bspline\ncurv 0 1 1 2 3 4 1\n", &closed),
            // As Blender and others write it: with a knot too many.
            (
                "cstype bspline\ndeg 1\ncurv 0 1 1 2 3 4 1\n\
                 parm u 0 .125 .25 .375 .5 .625 .75 .875",
                &closed,
            ),
            (
                "cstype bspline\ndeg 1\ncurv 0 1 1 2 3 4\nparm u 0 0 .5 1 1",
                &open,
            ),
            ("cstype bezier\ndeg 1 1\ncurv 0 3 1 2 3 4\nend", &open),
            ("cstype rat bspline\ndeg 1\ncurv 0 1 1 2 3 4 1", &closed),
        ] {
            let set = parse(&format!("{text}{statements}"));
            assert_eq!(set.basis(), Basis::Polyline);
            assert_eq!(&curves(&set), expected, "{statements}");
        }
    }

    #[test]
    fn uniform_cubic_splines_keep_their_control_points() {
        let text = vertices(&points(6), 2.0) + "cstype rat bspline\ndeg 3\n";
        let open = "curv 3 6 1 2 3 4 5 6\nparm u 0 1 2 3 4 5 6 7 8 9\nend\n";
        // As Blender writes a cyclic curve: the range is that of all knots, which are rounded.
        let knots: Vec<String> = (0..13)
            .map(|k| format!("{:.5}", f64::from(k) / 12.0))
            .collect();
        let wrong = open.replace(" 8 9", " 8").replace("3 6", "0 8");
        let set = parse(&format!("{text}{wrong}"));
        assert_eq!(curves(&set), [(false, points(6))]);
        let closed = format!(
            "curv 0.0 1.0 1 2 3 4 5 6 1 2 3\nparm u {}\nend\n",
            knots.join(" ")
        );
        let set = parse(&format!("{text}{open}{closed}"));
        assert_eq!(set.basis(), Basis::BSpline);
        assert_eq!(curves(&set), [(false, points(6)), (true, points(6))]);
    }

    #[test]
    fn splines_become_bezier_pieces_with_the_same_points() {
        for (degree, knots, range) in [
            (3, "0 0 0 0 1 1 1 1", [0.0, 1.0]),
            (3, "0 0 0 0 .2 .3 .3 .9 1 1 1 1", [0.0, 1.0]),
            (3, "0 1 2 3 4 5 6 7 8", [3.5, 4.75]),
            (3, "-2 -1 0 .5 .7 .7 .7 2 2.5 7 7", [0.5, 2.0]),
            (2, "0 0 0 1 2 2 3 3 3", [0.0, 3.0]),
            (2, "0 1 3 4 9 10 11", [2.0, 6.0]),
            (1, "0 0 1 5 5", [0.25, 3.0]),
        ] {
            let numbers: Vec<f64> = knots.split(' ').map(|k| k.parse().unwrap()).collect();
            let n = numbers.len() - degree - 1;
            let indices: Vec<String> = (1..=n).map(|k| k.to_string()).collect();
            let [from, to] = range;
            let set = parse(&format!(
                "{}cstype bspline\ndeg {degree}\ncurv {from} {to} {}\nparm u {knots}\nend\n",
                vertices(&points(n), 1.0),
                indices.join(" ")
            ));
            assert_eq!(set.basis(), Basis::Bezier);
            let mut ends: Vec<f64> = numbers[degree..=n].to_vec();
            ends.iter_mut().for_each(|t| *t = t.clamp(from, to));
            ends.dedup();
            assert_eq!(set.curve(0).segments as usize, ends.len() - 1, "{knots}");
            for (piece, span) in ends.windows(2).enumerate() {
                let b: Vec<Point> = (0..4).map(|k| set.point(0, 3 * piece + k)).collect();
                for s in [0.0, 0.3, 0.9_f64] {
                    let t = span[0] + s * (span[1] - span[0]);
                    let expected = bspline(&points(n), &numbers, degree, t);
                    let r = 1.0 - s;
                    for x in 0..3 {
                        let cubic = r * r * (r * b[0][x] + 3.0 * s * b[1][x])
                            + s * s * (3.0 * r * b[2][x] + s * b[3][x]);
                        // A curve of degree 1 has the same points at other parameters.
                        if degree > 1 {
                            assert!((cubic - expected[x]).abs() < 1e-13, "{knots}, {t}");
                        } else if s == 0.0 {
                            assert!((b[0][x] - expected[x]).abs() < 1e-13, "{knots}, {t}");
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn bezier_curves_are_read_bit_for_bit() {
        let points: Vec<Point> = points(7).iter().map(|p| p.map(|x| x / 3.0)).collect();
        let text = vertices(&points, 1.0) + "cstype bezier\ndeg 3\n";
        let set = parse(&format!(
            "{text}curv 0 2 1 2 3 4 5 6 7\nend\ncurv 1 3 1 2 3 4 5 6 1\nparm u 1 1.5 3\nend\n"
        ));
        assert_eq!(set.basis(), Basis::Bezier);
        let expected = [(false, points.clone()), (true, points[..6].to_vec())];
        assert_eq!(curves(&set), expected);
    }

    #[test]
    fn polylines_beside_splines_become_straight_pieces_with_the_same_links() {
        let square = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\n";
        let ring = "v 0 0 -1\nv 0 2 -1\nv 0 2 1\nv 0 0 1\n";
        let spline = "cstype bspline\ndeg 3\ncurv 0 1 5 6 7 8 5\nparm u 0 0 0 0 .5 1 1 1 1\nend\n";
        for line in ["l 1 2 3 4 1\n", "l 1 2\nl 2 3\nl 3 4\nl 4 1\n"] {
            let set = parse(&format!("{square}{ring}{line}{spline}"));
            assert_eq!((set.basis(), set.len()), (Basis::Bezier, 2));
            assert!(set.curves().iter().all(|curve| curve.closed));
            let [p, q] = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0]];
            assert_eq!([0, 1, 2, 3].map(|k| set.point(0, k)), [p, p, q, q]);
            let mut certifier = Certifier::default();
            let (certificate, _) = certifier.certify(&set);
            assert_eq!(certificate.links.len(), 1);
            assert_eq!(certificate.links[0].lambda.abs(), 1);
        }
    }

    #[test]
    fn curves_that_no_basis_represents_are_counted_with_the_first_line() {
        let text = vertices(&points(6), 1.0) + "v 0 0 0 2\nl 1 2 3 1\n";
        let cubic = "cstype bspline\ndeg 3\ncurv 0 1 1 2 3 4\n";
        for (statements, why) in [
            ("curv 0 1 1 2\nend", "line 9, of degree 0"),
            ("deg 1\ncurv 0 1 1 2\nend", "line 10, without cstype"),
            (
                "cstype bspline\ndeg 5\ncurv 0 1 1 2 3 4 5 6\nend",
                "line 11, of degree 5",
            ),
            (
                "cstype cardinal\ndeg 3\ncurv 0 1 1 2 3 4",
                "of the cstype 'cardinal'",
            ),
            (
                "cstype rat bspline\ndeg 2\ncurv 0 1 1 2 7",
                "rational, with weights that differ",
            ),
            (
                "cstype bezier\ndeg 3\ncurv 0 1 1 2 3 4 5",
                "5 points, of Bezier pieces",
            ),
            (
                "cstype bezier\ndeg 3\ncurv 0 1 1 2 3 4\nparm u 0 1 2",
                "3 parameters for 1",
            ),
            (cubic, "with 0 knots (parm u), expected 8"),
            (&format!("{cubic}parm u 0 0 0 0 1 1 1\n"), "with 7 knots"),
            (
                &format!("{cubic}parm u 0 0 0 0 2 1 1 1\n"),
                "with the knot 1 after 2",
            ),
            (
                &format!("{cubic}parm u 7 7 7 7 8 8 8 8\n"),
                "with the range 0 to 1",
            ),
            (
                "cstype bspline\ndeg 2\ncurv 0 1 1 2 3 4 5 6\nparm u 0 0 0 .5 .5 .5 1 1 1",
                "with 3 knots at 0.5",
            ),
        ] {
            let (set, left_out) =
                curves_in(format!("{text}{statements}\n").as_bytes().into()).unwrap();
            assert_eq!(set.len(), 1);
            let said = left_out[0].to_string();
            assert!(
                said.starts_with("1 free-form curve (curv in line"),
                "{said}"
            );
            assert!(
                left_out.len() == 1 && said.contains(why),
                "{said:?} lacks {why:?}"
            );
            // Without a curve that is read, the reason is in the error.
            let alone = text.replace("l 1 2 3 1", "f 1 2 3") + statements;
            let error = curves_in(alone.as_bytes().into()).unwrap_err().to_string();
            assert!(
                error.contains("no curves; not read, so not verified: 1 free"),
                "{error}"
            );
        }
    }

    #[test]
    fn other_elements_that_may_be_curves_are_counted_by_kind() {
        let text = vertices(&points(6), 1.0)
            + "polyline 1 2 3\nl 1 2 3 1\ncurv2 1 2\ncall other.obj\ncstype bspline\ndeg 3 3\n\
               surf 0 1 0 1 1 2 3 4\nparm u 0 1\ntrim 0 1 1\nend\ncdc 1 2 3 4\ncurv2 3 4\nsp 1\n";
        let (set, left_out) = curves_in(text.as_bytes().into()).unwrap();
        assert_eq!(set.len(), 1);
        let said: Vec<String> = left_out.iter().map(ToString::to_string).collect();
        let expected = [
            "2 unknown statements (the first one: line 7: 'polyline')",
            "2 curves on surfaces (curv2) (the first one: line 9: 'curv2')",
            "1 free-form curve (line 17: 'cdc')",
        ];
        assert_eq!(said, expected);
    }
}
