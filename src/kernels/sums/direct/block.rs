//! Gauss integral of two blocks of segments, with its error bound; the last step of every
//! summation.
//!
//! # Angle of a segment pair
//!
//! For segments `k0 k1` and `l0 l1` with `a = l0 - k0`, `b = l0 - k1`, `c = l1 - k1`,
//! `d = l1 - k0`, Arai's sum (Arai 2013, equation 3) has the term `theta = arg z1 + arg z2`, where
//! `z1 = d1 + i p`, `z2 = d2 + i p`,
//!
//! ```text
//! p  = a . (b x c) = a . (f x e),  e = k1 - k0,  f = l1 - l0
//! d1 = |a| |b| |c| + (a . b) |c| + (b . c) |a| + (c . a) |b|
//! d2 = |a| |d| |c| + (a . d) |c| + (d . c) |a| + (c . a) |d|
//! ```
//!
//! and the linking number is the sum of all `theta`, divided by `2 pi`. `theta` is half the solid
//! angle of the plane parallelogram `a b c d`, so it is below `pi`. So one argument, that of
//! `z1 z2`, is enough, and `d1 + d2 >= 0`.
//!
//! # Error bound of a segment pair
//!
//! Let `u = 2^-53`. To first order, differences of input floats have a relative error of `u` in
//! each coordinate, lengths of `3.5 u`, and a dot product is off by `5 u` times the product of the
//! lengths. Then `d1`, summed as below, is off by `50 u |a| |b| |c|` at most (and `d2` likewise),
//! and `p` by `8 sqrt(2) u |a| |e| |f|`. `delta1` is the sum of both, with 64 in place of 50 and 12
//! in place of `8 sqrt(2)`, which amply covers higher orders, and with [`TINY`] for underflow.
//!
//! Let `m1 = max(d1, |p|)`, as computed, and let `kappa1` be between `delta1 / m1` and twice that.
//! If `kappa1 <= 1/8`, either the real part or the sign of the imaginary part is certain. So the
//! true and the computed `z1` do not lie on different sides of the negative axis, and their
//! arguments differ by `asin(8/7 kappa1) < 1.15 kappa1` at most. The same holds for `z2`. The
//! product rounds by `3 u`. It does not cross the negative axis either, because a negative
//! `d1 + d2`, which is a rounding error, is replaced by 0: this moves the argument back to `pi`,
//! towards the true one.
//!
//! If `kappa1 + kappa2 > 1/8`, the pair is undecided: it contributes 0, which is off by less than
//! `pi`. A pair that touches is always undecided: the origin lies in one of the two triangles,
//! whose `p = 0` and `d <= 0` are computed as at most `delta`. If no other pair is undecided, the
//! true sum of the others is a half-integer, and the two integers next to it are both within the
//! bound. If another pair is undecided, the bound is at least 1.
//!
//! # Error bound of the sum
//!
//! [`Formula::Arctangent`] adds an arctangent for each pair, which is off by `10 u` with its turns.
//! The rounding error of each addition is added to the bound. [`Formula::AngleSum`] (Bertolazzi et
//! al. 2019) multiplies the complex numbers instead, with an error of `3 u` for each product. It
//! counts quarter turns: the running product is rotated to within an eighth of a turn of the
//! positive axis, exactly, and the next factor to the right half plane. So their product is always
//! an eighth of a turn away from the negative axis, and no count of turns is uncertain, apart from
//! those of a single pair (see above).

use crate::curve::vector::sub;
use crate::kernels::Estimate;
use crate::simd::{Simd, dispatch_wide};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Method to sum the angles. Both methods have the same bound, up to rounding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Formula {
    /// One arctangent for each segment pair.
    Arctangent,
    /// A product of complex numbers, and one arctangent for each block.
    AngleSum,
}

/// Vertices of consecutive segments, as an array for each axis; one more than segments. Coordinates
/// are from -1 to 1: the caller scales them by a power of two.
pub(crate) type Strip<'a> = [&'a [f64]; 3];

/// Half a unit in the last place of 1.
const U: f64 = f64::EPSILON / 2.0;

/// Upper bound of all errors by underflow: squares of coordinates underflow by `2^-1074`, lengths
/// by its root, and products of three lengths, each below 4, by less than `1e-158`.
const TINY: f64 = 1e-150;

/// Number of columns (segments of the second strip) in a block.
const COLUMNS: usize = 64;

/// Number of columns of a short block, which costs less to set up.
const FEW_COLUMNS: usize = 16;

/// Padding of a row: there is one more vertex than columns, and loops over vertices run to the end
/// of a vector register.
const PADDING: usize = 8;

/// Sizes of the rows of both kinds of blocks.
const SHORT: usize = FEW_COLUMNS + PADDING;
const LONG: usize = COLUMNS + PADDING;

/// Returns the contribution of two strips to the linking number: all pairs of a segment of one and
/// a segment of the other.
pub(crate) fn gauss_sum(formula: Formula, rows: Strip<'_>, columns: Strip<'_>) -> Estimate {
    dispatch_wide!(simd => sum_all(simd, formula, rows, columns))
}

/// [`gauss_sum`] for an instruction set. The results have the same bits with AVX2 and AVX-512.
#[inline(always)]
pub(super) fn sum_all<S: Simd>(
    _simd: S,
    formula: Formula,
    rows: Strip<'_>,
    columns: Strip<'_>,
) -> Estimate {
    let mut sum = Sum::default();
    let last = columns[0].len().saturating_sub(1);
    for first in (0..last).step_by(COLUMNS) {
        let end = last.min(first + COLUMNS);
        let columns = columns.map(|v| &v[first..=end]);
        sum.add(match (formula, end - first <= FEW_COLUMNS) {
            (Formula::Arctangent, true) => Block::<SHORT>::new(columns).sum::<S, false>(rows),
            (Formula::Arctangent, false) => Block::<LONG>::new(columns).sum::<S, false>(rows),
            (Formula::AngleSum, true) => Block::<SHORT>::new(columns).sum::<S, true>(rows),
            (Formula::AngleSum, false) => Block::<LONG>::new(columns).sum::<S, true>(rows),
        });
    }
    sum.estimate()
}

/// Sum of estimates, with the rounding errors of the sum in the bound.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Sum {
    value: f64,
    bound: f64,
    rounding: f64,
}

impl Sum {
    /// Adds a part.
    #[inline(always)]
    pub fn add(&mut self, part: Estimate) {
        self.value += part.value;
        self.bound += part.bound;
        self.rounding += self.value.abs();
    }

    /// Returns the sum of all parts. Adding the bounds rounds only their last places, which the
    /// margins of the bounds cover.
    #[inline(always)]
    pub fn estimate(&self) -> Estimate {
        Estimate::new(self.value, 1.001 * (self.bound + U * self.rounding))
    }
}

/// Returns `a b + c`, rounded once if the CPU has FMA.
#[inline(always)]
fn fma<S: Simd>(a: f64, b: f64, c: f64) -> f64 {
    if S::FMA { a.mul_add(b, c) } else { a * b + c }
}

/// Returns `a . b`, as `a0 b0 + (a1 b1 + a2 b2)`; the sums are fused if the CPU has FMA.
#[inline(always)]
fn fused_dot<S: Simd>(a: [f64; 3], b: [f64; 3]) -> f64 {
    fma::<S>(a[0], b[0], fma::<S>(a[1], b[1], a[2] * b[2]))
}

/// The columns and their values for the current row. All loops are over arrays, so that the
/// compiler vectorizes them.
struct Block<const N: usize> {
    /// Number of columns. The vectors are padded with copies of the last vertex, which contribute
    /// nothing.
    columns: usize,
    filled: usize,
    vertices: [[f64; N]; 3],
    edges: [[f64; N]; 3],
    lengths: [f64; N],
    /// Distances of the vertices from the start and from the end of the row.
    near: [[f64; N]; 2],
    /// Dot products of the differences to the ends of each column, from the start and from the end
    /// of the row.
    along: [[f64; N]; 2],
    /// Dot products of the differences to the ends of the row, from each vertex.
    across: [f64; N],
    /// The sum of the angles; or the real part and the imaginary part of the product of complex
    /// numbers, and the number of its quarter turns.
    sums: [[f64; N]; 3],
    /// Sum of the error bounds.
    errors: [f64; N],
}

impl<const N: usize> Block<N> {
    #[inline(always)]
    fn new(strip: Strip<'_>) -> Block<N> {
        let columns = strip[0].len() - 1;
        let filled = columns.next_multiple_of(8);
        let zeros = [0.0; N];
        let mut block = Block {
            columns,
            filled,
            vertices: [zeros; 3],
            edges: [zeros; 3],
            lengths: zeros,
            near: [zeros; 2],
            along: [zeros; 2],
            across: zeros,
            sums: [zeros; 3],
            errors: zeros,
        };
        for (to, from) in block.vertices.iter_mut().zip(strip) {
            to[..=columns].copy_from_slice(from);
            to[columns + 1..].fill(from[columns]);
        }
        block
    }

    #[inline(always)]
    fn vertex(&self, j: usize) -> [f64; 3] {
        let [x, y, z] = &self.vertices;
        [x[j], y[j], z[j]]
    }

    #[inline(always)]
    fn sum<S: Simd, const PRODUCT: bool>(&mut self, rows: Strip<'_>) -> Estimate {
        let n = self.filled.min(N - PADDING);
        for j in 0..n {
            let f = sub(self.vertex(j + 1), self.vertex(j));
            let [x, y, z] = &mut self.edges;
            (x[j], y[j], z[j]) = (f[0], f[1], f[2]);
            self.lengths[j] = fused_dot::<S>(f, f).sqrt();
        }
        if PRODUCT {
            self.sums[0] = [1.0; N];
        }
        let [x, y, z] = rows;
        let count = x.len().min(y.len()).min(z.len());
        let Some(end) = count.checked_sub(1) else {
            return Sum::default().estimate();
        };
        let point = |i: usize| [x[i], y[i], z[i]];
        self.start::<S>(point(0), n);
        for i in 0..end {
            self.row::<S, PRODUCT>(point(i), point(i + 1), n);
        }
        self.finish::<S, PRODUCT>(end, n)
    }

    /// Computes distances and dot products from the first vertex of all rows, as if it were the end
    /// of a row.
    #[inline(always)]
    fn start<S: Simd>(&mut self, k: [f64; 3], n: usize) {
        for j in 0..n + 4 {
            let a = sub(self.vertex(j), k);
            self.near[1][j] = fused_dot::<S>(a, a).sqrt();
        }
        for j in 0..n {
            let (a, d) = (sub(self.vertex(j), k), sub(self.vertex(j + 1), k));
            self.along[1][j] = fused_dot::<S>(a, d);
        }
    }

    /// Adds the angles of one row, the segment `k0 k1`.
    #[inline(always)]
    fn row<S: Simd, const PRODUCT: bool>(&mut self, k0: [f64; 3], k1: [f64; 3], n: usize) {
        let e = sub(k1, k0);
        let length = 12.0 * U * fused_dot::<S>(e, e).sqrt();
        self.near.swap(0, 1);
        self.along.swap(0, 1);
        for j in 0..n + 4 {
            let l = self.vertex(j);
            let (a, b) = (sub(l, k0), sub(l, k1));
            self.across[j] = fused_dot::<S>(a, b);
            self.near[1][j] = fused_dot::<S>(b, b).sqrt();
        }
        for j in 0..n {
            let (l0, l1) = (self.vertex(j), self.vertex(j + 1));
            let (a, b, c) = (sub(l0, k0), sub(l0, k1), sub(l1, k1));
            let (na, nd) = (self.near[0][j], self.near[0][j + 1]);
            let (nb, nc) = (self.near[1][j], self.near[1][j + 1]);
            let bc = fused_dot::<S>(b, c);
            self.along[1][j] = bc;
            let f = [self.edges[0][j], self.edges[1][j], self.edges[2][j]];
            let cross = [
                fma::<S>(f[1], e[2], -(f[2] * e[1])),
                fma::<S>(f[2], e[0], -(f[0] * e[2])),
                fma::<S>(f[0], e[1], -(f[1] * e[0])),
            ];
            let p = fused_dot::<S>(a, cross);
            let diagonal = fma::<S>(na, nc, fused_dot::<S>(a, c));
            let (ab, cd, ad) = (self.across[j], self.across[j + 1], self.along[0][j]);
            let d1 = fma::<S>(nb, diagonal, fma::<S>(nc, ab, na * bc));
            let d2 = fma::<S>(nd, diagonal, fma::<S>(na, cd, nc * ad));

            let size = p.abs();
            let m1 = if d1 > size { d1 } else { size };
            let m2 = if d2 > size { d2 } else { size };
            let slack = fma::<S>(na, length * self.lengths[j], TINY);
            let ac = 64.0 * U * na * nc;
            let (delta1, delta2) = (fma::<S>(ac, nb, slack), fma::<S>(ac, nd, slack));
            // Divided by the power of two below the product, which is faster; the result is above
            // 1/8 if the product is 0.
            let parts = fma::<S>(delta1, m2, fma::<S>(delta2, m1, 1e-307));
            let kappa = parts * reciprocal_power(m1 * m2);
            let certain = kappa <= 0.125;
            let sum = d1 + d2;
            let sum = if sum > 0.0 { sum } else { 0.0 };
            let (x, y) = (fma::<S>(d1, d2, -(p * p)), p * sum);
            let x = if certain { x } else { 1.0 };
            let y = if certain { y } else { 0.0 };
            self.errors[j] += if certain { kappa } else { PI };
            // Rotates the factor to the right half plane; the direction of the half turn follows
            // the sign of p.
            let half = if x < 0.0 { 2f64.copysign(p) } else { 0.0 };
            let y = if x < 0.0 { -y } else { y };
            let x = x.abs();
            if PRODUCT {
                let [sx, sy, turns] = &mut self.sums;
                let tx = fma::<S>(sx[j], x, -(sy[j] * y));
                let ty = fma::<S>(sx[j], y, sy[j] * x);
                let (tx, ty, quarter) = turned(tx, ty);
                let scale = reciprocal_power(tx);
                sx[j] = tx * scale;
                sy[j] = ty * scale;
                turns[j] += half + quarter;
            } else {
                let (x, y, quarter) = turned(x, y);
                let angle = fma::<S>(half + quarter, FRAC_PI_2, arctangent::<S>(x, y));
                let sum = self.sums[0][j] + angle;
                self.sums[0][j] = sum;
                self.errors[j] = fma::<S>(U, sum.abs(), self.errors[j]);
            }
        }
    }

    #[inline(always)]
    fn finish<S: Simd, const PRODUCT: bool>(&self, rows: usize, n: usize) -> Estimate {
        let mut sum = Sum::default();
        // Additional error of every pair: see the module documentation.
        let each = rows as f64 * 16.0 * U;
        for j in 0..n {
            let [sx, sy, turns] = &self.sums;
            let value = match PRODUCT {
                true => turns[j] * FRAC_PI_2 + arctangent::<S>(sx[j], sy[j]),
                false => sx[j],
            };
            let bound = 1.16 * self.errors[j] + each + 16.0 * U * (1.0 + value.abs());
            // Padding has no error, but may come near the row even if no segment does.
            if j < self.columns {
                sum.add(Estimate { value, bound });
            }
        }
        let Estimate { value, bound } = sum.estimate();
        Estimate::new(value / TAU, 1.001 * (bound + 4.0 * U * value.abs()) / TAU)
    }
}

/// Returns a complex number rotated by a quarter turn if this brings it nearer to the positive
/// axis, and the number of quarter turns.
#[inline(always)]
fn turned(x: f64, y: f64) -> (f64, f64, f64) {
    let over = y.abs() > x;
    let sign = 1f64.copysign(y);
    (
        if over { y.abs() } else { x },
        if over { -sign * x } else { y },
        if over { sign } else { 0.0 },
    )
}

/// Returns a power of two from `1 / x` to `2 / x`, for normal `x > 0`; `2^1023` for smaller ones.
#[inline(always)]
fn reciprocal_power(x: f64) -> f64 {
    const EXPONENT: u64 = 0x7ff << 52;
    f64::from_bits((2046 << 52) - (x.to_bits() & EXPONENT))
}

/// `atan(1/2)`, rounded to the nearest.
const ATAN_HALF: f64 = 0.463_647_609_000_806_1;

/// Returns the argument of a complex number within an eighth of a turn of the positive axis; the
/// error is below `6 u`.
///
/// Arguments with a tangent above 1/3 are rotated back by `atan(1/2)`. The tangent is then between
/// `-1/7` and `1/3`, with a relative error of `3 u`. The truncation error of 16 terms of its
/// alternating series is below the next term, `6e-18`.
#[inline(always)]
fn arctangent<S: Simd>(x: f64, y: f64) -> f64 {
    let size = y.abs();
    let over = 3.0 * size > x;
    let (top, bottom) = (fma::<S>(2.0, size, -x), fma::<S>(2.0, x, size));
    let top = if over { top } else { size };
    let bottom = if over { bottom } else { x };
    let base = if over { ATAN_HALF } else { 0.0 };
    let t = top / bottom;
    let s = t * t;
    let mut series = -1.0 / 31.0;
    let mut k = 14i32;
    while k >= 0 {
        let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
        series = fma::<S>(series, s, sign / f64::from(2 * k + 1));
        k -= 1;
    }
    (base + t * series).copysign(y)
}
