//! Gradient noise over the plane, the same on the CPU and in `passes/common.wgsl`.

use glam::Vec2;

/// Mixes two lattice coordinates into 32 well-spread bits.
///
/// The finaliser is MurmurHash3's (Appleby, public domain), over a sum of both coordinates,
/// each spread by odd constants. Wrapping 32-bit integers only, so that the GPU gives the very same bits.
pub fn hash(x: i32, z: i32) -> u32 {
    let mut h = (x as u32).wrapping_mul(0x9E37_79B1);
    h = (h ^ h >> 15).wrapping_mul(0x2C1B_3C6D).wrapping_add((z as u32).wrapping_mul(0x85EB_CA77));
    h ^= h >> 16;
    h = h.wrapping_mul(0x85EB_CA6B);
    h ^= h >> 13;
    h = h.wrapping_mul(0xC2B2_AE35);
    h ^ (h >> 16)
}

fn gradient(x: i32, z: i32) -> Vec2 {
    const DIAGONAL: f32 = std::f32::consts::FRAC_1_SQRT_2;
    let h = hash(x, z);
    let sign = |bit: u32| if h & bit == 0 { 1.0 } else { -1.0 };
    match h & 3 {
        0 => Vec2::new(sign(4), 0.0),
        1 => Vec2::new(0.0, sign(4)),
        _ => Vec2::new(sign(4), sign(8)) * DIAGONAL,
    }
}

/// Perlin noise at `point`, one lattice cell a unit; about −0.9 to 0.9, 0 at every lattice point.
///
/// # Source
/// Perlin, "Improving Noise", SIGGRAPH 2002: the quintic fade and gradients from a small set. The
/// permutation table is replaced by [`hash`], so the noise has no period and needs no memory.
pub fn perlin(point: Vec2) -> f32 {
    let cell = point.floor();
    let f = point - cell;
    let (x, z) = (cell.x as i32, cell.y as i32);
    let corner = |dx: i32, dz: i32| {
        gradient(x.wrapping_add(dx), z.wrapping_add(dz)).dot(f - Vec2::new(dx as f32, dz as f32))
    };
    let u = f * f * f * (f * (f * 6.0 - 15.0) + 10.0);
    let near = corner(0, 0) + (corner(1, 0) - corner(0, 0)) * u.x;
    let far = corner(0, 1) + (corner(1, 1) - corner(0, 1)) * u.x;
    (near + (far - near) * u.y) * 1.4
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_zero_on_the_lattice_bounded_and_continuous() {
        for x in -5..5 {
            assert_eq!(perlin(Vec2::new(x as f32, 3.0)), 0.0);
        }
        let mut last = perlin(Vec2::new(-20.0, 0.37));
        for step in 1..40_000 {
            let value = perlin(Vec2::new(-20.0 + step as f32 * 1e-3, 0.37));
            assert!(value.abs() <= 1.0 && (value - last).abs() < 1e-2, "{value} after {last}");
            last = value;
        }
    }
}
