//! Wind: a breeze from one side whose gusts travel over the meadow as waves, and what it does to a blade.
//!
//! The field of gusts is one square of noise that repeats without a seam. It is looked up twice, large
//! and slow for gusts, small, turned and faster for the flutter of single tufts, so that no repetition
//! is seen.

use std::sync::LazyLock;

use glam::{Vec2, Vec3};
use rand_pcg::Pcg32;
use rand_pcg::rand_core::{RngCore, SeedableRng};

use super::camera::WALK_S;

/// Where the wind blows to, (x, z), unit.
pub const DIRECTION: Vec2 = Vec2::new(0.8, 0.6);
/// Texels of the field along one side; a power of two.
pub const FIELD_SIDE: u32 = 128;
/// Side of the field where it gives the gusts, metres.
pub const GUST_FIELD_M: f32 = 48.0;
/// Side of the field where it gives the flutter, metres.
pub const FLUTTER_FIELD_M: f32 = 9.0;
/// How fast gusts travel, metres a second: a whole number of fields in a round of the meadow's time
/// along either axis, so that they go on without a jump.
pub const GUST_M_PER_S: f32 = 5.0 * 34.0 * GUST_FIELD_M / WALK_S;
/// The same of the flutter, which runs across the gusts.
pub const FLUTTER_M_PER_S: f32 = 5.0 * 96.0 * FLUTTER_FIELD_M / WALK_S;

/// Power of the field's spectrum over frequency. Along a line through it, as the wind carries it past a
/// blade, it is less by 1: the 2 that was measured of moving branches.
const BETA: f32 = 3.0;
const SEED: u64 = 0x6057;

/// The field, row by row: along the wind and across it, each within ±1 and 0 in the mean.
///
/// # Source
/// Spectral synthesis (Voss 1985; METHODS 8): white Gaussian noise weighed by f^(−β/2) on the wrapped
/// lattice, brought back by an inverse Fourier transform, of which the real part is taken.
pub static FIELD: LazyLock<Vec<Vec2>> = LazyLock::new(|| {
    let [along, across] = synthesise(FIELD_SIDE as usize, BETA, SEED);
    along.into_iter().zip(across).map(|(x, y)| Vec2::new(x, y)).collect()
});

/// Two independent fields of `side`² values: the real and the imaginary part of one transform.
fn synthesise(side: usize, beta: f32, seed: u64) -> [Vec<f32>; 2] {
    let mut random = Pcg32::seed_from_u64(seed);
    let mut uniform = || (random.next_u32() as f32 + 0.5) / 4_294_967_296.0;
    let wrapped = |index: usize| index.min(side - index) as f32;
    let mut spectrum: Vec<Vec2> = (0..side * side)
        .map(|index| {
            let f = Vec2::new(wrapped(index % side), wrapped(index / side)).length();
            // Box and Muller: a Gaussian pair.
            let radius = (-2.0 * uniform().ln()).sqrt();
            let gaussian = Vec2::from_angle(std::f32::consts::TAU * uniform()) * radius;
            // What is shorter than a few texels would only be lost between them; no mean either.
            if f < 0.5 || f > side as f32 * 0.25 { Vec2::ZERO } else { gaussian * f.powf(-0.5 * beta) }
        })
        .collect();
    // Rows, then columns; so short, they need no fast transform.
    let turns: Vec<Vec2> =
        (0..side).map(|k| Vec2::from_angle(std::f32::consts::TAU * k as f32 / side as f32)).collect();
    for _ in 0..2 {
        let mut out = vec![Vec2::ZERO; side * side];
        for row in 0..side {
            let line = &spectrum[row * side..][..side];
            for x in 0..side {
                let sum: Vec2 =
                    line.iter().enumerate().map(|(k, value)| turns[k * x % side].rotate(*value)).sum();
                // Written as a column, so that the second time goes over the columns.
                out[x * side + row] = sum;
            }
        }
        spectrum = out;
    }
    [|value: &Vec2| value.x, |value: &Vec2| value.y].map(|part| {
        let values: Vec<f32> = spectrum.iter().map(part).collect();
        let largest = values.iter().fold(0f32, |largest, value| largest.max(value.abs()));
        values.into_iter().map(|value| value / largest).collect()
    })
}

/// The field at `at`, in sides of it, between its texels; it repeats at every whole number.
fn field(at: Vec2) -> Vec2 {
    let texel = (at - at.floor()) * FIELD_SIDE as f32;
    let lower = texel.floor();
    let f = texel - lower;
    let value = |dx: u32, dz: u32| {
        let (x, z) = ((lower.x as u32 + dx) % FIELD_SIDE, (lower.y as u32 + dz) % FIELD_SIDE);
        FIELD[(z * FIELD_SIDE + x) as usize]
    };
    value(0, 0).lerp(value(1, 0), f.x).lerp(value(0, 1).lerp(value(1, 1), f.x), f.y)
}

/// How far the wind bends a blade at `root` (x, z) over, as the angle of its tip seen from its root in
/// radians along x and z.
///
/// A gust lays the grass down further than a lull lets it rise: it goes with the square of the wind.
pub fn bend_rad(root: Vec2, time_s: f32) -> Vec2 {
    let across = Vec2::new(-DIRECTION.y, DIRECTION.x);
    let gust = field((root - DIRECTION * (GUST_M_PER_S * time_s)) * (1.0 / GUST_FIELD_M));
    let turned = Vec2::new(0.6 * root.x + 0.8 * root.y, 0.6 * root.y - 0.8 * root.x);
    let flutter = field((turned - DIRECTION * (FLUTTER_M_PER_S * time_s)) * (1.0 / FLUTTER_FIELD_M));
    let wind = 1.0 + 0.9 * gust.x;
    DIRECTION * (0.10 * wind * wind + 0.05 * flutter.x) + across * (0.09 * gust.y + 0.06 * flutter.y)
}

/// Where a point of a blade goes when the wind bends it, seen from the root: each piece turns by twice the
/// angle that its chord turns by, as an evenly bent rod does, and the blade stays as long as it was.
///
/// `point` and `tangent` (any length): before, in metres from the root; `along`: 0 at the root to 1 at the
/// tip; `bend_rad`: as [`bend_rad`] gives it. The tangent turns by `2·along·bend_rad` ([`turned`]).
///
/// # Source
/// The chord of an arc of turn Θt is sin(Θt/2)/(Θt/2) of its length; for a blade that is bent already,
/// the next term of the expansion in both bends.
pub fn bent(point: Vec3, tangent: Vec3, along: f32, bend_rad: Vec2) -> Vec3 {
    let angle = bend_rad * along;
    let size = angle.length();
    if size < 1e-5 {
        return point;
    }
    let axis = Vec3::new(angle.y, 0.0, -angle.x) / size;
    let reach = (point.length() * tangent.length()).max(1e-12);
    let more = axis.dot(point.cross(tangent)) / reach;
    turned(point, angle) * (size.sin() / size * (1.0 - size * more / 3.0))
}

/// Turns `v` by `angle` (radians, as a vector in x and z) from upright towards that direction.
pub fn turned(v: Vec3, angle: Vec2) -> Vec3 {
    let size = angle.length();
    if size < 1e-5 {
        return v;
    }
    let axis = Vec3::new(angle.y, 0.0, -angle.x) / size;
    let (sin, cos) = size.sin_cos();
    v * cos + axis.cross(v) * sin + axis * (axis.dot(v) * (1.0 - cos))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_field_is_level_bounded_and_without_a_seam() {
        let side = FIELD_SIDE as usize;
        assert_eq!(FIELD.len(), side * side);
        let mean = FIELD.iter().sum::<Vec2>() / FIELD.len() as f32;
        assert!(mean.length() < 1e-3, "{mean}");
        assert!(FIELD.iter().all(|value| value.abs().max_element() <= 1.0));
        let step = |a: usize, b: usize| (FIELD[a].x - FIELD[b].x).abs();
        let within: f32 = (0..side).map(|row| step(row * side + 40, row * side + 41)).sum();
        let seam: f32 = (0..side).map(|row| step(row * side + side - 1, row * side)).sum();
        assert!(seam < 2.0 * within, "{seam} at the seam, {within} elsewhere");
    }

    #[test]
    fn a_line_through_the_field_has_the_spectrum_of_moving_branches() {
        let side = FIELD_SIDE as usize;
        let power_of = |k: usize| -> f32 {
            let of_row = |row: usize| {
                let sum: Vec2 = (0..side)
                    .map(|x| {
                        let turn = std::f32::consts::TAU * (k * x % side) as f32 / side as f32;
                        Vec2::from_angle(-turn) * FIELD[row * side + x].x
                    })
                    .sum();
                sum.length_squared()
            };
            (0..side).map(of_row).sum()
        };
        let octave = |from: usize| (from..2 * from).map(power_of).sum::<f32>() / from as f32;
        let beta = (octave(2) / octave(8)).log2() / 2.0;
        assert!((beta - 2.0).abs() < 0.5, "1/f^{beta}");
    }

    #[test]
    fn gusts_travel_with_the_wind_and_come_round() {
        let root = Vec2::new(3.0, -7.0);
        let gust = |at: Vec2, time_s: f32| {
            let field_at = (at - DIRECTION * (GUST_M_PER_S * time_s)) * (1.0 / GUST_FIELD_M);
            field(field_at)
        };
        let later = gust(root + DIRECTION * (GUST_M_PER_S * 2.0), 2.0);
        assert!((later - gust(root, 0.0)).length() < 1e-4);
        let step = (bend_rad(root, WALK_S) - bend_rad(root, 0.0)).length();
        assert!(step < 5e-3, "a jump of {step} when the round begins anew");
        let moved = (0..100).map(|i| bend_rad(root, i as f32 * 0.5));
        let (least, most) = moved.fold((f32::MAX, f32::MIN), |(least, most), bend| {
            (least.min(bend.dot(DIRECTION)), most.max(bend.dot(DIRECTION)))
        });
        assert!(most - least > 0.05 && most < 0.8, "{least} to {most}");
    }

    #[test]
    fn a_bent_blade_keeps_its_length() {
        for droop in [-1.5f32, -0.5, 0.0, 0.7, 1.5] {
            for bend in [Vec2::new(0.1, 0.0), Vec2::new(0.35, -0.2), Vec2::new(-0.5, 0.1)] {
                let steps = 200;
                let tangent = |t: f32| Vec3::new((droop * t).sin(), (droop * t).cos(), 0.0);
                let (mut point, mut last, mut length) = (Vec3::ZERO, Vec3::ZERO, 0.0);
                for step in 0..steps {
                    let t = (step as f32 + 0.5) / steps as f32;
                    point += tangent(t) / steps as f32;
                    let along = (step + 1) as f32 / steps as f32;
                    let here = bent(point, tangent(along), along, bend);
                    length += here.distance(last);
                    last = here;
                }
                assert!((length - 1.0).abs() < 0.03, "droop {droop}, bend {bend}: length {length}");
            }
        }
    }
}
