//! Wind: a breeze from one side whose gusts travel over the meadow.

use glam::Vec2;

use super::perlin::perlin;

/// Where the wind blows to, (x, z), unit.
pub const DIRECTION: Vec2 = Vec2::new(0.8, 0.6);
/// How fast gusts travel, metres a second.
pub const SPEED_M_PER_S: f32 = 1.6;

/// How far the wind bends a blade at `root` (x, z) over, as its tip's angle in radians along x and z.
pub fn bend_rad(root: Vec2, time_s: f32) -> Vec2 {
    let travelled = root - DIRECTION * (SPEED_M_PER_S * time_s);
    let gust = perlin(travelled * (1.0 / 2.6));
    let flutter = perlin(travelled * (1.0 / 0.45) + Vec2::new(0.0, 0.7 * time_s));
    DIRECTION * (0.10 + 0.14 * gust) + Vec2::new(-DIRECTION.y, DIRECTION.x) * (0.07 * flutter)
}
