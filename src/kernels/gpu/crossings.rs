//! Crossings of all pairs of curves at once. Single precision counts the crossings that it decides;
//! the other tests are listed, and the CPU decides them exactly ([`crate::kernels::crossings`]), by
//! the same rules and in the same direction. So the sum is exact.
//!
//! The adapter also finds the segments to test: bounding boxes of runs of segments
//! ([`super::boxes`]), the direction of projection of each pair of curves ([`super::directions`]),
//! and the descent to tiles, pairs of boxes of 16 segments that may contain a crossing
//! ([`super::descent`]).
//!
//! # Error bounds
//!
//! `u = 2^-23` exceeds the relative error of an operation in any rounding mode (see
//! [`super::direct`]). Coordinates are exact, and their differences are pinned.
//!
//! * Determinant of two vectors, each a difference: the products have a relative error of `3 u`,
//!   and their difference of `u`, together `4 u` of the sum of the magnitudes. [`FLAT`] is `5 u`,
//!   which covers the rounding of the bound itself.
//! * Volume: three differences, three multiplications or additions inside, a multiplication, two
//!   additions: `9 u` of the permanent. [`SOLID`] is `12 u`.
//! * Coordinates are below 1, and numbers below `2^-126` may be flushed to 0, which causes an error
//!   below `10^-36`. [`TINY`] is more.
//! * If coordinates are off by a radius `r`, differences are off by `2 r`. Each product of two
//!   differences is off by `2 r (|x| + |y| + 2 r)`. Each monomial of the volume is one of the
//!   product of the three sums `|x| + |y| + |z|`, which grow by `6 r`.
//!
//! Boxes and intervals are compared by the sign of a difference, so touching ones are never
//! disjoint. Touching segments are never decided here: they are coplanar and their projections meet
//! in each direction, so the bounds prove neither that they are disjoint nor that they cross.

use super::boxes::{self, LEAF, NODES_SHADER};
use super::capacity::{Capacity, in_batches};
use super::commands::{Binding, Buffer, Command, Stage};
use super::counters::{self, TOO_MANY};
use super::descent::{self, AXIS, COUNTERS, TILES};
use super::error::Error;
use super::fixed;
use super::frame::Frame;
use super::layout::{Parameters, Undecided, named};
use super::{Gpu, State, directions};
use crate::kernels::crossings::{self, Direction, Input, conclude};
use crate::kernels::gpu_use::Counts;
use crate::kernels::{Counted, Linking};
use crate::pairs::Pair;
use crate::verdict::Stats;
use rayon::prelude::*;
use std::sync::atomic::AtomicU64;

/// Error of a determinant, relative to the sum of the magnitudes of both products.
const FLAT: f64 = 5.0 * super::direct::UNIT_ERROR;
/// Error of a volume, relative to the permanent.
const SOLID: f64 = 12.0 * super::direct::UNIT_ERROR;
/// Maximum error by underflow.
const TINY: f64 = 1e-35;

/// The shader that counts the crossings of tiles.
pub(super) const STAGE: Stage = Stage {
    name: "crossings",
    source: || {
        let real = named![FLAT, SOLID, TINY];
        let mut whole = descent::constants();
        whole.push(("LEAF", LEAF));
        let parts = [NODES_SHADER, include_str!("crossings.wgsl")];
        super::shader::<f32>(&whole, &real, &parts)
    },
};

const PARAMETERS: Buffer = Buffer("parameters", STAGE.name);
const SIGNS: Buffer = Buffer("signs", STAGE.name);
const UNDECIDED: Buffer = Buffer("undecided", STAGE.name);

/// Initial capacity of the list of undecided tests. It grows if a frame needs more.
pub(super) const UNDECIDED_CAPACITY: u32 = 1 << 16;

/// Size of an undecided test in bytes.
const ENTRY: u64 = size_of::<Undecided>() as u64;

/// Number of undecided tests that are downloaded with the counters, before their number is known.
const READ_AHEAD: u32 = 1 << 12;

/// Maximum number of pairs of curves in a pass: the node pairs of all of them stay below
/// [`counters::TOO_MANY`], and the index and the axis fit into one word.
const MOST_PAIRS: usize = 1 << 22;

/// Rounds of a thread in a tile. All rounds are counted, because a driver that leaves a loop early
/// may do so in the middle of a tile.
const ROUNDS: u32 = (LEAF * LEAF).div_ceil(descent::THREADS);

/// Number of pairs of curves in a CPU task.
const TASK: usize = 1024;

/// Result of a pass.
struct PassResult {
    /// Sum of the signs of the decided crossings, for each pair of curves.
    signs: Vec<[u32; 2]>,
    /// Tests that are not decided.
    undecided: Vec<Undecided>,
    counts: Vec<u32>,
}

/// CPU work that runs while the adapter counts.
pub(super) type Meanwhile<'a> = dyn FnMut(&mut State) -> Result<(), Error> + 'a;

/// Returns all linking numbers, in the order of the pairs, and the number of undecided tests.
pub(super) fn linking_numbers(
    gpu: &Gpu,
    frame: &Frame,
    input: Input<'_>,
    pairs: &[Pair],
    meanwhile: &mut Meanwhile<'_>,
) -> Result<Counts, Error> {
    let passes = {
        // No rayon task is spawned under this lock: a thread that waits for tasks may steal one
        // that needs the lock.
        let state = &mut gpu.lock();
        let fits = state.adapter.max_buffer_bytes / size_of::<[u32; 2]>() as u64;
        let most = MOST_PAIRS.min(fits as usize);
        let mut pass = |state: &mut State, pairs: &[Pair]| pass(state, frame, pairs, meanwhile);
        let capacity: fn(&mut State) -> &mut Capacity = |state| &mut state.crossing_capacity;
        in_batches(state, pairs, most, capacity, &mut pass)?
    };
    let (mut parts, mut left) = (Vec::new(), 0);
    let mut rest = pairs;
    for (count, found) in passes {
        let (own, others) = rest.split_at(count);
        rest = others;
        match found {
            Some(mut found) => {
                let undecided = &mut found.undecided;
                undecided.par_sort_unstable_by_key(|u| (number(u), u.upper, u.lower));
                left += undecided.len() as u64;
                parts.push(found.work(count));
                parts.extend(found.conclude(frame, input, own));
            }
            // The capacity is too small even for one pair.
            None => {
                let mut counted = Vec::new();
                crossings::linking_numbers(input, own, &mut counted, &AtomicU64::new(0));
                parts.extend(counted);
            }
        }
    }
    Ok((parts, left))
}

/// Returns the index of the pair of curves of a test.
fn number(u: &Undecided) -> usize {
    (u.pair & ((1 << AXIS) - 1)) as usize
}

impl PassResult {
    /// Returns the work that the adapter did for `pairs` pairs of curves. Undecided tests are
    /// counted by the CPU, which decides them.
    fn work(&self, pairs: usize) -> Counted {
        let stats = Stats {
            potential_links: pairs as u64,
            separated: counters::get(&self.counts, counters::SEPARATED).into(),
            tests: counters::get_wide(&self.counts, counters::TESTS)
                .saturating_sub(self.undecided.len() as u64),
            crossings: counters::get_wide(&self.counts, counters::CROSSINGS),
            ..Stats::default()
        };
        Counted {
            stats,
            ..Counted::default()
        }
    }

    /// Decides the undecided tests, which are sorted, and returns the linking numbers.
    fn conclude(&self, frame: &Frame, input: Input<'_>, pairs: &[Pair]) -> Vec<Counted> {
        let task = |(task, signs): (usize, &[[u32; 2]])| {
            let first = task * TASK;
            let mut rest = &self.undecided[self.undecided.partition_point(|u| number(u) < first)..];
            let (mut part, mut tests) = (Counted::default(), Vec::new());
            ((), part.stats) = input.workspaces.run(|workspace| {
                for (at, &signs) in (first..).zip(signs) {
                    let (own, others) = rest.split_at(rest.partition_point(|u| number(u) == at));
                    rest = others;
                    let (pair, sum) = (pairs[at], fixed::whole(signs));
                    let Some(one) = own.first() else {
                        part.add(pair, Linking::Number(sum));
                        continue;
                    };
                    let (i, j) = pair;
                    let direction = Direction {
                        axis: (one.pair >> AXIS) as usize,
                        second_over: frame.curves[j as usize].contains(&one.upper),
                    };
                    let (upper, lower) = direction.upper_first(i, j);
                    let [upper, lower] = [upper, lower].map(|curve| frame.first(curve));
                    tests.clear();
                    tests.extend(own.iter().map(|u| (u.upper - upper, u.lower - lower)));
                    let linking = conclude(input, pair, direction, sum, &tests, workspace);
                    part.add(pair, linking);
                }
            });
            part
        };
        let tasks = self.signs.par_chunks(TASK).enumerate().map(task);
        tasks.collect()
    }
}

/// Buffers of a pass.
struct Lists {
    capacity: Capacity,
    signs: Binding,
    undecided: Binding,
    /// Number of tiles in one submission, so that none takes too long.
    part: u32,
}

impl Lists {
    fn new(state: &State, pairs: &[Pair]) -> Lists {
        let list = u64::from(state.undecided_capacity) * ENTRY;
        Lists {
            capacity: state.crossing_capacity,
            signs: Binding::whole(SIGNS, size_of_val(pairs) as u64),
            undecided: Binding::whole(UNDECIDED, list),
            part: (state.max_work / u64::from(LEAF * LEAF)).max(1) as u32,
        }
    }

    /// Returns all commands up to the first batch of tiles. Most frames have no further batch.
    fn commands(&self, state: &mut State, frame: &Frame, pairs: &[Pair]) -> Vec<Command> {
        let (capacity, radius) = (self.capacity, frame.radius);
        let [mut commands, fits] = boxes::fit(state, frame);
        let (uploads, choice) = directions::choose(state, radius, pairs, capacity);
        commands.extend(uploads);
        let (upload, steps) = descent::descend(state, radius, capacity);
        commands.push(upload);
        let own = |first| Parameters::new(radius, first, self.part.min(capacity.tiles - first));
        let parts = (0..capacity.tiles).step_by(self.part as usize).map(own);
        commands.push(Command::parameters(PARAMETERS, parts));
        let [now, next] = descent::AGENDAS.map(|list| capacity.agenda(list));
        let lists = [now, next, capacity.tiles(TILES), self.undecided];
        commands.extend(lists.map(|list| Command::Reserve(list.buffer, list.size)));
        commands.push(Command::Clear(SIGNS, self.signs.size));
        commands.push(Command::Clear(COUNTERS.buffer, COUNTERS.size));
        commands.extend(fits);
        commands.push(choice);
        commands.extend(steps);
        commands.push(self.count(state, frame, 0));
        commands.extend(self.results());
        commands
    }

    /// Returns the command that counts the crossings of a batch of tiles.
    fn count(&self, state: &State, frame: &Frame, part: u32) -> Command {
        Command::Dispatch {
            stage: STAGE,
            bindings: vec![
                Binding::parameters(PARAMETERS, part),
                state.vertices(frame),
                state.hierarchy.nodes(),
                self.capacity.tiles(TILES),
                self.signs,
                self.undecided,
                COUNTERS,
            ],
            groups: state.strides(),
        }
    }

    fn results(&self) -> [Command; 4] {
        let ahead = self.undecided.size.min(u64::from(READ_AHEAD) * ENTRY);
        [
            Command::Download(COUNTERS.buffer, COUNTERS.size),
            Command::Download(SIGNS, self.signs.size),
            Command::Download(UNDECIDED, ahead),
            Command::Download(boxes::MADE.buffer, boxes::MADE.size),
        ]
    }
}

/// Returns the counters.
///
/// # Errors
///
/// Not all items were processed, or not all boxes were computed ([`State::incomplete`]).
pub(super) fn counters(
    state: &mut State,
    got: &[Vec<u8>],
    items: impl Fn(&[u32]) -> u32,
) -> Result<Vec<u32>, Error> {
    let words = |k: usize| bytemuck::pod_collect_to_vec::<u8, u32>(&got[k]);
    let (counts, made) = (words(0), words(3));
    match counters::get(&counts, counters::DONE) == items(&counts) && made == [state.boxes_made] {
        true => Ok(counts),
        false => Err(state.incomplete()),
    }
}

/// Runs one pass. Returns `None` if a capacity was too small.
fn pass(
    state: &mut State,
    frame: &Frame,
    pairs: &[Pair],
    meanwhile: &mut Meanwhile<'_>,
) -> Result<Option<PassResult>, Error> {
    let lists = Lists::new(state, pairs);
    let commands = lists.commands(state, frame, pairs);
    let pending = state.start(frame, commands)?;
    meanwhile(state)?;
    let mut got = state.finish(pending)?;
    state.boxes_of = Some(frame.id);
    let levels = state.hierarchy.levels() as usize;
    let capacity = lists.capacity;
    // Expected number of processed items: of each list as many as it can hold, and of the tiles the
    // first batch.
    let listed = |counts: &[u32], tiles: u32| {
        let steps = counts[..levels - 1].iter();
        let steps = steps.map(|&c| c.min(capacity.node_pairs));
        let rounds = counters::get(counts, counters::TILES).min(tiles);
        let rounds = rounds.wrapping_mul(ROUNDS);
        steps.fold((pairs.len() as u32).wrapping_add(rounds), u32::wrapping_add)
    };
    let mut counts = counters(state, &got, |c| listed(c, lists.part.min(capacity.tiles)))?;
    let tiles = counters::get(&counts, counters::TILES);
    if counts[..levels].iter().any(|&c| c > capacity.node_pairs) || tiles > capacity.tiles {
        return Ok(None);
    }
    // Node pairs below the last level would be lost.
    if counts[levels - 1] > 0 {
        let what = "levels of boxes";
        return Err(Error::limit(what, levels as u64 + 1, levels as u64));
    }
    if tiles > lists.part {
        let mut commands = Vec::new();
        for part in 1..tiles.div_ceil(lists.part) {
            commands.extend([lists.count(state, frame, part), Command::Submit]);
        }
        commands.extend(lists.results());
        got = state.run(frame, commands)?;
        counts = counters(state, &got, |c| listed(c, capacity.tiles))?;
    }
    let open = counters::get(&counts, counters::OPEN_TESTS);
    if open > state.undecided_capacity {
        // Repeats the pass with capacity for all of them. If the adapter does not allow that much,
        // later frames keep the old capacity.
        let most = state.adapter.max_buffer_bytes / ENTRY;
        let most = most.min(u64::from(TOO_MANY) - 1) as u32;
        if open > most {
            return Err(Error::limit("undecided tests", open.into(), most.into()));
        }
        state.undecided_capacity = open.saturating_add(open / 4).min(most);
        return pass(state, frame, pairs, meanwhile);
    }
    let mut undecided: Vec<Undecided> = bytemuck::pod_collect_to_vec(&got[2]);
    if open as usize > undecided.len() {
        let all = Command::Download(UNDECIDED, u64::from(open) * ENTRY);
        undecided = bytemuck::pod_collect_to_vec(&state.run(frame, vec![all])?[0]);
    }
    undecided.truncate(open as usize);
    Ok(Some(PassResult {
        signs: bytemuck::pod_collect_to_vec(&got[1]),
        undecided,
        counts,
    }))
}
