//! The table, a row as soon as it is measured.

/// A Markdown table on stdout.
pub(crate) struct Table(());

impl Table {
    /// Prints its head.
    pub(crate) fn begin() -> Self {
        println!("| what | unit | median | 5 % – 95 % | of |");
        println!("|---|---|---|---|---|");
        Self(())
    }

    /// Prints a row of `values`, in any order.
    ///
    /// # Panics
    /// If there are none.
    pub(crate) fn row(&mut self, what: &str, unit: &str, mut values: Vec<f64>) {
        assert!(!values.is_empty(), "{what}: nothing was measured");
        values.sort_by(f64::total_cmp);
        let at = |share: f64| values[(share * (values.len() - 1) as f64).round() as usize];
        let [low, median, high] = [0.05, 0.5, 0.95].map(|share| shown(at(share)));
        println!("| {what} | {unit} | {median} | {low} – {high} | {} |", values.len());
    }
}

/// Three digits, and no more of them than are measured.
fn shown(value: f64) -> String {
    let decimals = match value {
        _ if value >= 100.0 => 0,
        _ if value >= 10.0 => 1,
        _ if value >= 1.0 => 2,
        _ => 3,
    };
    format!("{value:.decimals$}")
}
