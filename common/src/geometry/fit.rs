//! Fitting curves to samples.

/// Weighted least squares of a polynomial of degree two at most: samples are added one by one.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Parabola {
    /// Σ w·sᵏ for k = 0..=4.
    powers: [f64; 5],
    /// Σ w·v·sᵏ for k = 0..=2.
    values: [f64; 3],
}

impl Parabola {
    /// Adds the sample `value` at `s`, with a weight ≥ 0.
    #[inline]
    pub fn add(&mut self, s: f64, value: f64, weight: f64) {
        let mut power = weight;
        for k in 0..5 {
            self.powers[k] += power;
            if k < 3 {
                self.values[k] += power * value;
            }
            power *= s;
        }
    }

    /// Moves all samples so far to `s + by`.
    ///
    /// ```
    /// let mut fit = common::geometry::fit::Parabola::default();
    /// [1.0, 2.0, 3.0, 4.0].map(|s| fit.add(s, s * s, 1.0));
    /// fit.shift(-4.0);
    /// let [a, b, c] = fit.solve(2, 0.0).expect("four samples");
    /// assert!((a - 16.0).abs() + (b - 8.0).abs() + (c - 1.0).abs() < 1e-9);
    /// ```
    #[inline]
    pub fn shift(&mut self, by: f64) {
        // Binomial sums, as Pascal's triangle makes them.
        for first in 1..5 {
            for k in (first..5).rev() {
                self.powers[k] += by * self.powers[k - 1];
            }
        }
        for first in 1..3 {
            for k in (first..3).rev() {
                self.values[k] += by * self.values[k - 1];
            }
        }
    }

    /// Multiplies the weights of all samples so far.
    #[inline]
    pub fn scale(&mut self, factor: f64) {
        self.powers.iter_mut().chain(&mut self.values).for_each(|sum| *sum *= factor);
    }

    /// The coefficients of 1, s and s² of the best polynomial of `degree` (0..=2); `None` where the
    /// samples do not determine it. `ridge` ≥ 0 holds the coefficient of s² back: it is what its
    /// square costs beside the mean square error.
    ///
    /// ```
    /// let mut fit = common::geometry::fit::Parabola::default();
    /// for s in [-2.0, -1.0, 1.0, 3.0] {
    ///     fit.add(s, 5.0 - s + 2.0 * s * s, 1.0);
    /// }
    /// let [a, b, c] = fit.solve(2, 0.0).expect("four samples");
    /// assert!((a - 5.0).abs() + (b + 1.0).abs() + (c - 2.0).abs() < 1e-9);
    /// assert!(fit.solve(2, 1e6).expect("four samples")[2].abs() < 1e-3);
    /// ```
    #[inline]
    pub fn solve(&self, degree: usize, ridge: f64) -> Option<[f64; 3]> {
        let n = degree.min(2) + 1;
        if self.powers[0] <= 1e-9 {
            return None;
        }
        // Gauss on the normal equations, a row as three coefficients and the right side.
        let mut rows: [[f64; 4]; 3] = std::array::from_fn(|row| {
            let [a, b, mut c] =
                [0, 1, 2].map(|column| if column < n { self.powers[row + column] } else { 0.0 });
            if row == 2 {
                c += ridge * self.powers[0];
            }
            [a, b, c, self.values[row]]
        });
        let rows = &mut rows[..n];
        for pivot in 0..n {
            let pivot_row = rows[pivot];
            if pivot_row[pivot].abs() < 1e-9 {
                return None;
            }
            for row in &mut rows[pivot + 1..] {
                let factor = row[pivot] / pivot_row[pivot];
                row.iter_mut().zip(pivot_row).for_each(|(value, above)| *value -= factor * above);
            }
        }
        let mut solution = [0.0; 3];
        for (index, row) in rows.iter().enumerate().rev() {
            let known: f64 = (index + 1..n).map(|column| row[column] * solution[column]).sum();
            solution[index] = (row[3] - known) / row[index];
        }
        Some(solution)
    }
}
