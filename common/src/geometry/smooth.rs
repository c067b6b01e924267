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
    let lone = |values: &[f64]| values.iter().map(|value| [*value]).collect::<Vec<[f64; 1]>>();
    Penalised::new(lone(weights), [wavelength])
        .smooth(lone(samples))
        .into_iter()
        .map(|[value]| value)
        .collect()
}

const ORDER: usize = 3;

/// What [`penalised`] needs to know of the weights of `N` sequences that are smoothed side by side: each comes
/// out to the bit as if it were alone, and together they cost hardly more than one, whose every step has to
/// wait for the one before.
#[derive(Clone, Debug)]
pub struct Penalised<const N: usize> {
    weights: Vec<[f64; N]>,
    /// LDLᵀ of W + λDᵀD, which has bandwidth 3: `band[i][k]` is entry (i, i − k) of L, `band[i][0]` one
    /// over that of D.
    band: Vec<[[f64; N]; ORDER + 1]>,
}

impl<const N: usize> Penalised<N> {
    /// For sequences with these weights, and their half-height wavelengths. O(n).
    pub fn new(weights: Vec<[f64; N]>, wavelengths: [f64; N]) -> Self {
        const STENCIL: [f64; ORDER + 1] = [-1.0, 3.0, -3.0, 1.0];
        let n = weights.len();
        if n <= ORDER {
            return Self { weights, band: Vec::new() };
        }
        // Not `powi`, whose last bit depends on what the compiler knows.
        let lambda = wavelengths.map(|wavelength| {
            let per_radian = wavelength / std::f64::consts::TAU;
            let cube = per_radian * per_radian * per_radian;
            cube * cube
        });
        // But for those near the ends all rows of DᵀD are alike.
        let penalty = {
            let mut rows = [[[0.0; N]; ORDER + 1]; 2 * ORDER + 1];
            let n = n.min(rows.len());
            for first in 0..n - ORDER {
                for a in 0..=ORDER {
                    for b in 0..=a {
                        let entry = &mut rows[first + a][a - b];
                        *entry = lanes(|k| entry[k] + lambda[k] * STENCIL[a] * STENCIL[b]);
                    }
                }
            }
            rows
        };
        let like = |i: usize| i.min(ORDER).max((i + penalty.len()).saturating_sub(n));
        // The ridge keeps the matrix regular where fewer than three samples are measured.
        let ridge = lambda.map(|lambda| 1e-12 * (1.0 + lambda));
        // The rows before, the nearest first; before the first row as if there were more, of nothing.
        let mut before = [[[0.0; N]; ORDER + 1]; ORDER];
        let band = weights
            .iter()
            .enumerate()
            .map(|(i, weight)| {
                let mut row = penalty[like(i)];
                row[0] = lanes(|lane| row[0][lane] + (weight[lane] + ridge[lane]));
                for k in (1..=ORDER).rev() {
                    // Entry (i, i − k) of LD.
                    for m in k + 1..=ORDER {
                        row[k] = lanes(|lane| row[k][lane] - row[m][lane] * before[k - 1][m - k][lane]);
                    }
                }
                let mut diagonal = row[0];
                for k in 1..=ORDER {
                    let of_l: [f64; N] = lanes(|lane| row[k][lane] * before[k - 1][0][lane]);
                    diagonal = lanes(|lane| diagonal[lane] - of_l[lane] * row[k][lane]);
                    row[k] = of_l;
                }
                row[0] = diagonal.map(|diagonal| 1.0 / diagonal);
                before = [row, before[0], before[1]];
                row
            })
            .collect();
        Self { weights, band }
    }

    /// Smooths sequences of as many samples as there are weights. O(n).
    pub fn smooth(&self, samples: Vec<[f64; N]>) -> Vec<[f64; N]> {
        let band = &self.band;
        let mut solution = samples;
        if solution.len() <= ORDER {
            return solution;
        }
        let mut before = [[0.0; N]; ORDER];
        for ((value, weight), row) in solution.iter_mut().zip(&self.weights).zip(band) {
            *value = lanes(|lane| value[lane] * weight[lane]);
            for k in 1..=ORDER {
                *value = lanes(|lane| value[lane] - row[k][lane] * before[k - 1][lane]);
            }
            before = [*value, before[0], before[1]];
        }
        let mut after = [([0.0; N], [[0.0; N]; ORDER + 1]); ORDER];
        for (value, row) in solution.iter_mut().zip(band).rev() {
            *value = lanes(|lane| value[lane] * row[0][lane]);
            for k in 1..=ORDER {
                let (next, of_next) = &after[k - 1];
                *value = lanes(|lane| value[lane] - next[lane] * of_next[k][lane]);
            }
            after = [(*value, *row), after[0], after[1]];
        }
        solution
    }
}

#[inline]
fn lanes<const N: usize>(of_lane: impl FnMut(usize) -> f64) -> [f64; N] {
    std::array::from_fn(of_lane)
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

    #[test]
    fn sequences_side_by_side_are_smoothed_as_each_alone() {
        let samples: Vec<[f64; 3]> =
            wave(9.0).iter().zip(wave(31.0)).map(|(a, b)| [*a, b, a * b + 3.0]).collect();
        let weights: Vec<[f64; 3]> = (0..400).map(|i| [1.0, f64::from(i % 7), 0.01 * f64::from(i)]).collect();
        let wavelengths = [12.0, 28.0, 48.0];
        for n in [2, 5, 400] {
            let together = Penalised::new(weights[..n].to_vec(), wavelengths).smooth(samples[..n].to_vec());
            for lane in 0..3 {
                let of_lane = |all: &[[f64; 3]]| all.iter().map(|it| it[lane]).collect::<Vec<f64>>();
                let alone = penalised(&of_lane(&samples[..n]), &of_lane(&weights[..n]), wavelengths[lane]);
                assert_eq!(of_lane(&together), alone);
            }
        }
    }
}
