//! Crossings of all pairs of curves at once: what single precision decides is counted here, the rest is listed and decided
//! exactly by the processor ([`crate::kernels::crossings`]), by the same rules and in the same direction. So the sum is
//! exact.
//!
//! Which segments to test is found out on the adapter as well: boxes around runs of segments ([`super::boxes`]), the direction of
//! each pair of curves ([`super::directions`]), and down to tiles, two boxes of 16 segments that may cross
//! ([`super::descent`]).
//!
//! # The bounds
//!
//! `u = 2^-23` is more than the relative error of an operation however it rounds (see [`super::direct`]). Coordinates
//! are exact, their differences are pinned.
//!
//! * The determinant of two differences each: the products are off by `3 u` of themselves and their difference by `u`,
//!   together `4 u` of the sum of their sizes. [`FLAT`] is `5 u`, which covers the bound's own rounding.
//! * The volume: three differences, three multiplications or additions inside, a multiplication, two additions, `9 u` of the
//!   permanent. [`SOLID`] is `12 u`.
//! * Coordinates are below 1, and numbers below `2^-126` may count as 0, which costs less than `10^-36`; [`TINY`] is more.
//! * Where coordinates are off by a radius `r`, differences are by `2 r`. Each product of two is off by `2 r (|x| + |y| + 2 r)`;
//!   each monomial of the volume's is one of the product of the three sums `|x| + |y| + |z|`, which grow by `6 r`.
//!
//! Boxes and intervals are compared by the sign of a difference, so none that touch are apart. Segments that touch are never decided here: they lie in one plane and their shadows meet in each
//! direction, so bounds prove neither that they are apart nor that they cross.

use super::boxes::{self, LEAF, NODES_PROGRAM};
use super::commands::{Binding, Buffer, Command, Stage};
use super::descent::{
    self, AXIS, COUNTERS, CROSSINGS, DONE, OPEN, SEPARATED, TESTS, TILES, TILES_AT, TOO_MANY,
};
use super::error::Trouble;
use super::fixed;
use super::frame::Frame;
use super::layout::{Parameters, Undecided};
use super::room::{Room, in_parts};
use super::{Counts, Engine, Gpu, directions};
use crate::kernels::crossings::{Direction, Scene, conclude, linking_number};
use crate::kernels::{Counted, Linking};
use crate::pairs::Pair;
use crate::verdict::Stats;
use rayon::prelude::*;

/// Of the sum of the sizes of both products.
const FLAT: f64 = 5.0 * super::direct::UNIT_ERROR;
/// Of the permanent.
const SOLID: f64 = 12.0 * super::direct::UNIT_ERROR;
/// What underflow can add.
const TINY: f64 = 1e-35;

/// The program.
pub(super) const STAGE: Stage = Stage {
    name: "crossings",
    source: || {
        let real = [("FLAT", FLAT), ("SOLID", SOLID), ("TINY", TINY)];
        let mut whole = descent::WORDS.to_vec();
        whole.extend([
            ("LEAF", LEAF),
            ("OPEN", OPEN),
            ("TESTS", TESTS),
            ("CROSSINGS", CROSSINGS),
        ]);
        super::program(
            &whole,
            &real,
            &[NODES_PROGRAM, include_str!("crossings.wgsl")],
        )
    },
};

const PARAMETERS: Buffer = Buffer("parameters", STAGE.name);
const SIGNS: Buffer = Buffer("signs", STAGE.name);
const UNDECIDED: Buffer = Buffer("undecided", STAGE.name);

/// Undecided tests that there is room for at first; more where a frame has shown more.
pub(super) const OPEN_ROOM: u32 = 1 << 16;

/// Bytes of one of them.
const ENTRY: u64 = size_of::<Undecided>() as u64;

/// Undecided tests that are read without being asked for.
const READ_AHEAD: u32 = 1 << 12;

/// Pairs of curves of one pass, at most: below [`descent::TOO_MANY`] with the node pairs of each, and with the axis in one word.
const MOST_PAIRS: usize = 1 << 22;

/// Rounds of a thread in a tile, which are counted: a driver that leaves a loop may do so in the middle of one.
const ROUNDS: u32 = (LEAF * LEAF).div_ceil(descent::THREADS);

/// Pairs of curves that are a task of the processor.
const TASK: usize = 1024;

/// What a pass found.
struct Found {
    /// The sum of the signs of each pair of curves, as far as it is decided.
    signs: Vec<[u32; 2]>,
    /// What is not decided.
    undecided: Vec<Undecided>,
    counts: Vec<u32>,
}

/// What there is to do while the adapter counts.
pub(super) type Meanwhile<'a> = dyn FnMut(&mut Engine) -> Result<(), Trouble> + 'a;

/// All linking numbers.
pub(super) fn linking_numbers(
    gpu: &Gpu,
    frame: &Frame,
    scene: Scene<'_>,
    pairs: &[Pair],
    meanwhile: &mut Meanwhile<'_>,
) -> Result<Counts, Trouble> {
    let passes = {
        // Nothing in here is shared out: a thread that waits for others may take up work that wants the adapter, too.
        let engine = &mut gpu.lock();
        let fits = engine.device.most_bytes() / size_of::<[u32; 2]>() as u64;
        let most = MOST_PAIRS.min(fits as usize);
        let mut pass = |engine: &mut Engine, pairs: &[Pair]| pass(engine, frame, pairs, meanwhile);
        in_parts(
            engine,
            pairs,
            most,
            |engine| &mut engine.count_room,
            &mut pass,
        )?
    };
    let (mut parts, mut left) = (Vec::new(), 0);
    let mut rest = pairs;
    for (count, found) in passes {
        let (own, others) = rest.split_at(count);
        rest = others;
        match found {
            Some(mut found) => {
                found
                    .undecided
                    .par_sort_unstable_by_key(|u| (number(u), u.upper, u.lower));
                left += found.undecided.len() as u64;
                parts.push(found.work(count));
                parts.extend(found.conclude(frame, scene, own));
            }
            // Too much for the adapter.
            None => parts.push(on_processor(scene, own)),
        }
    }
    Ok((parts, left))
}

/// The linking numbers of pairs that are too much for the adapter.
fn on_processor(scene: Scene<'_>, pairs: &[Pair]) -> Counted {
    let mut workspace = scene.workspaces.take();
    let mut part = Counted::default();
    for &pair in pairs {
        part.add(pair, linking_number(scene, pair, None, &mut workspace));
    }
    part.stats = workspace.take_stats();
    scene.workspaces.put(workspace);
    part
}

/// Which pair of curves a test is of.
fn number(u: &Undecided) -> usize {
    (u.pair & ((1 << AXIS) - 1)) as usize
}

impl Found {
    /// The work that the adapter did for so many pairs of curves. Undecided tests are counted where they are decided.
    fn work(&self, pairs: usize) -> Counted {
        let long = |at: u32| {
            let at = at as usize;
            u64::from(self.counts[at + 1]) << 32 | u64::from(self.counts[at])
        };
        let stats = Stats {
            potential_links: pairs as u64,
            separated: self.counts[SEPARATED as usize].into(),
            tests: long(TESTS).saturating_sub(self.undecided.len() as u64),
            crossings: long(CROSSINGS),
            ..Stats::default()
        };
        Counted {
            stats,
            ..Counted::default()
        }
    }

    /// Decides what is left, which is in order.
    fn conclude(&self, frame: &Frame, scene: Scene<'_>, pairs: &[Pair]) -> Vec<Counted> {
        let task = |(task, signs): (usize, &[[u32; 2]])| {
            let first = task * TASK;
            let mut rest = &self.undecided[self.undecided.partition_point(|u| number(u) < first)..];
            let mut workspace = scene.workspaces.take();
            let (mut part, mut tests) = (Counted::default(), Vec::new());
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
                let linking = conclude(scene, pair, direction, sum, &tests, &mut workspace);
                part.add(pair, linking);
            }
            part.stats = workspace.take_stats();
            scene.workspaces.put(workspace);
            part
        };
        let tasks = self.signs.par_chunks(TASK).enumerate().map(task);
        tasks.collect()
    }
}

/// Where a pass has its lists.
struct Lists {
    room: Room,
    signs: Binding,
    undecided: Binding,
    /// Tiles of one submission, so that none takes too long.
    part: u32,
}

impl Lists {
    fn new(engine: &Engine, pairs: &[Pair]) -> Lists {
        let list = u64::from(engine.open_room) * ENTRY;
        Lists {
            room: engine.count_room,
            signs: Binding::whole(SIGNS, size_of_val(pairs) as u64),
            undecided: Binding::whole(UNDECIDED, list),
            part: (engine.most_work / u64::from(LEAF * LEAF)).max(1) as u32,
        }
    }

    /// All that it takes, up to the first part of the tiles. More of them are rare.
    fn commands(&self, engine: &mut Engine, frame: &Frame, pairs: &[Pair]) -> Vec<Command> {
        let (room, radius) = (self.room, frame.radius);
        let [mut commands, fits] = boxes::fit(engine, frame);
        let (uploads, choice) = directions::choose(engine, radius, pairs, room);
        commands.extend(uploads);
        let (upload, steps) = descent::descend(engine, radius, room);
        commands.push(upload);
        let own = |first| Parameters {
            radius,
            zero: 0,
            first,
            items: self.part.min(room.tiles - first),
        };
        let parts = (0..room.tiles).step_by(self.part as usize).map(own);
        commands.push(Command::parameters(PARAMETERS, &parts.collect::<Vec<_>>()));
        let [now, next] = descent::AGENDAS;
        for list in [room.agenda(now), room.agenda(next), room.tiles(TILES)] {
            commands.push(Command::Reserve(list.buffer, list.size));
        }
        commands.push(Command::Reserve(UNDECIDED, self.undecided.size));
        commands.push(Command::Clear(SIGNS, self.signs.size));
        commands.push(Command::Clear(COUNTERS.buffer, COUNTERS.size));
        commands.extend(fits);
        commands.push(choice);
        commands.extend(steps);
        commands.push(self.count(engine, frame, 0));
        commands.extend(self.results());
        commands
    }

    /// Counts the crossings of a part of the tiles.
    fn count(&self, engine: &Engine, frame: &Frame, part: u32) -> Command {
        Command::Dispatch {
            stage: STAGE,
            bindings: vec![
                Binding::parameters(PARAMETERS, part),
                engine.vertices(frame),
                engine.hierarchy.nodes(),
                self.room.tiles(TILES),
                self.signs,
                self.undecided,
                COUNTERS,
            ],
            groups: engine.strides(),
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

/// The counters, where so many items were gone through, and all boxes were made ([`Engine::broken_off`]).
pub(super) fn counters(
    engine: &mut Engine,
    got: &[Vec<u8>],
    items: impl Fn(&[u32]) -> u32,
) -> Result<Vec<u32>, Trouble> {
    let words = |k: usize| bytemuck::pod_collect_to_vec::<u8, u32>(&got[k]);
    let (counts, made) = (words(0), words(3));
    match counts[DONE as usize] == items(&counts) && made == [engine.boxes_made] {
        true => Ok(counts),
        false => Err(engine.broken_off()),
    }
}

/// Counts on the adapter; none where there was too little room.
fn pass(
    engine: &mut Engine,
    frame: &Frame,
    pairs: &[Pair],
    meanwhile: &mut Meanwhile<'_>,
) -> Result<Option<Found>, Trouble> {
    let lists = Lists::new(engine, pairs);
    let commands = lists.commands(engine, frame, pairs);
    let pending = engine.start(frame, commands)?;
    meanwhile(engine)?;
    let mut got = engine.finish(pending)?;
    engine.boxes_of = Some(frame.id);
    let levels = engine.hierarchy.levels() as usize;
    let room = lists.room;
    // Of each list what there was room for, and of tiles one part at first.
    let listed = |counts: &[u32], tiles: u32| {
        let steps = counts[..levels - 1].iter().map(|&c| c.min(room.node_pairs));
        let rounds = counts[TILES_AT as usize].min(tiles).wrapping_mul(ROUNDS);
        steps.fold((pairs.len() as u32).wrapping_add(rounds), u32::wrapping_add)
    };
    let mut counts = counters(engine, &got, |c| listed(c, lists.part.min(room.tiles)))?;
    let tiles = counts[TILES_AT as usize];
    if counts[..levels].iter().any(|&c| c > room.node_pairs) || tiles > room.tiles {
        return Ok(None);
    }
    // What is left below the last level would be lost.
    if counts[levels - 1] > 0 {
        let what = "levels of boxes";
        return Err(Trouble::limit(what, levels as u64 + 1, levels as u64));
    }
    if tiles > lists.part {
        let mut commands = Vec::new();
        for part in 1..tiles.div_ceil(lists.part) {
            commands.extend([lists.count(engine, frame, part), Command::Submit]);
        }
        commands.extend(lists.results());
        got = engine.run(frame, commands)?;
        counts = counters(engine, &got, |c| listed(c, room.tiles))?;
    }
    let open = counts[OPEN as usize];
    if open > engine.open_room {
        // Once more, with room for all of them. Where there is none, later frames still have what there was.
        let most = engine.device.most_bytes() / ENTRY;
        let most = most.min(u64::from(TOO_MANY) - 1) as u32;
        if open > most {
            return Err(Trouble::limit("undecided tests", open.into(), most.into()));
        }
        engine.open_room = open.saturating_add(open / 4).min(most);
        return pass(engine, frame, pairs, meanwhile);
    }
    let mut undecided: Vec<Undecided> = bytemuck::pod_collect_to_vec(&got[2]);
    if open as usize > undecided.len() {
        let all = Command::Download(UNDECIDED, u64::from(open) * ENTRY);
        undecided = bytemuck::pod_collect_to_vec(&engine.run(frame, vec![all])?[0]);
    }
    undecided.truncate(open as usize);
    Ok(Some(Found {
        signs: bytemuck::pod_collect_to_vec(&got[1]),
        undecided,
        counts,
    }))
}
