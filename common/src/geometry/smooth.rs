//! Smoothing of evenly spaced samples by penalised least squares.

/// The sequence x that minimises Σ wᵢ(xᵢ − yᵢ)² + λ Σ (Δ³x)².
///
/// `samples`, evenly spaced; `weights` ≥ 0, as many (0: no measurement, the value is inferred);
/// `wavelength`, in samples: with unit weights, waves of that length keep half of their height,
/// longer ones more, shorter ones next to nothing. Parabolas pass unchanged. Sequences of fewer than
/// four samples come back as they are. O(n).
///
/// ```
/// let y: Vec<f64> = (0..40).map(|i| (i as f64 - 20.0).powi(2)).collect();
/// let x = common::geometry::smooth::penalised(&y, &vec![1.0; 40], 15.0);
/// assert!(x.iter().zip(&y).all(|(x, y)| (x - y).abs() < 1e-6));
/// ```
///
/// # Source
/// Whittaker 1923; Eilers 2003, "A perfect smoother". λ by the half-height wavelength is ours:
/// λ = (λ_w/2π)⁶.
pub fn penalised(samples: &[f64], weights: &[f64], wavelength: f64) -> Vec<f64> {
    Penalised::new(weights, wavelength).smooth(samples)
}

const ORDER: usize = 3;

/// What [`penalised`] needs to know of the weights: made once for several sequences.
#[derive(Clone, Debug)]
pub struct Penalised {
    weights: Vec<f64>,
    /// LDLᵀ of W + λDᵀD, which has bandwidth 3: `band[i][k]` is entry (i, i − k) of L, `band[i][0]` one
    /// over that of D.
    band: Vec<[f64; ORDER + 1]>,
}

impl Penalised {
    /// For sequences with these weights and this half-height wavelength. O(n).
    pub fn new(weights: &[f64], wavelength: f64) -> Self {
        const STENCIL: [f64; ORDER + 1] = [-1.0, 3.0, -3.0, 1.0];
        let n = weights.len();
        if n <= ORDER {
            return Self { weights: weights.to_vec(), band: Vec::new() };
        }
        let lambda = (wavelength / std::f64::consts::TAU).powi(2 * ORDER as i32);
        // But for those near the ends all rows of DᵀD are alike.
        let penalty = {
            let mut rows = [[0.0; ORDER + 1]; 2 * ORDER + 1];
            let n = n.min(rows.len());
            for first in 0..n - ORDER {
                for a in 0..=ORDER {
                    for b in 0..=a {
                        rows[first + a][a - b] += lambda * STENCIL[a] * STENCIL[b];
                    }
                }
            }
            rows
        };
        let like = |i: usize| i.min(ORDER).max((i + penalty.len()).saturating_sub(n));
        let mut band: Vec<[f64; ORDER + 1]> = (0..n).map(|i| penalty[like(i)]).collect();
        // The ridge keeps the matrix regular where fewer than three samples are measured.
        let ridge = 1e-12 * (1.0 + lambda);
        for (row, weight) in band.iter_mut().zip(weights) {
            row[0] += weight + ridge;
        }
        // The rows before, the nearest first; before the first row as if there were more, of nothing.
        let mut before = [[0.0; ORDER + 1]; ORDER];
        for row in &mut band {
            for k in (1..=ORDER).rev() {
                // Entry (i, i − k) of LD.
                for m in k + 1..=ORDER {
                    row[k] -= row[m] * before[k - 1][m - k];
                }
            }
            let mut diagonal = row[0];
            for k in 1..=ORDER {
                let of_l = row[k] * before[k - 1][0];
                diagonal -= of_l * row[k];
                row[k] = of_l;
            }
            row[0] = 1.0 / diagonal;
            before = [*row, before[0], before[1]];
        }
        Self { weights: weights.to_vec(), band }
    }

    /// Smooths a sequence of as many samples as there are weights. O(n).
    pub fn smooth(&self, samples: &[f64]) -> Vec<f64> {
        let band = &self.band;
        if samples.len() <= ORDER {
            return samples.to_vec();
        }
        let mut solution: Vec<f64> = samples.iter().zip(&self.weights).map(|(y, w)| w * y).collect();
        let mut before = [0.0; ORDER];
        for (value, row) in solution.iter_mut().zip(band) {
            for k in 1..=ORDER {
                *value -= row[k] * before[k - 1];
            }
            before = [*value, before[0], before[1]];
        }
        let mut after = [(0.0, [0.0; ORDER + 1]); ORDER];
        for (value, row) in solution.iter_mut().zip(band).rev() {
            *value *= row[0];
            for k in 1..=ORDER {
                let (next, of_next) = after[k - 1];
                *value -= next * of_next[k];
            }
            after = [(*value, *row), after[0], after[1]];
        }
        solution
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wave(length: f64) -> Vec<f64> {
        (0..400).map(|i| (f64::from(i) * std::f64::consts::TAU / length).sin()).collect()
    }

    #[test]
    fn the_half_height_wavelength_is_what_it_says() {
        let height = |length| {
            let smooth = penalised(&wave(length), &[1.0; 400], 20.0);
            smooth[100..300].iter().fold(0.0_f64, |a, b| a.max(*b))
        };
        assert!((height(20.0) - 0.5).abs() < 0.03, "{}", height(20.0));
        assert!(height(60.0) > 0.98);
        assert!(height(8.0) < 0.02);
    }

    #[test]
    fn unmeasured_samples_follow_their_neighbours() {
        let line: Vec<f64> = (0..50).map(f64::from).collect();
        let mut samples = line.clone();
        let mut weights = vec![1.0; 50];
        for i in (20..30).chain(45..50) {
            (samples[i], weights[i]) = (1e3, 0.0);
        }
        let smooth = penalised(&samples, &weights, 10.0);
        assert!(smooth.iter().zip(&line).all(|(a, b)| (a - b).abs() < 1e-5), "{smooth:?}");
    }
}
