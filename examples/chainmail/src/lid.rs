//! The lid: a plate that moves down after the falling sheet and packs it.

use crate::scene::{
    CONNECTOR_RADIUS, FLAT_RADIUS, FRICTION, HALF_THICKNESS, Options, WALL_LEAN, WIRE_RADIUS,
};
use rapier3d::prelude::*;
use std::f32::consts::TAU;

/// Seconds at which the lid begins and ends to move. It stays above the falling sheet, and meets it
/// when it lies in the box.
const LID_TIMES: [f32; 2] = [0.0, 3.8];

/// Share of the volume below the lid at its end that the wire fills.
const PACKED_SHARE: f32 = 0.15;

/// A plate that moves downwards.
#[derive(Clone, Copy)]
pub struct Lid {
    /// Body of the plate.
    pub body: RigidBodyHandle,
    /// Heights of its lower face at [`LID_TIMES`].
    pub heights: [f32; 2],
}

impl Lid {
    /// Returns the place of its body at this time.
    pub fn translation(&self, time: f32) -> Vector {
        let [start, end] = LID_TIMES;
        let share = ((time - start) / (end - start)).clamp(0.0, 1.0);
        let height = self.heights[0] + share * (self.heights[1] - self.heights[0]);
        Vector::new(0.0, height + HALF_THICKNESS, 0.0)
    }
}

/// Inserts the lid. It passes through the walls, because neither moves by forces.
pub fn insert_lid(world: &mut PhysicsWorld, half_width: f32, heights: [f32; 2]) -> Lid {
    let body = RigidBodyBuilder::kinematic_position_based();
    let collider = ColliderBuilder::cuboid(half_width, HALF_THICKNESS, half_width);
    let (body, _) = world.insert(body, collider.friction(FRICTION));
    let lid = Lid { body, heights };
    let place = lid.translation(0.0);
    world.bodies[body].set_translation(place, true);
    lid
}

/// Returns the height of the lid above the floor at its end.
pub fn packed_height(options: &Options, half_floor: f32) -> f32 {
    let (rows, columns) = (options.rows as f32, options.columns as f32);
    let connectors = rows * (columns - 1.0) + (rows - 1.0) * columns;
    let length = TAU * (rows * columns * FLAT_RADIUS + connectors * CONNECTOR_RADIUS);
    let volume = length * 0.5 * TAU * WIRE_RADIUS.powi(2) / PACKED_SHARE;
    // The box is a part of a pyramid: its volume up to the height h is
    // 4 / (3 tan) ((half_floor + h tan)^3 - half_floor^3).
    let tan = WALL_LEAN.tan();
    ((half_floor.powi(3) + 0.75 * tan * volume).cbrt() - half_floor) / tan
}
