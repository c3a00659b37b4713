//! A closed, twisted rod that coils up, as DNA does, and is relaxed by passing a strand through
//! itself, as a topoisomerase does. Publishes both edges of the ribbon on the bus.
//!
//! ```sh
//! linkwatch watch --service supercoil --events=all --abort-on never --record supercoil.mcap &
//! cargo run --release --example supercoil -- supercoil
//! linkwatch measure writhe supercoil.mcap --ribbon 0,1
//! ```
//!
//! Physics: overdamped motion of a ring of beads under stretching, bending, repulsion and twist.
//! The twist is spread evenly (Bergou et al. 2008), so its energy depends on the total twist alone,
//! `Tw = Lk - Wr`, and its force is that of the change of the writhe, which is local.

use linkwatch::{Basis, Client, ClientOptions, CurveSet, GaussIntegrals, Positions};
use linkwatch::{Outcome, Result};
use std::f64::consts::TAU;
use std::time::Duration;

type Vector = [f64; 3];

/// Number of beads, and their distance at rest.
const BEADS: usize = 96;
const REST: f64 = 1.0;
/// Linking number of the ribbon at the start: a flat ring with this number of turns of twist.
const TURNS: f64 = 6.0;
const BENDING: f64 = 8.0;
const TWISTING: f64 = 40.0;
const STRETCHING: f64 = 60.0;
/// Diameter of the rod, and half the width of the ribbon.
const DIAMETER: f64 = 2.2;
const HALF_WIDTH: f64 = 0.4;
const STEP: f64 = 2e-3;
const STEPS_PER_FRAME: usize = 100;
const FRAMES: usize = 160;
/// Frame in which a strand is passed through another one.
const PASSAGE: usize = 100;

fn zip(a: Vector, b: Vector, f: impl Fn(f64, f64) -> f64) -> Vector {
    [f(a[0], b[0]), f(a[1], b[1]), f(a[2], b[2])]
}

fn add(a: Vector, t: f64, b: Vector) -> Vector {
    zip(a, b, |x, y| x + t * y)
}

fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: Vector, b: Vector) -> Vector {
    [(1, 2), (2, 0), (0, 1)].map(|(x, y)| a[x] * b[y] - a[y] * b[x])
}

fn unit(a: Vector) -> Vector {
    let length = dot(a, a).sqrt();
    a.map(|x| x / length)
}

struct Rod {
    x: Vec<Vector>,
    writhe: f64,
    /// Twist of the ribbon, in turns. It changes continuously, even if the writhe jumps.
    twist: f64,
}

impl Rod {
    fn new() -> Result<Rod> {
        let radius = BEADS as f64 * REST / TAU;
        let bead = |k: usize| {
            let t = TAU * k as f64 / BEADS as f64;
            // Slightly bent out of the plane, so that it coils up.
            [
                radius * t.cos(),
                radius * t.sin(),
                0.3 * (2.0 * t).sin() + 0.1 * (3.0 * t).cos(),
            ]
        };
        let x: Vec<Vector> = (0..BEADS).map(bead).collect();
        let writhe = writhe(&x)?;
        let twist = TURNS - writhe;
        Ok(Rod { x, writhe, twist })
    }

    fn edge(&self, k: usize) -> Vector {
        add(self.x[(k + 1) % BEADS], -1.0, self.x[k % BEADS])
    }

    /// Moves all beads along the forces.
    fn advance(&mut self) -> Result<()> {
        let mut force = vec![[0.0; 3]; BEADS];
        let mut push = |k: usize, t: f64, f: Vector| force[k % BEADS] = add(force[k % BEADS], t, f);
        // The torque is the same everywhere.
        let torque = TWISTING * TAU * self.twist / (BEADS as f64 * REST);
        for k in 0..BEADS {
            let (e, f) = (self.edge(k), self.edge(k + 1));
            let (le, lf) = (dot(e, e).sqrt(), dot(f, f).sqrt());
            let pull = STRETCHING * (le - REST) / le;
            push(k, pull, e);
            push(k + 1, -pull, e);
            // Bending: the second difference, which is 0 for a straight rod.
            let bend = add(f, -1.0, e);
            push(k, -BENDING, bend);
            push(k + 1, 2.0 * BENDING, bend);
            push(k + 2, -BENDING, bend);
            // Twist: the gradient of 2 pi Wr at a corner (Bergou et al. 2008, equation 9). A larger
            // writhe has less twist.
            let binormal = cross(e, f).map(|x| 2.0 * x / (le * lf + dot(e, f)));
            let (back, ahead) = (0.5 / le, 0.5 / lf);
            push(k, torque * back, binormal);
            push(k + 1, torque * (ahead - back), binormal);
            push(k + 2, -torque * ahead, binormal);
        }
        for i in 0..BEADS {
            for j in i + 4..BEADS.min(BEADS + i - 3) {
                let r = add(self.x[j], -1.0, self.x[i]);
                let distance = dot(r, r).sqrt();
                if distance < DIAMETER {
                    let f = 200.0 * (DIAMETER - distance) / distance;
                    push(i, -f, r);
                    push(j, f, r);
                }
            }
        }
        for (x, f) in self.x.iter_mut().zip(force) {
            *x = add(*x, STEP, f);
        }
        self.follow()
    }

    /// Updates the twist. A passage of the rod through itself changes the writhe by 2 at once, and
    /// the twist not at all: so it is Lk that changes.
    fn follow(&mut self) -> Result<()> {
        let writhe = writhe(&self.x)?;
        let change = writhe - self.writhe;
        self.twist -= change - 2.0 * (0.5 * change).round();
        self.writhe = writhe;
        Ok(())
    }

    /// Passes the rod through itself where it comes closest, in one frame. Returns both beads.
    fn pass(&mut self) -> Result<(usize, usize)> {
        let mut nearest = (f64::INFINITY, 0, 0);
        for i in 0..BEADS {
            for j in i + 12..BEADS.min(BEADS + i - 11) {
                let r = add(self.x[j], -1.0, self.x[i]);
                if dot(r, r) < nearest.0 {
                    nearest = (dot(r, r), i, j);
                }
            }
        }
        let (_, i, j) = nearest;
        let way = add(self.x[j], -1.0, self.x[i]);
        for k in 0..BEADS {
            let apart = i.abs_diff(k).min(BEADS - i.abs_diff(k)) as f64;
            let share = (1.0 - (apart / 6.0).powi(2)).max(0.0);
            self.x[k] = add(self.x[k], 2.2 * share * share, way);
        }
        self.follow()?;
        Ok((i, j))
    }

    /// Returns the edges of the ribbon. Its direction is transported along the rod and turns
    /// evenly, so that it is closed after one round.
    fn edges(&self) -> Vec<f32> {
        let tangent = |k: usize| unit(add(unit(self.edge(k)), 1.0, unit(self.edge(k + BEADS - 1))));
        let mut normal = unit(cross(tangent(0), [0.1, 0.2, 1.0]));
        let start = normal;
        let mut normals = Vec::new();
        for k in 0..=BEADS {
            let t = tangent(k % BEADS);
            normal = unit(add(normal, -dot(normal, t), t));
            normals.push((t, normal));
        }
        // Angle between the transported direction and the first one, plus the turns of the twist:
        // spread evenly along the rod, it closes the ribbon.
        let (t, last) = normals[BEADS];
        let gap = dot(t, cross(last, start)).atan2(dot(last, start));
        let turn = gap + TAU * (self.twist - gap / TAU).round();
        let sides = [HALF_WIDTH, -HALF_WIDTH].map(|side| {
            let vertex = |k: usize| {
                let (t, normal) = normals[k];
                let (s, c) = (turn * k as f64 / BEADS as f64).sin_cos();
                let across = add(normal.map(|x| c * x), s, cross(t, normal));
                add(self.x[k], side, across).map(|x| x as f32)
            };
            (0..BEADS).map(vertex).collect::<Vec<_>>()
        });
        sides.concat().concat()
    }
}

fn writhe(x: &[Vector]) -> Result<f64> {
    let positions = Positions::F64(x.as_flattened());
    let rod = CurveSet::from_counts(Basis::Polyline, &[-(x.len() as i32)], positions)?;
    Ok(GaussIntegrals::new(&rod)?.writhe(0, 1e-6).value)
}

fn main() -> Result<()> {
    let service = std::env::args().nth(1).unwrap_or("supercoil".into());
    let mut client = Client::open(&service, &ClientOptions::lockstep())?;
    let strand = -(BEADS as i32);
    client.describe(
        Basis::Polyline,
        linkwatch::Precision::F32,
        &[strand, strand],
    )?;
    if !client.wait_for_watcher(Duration::from_secs(30))? {
        println!("no watcher of {service}: frames go unchecked");
    }
    let mut rod = Rod::new()?;
    for frame in 0..FRAMES {
        if frame == PASSAGE {
            let (i, j) = rod.pass()?;
            println!("frame {frame}: passed the rod at bead {i} through bead {j}");
        } else if frame > 0 {
            for _ in 0..STEPS_PER_FRAME {
                rod.advance()?;
            }
        }
        let seq = client.publish(frame as f64, Positions::F32(&rod.edges()))?;
        if let Outcome::Verdict(verdict) = client.wait(seq, Duration::from_secs(10))? {
            let (wr, tw) = (rod.writhe, rod.twist);
            if frame % 20 == 0 || verdict.abort || frame == PASSAGE {
                println!(
                    "frame {frame}: Wr {wr:.3}, Tw {tw:.3}, Lk {:.3}; {verdict}",
                    wr + tw
                );
            }
        }
    }
    client.finish().map(drop)
}
