//! Random numbers that are the same bits on every machine: integer arithmetic, division and
//! multiplication only, never the platform's `sin`, `ln` or `exp`.

use rand_pcg::Pcg32;
use rand_pcg::rand_core::RngCore;

/// A seeded stream of random numbers.
pub(super) struct Random(Pcg32);

impl Random {
    /// The stream `stream` of `seed`; two streams of one seed do not repeat each other.
    pub(super) fn new(seed: u64, stream: u64) -> Self {
        Self(Pcg32::new(seed, stream))
    }

    /// Uniform in `[0, 1)`, 24 bits.
    pub(super) fn unit(&mut self) -> f64 {
        f64::from(self.0.next_u32() >> 8) / f64::from(1_u32 << 24)
    }

    /// Uniform in `[low, high)`.
    pub(super) fn range(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Uniform in `low..=high`.
    pub(super) fn integer(&mut self, low: usize, high: usize) -> usize {
        let count = (high - low + 1) as f64;
        low + ((self.unit() * count) as usize).min(high - low)
    }

    /// Standard normal, to a good approximation: the number of ones among 64 random bits (mean 32,
    /// σ 4; excess kurtosis −0.03), its steps of ¼σ filled by a uniform number of the same width.
    pub(super) fn normal(&mut self) -> f64 {
        let ones = f64::from(self.0.next_u64().count_ones());
        // The variances add up: 64/4 of the bits, 1/12 of the filling.
        const SIGMA: f64 = 4.010_403_1;
        (ones - 32.0 + self.unit() - 0.5) / SIGMA
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normal_has_mean_0_and_variance_1() {
        let mut random = Random::new(5, 0);
        let draws: Vec<f64> = (0..100_000).map(|_| random.normal()).collect();
        let mean = draws.iter().sum::<f64>() / draws.len() as f64;
        let variance =
            draws.iter().map(|draw| (draw - mean) * (draw - mean)).sum::<f64>() / draws.len() as f64;
        assert!(mean.abs() < 0.015, "mean {mean}");
        assert!((variance - 1.0).abs() < 0.02, "variance {variance}");
    }

    #[test]
    fn a_seed_and_stream_are_these_numbers_on_every_machine() {
        let mut random = Random::new(1, 0);
        let first: Vec<usize> = (0..6).map(|_| random.integer(0, 999)).collect();
        let mut again = Random::new(1, 0);
        assert_eq!(first, (0..6).map(|_| again.integer(0, 999)).collect::<Vec<_>>());
        let mut other = Random::new(1, 1);
        assert_ne!(first, (0..6).map(|_| other.integer(0, 999)).collect::<Vec<_>>());
    }
}
