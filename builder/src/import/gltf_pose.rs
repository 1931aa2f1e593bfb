//! The pose of a glTF mesh: morph targets with their default weights, and skins with their joints as the nodes place them.
//!
//! Animations are not read: the pose is the one that the document itself describes.

use std::collections::HashMap;
use std::rc::Rc;

use glam::{DMat3, DMat4, DVec3};
use gltf::json::accessor::Type;
use gltf::json::mesh::{Primitive, Semantic};
use gltf::json::validation::Checked;

use super::assembly::{Assembly, Part};
use super::gltf_data::{Accessor, Source, reason};
use super::gltf_scene::{Instance, local_transform, node_label};
use crate::mesh::transform::{normal_matrix, transform_normal, transform_tangent};

/// The weights of the morph targets in an instance: those of its node, otherwise those of the mesh.
pub(super) fn weights<'a>(source: &'a Source<'_>, instance: &Instance) -> &'a [f32] {
    let node = instance.node.and_then(|index| source.root.nodes.get(index));
    let mesh = source.root.meshes.get(instance.mesh);
    let given = node.and_then(|node| node.weights.as_deref()).or_else(|| mesh.and_then(|mesh| mesh.weights.as_deref()));
    given.unwrap_or(&[])
}

/// Moves the vertices of a primitive by its morph targets. `used` holds the index in the file of each vertex. Returns
/// whether anything moved.
pub(super) fn morph(
    source: &Source<'_>,
    primitive: &Primitive,
    label: &str,
    used: &[u32],
    weights: &[f32],
    part: &mut Part,
    assembly: &mut Assembly,
) -> bool {
    let mut moved = false;
    for (number, (target, &weight)) in primitive.targets.iter().flatten().zip(weights).enumerate() {
        if weight == 0.0 {
            continue;
        }
        if !weight.is_finite() {
            assembly
                .warn(format!("{label}: the weight of morph target {number} is not finite; the target is left out"));
            continue;
        }
        let mut read = |index: Option<usize>, name: &str| {
            let what = format!("{name} of morph target {number} of {label}");
            let accessor = match source.accessor(index?, &what, &[Type::Vec3]) {
                Ok(accessor) => accessor,
                Err(e) => {
                    assembly.warn(format!("{label}: {name} of morph target {number} is left out: {}", reason(e)));
                    return None;
                }
            };
            let needed = used.last().map_or(0, |&last| last as usize + 1);
            if accessor.len() < needed {
                let have = accessor.len();
                assembly.warn(format!(
                    "{label}: {name} of morph target {number} is left out: it has {have} values for {needed} vertices"
                ));
                return None;
            }
            Some(accessor)
        };
        let positions = read(target.positions.as_ref().map(|i| i.value()), "POSITION");
        let normals = read(target.normals.as_ref().map(|i| i.value()), "NORMAL");
        let tangents = read(target.tangents.as_ref().map(|i| i.value()), "TANGENT");
        let weight = f64::from(weight);
        let offset = |accessor: &Accessor<'_>, vertex: u32| {
            let [x, y, z, _] = accessor.vector(vertex as usize);
            DVec3::new(x, y, z) * weight
        };
        if let Some(positions) = positions {
            for (p, &vertex) in part.positions.iter_mut().zip(used) {
                *p = (DVec3::from(*p) + offset(&positions, vertex)).to_array();
            }
            moved = true;
        }
        // Unit length is restored after the last target.
        if let Some(normals) = normals {
            for (n, &vertex) in part.normals.iter_mut().zip(used) {
                *n = (DVec3::from(n.map(f64::from)) + offset(&normals, vertex)).as_vec3().to_array();
            }
            moved = true;
        }
        if let Some(tangents) = tangents {
            for ([x, y, z, _], &vertex) in part.tangents.iter_mut().zip(used) {
                let t = DVec3::new(f64::from(*x), f64::from(*y), f64::from(*z)) + offset(&tangents, vertex);
                [*x, *y, *z] = t.as_vec3().to_array();
            }
            moved = true;
        }
    }
    if moved {
        for n in &mut part.normals {
            *n = DVec3::from(n.map(f64::from)).normalize_or_zero().as_vec3().to_array();
        }
        for t in &mut part.tangents {
            let unit = DVec3::new(f64::from(t[0]), f64::from(t[1]), f64::from(t[2])).normalize_or_zero().as_vec3();
            *t = if unit == glam::Vec3::ZERO { [0.0; 4] } else { [unit.x, unit.y, unit.z, t[3]] };
        }
    }
    moved
}

/// The joints of all skins in use.
#[derive(Default)]
pub(super) struct Skins {
    /// For each skin the transform of each joint, or `None` if the skin cannot be read.
    joints: HashMap<usize, Option<Rc<[DMat4]>>>,
    /// Transforms of nodes into the scene.
    placed: HashMap<usize, DMat4>,
    parents: Option<Vec<Option<usize>>>,
}

impl Skins {
    /// For each joint of the skin of an instance: from the mesh in its bind pose into the scene. `None` if the node has no
    /// skin, or, with a warning, one that cannot be read.
    pub(super) fn joints(
        &mut self,
        source: &Source<'_>,
        instance: &Instance,
        assembly: &mut Assembly,
    ) -> Option<Rc<[DMat4]>> {
        let index = instance.node?;
        let skin = source.root.nodes.get(index)?.skin?.value();
        if !self.joints.contains_key(&skin) {
            let read = self.read(source, skin);
            let joints = match read {
                Ok(joints) => Some(joints),
                Err(why) => {
                    let label = node_label(source, index);
                    assembly.warn(format!("{label}: {why}; its mesh stays as the node places it"));
                    None
                }
            };
            self.joints.insert(skin, joints);
        }
        self.joints.get(&skin).cloned().flatten()
    }

    fn read(&mut self, source: &Source<'_>, index: usize) -> Result<Rc<[DMat4]>, String> {
        let skins = &source.root.skins;
        let skin = skins.get(index).ok_or_else(|| format!("skin {index} cannot be read or does not exist"))?;
        let inverse = match &skin.inverse_bind_matrices {
            Some(accessor) => {
                let what = format!("inverse bind matrices of skin {index}");
                let accessor = source.accessor(accessor.value(), &what, &[Type::Mat4]).map_err(reason)?;
                let (have, need) = (accessor.len(), skin.joints.len());
                if have < need {
                    return Err(format!("skin {index} has {have} inverse bind matrices for {need} joints"));
                }
                if !accessor.is_float() {
                    return Err(format!("the inverse bind matrices of skin {index} are not floating-point numbers"));
                }
                Some(accessor)
            }
            None => None,
        };
        let mut joints = Vec::with_capacity(skin.joints.len());
        for (number, joint) in skin.joints.iter().enumerate() {
            let placed = self.placed(source, joint.value());
            let placed =
                placed.ok_or_else(|| format!("joint {number} of skin {index} is not a node of the scene graph"))?;
            joints
                .push(placed * inverse.as_ref().map_or(DMat4::IDENTITY, |a| DMat4::from_cols_array(&a.matrix(number))));
        }
        Ok(joints.into())
    }

    /// The transform of a node into the scene. `None` if there is no such node, or if it is its own ancestor.
    fn placed(&mut self, source: &Source<'_>, index: usize) -> Option<DMat4> {
        let nodes = &source.root.nodes;
        let parents = self.parents.get_or_insert_with(|| {
            let mut parents = vec![None; nodes.len()];
            for (parent, node) in nodes.iter().enumerate() {
                for child in node.children.iter().flatten() {
                    if let Some(entry) = parents.get_mut(child.value()) {
                        *entry = Some(parent);
                    }
                }
            }
            parents
        });
        let mut chain = Vec::new();
        let mut at = Some(index);
        let mut transform = DMat4::IDENTITY;
        while let Some(node) = at {
            if let Some(known) = self.placed.get(&node) {
                transform = *known;
                break;
            }
            if chain.len() > nodes.len() {
                return None;
            }
            chain.push(node);
            at = *parents.get(node)?;
        }
        for &node in chain.iter().rev() {
            transform *= local_transform(&nodes[node]);
            self.placed.insert(node, transform);
        }
        Some(transform)
    }
}

/// `part` moved by the joints of its skin into the scene. `Err` says why that is not possible.
pub(super) fn skinned(
    source: &Source<'_>,
    primitive: &Primitive,
    label: &str,
    used: &[u32],
    part: &Part,
    joints: &[DMat4],
) -> Result<Part, String> {
    let attribute = |semantic: Semantic| primitive.attributes.get(&Checked::Valid(semantic)).map(|a| a.value());
    let mut sets = Vec::new();
    for set in 0.. {
        let (Some(j), Some(w)) = (attribute(Semantic::Joints(set)), attribute(Semantic::Weights(set))) else { break };
        let read = |index, name: &str| {
            let accessor =
                source.accessor(index, &format!("{name}_{set} of {label}"), &[Type::Vec4]).map_err(reason)?;
            let (have, need) = (accessor.len(), used.last().map_or(0, |&last| last as usize + 1));
            if have < need {
                return Err(format!("{name}_{set} has {have} values for {need} vertices"));
            }
            Ok(accessor)
        };
        sets.push((read(j, "JOINTS")?, read(w, "WEIGHTS")?));
    }
    if sets.is_empty() {
        return Err("it has no JOINTS_0 and WEIGHTS_0 for the skin".into());
    }
    let mut matrices = Vec::with_capacity(used.len());
    for &vertex in used {
        matrices.push(blended(&sets, vertex, joints).ok_or_else(|| {
            format!("vertex {vertex} refers to a joint that the skin does not have; it has {}", joints.len())
        })?);
    }
    let mut moved = Part {
        uvs: part.uvs.clone(),
        colors: part.colors.clone(),
        triangles: part.triangles.clone(),
        material: part.material,
        ..Part::default()
    };
    let place = |(p, m): (&[f64; 3], &DMat4)| m.transform_point3(DVec3::from(*p)).to_array();
    moved.positions = part.positions.iter().zip(&matrices).map(place).collect();
    let turn = |(n, m): (&[f32; 3], &DMat4)| transform_normal(&normal_matrix(m), *n);
    moved.normals = part.normals.iter().zip(&matrices).map(turn).collect();
    moved.tangents = part.tangents.iter().zip(&matrices).map(|(t, m)| transform_tangent(m, *t)).collect();
    // A matrix that mirrors turns the winding.
    for t in &mut moved.triangles {
        if matrices.get(t[0] as usize).is_some_and(|m| DMat3::from_mat4(*m).determinant() < 0.0) {
            t.swap(1, 2);
        }
    }
    Ok(moved)
}

/// The mean of the joints of a vertex by its weights. A vertex without weights follows its first joint. `None` if a joint
/// does not exist.
fn blended(sets: &[(Accessor<'_>, Accessor<'_>)], vertex: u32, joints: &[DMat4]) -> Option<DMat4> {
    let mut sum = DMat4::ZERO;
    let mut total = 0.0;
    for (indices, weights) in sets {
        let (indices, weights) = (indices.vector(vertex as usize), weights.vector(vertex as usize));
        for (index, weight) in indices.into_iter().zip(weights) {
            if weight > 0.0 && weight.is_finite() {
                sum += *joints.get(index as usize)? * weight;
                total += weight;
            }
        }
    }
    if total > 0.0 {
        Some(sum * (1.0 / total))
    } else {
        joints.get(sets[0].0.vector(vertex as usize)[0] as usize).copied()
    }
}
