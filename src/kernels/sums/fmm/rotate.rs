//! Rotations of moments about the axes.
//!
//! A rotation about z multiplies by phases. A rotation about y is a rotation about z between two
//! exchanges of y and z, which are constant matrices (Dehnen 2014, section 3.3); only a fourth of
//! their entries are not 0.

use super::harmonics::{Lanes, MOST, at};
use std::sync::LazyLock;

/// Exchange of y and z: `f(x, z, y)` for every real and imaginary part of every harmonic. Each row
/// of the matrix has the indices and coefficients of its entries.
#[derive(Clone, Debug)]
pub(super) struct Swap(Vec<Vec<(u32, f64)>>);

/// The exchange up to the maximum order.
pub(super) static SWAP: LazyLock<Swap> = LazyLock::new(Swap::new);

type Complex = [f64; 2];

impl Swap {
    /// Computes the matrix degree by degree, from the derivatives. All entries are multiples of
    /// `2^-n`, and exact.
    fn new() -> Swap {
        let mut rows = vec![Vec::new(); at(MOST + 1, 0)];
        // Coefficients of R_n^k(x, z, y), for k from -n to n, in terms of R_n^l.
        let mut before: Vec<Vec<Complex>> = vec![vec![[1.0, 0.0]]];
        for n in 1..=MOST as isize {
            let get = |k: isize, l: isize| -> Complex {
                let m = n - 1;
                match k.abs() <= m && l.abs() <= m {
                    true => before[(k + m) as usize][(l + m) as usize],
                    false => [0.0; 2],
                }
            };
            let size = 2 * n as usize + 1;
            let mut next = vec![vec![[0.0; 2]; size]; size];
            for k in -n..=n {
                for l in -n..=n {
                    let entry = if l.abs() < n {
                        let (u, w) = (get(k + 1, l), get(k - 1, l));
                        // (u + w) / 2i
                        [0.5 * (u[1] + w[1]), -0.5 * (u[0] + w[0])]
                    } else {
                        let m = l - l.signum();
                        let (u, w, z) = (get(k + 1, m), get(k - 1, m), get(k, m));
                        let half = [0.5 * (u[0] - w[0]), 0.5 * (u[1] - w[1])];
                        match l > 0 {
                            // -((u - w) / 2 - i z)
                            true => [-half[0] - z[1], -half[1] + z[0]],
                            // (u - w) / 2 + i z
                            false => [half[0] - z[1], half[1] + z[0]],
                        }
                    };
                    next[(k + n) as usize][(l + n) as usize] = entry;
                }
            }
            for k in 0..=n {
                for l in 0..=n {
                    let [a, b] = next[(k + n) as usize][(l + n) as usize];
                    let [c, d] = match l {
                        0 => [0.0; 2],
                        // R^-l is (-1)^l conj R^l.
                        _ => {
                            let sign = if l % 2 == 0 { 1.0 } else { -1.0 };
                            next[(k + n) as usize][(n - l) as usize].map(|x| x * sign)
                        }
                    };
                    let [i, j] = [k, l].map(|order| at(n as usize, order as usize));
                    let j = j as u32;
                    let mut push = |row: usize, column: u32, x: f64| {
                        if x != 0.0 {
                            rows[row].push((column, x));
                        }
                    };
                    push(i, j, a + c);
                    push(i + 1, j, b + d);
                    if l > 0 {
                        push(i, j + 1, d - b);
                        push(i + 1, j + 1, a - c);
                    }
                }
            }
            before = next;
        }
        Swap(rows)
    }

    /// Exchanges y and z.
    #[inline(always)]
    pub fn apply<const L: usize>(&self, order: usize, from: &[Lanes<L>], to: &mut [Lanes<L>]) {
        for i in at(1, 0)..at(order + 1, 0) {
            let mut sum = [0.0; L];
            for &(j, c) in &self.0[i] {
                let x = &from[j as usize];
                for l in 0..L {
                    sum[l] += c * x[l];
                }
            }
            to[i] = sum;
        }
    }
}

/// Multiplies order `k` by the phase `(c + i s)^k`.
#[inline(always)]
pub(super) fn turn<const L: usize>(
    order: usize,
    c: &Lanes<L>,
    s: &Lanes<L>,
    moments: &mut [Lanes<L>],
) {
    let (mut x, mut y) = (*c, *s);
    for k in 1..=order {
        for n in k..=order {
            let i = at(n, k);
            for l in 0..L {
                let (re, im) = (moments[i][l], moments[i + 1][l]);
                moments[i][l] = x[l] * re - y[l] * im;
                moments[i + 1][l] = x[l] * im + y[l] * re;
            }
        }
        for l in 0..L {
            (x[l], y[l]) = (x[l] * c[l] - y[l] * s[l], x[l] * s[l] + y[l] * c[l]);
        }
    }
}
