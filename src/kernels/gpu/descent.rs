//! From the node pairs to begin with to tiles, pairs of boxes at the bottom that may hold a crossing: level by level, all node
//! pairs of all curves side by side.

use super::boxes::{FAN, LEVEL, NODES_PROGRAM};
use super::commands::{Binding, Buffer, Command, Stage};
use super::layout::Parameters;
use super::{Engine, Room};

/// Threads of a workgroup.
pub(super) const THREADS: u32 = 64;

/// Counters: the node pairs of each level, and those that follow.
pub(super) const COUNTS: u32 = 64;
/// Tiles.
pub(super) const TILES_AT: u32 = 56;
/// Tests that single precision does not decide.
pub(super) const OPEN: u32 = 57;
/// Pairs of curves that a direction without any overlap proves to be unlinked.
pub(super) const SEPARATED: u32 = 58;
/// Tests, low half; the high one follows.
pub(super) const TESTS: u32 = 59;
/// Crossings, likewise.
pub(super) const CROSSINGS: u32 = 61;
/// What was gone through, of all lists: pairs of curves, node pairs and tiles.
pub(super) const DONE: u32 = 63;

/// Items at which a list is no longer counted, more than there can be room for; threads that have just looked add fewer
/// than it takes to come round to 0.
pub(super) const TOO_MANY: u32 = 1 << 31;

/// Where the axis is in the first word of a node pair.
pub(super) const AXIS: u32 = 30;

/// What all programs here know.
pub(super) const WORDS: [(&str, u32); 7] = [
    ("THREADS", THREADS),
    ("COUNTS", COUNTS),
    ("TILES", TILES_AT),
    ("DONE", DONE),
    ("TOO_MANY", TOO_MANY),
    ("AXIS", AXIS),
    ("LEVEL", LEVEL),
];

/// How lists are added to.
pub(super) const AGENDA_PROGRAM: &str = include_str!("agenda.wgsl");

/// The program.
pub(super) const STAGE: Stage = Stage {
    name: "descent",
    source: || {
        let mut whole = WORDS.to_vec();
        whole.push(("FAN", FAN));
        let parts = [NODES_PROGRAM, AGENDA_PROGRAM, include_str!("descent.wgsl")];
        super::program(&whole, &[], &parts)
    },
};

pub(super) const AGENDAS: [Buffer; 2] = [
    Buffer("agenda", STAGE.name),
    Buffer("next agenda", STAGE.name),
];
pub(super) const TILES: Buffer = Buffer("tiles", STAGE.name);
const PARAMETERS: Buffer = Buffer("parameters", STAGE.name);

/// What programs see of the counters.
pub(super) const COUNTERS: Binding = Binding {
    buffer: Buffer("counts", STAGE.name),
    offset: 0,
    size: 4 * COUNTS as u64,
};

/// What it takes to come from the node pairs to begin with to tiles: an upload, and what runs after it.
pub(super) fn descend(engine: &Engine, radius: f32, room: Room) -> (Command, Vec<Command>) {
    let steps = engine.hierarchy.levels().saturating_sub(1);
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
                engine.hierarchy.nodes(),
                room.agenda(to),
                room.tiles(TILES),
                COUNTERS,
                room.agenda(from),
            ],
            groups: engine.strides(),
        }
    };
    let upload = Command::parameters(PARAMETERS, &parameters);
    (upload, (0..steps).map(step).collect())
}
