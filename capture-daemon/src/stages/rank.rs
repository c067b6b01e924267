//! Order statistics of a few numbers.

/// As many numbers as [`Few`] holds.
pub(super) const MOST: usize = 32;
/// As many as are compared at a time.
const LANES: usize = 8;

/// Up to [`MOST`] numbers, of which some are asked for by their rank.
///
/// To count for each of them how many are smaller takes more comparisons than to sort them, but none that the
/// processor would have to guess the outcome of.
pub(super) struct Few {
    /// Integers in the order of the numbers.
    keys: [i32; MOST],
    count: usize,
}

impl Default for Few {
    fn default() -> Self {
        Self { keys: [i32::MAX; MOST], count: 0 }
    }
}

impl Few {
    /// Takes a number up, as far as there is room.
    pub(super) fn push(&mut self, value: f32) {
        if let Some(key) = self.keys.get_mut(self.count) {
            *key = ordered(value.to_bits() as i32);
            self.count += 1;
        }
    }

    /// How many there are.
    pub(super) fn len(&self) -> usize {
        self.count
    }

    /// The numbers that have these ranks by [`f32::total_cmp`], from 0; each less than [`Self::len`].
    pub(super) fn ranked<const N: usize>(&self, ranks: [usize; N]) -> [f32; N] {
        let (blocks, _) = self.keys.as_chunks::<LANES>();
        // The largest of all that no more than so many are smaller than.
        let mut found = [[i32::MIN; LANES]; N];
        for block in &blocks[..self.count.div_ceil(LANES)] {
            let mut smaller = [0; LANES];
            for key in &self.keys[..self.count] {
                for (smaller, own) in smaller.iter_mut().zip(block) {
                    *smaller += i32::from(key < own);
                }
            }
            for (found, rank) in found.iter_mut().zip(ranks) {
                for ((found, own), smaller) in found.iter_mut().zip(block).zip(smaller) {
                    // What fills up the last block has all the others before it.
                    let within = if smaller <= rank as i32 { *own } else { i32::MIN };
                    *found = (*found).max(within);
                }
            }
        }
        found.map(|lanes| {
            let key = lanes.into_iter().fold(i32::MIN, i32::max);
            f32::from_bits(ordered(key) as u32)
        })
    }
}

/// From the bits of a number to an integer in the order of [`f32::total_cmp`], and back.
fn ordered(bits: i32) -> i32 {
    bits ^ (((bits >> 31) as u32) >> 1) as i32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranks_are_those_of_sorting() {
        let mut state = 1_u32;
        for count in 1..=MOST {
            for spread in [3, 40, 1 << 20] {
                let mut few = Few::default();
                let mut sorted: Vec<f32> = (0..count)
                    .map(|_| {
                        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                        let value = ((state >> 8) % spread) as f32 - (spread / 2) as f32;
                        value * if state & 128 == 0 { 1e-3 } else { -1e-3 }
                    })
                    .collect();
                sorted.iter().for_each(|value| few.push(*value));
                sorted.sort_by(f32::total_cmp);
                assert_eq!(few.len(), count);
                for (rank, expected) in sorted.iter().enumerate() {
                    let [own, first] = few.ranked([rank, 0]);
                    assert_eq!(own.to_bits(), expected.to_bits(), "{rank} of {sorted:?}");
                    assert_eq!(first.to_bits(), sorted[0].to_bits());
                }
            }
        }
    }
}
