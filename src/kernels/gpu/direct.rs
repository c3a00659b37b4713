//! The Gauss sum of all pairs of curves at once, in single or in double precision, with its bound.
//!
//! The terms are those of [`crate::kernels::direct`], divided by the distances, so that no product of lengths underflows:
//! with `a = l0 - k0`, `b = l0 - k1`, `c = l1 - k1`, `d = l1 - k0`, their unit vectors `a^ ..`, `e = k1 - k0`, `f = l1 - l0`,
//!
//! ```text
//! q  = (a^ . (f x e)) / |c|                     P1 = q / |b|     P2 = q / |d|
//! D1 = 1 + a^.b^ + b^.c^ + c^.a^                D2 = 1 + a^.d^ + d^.c^ + c^.a^
//! theta = arg z1 + arg z2 = arg(z1 z2),         z1 = D1 + i P1,  z2 = D2 + i P2
//! ```
//!
//! Changed against the processor: the bound of a pair is proportional to the pair's own size, which it has to be where
//! `2^-23` times ten thousand million pairs is more than an integer; sums are made in fixed point.
//!
//! # The bound of a pair
//!
//! `u`, which is `2^-23` in single precision and `2^-52` in double, is more than the relative error of an addition, a
//! subtraction or a multiplication, whichever way the adapter rounds; `4 u` is more than that of a division or an inverse
//! square root (in double precision: see below). [`super::self_test`] looks whether that is so. Vertices are exact, their
//! differences are pinned, so that no compiler takes them apart; all the rest are sums of products, and the bounds hold for
//! each grouping and contraction of those. To first order in `u`:
//!
//! * A difference is off by `u` a coordinate, the square of its length by `5 u` of itself, the inverse of the length by `6.5 u`,
//!   a coordinate of the unit vector by `8.5 u` of itself, the dot product of two by `20 u`, and `D1`, `D2` by `delta_D = 69 u`,
//!   below [`CORNERS`]` / 2`.
//! * `f x e` is off by `4 sqrt(2) u |e| |f|`; `q` by `10.7 u |e| |f| / |c| + 14.5 u |q|`; and `P1` by `delta_P = 10.7 u s1 + 22 u |P1|`
//!   with `s1 = |e| |f| / (|b| |c|)`. [`LEVER`] and [`HEIGHT`] are above that.
//! * Let `m = min(max(D1, |P1|), max(D2, |P2|))`. Where `(delta_P1 + delta_P2 + 2 delta_D) / m <= 1/8` ([`DOUBT`] is less), the
//!   computed and the true `z1` are on the same side of the negative axis, as in [`crate::kernels::direct::block`], and with
//!   `|z1| >= max(D1, |P1|)` their arguments differ by
//!   `asin((|D1| delta_P1 + |P1| delta_D) / (|z1| |z1'|)) <= 1.15 (delta_P1 + delta_D |P1| / m) / m`. The same for `z2`.
//! * The product is off by `4 u (|D1 D2| + |P1 P2|)` in its real part and by `4 u (|P1 D2| + |P2 D1|)` in the
//!   imaginary one, which turn it by `12 u (|P1| + |P2|) / m` at most. It does not cross the negative axis, because the factor
//!   `D2 / |b| + D1 / |d|`, which is not negative, counts as 0 where it is computed as negative.
//! * The arctangent is off by `16 u |theta|`: its series of seven terms by `(1/3)^14 / 15 < u / 8`, in double precision of
//!   sixteen by `(1/3)^32 / 33 < u / 8`; the rest is rounding. As `|theta| <= pi (|P1| + |P2|) / m`, that is below
//!   `50 u (|P1| + |P2|) / m`.
//!
//! Together, with `g = 1/|b| + 1/|d|`: `u g / m (16.1 |e| |f| / |c| + (90.8 + 83 / m) |q|)`. [`SPAN`], [`TURN`] and [`TILT`] are
//! above that, and all of it is taken 1.01 times ([`ROUNDED_UP`]) for the errors of the bound itself and of higher order.
//!
//! In single precision, numbers below `2^-126` may count as 0. With all four distances above `10^-8` ([`tiny_square`]; nearer
//! pairs are in doubt) and `10^-15` added to the lengths of segments ([`tiny_length`]), what that costs is below a hundredth of
//! the bound; and with coordinates below 1 nothing overflows. In double precision it is numbers below `2^-1022`, distances
//! above `10^-18`, and `10^-18` added to the lengths: the bound of a pair is above `u SPAN 10^-36 / 16 > 10^-52`, and what
//! is lost is `2^-1020` times two inverses of distances and one of `m`, which is above `CORNERS u / DOUBT`: below `10^-255`.
//!
//! # Inverses in double precision
//!
//! Vulkan asks of doubles no more than of singles. Sums and products of doubles are rounded properly by all hardware that has
//! them; of the rest nothing is used but conversions. An inverse (square root) begins in single precision and is refined:
//!
//! * Where `y` is off by `2^-20` of itself from `1 / sqrt(x)`, `r = 1 - x y^2` is below `2^-18.9`, and
//!   `1 / sqrt(x) = y (1 - r)^(-1/2)` is `y (1 + r / 2 + 3 r^2 / 8)` but for `r^3 / 3 < u / 16` of itself. As computed, `r` is off by
//!   `2 u`, whichever way the product is grouped, which counts half; then one addition rounds by `u`, and all else is
//!   `2^-17 u`. Together that is below `3 u`.
//! * Where `z` is off by `2^-20` from `1 / y`, `r = 1 - y z` is below `2^-20`, and `x / y = x z / (1 - r)` is `x z (1 + r + r^2)` but
//!   for `2 r^3 < u / 16`. As computed, `r` is off by `u`, and an addition and a product round by `u`: below `4 u`.
//!
//! In single precision `2^-20` is `8 * 2^-23`: 4 for the operation and 1 for the conversion are less. Its range has room for
//! squares of distances from `10^-36` to 12; for `m`, which is above `10^-13`; and for the denominator of the arctangent, above
//! `m^2 / 2` and below 100, since `|P1|` and `|P2|` are 1 at most and `|D1|` and `|D2|` 4. Roots of squares of lengths go
//! into the bound alone and are taken in single precision: what is off by a millionth of itself is within the hundredth of
//! [`ROUNDED_UP`], and what counts as 0 there, below `2^-126`, is that of a length below `10^-18`.
//!
//! Pairs in doubt count as 0, which is off by less than `pi`. Where there are more than 32 bits hold, nothing is known.
//!
//! # The bound of a sum
//!
//! Up to [`COLUMNS`] angles are added in the precision of the program, off by `u` of each partial sum, which is added to the
//! bound; then in units of `2^-44`, exactly, with a unit for the conversion. Ten thousand million pairs lose less
//! than `10^-5` by that. An angle that is certain is off by less than 1: those of `z1` and of `z2` by `1.15 / 8` at most, their product by
//! `12 u`. The bound above may be larger, since its `m` is the smaller one of both, and counts as 1 then: in double precision it came
//! to 90,000 for a pair of short and long segments at a small distance. An angle is below `pi`, so a workgroup's 1024 by 64
//! pairs stay below the 500,000 that 64 bits hold; the sum of a pair of curves has 96.
//!
//! # Vertices that are not exact
//!
//! Where coordinates had to be rounded, the sum is that of polylines whose vertices are where they were rounded to. They have
//! the same linking number if no two segments can meet on the way there: if these are further apart than `2 sqrt(3)`
//! times the radius, which is [`REACH`] or less. That is looked at for every pair of segments: along the axes; and by the
//! volume of the tetrahedron of their ends, since their lines are `|q| |a| |c| / (|e| |f|)` apart or more. Where neither
//! shows it, nothing is known of the pair of curves.

use super::Engine;
use super::commands::{Buffer, Command, Stage};
use super::error::Trouble;
use super::fixed;
use super::frame::Frame;
use super::layout::{AngleSum, Tile, word};
use super::precision::{Precision, Real};
use super::tiles::{Shape, cut};
use crate::kernels::Estimate;
use crate::kernels::barnes_hut::LEAF_SEGMENTS;
use crate::pairs::Pair;
use std::f64::consts::{PI, TAU};

/// What sums are made with.
pub(super) const SUMS_PROGRAM: &str = include_str!("sums.wgsl");

/// Threads of a workgroup.
pub(super) const THREADS: u32 = 64;

/// Columns that are summed before the sum goes into fixed point.
pub(super) const COLUMNS: u32 = 64;

/// More than the relative error of an operation in single precision.
pub(super) const UNIT_ERROR: f64 = f32::UNIT_ERROR;

/// Twice the error of `D1`, in units of [`Real::UNIT_ERROR`], like those that follow.
const CORNERS: f64 = 144.0;
/// Of `P1`, for each `s1`.
const LEVER: f64 = 14.0;
/// Of `P1`, for each `|P1|`.
const HEIGHT: f64 = 25.0;
/// Of the angle, for each `g |e| |f| / (|c| m)`.
const SPAN: f64 = 17.0;
/// Of the angle, for each `g |q| / m`.
const TURN: f64 = 92.0;
/// Of the angle, for each `g |q| / m^2`.
const TILT: f64 = 84.0;
/// Largest error of `z1` and of `z2`, relative to `m`, at which their arguments are certain; less than 1/8.
const DOUBT: f64 = 0.1;
/// The distance at which segments may meet if vertices are off by 1 along each axis: more than `2 sqrt(3)`.
pub(super) const REACH: f64 = 3.6;
/// More than the error of `q`, for each `|e| |f| / |c|`.
const SKEW: f64 = 40.0;
/// What a bound is taken times.
const ROUNDED_UP: f64 = 1.01;

/// Added to the length of a segment.
const fn tiny_length(precision: Precision) -> f64 {
    match precision {
        Precision::Single => 1e-15,
        Precision::Double => 1e-18,
    }
}

/// Squares of distances below this are in doubt.
const fn tiny_square(precision: Precision) -> f64 {
    match precision {
        Precision::Single => 1e-16,
        Precision::Double => 1e-36,
    }
}

// Leaves of trees are tiles of the smaller shape.
const _: () = assert!(LEAF_SEGMENTS <= SHAPES[0].rows && LEAF_SEGMENTS <= SHAPES[0].columns);

/// How work is cut: rows of a tile, and steps of [`COLUMNS`] columns.
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

/// A program for each of [`SHAPES`].
pub(super) fn stages<R: Real>() -> [Stage; 2] {
    let [small, large] = match R::PRECISION {
        Precision::Single => ["direct, small", "direct"],
        Precision::Double => ["direct, small, double", "direct, double"],
    };
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

/// The program for tiles of a shape.
fn source<R: Real>(shape: Shape) -> String {
    let whole = [
        ("THREADS", THREADS),
        ("ROWS", shape.rows),
        ("COLUMNS", COLUMNS),
        ("STEPS", shape.columns / COLUMNS),
        ("WORDS", word!(AngleSum)),
        ("VALUE", word!(AngleSum.value)),
        ("BOUND", word!(AngleSum.bound)),
        ("DOUBTS", word!(AngleSum.doubts)),
        ("NEAR", word!(AngleSum.near)),
    ];
    let real = [
        ("UNIT_ERROR", R::UNIT_ERROR),
        ("CORNERS", CORNERS),
        ("LEVER", LEVER),
        ("HEIGHT", HEIGHT),
        ("SPAN", SPAN),
        ("TURN", TURN),
        ("TILT", TILT),
        ("DOUBT", DOUBT),
        ("REACH", REACH),
        ("SKEW", SKEW * R::UNIT_ERROR),
        ("TINY_LENGTH", tiny_length(R::PRECISION)),
        ("TINY_SQUARE", tiny_square(R::PRECISION)),
        ("ROUNDED_UP", ROUNDED_UP * R::UNIT_ERROR),
        ("MOST", 1.0 / R::UNIT_ERROR),
        ("ATAN_HALF", 0.5f64.atan()),
        ("HALF_PI", PI / 2.0),
        ("PI", PI),
    ];
    super::program_in::<R>(&whole, &real, &[SUMS_PROGRAM, include_str!("direct.wgsl")])
}

/// The linking numbers of all pairs, in one list of commands unless they are millions.
pub(super) fn linking_numbers<R: Real>(
    engine: &mut Engine,
    frame: &Frame<R>,
    pairs: &[Pair],
) -> Result<Vec<Estimate>, Trouble> {
    // As many as there is room for the sums of.
    let room = engine.device.most_bytes().saturating_sub(bytes(0));
    let most = (room / size_of::<AngleSum>() as u64).max(1) as usize;
    if pairs.len() > most {
        let mut all = Vec::with_capacity(pairs.len());
        for part in pairs.chunks(most) {
            all.extend(linking_numbers(engine, frame, part)?);
        }
        return Ok(all);
    }
    let segments = |&(i, j): &Pair| [frame.segments(i), frame.segments(j)];
    // Most pairs are small together or large together; what wastes fewer threads is taken.
    let shape_of = |[m, n]: [u32; 2]| usize::from(m.max(n) > 2 * SHAPES[0].rows);
    let mut tiles = SHAPES.map(|_| Vec::new());
    for (k, pair) in (0..).zip(pairs) {
        let (i, j) = *pair;
        let [m, n] = segments(pair);
        if !frame.has_numbers(*pair) {
            continue;
        }
        // The same sum whichever curve is named first.
        let (rows, columns) = match (m, i) > (n, j) {
            true => (i, j),
            false => (j, i),
        };
        let shape = shape_of([m, n]);
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
    let size = bytes(pairs.len());
    let mut commands = vec![Command::Clear(super::SUMS, size)];
    for ((shape, stage), tiles) in SHAPES.iter().zip(stages::<R>()).zip(&tiles) {
        let per_group = THREADS / shape.rows;
        let sums = [(super::SUMS, size)];
        engine.dispatch_tiles(&mut commands, stage, frame, tiles, per_group, &sums)?;
    }
    commands.push(Command::Download(super::SUMS, size));
    let found = engine.run(frame, commands)?;
    let listed = tiles.iter().map(|tiles| tiles.len() as u32);
    let sums = read(engine, &found[0], listed.fold(0, u32::wrapping_add))?;
    let estimate = |(pair, sum): (&Pair, &AngleSum)| match frame.has_numbers(*pair) {
        true => estimate(sum),
        false => Estimate::UNKNOWN,
    };
    Ok(pairs.iter().zip(&sums).map(estimate).collect())
}

/// The sums of tiles that are in a buffer already, each no larger than the smaller shape.
pub(super) fn sum_tiles(
    engine: &mut Engine,
    frame: &Frame,
    pairs: usize,
    tiles: Buffer,
    count: u32,
) -> Result<Vec<AngleSum>, Trouble> {
    if count == 0 {
        return Ok(vec![AngleSum::default(); pairs]);
    }
    let (shape, [stage, _]) = (SHAPES[0], stages::<f32>());
    let size = bytes(pairs);
    let work = u64::from(LEAF_SEGMENTS * LEAF_SEGMENTS);
    let mut commands = vec![Command::Clear(super::SUMS, size)];
    let per_group = THREADS / shape.rows;
    let sums = [(super::SUMS, size)];
    engine.dispatch_buffer(
        &mut commands,
        stage,
        frame,
        (tiles, count, work),
        per_group,
        &sums,
    );
    commands.push(Command::Download(super::SUMS, size));
    let found = engine.run(frame, commands)?;
    read(engine, &found[0], count)
}

/// Bytes of the sums of so many pairs, with the count of tiles behind them.
fn bytes(pairs: usize) -> u64 {
    (pairs * size_of::<AngleSum>() + size_of::<u32>()) as u64
}

/// The sums, where all tiles were gone through ([`Engine::broken_off`]).
pub(super) fn read(
    engine: &mut Engine,
    found: &[u8],
    tiles: u32,
) -> Result<Vec<AngleSum>, Trouble> {
    let (sums, done) = found.split_at(found.len() - size_of::<u32>());
    match bytemuck::pod_read_unaligned::<u32>(done) == tiles {
        true => Ok(bytemuck::pod_collect_to_vec(sums)),
        false => Err(engine.broken_off()),
    }
}

/// What a sum says of the linking number.
pub(super) fn estimate(sum: &AngleSum) -> Estimate {
    if sum.near > 0 {
        return Estimate::UNKNOWN;
    }
    let value = fixed::number(sum.value);
    let bound = fixed::number(sum.bound) + PI * f64::from(sum.doubts);
    Estimate {
        value: value / TAU,
        bound: (1.000_001 * bound + 1e-15 * value.abs()) / TAU,
    }
}
