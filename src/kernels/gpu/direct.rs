//! Gauss sum of all pairs of curves at once, in single or in double precision, with its error
//! bound.
//!
//! # Formula
//!
//! The terms are those of [`crate::kernels::sums::direct`], divided by the distances, so that no
//! product of lengths underflows. Let `a = l0 - k0`, `b = l0 - k1`, `c = l1 - k1`, `d = l1 - k0`,
//! let `a^ ..` be their unit vectors, and let `e = k1 - k0`, `f = l1 - l0`. Then
//!
//! ```text
//! q  = (a^ . (f x e)) / |c|                     P1 = q / |b|     P2 = q / |d|
//! D1 = 1 + a^.b^ + b^.c^ + c^.a^                D2 = 1 + a^.d^ + d^.c^ + c^.a^
//! theta = arg z1 + arg z2 = arg(z1 z2),         z1 = D1 + i P1,  z2 = D2 + i P2
//! ```
//!
//! Differences from the CPU: the error bound of a segment pair is proportional to the size of the
//! pair, because `2^-23` times ten thousand million pairs would exceed 1; and sums are computed in
//! fixed point.
//!
//! # Error bound of a segment pair
//!
//! `u` is `2^-23` in single precision and `2^-52` in double precision. It exceeds the relative
//! error of an addition, a subtraction or a multiplication in any rounding mode; `4 u` exceeds that
//! of a division or of an inverse square root (in double precision: see below).
//! [`super::self_test`] tests this. Vertices are exact. Their differences are pinned, so that no
//! compiler regroups across them. All the rest are sums of products, and the bounds hold for each
//! grouping and contraction of those. To first order in `u`:
//!
//! * The relative error of a coordinate of a difference is `u`, of the square of its length `5 u`,
//!   of the inverse of the length `6.5 u`, of a coordinate of the unit vector `8.5 u`. The dot
//!   product of two unit vectors is off by `20 u`, and `D1` and `D2` by `delta_D = 69 u`, below
//!   [`CORNERS`]` / 2`.
//! * `f x e` is off by `4 sqrt(2) u |e| |f|`; `q` by `10.7 u |e| |f| / |c| + 14.5 u |q|`; and `P1`
//!   by `delta_P = 10.7 u s1 + 22 u |P1|` with `s1 = |e| |f| / (|b| |c|)`. [`LEVER`] and [`HEIGHT`]
//!   are above that.
//! * Let `m = min(max(D1, |P1|), max(D2, |P2|))`. If `(delta_P1 + delta_P2 + 2 delta_D) / m <= 1/8`
//!   ([`DOUBT`] is less), the computed and the true `z1` are on the same side of the negative axis,
//!   as in [`crate::kernels::sums::direct::block`], and with `|z1| >= max(D1, |P1|)` their
//!   arguments differ by
//!   `asin((|D1| delta_P1 + |P1| delta_D) / (|z1| |z1'|))`, which is at most
//!   `1.15 (delta_P1 + delta_D |P1| / m) / m`. The same holds for `z2`.
//! * The product is off by `4 u (|D1 D2| + |P1 P2|)` in its real part and by
//!   `4 u (|P1 D2| + |P2 D1|)` in its imaginary part, which rotates it by `12 u (|P1| + |P2|) / m`
//!   at most. It does not cross the negative axis, because the factor `D2 / |b| + D1 / |d|`, which
//!   is not negative, is replaced by 0 if its computed value is negative.
//! * The arctangent is off by `16 u |theta|`: its series of seven terms by `(1/3)^14 / 15 < u / 8`,
//!   in double precision of sixteen terms by `(1/3)^32 / 33 < u / 8`; the rest is rounding. As
//!   `|theta| <= pi (|P1| + |P2|) / m`, that is below `50 u (|P1| + |P2|) / m`.
//!
//! Together, with `g = 1/|b| + 1/|d|`, the bound is
//! `u g / m (16.1 |e| |f| / |c| + (90.8 + 83 / m) |q|)`. [`SPAN`], [`TURN`] and [`TILT`] are above
//! its coefficients. The result is multiplied by 1.01 ([`ROUNDED_UP`]) for the rounding of the
//! bound itself and for terms of higher order.
//!
//! ## Underflow and overflow
//!
//! In single precision, numbers below `2^-126` may be flushed to 0. All four distances are above
//! `10^-8` ([`tiny_square`]; nearer pairs are undecided), and `10^-15` is added to the lengths of
//! segments ([`tiny_length`]). So the error by flushing is below a hundredth of the bound.
//! Coordinates are below 1, so nothing overflows. In double precision the limits are: numbers below
//! `2^-1022`, distances above `10^-18`, and `10^-18` added to the lengths. The bound of a pair is
//! above `u SPAN 10^-36 / 16 > 10^-52`. The error by flushing is `2^-1020` times two inverses of
//! distances and one of `m`, which is above `CORNERS u / DOUBT`: below `10^-255`.
//!
//! # Inverses in double precision
//!
//! Vulkan requires no more accuracy of doubles than of singles. All hardware with doubles rounds
//! their sums and products correctly; apart from those, only conversions are used. An inverse or an
//! inverse square root starts in single precision and is refined:
//!
//! * Let `y` approximate `1 / sqrt(x)` with a relative error of `2^-20`. Then `r = 1 - x y^2` is
//!   below `2^-18.9`, and `1 / sqrt(x) = y (1 - r)^(-1/2)` is `y (1 + r / 2 + 3 r^2 / 8)` up to a
//!   relative error of `r^3 / 3 < u / 16`. The computed `r` is off by `2 u`, for either grouping of
//!   the product; half of that counts. One addition rounds by `u`, and all else is `2^-17 u`.
//!   Together that is below `3 u`.
//! * Let `z` approximate `1 / y` with a relative error of `2^-20`. Then `r = 1 - y z` is below
//!   `2^-20`, and `x / y = x z / (1 - r)` is `x z (1 + r + r^2)` up to a relative error of
//!   `2 r^3 < u / 16`. The computed `r` is off by `u`, and an addition and a product round by `u`:
//!   below `4 u`.
//!
//! In single precision `2^-20` is `8 * 2^-23`, more than the 4 of the operation and the 1 of the
//! conversion. The range of single precision includes the squares of distances, from `10^-36` to
//! 12; `m`, which is above `10^-13`; and the denominator of the arctangent, above `m^2 / 2` and
//! below 100, because `|P1|` and `|P2|` are at most 1 and `|D1|` and `|D2|` at most 4. Square roots
//! of squares of lengths are used in the bound only and are computed in single precision: a
//! relative error of a millionth is within the hundredth of [`ROUNDED_UP`], and a square that is
//! flushed to 0, below `2^-126`, is that of a length below `10^-18`.
//!
//! Undecided segment pairs contribute 0, which is off by less than `pi`. If their count exceeds 32
//! bits, nothing is known of the pair of curves.
//!
//! # Error bound of a sum
//!
//! Up to [`COLUMNS`] angles are added in the precision of the shader. The error is `u` times each
//! partial sum, which is added to the bound. Then the sum is converted to units of `2^-44`, with an
//! error of one unit, and added exactly. Ten thousand million pairs lose less than `10^-5` by that.
//!
//! A decided angle is off by less than 1: those of `z1` and of `z2` by `1.15 / 8` at most, their
//! product by `12 u`. The bound above may be larger, because its `m` is the smaller one of both,
//! and is capped at 1 then: in double precision it reached 90,000 for a pair of a short and a long
//! segment at a small distance. An angle is below `pi`, so the 1024 by 64 pairs of a workgroup stay
//! below the 500,000 that 64 bits hold; the sum of a pair of curves has 96 bits.
//!
//! # Inexact vertices
//!
//! If coordinates had to be rounded, the sum is that of polylines with the rounded vertices. They
//! have the same linking number if no two segments can meet while the vertices move from the exact
//! to the rounded positions. That is so if the segments are further apart than `2 sqrt(3)` times
//! the radius, which is less than [`REACH`] times the radius. It is tested for every segment pair,
//! along the axes, and by the volume of the tetrahedron of the four ends, because the distance of
//! the two lines is at least `|q| |a| |c| / (|e| |f|)`. If neither test proves it, nothing is known
//! of the pair of curves.

use super::State;
use super::commands::{ALIGNMENT, Binding, Buffer, Command, Stage};
use super::error::Error;
use super::fixed;
use super::frame::Frame;
use super::layout::{AngleSum, Parameters, Tile, named, word};
use super::precision::Real;
use super::tiles::{self, Shape, cut};
use crate::kernels::Estimate;
use crate::kernels::sums::barnes_hut::LEAF_SEGMENTS;
use crate::pairs::Pair;
use std::f64::consts::{PI, TAU};

/// Shader code that adds to sums of 96 bits.
pub(super) const SUMS_SHADER: &str = include_str!("sums.wgsl");

const SUMS: Buffer = Buffer("sums", "all");

/// Batches of lists of tiles start at multiples of this.
const STEP: usize = ALIGNMENT as usize / size_of::<Tile>();

/// Threads of a workgroup.
pub(super) const THREADS: u32 = 64;

/// Number of columns that are summed before the sum is converted to fixed point.
pub(super) const COLUMNS: u32 = 64;

/// Upper bound of the relative error of an operation in single precision.
pub(super) const UNIT_ERROR: f64 = f32::UNIT_ERROR;

/// Twice the error of `D1`, in units of [`Real::UNIT_ERROR`], as the following constants.
const CORNERS: f64 = 144.0;
/// Error of `P1`, coefficient of `s1`.
const LEVER: f64 = 14.0;
/// Error of `P1`, coefficient of `|P1|`.
const HEIGHT: f64 = 25.0;
/// Error of the angle, coefficient of `g |e| |f| / (|c| m)`.
const SPAN: f64 = 17.0;
/// Error of the angle, coefficient of `g |q| / m`.
const TURN: f64 = 92.0;
/// Error of the angle, coefficient of `g |q| / m^2`.
const TILT: f64 = 84.0;
/// Maximum error of `z1` and of `z2`, relative to `m`, at which their arguments are decided; less
/// than 1/8.
const DOUBT: f64 = 0.1;
/// Distance within which segments may meet if each coordinate of a vertex is off by 1: more than
/// `2 sqrt(3)`.
pub(super) const REACH: f64 = 3.6;
/// Upper bound of the error of `q`, coefficient of `|e| |f| / |c|`.
const SKEW: f64 = 40.0;
/// Factor on error bounds, for the rounding of the bounds themselves.
const ROUNDED_UP: f64 = 1.01;

// Leaves of trees must fit into tiles of the smaller shape.
const _: () = assert!(LEAF_SEGMENTS <= SHAPES[0].rows && LEAF_SEGMENTS <= SHAPES[0].columns);

/// Shapes of tiles: rows, and columns in steps of [`COLUMNS`].
pub(super) const SHAPES: [Shape; 2] = [
    Shape {
        rows: 16,
        columns: COLUMNS,
    },
    Shape {
        rows: 64,
        columns: 16 * COLUMNS,
    },
];

/// Returns the shaders for each of [`SHAPES`].
pub(super) fn stages<R: Real>() -> [Stage; 2] {
    let [small, large] = R::DIRECT;
    [
        Stage {
            name: small,
            source: || source::<R>(SHAPES[0]),
        },
        Stage {
            name: large,
            source: || source::<R>(SHAPES[1]),
        },
    ]
}

/// Returns the source of the shader for tiles of a shape.
fn source<R: Real>(shape: Shape) -> String {
    let own = [
        ("ROWS", shape.rows),
        ("STEPS", shape.columns / COLUMNS),
        ("WORDS", word!(AngleSum)),
        ("VALUE", word!(AngleSum.value)),
        ("BOUND", word!(AngleSum.bound)),
        ("DOUBTS", word!(AngleSum.doubts)),
        ("NEAR", word!(AngleSum.near)),
    ];
    let whole = [&own[..], &named![THREADS, COLUMNS]].concat();
    let errors = named![CORNERS, LEVER, HEIGHT, SPAN, TURN, TILT, DOUBT, REACH, PI];
    let own = [
        ("UNIT_ERROR", R::UNIT_ERROR),
        ("SKEW", SKEW * R::UNIT_ERROR),
        ("TINY_LENGTH", R::TINY_LENGTH),
        ("TINY_SQUARE", R::TINY_SQUARE),
        ("ROUNDED_UP", ROUNDED_UP * R::UNIT_ERROR),
        ("MOST", 1.0 / R::UNIT_ERROR),
        ("ATAN_HALF", 0.5f64.atan()),
        ("HALF_PI", PI / 2.0),
    ];
    let real = [&own[..], &errors].concat();
    super::shader::<R>(&whole, &real, &[SUMS_SHADER, include_str!("direct.wgsl")])
}

/// Returns the linking numbers of all pairs, from one list of commands unless there are millions of
/// pairs.
pub(super) fn linking_numbers<R: Real>(
    state: &mut State,
    frame: &Frame<R>,
    pairs: &[Pair],
) -> Result<Vec<Estimate>, Error> {
    // Number of pairs whose sums fit into a buffer.
    let capacity = state.adapter.max_buffer_bytes.saturating_sub(bytes(0));
    let most = (capacity / size_of::<AngleSum>() as u64).max(1) as usize;
    if pairs.len() > most {
        let mut all = Vec::with_capacity(pairs.len());
        for part in pairs.chunks(most) {
            all.extend(linking_numbers(state, frame, part)?);
        }
        return Ok(all);
    }
    let mut tiles = SHAPES.map(|_| Vec::new());
    for (k, &(i, j)) in (0..).zip(pairs) {
        if !frame.has_numbers((i, j)) {
            continue;
        }
        let [m, n] = [i, j].map(|i| frame.segments(i));
        // The sum does not depend on the order of the curves.
        let (rows, columns) = match (m, i) > (n, j) {
            true => (i, j),
            false => (j, i),
        };
        // Most pairs have two small curves or two large ones; the shape that leaves fewer threads
        // idle is chosen.
        let shape = usize::from(m.max(n) > 2 * SHAPES[0].rows);
        let whole = Tile {
            pair: k,
            first_row: frame.first(rows),
            rows: frame.segments(rows),
            first_column: frame.first(columns),
            columns: frame.segments(columns),
            ..Tile::default()
        };
        cut(whole, SHAPES[shape], &mut tiles[shape]);
    }
    // The offsets of a batch and of its parameters must fit into a buffer and into 32 bits.
    let longest = (state.adapter.max_buffer_bytes / ALIGNMENT).min(1 << 24) as usize * STEP;
    let most = state.max_work / R::SLOWER;
    let size = bytes(pairs.len());
    let mut commands = vec![Command::Clear(SUMS, size)];
    for (shape, (stage, tiles)) in stages::<R>().into_iter().zip(&tiles).enumerate() {
        let list = Buffer("tiles", stage.name);
        for tiles in tiles.chunks(longest.max(STEP)) {
            let parts = tiles::parts(tiles, STEP, longest, most);
            let counts: Vec<u32> = parts.iter().map(|part| part.len() as u32).collect();
            commands.push(Command::upload(list, tiles));
            commands.extend(dispatches(state, frame, shape, list, &counts, size));
        }
    }
    commands.push(Command::Download(SUMS, size));
    let found = state.run(frame, commands)?;
    let listed = tiles.iter().map(|tiles| tiles.len() as u32);
    let sums = read(state, &found[0], listed.fold(0, u32::wrapping_add))?;
    let estimate = |(pair, sum): (&Pair, &AngleSum)| match frame.has_numbers(*pair) {
        true => estimate(sum),
        false => Estimate::UNKNOWN,
    };
    Ok(pairs.iter().zip(&sums).map(estimate).collect())
}

/// Sums tiles that are in a buffer already, each no larger than the smaller shape.
pub(super) fn sum_tiles(
    state: &mut State,
    frame: &Frame,
    pairs: usize,
    tiles: Buffer,
    count: u32,
) -> Result<Vec<AngleSum>, Error> {
    if count == 0 {
        return Ok(vec![AngleSum::default(); pairs]);
    }
    let size = bytes(pairs);
    let most = state.max_work / u64::from(LEAF_SEGMENTS * LEAF_SEGMENTS);
    let part = (most as u32).next_multiple_of(STEP as u32).max(STEP as u32);
    let counts = (0..count.div_ceil(part)).map(|k| part.min(count - k * part));
    let counts: Vec<u32> = counts.collect();
    let mut commands = vec![Command::Clear(SUMS, size)];
    commands.extend(dispatches(state, frame, 0, tiles, &counts, size));
    commands.push(Command::Download(SUMS, size));
    let found = state.run(frame, commands)?;
    read(state, &found[0], count)
}

/// Returns the commands that sum tiles of a shape, which are in a buffer, in batches of these
/// sizes. All but the last are multiples of [`STEP`]. The sums take `bytes` bytes.
fn dispatches<R: Real>(
    state: &State,
    frame: &Frame<R>,
    shape: usize,
    list: Buffer,
    counts: &[u32],
    bytes: u64,
) -> Vec<Command> {
    let stage = stages::<R>()[shape];
    let parameters = Buffer("parameters", stage.name);
    let own = |&items: &u32| Parameters::new(frame.radius, 0, items);
    let mut commands = vec![Command::parameters(parameters, counts.iter().map(own))];
    let mut offset = 0;
    for (k, &count) in (0..).zip(counts) {
        let tiles = Binding {
            buffer: list,
            offset,
            size: u64::from(count) * size_of::<Tile>() as u64,
        };
        commands.push(Command::Dispatch {
            stage,
            bindings: vec![
                Binding::parameters(parameters, k),
                state.vertices(frame),
                tiles,
                Binding::whole(SUMS, bytes),
            ],
            groups: count.div_ceil(THREADS / SHAPES[shape].rows),
        });
        commands.push(Command::Submit);
        offset += tiles.size;
    }
    commands
}

/// Returns the size in bytes of the sums of `pairs` pairs and of the count of processed tiles that
/// follows.
fn bytes(pairs: usize) -> u64 {
    (pairs * size_of::<AngleSum>() + size_of::<u32>()) as u64
}

/// Returns the sums.
///
/// # Errors
///
/// Not all tiles were processed ([`State::incomplete`]).
pub(super) fn read(state: &mut State, found: &[u8], tiles: u32) -> Result<Vec<AngleSum>, Error> {
    let (sums, done) = found.split_at(found.len() - size_of::<u32>());
    match bytemuck::pod_read_unaligned::<u32>(done) == tiles {
        true => Ok(bytemuck::pod_collect_to_vec(sums)),
        false => Err(state.incomplete()),
    }
}

/// Returns the linking number and its error bound from a sum of angles.
pub(super) fn estimate(sum: &AngleSum) -> Estimate {
    if sum.near > 0 {
        return Estimate::UNKNOWN;
    }
    let value = fixed::number(sum.value);
    let bound = fixed::number(sum.bound) + PI * f64::from(sum.doubts);
    Estimate::new(value / TAU, (1.000_001 * bound + 1e-15 * value.abs()) / TAU)
}
