//! Colour, normal and ambient occlusion of hit voxels.

use esvo_format::Octree;
use glam::{DMat3, DMat4, DVec3, Vec3};

use crate::hit::Hit;
use crate::object::Object;
use crate::ray::Ray;

/// Colour of voxels without a colour, sRGB-encoded.
pub const PLAIN_COLOR: [f32; 3] = [0.75, 0.75, 0.75];

/// The normal, reversed if it points along the direction of view.
pub(crate) fn facing(normal: DVec3, direction: DVec3) -> DVec3 {
    if normal.dot(direction) > 0.0 { -normal } else { normal }
}

/// Unit normal of a hit voxel in mesh space, facing the ray: of its attachment, else of its contour, else of the face of the
/// cube by which the ray entered.
///
/// # Panics
/// The hit is not of this octree, or a miss.
pub fn voxel_normal(octree: &Octree, octree_to_mesh: &DMat4, ray: &Ray, hit: &Hit) -> DVec3 {
    facing(
        normal_in(octree, octree_to_mesh, None, ray, hit),
        octree_to_mesh.transform_vector3(ray.direction.as_dvec3()),
    )
}

/// The same of an object, which may have been [placed](Object::placed).
pub(crate) fn facing_normal(object: &Object, ray: &Ray, hit: &Hit) -> DVec3 {
    facing(own_normal(object, ray, hit), object.octree_to_mesh().transform_vector3(ray.direction.as_dvec3()))
}

/// The same, but not turned to the ray if it comes from an attachment.
pub(crate) fn own_normal(object: &Object, ray: &Ray, hit: &Hit) -> DVec3 {
    normal_in(object.octree(), object.octree_to_mesh(), object.turn(), ray, hit)
}

/// `turn` is for stored normals.
fn normal_in(octree: &Octree, octree_to_mesh: &DMat4, turn: Option<&DMat3>, ray: &Ray, hit: &Hit) -> DVec3 {
    let stored = octree.normal_at(hit.slot, hit.child(), place(ray, hit)).map(Vec3::as_dvec3);
    if let Some(normal) = stored.filter(|n| *n != DVec3::ZERO) {
        return turn.map_or(normal, |turn| *turn * normal).normalize_or_zero();
    }
    // Contours and faces have no outside: they face the ray.
    let contour = octree.contour(hit.slot, hit.child()).map(|c| DVec3::from(c.decode().normal));
    let normal = contour.unwrap_or_else(|| entry_side(ray, hit));
    let normal = DMat3::from_mat4(*octree_to_mesh).inverse().transpose() * normal;
    facing(normal, octree_to_mesh.transform_vector3(ray.direction.as_dvec3())).normalize_or_zero()
}

/// Normal of the face of the cube by which the ray entered: of the planes of the voxel's grid, the one nearest to the hit.
fn entry_side(ray: &Ray, hit: &Hit) -> DVec3 {
    let cells = (ray.origin + ray.direction * hit.raw_t) / hit.size();
    let off = (cells - cells.round()).abs();
    let mut side = DVec3::ZERO;
    side[off.min_position()] = 1.0;
    side
}

/// The place of a hit in its voxel, 0 to 1 on each axis. Attributes at corners are interpolated for it.
fn place(ray: &Ray, hit: &Hit) -> Vec3 {
    // Moved a little along the ray: on the face itself, rounding could select the voxel before it.
    let point = ray.origin + ray.direction * hit.raw_t + ray.direction.normalize_or_zero() * (hit.size() * 1e-3);
    let cells = point / hit.size();
    cells - cells.floor()
}

/// Colour of a hit voxel at the hit, sRGB-encoded, or [`PLAIN_COLOR`].
///
/// # Panics
/// The hit is not of this octree, or a miss.
pub fn voxel_color(octree: &Octree, ray: &Ray, hit: &Hit) -> [f32; 3] {
    octree.color_at(hit.slot, hit.child(), place(ray, hit)).unwrap_or(PLAIN_COLOR)
}

/// Share of the light from all directions that reaches a hit voxel; 1 if the octree has no ambient occlusion.
///
/// # Panics
/// The hit is not of this octree, or a miss.
pub fn voxel_ambient(octree: &Octree, hit: &Hit) -> f32 {
    octree.ambient(hit.slot, hit.child()).unwrap_or(1.0)
}
