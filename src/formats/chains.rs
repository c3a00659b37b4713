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

/// A curve: its first edge, and its vertices in order.
pub(super) struct Chain {
    pub(super) first: usize,
    pub(super) vertices: Vec<u32>,
    pub(super) closed: bool,
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
                    let (vertex, lines) = (v, [p, q, edge.line]);
                    return Err(ThirdEdge { vertex, lines });
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

    /// Returns the curves, in the order of their first edges.
    pub(super) fn curves(&self) -> impl Iterator<Item = Chain> {
        let mut used = vec![false; self.edges.len()];
        (0..self.edges.len()).filter_map(move |first| match used[first] {
            true => None,
            false => Some(self.follow(first, &mut used)),
        })
    }

    /// Returns the curve through edge `first`, in its direction, and marks its edges.
    fn follow(&self, first: usize, used: &mut [bool]) -> Chain {
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
        let mut vertices = vec![v];
        loop {
            used[e] = true;
            v = self.other_end(v, e);
            if !closed || v != vertices[0] {
                vertices.push(v);
            }
            match self.other(v, e) {
                Some(next) if !used[next] => e = next,
                _ => break,
            }
        }
        Chain {
            first,
            vertices,
            closed,
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
        Ok(chains.curves().map(|c| (c.closed, c.vertices)).collect())
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
