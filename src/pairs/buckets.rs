//! Sorting by buckets, for items that are spread evenly.

use rayon::prelude::*;

/// A sort by buckets. Its buffer is reused from frame to frame.
///
/// Cost: linear if every bucket has few items. If all items are in one bucket, that of an ordinary
/// sort.
#[derive(Debug, Default)]
pub(super) struct BucketSort {
    /// End of each bucket in the sorted items.
    ends: Vec<usize>,
}

impl BucketSort {
    /// Sorts `items` into `sorted`. `bucket` returns a number below `buckets` that increases with
    /// the items.
    pub fn sort<T: Copy + Default + Ord + Send>(
        &mut self,
        items: impl Iterator<Item = T> + Clone,
        buckets: usize,
        bucket: impl Fn(&T) -> usize,
        sorted: &mut Vec<T>,
    ) {
        let items = items.map(|item| (bucket(&item), item));
        distribute(items, buckets, &mut self.ends, sorted);
        let mut start = 0;
        for &end in &self.ends {
            if end - start > 1 {
                sorted[start..end].par_sort_unstable();
            }
            start = end;
        }
    }
}

/// Sorts items into `sorted` by their buckets, which are numbers below `buckets`. The items of a
/// bucket stay in their order. Writes the end of each bucket to `ends`.
pub(super) fn distribute<T: Copy + Default>(
    items: impl Iterator<Item = (usize, T)> + Clone,
    buckets: usize,
    ends: &mut Vec<usize>,
    sorted: &mut Vec<T>,
) {
    ends.clear();
    ends.resize(buckets, 0);
    for (bucket, _) in items.clone() {
        ends[bucket] += 1;
    }
    // The starts of the buckets, which become their ends as items are added.
    let mut start = 0;
    for end in ends.iter_mut() {
        start += std::mem::replace(end, start);
    }
    sorted.clear();
    sorted.resize(start, T::default());
    for (bucket, item) in items {
        let end = &mut ends[bucket];
        sorted[*end] = item;
        *end += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn equals_an_ordinary_sort(
            items in prop::collection::vec((0u32..50, 0u32..1000), 0..300),
            width in 1usize..60,
        ) {
            let mut sort = BucketSort { ends: vec![7; 9] };
            let mut sorted = vec![(1, 1); 3];
            let bucket = |&(i, _): &(u32, u32)| i as usize / width;
            sort.sort(items.iter().copied(), 50, bucket, &mut sorted);
            let mut want = items;
            want.sort_unstable();
            prop_assert_eq!(sorted, want);
        }
    }
}
