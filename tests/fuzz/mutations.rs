//! Named changes of a valid frame.

use super::frame::{Frame, Scene, pad};
use super::support::random::Random;
use super::support::raw_bus::Header;
use linkwatch::Verdict;

/// Effect of a change on the verdict of a frame that stays valid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effect {
    /// The verdict is that of the frame before the change.
    None,
    /// The verdict becomes this one.
    Verdict(Verdict),
    /// The verdict becomes that of a full run on the changed values.
    Unknown,
}

/// A change of the content of a frame, and its effect. The frame stays valid if it announces other
/// curves by a new `layout`; otherwise it contradicts the layout.
pub type SceneChange = (&'static str, fn(&mut Scene, &mut Random) -> Effect);

/// A change of the bytes of a frame, and its effect on the verdict if the frame stays valid.
pub type ByteChange = (&'static str, fn(&mut Frame, &mut Random) -> Effect);

/// Numbers that overflow something.
const HUGE: [u64; 10] = [
    u64::MAX,
    u64::MAX - 1,
    u64::MAX / 12,
    u64::MAX / 12 + 1,
    u64::MAX / 24 + 2,
    1 << 63,
    1 << 61,
    (1 << 32) + 1,
    u32::MAX as u64,
    1 << 31,
];

/// Returns the effect of a change of all links of ring `ring`.
fn changes_links(scene: &Scene, ring: usize) -> Effect {
    match scene.is_linked(ring) {
        true => Effect::Verdict(Verdict::Changed),
        false => Effect::None,
    }
}

/// Changes of positions; the curves stay the same.
pub const SHAPES: &[SceneChange] = &[
    ("a ring far from its neighbours", |scene, random| {
        let i = random.pick(&scene.rings());
        scene.curves[i].displace([0.0, 1000.0, 0.0]);
        changes_links(scene, i)
    }),
    ("a ring with the other direction", |scene, random| {
        let i = random.pick(&scene.rings());
        scene.curves[i].points.reverse();
        changes_links(scene, i)
    }),
    ("two rings that touch", |scene, _| {
        let &[i, j, ..] = &scene.rings()[..] else {
            return Effect::None;
        };
        let shared = scene.curves[i].points[0];
        scene.curves[j].points[0] = shared;
        // A corner that is moved across the chain may also unlink its ring.
        let next = scene.curves[j].place == scene.curves[i].place + 1;
        match scene.basis == 0 && next {
            true => Effect::Verdict(Verdict::Contact),
            false => Effect::Unknown,
        }
    }),
    ("a ring of one point", |scene, random| {
        let i = random.pick(&scene.rings());
        let first = scene.curves[i].points[0];
        scene.curves[i].points.fill(first);
        Effect::Unknown
    }),
    ("a repeated point", |scene, random| {
        let i = random.pick(&scene.rings());
        let k = random.below(scene.curves[i].points.len() - 1);
        scene.curves[i].points[k] = scene.curves[i].points[k + 1];
        Effect::Unknown
    }),
    ("another unit of length", |scene, random| {
        let exponent = match scene.double {
            true => random.below(2060) - 1074,
            false => random.below(264) - 149,
        };
        let half = exponent / 2;
        let factor = [half, exponent - half].map(|e| 2_f64.powi(e));
        for x in scene
            .curves
            .iter_mut()
            .flat_map(|c| c.points.iter_mut().flatten())
        {
            *x = *x * factor[0] * factor[1];
        }
        match scene.basis == 0 || exponent.abs() < 100 {
            true => Effect::None,
            false => Effect::Unknown,
        }
    }),
];

/// Changes of the curves.
pub const CURVES: &[SceneChange] = &[
    ("two curves in the other order", |scene, random| {
        let n = scene.curves.len();
        let i = random.below(n);
        scene.curves.swap(i, (i + 1) % n);
        Effect::None
    }),
    ("a curve less", |scene, random| {
        let rings = scene.rings();
        if rings.len() > 1 {
            scene.curves.remove(random.pick(&rings));
        }
        Effect::None
    }),
    ("another name", |scene, random| {
        let i = random.below(scene.curves.len());
        scene.curves[i].name = format!("new/{}", random.next());
        Effect::None
    }),
    ("names in the other order", |scene, _| {
        let names: Vec<String> = scene.curves.iter().rev().map(|c| c.name.clone()).collect();
        for (curve, name) in scene.curves.iter_mut().zip(names) {
            curve.name = name;
        }
        // The names then belong to other curves with other links, unless the chain is symmetric.
        Effect::Unknown
    }),
    ("another radius", |scene, random| {
        let i = random.below(scene.curves.len());
        scene.curves[i].radius += 1.0;
        Effect::None
    }),
    ("radii or none", |scene, _| {
        scene.radii = !scene.radii;
        Effect::None
    }),
    ("names or none", |scene, _| {
        scene.named = !scene.named;
        Effect::None
    }),
    ("the other precision", |scene, _| {
        scene.double = !scene.double;
        Effect::None
    }),
    ("another basis", |scene, random| {
        scene.basis = random.below(4);
        Effect::Unknown
    }),
    ("a point more", |scene, random| {
        let i = random.pick(&scene.rings());
        let ring = &mut scene.curves[i];
        ring.points.push(ring.points[0]);
        Effect::Unknown
    }),
];

/// Wrong values in the header.
pub const HEADER: &[ByteChange] = &[
    ("magic", |f, r| {
        f.header.magic ^= 1 << r.below(64);
        Effect::None
    }),
    ("magic of the other byte order", |f, _| {
        f.header.magic = f.header.magic.swap_bytes();
        Effect::None
    }),
    ("version", |f, r| {
        f.header.version = r.pick(&[0, 1, 5, 7, u32::MAX]);
        Effect::None
    }),
    ("flags that have no meaning yet", |f, r| {
        f.header.flags |= (r.next() as u32) & !63;
        Effect::None
    }),
    ("a baseline that no simulator has accepted", |f, _| {
        f.header.flags |= Header::BASELINE;
        Effect::None
    }),
    ("lockstep, unfinished", |f, r| {
        f.header.flags ^= r.pick(&[1, 8, 9]);
        Effect::None
    }),
    ("a signal with a payload", |f, r| {
        f.header.flags |= r.pick(&[Header::END, Header::ANNOUNCE, 6, 10]);
        Effect::None
    }),
    ("radii that are not there, or not announced", |f, _| {
        f.header.flags ^= Header::RADII;
        Effect::None
    }),
    ("session 0", |f, _| {
        f.header.session = 0;
        Effect::None
    }),
    ("another session", |f, r| {
        f.header.session = r.next();
        Effect::None
    }),
    ("a number that goes back", |f, r| {
        f.header.seq = f.header.seq.saturating_sub(1 + r.below(5));
        Effect::None
    }),
    ("a number that no simulator reaches", |f, r| {
        f.header.seq = r.pick(&[
            u64::MAX,
            u64::MAX - 1,
            1 << 63,
            1 << 53,
            (1 << 53) - 1,
            1 << 50,
        ]);
        Effect::None
    }),
    ("a number after skipped frames", |f, r| {
        f.header.seq = f.header.seq.saturating_add(r.below(1000));
        Effect::None
    }),
    ("time", |f, r| {
        f.header.time = r.pick(&[f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -1e300, 5e-324]);
        Effect::None
    }),
    ("time step", |f, r| {
        f.header.time_step = r.pick(&[f64::NAN, f64::INFINITY, -1.0, -5e-324, -0.0, 1e-3]);
        Effect::None
    }),
    ("some points more or less", |f, r| {
        f.header.n_points = f.header.n_points.wrapping_add(r.below(65)).wrapping_sub(32);
        Effect::None
    }),
    ("a huge number of points", |f, r| {
        f.header.n_points = r.pick(&HUGE);
        Effect::None
    }),
    ("some curves more or less", |f, r| {
        f.header.n_curves = f.header.n_curves.wrapping_add(r.below(65)).wrapping_sub(32);
        Effect::None
    }),
    ("a huge number of curves", |f, r| {
        f.header.n_curves = r.pick(&HUGE) as u32;
        Effect::None
    }),
    ("basis", |f, r| {
        f.header.basis = r.pick(&[0, 1, 2, 3, 4, 255, u32::MAX]);
        Effect::Unknown
    }),
    ("bytes of a coordinate", |f, r| {
        f.header.coordinate_bytes = r.pick(&[0, 1, 2, 3, 4, 5, 8, 16, u32::MAX]);
        Effect::Unknown
    }),
    ("points of the other precision", |f, _| {
        // The length stays consistent: twice the points with half the bytes each, or the reverse.
        let single = f.header.coordinate_bytes == 4;
        f.header.coordinate_bytes = if single { 8 } else { 4 };
        f.header.n_points = if single {
            f.header.n_points / 2
        } else {
            f.header.n_points.wrapping_mul(2)
        };
        Effect::Unknown
    }),
    ("cuts", |f, r| {
        f.header.cuts = r.next() as u32;
        Effect::None
    }),
    ("bytes of the names", |f, r| {
        let n = f.header.names_bytes;
        let by = 1 + r.below(70);
        let others = [
            n + by,
            n.wrapping_sub(by),
            0,
            1,
            u32::MAX,
            u32::MAX - 63,
            1 << 31,
        ];
        f.header.names_bytes = r.pick(&others);
        Effect::Unknown
    }),
    ("a periodic cell", |f, r| {
        f.header.cell_vectors = r.pick(&[1, 2, 3, u32::MAX]);
        if r.below(2) == 0 {
            f.header.cell[..5].copy_from_slice(&[10.0, 0.0, 0.0, 2.0, 10.0]);
        }
        Effect::None
    }),
    ("reserved fields", |f, r| {
        f.header.reserved = r.next() as u32;
        f.header.cell_origin[r.below(3)] = f64::from_bits(r.next());
        f.header.cell[r.below(9)] = f64::from_bits(r.next());
        Effect::None
    }),
];

/// Wrong values in the parts before the positions.
pub const LAYOUT: &[ByteChange] = &[
    ("a count", |f, r| {
        let values = [0, 1, -1, 2, -2, -3, i32::MIN, i32::MIN + 1, i32::MAX];
        with_count(f, r, |r, _| r.pick(&values));
        Effect::Unknown
    }),
    ("a count that is one off", |f, r| {
        with_count(f, r, |r, count| count.wrapping_add(r.pick(&[-1, 1])));
        Effect::Unknown
    }),
    ("open instead of closed", |f, r| {
        with_count(f, r, |_, count| count.wrapping_neg());
        Effect::Unknown
    }),
    ("an end that goes back", |f, r| {
        // One curve takes points of another one, so the sum stays the same, at least modulo 2^32.
        let by = r.pick(&[1, 3, i32::MAX, 1 << 30]);
        with_count(f, r, |_, count| count.wrapping_add(by));
        with_count(f, r, |_, count| count.wrapping_sub(by));
        Effect::Unknown
    }),
    ("counts in the other order", |f, r| {
        let n = curves(f);
        if n > 1 {
            let i = r.below(n - 1);
            let (a, b) = (word(f, 4 * i), word(f, 4 * i + 4));
            set_word(f, 4 * i, b);
            set_word(f, 4 * i + 4, a);
        }
        Effect::Unknown
    }),
    ("bytes after a part that are not zero", |f, r| {
        let end = 4 * curves(f);
        if !end.is_multiple_of(64) && end < f.payload.len() {
            f.payload[end] = r.next() as u8;
        }
        Effect::None
    }),
    ("a byte of a name", |f, r| {
        let (start, n) = names(f);
        if n > 0 {
            let value = r.pick(&[0, 1, 0x1b, 0x7f, 0x80, 0xc0, 0xff, b'a']);
            f.payload[start + r.below(n)] = value;
        }
        Effect::Unknown
    }),
    ("a name without an end", |f, r| {
        let (start, n) = names(f);
        if n > 0 {
            f.payload[start + n - 1] = r.pick(&[b'x', 0xff]);
        }
        Effect::Unknown
    }),
    ("two equal names", |f, r| {
        replace_names(f, |names| {
            let (i, j) = (r.below(names.len()), r.below(names.len()));
            names[i] = names[j].clone();
        });
        Effect::Unknown
    }),
    ("a name that is too long, empty or not text", |f, r| {
        replace_names(f, |names| {
            let i = r.below(names.len());
            names[i] = match r.below(6) {
                0 => Vec::new(),
                1 => vec![b'n'; 255 + r.below(3_usize)],
                2 => b"\xed\xa0\x80".to_vec(),
                3 => "a\u{85}b".into(),
                4 => b"\x1b[2J".to_vec(),
                _ => vec![r.next() as u8; 1 + r.below(4_usize)],
            };
        });
        Effect::Unknown
    }),
    ("a name more or less", |f, r| {
        replace_names(f, |names| match r.one_in(2) {
            true => names.push(b"more".to_vec()),
            false => drop(names.pop()),
        });
        Effect::Unknown
    }),
    ("thousands of empty names", |f, r| {
        replace_names(f, |names| {
            *names = vec![Vec::new(); 1000 + r.below(5000_usize)]
        });
        Effect::Unknown
    }),
    ("a radius", |f, r| {
        let n = curves(f);
        let (start, names) = names(f);
        let at = start + names.next_multiple_of(64);
        if f.header.flags & Header::RADII != 0 && at + 4 * n <= f.payload.len() && n > 0 {
            let value = r.pick(&[
                f32::NAN,
                -1.0,
                f32::INFINITY,
                f32::NEG_INFINITY,
                7e37,
                -1e-45,
            ]);
            set_word(f, at + 4 * r.below(n), value.to_bits() as i32);
        }
        // If another change has announced radii that the frame does not have, this writes into a
        // coordinate.
        Effect::Unknown
    }),
];

/// Wrong values in the payload.
pub const PAYLOAD: &[ByteChange] = &[
    ("truncated", |f, r| {
        let n = f.payload.len();
        f.payload.truncate(n.saturating_sub(1 + r.below(100_usize)));
        Effect::Unknown
    }),
    ("no payload", |f, _| {
        f.payload.clear();
        Effect::Unknown
    }),
    ("bytes at the end", |f, r| {
        let n = f.payload.len() + 1 + r.below(200_usize);
        f.payload.resize(n, r.next() as u8);
        Effect::Unknown
    }),
    ("moved by a byte", |f, _| {
        f.payload.insert(0, 0);
        f.payload.pop();
        Effect::Unknown
    }),
    ("more than the limit", |f, r| {
        let n = (1 << 15) + r.below(1_usize << 15);
        f.payload.resize(n, 0);
        Effect::Unknown
    }),
    ("more points than the limit, consistently", |f, _| {
        let more = 4096;
        with_count_at(f, 0, |count| count.wrapping_sub(more));
        f.header.n_points = f.header.n_points.wrapping_add(more as u64);
        let n = f.payload.len() + 3 * more as usize * f.header.coordinate_bytes.min(8) as usize;
        f.payload.resize(n, 0);
        Effect::Unknown
    }),
    ("a value that is not finite", |f, r| {
        let values = [f64::NAN, -f64::NAN, f64::INFINITY, f64::NEG_INFINITY];
        let value = r.pick(&values);
        set_coordinate(f, r, value.to_bits(), (value as f32).to_bits());
        Effect::Unknown
    }),
    ("a signalling NaN", |f, r| {
        set_coordinate(f, r, 0x7ff0_0000_0000_0001, 0xff80_0001);
        Effect::Unknown
    }),
    ("many values that are not finite", |f, r| {
        for _ in 0..1 + r.below(20) {
            set_coordinate(f, r, f64::NAN.to_bits(), f32::INFINITY.to_bits());
        }
        Effect::Unknown
    }),
    ("a denormal number, zero or the smallest", |f, r| {
        let (double, single) = r.pick(&[(1, 1), (0, 0), (1 << 63, 1 << 31), (7 << 40, 7 << 10)]);
        set_coordinate(f, r, double, single);
        Effect::Unknown
    }),
    ("a huge number", |f, r| {
        let value = r.pick(&[f64::MAX, f64::MIN, 1e200, -1e90, 3e90]);
        let single = r.pick(&[f32::MAX, f32::MIN, 1e30]);
        set_coordinate(f, r, value.to_bits(), single.to_bits());
        Effect::Unknown
    }),
    ("random bits in a coordinate", |f, r| {
        let (double, single) = (r.next(), r.next() as u32);
        set_coordinate(f, r, double, single);
        Effect::Unknown
    }),
    ("a random bit", |f, r| {
        if !f.payload.is_empty() {
            let at = r.below(f.payload.len());
            f.payload[at] ^= 1 << r.below(8);
        }
        Effect::Unknown
    }),
    ("all zeros", |f, _| {
        f.payload.fill(0);
        Effect::Unknown
    }),
    ("all bits set", |f, _| {
        f.payload.fill(0xff);
        Effect::Unknown
    }),
];

fn curves(f: &Frame) -> usize {
    (f.header.n_curves as usize).min(f.payload.len() / 4)
}

fn word(f: &Frame, at: usize) -> i32 {
    let bytes = f.payload.get(at..at + 4);
    bytes.map_or(0, |b| i32::from_ne_bytes(b.try_into().expect("four bytes")))
}

fn set_word(f: &mut Frame, at: usize, value: i32) {
    if let Some(bytes) = f.payload.get_mut(at..at + 4) {
        bytes.copy_from_slice(&value.to_ne_bytes());
    }
}

fn with_count(f: &mut Frame, r: &mut Random, change: impl FnOnce(&mut Random, i32) -> i32) {
    let n = curves(f);
    if n > 0 {
        let i = r.below(n);
        with_count_at(f, i, |count| change(r, count));
    }
}

fn with_count_at(f: &mut Frame, i: usize, change: impl FnOnce(i32) -> i32) {
    let count = change(word(f, 4 * i));
    set_word(f, 4 * i, count);
}

/// Returns the first byte of the names, and their number of bytes, within the payload.
fn names(f: &Frame) -> (usize, usize) {
    let start = (4 * f.header.n_curves as usize).next_multiple_of(64);
    let left = f.payload.len().saturating_sub(start);
    (start, (f.header.names_bytes as usize).min(left))
}

/// Replaces the names by others. Lengths stay consistent.
fn replace_names(f: &mut Frame, change: impl FnOnce(&mut Vec<Vec<u8>>)) {
    let (start, n) = names(f);
    if n == 0 {
        return;
    }
    let old = f.payload[start..][..n - 1].split(|&b| b == 0);
    let mut names: Vec<Vec<u8>> = old.map(<[u8]>::to_vec).collect();
    change(&mut names);
    let mut bytes = Vec::new();
    for name in names {
        bytes.extend(name);
        bytes.push(0);
    }
    f.header.names_bytes = bytes.len() as u32;
    pad(&mut bytes);
    let end = (start + n.next_multiple_of(64)).min(f.payload.len());
    f.payload.splice(start..end, bytes);
}

fn set_coordinate(f: &mut Frame, r: &mut Random, double: u64, single: u32) {
    let size = if f.header.coordinate_bytes == 8 { 8 } else { 4 };
    let coordinates = 3 * f.header.n_points.min(1 << 20) as usize;
    let n = coordinates.min(f.payload.len() / size);
    if n == 0 {
        return;
    }
    let at = f.payload.len() - size * (1 + r.below(n));
    match size {
        8 => f.payload[at..at + 8].copy_from_slice(&double.to_ne_bytes()),
        _ => f.payload[at..at + 4].copy_from_slice(&single.to_ne_bytes()),
    }
}
