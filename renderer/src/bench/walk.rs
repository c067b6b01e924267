//! What a slow camera makes of levels of detail: how much successive frames differ, blended and not.

use common::library::Snapshot;

use super::report::{Largest, Walk};
use super::stand::Stand;
use crate::passes::cull::Detail;
use crate::scene::grassland::field::Field;

/// Size of the pictures.
const SIZE: (u32, u32) = (640, 360);
/// How far the eye goes between two frames.
const STEP_M: f32 = 0.01;
/// That, as a part of the distance of what changes its level there.
const STEP_PART: f32 = 0.002;

/// Walks `steps` steps over a meadow in still air, blended and not.
pub(super) fn measure<B: AsRef<[u8]>>(library: &Snapshot<B>, steps: u32) -> anyhow::Result<Walk> {
    let mut stand = Stand::open(SIZE)?;
    let field = Field::of_tiles(Field::PAPER_TILES);
    stand.meadow.lay_out(field);
    stand.meadow.plant(&stand.gpu, library);
    let mut largest = |blended: bool| -> anyhow::Result<Largest> {
        stand.meadow.set_detail(&stand.gpu, Detail { blended, ..Detail::default() });
        let mut view = super::edge(&field);
        let mut last: Option<Vec<u8>> = None;
        let mut largest = Largest::default();
        for _ in 0..=steps {
            let picture = stand.measure(&view, None)?;
            if let Some(last) = &last {
                largest.whole = largest.whole.max(super::flip(SIZE, last, &picture));
            }
            // The same view with the levels of detail of one that is a step farther off.
            stand.meadow.set_detail(&stand.gpu, Detail { blended, distance: 1.0 - STEP_PART, naive: false });
            let other_levels = stand.measure(&view, None)?;
            stand.meadow.set_detail(&stand.gpu, Detail { blended, ..Detail::default() });
            largest.levels = largest.levels.max(super::flip_of_worst(SIZE, &picture, &other_levels));
            last = Some(picture);
            view.camera.foot.y -= STEP_M;
        }
        Ok(largest)
    };
    let (blended, unblended) = (largest(true)?, largest(false)?);
    Ok(Walk { step_m: STEP_M, blended, unblended })
}
