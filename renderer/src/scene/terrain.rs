//! The ground: soft hills without end, a function of position and nothing else.

use glam::Vec2;

use super::perlin::perlin;

/// Height of the ground at `point` (x, z), metres; within ±1.4.
pub fn height_m(point: Vec2) -> f32 {
    perlin(point * (1.0 / 31.0)) * 1.1 + perlin(point * (1.0 / 7.3)) * 0.16
}

/// How much grass grows at `point`, 0.45 to 1: thinner patches of a metre or two, never bald.
pub fn density(point: Vec2) -> f32 {
    (0.86 + 0.5 * perlin(point * (1.0 / 1.9))).clamp(0.45, 1.0)
}

/// How lush the grass is at `point`, 0 (short, light, dry) to 1: patches of metres, tufts within them.
pub fn lushness(point: Vec2) -> f32 {
    let patches = 0.62 * perlin(point * (1.0 / 5.7))
        + 0.34 * perlin(point * (1.0 / 1.3))
        + 0.30 * perlin(point * (1.0 / 0.43));
    (0.52 + patches).clamp(0.0, 1.0)
}

/// How far the blades of a tuft at `point` lean together, as their tips' angle in radians along x
/// and z: grass that has grown, rained and dried leans in tufts, not blade by blade.
pub fn tuft_lean_rad(point: Vec2) -> Vec2 {
    let across = point * (1.0 / 0.47);
    0.42 * Vec2::new(perlin(across), perlin(across + Vec2::new(31.7, 11.3)))
}
