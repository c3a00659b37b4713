//! Estimate of the work of many potential links, from a sample of them.

use crate::kernels::KernelWork;
use crate::kernels::calibration::segments;
use crate::kernels::crossings::{Input, sample, shares_out};
use crate::pairs::Pair;
use rayon::prelude::*;
use std::ops::Add;

/// Maximum number of potential links in the sample.
const SAMPLE: usize = 64;

/// Estimate of the work of all potential links from a sample.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sample {
    /// Number of sampled potential links.
    pub links: usize,
    /// Estimated work of all links.
    pub work: KernelWork,
    /// True if one of the sampled links uses several threads.
    pub shared: bool,
}

impl Sample {
    pub fn of(input: Input<'_>, links: &[Pair]) -> Sample {
        let drawn = draw(links.len(), |k| segments(input.set, &links[k..=k]));
        let work = |&(k, factor): &(usize, f64)| {
            // Sampling does not count as verification work.
            let run = |workspace: &mut _| sample(input, links[k], workspace);
            (input.workspaces.run(run).0, factor)
        };
        let works: Vec<(KernelWork, f64)> = drawn.par_iter().map(work).collect();
        let scaled = works.iter().map(|(work, factor)| work.scaled(*factor));
        let mut each = works.iter().map(|(work, _)| work);
        Sample {
            links: works.len(),
            work: scaled.fold(KernelWork::default(), Add::add),
            shared: each.any(|work| shares_out(work.nodes + work.computed, work.tests)),
        }
    }
}

/// Returns a sorted sample of the numbers below `count`, with factors so that the weighted sum over
/// the sample estimates the sum over all. The sample has all numbers if there are at most
/// [`SAMPLE`]. Otherwise [`SAMPLE`] of them are drawn at equal distances along a line on which each
/// number takes the length `weight` (systematic sampling with probability proportional to size).
fn draw(count: usize, weight: impl Fn(usize) -> u64) -> Vec<(usize, f64)> {
    if count <= SAMPLE {
        return (0..count).map(|k| (k, 1.0)).collect();
    }
    let total: u64 = (0..count).map(&weight).sum();
    let step = total as f64 / SAMPLE as f64;
    let mut drawn: Vec<(usize, f64)> = Vec::with_capacity(SAMPLE);
    let (mut end, mut next) = (0, 0.5 * step);
    for k in 0..count {
        let length = weight(k);
        end += length;
        let mut times = 0;
        while next < end as f64 {
            times += 1;
            next += step;
        }
        if times > 0 {
            drawn.push((k, f64::from(times) * step / length as f64));
        }
    }
    drawn
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn draws_all_of_few_and_a_weighted_sample_of_many() {
        assert_eq!(draw(3, |k| k as u64), [(0, 1.0), (1, 1.0), (2, 1.0)]);
        let count = 10 * SAMPLE;
        for weight in [
            |_| 7,
            |k: usize| k as u64,
            |k| if k == 100 { 1_000_000 } else { 3 },
        ] {
            let drawn = draw(count, weight);
            assert!(drawn.len() <= SAMPLE && drawn.is_sorted());
            let total: u64 = (0..count).map(weight).sum();
            let sum: f64 = drawn
                .iter()
                .map(|&(k, times)| times * weight(k) as f64)
                .sum();
            assert!((sum / total as f64 - 1.0).abs() < 1e-9);
        }
    }
}
