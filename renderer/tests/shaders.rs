//! Are the shaders valid, and do they see memory as Rust does?

use naga::valid::{Capabilities, ValidationFlags, Validator};
use naga::{Module, TypeInner};
use renderer::frame::gpu_data::Frame;
use renderer::gpu::shader::{PASSES, Sources};
use renderer::passes::cull::gpu_data::{Chunk, Counts, Draw, Instance, Share, Slot, Survey};
use renderer::passes::grass::gpu_data::{ShapeKnot, SimulatedKnot};
use renderer::passes::shadow::gpu_data::Shadow;
use renderer::scene::grassland::PatchBlade;
use renderer::scene::grassland::field::Block;
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
    let [tiles, blades, args, grass] = ["cull.tiles", "cull.blades", "cull.args", "grass"].map(module_of);
    for module in [&tiles, &blades, &args, &grass] {
        check_layout!(
            module,
            Frame {
                clip_from_world,
                world_from_clip,
                planes,
                eye_in_world,
                time_s,
                pixel_rad,
                grown,
                full_pixel_m,
                range_m,
                field_from_m,
                field_to_m,
            }
        );
    }
    for module in [&grass, &module_of("ground"), &module_of("sky")] {
        check_layout!(
            module,
            Light { perez, zenith_over_perez, haze, fill, sun, exposure, to_sun, shadow_slope }
        );
    }
    for module in [&grass, &module_of("ground")] {
        check_layout!(module, Shadow { map_from_world, strength, texel_m, thrown_to_m, _pad_0 });
    }
    for module in [&tiles, &blades, &args] {
        check_layout!(
            module,
            Survey {
                first_tile_x,
                first_tile_z,
                columns,
                tiles,
                full_pixel_m,
                detail,
                range_m,
                swapped,
                blocks,
                everything,
                slots,
                capacity,
                reach_m,
                blended,
                _pad_0,
                _pad_1,
            }
        );
        check_layout!(module, Counts { chunks, instances, levels });
    }
    check_layout!(&tiles, Block { x, z });
    check_layout!(&tiles, Slot { tile_x, tile_z, slot, _pad_0 });
    for module in [&tiles, &blades] {
        check_layout!(module, Chunk { tile_x, tile_z, first_rank, slot });
    }
    check_layout!(&blades, PatchBlade { root, shape_turn_scale_mirror, lean_hue, salt });
    check_layout!(&blades, Share { shape, reach_m });
    for module in [&blades, &grass] {
        check_layout!(
            module,
            Instance {
                root_in_world,
                first_knot,
                bend_rad,
                scale,
                widen,
                morph,
                shape_turn_scale_mirror,
                lean_hue,
                salt,
                lush,
                sunlight,
                simulated,
                stands_for,
            }
        );
    }
    check_layout!(&args, Draw { index_count, instance_count, first_index, base_vertex, first_instance });
    check_layout!(
        &grass,
        ShapeKnot {
            position,
            along,
            across,
            half_width_left,
            tangent,
            half_width_right,
            coarse_row,
            coarse_between,
            finest_row,
            reach_m,
        }
    );
    check_layout!(&grass, SimulatedKnot { position, _pad_0 });
}

#[test]
fn shaders_stay_within_what_every_driver_has() {
    for (name, _) in PASSES {
        let module = module_of(name);
        let storage = module
            .global_variables
            .iter()
            .filter(|(_, variable)| matches!(variable.space, naga::AddressSpace::Storage { .. }))
            .count();
        assert!(storage <= 8, "{name} has {storage} storage buffers");
        for entry in &module.entry_points {
            let threads: u32 = entry.workgroup_size.iter().product();
            assert!(threads <= 256, "{name}: workgroups of {threads}");
        }
    }
}
