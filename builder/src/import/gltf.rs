//! glTF 2.0 scenes: the primitives of each mesh, and their copies in the scene.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::Path;

use glam::DVec3;
use gltf::json::accessor::Type;
use gltf::json::mesh::{Mode, Primitive, Semantic};
use gltf::json::validation::Checked;

use super::assembly::{Assembly, Part, compact};
use super::error::{ImportError, one_line};
use super::gltf_alpha::cut;
use super::gltf_data::{Accessor, Source, reason};
use super::gltf_material::{Materials, VertexAlpha};
use super::gltf_pose::{Skins, morph, skinned, weights};
use super::gltf_scene::{Instance, instances, node_label, placements};
use crate::mesh::MAX_ELEMENTS;
use crate::mesh::Mesh;

/// Extensions that a file may require although they are ignored: they change neither shape nor base colour.
const HARMLESS: [&str; 6] = [
    "KHR_animation_pointer",
    "KHR_lights_punctual",
    "KHR_materials_variants",
    "KHR_xmp",
    "KHR_xmp_json_ld",
    "EXT_lights_image_based",
];

/// Extensions that are supported, or whose losses are reported where they occur.
const HONOURED: [&str; 12] = [
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "EXT_texture_avif",
    "EXT_texture_webp",
    "KHR_draco_mesh_compression",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_mesh_quantization",
    "KHR_meshopt_compression",
    "KHR_node_visibility",
    "KHR_texture_basisu",
    "KHR_texture_transform",
    "MSFT_texture_dds",
];

/// Whether an extension needs neither a refusal nor a warning for the whole file.
fn is_known(name: &str) -> bool {
    HONOURED.contains(&name) || HARMLESS.contains(&name) || name.starts_with("KHR_materials_")
}

/// Reads a document: see [`instances`] for the parts of it that count.
pub(super) fn load(path: &Path, bytes: Vec<u8>, property_maps: bool) -> Result<Mesh, ImportError> {
    let source = Source::parse(path, &bytes, is_known)?;
    drop(bytes);
    let mut assembly = Assembly::default();
    check_extensions(&source, &mut assembly)?;
    let mut instances = instances(&source, &mut assembly)?;
    // Process all instances of a mesh together: each mesh is decoded once, and only one is in memory at a time.
    instances.sort_by_key(|instance| instance.mesh);
    let mut importer =
        Importer { source: &source, materials: Materials::new(property_maps), skins: Skins::default(), assembly };
    for group in instances.chunk_by(|a, b| a.mesh == b.mesh) {
        let index = group[0].mesh;
        let meshes = &source.root.meshes;
        let mesh = meshes.get(index).ok_or_else(|| source.out_of_range("mesh", index, meshes.len()))?;
        let mesh_name = mesh.name.as_deref().map_or(String::new(), |name| format!(" ({})", one_line(name)));
        for (number, primitive) in mesh.primitives.iter().enumerate() {
            let label = format!("mesh {index}{mesh_name}, primitive {number}");
            if let Some(decoded) = importer.decode(primitive, label)? {
                importer.place(&decoded, group)?;
            }
        }
    }
    Ok(importer.assembly.finish())
}

fn check_extensions(source: &Source<'_>, assembly: &mut Assembly) -> Result<(), ImportError> {
    if let Some(name) = source.root.extensions_required.iter().find(|name| !is_known(name)) {
        let name = one_line(name);
        return Err(ImportError::unsupported(
            source.path,
            format!("the file requires the glTF extension {name}, which is not supported; export it without"),
        ));
    }
    for (name, place) in &source.ignored {
        assembly.warn(format!("{place}: the glTF extension {name} is not supported; it is ignored"));
    }
    Ok(())
}

/// What the parts of a document share while they are read.
struct Importer<'s> {
    source: &'s Source<'s>,
    materials: Materials,
    skins: Skins,
    assembly: Assembly,
}

/// A primitive in the coordinates of its mesh.
struct Decoded<'s> {
    primitive: &'s Primitive,
    label: String,
    part: Part,
    /// The index in the file of each vertex, ascending.
    used: Vec<u32>,
    /// The opacity of each vertex, if it matters.
    alphas: Option<(Vec<f32>, VertexAlpha)>,
}

impl<'s> Importer<'s> {
    /// Adds a primitive to the mesh for each instance in `group`.
    fn place(&mut self, decoded: &Decoded<'_>, group: &[Instance]) -> Result<(), ImportError> {
        let source = self.source;
        let copies = group.iter().fold(0usize, |sum, instance| sum.saturating_add(instance.copies));
        self.assembly.check_room(source.path, &decoded.part, copies)?;
        let mut in_rest: Option<Vec<Part>> = None;
        for instance in group {
            let mut part = Cow::Borrowed(&decoded.part);
            let weights = weights(source, instance);
            if weights.iter().any(|&weight| weight != 0.0) && decoded.primitive.targets.is_some() {
                let mut moved = part.clone().into_owned();
                let (primitive, label, used) = (decoded.primitive, &decoded.label, &decoded.used);
                if morph(source, primitive, label, used, weights, &mut moved, &mut self.assembly) {
                    part = Cow::Owned(moved);
                }
            }
            let mut in_scene = false;
            if let Some(joints) = self.skins.joints(source, instance, &mut self.assembly) {
                match skinned(source, decoded.primitive, &decoded.label, &decoded.used, &part, &joints) {
                    Ok(moved) => (part, in_scene) = (Cow::Owned(moved), true),
                    Err(why) => {
                        let label = instance.node.map_or(String::new(), |node| node_label(source, node));
                        self.assembly.warn(format!(
                            "{}: {why}; in {label} it stays as the node places it, without its skin",
                            decoded.label
                        ));
                    }
                }
                if in_scene && instance.copies != 1 {
                    let label = instance.node.map_or(String::new(), |node| node_label(source, node));
                    self.assembly
                        .warn(format!("{label} has a skin and EXT_mesh_gpu_instancing; its mesh is drawn once"));
                }
            }
            let posed = match part {
                Cow::Owned(part) => Some(self.cut(part, decoded)?),
                Cow::Borrowed(part) => {
                    if in_rest.is_none() {
                        in_rest = Some(self.cut(part.clone(), decoded)?);
                    }
                    None
                }
            };
            let mut parts = posed.as_deref().or(in_rest.as_deref()).unwrap_or_default();
            let hidden: Vec<Part>;
            if instance.hidden {
                // Hidden geometry keeps its place in the bounds, so that voxels stay where they are if it is shown.
                let material = self.materials.invisible(&mut self.assembly);
                let positions = |part: &Part| (part.positions.clone(), part.triangles.clone());
                hidden = (parts.iter().map(positions))
                    .map(|(positions, triangles)| Part { positions, triangles, material, ..Part::default() })
                    .collect();
                parts = &hidden;
            }
            if in_scene {
                parts.iter().try_for_each(|part| self.assembly.append(source.path, part, None))?;
                continue;
            }
            for transform in placements(source, instance)? {
                parts.iter().try_for_each(|part| self.assembly.append(source.path, part, Some(&transform)))?;
            }
        }
        Ok(())
    }

    /// The parts of a primitive in its pose: one for each opacity of its vertices that matters, and one for what is not to be
    /// seen.
    fn cut(&mut self, part: Part, decoded: &Decoded<'_>) -> Result<Vec<Part>, ImportError> {
        let Some((alphas, alpha)) = &decoded.alphas else { return Ok(vec![part]) };
        let material = part.material;
        let found = cut(part, alphas.clone(), alpha.least);
        let mut parts = Vec::new();
        if !found.hidden.triangles.is_empty() {
            parts.push(Part { material: self.materials.invisible(&mut self.assembly), ..found.hidden });
        }
        if !alpha.scales_texture {
            parts.push(found.visible);
        } else {
            // The texture cuts holes, too: one material for each opacity of its triangles.
            let mean = |t: &[u32; 3]| t.iter().map(|&v| found.alphas[v as usize]).sum::<f32>() / 3.0;
            let mut by_opacity: BTreeMap<u8, Vec<[u32; 3]>> = BTreeMap::new();
            for triangle in &found.visible.triangles {
                by_opacity.entry((mean(triangle) * 255.0).round() as u8).or_default().push(*triangle);
            }
            for (opacity, triangles) in by_opacity {
                let material = self.materials.with_opacity(material, opacity, &mut self.assembly);
                parts.push(Part { material, ..found.visible.of_triangles(triangles) });
            }
        }
        parts.retain(|part| !part.triangles.is_empty());
        Ok(parts)
    }

    /// The triangles of a primitive in the coordinates of its mesh. `None`, with a warning, if it has none.
    fn decode(&mut self, primitive: &'s Primitive, label: String) -> Result<Option<Decoded<'s>>, ImportError> {
        let Self { source, materials, assembly, .. } = self;
        let source = *source;
        let Checked::Valid(mode) = primitive.mode else {
            return Err(source.malformed(format!("{label} has an unknown mode")));
        };
        if matches!(mode, Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip) {
            assembly.warn(format!("{label} is made of points or lines; it is skipped"));
            return Ok(None);
        }
        let Some(positions) = primitive.attributes.get(&Checked::Valid(Semantic::Positions)) else {
            assembly.warn(format!("{label} has no positions; it is skipped"));
            return Ok(None);
        };
        source.check_compression(primitive, positions.value(), &label)?;
        let positions = source.accessor(positions.value(), &format!("POSITION of {label}"), &[Type::Vec3])?;
        let attributes = Attributes { source, primitive, label: &label, vertices: positions.len() };
        let normals = attributes.read(Semantic::Normals, "NORMAL", &[Type::Vec3], assembly);
        let colors = attributes.read(Semantic::Colors(0), "COLOR_0", &[Type::Vec3, Type::Vec4], assembly);
        let material = primitive.material.map(|m| m.value());
        let wanted = materials.wanted(source, material, assembly)?;
        let uvs = wanted.and_then(|w| {
            let set = w.coordinates.set;
            let uvs = attributes.read(Semantic::TexCoords(set), &format!("TEXCOORD_{set}"), &[Type::Vec2], assembly);
            if uvs.is_none() {
                let lost = if w.textured { "it gets its plain colour" } else { "its normal map is left out" };
                assembly.warn(format!("{label} has no TEXCOORD_{set} for its texture; {lost}"));
            }
            uvs
        });
        // Tangents are only needed for a normal map, and only valid with the normals of the file.
        let tangents = match &wanted {
            Some(w) if w.normal_map.is_some() && normals.is_some() && uvs.is_some() => {
                attributes.read(Semantic::Tangents, "TANGENT", &[Type::Vec4], assembly)
            }
            _ => None,
        };

        let indices = corner_list(source, primitive, &label, positions.len())?;
        let mut part = Part { triangles: triangles(mode, &indices), ..Part::default() };
        if mode == Mode::Triangles && indices.len() % 3 != 0 {
            assembly.warn(format!("{label} has {} corners left over after its last triangle", indices.len() % 3));
        }
        if part.triangles.is_empty() {
            assembly.warn(format!("{label} has no triangles; it is skipped"));
            return Ok(None);
        }

        // Keep only the vertices that are used: primitives often share one large buffer.
        let used = compact(&mut part.triangles, positions.len());
        part.positions.reserve(used.len());
        for &vertex in &used {
            let [x, y, z, _] = positions.vector(vertex as usize);
            if !(x.is_finite() && y.is_finite() && z.is_finite()) {
                return Err(source.malformed(format!("{label}: vertex {vertex} is not finite; repair or remove it")));
            }
            part.positions.push([x, y, z]);
        }
        let rows = |accessor: &Option<Accessor<'_>>| -> Vec<[f64; 4]> {
            accessor.as_ref().map_or(Vec::new(), |a| used.iter().map(|&v| a.vector(v as usize)).collect())
        };
        part.normals = rows(&normals)
            .into_iter()
            .map(|[x, y, z, _]| DVec3::new(x, y, z).normalize_or_zero().as_vec3().to_array())
            .collect();
        let unit = |x: f64| if x.is_finite() { x.clamp(0.0, 1.0) as f32 } else { 1.0 };
        // The colours of vertices multiply the base colour, not what a material emits.
        if !materials.emits(material) {
            part.colors = rows(&colors).into_iter().map(|[r, g, b, _]| [r, g, b].map(unit)).collect();
        }
        part.tangents = rows(&tangents).into_iter().map(unit_tangent).collect();
        if let Some(c) = wanted.map(|w| w.coordinates) {
            part.uvs = rows(&uvs).into_iter().map(|[u, v, ..]| c.transform.apply([u as f32, v as f32])).collect();
            repair_uvs(&mut part.uvs, &used, &label, assembly);
        }
        let wanted = wanted.filter(|_| uvs.is_some());
        part.material = materials.index(source, material, wanted.as_ref(), assembly)?;
        let alphas: Vec<f32> = match &colors {
            Some(colors) if colors.components() == 4 => {
                rows(&Some(colors.clone())).iter().map(|c| unit(c[3])).collect()
            }
            _ => Vec::new(),
        };
        let lowest = alphas.iter().copied().reduce(f32::min);
        let alpha = lowest.and_then(|lowest| materials.vertex_alpha(source, material, part.material, lowest, assembly));
        if let Some(alpha) = alpha.as_ref().filter(|alpha| alpha.scales_texture)
            && alphas.iter().any(|&alpha| alpha != alphas[0])
        {
            assembly.warn(format!(
                "{label}: the opacity of its vertices varies over a texture with holes (cutoff {}); the mean of each \
                 triangle is used",
                alpha.cutoff
            ));
        }
        let alphas = alpha.map(|alpha| (alphas, alpha));
        Ok(Some(Decoded { primitive, label, part, used, alphas }))
    }
}

/// The attributes of a primitive other than its positions.
struct Attributes<'a> {
    source: &'a Source<'a>,
    primitive: &'a Primitive,
    label: &'a str,
    vertices: usize,
}

impl<'a> Attributes<'a> {
    /// An attribute. `None` if there is none, or, with a warning, if it cannot be read: the rest of the primitive can.
    fn read(&self, semantic: Semantic, name: &str, types: &[Type], assembly: &mut Assembly) -> Option<Accessor<'a>> {
        let index = self.primitive.attributes.get(&Checked::Valid(semantic))?.value();
        let why = match self.source.accessor(index, &format!("{name} of {}", self.label), types) {
            Ok(accessor) if accessor.len() >= self.vertices => return Some(accessor),
            Ok(accessor) => format!("it has {} values for {} vertices", accessor.len(), self.vertices),
            Err(e) => reason(e),
        };
        assembly.warn(format!("{}: {name} is left out: {why}", self.label));
        None
    }
}

/// Replaces texture coordinates that are not finite by 0, 0, with a warning.
fn repair_uvs(uvs: &mut [[f32; 2]], used: &[u32], label: &str, assembly: &mut Assembly) {
    let mut bad = 0;
    let mut first = 0;
    for (uv, &vertex) in uvs.iter_mut().zip(used) {
        if !uv.iter().all(|x| x.is_finite()) {
            *uv = [0.0; 2];
            first = if bad == 0 { vertex } else { first };
            bad += 1;
        }
    }
    if bad > 0 {
        assembly.warn(format!(
            "{label}: the texture coordinates of {bad} of its vertices (the first is vertex {first}) are not finite; 0, 0 is \
             used"
        ));
    }
}

/// A unit tangent with its handedness; zero (no tangent) if the file gives one without length.
fn unit_tangent([x, y, z, w]: [f64; 4]) -> [f32; 4] {
    let t = DVec3::new(x, y, z).normalize_or_zero().as_vec3();
    if t == glam::Vec3::ZERO { [0.0; 4] } else { [t.x, t.y, t.z, if w < 0.0 { -1.0 } else { 1.0 }] }
}

/// The vertices of a primitive in drawing order, all below `vertices`.
fn corner_list(
    source: &Source<'_>,
    primitive: &Primitive,
    label: &str,
    vertices: usize,
) -> Result<Vec<u32>, ImportError> {
    let too_large = |count: usize| ImportError::TooLarge {
        path: source.path.into(),
        what: format!("{label} has {count} corners"),
        limit: 3 * MAX_ELEMENTS as u64,
    };
    let Some(indices) = primitive.indices else {
        let end = u32::try_from(vertices).ok().filter(|_| vertices <= 3 * MAX_ELEMENTS);
        return Ok((0..end.ok_or_else(|| too_large(vertices))?).collect());
    };
    let indices = source.accessor(indices.value(), &format!("indices of {label}"), &[Type::Scalar])?;
    if indices.is_float() {
        return Err(source.malformed(format!("the indices of {label} are not integers")));
    }
    if indices.len() > 3 * MAX_ELEMENTS {
        return Err(too_large(indices.len()));
    }
    let mut list = Vec::with_capacity(indices.len());
    for i in 0..indices.len() {
        let vertex = indices.index(i);
        if vertex as usize >= vertices {
            return Err(source.malformed(format!("{label}: index {i} refers to vertex {vertex} of {vertices}")));
        }
        list.push(vertex);
    }
    Ok(list)
}

fn triangles(mode: Mode, corners: &[u32]) -> Vec<[u32; 3]> {
    let distinct = |&[a, b, c]: &[u32; 3]| a != b && b != c && c != a;
    match mode {
        // Every second triangle of a strip has the opposite winding. Repeated vertices only join strips.
        Mode::TriangleStrip => corners
            .windows(3)
            .enumerate()
            .map(|(i, w)| if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[1], w[0], w[2]] })
            .filter(distinct)
            .collect(),
        Mode::TriangleFan => match corners {
            [hub, rim @ ..] => rim.windows(2).map(|w| [w[0], w[1], *hub]).filter(distinct).collect(),
            [] => Vec::new(),
        },
        _ => corners.as_chunks::<3>().0.to_vec(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_and_fans_keep_their_winding() {
        assert_eq!(triangles(Mode::TriangleStrip, &[0, 1, 2, 3, 3, 4]), [[0, 1, 2], [2, 1, 3]]);
        assert_eq!(triangles(Mode::TriangleFan, &[9, 1, 2, 3]), [[1, 2, 9], [2, 3, 9]]);
        assert_eq!(triangles(Mode::Triangles, &[0, 1, 2, 3, 4]), [[0, 1, 2]]);
    }
}
