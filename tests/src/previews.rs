//! What must hold of a preview that is taken for whole.

use common::preview::{HAND, Preview, SEEN, layout};

/// Reads everything that a valid preview offers and holds it to what the interface says.
///
/// # Panics
/// When something is not as the interface says.
pub fn read_all<B: AsRef<[u8]>>(preview: &Preview<B>) {
    let header = preview.header();
    let pixels = header.width as usize * header.height as usize;
    assert_eq!(
        (preview.depth_mm().count(), preview.mask().len(), preview.labels().len()),
        (pixels, pixels, pixels)
    );
    assert!(preview.mask().iter().all(|bits| *bits <= SEEN | HAND));
    assert!((0.0..=1.0).contains(&header.hold));
    assert!(header.camera_px.iter().all(|value| value.is_finite()));
    for line in preview.polylines() {
        let _ = (line.kind(), line.label());
        assert!(line.points().len() >= 2);
        for point in line.points() {
            assert!(point.x.is_finite() && point.y.is_finite());
            assert!(point.half_width_left >= 0.0 && point.half_width_right >= 0.0);
        }
    }
    assert!(!preview.code().is_empty() && preview.words().len() <= layout::MAX_WORDS_BYTES);
}
