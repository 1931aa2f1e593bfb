//! Octrees as shapes of a world.

use esvo_core::reference::cast_ray;
use esvo_core::shading::decode_srgb;
use esvo_core::{HitPoint, Object};
use esvo_format::Octree;
use glam::{DMat3, DMat4, DQuat, DVec3, Vec3};

use crate::effects::bounce::Look;
use crate::error::ShadowError;
use crate::grid::{Grid, Pose};
use crate::shape::{Cubes, Rule, Shape};
use crate::volume::MAX_VOXELS;
use crate::world::World;

/// A contour, in octree space: `low <= normal . p <= high`.
#[derive(Clone, Copy)]
struct Slab {
    normal: DVec3,
    low: f64,
    high: f64,
}

impl Slab {
    fn meets(&self, middle: DVec3, half: f64) -> bool {
        let (at, reach) = (self.normal.dot(middle), self.normal.abs().element_sum() * half);
        at + reach >= self.low && at - reach <= self.high
    }
}

/// The cells of a level that an object's voxels fill: cell `c` reaches from `c / 2^level` to the next in octree space. Voxels above that level
/// are divided, and a part counts if the contours of the voxel and of those around it meet it. The octree must be [sound](Octree::sound).
///
/// # Panics
/// There is no such object. A level above 21.
pub fn cells(octree: &Octree, object: usize, level: u32) -> Vec<[i32; 3]> {
    assert!(level <= 21, "there are cells of levels 0 to 21");
    let mut cells = Vec::new();
    let root = octree.objects()[object].root_slot as u32;
    if level == 0 {
        return vec![[0; 3]];
    }
    descend(octree, Some(root), [0; 3], 0, level, &mut Vec::new(), &mut cells);
    cells
}

/// Adds the cells within a voxel: of its children if it has a descriptor, of all its parts if it is a leaf.
fn descend(
    octree: &Octree,
    slot: Option<u32>,
    cell: [i32; 3],
    depth: u32,
    level: u32,
    slabs: &mut Vec<Slab>,
    cells: &mut Vec<[i32; 3]>,
) {
    let edge = 0.5f64.powi(depth as i32 + 1);
    for child in 0..8u8 {
        if slot.is_some_and(|slot| octree.descriptor(slot).valid_mask() >> child & 1 == 0) {
            continue;
        }
        let place: [i32; 3] = std::array::from_fn(|axis| 2 * cell[axis] + i32::from(child >> axis & 1));
        let middle = (DVec3::from(place.map(f64::from)) + 0.5) * edge;
        let kept = slabs.len();
        if let Some(contour) = slot.and_then(|slot| octree.contour(slot, child)) {
            let slab = contour.decode();
            let normal = DVec3::from(slab.normal);
            let at = normal.dot(middle);
            slabs.push(Slab { normal, low: at + slab.lo() * edge, high: at + slab.hi() * edge });
        }
        if slabs.iter().all(|slab| slab.meets(middle, edge * 0.5)) {
            if depth + 1 == level {
                cells.push(place);
            } else {
                let next = slot.and_then(|slot| octree.child(slot, child));
                descend(octree, next, place, depth + 1, level, slabs, cells);
            }
        }
        slabs.truncate(kept);
    }
}

/// An object of an octree as cubes of a level, and its pose. `octree_to_world` takes octree space, the root cube `[0, 1]³`, to the world: it may turn, move and
/// scale all axes alike.
///
/// # Errors
/// A transform that scales axes differently, mirrors, or is not finite.
///
/// # Panics
/// As [`cells`].
pub fn as_cubes(
    octree: &Octree,
    object: usize,
    octree_to_world: DMat4,
    level: u32,
) -> Result<(Cubes, Pose), ShadowError> {
    let matrix = DMat3::from_mat4(octree_to_world);
    let scale = matrix.x_axis.length();
    let turn = matrix * (1.0 / scale);
    let off = turn.transpose() * turn - DMat3::IDENTITY;
    let most = off.to_cols_array().iter().fold(0.0, |most: f64, x| most.max(x.abs()));
    // Also if a number is NaN.
    if !(scale.is_finite() && scale > 0.0 && most < 1e-6 && turn.determinant() > 0.0) {
        return Err(ShadowError::Pose(
            "an octree is placed by a transform that mirrors it, or scales its axes differently; a shadow volume takes octrees \
             that are turned, moved, and scaled alike"
                .into(),
        ));
    }
    let edge = scale * 0.5f64.powi(level as i32);
    let cubes = Cubes::new(cells(octree, object, level), edge, Rule::Touch)?;
    let rotation = if turn == DMat3::IDENTITY { DQuat::IDENTITY } else { DQuat::from_mat3(&turn).normalize() };
    Ok((cubes, Pose { rotation, position: octree_to_world.w_axis.truncate() }))
}

/// Bounds of the objects' root cubes, which [`world_of`] makes the world of; `None` without objects.
pub fn bounds(objects: &[Object]) -> Option<(DVec3, DVec3)> {
    let corner = |object: &Object, i: u32| {
        object.octree_to_mesh().transform_point3(DVec3::from_array([0, 1, 2].map(|axis| f64::from(i >> axis & 1))))
    };
    let corners = objects.iter().flat_map(|object| (0..8).map(move |i| corner(object, i)));
    corners.fold(None, |ends: Option<(DVec3, DVec3)>, corner| {
        Some(ends.map_or((corner, corner), |(low, high)| (low.min(corner), high.max(corner))))
    })
}

/// A world of objects that stay where they are, with voxels of about this edge and a border of two voxels. One object alone that is not turned gets voxels
/// that are its own cells, so that its surface is as thin as can be.
///
/// # Errors
/// An edge that is not above 0; a transform that [`as_cubes`] refuses; as for [`World::new`]. Objects that are not there.
pub fn world_of(objects: &[Object], voxel: f64, mips: u32) -> Result<World, ShadowError> {
    if !(voxel > 0.0 && voxel.is_finite()) {
        return Err(ShadowError::Shape(format!("voxels with an edge of {voxel} were asked for; edges are above 0")));
    }
    let Some((low, high)) = bounds(objects) else {
        return Err(ShadowError::Shape("there is no object to make a volume of".into()));
    };
    let size = |voxel: f64| ((high - low) / voxel + 4.001).ceil().to_array().map(|n| n.min(f64::from(u32::MAX)) as u32);
    let level = |object: &Object, voxel: f64| {
        let scale = object.octree_to_mesh().x_axis.truncate().length();
        (scale / voxel).log2()
    };
    let edge = (high - low).x;
    if let [object] = objects
        && edge > 0.0
        && DMat3::from_mat4(*object.octree_to_mesh()) == DMat3::from_diagonal(DVec3::splat(edge))
    {
        let level = level(object, voxel).round().clamp(1.0, 21.0);
        let voxel = edge / level.exp2();
        // Before memory is taken for cells.
        if level.exp2() > f64::from(MAX_VOXELS) {
            return Err(ShadowError::Size(size(voxel)));
        }
        let cells = cells(object.octree(), index(object), level as u32);
        // Around what is full, which is often much less than the root cube.
        let least: [i32; 3] = std::array::from_fn(|axis| cells.iter().map(|cell| cell[axis]).min().unwrap_or(0));
        let most: [i32; 3] = std::array::from_fn(|axis| cells.iter().map(|cell| cell[axis]).max().unwrap_or(0));
        let origin = low + (DVec3::from(least.map(f64::from)) - 2.0) * voxel;
        let size = std::array::from_fn(|axis| (most[axis] - least[axis]) as u32 + 5);
        let mut world = World::new(Grid { origin, voxel }, size, mips)?;
        let place = |cell: [i32; 3]| std::array::from_fn(|axis| cell[axis] - least[axis] + 2);
        world.add_fixed_voxels(cells.into_iter().map(place));
        world.update(0);
        return Ok(world);
    }
    let mut world = World::new(Grid { origin: low - 2.0 * voxel, voxel }, size(voxel), mips)?;
    for object in objects {
        // Cubes of half a voxel's edge or less, so that surfaces grow little.
        let level = (level(object, voxel) + 1.0).ceil().clamp(1.0, 21.0);
        let (cubes, pose) = as_cubes(object.octree(), index(object), *object.octree_to_mesh(), level as u32)?;
        world.add_fixed(&Shape::Cubes(cubes), &pose)?;
    }
    world.update(0);
    Ok(world)
}

/// What objects have at a place that a ray in a direction, of length 1, met: normal and colour of the first voxel from `distance` before it to as much behind it,
/// in the world's unit. Light that bounces gets the colours of octrees so: a volume has none.
pub fn look(objects: &[Object], place: Vec3, direction: Vec3, distance: f32) -> Option<Look> {
    let (place, direction, distance) = (place.as_dvec3(), direction.as_dvec3(), f64::from(distance));
    let from = place - direction * distance;
    let met = objects.iter().filter_map(|object| {
        let ray = object.ray(from, direction, 0.0..2.0 * distance);
        let hit = cast_ray(object.octree(), object.root(), &ray, object.contours());
        let point = HitPoint::new(object, &ray, &hit)?;
        let normal = point.normal().as_vec3();
        Some((point.position().distance_squared(from), (normal, Vec3::from(point.color().map(decode_srgb)))))
    });
    met.min_by(|(a, _), (b, _)| a.total_cmp(b)).map(|(_, look)| look)
}

/// Number of an object in its octree.
fn index(object: &Object) -> usize {
    let root = u64::from(object.root());
    object.octree().objects().iter().position(|entry| entry.root_slot == root).unwrap_or(0)
}
