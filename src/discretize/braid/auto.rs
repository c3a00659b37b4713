//! Finds the braids of a frame: open curves whose ends are near one another.
//!
//! Cost: quadratic in the number of open curves, once.

use super::Braid;
use super::pose::principal_axes;
use crate::curve::CurveSet;
use crate::error::{Error, Result};
use nalgebra::Vector3;

/// Two curves belong together if both pairs of ends are closer than this share of the shorter
/// curve's end distance.
const NEAR: f64 = 0.25;

/// Groups the open curves of a frame into braids, each sorted along its left end.
///
/// # Errors
///
/// [`Error::Braid`] if there is no open curve, or a group has fewer than four.
pub fn find(set: &CurveSet) -> Result<Vec<Braid>> {
    let open = (0..set.len()).filter(|&i| !set.curve(i).closed);
    let ends = |i: usize| [0, set.curve(i).segments as usize].map(|s| set.knot(i, s).into());
    let curves: Vec<(u32, [Vector3<f64>; 2])> = open.map(|i| (i as u32, ends(i))).collect();
    if curves.is_empty() {
        let what = format!("no open curve among {}, so there are no braids", set.len());
        return Err(Error::Braid(what));
    }
    let length = |[p, q]: [Vector3<f64>; 2]| (q - p).norm();
    let mut group = vec![None; curves.len()];
    let mut braids = Vec::new();
    for first in 0..curves.len() {
        if group[first].is_some() {
            continue;
        }
        group[first] = Some(false);
        let (mut members, mut next) = (vec![first], 0);
        while let Some(&a) = members.get(next) {
            next += 1;
            let [p, q] = oriented(curves[a].1, group[a] == Some(true));
            for b in 0..curves.len() {
                if group[b].is_some() {
                    continue;
                }
                let limit = NEAR * length([p, q]).min(length(curves[b].1));
                let near = |flipped: &bool| {
                    let [r, s] = oriented(curves[b].1, *flipped);
                    (p - r).norm() < limit && (q - s).norm() < limit
                };
                if let Some(flipped) = [false, true].into_iter().find(near) {
                    group[b] = Some(flipped);
                    members.push(b);
                }
            }
        }
        let flipped = |k: usize| group[k] == Some(true);
        let left = |k: usize| oriented(curves[k].1, flipped(k))[0];
        let ends: Vec<Vector3<f64>> = members.iter().map(|&k| left(k)).collect();
        let axis = principal_axes(&ends).axes[0];
        members.sort_by(|&a, &b| left(a).dot(&axis).total_cmp(&left(b).dot(&axis)));
        let name = |k: &usize| curves[*k].0;
        if members.len() < 4 {
            let mut names: Vec<u32> = members.iter().map(name).collect();
            names.sort_unstable();
            return Err(Error::Braid(format!(
                "open curves {names:?} have ends near one another and no others; a braid needs at \
                 least 4 curves: name the curves of each braid in a file (option `braid=ends.json`)"
            )));
        }
        braids.push(Braid {
            curves: members.iter().map(name).collect(),
            reversed: members.iter().filter(|&&k| flipped(k)).map(name).collect(),
            ..Braid::default()
        });
    }
    Ok(braids)
}

fn oriented([p, q]: [Vector3<f64>; 2], flipped: bool) -> [Vector3<f64>; 2] {
    if flipped { [q, p] } else { [p, q] }
}
