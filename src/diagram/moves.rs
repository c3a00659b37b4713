//! Reduction by Reidemeister I and II moves, on the Gauss code.
//!
//! # Proof: the conditions on the code suffice
//!
//! I. If both passages of a crossing follow one another, the arc between them is a closed curve
//! that nothing crosses. Parts of the link inside of it have no crossing with the rest, so that
//! they can be moved away, and the loop is untwisted.
//!
//! II. Let crossings `a` and `b` follow one another on two strands, on one of them above, on the
//! other one below. The two arcs between them form a closed curve, which nothing crosses. At `a`,
//! the continuations of both strands leave to the same side of it, and likewise at `b`. If the
//! sides are the same, the other side is an empty bigon, and the strands can be pulled apart. The
//! signs of `a` and `b` are then opposite: both strands pass from one side of the other strand to
//! the other side and back. A reflection of the neighbourhood of `b` changes both its sign and its
//! side. So opposite signs prove a bigon.

/// Passages of the components as cyclic lists.
struct Lists {
    next: Vec<u32>,
    previous: Vec<u32>,
    removed: Vec<bool>,
}

impl Lists {
    fn remove(&mut self, passage: u32) {
        let (before, after) = (self.previous[passage as usize], self.next[passage as usize]);
        self.next[before as usize] = after;
        self.previous[after as usize] = before;
        self.removed[passage as usize] = true;
    }

    /// Returns the other crossing of a bigon that begins with this passage.
    fn bigon(&self, passage: u32, signs: &[i8]) -> Option<u32> {
        let next = self.next[passage as usize];
        let (a, b) = (passage / 2, next / 2);
        let same_level = passage % 2 == next % 2 && a != b;
        let (other, other_next) = (passage ^ 1, next ^ 1);
        let adjacent =
            self.next[other as usize] == other_next || self.next[other_next as usize] == other;
        let opposite = signs[a as usize] != signs[b as usize];
        (same_level && adjacent && opposite).then_some(b)
    }
}

/// Makes Reidemeister moves I and II until none is possible. Removes the passages of the removed
/// crossings. Returns the numbers of moves I and II.
pub(super) fn reduce(components: &mut [Vec<u32>], signs: &[i8]) -> [u64; 2] {
    let total = 2 * signs.len();
    let mut lists = Lists {
        next: vec![0; total],
        previous: vec![0; total],
        // Passages of other curves are not there.
        removed: vec![true; total],
    };
    let mut work = Vec::with_capacity(total);
    for passages in components.iter() {
        for (k, &passage) in passages.iter().enumerate() {
            let next = passages[(k + 1) % passages.len()];
            lists.next[passage as usize] = next;
            lists.previous[next as usize] = passage;
            lists.removed[passage as usize] = false;
        }
        work.extend(passages);
    }
    let mut moves = [0, 0];
    while let Some(passage) = work.pop() {
        if lists.removed[passage as usize] {
            continue;
        }
        let other = if lists.next[passage as usize] == passage ^ 1 {
            moves[0] += 1;
            None
        } else if let Some(other) = lists.bigon(passage, signs) {
            moves[1] += 1;
            Some(other)
        } else {
            continue;
        };
        let crossings = [passage / 2].into_iter().chain(other);
        for passage in crossings.flat_map(|c| [2 * c, 2 * c + 1]) {
            work.push(lists.previous[passage as usize]);
            lists.remove(passage);
        }
    }
    for passages in components {
        passages.retain(|&passage| !lists.removed[passage as usize]);
    }
    moves
}
