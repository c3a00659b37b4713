//! The direction of projection of every pair of curves, and the node pairs to begin with: a workgroup each.
//!
//! All pairs of the roots of both curves, 256 at most, are seen in all six directions; that is taken in which the fewest may cross.
//! Where it is none, the linking number is 0.

use super::boxes::{NODES_PROGRAM, ROOTS};
use super::commands::{Binding, Buffer, Command, Stage};
use super::descent::{self, AGENDA_PROGRAM, COUNTERS, SEPARATED, THREADS};
use super::layout::Parameters;
use super::{Engine, Room};
use crate::pairs::Pair;

/// Node pairs of a thread.
const SHARE: u32 = (ROOTS * ROOTS).div_ceil(THREADS);

/// The program.
pub(super) const STAGE: Stage = Stage {
    name: "directions",
    source: || {
        let mut whole = descent::WORDS.to_vec();
        whole.extend([("SHARE", SHARE), ("SEPARATED", SEPARATED)]);
        let parts = [
            NODES_PROGRAM,
            AGENDA_PROGRAM,
            include_str!("directions.wgsl"),
        ];
        super::program(&whole, &[], &parts)
    },
};

const PAIRS: Buffer = Buffer("pairs", STAGE.name);
const PARAMETERS: Buffer = Buffer("parameters", STAGE.name);

/// What it takes to choose the directions of some pairs: uploads, and what runs after them.
pub(super) fn choose(
    engine: &Engine,
    radius: f32,
    pairs: &[Pair],
    room: Room,
) -> ([Command; 2], Command) {
    let parameters = Parameters {
        radius,
        zero: 0,
        first: 0,
        items: pairs.len() as u32,
    };
    let listed: Vec<[u32; 2]> = pairs.iter().map(|&(i, j)| [i, j]).collect();
    let uploads = [
        Command::upload(PAIRS, &listed),
        Command::parameters(PARAMETERS, &[parameters]),
    ];
    let dispatch = Command::Dispatch {
        stage: STAGE,
        bindings: vec![
            Binding::parameters(PARAMETERS, 0),
            engine.hierarchy.nodes(),
            room.agenda(descent::AGENDAS[0]),
            room.tiles(descent::TILES),
            COUNTERS,
            engine.hierarchy.roots(),
            Binding::whole(PAIRS, size_of_val(&listed[..]) as u64),
        ],
        groups: pairs.len() as u32,
    };
    (uploads, dispatch)
}
