//! Choice of the direction of projection for every pair of curves, and its initial node pairs. Each
//! pair of curves has a workgroup.
//!
//! All pairs of roots of both curves, 256 at most, are tested in all six directions. The direction
//! with the fewest remaining node pairs is chosen. If none remain, the linking number is 0.

use super::boxes::{NODES_SHADER, ROOTS};
use super::commands::{Binding, Buffer, Command, Stage};
use super::descent::{self, AGENDA_SHADER, COUNTERS, THREADS};
use super::layout::Parameters;
use super::{Capacity, State};
use crate::pairs::Pair;

/// Number of node pairs of a thread.
const SHARE: u32 = (ROOTS * ROOTS).div_ceil(THREADS);

/// The shader that chooses the directions.
pub(super) const STAGE: Stage = Stage {
    name: "directions",
    source: || {
        let mut whole = descent::constants();
        whole.push(("SHARE", SHARE));
        let parts = [NODES_SHADER, AGENDA_SHADER, include_str!("directions.wgsl")];
        super::shader::<f32>(&whole, &[], &parts)
    },
};

const PAIRS: Buffer = Buffer("pairs", STAGE.name);
const PARAMETERS: Buffer = Buffer("parameters", STAGE.name);

/// Returns the commands that choose the directions of some pairs: the uploads, and the dispatch
/// that follows them.
pub(super) fn choose(
    state: &State,
    radius: f32,
    pairs: &[Pair],
    capacity: Capacity,
) -> ([Command; 2], Command) {
    let parameters = Parameters::new(radius, 0, pairs.len() as u32);
    let listed: Vec<[u32; 2]> = pairs.iter().map(|&(i, j)| [i, j]).collect();
    let uploads = [
        Command::upload(PAIRS, &listed),
        Command::parameters(PARAMETERS, [parameters]),
    ];
    let dispatch = Command::Dispatch {
        stage: STAGE,
        bindings: vec![
            Binding::parameters(PARAMETERS, 0),
            state.hierarchy.nodes(),
            capacity.agenda(descent::AGENDAS[0]),
            capacity.tiles(descent::TILES),
            COUNTERS,
            state.hierarchy.roots(),
            Binding::whole(PAIRS, size_of_val(&listed[..]) as u64),
        ],
        groups: pairs.len() as u32,
    };
    (uploads, dispatch)
}
