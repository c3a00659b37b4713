//! Segment pairs of two curves whose boxes overlap in space.

use super::descent::{Visitor, descend};
use super::trees::{Node, Trees};
#[cfg(target_arch = "x86_64")]
use crate::curve::Avx2;
use crate::curve::{BoxGroup, CurveSet, Lanes, Portable};

/// All segment pairs of curves `i` and `j` with overlapping boxes, sorted.
pub(crate) fn overlapping_segments(
    set: &CurveSet,
    trees: &Trees,
    i: usize,
    j: usize,
) -> Vec<(u32, u32)> {
    let mut found = {
        #[cfg(target_arch = "x86_64")]
        match Avx2::detect() {
            #[expect(unsafe_code, reason = "vector instructions")]
            // SAFETY: the token says that the processor has them.
            Some(avx2) => unsafe { find_avx2(avx2, set, trees, i, j) },
            None => find(Portable, set, trees, i, j),
        }
        #[cfg(not(target_arch = "x86_64"))]
        find(Portable, set, trees, i, j)
    };
    found.sort_unstable();
    found
}

/// [`find`], compiled with AVX2.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn find_avx2(avx2: Avx2, set: &CurveSet, trees: &Trees, i: usize, j: usize) -> Vec<(u32, u32)> {
    find(avx2, set, trees, i, j)
}

#[inline(always)]
fn find<L: Lanes>(simd: L, set: &CurveSet, trees: &Trees, i: usize, j: usize) -> Vec<(u32, u32)> {
    let both = [trees.of(set, i), trees.of(set, j)];
    let mut stack = vec![(both[0].root(), both[1].root())];
    let mut found = Found(Vec::new());
    while !stack.is_empty() {
        descend(simd, both, 2, &mut stack, &mut found, u32::MAX);
    }
    found.0
}

struct Found(Vec<(u32, u32)>);

impl Visitor for Found {
    const IN_SPACE: bool = true;

    #[inline(always)]
    fn full(&self) -> bool {
        false
    }

    #[inline(always)]
    fn visit<L: Lanes>(
        &mut self,
        _: L,
        [t, u]: [Node; 2],
        _: [&BoxGroup; 2],
        _: usize,
        mut pairs: u64,
    ) {
        while pairs != 0 {
            let bit = pairs.trailing_zeros();
            pairs &= pairs - 1;
            self.0.push((t.lane(bit / 8), u.lane(bit % 8)));
        }
    }
}
