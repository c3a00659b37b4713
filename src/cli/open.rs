//! `linkwatch certify --open`: prints the Gauss linking integrals of all pairs of curves.

use super::Outcome;
use super::frames::Picked;
use super::measure::writhe::warn_of_bound;
use super::output::{count, millis, plural};
use linkwatch::{GaussIntegrals, Result};
use serde_json::json;
use std::time::Instant;

/// Prints `i,j,integral,bound` for every pair of curves of a set. None is rounded to an integer.
///
/// Pairs whose integral is below `least` in size, even with its bound, are skipped.
/// A line with the name of the frame comes first if it is `titled`.
pub fn print(
    frame: &Picked,
    tolerance: f64,
    least: f64,
    titled: bool,
    as_json: bool,
) -> Result<Outcome> {
    let (name, set) = (&frame.name, &frame.curves);
    if titled && !as_json {
        out!("# {name}");
    }
    let integrals = GaussIntegrals::new(set)?;
    let start = Instant::now();
    let (mut printed, mut undecided) = (0_u64, 0_u64);
    let mut worst = None;
    for i in 0..set.len() {
        for (k, found) in integrals.row(i, tolerance).into_iter().enumerate() {
            let j = i + 1 + k;
            if found.bound > tolerance {
                undecided += 1;
                worst.get_or_insert((i, j, found));
            }
            if found.value.abs() + found.bound < least {
                continue;
            }
            printed += 1;
            if as_json {
                let (integral, bound) = (found.value, found.bound);
                frame.print_json(json!({ "i": i, "j": j, "integral": integral, "bound": bound }));
            } else {
                let (value, bound) = (found.value, found.bound);
                out!("{i},{j},{value:.12},{bound:.1e}");
            }
        }
    }
    let pairs = set.len() * set.len().saturating_sub(1) / 2;
    let (integrals, printed) = (plural(pairs, "linking integral"), count(printed));
    let took = millis(start.elapsed());
    tracing::info!("{name}: {integrals}, {printed} of them printed ({took})");
    let Some((i, j, found)) = worst else {
        return Ok(Outcome::Fine);
    };
    warn_of_bound(&format!("{name}: curves {i} and {j}"), found, tolerance);
    if undecided > 1 {
        let others = plural(undecided - 1, "other pair");
        tracing::warn!("{name}: and {others}");
    }
    Ok(Outcome::Undecided)
}
