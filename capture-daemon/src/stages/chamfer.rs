//! Distances over a whole grid.

/// Spreads distances from where they are 0: each becomes the least sum of itself and the way there, 12 for
/// a straight step and 17 for a diagonal one. `distance`: rows of `columns` pixels, large where unknown,
/// but no larger than `u32::MAX / 2`. O(pixels).
///
/// # Source
/// Borgefors 1986, in two passes, one each way.
pub(super) fn spread(distance: &mut [u32], columns: usize) {
    let rows = distance.len() / columns;
    if let Some(first) = distance.get_mut(..columns) {
        along(first);
    }
    for y in 1..rows {
        let (above, here) = distance[(y - 1) * columns..(y + 1) * columns].split_at_mut(columns);
        pass_on(above, here);
    }
    for y in (1..rows).rev() {
        let (here, below) = distance[(y - 1) * columns..(y + 1) * columns].split_at_mut(columns);
        pass_on(below, here);
    }
}

/// From a row to the next one, and along that.
fn pass_on(from: &[u32], to: &mut [u32]) {
    // The three neighbours one after the other for all pixels together: the processor takes several at a time.
    to.iter_mut().zip(from).for_each(|(to, from)| *to = (*to).min(from + 12));
    to.iter_mut().zip(&from[1..]).for_each(|(to, from)| *to = (*to).min(from + 17));
    to[1..].iter_mut().zip(from).for_each(|(to, from)| *to = (*to).min(from + 17));
    along(to);
}

fn along(row: &mut [u32]) {
    let mut before = u32::MAX / 2;
    for distance in row.iter_mut() {
        before = (before + 12).min(*distance);
        *distance = before;
    }
    let mut before = u32::MAX / 2;
    for distance in row.iter_mut().rev() {
        before = (before + 12).min(*distance);
        *distance = before;
    }
}
