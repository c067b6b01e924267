//! Libraries to test with: blades of five outlines, bent as real ones are.
#![allow(dead_code, reason = "each test takes what it needs")]

use common::blade::{Blade, BladeId, Knot};
use glam::Vec3;

/// One blade's making: lengths in metres, angles in radians.
struct Recipe {
    name: &'static str,
    length_m: f32,
    /// Largest width over length.
    slimness: f32,
    /// Half width at `t` of 0..1 from root to tip, 1 at its largest.
    outline: fn(f32) -> f32,
    /// Angle from upright at the root.
    lean: f32,
    /// How much further the tip has turned.
    droop: f32,
    /// Turn about its own axis from root to tip.
    twist: f32,
    knots: usize,
}

fn lanceolate(t: f32) -> f32 {
    (0.55 + 1.5 * t) * (1.0 - t).powf(0.75) * 0.93
}

fn linear(t: f32) -> f32 {
    (0.82 + 0.18 * (t * 6.0).min(1.0)) * (1.0 - ((t - 0.72) / 0.28).max(0.0).powi(2)).max(0.0).sqrt()
}

fn elliptic(t: f32) -> f32 {
    (1.0 - (2.0 * t - 1.0).powi(2)).max(0.0).sqrt().max(0.12 * (1.0 - t))
}

fn bamboo(t: f32) -> f32 {
    (t * 5.0).min(1.0).sqrt() * (1.0 - t).powf(0.9) * 1.35
}

fn narrow_tip(t: f32) -> f32 {
    (1.0 - t).powf(0.62)
}

const RECIPES: [Recipe; 8] = [
    Recipe {
        name: "lanceolate",
        length_m: 0.21,
        slimness: 0.058,
        outline: lanceolate,
        lean: 0.10,
        droop: 0.9,
        twist: 0.4,
        knots: 16,
    },
    Recipe {
        name: "linear",
        length_m: 0.24,
        slimness: 0.042,
        outline: linear,
        lean: 0.05,
        droop: 1.3,
        twist: -0.6,
        knots: 16,
    },
    Recipe {
        name: "elliptic leaf",
        length_m: 0.12,
        slimness: 0.14,
        outline: elliptic,
        lean: 0.25,
        droop: 0.7,
        twist: 0.1,
        knots: 12,
    },
    Recipe {
        name: "bamboo",
        length_m: 0.18,
        slimness: 0.10,
        outline: bamboo,
        lean: 0.20,
        droop: 1.0,
        twist: 0.3,
        knots: 16,
    },
    Recipe {
        name: "narrow tip",
        length_m: 0.26,
        slimness: 0.045,
        outline: narrow_tip,
        lean: 0.08,
        droop: 1.6,
        twist: 0.5,
        knots: 24,
    },
    Recipe {
        name: "young",
        length_m: 0.15,
        slimness: 0.05,
        outline: narrow_tip,
        lean: 0.03,
        droop: 0.3,
        twist: 0.0,
        knots: 8,
    },
    Recipe {
        name: "lanceolate, bent",
        length_m: 0.23,
        slimness: 0.05,
        outline: lanceolate,
        lean: -0.1,
        droop: -1.9,
        twist: 0.2,
        knots: 16,
    },
    Recipe {
        name: "linear, upright",
        length_m: 0.20,
        slimness: 0.04,
        outline: linear,
        lean: -0.06,
        droop: -0.5,
        twist: 0.8,
        knots: 12,
    },
];

fn grow(recipe: &Recipe, index: u32) -> Blade {
    let steps = recipe.knots - 1;
    let step_m = recipe.length_m / steps as f32;
    let widest_m = recipe.length_m * recipe.slimness * 0.5;
    let mut position = Vec3::ZERO;
    let knots: Vec<Knot> = (0..recipe.knots)
        .map(|knot| {
            let t = knot as f32 / steps as f32;
            let angle = recipe.lean + recipe.droop * t.powf(1.6);
            let here = position;
            // Bends in the plane of x and y, a third of it towards the camera.
            position += Vec3::new(angle.sin() * 0.94, angle.cos(), angle.sin() * 0.33).normalize() * step_m;
            let across = Vec3::new(0.33 * angle.cos(), -0.3 * angle.sin(), -0.94).normalize();
            let across = glam::Quat::from_rotation_y(1.2 + recipe.twist * t) * across;
            let half = widest_m * (recipe.outline)(t);
            Knot { position: here, half_width_left: half * 1.04, across, half_width_right: half * 0.96 }
        })
        .collect();
    let id = BladeId::of(u64::from(index), index, &knots);
    let width_m = knots.iter().map(Knot::width).fold(0.0, f32::max);
    Blade::new(id, recipe.name, knots, [recipe.length_m, width_m], 1, 0.9).expect("a plausible blade")
}

/// Eight blades of five outlines, leaves rarer than blades.
pub(crate) fn meadow(generation: u64) -> Vec<u8> {
    library(generation, &(0..RECIPES.len()).collect::<Vec<_>>())
}

/// A library of these of the eight blades.
pub(crate) fn library(generation: u64, which: &[usize]) -> Vec<u8> {
    let blades: Vec<Blade> = which
        .iter()
        .map(|index| {
            let recipe = &RECIPES[*index];
            let mix = if recipe.slimness > 0.08 { 0.12 } else { 1.0 };
            grow(recipe, *index as u32).with_mix(mix).expect("a valid weight")
        })
        .collect();
    common::library::encode(generation, &blades).expect("few blades")
}
