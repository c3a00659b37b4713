//! All pairs of edges (section 1, Algorithm 1): the oracle of the octree.

use crate::curve::Image;
use crate::error::Result;
use crate::measure::thickness::edges::{Edges, Found};

/// Returns the shortest strut.
///
/// # Errors
///
/// The errors of [`Edges::check_images`].
pub fn shortest(edges: &Edges) -> Result<Option<Found>> {
    let mut best: Option<Found> = None;
    let mut compare = |(i, j, image), longest_sq: f64| {
        let limit = best.map_or(longest_sq, |b| b.distance_sq.min(longest_sq));
        let found = edges.strut_between(i, j, image, limit);
        let shorter = |found: &Found| best.is_none_or(|best| found.order(&best).is_lt());
        best = found.filter(shorter).or(best);
        best
    };
    let home = pairs(edges).fold(None, |_, pair| compare(pair, f64::INFINITY));
    let limit_sq = home.map_or(f64::INFINITY, |found| found.distance_sq);
    let limit_sq = limit_sq.min(edges.bound_sq());
    edges.check_images(limit_sq)?;
    Ok(image_pairs(edges, limit_sq).fold(home, |_, pair| compare(pair, limit_sq)))
}

/// Returns all struts up to a length.
///
/// # Errors
///
/// The errors of [`Edges::check_images`].
pub fn up_to(edges: &Edges, longest: f64) -> Result<Vec<Found>> {
    let limit_sq = edges.scaled(longest).powi(2);
    edges.check_images(limit_sq)?;
    let all = pairs(edges).chain(image_pairs(edges, limit_sq));
    let found = all.filter_map(|(i, j, image)| edges.strut_between(i, j, image, limit_sq));
    Ok(found.collect())
}

fn pairs(edges: &Edges) -> impl Iterator<Item = (u32, u32, Image)> {
    let n = edges.len() as u32;
    (0..n).flat_map(move |i| (i + 1..n).map(move |j| (i, j, Image::default())))
}

/// Returns all pairs of an edge and an image that may be within a distance.
fn image_pairs(edges: &Edges, distance_sq: f64) -> impl Iterator<Item = (u32, u32, Image)> {
    let n = edges.len() as u32;
    (0..n).flat_map(move |i| {
        let images = edges.images(i, distance_sq);
        images.flat_map(move |image| (0..n).map(move |j| (i, j, image)))
    })
}
