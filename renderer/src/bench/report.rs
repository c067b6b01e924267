//! What the bench found, as JSON and as a table.

use std::fmt;

use serde::Serialize;

use crate::scene::grassland::field::Field;

/// The least that a pass took.
#[derive(Clone, Debug, Serialize)]
pub(super) struct PassTime {
    pub(super) pass: String,
    pub(super) least_s: f64,
}

/// The frames of one scene.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Scene {
    pub(super) name: String,
    pub(super) field_blades: u64,
    /// Blades drawn, by level of detail, fine to coarse.
    pub(super) level_blades: Vec<u32>,
    pub(super) triangles: u64,
    /// Wall time of each frame, from its first command to its end.
    pub(super) frames_s: Vec<f64>,
    pub(super) passes: Vec<PassTime>,
    pub(super) gpu_bytes: u64,
}

impl Scene {
    pub(super) fn new(name: &str, field: &Field) -> Self {
        Self {
            name: name.into(),
            field_blades: field.blades(),
            level_blades: Vec::new(),
            triangles: 0,
            frames_s: Vec::new(),
            passes: Vec::new(),
            gpu_bytes: 0,
        }
    }

    pub(super) fn least_s(&self) -> f64 {
        self.frames_s.iter().copied().fold(f64::INFINITY, f64::min)
    }
}

/// Largest changes by FLIP.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub(super) struct Largest {
    /// Between successive frames, mean over the picture: of what moves and of levels of detail.
    pub(super) whole: f32,
    /// Of levels of detail alone, by as much as a step changes them: of the worst thousandth of the pixels, the least.
    pub(super) levels: f32,
}

/// Largest change between successive frames along a slow path.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Walk {
    pub(super) step_m: f32,
    pub(super) blended: Largest,
    pub(super) unblended: Largest,
}

/// Frames while libraries change.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Swap {
    pub(super) blades: usize,
    pub(super) swaps: u32,
    /// Longest frame of a swap over the median frame: median over the swaps.
    pub(super) longest_over_median: f64,
    pub(super) median_frame_s: f64,
    /// Making a library ready to grow, on its own thread.
    pub(super) preparing_s: f64,
}

/// All of it.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Report {
    pub(super) adapter: String,
    pub(super) size: (u32, u32),
    pub(super) scenes: Vec<Scene>,
    pub(super) flip_to_naive: Option<f32>,
    pub(super) walk: Option<Walk>,
    pub(super) swap: Option<Swap>,
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (width, height) = self.size;
        writeln!(f, "{} · {width}×{height}, 4 samples · least of the frames, ms", self.adapter)?;
        write!(
            f,
            "{:<22} {:>10} {:>9} {:>10} {:>8} {:>8}",
            "scene", "drawn", "triangles", "", "MiB", "frame"
        )?;
        let passes = self.scenes.first().map_or(&[][..], |scene| &scene.passes);
        passes.iter().try_for_each(|pass| write!(f, " {:>12}", pass.pass))?;
        writeln!(f)?;
        for scene in &self.scenes {
            let drawn: u32 = scene.level_blades.iter().sum();
            let levels: Vec<String> = scene.level_blades.iter().map(u32::to_string).collect();
            write!(
                f,
                "{:<22} {drawn:>10} {:>9} {:>10} {:>8.1} {:>8.1}",
                scene.name,
                scene.triangles,
                "",
                scene.gpu_bytes as f64 / f64::from(1 << 20),
                scene.least_s() * 1e3
            )?;
            scene.passes.iter().try_for_each(|pass| write!(f, " {:>12.1}", pass.least_s * 1e3))?;
            writeln!(f, "   levels {}", levels.join("/"))?;
        }
        let least = |name: &str| self.scenes.iter().find(|scene| scene.name == name).map(Scene::least_s);
        if let (Some(naive), Some(ours)) = (least("paper's field, naive"), least("paper's field")) {
            writeln!(f, "naive over ours: {:.1}", naive / ours)?;
        }
        if let Some(flip) = self.flip_to_naive {
            writeln!(f, "FLIP of ours to naive: {flip:.4}")?;
        }
        let fields = || self.scenes.iter().filter(|scene| scene.name.ends_with(" blades"));
        let (low, high) = fields().fold((f64::INFINITY, 0.0_f64), |(low, high), scene| {
            (low.min(scene.least_s()), high.max(scene.least_s()))
        });
        let bytes =
            |pick: fn(u64, u64) -> u64| fields().map(|scene| scene.gpu_bytes).reduce(pick).unwrap_or(1);
        writeln!(
            f,
            "1 M to 1 G blades: {:.2} × in time, {:.2} × in memory",
            high / low,
            bytes(u64::max) as f64 / bytes(u64::min) as f64
        )?;
        if let Some(walk) = &self.walk {
            writeln!(
                f,
                "largest FLIP between frames {:.0} mm apart: {:.4} blended, {:.4} not; by levels of detail alone, worst 1/1000 of the pixels: {:.4} blended, {:.4} not",
                walk.step_m * 1e3,
                walk.blended.whole,
                walk.unblended.whole,
                walk.blended.levels,
                walk.unblended.levels
            )?;
        }
        if let Some(swap) = &self.swap {
            writeln!(
                f,
                "{} swaps of {} blades: longest frame {:.2} × the median of {:.1} ms (median over the swaps); made ready in {:.0} ms beside the frames",
                swap.swaps,
                swap.blades,
                swap.longest_over_median,
                swap.median_frame_s * 1e3,
                swap.preparing_s * 1e3
            )?;
        }
        Ok(())
    }
}
