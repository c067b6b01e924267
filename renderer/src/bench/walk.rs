//! What a slow camera makes of levels of detail: how much successive frames differ, blended and not.

use common::library::Snapshot;

use super::report::Walk;
use super::stand::Stand;
use crate::passes::cull::Detail;
use crate::scene::grassland::field::Field;

/// Size of the pictures.
const SIZE: (u32, u32) = (640, 360);
/// How far the eye goes between two frames.
const STEP_M: f32 = 0.005;

/// Walks `steps` steps over a meadow in still air, blended and not.
pub(super) fn measure<B: AsRef<[u8]>>(library: &Snapshot<B>, steps: u32) -> anyhow::Result<Walk> {
    let mut stand = Stand::open(SIZE)?;
    let field = Field::of_tiles(Field::PAPER_TILES);
    stand.meadow.lay_out(field);
    stand.meadow.plant(&stand.gpu, library);
    let mut largest = |blended: bool| -> anyhow::Result<f32> {
        stand.meadow.set_detail(&stand.gpu, Detail { blended, ..Detail::default() });
        let mut view = super::edge(&field);
        let mut last: Option<Vec<u8>> = None;
        let mut largest: f32 = 0.0;
        for _ in 0..=steps {
            let picture = stand.measure(&view, None)?;
            if let Some(last) = &last {
                largest = largest.max(super::flip(SIZE, last, &picture));
            }
            last = Some(picture);
            view.camera.foot.y -= STEP_M;
        }
        Ok(largest)
    };
    let (largest_flip_blended, largest_flip_unblended) = (largest(true)?, largest(false)?);
    Ok(Walk { step_m: STEP_M, largest_flip_blended, largest_flip_unblended })
}
