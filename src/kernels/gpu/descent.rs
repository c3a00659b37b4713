//! Descent from the initial node pairs to tiles: pairs of boxes of the lowest level that may
//! contain a crossing. Level by level, the node pairs of all curves in parallel.

use super::boxes::{FAN, LEVEL, NODES_SHADER};
use super::commands::{Binding, Buffer, Command, Stage};
use super::layout::Parameters;
use super::{Capacity, State};

/// Threads of a workgroup.
pub(super) const THREADS: u32 = 64;

/// Number of counters: the node pairs of each level, then the counters below.
pub(super) const COUNTS: u32 = 64;
/// Counter of tiles.
pub(super) const TILES_AT: u32 = 56;
/// Counter of tests that single precision does not decide.
pub(super) const OPEN: u32 = 57;
/// Counter of the pairs of curves that do not overlap in some direction, and so are not linked.
pub(super) const SEPARATED: u32 = 58;
/// Counter of tests: low half; the high half follows.
pub(super) const TESTS: u32 = 59;
/// Counter of crossings: low half; the high half follows.
pub(super) const CROSSINGS: u32 = 61;
/// Counter of processed items of all lists: pairs of curves, node pairs and tiles.
pub(super) const DONE: u32 = 63;

/// A list counter that has reached this value is not incremented any more. The value is above every
/// capacity, and threads that have read a smaller value just before add less than would make the
/// counter wrap to 0.
pub(super) const TOO_MANY: u32 = 1 << 31;

/// Position of the axis in the first word of a node pair.
pub(super) const AXIS: u32 = 30;

/// Constants of all shaders of the crossing kernel.
pub(super) const WORDS: [(&str, u32); 7] = [
    ("THREADS", THREADS),
    ("COUNTS", COUNTS),
    ("TILES", TILES_AT),
    ("DONE", DONE),
    ("TOO_MANY", TOO_MANY),
    ("AXIS", AXIS),
    ("LEVEL", LEVEL),
];

/// Shader code that appends to the lists.
pub(super) const AGENDA_SHADER: &str = include_str!("agenda.wgsl");

/// The shader that descends by one level.
pub(super) const STAGE: Stage = Stage {
    name: "descent",
    source: || {
        let mut whole = WORDS.to_vec();
        whole.push(("FAN", FAN));
        let parts = [NODES_SHADER, AGENDA_SHADER, include_str!("descent.wgsl")];
        super::shader(&whole, &[], &parts)
    },
};

pub(super) const AGENDAS: [Buffer; 2] = [
    Buffer("agenda", STAGE.name),
    Buffer("next agenda", STAGE.name),
];
pub(super) const TILES: Buffer = Buffer("tiles", STAGE.name);
const PARAMETERS: Buffer = Buffer("parameters", STAGE.name);

/// Binding of the counters.
pub(super) const COUNTERS: Binding = Binding {
    buffer: Buffer("counts", STAGE.name),
    offset: 0,
    size: 4 * COUNTS as u64,
};

/// Returns the commands that descend from the initial node pairs to tiles: an upload, and the
/// dispatches that follow it.
pub(super) fn descend(state: &State, radius: f32, capacity: Capacity) -> (Command, Vec<Command>) {
    let steps = state.hierarchy.levels().saturating_sub(1);
    let parameters: Vec<Parameters> = (0..steps)
        .map(|step| Parameters {
            radius,
            zero: 0,
            first: 0,
            items: step,
        })
        .collect();
    let step = |step: u32| {
        let [from, to] = match step % 2 {
            0 => AGENDAS,
            _ => [AGENDAS[1], AGENDAS[0]],
        };
        Command::Dispatch {
            stage: STAGE,
            bindings: vec![
                Binding::parameters(PARAMETERS, step),
                state.hierarchy.nodes(),
                capacity.agenda(to),
                capacity.tiles(TILES),
                COUNTERS,
                capacity.agenda(from),
            ],
            groups: state.strides(),
        }
    };
    let upload = Command::parameters(PARAMETERS, &parameters);
    (upload, (0..steps).map(step).collect())
}
