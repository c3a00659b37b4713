//! Routes of the virtual connections of an end. Each runs within a layer, past the stubs of the
//! other curves.
//!
//! In the plane orthogonal to the stubs, each stub is a point. The connection from point `m` to the
//! next one is a straight line, or goes around in a U. It stays away from all other points, so that
//! it may be in any layer. Connections of the same layer stay away from one another, unless they
//! are consecutive: their loops share a curve and are never compared.
//!
//! Cost: at most cubic in the number of curves, once.

use nalgebra::SVector;

type Point2 = SVector<f64, 2>;

/// Route of one connection.
#[derive(Clone, Debug, PartialEq)]
pub struct Route {
    /// Number of the layer, from 0.
    pub layer: usize,
    /// Vertices in the plane, the points at both ends included.
    pub path: Vec<Point2>,
}

/// Distance that a route keeps, relative to the smallest distance of two points. It is larger than
/// the distance by which an end point may be off its place, which bends its stub.
const CLEARANCE: f64 = 0.25;

/// Offsets of a U from the straight line, relative to the smallest distance of two points.
const OFFSETS: [f64; 10] = [0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0];

/// Returns the smallest distance of two points.
pub fn smallest_distance<const D: usize>(points: &[SVector<f64, D>]) -> f64 {
    let before = |k: usize| points[..k].iter().map(move |q| (points[k] - q).norm());
    let distances = (0..points.len()).flat_map(before);
    distances.fold(f64::INFINITY, f64::min)
}

/// Returns the routes from each point to the next one, and from the last to the first. Returns
/// `None` if no route was found for one of them.
pub fn find(points: &[Point2]) -> Option<Vec<Route>> {
    let gap = smallest_distance(points);
    let mut routes = Vec::with_capacity(points.len());
    for m in 0..points.len() {
        routes.push(one(points, gap, &routes, m)?);
    }
    Some(routes)
}

/// Returns the route from point `m`. The routes from earlier points must be known.
fn one(points: &[Point2], gap: f64, routes: &[Route], m: usize) -> Option<Route> {
    let clearance = CLEARANCE * gap;
    let n = points.len();
    let (a, b) = (points[m], points[(m + 1) % n]);
    let chord = b - a;
    let normal = Point2::new(-chord.y, chord.x).try_normalize(0.0)?;
    let offsets = OFFSETS.iter().flat_map(|offset| [*offset, -offset]);
    let bent = offsets.map(|offset| {
        let aside = normal * (offset * gap);
        vec![a, a + aside, b + aside, b]
    });
    let mut paths = std::iter::once(vec![a, b]).chain(bent);
    let path = paths.find(|path| {
        let mut others = (0..n).filter(|&k| k != m && k != (m + 1) % n);
        others.all(|k| distance_to(path, &points[k]) >= clearance)
    })?;
    let free = |layer: &usize| {
        let same = routes.iter().enumerate().filter(|(_, r)| r.layer == *layer);
        let mut compared = same.filter(|(k, _)| (k + 1) % n != m && (m + 1) % n != *k);
        compared.all(|(_, other)| distance(&path, &other.path) >= clearance)
    };
    // A layer without a route is free.
    let layer = (0..=routes.len()).find(free)?;
    Some(Route { layer, path })
}

/// Returns the distance from a path to a point.
fn distance_to(path: &[Point2], p: &Point2) -> f64 {
    let edges = path.windows(2).map(|e| to_edge([e[0], e[1]], p));
    edges.fold(f64::INFINITY, f64::min)
}

fn to_edge([a, b]: [Point2; 2], p: &Point2) -> f64 {
    let d = b - a;
    let t = (d.dot(&(p - a)) / d.norm_squared()).clamp(0.0, 1.0);
    (a + d * t - p).norm()
}

/// Returns the distance of two paths: 0 if they cross.
fn distance(path: &[Point2], other: &[Point2]) -> f64 {
    for e in path.windows(2) {
        for f in other.windows(2) {
            if cross([e[0], e[1]], [f[0], f[1]]) {
                return 0.0;
            }
        }
    }
    // Paths that do not cross are closest at a vertex of one of them.
    let own = path.iter().map(|p| distance_to(other, p));
    let others = other.iter().map(|p| distance_to(path, p));
    own.chain(others).fold(f64::INFINITY, f64::min)
}

fn cross([a, b]: [Point2; 2], [c, d]: [Point2; 2]) -> bool {
    let side = |p: Point2, q: Point2, r: Point2| (q - p).perp(&(r - p));
    side(a, b, c) * side(a, b, d) < 0.0 && side(c, d, a) * side(c, d, b) < 0.0
}
