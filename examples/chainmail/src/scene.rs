//! A sheet of chainmail that is dropped into an open box and crumples there.
//!
//! This module is a plain rigid-body simulator built on `rapier3d`. It builds the scene, advances
//! it and returns the centre lines of the rings. It does not check their topology.
//!
//! # The scene
//!
//! The sheet is Japanese 4-in-1 mail: flat rings lie on a square grid, and an upright, somewhat
//! smaller connector ring passes through each two neighbours of the grid. A sheet of `rows` times
//! `columns` flat rings has `rows * (columns - 1) + (rows - 1) * columns` connectors, each of
//! which is linked with exactly two flat rings.
//!
//! Every ring is one rigid body whose collider is a compound of [`VERTICES_PER_RING`] capsules
//! laid along a regular polygon. [`Sheet::write_positions`] writes the corners of the very same
//! polygon, so a viewer sees exactly what collides.
//!
//! The box stands open at the top and has a small floor and four walls that lean outwards. Its rim
//! is just wide enough for the flat sheet. The edges of the sheet touch the walls first, the middle
//! keeps falling, and the sheet is drawn together, folds over itself and ends as a heap. The sheet
//! is turned a little about the vertical so that it does not fall symmetrically.
//!
//! With [`Options::lid`], a plate moves down after the sheet and presses it into the lower part of
//! the box.
//!
//! # Time steps
//!
//! All settings of the solver are rapier's defaults, except that its continuous collision
//! detection is off. A frame is advanced by as many equal time steps as the caller asks for. With
//! a whole frame in one step, a wire moves by more than its own thickness in a step, which is too
//! much for a solver that looks at contacts only once a step: rings slip through one another.
//! Nothing else in the scene breaks them.

use std::f32::consts::{FRAC_PI_2, TAU};

use crate::lid::{Lid, insert_lid, packed_height};
use rapier3d::prelude::*;
use sidecar::Scene;

/// Corners of a ring's centre line, and capsules of its collider.
pub const VERTICES_PER_RING: usize = 12;

/// Radius of the wire that the rings are bent from.
pub const WIRE_RADIUS: f32 = 0.14;

/// The length of a frame that the scene is made for, in seconds.
pub const FRAME_DT: f32 = 1.0 / 30.0;

/// The number of frames after which the default sheet has come to lie in the box.
pub const FRAMES: usize = 72;

/// Radius of the centre line of a flat ring (to the corners of the polygon).
pub const FLAT_RADIUS: f32 = 1.0;

/// Radius of the centre line of a connector ring.
pub const CONNECTOR_RADIUS: f32 = 0.75;

/// Distance between the centres of neighbouring flat rings.
const PITCH: f32 = 2.4;

/// The number of frames after which the lid has packed the default sheet.
pub const PACKED_FRAMES: usize = 120;

/// Distance between the centres of a flat ring and a connector from which on a person sees that
/// they are not linked: there is a gap between them, as wide as a wire is thick.
const TORN: f32 = FLAT_RADIUS + CONNECTOR_RADIUS + 4.0 * WIRE_RADIUS;

/// Half the width of the box's floor, as a part of half the width of the sheet.
const FLOOR_RATIO: f32 = 0.31;

/// Half the width of the box at its rim, as a part of half the width of the sheet.
const RIM_RATIO: f32 = 1.08;

/// Angle from the vertical by which the walls lean outwards.
pub const WALL_LEAN: f32 = 34.0 * TAU / 360.0;

/// Half the thickness of the floor and the walls: far more than any motion in a step.
pub const HALF_THICKNESS: f32 = 10.0;

/// Angle by which the sheet is turned about the vertical.
const YAW: f32 = 0.08;

/// Coulomb friction, of the rings as of the box.
pub const FRICTION: f32 = 0.2;

/// Damping of the rings' spin, in 1/s.
const ANGULAR_DAMPING: f32 = 0.5;

/// Parameters of a [`Sheet`].
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Number of rows of flat rings.
    pub rows: usize,
    /// Number of columns of flat rings.
    pub columns: usize,
    /// Downward acceleration, in units of length per second squared. The outer radius of a flat
    /// ring is about 1.
    pub gravity: f32,
    /// Height of the flat sheet above the rim of the box at the start.
    pub drop_height: f32,
    /// True if a lid then packs the sheet: it moves down from the rim and presses the sheet into
    /// the lower part of the box.
    pub lid: bool,
}

impl Default for Options {
    /// 1,045 rings: 361 flat ones and 684 connectors.
    fn default() -> Self {
        Options {
            rows: 19,
            columns: 19,
            gravity: 16.0,
            drop_height: 1.0,
            lid: false,
        }
    }
}

/// One ring: its body, and the polygon of its centre line in the frame of the body.
#[derive(Clone)]
struct Ring {
    body: RigidBodyHandle,
    polygon: [Vector; VERTICES_PER_RING],
}

/// The chainmail sheet, the box, and the physics world in which they meet.
pub struct Sheet {
    world: PhysicsWorld,
    rings: Vec<Ring>,
    /// Links of the construction: a flat ring and a connector.
    links: Vec<[usize; 2]>,
    lid: Option<Lid>,
    /// Seconds since the start.
    time: f32,
}

impl Sheet {
    /// Builds the sheet, flat and at rest, above the open box.
    pub fn new(options: &Options) -> Sheet {
        let mut world = PhysicsWorld::new();
        world.gravity = Vector::new(0.0, -options.gravity, 0.0);
        // The walls are thick enough to need no continuous collision detection.
        world.integration_parameters.max_ccd_substeps = 0;

        let longer = options.rows.max(options.columns) as f32;
        let half_sheet = 0.5 * (longer - 1.0) * PITCH + FLAT_RADIUS + WIRE_RADIUS;
        let rim_height = insert_box(&mut world, FLOOR_RATIO * half_sheet, RIM_RATIO * half_sheet);

        let lid = options.lid.then(|| {
            // High enough that the flat sheet is below it.
            let clear = rim_height + options.drop_height + 2.0 * FLAT_RADIUS;
            let packed = packed_height(options, FLOOR_RATIO * half_sheet);
            insert_lid(&mut world, RIM_RATIO * half_sheet, [clear, packed])
        });
        let mut sheet = Sheet {
            world,
            rings: Vec::new(),
            links: Vec::new(),
            lid,
            time: 0.0,
        };
        sheet.insert_rings(options, rim_height + options.drop_height);
        sheet
    }

    /// Returns the number of rings.
    pub fn rings(&self) -> usize {
        self.rings.len()
    }

    /// Returns the number of corners of each ring's centre line, a closed polygon.
    pub fn vertices_per_ring() -> usize {
        VERTICES_PER_RING
    }

    /// Advances the scene by one frame of `frame_dt` seconds, in `substeps` equal time steps.
    pub fn step(&mut self, frame_dt: f32, substeps: usize) {
        let dt = frame_dt / substeps as f32;
        self.world.integration_parameters.dt = dt;
        for _ in 0..substeps {
            self.time += dt;
            if let Some(lid) = self.lid {
                let place = lid.translation(self.time);
                self.world.bodies[lid.body].set_next_kinematic_translation(place);
            }
            self.world.step();
        }
    }

    /// Returns the number of links of the construction whose rings are so far apart that a person
    /// sees it.
    pub fn torn(&self) -> usize {
        let center = |ring: usize| self.world.bodies[self.rings[ring].body].translation();
        let far = |&&[a, b]: &&[usize; 2]| (center(a) - center(b)).length() > TORN;
        self.links.iter().filter(far).count()
    }

    /// Writes the corners of all centre lines in world space: x, y, z of each corner in turn, ring
    /// after ring. The z axis points up, as viewers have it.
    ///
    /// # Panics
    ///
    /// Panics unless `out` holds exactly `3 * rings() * vertices_per_ring()` numbers.
    pub fn write_positions(&self, out: &mut [f32]) {
        assert_eq!(out.len(), 3 * VERTICES_PER_RING * self.rings.len());
        for (ring, out) in self
            .rings
            .iter()
            .zip(out.chunks_exact_mut(3 * VERTICES_PER_RING))
        {
            let pose = self.world.bodies[ring.body].position();
            for (corner, out) in ring.polygon.iter().zip(out.chunks_exact_mut(3)) {
                // The world of the simulation has its y axis upwards.
                let [x, y, z] = pose.transform_point(*corner).to_array();
                out.copy_from_slice(&[x, -z, y]);
            }
        }
    }

    /// Inserts all rings of a sheet that lies flat at height `y`.
    fn insert_rings(&mut self, options: &Options, y: f32) {
        let (rows, columns) = (options.rows, options.columns);
        let sheet = Pose::from_parts(Vector::new(0.0, y, 0.0), Rotation::from_rotation_y(YAW));
        // The middle of the sheet is the origin of its frame; connectors are at half-integer
        // places.
        let place = |row: f32, column: f32| {
            Vector::new(
                (column - 0.5 * (columns as f32 - 1.0)) * PITCH,
                0.0,
                (row - 0.5 * (rows as f32 - 1.0)) * PITCH,
            )
        };
        // The polygon of a ring lies in the x-z plane of its body.
        let upright_along_x = Rotation::from_rotation_x(FRAC_PI_2);
        let upright_along_z = Rotation::from_rotation_z(FRAC_PI_2);

        let flat = RingShape::new(FLAT_RADIUS);
        let connector = RingShape::new(CONNECTOR_RADIUS);
        // Numbers of the flat rings, and each connector with the places of its two flat rings.
        let (mut flat_rings, mut joins) = (Vec::new(), Vec::new());
        for row in 0..rows {
            for column in 0..columns {
                let (r, c) = (row as f32, column as f32);
                let here = self.insert_ring(&flat, sheet * Pose::from_translation(place(r, c)));
                flat_rings.push(here);
                if column + 1 < columns {
                    let pose = Pose::from_parts(place(r, c + 0.5), upright_along_x);
                    let ring = self.insert_ring(&connector, sheet * pose);
                    joins.push([ring, row * columns + column, row * columns + column + 1]);
                }
                if row + 1 < rows {
                    let pose = Pose::from_parts(place(r + 0.5, c), upright_along_z);
                    let ring = self.insert_ring(&connector, sheet * pose);
                    joins.push([ring, row * columns + column, (row + 1) * columns + column]);
                }
            }
        }
        for [ring, a, b] in joins {
            self.links
                .extend([[flat_rings[a], ring], [flat_rings[b], ring]]);
        }
    }

    /// Inserts a ring. Returns its number.
    fn insert_ring(&mut self, shape: &RingShape, pose: Pose) -> usize {
        let body = RigidBodyBuilder::dynamic()
            .pose(pose)
            .angular_damping(ANGULAR_DAMPING)
            .can_sleep(false);
        let collider = ColliderBuilder::new(shape.collider.clone()).friction(FRICTION);
        let (body, _) = self.world.insert(body, collider);
        self.rings.push(Ring {
            body,
            polygon: shape.polygon,
        });
        self.rings.len() - 1
    }
}

impl Scene for Sheet {
    fn advance(&mut self, steps: usize) {
        self.step(FRAME_DT, steps);
    }

    fn write_positions(&self, out: &mut [f32]) {
        Sheet::write_positions(self, out);
    }
}

impl Clone for Sheet {
    /// Copies the state of the world. The workspaces of rapier start empty.
    fn clone(&self) -> Sheet {
        let world = &self.world;
        Sheet {
            world: PhysicsWorld {
                gravity: world.gravity,
                integration_parameters: world.integration_parameters,
                islands: world.islands.clone(),
                broad_phase: world.broad_phase.clone(),
                narrow_phase: world.narrow_phase.clone(),
                bodies: world.bodies.clone(),
                colliders: world.colliders.clone(),
                impulse_joints: world.impulse_joints.clone(),
                multibody_joints: world.multibody_joints.clone(),
                ..PhysicsWorld::new()
            },
            rings: self.rings.clone(),
            links: self.links.clone(),
            lid: self.lid,
            time: self.time,
        }
    }
}

/// Properties of all rings of one size.
struct RingShape {
    polygon: [Vector; VERTICES_PER_RING],
    collider: SharedShape,
}

impl RingShape {
    fn new(radius: f32) -> RingShape {
        let polygon: [Vector; VERTICES_PER_RING] = std::array::from_fn(|k| {
            let (sin, cos) = ((k as f32 + 0.5) / VERTICES_PER_RING as f32 * TAU).sin_cos();
            Vector::new(radius * cos, 0.0, radius * sin)
        });
        let capsules = (0..VERTICES_PER_RING)
            .map(|k| {
                let next = (k + 1) % VERTICES_PER_RING;
                let capsule = SharedShape::capsule(polygon[k], polygon[next], WIRE_RADIUS);
                (Pose::IDENTITY, capsule)
            })
            .collect();
        RingShape {
            polygon,
            collider: SharedShape::compound(capsules),
        }
    }
}

/// Inserts a box of cuboids, open at the top, whose floor is at height 0. The arguments are half
/// its inner widths at the floor and at the rim; the result is the height of the rim.
fn insert_box(world: &mut PhysicsWorld, half_floor: f32, half_rim: f32) -> f32 {
    let mut insert = |pose: Pose, half_extents: Vector| {
        let [x, y, z] = half_extents.to_array();
        let collider = ColliderBuilder::cuboid(x, y, z).friction(FRICTION);
        world.insert(RigidBodyBuilder::fixed().pose(pose), collider);
    };
    let reach = half_rim + 2.0 * HALF_THICKNESS;
    insert(
        Pose::from_translation(Vector::new(0.0, -HALF_THICKNESS, 0.0)),
        Vector::new(reach, HALF_THICKNESS, reach),
    );

    let rim_height = (half_rim - half_floor) / WALL_LEAN.tan();
    let half_length = 0.5 * rim_height / WALL_LEAN.cos();
    for quarter_turns in 0..4 {
        let yaw = Rotation::from_rotation_y(quarter_turns as f32 * FRAC_PI_2);
        // The foot of the wall's inner face, leaning outwards from there.
        let foot = Pose::from_parts(
            yaw * Vector::new(half_floor, 0.0, 0.0),
            yaw * Rotation::from_rotation_z(-WALL_LEAN),
        );
        insert(
            foot * Pose::from_translation(Vector::new(HALF_THICKNESS, half_length, 0.0)),
            Vector::new(HALF_THICKNESS, half_length, reach),
        );
    }
    rim_height
}

#[cfg(test)]
mod tests {
    use super::*;

    fn packed(side: usize) -> Sheet {
        Sheet::new(&Options {
            rows: side,
            columns: side,
            lid: true,
            ..Options::default()
        })
    }

    fn positions(sheet: &Sheet) -> Vec<f32> {
        let mut positions = vec![0.0; 3 * VERTICES_PER_RING * sheet.rings()];
        sheet.write_positions(&mut positions);
        positions
    }

    /// Rolling back requires this.
    #[test]
    fn a_copy_of_a_sheet_moves_as_the_sheet_does() {
        let mut sheet = packed(4);
        // In contact with the box and with each other.
        (0..50).for_each(|_| sheet.advance(2));
        let mut copy = sheet.clone();
        (0..10).for_each(|_| sheet.advance(3));
        (0..10).for_each(|_| copy.advance(3));
        assert_eq!(positions(&sheet), positions(&copy));
    }

    #[test]
    fn the_lid_presses_the_sheet_to_its_height() {
        let mut sheet = packed(6);
        (0..PACKED_FRAMES).for_each(|_| sheet.advance(8));
        let highest = positions(&sheet).into_iter().skip(2).step_by(3);
        let highest = highest.fold(0.0, f32::max);
        let lid = sheet.lid.unwrap().heights[1];
        assert!(
            highest < lid && highest > 0.7 * lid,
            "{highest} below the lid at {lid}"
        );
        assert_eq!(sheet.torn(), 0);
    }

    #[test]
    fn a_link_is_torn_only_if_there_is_a_gap() {
        let mut sheet = packed(2);
        assert_eq!((sheet.links.len(), sheet.torn()), (8, 0));
        let connector = sheet.rings[sheet.links[0][1]].body;
        let far = Vector::new(0.0, 50.0, 0.0);
        sheet.world.bodies[connector].set_translation(far, true);
        assert_eq!(sheet.torn(), 2);
    }
}
