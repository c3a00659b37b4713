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
use num_bigint::BigUint;
use rayon::prelude::*;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

impl Diagram {
    /// Returns the determinant.
    pub(super) fn determinant(&self) -> BigUint {
        let split = self.components.len() > 1 && self.components.iter().any(Vec::is_empty);
        if split || !self.is_connected() {
            return BigUint::ZERO;
        }
        if self.signs.is_empty() {
            return BigUint::from(1_u32);
        }
        let (faces, edges) = self.goeritz_graph();
        let mut degrees = vec![0_u64; faces];
        for &(a, b, _) in &edges {
            degrees[a] += 1;
            degrees[b] += 1;
        }
        // The vertex that is left out is that with the largest degree: the bound is smallest.
        let root = (0..faces).max_by_key(|&f| degrees[f]).unwrap_or(0);
        let others = (0..faces).filter(|&f| f != root);
        let bound: BigUint = others.map(|f| BigUint::from(degrees[f].max(1))).product();
        let mut product = BigUint::from(1_u32);
        let primes = (0..1 << 30)
            .map(|k| (1 << 31) - 1 - 2 * k)
            .filter(|&n| is_prime(n));
        let primes = primes.take_while(|&prime| {
            let enough = product > &bound * 2_u32;
            product *= prime;
            !enough
        });
        let primes: Vec<u64> = primes.collect();
        let residues = primes
            .par_iter()
            .map(|&p| (p, minor(faces, &edges, root, p)));
        combine(residues.collect())
    }

    /// Returns the number of faces, and the edges of the graph of those of one colour: two faces
    /// and a weight for each crossing.
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
            (
                faces[corner],
                faces[corner + 2],
                if place == 1 { 1 } else { -1 },
            )
        });
        (count, edges.collect())
    }
}

/// Columns and values of a row of a sparse matrix, sorted.
type Row = Vec<(u32, u64)>;

/// Returns the determinant of the Laplacian without the row and the column of `root`, modulo a
/// prime
/// `p` below `2^31`, by elimination of the vertex with the fewest neighbours.
fn minor(vertices: usize, edges: &[(usize, usize, i64)], root: usize, p: u64) -> u64 {
    let mut diagonal = vec![0; vertices];
    let mut rows = vec![Row::new(); vertices];
    // Faces of the other colour have no edges.
    let mut done = vec![true; vertices];
    for &(a, b, weight) in edges {
        (done[a], done[b]) = (false, false);
        for (a, b) in [(a, b), (b, a)].into_iter().filter(|(a, b)| a != b) {
            diagonal[a] = (diagonal[a] + weight.rem_euclid(p as i64) as u64) % p;
            if a != root && b != root {
                add(
                    &mut rows[a],
                    b as u32,
                    (-weight).rem_euclid(p as i64) as u64,
                    p,
                );
            }
        }
    }
    done[root] = true;
    let used = (0..vertices).filter(|&v| !done[v]);
    let queue = used.map(|v| Reverse((rows[v].len(), v as u32)));
    let mut queue: BinaryHeap<Reverse<(usize, u32)>> = queue.collect();
    let mut determinant = 1;
    while let Some(Reverse((degree, v))) = queue.pop() {
        let at = v as usize;
        // Each change of a row adds an entry with its new length.
        if done[at] || degree != rows[at].len() {
            continue;
        }
        if diagonal[at] == 0 {
            // The row and the column of a neighbour are added, which keeps the determinant.
            let Some(&(u, with)) = rows[at].first() else {
                return 0;
            };
            let (of_u, own) = (rows[u as usize].clone(), diagonal[u as usize]);
            diagonal[at] = (own + 2 * with) % p;
            for (w, value) in of_u.into_iter().filter(|(w, _)| *w != v).chain([(u, own)]) {
                add(&mut rows[at], w, value, p);
                add(&mut rows[w as usize], v, value, p);
                queue.push(Reverse((rows[w as usize].len(), w)));
            }
            queue.push(Reverse((rows[at].len(), v)));
            continue;
        }
        done[at] = true;
        determinant = determinant * diagonal[at] % p;
        let inverse = inverse(diagonal[at], p);
        let neighbours = std::mem::take(&mut rows[at]);
        for &(a, x) in &neighbours {
            let factor = (p - x * inverse % p) % p;
            diagonal[a as usize] = (diagonal[a as usize] + factor * x) % p;
            rows[a as usize] = sum(&rows[a as usize], &neighbours, factor, p, [v, a]);
        }
        let changed = neighbours.iter().map(|&(a, _)| a);
        queue.extend(changed.map(|a| Reverse((rows[a as usize].len(), a))));
    }
    determinant
}

/// Returns a sparse row plus a multiple of another one, both sorted, without two columns and
/// without zeros.
fn sum(row: &[(u32, u64)], other: &[(u32, u64)], by: u64, p: u64, skip: [u32; 2]) -> Row {
    let mut out = Row::with_capacity(row.len() + other.len());
    let (mut row, mut other) = (row.iter().peekable(), other.iter().peekable());
    while let Some(column) = row
        .peek()
        .into_iter()
        .chain(other.peek())
        .map(|e| e.0)
        .min()
    {
        let own = row.next_if(|e| e.0 == column).map_or(0, |e| e.1);
        let added = other.next_if(|e| e.0 == column).map_or(0, |e| e.1);
        let value = (own + by * added) % p;
        if value != 0 && !skip.contains(&column) {
            out.push((column, value));
        }
    }
    out
}

/// Adds to an entry of a sparse row. Entries that become 0 are removed.
fn add(row: &mut Row, column: u32, value: u64, p: u64) {
    match row.binary_search_by_key(&column, |e| e.0) {
        Ok(at) if row[at].1 + value == p => drop(row.remove(at)),
        Ok(at) => row[at].1 = (row[at].1 + value) % p,
        Err(at) if value != 0 => row.insert(at, (column, value)),
        Err(_) => {}
    }
}

/// Returns the inverse modulo a prime below `2^31`, by Fermat's theorem.
fn inverse(a: u64, p: u64) -> u64 {
    let (mut base, mut exponent, mut out) = (a, p - 2, 1);
    while exponent > 0 {
        if exponent % 2 == 1 {
            out = out * base % p;
        }
        base = base * base % p;
        exponent /= 2;
    }
    out
}

/// Returns true if an odd number is prime.
fn is_prime(n: u64) -> bool {
    let mut factors = (3..).step_by(2).take_while(|factor| factor * factor <= n);
    factors.all(|factor| !n.is_multiple_of(factor))
}

/// Returns the absolute value of the integer with these residues modulo primes that is smallest in
/// size (Chinese remainder theorem).
fn combine(residues: Vec<(u64, u64)>) -> BigUint {
    let (mut value, mut modulus) = (BigUint::ZERO, BigUint::from(1_u32));
    for (p, residue) in residues {
        let low = |n: &BigUint| u64::try_from(n % p).expect("less than the prime");
        let missing = (residue + p - low(&value)) % p;
        value += &modulus * (missing * inverse(low(&modulus), p) % p);
        modulus *= p;
    }
    let negative = modulus - &value;
    value.min(negative)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn residues_determine_positive_and_negative_integers() {
        let primes: Vec<u64> = (0..)
            .map(|k| (1 << 31) - 1 - 2 * k)
            .filter(|&n| is_prime(n))
            .take(4)
            .collect();
        assert_eq!(primes[1], 2_147_483_629);
        for n in [0_i128, 1, -1, 1 << 100, -(1 << 100) + 5] {
            let residues = primes.iter().map(|&p| (p, n.rem_euclid(p.into()) as u64));
            assert_eq!(combine(residues.collect()), BigUint::from(n.unsigned_abs()));
        }
    }
}
