//! Barnes-Hut for all pairs of curves at once. Both trees are descended level by level, all node
//! pairs of a level in parallel.
//!
//! The expansion and its remainder are those of [`crate::kernels::sums::barnes_hut`]. The trees are
//! its trees, built from the uploaded vertices, with leaves of 16 segments. The difference is
//! single precision: moments are divided by the length and by powers of the radius of their node,
//! and the distance is the unit of length, so that no product underflows. Pairs of leaves that are
//! not expanded become tiles of the direct sum ([`super::direct`]).
//!
//! # Bound of the rounding error
//!
//! Let `u = 2^-23` (see [`super::direct`]). A centre is stored in two parts, so that a coordinate
//! of the difference of two centres has a relative error of `3 u`, its direction `13 u`, the ratio
//! of a radius and the distance `8 u`, and a moment `u`. A term of the expansion is a product of at
//! most two moments, two squares of ratios and five directions, computed by at most 20
//! multiplications and additions. So its error is less than `128 u` times the sum of the magnitudes
//! of its monomials. That sum is at most 4 times the maximum of the term, and these maxima add up
//! to `1 + 4 q + 12 q^2` times the scale ([`bound`]). The scale itself has a relative error of
//! `20 u`. [`ROUNDING`] is `1024 u`.
//!
//! The bound of the remainder has positive terms only, except for `1 - q`, which is above 0.2, and
//! for the squared sine between tangents, to which [`PARALLEL`] is added. [`OUTWARD`] covers the
//! rest.
//!
//! [`bound`]: crate::kernels::sums::barnes_hut
//!
//! # Passes
//!
//! The first pass accepts node pairs by distance. Pairs that it does not prove are summed again
//! with the error bound as the criterion, in finer and finer passes, as on the CPU.

use super::State;
use super::capacity::{Capacity, in_batches};
use super::commands::{Binding, Buffer, Command, Stage};
use super::counters::{self, COUNTS, DONE};
use super::direct::{self, REACH, THREADS};
use super::error::Error;
use super::fixed;
use super::frame::Frame;
use super::layout::{AngleSum, Criterion, FarSum, Node, NodePair, Parameters, named, word};
use crate::curve::vector::per_axis;
use crate::kernels::Estimate;
use crate::kernels::sums::barnes_hut::pack;
use crate::pairs::Pair;
use rayon::prelude::*;
use std::f64::consts::PI;
use std::ops::Range;

/// Node pairs are not expanded if the sum of their radii, divided by the distance of the centres,
/// is above this.
const WIDEST: f64 = 0.79;
/// Added to the squared sine between tangents: rounding error of six products of means.
const PARALLEL: f64 = 4e-6;
/// Factor on error bounds, for the rounding of the bounds themselves.
const OUTWARD: f64 = 1.01;
/// Rounding error of an expansion, relative to the sum of the magnitudes of its terms.
const ROUNDING: f64 = 1024.0 * direct::UNIT_ERROR;
/// Node pairs whose squared distance is below this are not expanded. The low part of a coordinate
/// is rounded by `2^-49`, which is less than `u` times `10^-7`.
const NEAREST_SQUARE: f64 = 1e-14;
/// Expansions with larger terms or remainders are rejected.
const LARGEST: f64 = 16.0;
/// Inverse of the area of the unit sphere.
const SPHERE: f64 = 1.0 / (4.0 * PI);
/// Maximum number of expansions that a thread adds up in 64 bits: far below the 500,000 that these
/// hold.
const RUN: u32 = 1024;

/// The shader that descends by one level.
pub(super) const STAGE: Stage = Stage {
    name: "Barnes-Hut",
    source: || {
        let own = [
            ("WORDS", word!(FarSum)),
            ("VALUE", word!(FarSum.value)),
            ("BOUND", word!(FarSum.bound)),
            ("SIZE", word!(FarSum.size)),
        ];
        let whole = [&own[..], &named![THREADS, RUN], &counters::NAMES].concat();
        let errors = named![PARALLEL, OUTWARD, ROUNDING, SPHERE, REACH];
        let limits = named![WIDEST, LARGEST, NEAREST_SQUARE];
        let real = [&errors[..], &limits].concat();
        let parts = [direct::SUMS_SHADER, include_str!("barnes_hut.wgsl")];
        super::shader::<f32>(&whole, &real, &parts)
    },
};

const NODES: Buffer = Buffer("nodes", "Barnes-Hut");
const CRITERIA: Buffer = Buffer("criteria", "Barnes-Hut");
const AGENDAS: [Buffer; 2] = [
    Buffer("agenda", "Barnes-Hut"),
    Buffer("next agenda", "Barnes-Hut"),
];
const TILES: Buffer = Buffer("tiles", "Barnes-Hut");
const FAR: Buffer = Buffer("sums", "Barnes-Hut");
const COUNTERS: Binding = counters::binding("Barnes-Hut");
const PARAMETERS: Buffer = Buffer("parameters", "Barnes-Hut");

/// Maximum number of passes with the error bound as the criterion.
const PASSES: usize = 4;

/// Target for the error bound of a pair.
const BUDGET: f64 = 0.8;

/// Trees of a frame.
#[derive(Debug)]
pub(crate) struct Forest {
    nodes: Vec<Node>,
    /// Root, number of levels and number of leaves of each curve.
    roots: Vec<(u32, u32, u32)>,
}

impl Forest {
    /// Builds the trees of the curves of a frame.
    pub fn new(frame: &Frame) -> Forest {
        let tree = |range: &Range<u32>| {
            // The last vertex is the first one again.
            let open = range.start as usize..range.end.saturating_sub(1) as usize;
            let open = frame.vertices.get(open).unwrap_or_default().iter();
            let points: Vec<_> = open.map(|p| per_axis(|x| f64::from(p[x]))).collect();
            let mut nodes = Vec::new();
            let levels = pack(&points, range.start, &mut nodes);
            (nodes, levels)
        };
        let trees: Vec<(Vec<Node>, u32)> = frame.curves.par_iter().map(tree).collect();
        let mut forest = Forest {
            nodes: Vec::with_capacity(trees.iter().map(|t| t.0.len()).sum()),
            roots: Vec::with_capacity(trees.len()),
        };
        for (nodes, levels) in trees {
            let at = forest.nodes.len() as u32;
            let leaves = (nodes.len() as u32).div_ceil(2);
            forest.roots.push((at, levels, leaves));
            let moved = nodes.into_iter().map(|n| Node {
                right: n.right + at,
                ..n
            });
            forest.nodes.extend(moved);
        }
        forest
    }
}

/// Result of a pass for one pair.
#[derive(Clone, Copy, Debug)]
struct PairEstimate {
    estimate: Estimate,
    /// Part of the bound that a finer pass does not reduce.
    rounding: f64,
}

const NOTHING: PairEstimate = PairEstimate {
    estimate: Estimate::UNKNOWN,
    rounding: f64::INFINITY,
};

/// Returns the linking numbers of all pairs. With `beta` it makes one pass and accepts node pairs
/// by distance.
pub(super) fn linking_numbers(
    state: &mut State,
    frame: &Frame,
    forest: &Forest,
    pairs: &[Pair],
    beta: Option<f64>,
) -> Result<Vec<Estimate>, Error> {
    let by_distance = Criterion {
        beta: beta.unwrap_or(4.0) as f32,
        share: f32::MAX,
    };
    let whole = (0..pairs.len()).filter(|&k| frame.has_numbers(pairs[k]));
    let mut open: Vec<usize> = whole.collect();
    let mut shares: Vec<f64> = Vec::new();
    let mut out = vec![NOTHING; pairs.len()];
    for pass in 0..=PASSES {
        let criterion = |k: usize| match pass {
            0 => by_distance,
            _ => Criterion {
                beta: 0.0,
                share: shares[k] as f32,
            },
        };
        let all = open.iter().enumerate();
        let asked: Vec<_> = all.map(|(k, &at)| (pairs[at], criterion(k))).collect();
        let found = sums(state, frame, forest, &asked)?;
        for (&at, found) in open.iter().zip(&found) {
            // A finer pass may have a larger bound, because of rounding.
            if found.estimate.bound < out[at].estimate.bound {
                out[at] = *found;
            }
        }
        if beta.is_some() {
            break;
        }
        let mut left = Vec::new();
        let mut finer = Vec::new();
        for (k, (&at, found)) in open.iter().zip(&found).enumerate() {
            let bound = found.estimate.bound;
            let hopeless = found.rounding > BUDGET || bound.is_nan() || bound == f64::INFINITY;
            if out[at].estimate.integer().is_some() || hopeless {
                continue;
            }
            let (i, j) = pairs[at];
            let leaves = forest.roots[i as usize].2 + forest.roots[j as usize].2;
            let share = match pass {
                0 => BUDGET / (8.0 * f64::from(leaves).sqrt()),
                _ => shares[k] * (0.9 * BUDGET / bound).powf(1.25).clamp(1e-4, 0.7),
            };
            left.push(at);
            finer.push(share);
        }
        (open, shares) = (left, finer);
        if open.is_empty() {
            break;
        }
    }
    Ok(out.into_iter().map(|found| found.estimate).collect())
}

/// Runs one pass, in batches if all pairs together exceed a capacity.
fn sums(
    state: &mut State,
    frame: &Frame,
    forest: &Forest,
    asked: &[(Pair, Criterion)],
) -> Result<Vec<PairEstimate>, Error> {
    // Limit of the buffer of the sums, for the larger of both kinds.
    let most = state.adapter.max_buffer_bytes / size_of::<FarSum>() as u64;
    let mut pass = |state: &mut State, asked: &[_]| pass(state, frame, forest, asked);
    let capacity: fn(&mut State) -> &mut Capacity = |state| &mut state.sum_capacity;
    let parts = in_batches(state, asked, most as usize, capacity, &mut pass)?;
    let found = |(count, found): (_, Option<Vec<_>>)| found.unwrap_or(vec![NOTHING; count]);
    Ok(parts.into_iter().flat_map(found).collect())
}

/// Runs one pass. Returns `None` if a capacity was too small.
fn pass(
    state: &mut State,
    frame: &Frame,
    forest: &Forest,
    asked: &[(Pair, Criterion)],
) -> Result<Option<Vec<PairEstimate>>, Error> {
    let capacity = state.sum_capacity;
    if asked.len() as u64 > u64::from(capacity.node_pairs) {
        return Ok(None);
    }
    let root = |i: u32| forest.roots[i as usize];
    let levels = asked.iter().map(|&((i, j), _)| root(i).1 + root(j).1);
    let levels = levels.max().unwrap_or(0).min(counters::MOST_LEVELS);
    let start = |(pair, &((i, j), _)): (u32, &(Pair, Criterion))| NodePair {
        pair,
        first: root(i).0,
        second: root(j).0,
    };
    let start: Vec<NodePair> = (0..).zip(asked).map(start).collect();
    let criteria: Vec<Criterion> = asked.iter().map(|a| a.1).collect();
    let mut counts = [0u32; COUNTS as usize];
    counts[0] = asked.len() as u32;
    let parameters = (0..levels).map(|level| Parameters::new(frame.radius, 0, level));
    let tile_bytes = u64::from(capacity.tiles) * size_of::<super::Tile>() as u64;
    let far_bytes = (asked.len() * size_of::<FarSum>()) as u64;
    let agendas = AGENDAS.map(|buffer| capacity.agenda(buffer));
    let mut commands = Vec::new();
    if state.nodes_of != Some(frame.id) {
        commands.push(Command::upload(NODES, &forest.nodes));
    }
    commands.extend([
        Command::parameters(PARAMETERS, parameters),
        Command::upload(CRITERIA, &criteria),
        Command::Reserve(AGENDAS[0], agendas[0].size),
        Command::Reserve(AGENDAS[1], agendas[1].size),
        Command::upload(AGENDAS[0], &start),
        Command::upload(COUNTERS.buffer, &counts),
        Command::Reserve(TILES, tile_bytes),
        Command::Clear(FAR, far_bytes),
    ]);
    for level in 0..levels {
        let from = level as usize % 2;
        commands.push(Command::Dispatch {
            stage: STAGE,
            bindings: vec![
                Binding::parameters(PARAMETERS, level),
                Binding::whole(NODES, size_of_val(&forest.nodes[..]) as u64),
                Binding::whole(CRITERIA, size_of_val(&criteria[..]) as u64),
                Binding::whole(FAR, far_bytes),
                agendas[from],
                agendas[1 - from],
                Binding::whole(TILES, tile_bytes),
                COUNTERS,
            ],
            groups: state.strides(),
        });
    }
    commands.push(Command::Download(FAR, far_bytes));
    commands.push(Command::Download(COUNTERS.buffer, COUNTERS.size));
    state.nodes_of = None;
    let got = state.run(frame, commands)?;
    state.nodes_of = Some(frame.id);
    let counts: Vec<u32> = bytemuck::pod_collect_to_vec(&got[1]);
    let Some(tiles) = tiles(state, &counts, levels, asked.len())? else {
        return Ok(None);
    };
    // Node pairs below the last level would be lost.
    if counts[levels as usize] > 0 {
        let most = u64::from(levels);
        return Err(Error::limit("levels of trees", most + 1, most));
    }
    let far: Vec<FarSum> = bytemuck::pod_collect_to_vec(&got[0]);
    let near = direct::sum_tiles(state, frame, asked.len(), TILES, tiles)?;
    let both = far.iter().zip(&near);
    Ok(Some(both.map(|(far, near)| found(far, near)).collect()))
}

/// Returns the number of listed tiles. Returns `None` if the node pairs or the tiles exceeded the
/// capacity.
///
/// # Errors
///
/// Not all node pairs were processed ([`State::incomplete`]).
pub(super) fn tiles(
    state: &mut State,
    counts: &[u32],
    levels: u32,
    asked: usize,
) -> Result<Option<u32>, Error> {
    let capacity = state.sum_capacity;
    let node_pairs = &counts[..=levels as usize];
    let [done, tiles] = [DONE, counters::TILES].map(|counter| counters::get(counts, counter));
    let listed = node_pairs.iter().map(|&c| c.min(capacity.node_pairs));
    let processed = listed.take(levels as usize).fold(0, u32::wrapping_add);
    if done != processed || node_pairs[0] as usize != asked {
        return Err(state.incomplete());
    }
    let fit = |&count: &u32| count <= capacity.node_pairs;
    Ok((node_pairs.iter().all(fit) && tiles <= capacity.tiles).then_some(tiles))
}

fn found(far: &FarSum, near: &AngleSum) -> PairEstimate {
    let Estimate { value, bound } = direct::estimate(near);
    let total = bound + 1.000_001 * fixed::number(far.bound) + 1e-15 * value.abs();
    PairEstimate {
        estimate: Estimate::new(value + fixed::number(far.value), total),
        rounding: bound + fixed::number(far.size),
    }
}
