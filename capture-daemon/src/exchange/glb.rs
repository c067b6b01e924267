//! Blades → GLB: a mesh each, for any program that reads glTF 2.0.

use std::collections::BTreeMap;

use common::blade::{Blade, Knot};
use glam::{Vec2, Vec3};
use gltf_json::accessor::{Accessor, ComponentType, GenericComponentType, Type};
use gltf_json::buffer::{Buffer, Stride, Target, View};
use gltf_json::material::{Material, PbrBaseColorFactor, PbrMetallicRoughness, StrengthFactor};
use gltf_json::mesh::{Mesh, Mode, Primitive, Semantic};
use gltf_json::scene::{Node, Scene};
use gltf_json::validation::{Checked, USize64};
use gltf_json::{Asset, Index, Root};

/// Between blades, metres.
const GAP_M: f32 = 0.01;
/// Position, normal, texture coordinates.
const VERTEX_BYTES: usize = 32;
/// Half widths below this are a point, metres.
const POINT_M: f32 = 1e-7;

/// A GLB of blades side by side, their roots on the x axis: metres, +y up, +z their front. Each is a node with its
/// name; its texture coordinates run from 0 at the left edge to 1 at the right and from 0 at the root to 1 at the tip.
/// The material is two-sided.
///
/// # Errors
/// When the description cannot be written as JSON.
pub fn write(blades: &[&Blade]) -> Result<Vec<u8>, serde_json::Error> {
    let mut root = Root {
        asset: Asset {
            generator: Some(concat!("Sward ", env!("CARGO_PKG_VERSION")).into()),
            ..Asset::default()
        },
        ..Root::default()
    };
    let mut bytes = Vec::new();
    let buffer = root.push(Buffer {
        byte_length: USize64(0),
        name: None,
        uri: None,
        extensions: None,
        extras: Default::default(),
    });
    let material = root.push(Material {
        name: Some("blade".into()),
        double_sided: true,
        pbr_metallic_roughness: PbrMetallicRoughness {
            base_color_factor: PbrBaseColorFactor([0.15, 0.35, 0.06, 1.0]),
            metallic_factor: StrengthFactor(0.0),
            roughness_factor: StrengthFactor(0.6),
            ..PbrMetallicRoughness::default()
        },
        ..Material::default()
    });
    let mut x_m = 0.0;
    let mut nodes = Vec::new();
    for blade in blades {
        let surface = Surface::of(blade.knots());
        let [low, high] = surface.bounds();
        let primitive = surface.push(&mut root, &mut bytes, buffer, material);
        let name = Some(blade.name().to_owned());
        let mesh = root.push(Mesh {
            name: name.clone(),
            primitives: vec![primitive],
            weights: None,
            extensions: None,
            extras: Default::default(),
        });
        let translation = Some([x_m - low.x, 0.0, 0.0]);
        nodes.push(root.push(Node { name, mesh: Some(mesh), translation, ..Node::default() }));
        x_m += high.x - low.x + GAP_M;
    }
    let scene = Scene { name: None, nodes, extensions: None, extras: Default::default() };
    root.scene = Some(root.push(scene));
    root.buffers[0].byte_length = USize64(bytes.len() as u64);
    if blades.is_empty() {
        // Neither buffers nor scenes are empty.
        root = Root { asset: root.asset, ..Root::default() };
    }
    Ok(container(serde_json::to_vec(&root)?, bytes))
}

/// The two chunks of a GLB.
fn container(mut json: Vec<u8>, mut binary: Vec<u8>) -> Vec<u8> {
    json.resize(json.len().next_multiple_of(4), b' ');
    binary.resize(binary.len().next_multiple_of(4), 0);
    let chunks: &[(&[u8; 4], &[u8])] = &[(b"JSON", &json), (b"BIN\0", &binary)];
    let chunks = &chunks[..if binary.is_empty() { 1 } else { 2 }];
    let total = 12 + chunks.iter().map(|(_, chunk)| 8 + chunk.len()).sum::<usize>();
    let mut file = Vec::with_capacity(total);
    file.extend_from_slice(b"glTF");
    file.extend_from_slice(&2_u32.to_le_bytes());
    file.extend_from_slice(&(total as u32).to_le_bytes());
    for (kind, chunk) in chunks {
        file.extend_from_slice(&(chunk.len() as u32).to_le_bytes());
        file.extend_from_slice(*kind);
        file.extend_from_slice(chunk);
    }
    file
}

#[derive(Clone, Copy)]
struct Vertex {
    position: Vec3,
    normal: Vec3,
    uv: Vec2,
}

/// A blade's surface: both halves beside its midrib.
struct Surface {
    vertices: Vec<Vertex>,
    triangles: Vec<[u32; 3]>,
}

impl Surface {
    fn of(knots: &[Knot]) -> Self {
        let places: Vec<Vec3> = knots.iter().map(|knot| knot.position).collect();
        let lengths = common::geometry::polyline::cumulative_length(&places);
        let whole = lengths[lengths.len() - 1];
        let mut vertices = Vec::with_capacity(3 * knots.len());
        // Of each knot: left edge, midrib, right edge; the same one where it has no width.
        let mut rows: Vec<[u32; 3]> = Vec::with_capacity(knots.len());
        for (k, knot) in knots.iter().enumerate() {
            let along = places[(k + 1).min(knots.len() - 1)] - places[k.saturating_sub(1)];
            let normal = knot.across.cross(along).normalize_or(Vec3::Z);
            let v = lengths[k] / whole;
            let mut push = |position: Vec3, u: f32| {
                vertices.push(Vertex { position, normal, uv: Vec2::new(u, v) });
                vertices.len() as u32 - 1
            };
            let middle =
                push(knot.position, knot.half_width_left.max(POINT_M) / knot.width().max(2.0 * POINT_M));
            let left = if knot.half_width_left > POINT_M { push(knot.left(), 0.0) } else { middle };
            let right = if knot.half_width_right > POINT_M { push(knot.right(), 1.0) } else { middle };
            rows.push([left, middle, right]);
        }
        let mut triangles = Vec::with_capacity(4 * knots.len());
        for pair in rows.windows(2) {
            let ([l0, m0, r0], [l1, m1, r1]) = (pair[0], pair[1]);
            // Counterclockwise seen from the front.
            triangles.extend([[l0, m0, m1], [l0, m1, l1], [m0, r0, r1], [m0, r1, m1]]);
        }
        triangles.retain(|[a, b, c]| a != b && b != c && c != a);
        Self { vertices, triangles }
    }

    fn bounds(&self) -> [Vec3; 2] {
        let places = || self.vertices.iter().map(|vertex| vertex.position);
        [places().reduce(Vec3::min).unwrap_or_default(), places().reduce(Vec3::max).unwrap_or_default()]
    }

    fn push(
        &self,
        root: &mut Root,
        bytes: &mut Vec<u8>,
        buffer: Index<Buffer>,
        material: Index<Material>,
    ) -> Primitive {
        let mut view = |root: &mut Root, data: &[u8], target: Target, stride: Option<usize>| {
            let view = View {
                buffer,
                byte_length: USize64(data.len() as u64),
                byte_offset: Some(USize64(bytes.len() as u64)),
                byte_stride: stride.map(Stride),
                name: None,
                target: Some(Checked::Valid(target)),
                extensions: None,
                extras: Default::default(),
            };
            bytes.extend_from_slice(data);
            root.push(view)
        };
        let floats = |vertex: &Vertex| {
            let Vertex { position: p, normal: n, uv } = vertex;
            [p.x, p.y, p.z, n.x, n.y, n.z, uv.x, uv.y]
        };
        let data: Vec<u8> =
            self.vertices.iter().flat_map(floats).flat_map(|number: f32| number.to_le_bytes()).collect();
        let vertices = view(root, &data, Target::ArrayBuffer, Some(VERTEX_BYTES));
        let data: Vec<u8> = self.triangles.iter().flatten().flat_map(|index| index.to_le_bytes()).collect();
        let indices = view(root, &data, Target::ElementArrayBuffer, None);

        let [low, high] = self.bounds().map(|corner| corner.to_array().to_vec().into());
        let of = |view, offset: u64, type_: Type| Accessor {
            buffer_view: Some(view),
            byte_offset: Some(USize64(offset)),
            count: USize64(self.vertices.len() as u64),
            component_type: Checked::Valid(GenericComponentType(ComponentType::F32)),
            type_: Checked::Valid(type_),
            min: None,
            max: None,
            name: None,
            normalized: false,
            sparse: None,
            extensions: None,
            extras: Default::default(),
        };
        let position = root.push(Accessor { min: Some(low), max: Some(high), ..of(vertices, 0, Type::Vec3) });
        let normal = root.push(of(vertices, 12, Type::Vec3));
        let uv = root.push(of(vertices, 24, Type::Vec2));
        let indices = root.push(Accessor {
            count: USize64(3 * self.triangles.len() as u64),
            component_type: Checked::Valid(GenericComponentType(ComponentType::U32)),
            ..of(indices, 0, Type::Scalar)
        });
        let attributes = BTreeMap::from([
            (Checked::Valid(Semantic::Positions), position),
            (Checked::Valid(Semantic::Normals), normal),
            (Checked::Valid(Semantic::TexCoords(0)), uv),
        ]);
        Primitive {
            attributes,
            indices: Some(indices),
            material: Some(material),
            mode: Checked::Valid(Mode::Triangles),
            targets: None,
            extensions: None,
            extras: Default::default(),
        }
    }
}
