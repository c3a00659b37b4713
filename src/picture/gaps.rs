//! Crossings of projected strands: the lower one is interrupted, as in a knot diagram.
//!
//! Cost: the edges are sorted by their left end, and each is compared with those that overlap it
//! horizontally.

use crate::curve::Point;
use crate::curve::vector::per_axis;
use std::ops::Range;

/// A projected strand: to the right and down in pixels, and depth, which grows towards the viewer.
pub(super) struct Line {
    pub points: Vec<Point>,
    /// True if the end is joined to the start, which is then repeated.
    pub closed: bool,
    /// Width in pixels.
    pub width: f64,
}

/// Visible gap on each side of the upper line.
const MARGIN: f64 = 2.5;

/// Smallest sine of the angle of a crossing that lengthens its gap.
const FLATTEST: f64 = 0.4;

/// Depth difference, in pixels, below which neither line is above the other.
const SAME_DEPTH: f64 = 1e-6;

/// An edge of a line.
struct Edge {
    line: usize,
    at: usize,
    /// Bounds to the right and down.
    x: [f64; 2],
    y: [f64; 2],
}

/// Returns the visible pieces of each line.
pub(super) fn visible(lines: &[Line]) -> Vec<Vec<Vec<Point>>> {
    let mut edges: Vec<Edge> = Vec::new();
    for (line, l) in lines.iter().enumerate() {
        let ends = l.points.windows(2).enumerate();
        edges.extend(ends.map(|(at, e)| Edge {
            line,
            at,
            x: [e[0][0].min(e[1][0]), e[0][0].max(e[1][0])],
            y: [e[0][1].min(e[1][1]), e[0][1].max(e[1][1])],
        }));
    }
    edges.sort_by(|a, b| a.x[0].total_cmp(&b.x[0]));
    let lengths: Vec<Vec<f64>> = lines.iter().map(|l| lengths(&l.points)).collect();
    let mut gaps: Vec<Vec<Range<f64>>> = vec![Vec::new(); lines.len()];
    for (k, e) in edges.iter().enumerate() {
        for f in edges[k + 1..].iter().take_while(|f| f.x[0] <= e.x[1]) {
            if f.y[0] > e.y[1] || f.y[1] < e.y[0] {
                continue;
            }
            let end = |e: &Edge| [lines[e.line].points[e.at], lines[e.line].points[e.at + 1]];
            let Some((t, u, sine)) = crossing(end(e), end(f)) else {
                continue;
            };
            let depth = |[a, b]: [Point; 2], t: f64| a[2] + t * (b[2] - a[2]);
            let above = depth(end(e), t) - depth(end(f), u);
            if above.abs() < SAME_DEPTH {
                continue;
            }
            let (lower, at, upper) = if above > 0.0 { (f, u, e) } else { (e, t, f) };
            let along = &lengths[lower.line];
            let at = along[lower.at] + at * (along[lower.at + 1] - along[lower.at]);
            let half = (0.5 * lines[upper.line].width + MARGIN) / sine.max(FLATTEST);
            let (gaps, all) = (&mut gaps[lower.line], along[along.len() - 1]);
            gaps.push(at - half..at + half);
            if lines[lower.line].closed {
                // The gap may pass the start.
                gaps.push(at - half - all..at + half - all);
                gaps.push(at - half + all..at + half + all);
            }
        }
    }
    let lines = lines.iter().zip(&lengths).zip(gaps);
    let pieces = lines.map(|((line, lengths), gaps)| cut(line, lengths, gaps));
    pieces.collect()
}

/// Returns the length of a line up to each of its points.
fn lengths(points: &[Point]) -> Vec<f64> {
    let mut sum = 0.0;
    let mut out = vec![0.0];
    for e in points.windows(2) {
        sum += (e[1][0] - e[0][0]).hypot(e[1][1] - e[0][1]);
        out.push(sum);
    }
    out
}

/// Returns the parameters at which two edges cross, and the sine of their angle. `None` if they do
/// not cross, or share an end, as successive edges do.
fn crossing([a, b]: [Point; 2], [c, d]: [Point; 2]) -> Option<(f64, f64, f64)> {
    let same = |p: Point, q: Point| p[0] == q[0] && p[1] == q[1];
    if same(a, c) || same(a, d) || same(b, c) || same(b, d) {
        return None;
    }
    let (r, s) = ([b[0] - a[0], b[1] - a[1]], [d[0] - c[0], d[1] - c[1]]);
    let q = [c[0] - a[0], c[1] - a[1]];
    let area = r[0] * s[1] - r[1] * s[0];
    let t = (q[0] * s[1] - q[1] * s[0]) / area;
    let u = (q[0] * r[1] - q[1] * r[0]) / area;
    let inside = |t: f64| (0.0..=1.0).contains(&t);
    let sine = area.abs() / (r[0].hypot(r[1]) * s[0].hypot(s[1]));
    (inside(t) && inside(u)).then_some((t, u, sine))
}

/// Cuts the gaps out of a line.
fn cut(line: &Line, lengths: &[f64], mut gaps: Vec<Range<f64>>) -> Vec<Vec<Point>> {
    gaps.sort_by(|a, b| a.start.total_cmp(&b.start));
    let all = lengths[lengths.len() - 1];
    let mut pieces = Vec::new();
    let mut from = 0.0;
    for gap in gaps.into_iter().chain(std::iter::once(all..f64::INFINITY)) {
        if gap.start > from {
            pieces.push(piece(&line.points, lengths, from, gap.start.min(all)));
        }
        from = gap.end.max(from);
        if from >= all {
            break;
        }
    }
    // The ends of a closed line are joined, unless a gap is there.
    if line.closed && pieces.len() > 1 {
        let joined = pieces[0].first() == line.points.first()
            && pieces[pieces.len() - 1].last() == line.points.last();
        if joined && let Some(mut last) = pieces.pop() {
            last.extend_from_slice(&pieces[0][1..]);
            pieces[0] = last;
        }
    }
    pieces
}

/// Returns the part of a line between two lengths.
fn piece(points: &[Point], lengths: &[f64], from: f64, to: f64) -> Vec<Point> {
    let at = |length: f64| {
        let k = lengths.partition_point(|l| *l < length);
        let k = k.clamp(1, points.len() - 1);
        let t = (length - lengths[k - 1]) / (lengths[k] - lengths[k - 1]);
        match t {
            // The points themselves, so that the ends of closed lines are recognised.
            t if t <= 0.0 || t.is_nan() => points[k - 1],
            t if t >= 1.0 => points[k],
            t => per_axis(|x| points[k - 1][x] + t * (points[k][x] - points[k - 1][x])),
        }
    };
    let inner = points.iter().zip(lengths);
    let inner = inner.filter(|(_, l)| **l > from && **l < to);
    let mut out = vec![at(from)];
    out.extend(inner.map(|(p, _)| *p));
    out.push(at(to));
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(points: &[Point], closed: bool) -> Line {
        Line {
            points: points.to_vec(),
            closed,
            width: 4.0,
        }
    }

    fn length(pieces: &[Vec<Point>]) -> f64 {
        pieces.iter().map(|p| lengths(p)[p.len() - 1]).sum()
    }

    #[test]
    fn the_lower_line_of_a_crossing_is_interrupted() {
        for (z, upper) in [(1.0, 0), (-1.0, 1)] {
            let lines = [
                line(&[[-50.0, 0.0, z], [50.0, 0.0, z]], false),
                line(&[[0.0, -50.0, 0.0], [0.0, 50.0, 0.0]], false),
            ];
            let visible = visible(&lines);
            assert_eq!(visible[upper].len(), 1);
            assert_eq!(length(&visible[upper]), 100.0);
            let lower = &visible[1 - upper];
            assert_eq!(lower.len(), 2);
            assert!((length(lower) - (100.0 - 4.0 - 2.0 * MARGIN)).abs() < 1e-9);
        }
    }

    #[test]
    fn lines_that_touch_and_successive_edges_have_no_gap() {
        let touching = [
            line(&[[-50.0, 0.0, 0.0], [50.0, 0.0, 0.0]], false),
            line(&[[0.0, -50.0, 0.0], [0.0, 50.0, 0.0]], false),
        ];
        assert!(visible(&touching).iter().all(|pieces| pieces.len() == 1));
        let corner = [line(&[[0.0; 3], [9.0, 0.0, 5.0], [0.0, 1.0, 9.0]], false)];
        assert_eq!(visible(&corner)[0].len(), 1);
    }

    #[test]
    fn a_gap_at_the_start_of_a_closed_line_continues_at_its_end() {
        let square = [
            [0.0, 0.0, 0.0],
            [50.0, 0.0, 0.0],
            [50.0, 50.0, 0.0],
            [0.0, 50.0, 0.0],
            [0.0, 0.0, 0.0],
        ];
        let over = line(&[[1.0, -20.0, 9.0], [1.0, 20.0, 9.0]], false);
        let pieces = visible(&[line(&square, true), over]);
        assert_eq!(pieces[0].len(), 1);
        let gap = 4.0 + 2.0 * MARGIN;
        assert!((length(&pieces[0]) - (200.0 - gap)).abs() < 1e-9);
        // A gap elsewhere: one piece, joined at the start.
        let over = line(&[[25.0, -20.0, 9.0], [25.0, 20.0, 9.0]], false);
        let pieces = visible(&[line(&square, true), over]);
        assert_eq!(pieces[0].len(), 1);
        assert!(pieces[0][0].contains(&square[0]));
    }
}
