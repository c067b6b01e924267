//! What a change of the whole library does to the frames.

use std::time::Instant;

use common::blade::{Blade, BladeId, Knot};
use common::library::{self, Snapshot};

use super::report::Swap;
use super::stand::Stand;
use crate::frame::SWAP_S;
use crate::nursery::Nursery;
use crate::scene::grassland::field::Field;

/// Blades that come and go at once.
const BLADES: usize = 256;
/// Size of the pictures.
const SIZE: (u32, u32) = (640, 360);
/// Frames before, during and after a swap, each this much of the meadow's time.
const FRAMES: usize = 16;

/// Blades like those of `library`, each a little larger or smaller, no two alike and none as in another generation.
fn generation<B: AsRef<[u8]>>(library: &Snapshot<B>, generation: u64) -> anyhow::Result<Snapshot<Vec<u8>>> {
    let kinds: Vec<Vec<Knot>> = library.blades().map(|blade| blade.knots()).collect();
    let blades: Vec<Blade> = (0..BLADES)
        .map(|index| {
            let size = 0.8 + 0.4 * index as f32 / BLADES as f32;
            let mut knots = kinds[index % kinds.len()].clone();
            knots.iter_mut().for_each(|knot| knot.position *= size);
            let id = BladeId::of(generation, index as u32, &knots);
            Blade::new(id, "bench", knots, [0.2 * size, 0.01], 0, 1.0)
        })
        .collect::<Result<_, _>>()?;
    Ok(Snapshot::validate(library::encode(generation, &blades)?)?)
}

/// Swaps libraries of 256 blades `swaps` times beside running frames.
pub(super) fn measure<B: AsRef<[u8]>>(library: &Snapshot<B>, swaps: u32) -> anyhow::Result<Swap> {
    let mut stand = Stand::open(SIZE)?;
    let field = Field::of_tiles(Field::PAPER_TILES);
    stand.meadow.lay_out(field);
    stand.meadow.plant(&stand.gpu, &generation(library, 1)?);
    let mut view = super::edge(&field);
    view.camera.eye_height_m = 0.5;
    let nursery = Nursery::start()?;
    let (mut ratios, mut medians, mut preparing) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..3 {
        stand.frame(&view)?;
    }
    for swap in 0..u64::from(swaps) {
        let next = generation(library, swap + 2)?;
        let sown = Instant::now();
        nursery.sow(next);
        let mut frames = Vec::new();
        let mut after = 0;
        while after < FRAMES {
            let started = Instant::now();
            if let Some(seedling) = nursery.take() {
                preparing.push(sown.elapsed().as_secs_f64());
                stand.meadow.grow(&stand.gpu, seedling.shapes.as_ref());
            }
            let growing = stand.meadow.is_growing();
            stand.meadow.pass_time(SWAP_S / FRAMES as f32);
            stand.frame(&view)?;
            frames.push(started.elapsed().as_secs_f64());
            after += usize::from(!growing && !preparing.is_empty() && preparing.len() as u64 > swap);
        }
        let longest = frames.iter().copied().fold(0.0, f64::max);
        let median = median(frames);
        ratios.push(longest / median);
        medians.push(median);
    }
    Ok(Swap {
        blades: BLADES,
        swaps,
        longest_over_median: median(ratios),
        median_frame_s: median(medians),
        preparing_s: median(preparing),
    })
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}
