//! Contacts between the segments of all bands: a spatial grid, and the closest points of two
//! segments.
//!
//! Segments are sorted into cubic cells by their midpoints. A cell is as wide as the longest
//! segment plus the thickness of a band, so that two segments in contact are in the same cell or
//! in neighbouring ones. Cost: time and memory proportional to the number of segments, as long as
//! few of them share a cell.

use glam::{IVec3, Vec3};

/// Number of buckets of the hash table of cells.
const BUCKETS: usize = 1 << 16;

/// Offsets of a cell and its 26 neighbours.
const OFFSETS: std::ops::RangeInclusive<i32> = -1..=1;

/// Segments sorted into cells. Keeps its memory between time steps.
#[derive(Clone, Debug)]
pub struct Grid {
    /// Cell of each segment.
    cells: Vec<IVec3>,
    /// First entry of each bucket, and one more.
    starts: Vec<u32>,
    /// Segments, bucket after bucket, ascending within each one.
    entries: Vec<u32>,
}

impl Grid {
    /// Returns an empty grid.
    pub fn new() -> Grid {
        Grid {
            cells: Vec::new(),
            starts: vec![0; BUCKETS + 1],
            entries: Vec::new(),
        }
    }

    /// Writes all pairs of segments that may be closer than `thickness` to `pairs`, the smaller
    /// index first, in an order that depends on the positions only. `segment` returns the ends of
    /// a segment.
    pub fn pairs(
        &mut self,
        count: usize,
        thickness: f32,
        segment: impl Fn(usize) -> [Vec3; 2],
        pairs: &mut Vec<[u32; 2]>,
    ) {
        pairs.clear();
        let longest = (0..count).fold(0.0, |longest: f32, k| {
            let [a, b] = segment(k);
            longest.max(a.distance_squared(b))
        });
        let width = longest.sqrt() + thickness;
        self.sort(count, width, &segment);
        for i in 0..count {
            let [a, b] = segment(i);
            let (low, high) = (a.min(b) - thickness, a.max(b) + thickness);
            for x in OFFSETS {
                for y in OFFSETS {
                    for z in OFFSETS {
                        let cell = self.cells[i] + IVec3::new(x, y, z);
                        let bucket = bucket(cell);
                        let range = self.starts[bucket] as usize..self.starts[bucket + 1] as usize;
                        for &j in &self.entries[range] {
                            // Another cell may share the bucket.
                            if j as usize <= i || self.cells[j as usize] != cell {
                                continue;
                            }
                            let [c, d] = segment(j as usize);
                            if c.min(d).cmple(high).all() && c.max(d).cmpge(low).all() {
                                pairs.push([i as u32, j]);
                            }
                        }
                    }
                }
            }
        }
    }

    /// Sorts the segments into buckets by counting.
    fn sort(&mut self, count: usize, width: f32, segment: &impl Fn(usize) -> [Vec3; 2]) {
        self.cells.clear();
        self.cells.extend((0..count).map(|k| {
            let [a, b] = segment(k);
            (0.5 * (a + b) / width).floor().as_ivec3()
        }));
        self.starts.fill(0);
        for &cell in &self.cells {
            self.starts[bucket(cell)] += 1;
        }
        let mut sum = 0;
        for start in &mut self.starts {
            sum += *start;
            *start = sum;
        }
        self.entries.clear();
        self.entries.resize(count, 0);
        for (k, &cell) in self.cells.iter().enumerate().rev() {
            let start = &mut self.starts[bucket(cell)];
            *start -= 1;
            self.entries[*start as usize] = k as u32;
        }
    }
}

/// Returns the bucket of a cell.
fn bucket(cell: IVec3) -> usize {
    let [x, y, z] = cell.to_array().map(|x| x as u32);
    let hash =
        x.wrapping_mul(0x8da6_b343) ^ y.wrapping_mul(0xd816_3841) ^ z.wrapping_mul(0xcb1a_b31f);
    (hash.wrapping_mul(0x9e37_79b9) >> 16) as usize
}

/// Returns the places of the closest points of two segments, 0 at the first end and 1 at the
/// second one. Ericson, Real-Time Collision Detection, section 5.1.9.
pub fn closest([a, b]: [Vec3; 2], [c, d]: [Vec3; 2]) -> [f32; 2] {
    let (u, v, r) = (b - a, d - c, a - c);
    let (uu, vv, uv) = (u.dot(u), v.dot(v), u.dot(v));
    let (ur, vr) = (u.dot(r), v.dot(r));
    if uu <= f32::MIN_POSITIVE || vv <= f32::MIN_POSITIVE {
        return [0.5, 0.5];
    }
    let determinant = uu * vv - uv * uv;
    let mut s = match determinant > 1e-6 * uu * vv {
        true => ((uv * vr - ur * vv) / determinant).clamp(0.0, 1.0),
        // Parallel segments: the middle of the first one.
        false => 0.5,
    };
    let t = ((uv * s + vr) / vv).clamp(0.0, 1.0);
    s = ((uv * t - ur) / uu).clamp(0.0, 1.0);
    [s, t]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns pseudo-random segments of lengths up to 1 in a cube of width 4.
    fn random_segments(count: usize) -> Vec<[Vec3; 2]> {
        let mut state = 1_u32;
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32
        };
        (0..count)
            .map(|_| {
                let a = 4.0 * Vec3::new(next(), next(), next());
                [a, a + 0.5 * Vec3::new(next(), next(), next())]
            })
            .collect()
    }

    fn distance(p: [Vec3; 2], q: [Vec3; 2]) -> f32 {
        let [s, t] = closest(p, q);
        p[0].lerp(p[1], s).distance(q[0].lerp(q[1], t))
    }

    #[test]
    fn the_grid_finds_every_pair_in_contact() {
        let all = random_segments(400);
        let mut found = Vec::new();
        Grid::new().pairs(all.len(), 0.2, |k| all[k], &mut found);
        let mut near = 0;
        for i in 0..all.len() {
            for j in i + 1..all.len() {
                if distance(all[i], all[j]) < 0.2 {
                    near += 1;
                    assert!(
                        found.contains(&[i as u32, j as u32]),
                        "segments {i} and {j}"
                    );
                }
            }
        }
        assert!(near > 100, "{near} pairs");
        let count = found.len();
        found.sort_unstable();
        found.dedup();
        assert_eq!(found.len(), count, "a pair was found twice");
    }

    #[test]
    fn no_sampled_points_are_closer_than_the_closest_points() {
        let all = random_segments(60);
        for pair in all.chunks_exact(2) {
            let least = distance(pair[0], pair[1]);
            for k in 0..=50 {
                for l in 0..=50 {
                    let [s, t] = [k, l].map(|k| k as f32 / 50.0);
                    let p = pair[0][0].lerp(pair[0][1], s);
                    let q = pair[1][0].lerp(pair[1][1], t);
                    assert!(p.distance(q) > least - 1e-5);
                }
            }
        }
    }
}
