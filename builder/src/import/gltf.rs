//! glTF 2.0 scenes: nodes, instances and primitives.

use std::path::Path;

use glam::{DMat4, DQuat, DVec3, DVec4};
use gltf::json;
use gltf::json::accessor::Type;
use gltf::json::mesh::{Mode, Primitive, Semantic};
use gltf::json::validation::Checked;

use super::assembly::{Assembly, Part};
use super::error::{ImportError, one_line};
use super::gltf_data::{Accessor, Source};
use super::gltf_material::Materials;
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

/// Extensions that are supported.
const HONOURED: [&str; 3] = ["KHR_materials_pbrSpecularGlossiness", "KHR_mesh_quantization", "KHR_texture_transform"];

/// Reads the default scene; without a default, all scenes; without scenes, all nodes; without nodes, all meshes with no
/// transform.
pub(super) fn load(path: &Path, bytes: Vec<u8>) -> Result<Mesh, ImportError> {
    let source = Source::parse(path, &bytes)?;
    drop(bytes);
    let mut assembly = Assembly::default();
    check_extensions(&source, &mut assembly)?;
    let mut instances = instances(&source, &mut assembly)?;
    // Process all instances of a mesh together: each mesh is decoded once, and only one is in memory at a time.
    instances.sort_by_key(|&(mesh, _)| mesh);
    let mut materials = Materials::default();
    for group in instances.chunk_by(|a, b| a.0 == b.0) {
        let index = group[0].0;
        let meshes = &source.root.meshes;
        let mesh = meshes.get(index).ok_or_else(|| source.out_of_range("mesh", index, meshes.len()))?;
        let mesh_name = mesh.name.as_deref().map_or(String::new(), |name| format!(" ({})", one_line(name)));
        for (number, primitive) in mesh.primitives.iter().enumerate() {
            let label = format!("mesh {index}{mesh_name}, primitive {number}");
            let Some(part) = decode(&source, primitive, &label, &mut materials, &mut assembly)? else { continue };
            assembly.check_room(path, &part, group.len())?;
            for (_, transform) in group {
                assembly.append(path, &part, Some(transform))?;
            }
        }
    }
    Ok(assembly.finish())
}

fn check_extensions(source: &Source<'_>, assembly: &mut Assembly) -> Result<(), ImportError> {
    let known = |name: &str| HONOURED.contains(&name) || HARMLESS.contains(&name) || name.starts_with("KHR_materials_");
    if let Some(name) = source.root.extensions_required.iter().find(|name| !known(name)) {
        let name = one_line(name);
        return Err(ImportError::unsupported(
            source.path,
            format!("the file requires the glTF extension {name}, which is not supported; export it without"),
        ));
    }
    for name in source.root.extensions_used.iter().filter(|name| !known(name)) {
        assembly.warn(format!("the optional glTF extension {} is not supported; it is ignored", one_line(name)));
    }
    Ok(())
}

/// All uses of meshes in the scene: index of the mesh, and transform into the scene.
fn instances(source: &Source<'_>, assembly: &mut Assembly) -> Result<Vec<(usize, DMat4)>, ImportError> {
    let root = &source.root;
    let nodes = &root.nodes;
    let mut starts: Vec<usize> = match root.scene {
        Some(scene) => {
            let index = scene.value();
            let scene = root.scenes.get(index).ok_or_else(|| source.out_of_range("scene", index, root.scenes.len()))?;
            scene.nodes.iter().map(|n| n.value()).collect()
        }
        None if !root.scenes.is_empty() => {
            // A node may be the root of several scenes, but it is read only once.
            let mut starts: Vec<usize> = root.scenes.iter().flat_map(|s| &s.nodes).map(|n| n.value()).collect();
            starts.sort_unstable();
            starts.dedup();
            starts
        }
        None => {
            let mut is_child = vec![false; nodes.len()];
            for child in nodes.iter().filter_map(|n| n.children.as_ref()).flatten() {
                if let Some(flag) = is_child.get_mut(child.value()) {
                    *flag = true;
                }
            }
            (0..nodes.len()).filter(|&i| !is_child[i]).collect()
        }
    };
    if nodes.is_empty() && starts.is_empty() && !root.meshes.is_empty() {
        assembly.warn("the file has no nodes; its meshes are read without a transform");
        return Ok((0..root.meshes.len()).map(|mesh| (mesh, DMat4::IDENTITY)).collect());
    }
    // Reversed, because the last node on the stack is processed first.
    starts.reverse();
    let mut stack: Vec<(usize, DMat4)> = starts.into_iter().map(|i| (i, DMat4::IDENTITY)).collect();
    let mut reached = vec![false; nodes.len()];
    let mut instances = Vec::new();
    while let Some((index, parent)) = stack.pop() {
        let node = nodes.get(index).ok_or_else(|| source.out_of_range("node", index, nodes.len()))?;
        // Reaching a node twice means a cycle, or a graph whose copies could grow without bound.
        if std::mem::replace(&mut reached[index], true) {
            return Err(source.malformed(format!("node {index} has more than one parent, or is its own ancestor")));
        }
        let transform = parent * local_transform(node);
        if let Some(mesh) = node.mesh {
            instances.push((mesh.value(), transform));
        }
        if node.skin.is_some() {
            assembly.warn("skins are not applied: the mesh is in its rest pose");
        }
        stack.extend(node.children.iter().flatten().rev().map(|child| (child.value(), transform)));
    }
    Ok(instances)
}

fn local_transform(node: &json::Node) -> DMat4 {
    if let Some(columns) = &node.matrix {
        return DMat4::from_cols_array(&columns.map(f64::from));
    }
    let vector = |v: Option<[f32; 3]>, default: f64| v.map_or(DVec3::splat(default), |v| DVec3::from(v.map(f64::from)));
    let rotation = node.rotation.map_or(DQuat::IDENTITY, |q| {
        let v = DVec4::from(q.0.map(f64::from)).normalize_or(DVec4::W);
        DQuat::from_vec4(v)
    });
    DMat4::from_scale_rotation_translation(vector(node.scale, 1.0), rotation, vector(node.translation, 0.0))
}

/// The triangles of a primitive in the coordinates of its mesh. `None`, with a warning, if it has none.
fn decode(
    source: &Source<'_>,
    primitive: &Primitive,
    label: &str,
    materials: &mut Materials,
    assembly: &mut Assembly,
) -> Result<Option<Part>, ImportError> {
    let attribute = |semantic: Semantic| primitive.attributes.get(&Checked::Valid(semantic)).map(|a| a.value());
    let Checked::Valid(mode) = primitive.mode else {
        return Err(source.malformed(format!("{label} has an unknown mode")));
    };
    if matches!(mode, Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip) {
        assembly.warn(format!("{label} is made of points or lines; it is skipped"));
        return Ok(None);
    }
    let Some(positions) = attribute(Semantic::Positions) else {
        assembly.warn(format!("{label} has no positions; it is skipped"));
        return Ok(None);
    };
    if primitive.targets.as_ref().is_some_and(|t| !t.is_empty()) {
        assembly.warn("morph targets are not applied: the mesh is in its rest pose");
    }
    let what = |name: &str| format!("{name} of {label}");
    let positions = source.accessor(positions, &what("POSITION"), &[Type::Vec3])?;
    let optional = |semantic: Semantic, name: &str, types: &[Type]| -> Result<Option<Accessor<'_>>, ImportError> {
        let Some(index) = attribute(semantic) else { return Ok(None) };
        let accessor = source.accessor(index, &what(name), types)?;
        if accessor.len() < positions.len() {
            let (have, need) = (accessor.len(), positions.len());
            return Err(source.malformed(format!("{} has {have} values for {need} vertices", what(name))));
        }
        Ok(Some(accessor))
    };
    let normals = optional(Semantic::Normals, "NORMAL", &[Type::Vec3])?;
    let colors = optional(Semantic::Colors(0), "COLOR_0", &[Type::Vec3, Type::Vec4])?;
    let material = primitive.material.map(|m| m.value());
    let wanted = Materials::wanted(source, material, assembly)?;
    let uvs = match wanted.map(|w| w.coordinates.set) {
        Some(set) => optional(Semantic::TexCoords(set), &format!("TEXCOORD_{set}"), &[Type::Vec2])?,
        None => None,
    };
    if let (Some(w), None) = (&wanted, &uvs) {
        let (set, lost) = (w.coordinates.set, if w.textured { "it gets its plain colour" } else { "it is left out" });
        assembly.warn(format!("{label} has no TEXCOORD_{set} for its texture; {lost}"));
    }
    // Tangents are only needed for a normal map, and only valid with the normals of the file.
    let tangents = match &wanted {
        Some(w) if w.normal_map.is_some() && normals.is_some() && uvs.is_some() => {
            optional(Semantic::Tangents, "TANGENT", &[Type::Vec4])?
        }
        _ => None,
    };

    let indices = corner_list(source, primitive, label, positions.len())?;
    let mut part = Part { triangles: triangles(mode, &indices), ..Part::default() };
    if mode == Mode::Triangles && indices.len() % 3 != 0 {
        assembly.warn(format!("{label} has {} corners left over after its last triangle", indices.len() % 3));
    }
    if part.triangles.is_empty() {
        assembly.warn(format!("{label} has no triangles; it is skipped"));
        return Ok(None);
    }

    // Keep only the vertices that are used: primitives often share one large buffer.
    let mut used: Vec<u32> = part.triangles.as_flattened().to_vec();
    used.sort_unstable();
    used.dedup();
    if used.len() < positions.len() {
        for corner in part.triangles.as_flattened_mut() {
            // Always found: `used` contains every corner.
            *corner = used.partition_point(|&v| v < *corner) as u32;
        }
    }
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
    part.colors = rows(&colors).into_iter().map(|[r, g, b, _]| [r, g, b].map(unit)).collect();
    part.tangents = rows(&tangents).into_iter().map(unit_tangent).collect();
    if let Some(c) = wanted.map(|w| w.coordinates) {
        part.uvs = rows(&uvs).into_iter().map(|[u, v, ..]| c.transform.apply([u as f32, v as f32])).collect();
        if let Some(i) = part.uvs.iter().position(|uv| !uv.iter().all(|x| x.is_finite())) {
            let vertex = used[i];
            return Err(source.malformed(format!("{label}: the texture coordinates of vertex {vertex} are not finite")));
        }
        if !c.repeats && part.uvs.as_flattened().iter().any(|x| !(-1e-3..=1.001).contains(x)) {
            assembly.warn(format!(
                "{label}: texture coordinates outside 0 to 1 repeat the image; the file asks for another wrapping mode"
            ));
        }
    }
    let wanted = wanted.filter(|_| uvs.is_some());
    part.material = materials.index(source, material, wanted.as_ref(), assembly)?;
    Ok(Some(part))
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
