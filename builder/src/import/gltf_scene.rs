//! The scene of a glTF file: which meshes its nodes draw, where, and how often.

use glam::{DMat4, DQuat, DVec3, DVec4};
use gltf::json;
use gltf::json::accessor::Type;

use super::assembly::Assembly;
use super::error::{ImportError, one_line};
use super::gltf_data::{Accessor, Source};

/// A use of a mesh by a node.
#[derive(Clone, Copy, Debug)]
pub(super) struct Instance {
    pub(super) mesh: usize,
    /// The node; `None` if the file has no nodes.
    pub(super) node: Option<usize>,
    /// From the mesh into the scene. Does not apply to a mesh with a skin.
    pub(super) transform: DMat4,
    /// Whether `KHR_node_visibility` hides the node or an ancestor of it.
    pub(super) hidden: bool,
    /// Copies of the mesh: 1, or what `EXT_mesh_gpu_instancing` says.
    pub(super) copies: usize,
}

/// `node 3 (lamp)`.
pub(super) fn node_label(source: &Source<'_>, index: usize) -> String {
    let name = source.root.nodes.get(index).and_then(|node| node.name.as_deref());
    name.map_or_else(|| format!("node {index}"), |name| format!("node {index} ({})", one_line(name)))
}

/// All uses of meshes in the scene: the default scene; without a default, all scenes; without scenes, all nodes; without
/// nodes, all meshes with no transform.
pub(super) fn instances(source: &Source<'_>, assembly: &mut Assembly) -> Result<Vec<Instance>, ImportError> {
    let root = &source.root;
    let nodes = &root.nodes;
    let mut starts = start_nodes(source)?;
    if nodes.is_empty() && starts.is_empty() && !root.meshes.is_empty() {
        assembly.warn("the file has no nodes; its meshes are read without a transform");
        let bare = |mesh| Instance { mesh, node: None, transform: DMat4::IDENTITY, hidden: false, copies: 1 };
        return Ok((0..root.meshes.len()).map(bare).collect());
    }
    // Reversed, because the last node on the stack is processed first.
    starts.reverse();
    let mut stack: Vec<(usize, DMat4, bool)> = starts.into_iter().map(|i| (i, DMat4::IDENTITY, false)).collect();
    let mut reached = vec![false; nodes.len()];
    let mut instances = Vec::new();
    while let Some((index, parent, hidden)) = stack.pop() {
        let node = nodes.get(index).ok_or_else(|| source.out_of_range("node", index, nodes.len()))?;
        // Reaching a node twice means a cycle, or a graph whose copies could grow without bound.
        if std::mem::replace(&mut reached[index], true) {
            return Err(source.malformed(format!("node {index} has more than one parent, or is its own ancestor")));
        }
        let transform = parent * local_transform(node);
        let hidden = hidden || is_hidden(node);
        if let Some(mesh) = node.mesh {
            let copies = copies(source, index, node)?;
            if hidden {
                let label = node_label(source, index);
                assembly.warn(format!("{label} is hidden by KHR_node_visibility; its mesh is left out"));
            }
            instances.push(Instance { mesh: mesh.value(), node: Some(index), transform, hidden, copies });
        }
        stack.extend(node.children.iter().flatten().rev().map(|child| (child.value(), transform, hidden)));
    }
    if !instances.is_empty() && instances.iter().all(|instance| instance.hidden) {
        let what = "KHR_node_visibility hides every node that has a mesh; make one visible";
        return Err(ImportError::unsupported(source.path, what));
    }
    Ok(instances)
}

/// The nodes at the top of the scene.
fn start_nodes(source: &Source<'_>) -> Result<Vec<usize>, ImportError> {
    let root = &source.root;
    let nodes = &root.nodes;
    Ok(match root.scene {
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
    })
}

/// The transform of a node relative to its parent.
pub(super) fn local_transform(node: &json::Node) -> DMat4 {
    if let Some(columns) = &node.matrix {
        return DMat4::from_cols_array(&columns.map(f64::from));
    }
    let vector = |v: Option<[f32; 3]>, default: f64| v.map_or(DVec3::splat(default), |v| DVec3::from(v.map(f64::from)));
    let rotation = node.rotation.map_or(DQuat::IDENTITY, |q| rotation(q.0.map(f64::from)));
    DMat4::from_scale_rotation_translation(vector(node.scale, 1.0), rotation, vector(node.translation, 0.0))
}

/// A quaternion as written, brought to unit length; the identity if it has none.
fn rotation(xyzw: [f64; 4]) -> DQuat {
    DQuat::from_vec4(DVec4::from(xyzw).normalize_or(DVec4::W))
}

/// The value of an extension of a node.
fn extension<'a>(node: &'a json::Node, name: &str) -> Option<&'a json::Value> {
    node.extensions.as_ref()?.others.get(name)
}

/// Whether `KHR_node_visibility` hides a node and its descendants.
fn is_hidden(node: &json::Node) -> bool {
    let visible = extension(node, "KHR_node_visibility").and_then(|value| value.get("visible"));
    visible.and_then(json::Value::as_bool) == Some(false)
}

const INSTANCING: &str = "EXT_mesh_gpu_instancing";
/// The attributes of the extension that place copies, with their types.
const PLACING: [(&str, Type); 3] = [("TRANSLATION", Type::Vec3), ("ROTATION", Type::Vec4), ("SCALE", Type::Vec3)];

/// The accessor of an attribute of the extension, if the node has it.
fn instancing_accessor(node: &json::Node, attribute: &str) -> Option<usize> {
    let index = extension(node, INSTANCING)?.get("attributes")?.get(attribute)?.as_u64()?;
    Some(usize::try_from(index).unwrap_or(usize::MAX))
}

/// How many copies of its mesh a node draws. Other attributes than those that place copies are for shaders.
fn copies(source: &Source<'_>, index: usize, node: &json::Node) -> Result<usize, ImportError> {
    let mut first: Option<(&str, u64)> = None;
    for (name, _) in PLACING {
        let Some(accessor) = instancing_accessor(node, name) else { continue };
        let accessors = &source.root.accessors;
        let found =
            accessors.get(accessor).ok_or_else(|| source.out_of_range("accessor", accessor, accessors.len()))?;
        let count = found.count.0;
        let (other, expected) = *first.get_or_insert((name, count));
        if count != expected {
            let label = node_label(source, index);
            return Err(source.malformed(format!(
                "{label}: {INSTANCING} has {expected} values of {other}, but {count} of {name}; expected the same number"
            )));
        }
    }
    Ok(first.map_or(1, |(_, count)| usize::try_from(count).unwrap_or(usize::MAX)))
}

/// The transforms of all copies that a node draws. The accessors are checked before the first: their counts are within the
/// limits of [`Source::accessor`].
pub(super) fn placements(source: &Source<'_>, instance: &Instance) -> Result<impl Iterator<Item = DMat4>, ImportError> {
    let node = instance.node.and_then(|index| Some((index, source.root.nodes.get(index)?)));
    let node = node.filter(|(_, node)| extension(node, INSTANCING).is_some());
    let read = |(name, kind): (&str, Type)| -> Result<Option<Accessor<'_>>, ImportError> {
        let Some((index, node)) = node else { return Ok(None) };
        let Some(accessor) = instancing_accessor(node, name) else { return Ok(None) };
        source.accessor(accessor, &format!("{name} of {}", node_label(source, index)), &[kind]).map(Some)
    };
    let [translations, rotations, scales] = PLACING;
    let (translations, rotations, scales) = (read(translations)?, read(rotations)?, read(scales)?);
    let is_placed = node.is_some();
    let transform = instance.transform;
    let vector = |accessor: &Option<Accessor<'_>>, i: usize, default: f64| {
        accessor.as_ref().map_or(DVec3::splat(default), |a| DVec4::from(a.vector(i)).truncate())
    };
    let placed = move |i: usize| {
        if !is_placed {
            return transform;
        }
        let turned = rotations.as_ref().map_or(DQuat::IDENTITY, |a| rotation(a.vector(i)));
        let local =
            DMat4::from_scale_rotation_translation(vector(&scales, i, 1.0), turned, vector(&translations, i, 0.0));
        transform * local
    };
    Ok((0..instance.copies).map(placed))
}
