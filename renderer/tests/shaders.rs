//! Are the shaders valid, and do they see memory as Rust does?

use naga::valid::{Capabilities, ValidationFlags, Validator};
use naga::{Module, TypeInner};
use renderer::frame::gpu_data::Frame;
use renderer::gpu::shader::{PASSES, Sources};
use renderer::passes::cull::gpu_data::{Draw, Instance, Window};
use renderer::passes::grass::gpu_data::Shape;
use renderer::passes::shadow::gpu_data::Shadow;
use renderer::scene::grassland::PatchBlade;
use renderer::scene::light::Light;

fn parse(name: &str, source: &str) -> Module {
    let module = naga::front::wgsl::parse_str(source)
        .unwrap_or_else(|error| panic!("{name}: {}", error.emit_to_string(source)));
    Validator::new(ValidationFlags::all(), Capabilities::empty())
        .validate(&module)
        .unwrap_or_else(|error| panic!("{name}: {}", error.emit_to_string(source)));
    module
}

fn module_of(pass: &str) -> Module {
    parse(pass, &Sources::default().compose(pass))
}

#[test]
fn every_shader_is_valid() {
    for (pass, _) in PASSES {
        module_of(pass);
    }
}

/// Compares the WGSL struct `name` with what Rust has: its members in order, each with its offset,
/// and its size.
fn check(module: &Module, name: &str, expected: &[(&str, usize)], size: usize) {
    let (_, found) = module
        .types
        .iter()
        .find(|(_, found)| found.name.as_deref() == Some(name))
        .expect("the struct is there");
    let TypeInner::Struct { members, span } = &found.inner else { panic!("{name} is no struct") };
    let members: Vec<(&str, usize)> = members
        .iter()
        .map(|member| (member.name.as_deref().unwrap_or_default(), member.offset as usize))
        .collect();
    assert_eq!(members, expected, "{name}");
    assert_eq!(*span as usize, size, "{name}");
}

macro_rules! check_layout {
    ($module:expr, $name:ident { $($field:ident),* $(,)? }) => {
        check(
            $module,
            stringify!($name),
            &[$((stringify!($field), std::mem::offset_of!($name, $field))),*],
            size_of::<$name>(),
        )
    };
}

#[test]
fn structs_lie_in_memory_as_in_rust() {
    use common::blade::Knot;
    let (cull, grass) = (module_of("cull"), module_of("grass"));
    for module in [&cull, &grass] {
        check_layout!(
            module,
            Frame {
                clip_from_world,
                world_from_clip,
                planes,
                eye_in_world,
                time_s,
                pixel_rad,
                grows,
                _pad_0,
                _pad_1,
            }
        );
        check_layout!(module, PatchBlade { root, shape_turn_scale_mirror, lean_hue, salt });
    }
    for module in [&grass, &module_of("ground"), &module_of("sky")] {
        check_layout!(
            module,
            Light { perez, zenith_over_perez, haze, fill, sun, exposure, to_sun, shadow_slope }
        );
    }
    for module in [&grass, &module_of("ground")] {
        check_layout!(module, Shadow { map_from_world, strength, texel_m, _pad_0, _pad_1 });
    }
    check_layout!(&cull, Window { first_tile_x, first_tile_z, side, reach_m });
    check_layout!(&cull, Instance { root_in_world, blade_and_lushness, bend_rad, presence, widen });
    check_layout!(&cull, Draw { index_count, instance_count, first_index, base_vertex, first_instance });
    check_layout!(&grass, Shape { first_knot, knot_count });
    check_layout!(&grass, Knot { position, half_width_left, across, half_width_right });
}
