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
    let mut rest: Vec<(u32, [Vector3<f64>; 2])> = open.map(|i| (i as u32, ends(i))).collect();
    if rest.is_empty() {
        let what = format!("no open curve among {}, so there are no braids", set.len());
        return Err(Error::Braid(what));
    }
    let length = |[p, q]: [Vector3<f64>; 2]| (q - p).norm();
    let mut braids = Vec::new();
    while !rest.is_empty() {
        // Curves, their ends from left to right, and true for those that start at the right end.
        let (first, ends) = rest.remove(0);
        let (mut members, mut next) = (vec![(first, ends, false)], 0);
        while let Some(&(_, [p, q], _)) = members.get(next) {
            next += 1;
            rest.retain(|&(i, [r, s])| {
                let limit = NEAR * length([p, q]).min(length([r, s]));
                let near =
                    |[r, s]: [Vector3<f64>; 2]| (p - r).norm() < limit && (q - s).norm() < limit;
                let mut ways = [(i, [r, s], false), (i, [s, r], true)].into_iter();
                let member = ways.find(|(_, ends, _)| near(*ends));
                members.extend(member);
                member.is_none()
            });
        }
        let left: Vec<Vector3<f64>> = members.iter().map(|(_, [p, _], _)| *p).collect();
        let axis = principal_axes(&left).axes[0];
        members.sort_by(|(_, [p, _], _), (_, [q, _], _)| p.dot(&axis).total_cmp(&q.dot(&axis)));
        let curves: Vec<u32> = members.iter().map(|member| member.0).collect();
        if curves.len() < 4 {
            let mut names = curves;
            names.sort_unstable();
            return Err(Error::Braid(format!(
                "open curves {names:?} have ends near one another and no others; a braid needs at \
                 least 4 curves: name the curves of each braid in a file (option `braid=ends.json`)"
            )));
        }
        let reversed = members.iter().filter(|member| member.2);
        braids.push(Braid {
            reversed: reversed.map(|member| member.0).collect(),
            curves,
            ..Braid::default()
        });
    }
    Ok(braids)
}
