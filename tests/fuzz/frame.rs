//! Valid frames: chains of square rings with known linking numbers, in every basis and precision.

use super::support::random::Random;
use super::support::raw_bus::Header;

/// Half the side of a ring.
const HALF: f64 = 12.0;
/// Numbers of points per side of a ring with which neighbours are linked, for each basis.
const SIDES: [&[usize]; 4] = [&[1, 2, 3, 4, 6], &[2, 3, 4, 6], &[2, 3, 4, 6], &[3, 6]];

/// Header and payload of a frame.
#[derive(Clone)]
pub struct Frame {
    pub header: Header,
    pub payload: Vec<u8>,
}

/// Content of a frame, from which its bytes are made.
#[derive(Clone)]
pub struct Scene {
    /// Code of the basis.
    pub basis: u32,
    pub double: bool,
    pub named: bool,
    pub radii: bool,
    pub curves: Vec<Loop>,
}

#[derive(Clone)]
pub struct Loop {
    pub closed: bool,
    /// Place of a ring in the chain.
    pub place: usize,
    pub name: String,
    pub radius: f32,
    pub points: Vec<[f64; 3]>,
}

impl Scene {
    /// Creates a chain of linked rings, and sometimes an open curve far from it.
    pub fn random(random: &mut Random) -> Scene {
        let basis = random.below(4_usize);
        let side = random.pick(SIDES[basis]);
        let mut curves: Vec<Loop> = (0..2 + random.below(4_usize))
            .map(|k| Loop {
                closed: true,
                place: k,
                name: format!("ring/{k}"),
                radius: random.below(100) as f32 / 8.0,
                points: ring(k, side),
            })
            .collect();
        if random.one_in(3) {
            let points = random.pick(&[4, 7]);
            let points = (0..points).map(|k| [f64::from(k), 500.0, 0.0]).collect();
            let at = random.below(curves.len() + 1);
            curves.insert(
                at,
                Loop {
                    closed: false,
                    place: usize::MAX,
                    name: "\u{e9}nd".into(),
                    radius: 0.0,
                    points,
                },
            );
        }
        Scene {
            basis: basis as u32,
            double: random.one_in(2),
            named: random.one_in(2),
            radii: random.one_in(3),
            curves,
        }
    }

    /// Returns the scene with each curve displaced a little, so that all links remain.
    pub fn moved(&self, random: &mut Random) -> Scene {
        let mut scene = self.clone();
        for curve in &mut scene.curves {
            let by = [(); 3].map(|()| f64::from(random.below(5_u32)) - 2.0);
            curve.displace(by);
        }
        scene
    }

    /// Returns the indices of the closed curves.
    pub fn rings(&self) -> Vec<usize> {
        let closed = |&i: &usize| self.curves[i].closed;
        (0..self.curves.len()).filter(closed).collect()
    }

    /// Returns true if ring `i` is linked with another one.
    pub fn is_linked(&self, i: usize) -> bool {
        let place = self.curves[i].place;
        let mut others = self.rings().into_iter().map(|j| self.curves[j].place);
        others.any(|other| other.abs_diff(place) == 1)
    }

    /// Returns the bytes of the frame.
    pub fn frame(&self, session: u64, seq: u64, layout: u32) -> Frame {
        let count = |c: &Loop| c.points.len() as i32 * if c.closed { -1 } else { 1 };
        let mut payload: Vec<u8> = Vec::new();
        for curve in &self.curves {
            payload.extend(count(curve).to_ne_bytes());
        }
        pad(&mut payload);
        let start = payload.len();
        if self.named {
            for curve in &self.curves {
                payload.extend(curve.name.bytes());
                payload.push(0);
            }
        }
        let names_bytes = payload.len() - start;
        pad(&mut payload);
        if self.radii {
            for curve in &self.curves {
                payload.extend(curve.radius.to_ne_bytes());
            }
            pad(&mut payload);
        }
        for x in self.curves.iter().flat_map(|c| c.points.iter().flatten()) {
            match self.double {
                true => payload.extend(x.to_ne_bytes()),
                false => payload.extend((*x as f32).to_ne_bytes()),
            }
        }
        let header = Header {
            magic: Header::MAGIC,
            version: Header::VERSION,
            flags: if self.radii { Header::RADII } else { 0 },
            session,
            seq,
            time: seq as f64 / 8.0,
            n_points: self.curves.iter().map(|c| c.points.len() as u64).sum(),
            n_curves: self.curves.len() as u32,
            basis: self.basis,
            coordinate_bytes: if self.double { 8 } else { 4 },
            layout,
            names_bytes: names_bytes as u32,
            ..Header::default()
        };
        Frame { header, payload }
    }
}

impl Loop {
    pub fn displace(&mut self, by: [f64; 3]) {
        for p in &mut self.points {
            *p = [0, 1, 2].map(|x| p[x] + by[x]);
        }
    }
}

/// Returns ring `k` of the chain. Each ring passes through the next one, which lies in the other
/// plane.
fn ring(k: usize, side: usize) -> Vec<[f64; 3]> {
    let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
    let center = 1.5 * HALF * k as f64;
    let mut points = Vec::new();
    for c in 0..4 {
        let ((x0, y0), (x1, y1)) = (corners[c], corners[(c + 1) % 4]);
        for s in 0..side {
            let at = |from: f64, to: f64| HALF * (from + (to - from) * s as f64 / side as f64);
            let (x, y) = (center + at(x0, x1).round(), at(y0, y1).round());
            points.push(if k.is_multiple_of(2) {
                [x, y, 0.0]
            } else {
                [x, 0.0, y]
            });
        }
    }
    points
}

/// Appends zeros up to a multiple of 64 bytes.
pub fn pad(bytes: &mut Vec<u8>) {
    bytes.resize(bytes.len().next_multiple_of(64), 0);
}
