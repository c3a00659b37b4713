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
        let ends = &mut self.ends;
        ends.clear();
        ends.resize(buckets, 0);
        let mut count = 0;
        for item in items.clone() {
            ends[bucket(&item)] += 1;
            count += 1;
        }
        // The starts of the buckets, which become their ends as items are added.
        let mut start = 0;
        for end in ends.iter_mut() {
            start += std::mem::replace(end, start);
        }
        sorted.clear();
        sorted.resize(count, T::default());
        for item in items {
            let end = &mut ends[bucket(&item)];
            sorted[*end] = item;
            *end += 1;
        }
        let mut start = 0;
        for &end in ends.iter() {
            if end - start > 1 {
                sorted[start..end].par_sort_unstable();
            }
            start = end;
        }
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
