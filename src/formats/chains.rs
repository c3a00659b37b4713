//! Joins edges that share a vertex to curves, in any order and direction.
//!
//! Cost: linear in edges and vertices.

/// Two vertices, and the line of the file that joins them.
#[derive(Clone, Copy, Debug)]
pub(super) struct Edge {
    pub(super) ends: [u32; 2],
    pub(super) line: u64,
}

/// Error: more than two edges meet at a vertex, so they do not determine a curve.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct ThirdEdge {
    pub(super) vertex: u32,
    /// Lines of the first two edges, and of the third one.
    pub(super) lines: [u64; 3],
}

/// Edges that meet at each vertex.
pub(super) struct Chains<'a> {
    edges: &'a [Edge],
    at_vertex: Vec<[usize; 2]>,
}

/// Marks a missing second edge.
const NONE: usize = usize::MAX;

impl<'a> Chains<'a> {
    /// Creates the table. Vertices must be below `vertices`, and no edge may join a vertex with
    /// itself.
    pub(super) fn new(edges: &'a [Edge], vertices: usize) -> Result<Self, ThirdEdge> {
        // Without edges no table is needed.
        let vertices = if edges.is_empty() { 0 } else { vertices };
        let mut at_vertex = vec![[NONE; 2]; vertices];
        for (e, edge) in edges.iter().enumerate() {
            for v in edge.ends {
                let slots = &mut at_vertex[v as usize];
                let Some(slot) = slots.iter_mut().find(|s| **s == NONE) else {
                    let [p, q] = slots.map(|e| edges[e].line);
                    return Err(ThirdEdge {
                        vertex: v,
                        lines: [p, q, edge.line],
                    });
                };
                *slot = e;
            }
        }
        Ok(Self { edges, at_vertex })
    }

    /// Returns the edge other than `e` at vertex `v`.
    fn other(&self, v: u32, e: usize) -> Option<usize> {
        let [p, q] = self.at_vertex[v as usize];
        let other = if p == e { q } else { p };
        (other != NONE).then_some(other)
    }

    /// Returns the end of edge `e` other than `v`.
    fn other_end(&self, v: u32, e: usize) -> u32 {
        let [a, b] = self.edges[e].ends;
        if a == v { b } else { a }
    }

    /// Writes the vertices of the curve through edge `first`, in its direction, and marks its
    /// edges. Returns true if the curve is closed.
    pub(super) fn follow(&self, first: usize, chain: &mut Vec<u32>, used: &mut [bool]) -> bool {
        // Goes back to the start of the curve: its open end, or `first` again.
        let (mut v, mut e) = (self.edges[first].ends[0], first);
        let closed = loop {
            match self.other(v, e) {
                None => break false,
                Some(before) if before == first => break true,
                Some(before) => (v, e) = (self.other_end(v, before), before),
            }
        };
        if closed {
            (v, e) = (self.edges[first].ends[0], first);
        }
        let start = v;
        chain.clear();
        loop {
            chain.push(v);
            used[e] = true;
            v = self.other_end(v, e);
            if closed && v == start {
                return true;
            }
            match self.other(v, e) {
                Some(next) => e = next,
                None => {
                    chain.push(v);
                    return false;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Returns the curves of `edges`, whose vertices are below `vertices`: true if closed, and the
    /// vertices.
    fn join(edges: &[[u32; 2]], vertices: usize) -> Result<Vec<(bool, Vec<u32>)>, ThirdEdge> {
        let edges: Vec<Edge> = (1..)
            .zip(edges)
            .map(|(line, &ends)| Edge { ends, line })
            .collect();
        let chains = Chains::new(&edges, vertices)?;
        let mut used = vec![false; edges.len()];
        let mut curves = Vec::new();
        for first in 0..edges.len() {
            if !used[first] {
                let mut chain = Vec::new();
                let closed = chains.follow(first, &mut chain, &mut used);
                curves.push((closed, chain));
            }
        }
        Ok(curves)
    }

    #[test]
    fn the_first_edge_gives_start_and_direction() {
        let joined = join(&[[3, 2], [0, 1], [1, 2], [3, 0]], 4).unwrap();
        assert_eq!(joined, [(true, vec![3, 2, 1, 0])]);
        let joined = join(&[[3, 2], [0, 1], [1, 2]], 4).unwrap();
        assert_eq!(joined, [(false, vec![3, 2, 1, 0])]);
        let joined = join(&[[1, 2], [0, 1], [3, 2]], 4).unwrap();
        assert_eq!(joined, [(false, vec![0, 1, 2, 3])]);
    }

    #[test]
    fn two_vertices_joined_twice_are_a_closed_curve() {
        assert_eq!(join(&[[0, 1], [1, 0]], 2), Ok(vec![(true, vec![0, 1])]));
        assert_eq!(join(&[[0, 1], [0, 1]], 2), Ok(vec![(true, vec![0, 1])]));
    }

    #[test]
    fn rejects_a_third_edge_with_all_three_lines() {
        let third = join(&[[0, 1], [5, 4], [2, 1], [1, 3]], 6).unwrap_err();
        assert_eq!((third.vertex, third.lines), (1, [1, 3, 4]));
        // A third copy of an edge.
        assert!(join(&[[0, 1], [1, 0], [0, 1]], 2).is_err());
    }

    proptest! {
        #[test]
        fn shuffled_and_turned_edges_give_the_same_curves(
            sizes in prop::collection::vec((3..12u32, any::<bool>()), 1..6),
            keys in prop::collection::vec(any::<u32>(), 72),
            turned in prop::collection::vec(any::<bool>(), 72),
        ) {
            let mut edges = Vec::new();
            let mut base = 0;
            for &(n, closed) in &sizes {
                edges.extend((1..n).map(|k| [base + k - 1, base + k]));
                edges.extend(closed.then_some([base + n - 1, base]));
                base += n;
            }
            let mut order: Vec<usize> = (0..edges.len()).collect();
            order.sort_by_key(|&k| keys[k]);
            let shuffled: Vec<[u32; 2]> = order
                .iter()
                .map(|&k| if turned[k] { [edges[k][1], edges[k][0]] } else { edges[k] })
                .collect();
            let curves = join(&shuffled, base as usize).unwrap();
            prop_assert_eq!(curves.len(), sizes.len());
            let mut found = Vec::new();
            for (closed, chain) in &curves {
                found.extend(chain.windows(2).map(|w| [w[0], w[1]]));
                if *closed {
                    found.push([*chain.last().unwrap(), chain[0]]);
                }
            }
            // The first edge of each curve in the file keeps its direction.
            prop_assert!(found.contains(&shuffled[0]));
            let sorted = |mut edges: Vec<[u32; 2]>| {
                edges.iter_mut().for_each(|e| e.sort_unstable());
                edges.sort_unstable();
                edges
            };
            prop_assert_eq!(sorted(found), sorted(edges));
        }

        #[test]
        fn any_edges_give_every_edge_once_or_an_error(
            pairs in prop::collection::vec((0..12u32, 0..12u32), 0..12),
        ) {
            let edges: Vec<[u32; 2]> = pairs
                .into_iter()
                .filter(|(a, b)| a != b)
                .map(|(a, b)| [a, b])
                .collect();
            if let Ok(curves) = join(&edges, 12) {
                let count = |(closed, c): &(bool, Vec<u32>)| c.len() - usize::from(!closed);
                prop_assert_eq!(curves.iter().map(count).sum::<usize>(), edges.len());
            }
        }
    }
}
