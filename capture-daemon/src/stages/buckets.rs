//! A queue in the order of distances that are never far apart.

/// Places by their distance: those next in turn are within `N − 1` of the nearest.
///
/// # Source
/// Dial 1969. Distances that are no integers are as good, as long as no step is shorter than 1: then none
/// of a bucket can be reached by a shorter way through another one of it.
pub(super) struct Buckets<const N: usize> {
    buckets: [Vec<u32>; N],
    nearest: usize,
    waiting: usize,
}

impl<const N: usize> Default for Buckets<N> {
    fn default() -> Self {
        Self { buckets: std::array::from_fn(|_| Vec::new()), nearest: 0, waiting: 0 }
    }
}

impl<const N: usize> Buckets<N> {
    /// `distance`: at least that of the last bucket taken and less than `N` more.
    pub(super) fn push(&mut self, distance: usize, place: usize) {
        self.buckets[distance % N].push(place as u32);
        self.waiting += 1;
    }

    /// No place that waits is nearer than this.
    pub(super) fn nearest(&self) -> usize {
        self.nearest
    }

    /// The places of the next bucket and their distance, rounded down; `None` when there are no more. What was
    /// reached by a shorter way since is among them too.
    pub(super) fn next(&mut self) -> Option<(usize, Vec<u32>)> {
        while self.waiting > 0 {
            let at = self.nearest;
            self.nearest += 1;
            if !self.buckets[at % N].is_empty() {
                let places = std::mem::take(&mut self.buckets[at % N]);
                self.waiting -= places.len();
                return Some((at, places));
            }
        }
        None
    }

    /// Keeps the memory of a bucket that was taken.
    pub(super) fn give_back(&mut self, distance: usize, mut places: Vec<u32>) {
        places.clear();
        self.buckets[distance % N] = places;
    }
}
