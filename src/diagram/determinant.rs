//! Determinant of a link, `|Delta(-1)|`, from its Goeritz matrix.
//!
//! # Derivation
//!
//! The faces of a connected diagram are coloured like a chessboard. The faces of one colour are the
//! vertices of a graph, and each crossing is an edge between the two of its faces that have the
//! colour, with the weight 1 or -1: 1 if the upper strand, turned counterclockwise, sweeps these
//! faces. The Goeritz matrix is the Laplacian of this graph without the row and the column of one
//! face. The absolute value of its determinant is that of the link (Gordon & Litherland 1978, *On
//! the signature of a link*, Invent. math. 47).
//!
//! By the matrix tree theorem, the determinant is a sum of products of weights over the spanning
//! trees of the graph. A spanning tree assigns to each vertex but one its edge towards this one, so
//! there are at most as many as the product of the degrees of these vertices. It is computed modulo
//! primes below `2^31` whose product is larger than twice this bound, which determines it.

use super::Diagram;
use crate::simd::dispatch;
use num_bigint::BigUint;
use rayon::prelude::*;
use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};
use std::{array, iter};

impl Diagram {
    /// Returns the determinant.
    pub(super) fn determinant(&self) -> BigUint {
        let split = self.components.len() > 1 && self.components.iter().any(Vec::is_empty);
        if split || self.connected_components().len() != 1 {
            return BigUint::ZERO;
        }
        if self.signs.is_empty() {
            return BigUint::from(1_u32);
        }
        let (faces, edges) = self.goeritz_graph();
        determinant(faces, &edges)
    }

    /// Returns the number of faces, and the edges of the checkerboard graph of the faces of one
    /// colour: for each crossing, two faces and a weight.
    fn goeritz_graph(&self) -> (usize, Vec<(usize, usize, i64)>) {
        let code = self.pd_code();
        // Both ends of each arc: four times the crossing, plus the place at it.
        let mut ends = vec![[usize::MAX; 2]; 2 * code.len() + 1];
        for (at, &arc) in code.as_flattened().iter().enumerate() {
            let ends = &mut ends[arc as usize];
            ends[usize::from(ends[0] != usize::MAX)] = at;
        }
        let arcs = code.as_flattened();
        let turned = |at: usize, by: usize| at / 4 * 4 + (at + by) % 4;
        let other_end = |at: usize| {
            let [a, b] = ends[arcs[at] as usize];
            if a == at { b } else { a }
        };
        // Corner `at` is to the left of the arc that leaves at place `at`. A walk along the face
        // leaves a corner by the next arc, and arrives at the corner with the index of its end.
        let mut faces = vec![usize::MAX; arcs.len()];
        let mut count = 0;
        for start in 0..faces.len() {
            let mut corner = start;
            while faces[corner] == usize::MAX {
                faces[corner] = count;
                corner = other_end(turned(corner, 1));
            }
            count += usize::from(corner == start && faces[start] == count);
        }
        // Colours alternate around a crossing and across an arc.
        let mut colours = vec![usize::MAX; code.len()];
        let mut front = vec![0];
        colours[0] = 0;
        while let Some(crossing) = front.pop() {
            for place in 0..4 {
                let end = other_end(4 * crossing + place);
                // To the left of the arc here is to its right there.
                let colour = (colours[crossing] + place + turned(end, 3) % 4) % 2;
                if colours[end / 4] == usize::MAX {
                    colours[end / 4] = colour;
                    front.push(end / 4);
                }
            }
        }
        // The corner with the colour 0, and the one opposite to it.
        let edges = colours.iter().enumerate().map(|(crossing, &place)| {
            let corner = 4 * crossing + place;
            // The upper strand has places 1 and 3.
            let weight = if place == 1 { 1 } else { -1 };
            (faces[corner], faces[corner + 2], weight)
        });
        (count, edges.collect())
    }
}

/// Returns the determinant of the Laplacian of a graph, without the row and the column of a vertex
/// that has edges.
fn determinant(faces: usize, edges: &[(usize, usize, i64)]) -> BigUint {
    let mut degrees = vec![0_u64; faces];
    for &(a, b, _) in edges {
        degrees[a] += 1;
        degrees[b] += 1;
    }
    // Removes the vertex with the largest degree, because the bound is then smallest.
    let root = (0..faces).max_by_key(|&f| degrees[f]).unwrap_or(0);
    let others = (0..faces).filter(|&f| f != root);
    let bound: BigUint = others.map(|f| BigUint::from(degrees[f].max(1))).product();
    let mut product = BigUint::from(1_u32);
    let numbers = (0..1 << 30).map(|k| (1_u32 << 31) - 1 - 2 * k);
    let primes = numbers.filter(|&n| is_prime(n));
    let primes = primes.take_while(|&prime| {
        let enough = product > &bound * 2_u32;
        product *= prime;
        !enough
    });
    let primes: Vec<u32> = primes.collect();
    let passes = primes.chunks(LANES);
    let passes = passes.map(|p| Moduli::new(array::from_fn(|k| p[k.min(p.len() - 1)])));
    let passes: Vec<Moduli> = passes.collect();
    let minor = |moduli: &Moduli| minor(faces, edges, root, moduli);
    let (first, program) = minor(&passes[0]);
    let others: Vec<_> = passes[1..].par_iter().map(|m| program.run(m)).collect();
    let found = iter::once(first).chain(others).flatten();
    let alone = |p: u32| minor(&Moduli::new([p; LANES])).0[0].expect("no pivot is 0");
    let residues = primes.iter().zip(found);
    let residues = residues.map(|(&p, found)| (p, found.unwrap_or_else(|| alone(p))));
    combine(residues.collect())
}

/// Number of primes of a pass.
const LANES: usize = 8;

/// Numbers modulo the primes of a pass.
type Residues = [u32; LANES];

/// Arithmetic modulo primes below `2^31`, with numbers times `2^32` (Montgomery 1985, *Modular
/// multiplication without trial division*, Math. Comp. 44).
struct Moduli {
    primes: Residues,
    /// `-1 / p` modulo `2^32`.
    inverses: Residues,
}

impl Moduli {
    fn new(primes: Residues) -> Moduli {
        // Each step of Newton's method doubles the number of bits that are right, at first three.
        let step = |p: u32, x: u32| x.wrapping_mul(2_u32.wrapping_sub(p.wrapping_mul(x)));
        let inverses = primes.map(|p| (0..4).fold(p, |x, _| step(p, x)).wrapping_neg());
        Moduli { primes, inverses }
    }

    fn of(&self, n: i64) -> Residues {
        let shifted = |p: i64| (n.rem_euclid(p) << 32) % p;
        self.primes.map(|p| shifted(p.into()) as u32)
    }

    /// Returns `a b + c`, for numbers up to the primes.
    #[inline(always)]
    fn multiply_add(&self, a: &Residues, b: &Residues, c: &Residues) -> Residues {
        array::from_fn(
            #[inline(always)]
            |k| {
                let (p, n) = (self.primes[k], u64::from(a[k]) * u64::from(b[k]));
                let multiple = (n as u32).wrapping_mul(self.inverses[k]);
                let product = ((n + u64::from(multiple) * u64::from(p)) >> 32) as u32;
                let sum = product.min(product.wrapping_sub(p)) + c[k];
                sum.min(sum.wrapping_sub(p))
            },
        )
    }

    /// Returns the negative inverses by Fermat's theorem; numbers equal to 0 for 0.
    fn negative_inverse(&self, n: &Residues) -> Residues {
        let none = [0; LANES];
        let (mut power, mut out) = (*n, self.of(1));
        for bit in 0..31 {
            let product = self.multiply_add(&out, &power, &none);
            let is_set = |k: usize| ((self.primes[k] - 2) >> bit) % 2 == 1;
            out = array::from_fn(|k| if is_set(k) { product[k] } else { out[k] });
            power = self.multiply_add(&power, &power, &none);
        }
        array::from_fn(|k| self.primes[k] - out[k])
    }
}

/// Index of a number in the elimination: the entries of the diagonal, 1, the other entries that are
/// not 0, and intermediate results.
type Slot = u32;

/// The elimination of a matrix as operations on numbers, to repeat it modulo other primes. No entry
/// counts as 0 because it is 0 modulo the first prime, so the operations hold modulo all primes
/// that divide no pivot.
#[derive(Default)]
struct Program {
    start: Vec<i64>,
    /// `to`, `a`, `b`: adds the product of `a` and `b`; stores the negative inverse of `a` if `b`
    /// is [`INVERT`].
    operations: Vec<[Slot; 3]>,
    slots: usize,
    /// Product of the pivots.
    product: Slot,
    /// Entries of the rows that are left, all 0. The determinant is the product if there are none.
    rest: Vec<Slot>,
}

const INVERT: Slot = Slot::MAX;

impl Program {
    /// Returns the determinant modulo each prime. `None` if the prime divides a pivot, or the rest
    /// is not 0.
    fn run(&self, moduli: &Moduli) -> [Option<u32>; LANES] {
        let mut values = self.values(moduli);
        values.resize(self.slots, [0; LANES]);
        dispatch!(apply_all(&mut values, &self.operations, moduli));
        self.determinant(&values, moduli)
    }

    fn determinant(&self, values: &[Residues], moduli: &Moduli) -> [Option<u32>; LANES] {
        let product = &values[self.product as usize];
        let plain = moduli.multiply_add(product, &[1; LANES], &[0; LANES]);
        array::from_fn(|k| {
            let mut rest = self.rest.iter().map(|&slot| values[slot as usize][k]);
            let holds = product[k] != 0 && rest.all(|n| n == 0);
            holds.then_some(if self.rest.is_empty() { plain[k] } else { 0 })
        })
    }

    fn values(&self, moduli: &Moduli) -> Vec<Residues> {
        self.start.iter().map(|&n| moduli.of(n)).collect()
    }
}

#[inline(always)]
fn apply_all(values: &mut [Residues], operations: &[[Slot; 3]], moduli: &Moduli) {
    for &operation in operations {
        apply(values, operation, moduli);
    }
}

#[inline(always)]
fn apply(values: &mut [Residues], [to, a, b]: [Slot; 3], moduli: &Moduli) {
    let at = |slot: Slot| &values[slot as usize];
    values[to as usize] = match b {
        INVERT => moduli.negative_inverse(at(a)),
        b => moduli.multiply_add(at(a), at(b), at(to)),
    };
}

/// A symmetric sparse matrix while it is eliminated.
struct Matrix<'a> {
    /// The slot of the entry for each other column of a row.
    rows: Vec<BTreeMap<u32, Slot>>,
    values: Vec<Residues>,
    moduli: &'a Moduli,
    program: Program,
}

impl<'a> Matrix<'a> {
    /// Returns the Laplacian of a graph without the row and the column of `root`, and the rows that
    /// it has: faces of the other colour have no edges.
    fn laplacian(
        faces: usize,
        edges: &[(usize, usize, i64)],
        root: usize,
        moduli: &'a Moduli,
    ) -> (Matrix<'a>, Vec<bool>) {
        let mut out = Matrix {
            rows: vec![BTreeMap::new(); faces],
            values: vec![[0; LANES]; faces + 1],
            moduli,
            program: Program::default(),
        };
        let mut used = vec![false; faces];
        let mut start = vec![0; faces];
        start.push(1);
        for &(a, b, weight) in edges {
            (used[a], used[b]) = (true, true);
            if a != b {
                start[a] += weight;
                start[b] += weight;
                if a != root && b != root {
                    let slot = out.slot(a as u32, b as u32) as usize;
                    start.resize(out.values.len(), 0);
                    start[slot] -= weight;
                }
            }
        }
        used[root] = false;
        out.program.start = start;
        out.program.product = faces as Slot;
        out.values = out.program.values(moduli);
        (out, used)
    }

    fn new_slot(&mut self) -> Slot {
        self.values.push([0; LANES]);
        self.values.len() as Slot - 1
    }

    /// Returns the slot of an entry.
    fn slot(&mut self, a: u32, b: u32) -> Slot {
        if a == b {
            return a;
        }
        if let Some(&slot) = self.rows[a as usize].get(&b) {
            return slot;
        }
        let slot = self.new_slot();
        self.rows[a as usize].insert(b, slot);
        self.rows[b as usize].insert(a, slot);
        slot
    }

    /// Returns the first other column in which a row is not 0.
    fn neighbour(&self, v: u32) -> Option<u32> {
        let mut row = self.rows[v as usize].iter();
        let found = row.find(|(_, slot)| self.values[**slot as usize][0] != 0);
        found.map(|(column, _)| *column)
    }

    /// Applies an operation, and adds it to the program.
    fn apply(&mut self, to: Slot, a: Slot, b: Slot) {
        apply(&mut self.values, [to, a, b], self.moduli);
        self.program.operations.push([to, a, b]);
    }

    /// Eliminates a row and its column. Returns their other columns.
    fn eliminate(&mut self, v: u32) -> Vec<(u32, Slot)> {
        let row = std::mem::take(&mut self.rows[v as usize]);
        let row: Vec<_> = row.into_iter().collect();
        let inverse = self.new_slot();
        self.apply(inverse, v, INVERT);
        for (k, &(a, entry)) in row.iter().enumerate() {
            self.rows[a as usize].remove(&v);
            let factor = self.new_slot();
            self.apply(factor, entry, inverse);
            for &(b, entry) in &row[k..] {
                let to = self.slot(a, b);
                self.apply(to, factor, entry);
            }
        }
        row
    }

    /// Adds a row and its column to another one, which keeps the determinant. Returns the columns.
    fn add(&mut self, from: u32, to: u32) -> Vec<(u32, Slot)> {
        let row: Vec<_> = self.rows[from as usize].clone().into_iter().collect();
        let one = self.rows.len() as Slot;
        let both = self.slot(from, to);
        for (to, a) in [(to, both), (both, from), (to, both)] {
            self.apply(to, a, one);
        }
        for &(column, entry) in row.iter().filter(|(column, _)| *column != to) {
            let to = self.slot(to, column);
            self.apply(to, entry, one);
        }
        row
    }
}

/// Returns the determinant of the Laplacian without the row and the column of `root` modulo each
/// prime, as [`Program::run`] does, and the program. No pivot is 0 modulo the first prime.
///
/// The next pivot is in the row with the fewest entries, among the rows that are not 0.
fn minor(
    faces: usize,
    edges: &[(usize, usize, i64)],
    root: usize,
    moduli: &Moduli,
) -> ([Option<u32>; LANES], Program) {
    let (mut matrix, mut left) = Matrix::laplacian(faces, edges, root, moduli);
    let degree = |matrix: &Matrix, v: u32| Reverse((matrix.rows[v as usize].len(), v));
    let rows = (0..faces as u32).filter(|&v| left[v as usize]);
    let mut queue: BinaryHeap<_> = rows.map(|v| degree(&matrix, v)).collect();
    loop {
        let changed = if let Some(Reverse((length, v))) = queue.pop() {
            let at = v as usize;
            // A row is in the queue again after each change.
            if !left[at] || length != matrix.rows[at].len() || matrix.values[at][0] == 0 {
                continue;
            }
            left[at] = false;
            let changed = matrix.eliminate(v);
            let product = matrix.new_slot();
            matrix.apply(product, matrix.program.product, v);
            matrix.program.product = product;
            changed
        } else {
            // All pivots are 0.
            let rows = (0..faces as u32).filter(|&v| left[v as usize]);
            let with_entries = rows.filter_map(|v| Some((v, matrix.neighbour(v)?)));
            let fewest = with_entries.min_by_key(|(v, _)| matrix.rows[*v as usize].len());
            let Some((to, from)) = fewest else { break };
            queue.push(degree(&matrix, to));
            let mut changed = matrix.add(from, to);
            changed.push((to, to));
            changed
        };
        queue.extend(changed.iter().map(|&(v, _)| degree(&matrix, v)));
    }
    for v in (0..faces as u32).filter(|&v| left[v as usize]) {
        let row = matrix.rows[v as usize].values();
        matrix.program.rest.extend(row.copied().chain([v]));
    }
    matrix.program.slots = matrix.values.len();
    let found = matrix.program.determinant(&matrix.values, moduli);
    (found, matrix.program)
}

/// Returns true if an odd number above 7 is prime (Miller-Rabin, with bases that suffice for 32
/// bits: Pomerance, Selfridge & Wagstaff 1980, *The pseudoprimes to 25e9*, Math. Comp. 35).
fn is_prime(n: u32) -> bool {
    let n = u64::from(n);
    let twos = (n - 1).trailing_zeros();
    [2, 3, 5, 7].iter().all(|&base| {
        let bits = (twos..32).rev().map(|bit| (n - 1) >> bit & 1);
        let power = bits.fold(1, |x, bit| x * x % n * [1, base][bit as usize] % n);
        let mut powers = iter::successors(Some(power), |x| Some(x * x % n));
        power == 1 || powers.by_ref().take(twos as usize).any(|x| x == n - 1)
    })
}

/// Returns the absolute value of the integer with these residues modulo primes that is smallest in
/// size (Chinese remainder theorem).
fn combine(residues: Vec<(u32, u32)>) -> BigUint {
    let (mut value, mut modulus) = (BigUint::ZERO, BigUint::from(1_u32));
    for (p, residue) in residues {
        let missing = (residue + p) - u32::try_from(&value % p).expect("less than the prime");
        let inverse = modulus.modinv(&p.into()).expect("the primes differ");
        value += &modulus * (inverse * missing % p);
        modulus *= p;
    }
    let negative = modulus - &value;
    value.min(negative)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use num_bigint::BigInt;

    /// Returns the absolute value of the determinant of a dense matrix (Bareiss 1968).
    fn dense(mut rows: Vec<Vec<BigInt>>) -> BigUint {
        let n = rows.len();
        let mut last = BigInt::from(1);
        for k in 0..n {
            let Some(pivot) = (k..n).find(|&i| rows[i][k] != BigInt::ZERO) else {
                return BigUint::ZERO;
            };
            rows.swap(k, pivot);
            for i in k + 1..n {
                for j in k + 1..n {
                    rows[i][j] = (&rows[i][j] * &rows[k][k] - &rows[i][k] * &rows[k][j]) / &last;
                }
            }
            last = rows[k][k].clone();
        }
        last.magnitude().clone()
    }

    #[test]
    fn sparse_elimination_equals_a_dense_one() {
        let mut random = Random::new(44);
        let mut zero = 0;
        for round in 0..3000 {
            let faces = 2 + round % 11;
            let count = faces - 1 + random.below(2 * faces);
            let mut edge = || {
                let weight = 1 - 2 * random.below(2) as i64;
                (random.below(faces), random.below(faces), weight)
            };
            let edges: Vec<_> = (0..count).map(|_| edge()).collect();
            let mut used = vec![false; faces];
            let mut laplacian = vec![vec![BigInt::ZERO; faces]; faces];
            for &(a, b, weight) in &edges {
                (used[a], used[b]) = (true, true);
                if a != b {
                    for (a, b) in [(a, b), (b, a)] {
                        laplacian[a][a] += weight;
                        laplacian[a][b] -= weight;
                    }
                }
            }
            let with_edges: Vec<usize> = (0..faces).filter(|&f| used[f]).collect();
            let row = |&a: &usize| {
                let columns = with_edges[1..].iter();
                columns.map(|&b| laplacian[a][b].clone()).collect()
            };
            let expected = dense(with_edges[1..].iter().map(row).collect());
            assert_eq!(determinant(faces, &edges), expected, "{faces} {edges:?}");
            zero += usize::from(expected == BigUint::ZERO);
        }
        assert!((300..2700).contains(&zero), "{zero} of 3000 are singular");
    }

    #[test]
    fn residues_determine_positive_and_negative_integers() {
        let primes: Vec<u32> = (0..)
            .map(|k| (1_u32 << 31) - 1 - 2 * k)
            .filter(|&n| is_prime(n))
            .take(4)
            .collect();
        assert_eq!(primes[1], 2_147_483_629);
        for n in [0_i128, 1, -1, 1 << 100, -(1 << 100) + 5] {
            let residues = primes.iter().map(|&p| (p, n.rem_euclid(p.into()) as u32));
            assert_eq!(combine(residues.collect()), BigUint::from(n.unsigned_abs()));
        }
    }

    #[test]
    fn primes_are_those_of_trial_division() {
        let by_division = |n: u32| {
            (3..)
                .step_by(2)
                .take_while(|d| d * d <= n)
                .all(|d| !n.is_multiple_of(d))
        };
        let last = (1_u32 << 31) - 1;
        for n in (9..20_000).chain(last - 500..=last).filter(|n| n % 2 == 1) {
            assert_eq!(is_prime(n), by_division(n), "{n}");
        }
    }
}
