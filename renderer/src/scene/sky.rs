//! The clear sky and the sun by day: how bright they are and in which colour, from where the sun stands
//! and how hazy the air is. Luminances in kcd/m², illuminances in klx, colours in linear sRGB whose
//! luminance has that unit.

use glam::{Mat3, Vec2, Vec3};

/// Direction to the sun, unit, from its heading (clockwise from −z seen from above) and elevation, radians.
pub fn direction(heading_and_elevation_rad: Vec2) -> Vec3 {
    let (sin_heading, cos_heading) = heading_and_elevation_rad.x.sin_cos();
    let (sin_elevation, cos_elevation) = heading_and_elevation_rad.y.sin_cos();
    Vec3::new(sin_heading * cos_elevation, sin_elevation, -cos_heading * cos_elevation)
}

/// Where the sun stands at `hour` (true solar time, 0 to 24): heading and elevation, radians, where −z is
/// north. The day is that of late May, the place 48° north.
///
/// # Source
/// Spherical astronomy's transformation of hour angle and declination to the horizon.
pub fn sun_at_hour(hour: f32) -> Vec2 {
    const LATITUDE_RAD: f32 = 48.0 * std::f32::consts::PI / 180.0;
    const DECLINATION_RAD: f32 = 21.0 * std::f32::consts::PI / 180.0;
    let (sin_hour, cos_hour) = ((hour - 12.0) * (std::f32::consts::TAU / 24.0)).sin_cos();
    let (sin_place, cos_place) = LATITUDE_RAD.sin_cos();
    let (sin_sun, cos_sun) = DECLINATION_RAD.sin_cos();
    let east = -cos_sun * sin_hour;
    let north = sin_sun * cos_place - cos_sun * cos_hour * sin_place;
    let up = sin_sun * sin_place + cos_sun * cos_hour * cos_place;
    Vec2::new(east.atan2(north), up.clamp(-1.0, 1.0).asin())
}

/// Luminance of a colour in linear sRGB.
pub fn luminance(colour: Vec3) -> f32 {
    colour.dot(Vec3::new(0.2126, 0.7152, 0.0722))
}

/// The sky's distribution of light, as the shader evaluates it too (`sky_radiance` in `common.wgsl`).
///
/// # Source
/// Preetham, Shirley and Smits, "A Practical Analytic Model for Daylight", 1999. Departures: the model
/// is too bright (see `MEASURED_OVER_MODEL`) and has no answer for a sun below the horizon, so the sky of a sun on the horizon goes dark with it; the
/// direction is held a little above the horizon; green is at least the mean of red and blue,
/// since the fit's horizon is purple under a high sun, which no daylight is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sky {
    /// A to E of Perez' distribution, each for luminance Y and chromaticity x, y.
    pub perez: [Vec3; 5],
    /// Y (kcd/m²), x and y of the zenith, over the distribution's value there.
    pub zenith_over_perez: Vec3,
    /// Unit vector to the sun, at least on the horizon.
    pub sun_direction: Vec3,
    sun_elevation_rad: f32,
    turbidity: f32,
}

/// How bright the measured sky is over this model's, whose clear skies are known to be too bright (Zotti,
/// Wilkie and Purgathofer 2007).
const MEASURED_OVER_MODEL: f32 = 0.65;

/// Least cosine of the angle from the zenith that the distribution is asked for.
pub const MIN_COS_ZENITH: f32 = 0.01;

/// XYZ to linear sRGB, IEC 61966-2-1.
const RGB_FROM_XYZ: Mat3 = Mat3::from_cols(
    Vec3::new(3.2406, -0.9689, 0.0557),
    Vec3::new(-1.5372, 1.8758, -0.2040),
    Vec3::new(-0.4986, 0.0415, 1.0570),
);

impl Sky {
    /// The sky for a sun at `heading_and_elevation_rad` and this turbidity: 2 is very clear, 6 hazy. An
    /// elevation below the horizon is dusk.
    pub fn new(heading_and_elevation_rad: Vec2, turbidity: f32) -> Self {
        let t = turbidity;
        let row = |y: (f32, f32), x: (f32, f32), small_y: (f32, f32)| {
            Vec3::new(y.0 * t + y.1, x.0 * t + x.1, small_y.0 * t + small_y.1)
        };
        let perez = [
            row((0.1787, -1.4630), (-0.0193, -0.2592), (-0.0167, -0.2608)),
            row((-0.3554, 0.4275), (-0.0665, 0.0008), (-0.0950, 0.0092)),
            row((-0.0227, 5.3251), (-0.0004, 0.2125), (-0.0079, 0.2102)),
            row((0.1206, -2.5771), (-0.0641, -0.8989), (-0.0441, -1.6537)),
            row((-0.0670, 0.3703), (-0.0033, 0.0452), (-0.0109, 0.0529)),
        ];
        let elevation = heading_and_elevation_rad.y.max(0.0);
        let theta = std::f32::consts::FRAC_PI_2 - elevation;
        let chi = (4.0 / 9.0 - t / 120.0) * (std::f32::consts::PI - 2.0 * theta);
        let luminance = (4.0453 * t - 4.9710) * chi.tan() - 0.2155 * t + 2.4192;
        let powers = [theta.powi(3), theta.powi(2), theta, 1.0];
        let chromaticity = |rows: [[f32; 4]; 3]| {
            let by_row = rows.map(|row| row.iter().zip(&powers).map(|(m, power)| m * power).sum::<f32>());
            (t * t) * by_row[0] + t * by_row[1] + by_row[2]
        };
        let x = chromaticity([
            [0.00166, -0.00375, 0.00209, 0.0],
            [-0.02903, 0.06377, -0.03202, 0.00394],
            [0.11693, -0.21196, 0.06052, 0.25886],
        ]);
        let y = chromaticity([
            [0.00275, -0.00610, 0.00317, 0.0],
            [-0.04214, 0.08970, -0.04153, 0.00516],
            [0.15346, -0.26756, 0.06670, 0.26688],
        ]);
        // From 0.4 klx at sunset to a hundredth of that when the sun is 6° down.
        let dusk = (0.77 * heading_and_elevation_rad.y.min(0.0).to_degrees()).exp();
        let zenith = Vec3::new(luminance.max(0.1) * dusk, x, y);
        Self {
            perez,
            zenith_over_perez: zenith * Vec3::new(MEASURED_OVER_MODEL, 1.0, 1.0)
                / distribution(&perez, 1.0, theta),
            sun_direction: direction(Vec2::new(heading_and_elevation_rad.x, elevation)),
            sun_elevation_rad: heading_and_elevation_rad.y,
            turbidity,
        }
    }

    /// Light from `direction` (unit), without the sun's disc; below the horizon that of the horizon.
    pub fn radiance(&self, direction: Vec3) -> Vec3 {
        let gamma = direction.dot(self.sun_direction).clamp(-1.0, 1.0).acos();
        let cos_zenith = direction.y.max(MIN_COS_ZENITH);
        let [luminance, x, y] =
            (self.zenith_over_perez * distribution(&self.perez, cos_zenith, gamma)).to_array();
        let xyz = Vec3::new(x / y, 1.0, (1.0 - x - y) / y) * luminance;
        let rgb = (RGB_FROM_XYZ * xyz).max(Vec3::ZERO);
        let daylight = rgb.with_y(rgb.y.max(0.5 * (rgb.x + rgb.z)));
        daylight * (self::luminance(rgb) / self::luminance(daylight).max(1e-9))
    }

    /// What the sun alone gives to a surface that faces it, klx.
    ///
    /// # Source
    /// Preetham et al. 1999, appendix: extinction by air, aerosol and ozone at 615, 545 and 465 nm; air
    /// mass of Kasten 1966. The sun above the air: 133 klx, its spectrum over D65's at these lengths.
    pub fn sun_illuminance(&self) -> Vec3 {
        const ABOVE_AIR: Vec3 = Vec3::new(139.2, 131.7, 128.1);
        const WAVELENGTH_UM: Vec3 = Vec3::new(0.615, 0.545, 0.465);
        const OZONE: Vec3 = Vec3::new(0.1125, 0.080, 0.0075);
        let elevation_deg = self.sun_elevation_rad.to_degrees();
        // Half of the disc is under the horizon at 0°.
        let risen = ((elevation_deg + 0.27) / 0.54).clamp(0.0, 1.0);
        let elevation_deg = elevation_deg.max(0.0);
        let air_mass = 1.0 / (elevation_deg.to_radians().sin() + 0.15 * (3.885 + elevation_deg).powf(-1.253));
        let beta = (0.04608 * self.turbidity - 0.04586).max(0.0);
        let extinction =
            0.008735 * WAVELENGTH_UM.powf(-4.08) + beta * WAVELENGTH_UM.powf(-1.3) + OZONE * 0.35;
        ABOVE_AIR * (-extinction * air_mass).exp() * risen
    }
}

/// Perez' F for Y, x and y; `gamma`: angle from the sun, radians.
fn distribution(perez: &[Vec3; 5], cos_zenith: f32, gamma: f32) -> Vec3 {
    let [a, b, c, d, e] = *perez;
    let cos_gamma = gamma.cos();
    (Vec3::ONE + a * (b / cos_zenith).exp())
        * (Vec3::ONE + c * (d * gamma).exp() + e * (cos_gamma * cos_gamma))
}

/// Visits directions of the upper half space evenly, each with the same share of its 2π.
pub(crate) fn for_each_direction(mut visit: impl FnMut(Vec3)) -> usize {
    const COUNT: usize = 1024;
    let golden = std::f32::consts::PI * (3.0 - 5f32.sqrt());
    for index in 0..COUNT {
        let y = (index as f32 + 0.5) / COUNT as f32;
        let (sin, cos) = (golden * index as f32).sin_cos();
        let radius = (1.0 - y * y).sqrt();
        visit(Vec3::new(cos * radius, y, sin * radius));
    }
    COUNT
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sky(elevation_deg: f32, turbidity: f32) -> Sky {
        Sky::new(Vec2::new(0.8, elevation_deg.to_radians()), turbidity)
    }

    /// Illuminance of the ground by the sky alone, klx.
    fn diffuse_klx(sky: &Sky) -> f32 {
        let mut sum = 0.0;
        let count = for_each_direction(|direction| sum += luminance(sky.radiance(direction)) * direction.y);
        sum * std::f32::consts::TAU / count as f32
    }

    #[test]
    fn daylight_is_as_bright_as_was_measured() {
        // IESNA Lighting Handbook, 9th edition, chapter 8: the clear sky's two illuminances.
        for elevation_deg in [20.0f32, 40.0, 60.0] {
            let sin = elevation_deg.to_radians().sin();
            let sky = sky(elevation_deg, 2.5);
            let (direct, diffuse) = (luminance(sky.sun_illuminance()), diffuse_klx(&sky));
            let (expected_direct, expected_diffuse) = (127.5 * (-0.21 / sin).exp(), 0.8 + 15.5 * sin.sqrt());
            assert!((direct / expected_direct - 1.0).abs() < 0.2, "{direct} klx, not {expected_direct}");
            assert!((diffuse / expected_diffuse - 1.0).abs() < 0.45, "{diffuse} klx, not {expected_diffuse}");
        }
    }

    #[test]
    fn the_zenith_has_the_papers_luminance() {
        // Y_z by hand for turbidity 3 and a sun at the zenith: (4·3.0453 …)·tan(0.41944·π) − … kcd/m².
        let sky = sky(90.0, 3.0);
        let by_hand = MEASURED_OVER_MODEL
            * ((4.0453 * 3.0 - 4.9710) * (0.419_444_44f32 * std::f32::consts::PI).tan() + 1.7727);
        let zenith = Sky { sun_direction: Vec3::Y, ..sky }.radiance(Vec3::Y);
        assert!((luminance(zenith) / by_hand - 1.0).abs() < 0.02, "{zenith}, not {by_hand}");
    }

    #[test]
    fn the_sky_is_brightest_at_the_sun_blue_above_and_pale_below() {
        for elevation_deg in [5.0, 25.0, 60.0] {
            let sky = sky(elevation_deg, 2.5);
            let at_sun = luminance(sky.radiance(sky.sun_direction));
            for_each_direction(|direction| {
                let radiance = sky.radiance(direction);
                assert!(radiance.is_finite() && radiance.min_element() >= 0.0);
                // Towards the horizon there is more air, and it may outshine a sun that stands higher.
                assert!(direction.y < 0.3 || luminance(radiance) <= at_sun * 1.01, "{direction}: {radiance}");
            });
            let away = Vec3::new(-sky.sun_direction.x, 0.0, -sky.sun_direction.z).normalize();
            let blueness = |radiance: Vec3| radiance.z / radiance.x;
            let aloft = sky.radiance((away + Vec3::Y * 2.0).normalize());
            assert!(blueness(aloft) > 1.3 * blueness(sky.radiance(away)), "{elevation_deg}");
        }
    }

    #[test]
    fn left_and_right_of_the_sun_are_alike() {
        let sky = Sky::new(Vec2::new(0.0, 0.4), 3.0);
        for_each_direction(|direction| {
            let other = sky.radiance(direction * Vec3::new(-1.0, 1.0, 1.0));
            assert!((sky.radiance(direction) - other).length() < 1e-3 * other.length());
        });
    }

    #[test]
    fn a_low_sun_is_red_and_dusk_is_dark_without_a_jump() {
        let (low, high) = (sky(3.0, 2.5).sun_illuminance(), sky(60.0, 2.5).sun_illuminance());
        assert!(low.x / low.z > 2.5 * high.x / high.z, "{low}, {high}");
        let mut last = f32::MAX;
        for step in 0..240 {
            let elevation_deg = 12.0 - step as f32 * 0.1;
            let sky = sky(elevation_deg, 2.5);
            let now = diffuse_klx(&sky)
                + luminance(sky.sun_illuminance()) * elevation_deg.max(0.0).to_radians().sin();
            assert!(
                now > 0.0 && now <= last * 1.02 && (last == f32::MAX || now > last * 0.85),
                "{elevation_deg}: {now}"
            );
            last = now;
        }
        assert!(last < 0.01, "{last} klx when the sun is 12 degrees down");
    }

    #[test]
    fn the_sun_goes_from_east_over_south_to_west() {
        let noon = sun_at_hour(12.0);
        assert!((noon.x.abs() - std::f32::consts::PI).abs() < 1e-3, "south, not {noon}");
        assert!((noon.y.to_degrees() - 63.0).abs() < 0.1, "90° − 48° + 21°, not {noon}");
        assert!(sun_at_hour(6.0).x > 0.0 && sun_at_hour(18.0).x < 0.0);
        assert!(sun_at_hour(0.0).y < 0.0 && sun_at_hour(3.8).y < 0.0 && sun_at_hour(5.0).y > 0.0);
        assert!((direction(sun_at_hour(9.0)).length() - 1.0).abs() < 1e-5);
    }
}
