//! All that the shaders know of sky and sun: worked out once a frame, already exposed, so that each
//! pixel has little left to do and stays within a half float's range.

use std::f32::consts::{PI, TAU};

use bytemuck::{Pod, Zeroable};
use glam::{Vec2, Vec3, Vec4};

use super::sky::{self, Sky};

/// How hazy the air is: 2 is very clear, 6 hazy.
pub const TURBIDITY: f32 = 2.6;
/// Terms of the horizon's light around the compass.
pub const HAZE_TERMS: usize = 8;
/// How high above the horizon the air's own light is looked up, as the sine of the elevation.
const HAZE_UP: f32 = 0.02;
/// What is metered: so much of what a flat white surface shows, as the meadow gives it back, and so much of
/// the horizon, or a low sun's sky would be burnt out.
const METERED: [f32; 2] = [0.038, 0.06];
/// What the mean of the picture is exposed to.
const MIDDLE_GREY: f32 = 0.18;
/// How far exposure follows the light, as an exponent: by 1, dusk would look like noon.
const ADAPTATION: f32 = 0.86;
/// Brightness (kcd/m²) at which exposure needs no adaptation: that of a meadow in the forenoon.
const MEAN_AT_FORENOON: f32 = 1.3;

/// The uniform, in the shaders' layout. Colours are linear sRGB, exposed.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Light {
    /// A to E of the sky's distribution, each for Y, x and y.
    pub perez: [Vec4; 5],
    /// Y, x and y of the zenith over the distribution's value there.
    pub zenith_over_perez: Vec4,
    /// Light of the horizon, as a cosine series in the angle from the sun's heading.
    pub haze: [Vec4; HAZE_TERMS],
    /// The sky as a white matt surface of normal n shows it: the first, and the others times n.
    pub fill: [Vec4; 4],
    /// The sun as a white matt surface that faces it shows it.
    pub sun: Vec3,
    /// Factor from kcd/m² to exposed light.
    pub exposure: f32,
    /// Unit vector to the sun, at least 1° above the horizon: the light of dusk comes flat.
    pub to_sun: Vec3,
    /// How long shadows are, 1 over the tangent of the elevation, at most 12.
    pub shadow_slope: f32,
}

impl Light {
    /// The light for a sun at `heading_and_elevation_rad`.
    ///
    /// # Source
    /// Irradiance of the sky by spherical harmonics of the first order: Ramamoorthi and Hanrahan 2001.
    pub fn new(heading_and_elevation_rad: Vec2) -> Self {
        let sky = Sky::new(heading_and_elevation_rad, TURBIDITY);
        let (mut mean, mut first) = (Vec3::ZERO, [Vec3::ZERO; 3]);
        let count = sky::for_each_direction(|direction| {
            let radiance = sky.radiance(direction);
            mean += radiance;
            for (sum, along) in first.iter_mut().zip(direction.to_array()) {
                *sum += radiance * along;
            }
        }) as f32;
        // The lower half is dark; a flat surface under an even sky of 1 shows 1, one that stands ½.
        let mut fill = [mean / (2.0 * count), first[0] / count, first[1] / count, first[2] / count];
        let sun = sky.sun_illuminance() / PI;
        let horizontal = sky::luminance(fill[0] + fill[2] + sun * sky.sun_direction.y);
        let horizon = haze(&sky);
        let exposure = exposure(horizontal, sky::luminance(horizon[0]));
        fill = fill.map(|term| term * exposure);
        let to_sun = sky::direction(Vec2::new(
            heading_and_elevation_rad.x,
            heading_and_elevation_rad.y.max(1f32.to_radians()),
        ));
        Self {
            perez: sky.perez.map(|row| row.extend(0.0)),
            zenith_over_perez: (sky.zenith_over_perez * Vec3::new(exposure, 1.0, 1.0)).extend(0.0),
            haze: horizon.map(|term| (term * exposure).extend(0.0)),
            fill: fill.map(|term| term.extend(0.0)),
            sun: sun * exposure,
            exposure,
            to_sun,
            shadow_slope: (to_sun.with_y(0.0).length() / to_sun.y).min(12.0),
        }
    }

    /// Exposed light of the horizon towards `direction`, which the haze takes on.
    pub fn haze_towards(&self, direction: Vec3) -> Vec3 {
        let ahead =
            direction.with_y(0.0).normalize_or_zero().dot(self.to_sun.with_y(0.0).normalize_or_zero());
        let angle = ahead.clamp(-1.0, 1.0).acos();
        let term = |order: usize| self.haze[order].truncate() * (angle * order as f32).cos();
        (0..HAZE_TERMS).map(term).sum::<Vec3>().max(Vec3::ZERO)
    }
}

/// Factor on light where a flat white surface shows `horizontal` kcd/m² and the horizon has `horizon`. A function of the sun alone, not
/// of the picture: it can neither flicker nor lag, and a turn of the head changes nothing.
fn exposure(horizontal: f32, horizon: f32) -> f32 {
    let mean = (METERED[0] * horizontal + METERED[1] * horizon).max(1e-5);
    MIDDLE_GREY / MEAN_AT_FORENOON * (mean / MEAN_AT_FORENOON).powf(-ADAPTATION)
}

/// The horizon's light as a cosine series: it is even about the sun's heading.
fn haze(sky: &Sky) -> [Vec3; HAZE_TERMS] {
    const SAMPLES: usize = 64;
    let heading = sky.sun_direction.z.atan2(sky.sun_direction.x);
    let mut terms = [Vec3::ZERO; HAZE_TERMS];
    for sample in 0..SAMPLES {
        let angle = TAU * sample as f32 / SAMPLES as f32;
        let (sin, cos) = (heading + angle).sin_cos();
        let radiance = sky.radiance(Vec3::new(cos, HAZE_UP, sin).normalize());
        for (order, term) in terms.iter_mut().enumerate() {
            let share = if order == 0 { 1.0 } else { 2.0 } / SAMPLES as f32;
            *term += radiance * (angle * order as f32).cos() * share;
        }
    }
    terms
}

#[cfg(test)]
mod tests {
    use super::*;

    fn light(elevation_deg: f32) -> Light {
        Light::new(Vec2::new(0.8, elevation_deg.to_radians()))
    }

    #[test]
    fn haze_is_the_skys_own_horizon() {
        for elevation_deg in [2.0f32, 12.0, 50.0] {
            let light = light(elevation_deg);
            let sky = Sky::new(Vec2::new(0.8, elevation_deg.to_radians()), TURBIDITY);
            for step in 0..32 {
                let (sin, cos) = (step as f32 * TAU / 32.0).sin_cos();
                let direction = Vec3::new(cos, HAZE_UP, sin).normalize();
                let (haze, horizon) =
                    (light.haze_towards(direction), sky.radiance(direction) * light.exposure);
                let off = (haze - horizon).length() / horizon.length();
                assert!(off < 0.16, "{elevation_deg}°, {direction}: {haze}, not {horizon}");
            }
        }
    }

    #[test]
    fn an_even_sky_lights_what_lies_flat_twice_as_much_as_what_stands() {
        let light = light(60.0);
        let shown = |normal: Vec3| {
            let [mean, x, y, z] = light.fill.map(Vec4::truncate);
            sky::luminance(mean + x * normal.x + y * normal.y + z * normal.z)
        };
        let around = [Vec3::X, Vec3::NEG_X, Vec3::Z, Vec3::NEG_Z].map(shown).iter().sum::<f32>() / 4.0;
        assert!((shown(Vec3::Y) / around - 1.85).abs() < 0.3, "{} and {around}", shown(Vec3::Y));
        assert!(shown(Vec3::NEG_Y).abs() < 0.2 * around);
    }

    #[test]
    fn exposure_follows_the_sun_steadily_and_keeps_dusk_darker() {
        let mut last: Option<(f32, f32)> = None;
        for step in 0..=140 {
            let light = light(64.0 - step as f32 * 0.5);
            let bright = sky::luminance(
                light.sun * light.to_sun.y + light.fill[0].truncate() + light.fill[2].truncate(),
            );
            assert!(bright > 0.05 && bright < 4.0, "{bright}");
            if let Some((exposure, brightness)) = last {
                assert!(light.exposure >= exposure && light.exposure < exposure * 1.5, "{}", light.exposure);
                assert!(bright <= brightness * 1.001, "{bright} after {brightness}");
            }
            last = Some((light.exposure, bright));
        }
    }
}
