//! Descent from the initial node pairs to tiles: pairs of boxes of the lowest level that may
//! contain a crossing. Level by level, the node pairs of all curves in parallel.

use super::boxes::{FAN, LEVEL, NODES_SHADER};
use super::commands::{Binding, Buffer, Command, Stage};
use super::layout::{Parameters, named};
use super::{Capacity, State, counters};

/// Threads of a workgroup.
pub(super) const THREADS: u32 = 64;

/// Position of the axis in the first word of a node pair.
pub(super) const AXIS: u32 = 30;

/// Returns the constants of all shaders of the crossing kernel.
pub(super) fn constants() -> Vec<(&'static str, u32)> {
    [&named![THREADS, AXIS, LEVEL][..], &counters::NAMES].concat()
}

/// Shader code that appends to the lists.
pub(super) const AGENDA_SHADER: &str = include_str!("agenda.wgsl");

/// The shader that descends by one level.
pub(super) const STAGE: Stage = Stage {
    name: "descent",
    source: || {
        let mut whole = constants();
        whole.push(("FAN", FAN));
        let parts = [NODES_SHADER, AGENDA_SHADER, include_str!("descent.wgsl")];
        super::shader::<f32>(&whole, &[], &parts)
    },
};

pub(super) const AGENDAS: [Buffer; 2] = [
    Buffer("agenda", STAGE.name),
    Buffer("next agenda", STAGE.name),
];
pub(super) const TILES: Buffer = Buffer("tiles", STAGE.name);
const PARAMETERS: Buffer = Buffer("parameters", STAGE.name);

/// Binding of the counters.
pub(super) const COUNTERS: Binding = counters::binding(STAGE.name);

/// Returns the commands that descend from the initial node pairs to tiles: an upload, and the
/// dispatches that follow it.
pub(super) fn descend(state: &State, radius: f32, capacity: Capacity) -> (Command, Vec<Command>) {
    let steps = state.hierarchy.levels().saturating_sub(1);
    let parameters = (0..steps).map(|step| Parameters::new(radius, 0, step));
    let step = |step: u32| {
        let from = step as usize % 2;
        Command::Dispatch {
            stage: STAGE,
            bindings: vec![
                Binding::parameters(PARAMETERS, step),
                state.hierarchy.nodes(),
                capacity.agenda(AGENDAS[1 - from]),
                capacity.tiles(TILES),
                COUNTERS,
                capacity.agenda(AGENDAS[from]),
            ],
            groups: state.strides(),
        }
    };
    let upload = Command::parameters(PARAMETERS, parameters);
    (upload, (0..steps).map(step).collect())
}
