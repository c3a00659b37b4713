//! Crossings of all pairs of curves at once: what single precision decides is counted here, the rest is listed and decided
//! exactly by the processor ([`crate::kernels::crossings`]), by the same rules and in the same direction. So the sum is
//! exact.
//!
//! Directions are chosen and curves cut into blocks that may cross by the processor's trees; a tile is a block of each.
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
//! Tests are the same as of the processor where the coordinates are exact: intervals are compared by the sign of a
//! difference. Segments that touch are never decided here: they lie in one plane and their shadows meet in each
//! direction, so bounds prove neither that they are apart nor that they cross.

use super::commands::{Buffer, Command, Stage};
use super::error::Trouble;
use super::fixed;
use super::frame::Frame;
use super::layout::{CrossingSum, Tile, Undecided};
use super::{Counts, Engine, Gpu};
use crate::kernels::Linking;
use crate::kernels::crossings::{BLOCK, Block, Counted, Direction, Scene, blocks, conclude};
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
        super::program(
            &[("BLOCK", BLOCK), ("TOO_MANY", TOO_MANY)],
            &real,
            &[include_str!("crossings.wgsl")],
        )
    },
};

const UNDECIDED: Buffer = Buffer("undecided", "crossings");
const FOUND: Buffer = Buffer("found", "crossings");

/// Undecided tests that there is room for at first; more where a frame has shown more.
pub(super) const ROOM: u32 = 1 << 16;

/// Undecided tests at which they are no longer counted: no list is so long, and threads that have just looked add fewer
/// than it takes to come round to 0.
const TOO_MANY: u32 = 1 << 31;

/// Pairs of curves that are a task of the processor.
const TASK: usize = 256;

/// All linking numbers.
pub(super) fn linking_numbers(
    gpu: &Gpu,
    frame: &Frame,
    scene: Scene<'_>,
    pairs: &[Pair],
) -> Result<Counts, Trouble> {
    let views = View::of_all(frame, scene, pairs);
    let tiles: Vec<Tile> = views.iter().flat_map(|v| &v.tiles).copied().collect();
    // No other work of the pool comes between: it might want the adapter, too.
    let (sums, mut undecided) = count(&mut gpu.lock(), frame, pairs.len(), &tiles)?;
    undecided.par_sort_unstable();
    let curve = |i: u32| frame.first(i);
    // Lists are in the order of the pairs, so parts of them are parts of it.
    let parts = views.par_iter().enumerate().map(|(k, view)| {
        let mut workspace = scene.workspaces.take();
        workspace.stats = view.stats;
        let mut found = Vec::with_capacity(view.directions.len());
        let first = (k * TASK) as u32;
        let mut rest = &undecided[undecided.partition_point(|u| u.pair < first)..];
        let mut tests = Vec::new();
        for (at, &direction) in (first..).zip(&view.directions) {
            let Some(direction) = direction else {
                found.push(Linking::Number(0));
                continue;
            };
            let (own, others) = rest.split_at(rest.partition_point(|u| u.pair <= at));
            rest = others;
            let pair = pairs[at as usize];
            let (upper, lower) = direction.upper_first(pair.0, pair.1);
            tests.clear();
            tests.extend(
                own.iter()
                    .map(|u| (u.upper - curve(upper), u.lower - curve(lower))),
            );
            let sum = &sums[at as usize];
            let counted = Counted {
                sum: fixed::whole(sum.signs),
                crossings: sum.crossings.into(),
                // Undecided ones are counted where they are decided.
                tests: u64::from(sum.tests).saturating_sub(tests.len() as u64),
            };
            found.push(conclude(
                scene,
                pair,
                direction,
                counted,
                &tests,
                &mut workspace,
            ));
        }
        let stats = workspace.take_stats();
        scene.workspaces.put(workspace);
        (found, stats)
    });
    let parts: Vec<(Vec<Linking>, Stats)> = parts.collect();
    let mut stats = Stats::default();
    for (_, part) in &parts {
        stats.add(part);
    }
    let found = parts.into_iter().flat_map(|(found, _)| found).collect();
    Ok((found, stats, undecided.len() as u64))
}

/// The work list of some pairs.
#[cfg(test)]
pub(super) fn tiles(frame: &Frame, scene: Scene<'_>, pairs: &[Pair]) -> Vec<Tile> {
    let views = View::of_all(frame, scene, pairs);
    views.iter().flat_map(|v| &v.tiles).copied().collect()
}

/// Some pairs as they are seen, and what there is to test.
struct View {
    directions: Vec<Option<Direction>>,
    tiles: Vec<Tile>,
    stats: Stats,
}

impl View {
    fn of_all(frame: &Frame, scene: Scene<'_>, pairs: &[Pair]) -> Vec<View> {
        let view = |(task, pairs): (usize, &[Pair])| {
            let mut workspace = scene.workspaces.take();
            let (mut directions, mut tiles, mut found) = (Vec::new(), Vec::new(), Vec::new());
            for (k, &pair) in pairs.iter().enumerate() {
                let direction = blocks(scene, pair, &mut workspace, &mut found);
                directions.push(direction);
                let Some(direction) = direction else { continue };
                let (upper, lower) = direction.upper_first(pair.0, pair.1);
                let tile = |Block([rows, columns]): Block| Tile {
                    pair: (task * TASK + k) as u32,
                    axis: direction.axis as u32,
                    first_row: frame.first(upper) + rows,
                    rows: BLOCK.min(frame.segments(upper) - rows),
                    first_column: frame.first(lower) + columns,
                    columns: BLOCK.min(frame.segments(lower) - columns),
                    padding: [0; 2],
                };
                tiles.extend(found.drain(..).map(tile));
            }
            let stats = workspace.take_stats();
            scene.workspaces.put(workspace);
            View {
                directions,
                tiles,
                stats,
            }
        };
        pairs.par_chunks(TASK).enumerate().map(view).collect()
    }
}

/// What the adapter decides, and, in any order, what it does not.
fn count(
    engine: &mut Engine,
    frame: &Frame,
    pairs: usize,
    tiles: &[Tile],
) -> Result<(Vec<CrossingSum>, Vec<Undecided>), Trouble> {
    let size = (pairs * size_of::<CrossingSum>()) as u64;
    loop {
        let room = engine.room;
        let list = u64::from(room) * size_of::<Undecided>() as u64;
        let mut commands = vec![
            Command::Clear(super::SUMS, size.max(4)),
            Command::Clear(FOUND, 4),
            Command::Reserve(UNDECIDED, list),
        ];
        let bindings = [(super::SUMS, size), (UNDECIDED, list), (FOUND, 4)];
        engine.dispatch_tiles(&mut commands, STAGE, frame, tiles, 1, &bindings)?;
        commands.push(Command::Download(super::SUMS, size.max(4)));
        commands.push(Command::Download(FOUND, 4));
        let mut got = engine.run(frame, &commands)?;
        let found: u32 = bytemuck::pod_read_unaligned(&got[1]);
        if found > room {
            // Once more, with room for all of them. Where there is none, later frames still have what there was.
            let wanted = found.saturating_add(found / 4);
            let most = engine.device.most_bytes() / size_of::<Undecided>() as u64;
            let most = most.min(u64::from(TOO_MANY) - 1) as u32;
            if found > most {
                return Err(Trouble::limit("undecided tests", found.into(), most.into()));
            }
            engine.room = wanted.min(most);
            continue;
        }
        let sums = bytemuck::pod_collect_to_vec(&got.swap_remove(0)[..size as usize]);
        let mut undecided = Vec::new();
        if found > 0 {
            let bytes = u64::from(found) * size_of::<Undecided>() as u64;
            let list = engine.run(frame, &[Command::Download(UNDECIDED, bytes)])?;
            undecided = bytemuck::pod_collect_to_vec(&list[0]);
        }
        return Ok((sums, undecided));
    }
}
