//! Viewpoints: a camera that sees a whole object, and near and far planes for an eye.

use esvo_format::Octree;
use glam::{DMat4, DVec3};

use crate::{Camera, Object};

/// Levels that are visited to find out which part of the root cube is filled: octrees without the levels below have the same
/// bounds and cameras.
pub const LEVELS: u32 = 6;
/// The same where there are more than [`MANY`] objects.
const LEVELS_OF_MANY: u32 = 3;
const MANY: usize = 16;

/// Corners of the smallest box of cubes of level 6 around everything in an object, in octree space (root cube `[0, 1]³`).
///
/// The octree must be [sound](Octree::sound).
pub fn bounds(octree: &Octree, object: usize) -> (DVec3, DVec3) {
    let (mut low, mut high) = (DVec3::ONE, DVec3::ZERO);
    coarse_cubes(octree, octree.objects()[object].root_slot as u32, LEVELS, |from, to| {
        (low, high) = (low.min(from), high.max(to));
    });
    (low, high)
}

/// The same around everything in all objects, in mesh space.
pub fn bounds_in_mesh(octree: &Octree) -> (DVec3, DVec3) {
    bounds_of(&Object::all(octree))
}

/// The same around objects that may have been [placed](Object::placed).
pub fn bounds_of(objects: &[Object]) -> (DVec3, DVec3) {
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for object in objects {
        let (mut from, mut to) = (DVec3::ONE, DVec3::ZERO);
        coarse_cubes(object.octree(), object.root(), levels(objects), |a, b| (from, to) = (from.min(a), to.max(b)));
        corners(object.octree_to_mesh(), from, to).for_each(|corner| (low, high) = (low.min(corner), high.max(corner)));
    }
    (low, high)
}

fn levels(objects: &[Object]) -> u32 {
    if objects.len() > MANY { LEVELS_OF_MANY } else { LEVELS }
}

/// Visits the voxels below a root at level `levels` and the leaves of lower levels, by lower and upper corner in octree space.
fn coarse_cubes(octree: &Octree, root: u32, levels: u32, mut visit: impl FnMut(DVec3, DVec3)) {
    let mut stack = vec![(root, DVec3::ZERO, 0)];
    while let Some((slot, corner, level)) = stack.pop() {
        let descriptor = octree.descriptor(slot);
        let edge = 0.5 / f64::from(1u32 << level);
        for child in (0..8u8).filter(|c| descriptor.valid_mask() >> c & 1 != 0) {
            let offset = DVec3::new(f64::from(child & 1), f64::from(child >> 1 & 1), f64::from(child >> 2));
            let at = corner + offset * edge;
            match octree.child(slot, child).filter(|_| level + 1 < levels) {
                Some(node) => stack.push((node, at, level + 1)),
                None => visit(at, at + edge),
            }
        }
    }
}

/// A camera in mesh units that sees all objects from outside: from the front, the right and above, as large as fits
/// into a picture whose width divided by its height is `aspect`. The field of view is that of the shorter side.
///
/// The octree must be [sound](Octree::sound).
pub fn overview(octree: &Octree, up: [f64; 3], fov_degrees: f64, aspect: f64) -> Camera {
    overview_of(&Object::all(octree), up, fov_degrees, aspect)
}

/// The same for objects that may have been [placed](Object::placed).
pub fn overview_of(objects: &[Object], up: [f64; 3], fov_degrees: f64, aspect: f64) -> Camera {
    let centre = match objects {
        [only] => only.octree_to_mesh().transform_point3(DVec3::splat(0.5)),
        _ => {
            let (low, high) = bounds_of(objects);
            (low + high) / 2.0
        }
    };
    let (up, outward) = overview_axes(up);
    let right = up.cross(outward).normalize();
    let top = outward.cross(right);
    let tangents = half_tangents(fov_degrees, aspect);
    // How far the object reaches beyond a view pyramid whose tip is at the centre: right and left, top and bottom; to the
    // front and to the back.
    let mut beyond = [[f64::NEG_INFINITY; 2]; 2];
    let (mut front_most, mut behind_most) = (f64::NEG_INFINITY, f64::NEG_INFINITY);
    let mut visit = |to_mesh: &DMat4, low, high| {
        for corner in corners(to_mesh, low, high) {
            let p = corner - centre;
            let ahead = p.dot(outward);
            (front_most, behind_most) = (front_most.max(ahead), behind_most.max(-ahead));
            for (axis, direction) in [right, top].into_iter().enumerate() {
                let (aside, toward) = (p.dot(direction), ahead * tangents[axis]);
                beyond[axis] = [beyond[axis][0].max(toward + aside), beyond[axis][1].max(toward - aside)];
            }
        }
    };
    for object in objects {
        let to_mesh = object.octree_to_mesh();
        coarse_cubes(object.octree(), object.root(), levels(objects), |low, high| visit(to_mesh, low, high));
    }
    // The eye moves back until the object fits, and aside until the object is in the middle.
    let [back_x, back_y] = std::array::from_fn(|axis| (beyond[axis][0] + beyond[axis][1]) / (2.0 * tangents[axis]));
    let [aside_x, aside_y] = beyond.map(|[one, other]| (one - other) / 2.0);
    let distance = back_x.max(back_y);
    Camera {
        eye: (centre + outward * distance + right * aside_x + top * aside_y).to_array(),
        forward: (-outward).to_array(),
        up: up.to_array(),
        fov_degrees,
        near: ((distance - front_most) * 0.9).max((distance + behind_most) * 1e-4),
        far: (distance + behind_most) * 1.05,
    }
}

/// A camera in mesh units that looks at the middle of all objects in the direction of [`overview`], from so far that it sees
/// all of them from every side: wherever it is turned to around the axis `up` through the middle. The middle comes second.
///
/// The octrees must be [sound](Octree::sound).
pub fn turntable(objects: &[Object], up: [f64; 3], fov_degrees: f64, aspect: f64) -> (Camera, DVec3) {
    let (low, high) = bounds_of(objects);
    let centre = (low + high) / 2.0;
    let (up, outward) = overview_axes(up);
    let sine = outward.dot(up);
    let cosine = (1.0 - sine * sine).sqrt();
    let [across, upright] = half_tangents(fov_degrees, aspect);
    let mut distance = 0.0f64;
    for object in objects {
        coarse_cubes(object.octree(), object.root(), levels(objects), |low, high| {
            for corner in corners(object.octree_to_mesh(), low, high) {
                let height = (corner - centre).dot(up);
                let radius = (corner - centre).reject_from_normalized(up).length();
                // The most, over a turn, of how far the corner is ahead plus how far it is aside, above or below as a part of
                // the slope of that side of the view pyramid.
                let aside = height * sine + radius * cosine.hypot(1.0 / across);
                let above = height * (sine + cosine / upright) + radius * (cosine - sine / upright).abs();
                let below = height * (sine - cosine / upright) + radius * (cosine + sine / upright);
                distance = distance.max(aside).max(above).max(below);
            }
        });
    }
    let eye = (centre + outward * distance).to_array();
    let (near, far) = planes_of(objects, eye);
    (Camera { eye, forward: (-outward).to_array(), up: up.to_array(), fov_degrees, near, far }, centre)
}

/// Up as a unit vector, and the unit vector from an object towards the camera of an overview: to the front, to the right and
/// upwards.
fn overview_axes(up: [f64; 3]) -> (DVec3, DVec3) {
    let up = DVec3::from(up).try_normalize().unwrap_or(DVec3::Y);
    let front = if up == DVec3::Y { DVec3::Z } else { up.any_orthonormal_vector() };
    (up, (front + up.cross(front) * 0.6 + up * 0.5).normalize())
}

/// Slopes of the sides of the view pyramid, to the right and upwards, with a margin of a twentieth.
fn half_tangents(fov_degrees: f64, aspect: f64) -> [f64; 2] {
    let tangent = (fov_degrees.to_radians() / 2.0).tan() / 1.05;
    [tangent * aspect.max(1.0), tangent * (1.0 / aspect).max(1.0)]
}

/// Near and far plane, in mesh units, for a camera at `eye`: the far plane lies beyond all objects, the near plane at a
/// ten-thousandth of that distance.
pub fn planes(octree: &Octree, eye: [f64; 3]) -> (f64, f64) {
    planes_of(&Object::all(octree), eye)
}

/// The same for objects that may have been [placed](Object::placed).
pub fn planes_of(objects: &[Object], eye: [f64; 3]) -> (f64, f64) {
    let reach_of = |object: &Object| {
        corners(object.octree_to_mesh(), DVec3::ZERO, DVec3::ONE).map(|c| c.distance(eye.into())).fold(0.0, f64::max)
    };
    let reach = objects.iter().map(reach_of).fold(0.0, f64::max) * 1.01;
    (reach * 1e-4, reach)
}

fn corners(to_mesh: &DMat4, low: DVec3, high: DVec3) -> impl Iterator<Item = DVec3> {
    let corner =
        move |i: u32| DVec3::from_array(std::array::from_fn(|a| if i >> a & 1 == 0 { low[a] } else { high[a] }));
    (0..8).map(move |i| to_mesh.transform_point3(corner(i)))
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use esvo_format::{AssembleOptions, Tree, Voxel, assemble};

    use super::*;
    use crate::reference::ReferenceCaster;
    use crate::testing::sample::two_objects_apart;
    use crate::{CastOptions, Caster, View};

    /// One voxel of level 1 at the corner 1, 1, 1 of a cube of edge 4 that starts at 10, 0, 0.
    fn octree() -> Octree {
        let mut tree = Tree::default();
        let mut children = [None; 8];
        children[7] = Some(Voxel { leaf: true, ..Voxel::default() });
        let root = tree.open(&children);
        tree.close(root);
        let place = DMat4::from_translation(DVec3::X * 10.0) * DMat4::from_scale(DVec3::splat(4.0));
        assemble(&tree, place, &AssembleOptions::default()).unwrap()
    }

    #[test]
    fn bounds_are_tight() {
        assert_eq!(bounds(&octree(), 0), (DVec3::splat(0.5), DVec3::ONE));
        assert_eq!(bounds_in_mesh(&octree()), (DVec3::new(12.0, 2.0, 2.0), DVec3::new(14.0, 4.0, 4.0)));
    }

    #[test]
    fn the_overview_fills_the_picture_but_for_a_margin() {
        let octree = std::sync::Arc::new(octree());
        for (width, height) in [(64, 48), (48, 64), (160, 40)] {
            for up in [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 2.0, -3.0]] {
                let camera = overview(&octree, up, 50.0, width as f64 / height as f64);
                let root = octree.objects()[0].root_slot as u32;
                let size = (width as u32, height as u32);
                let view = View::new(&camera, octree.octree_to_mesh(0), root, size, &CastOptions::default()).unwrap();
                let mut caster = ReferenceCaster::default();
                caster.load(&octree).unwrap();
                let mut hits = Vec::new();
                caster.cast(&view, &mut hits).unwrap();
                let seen = |x: usize, y: usize| !hits[y * width + x].is_miss();
                let columns: Vec<usize> = (0..width).filter(|x| (0..height).any(|y| seen(*x, y))).collect();
                let rows: Vec<usize> = (0..height).filter(|y| (0..width).any(|x| seen(x, *y))).collect();
                let span = |lines: &[usize]| (lines[0], *lines.last().unwrap());
                let ((left, right), (top, bottom)) = (span(&columns), span(&rows));
                let what = format!("{width}x{height}, {up:?}: {left}..={right}, {top}..={bottom}");
                assert!(left > 0 && right < width - 1 && top > 0 && bottom < height - 1, "{what}");
                // In one direction nearly as large as the picture, and in its middle.
                let fills = |(first, last): (usize, usize), size: usize| {
                    (last - first) * 10 >= size * 8 && first.abs_diff(size - 1 - last) <= 2
                };
                assert!(fills((left, right), width) || fills((top, bottom), height), "{what}");
            }
        }
    }

    #[test]
    fn a_turntable_sees_all_objects_from_every_side() {
        let octree = two_objects_apart(3.0).unwrap();
        let mut caster = ReferenceCaster::default();
        caster.load(&octree).unwrap();
        for (up, size) in [([0.0, 1.0, 0.0], (64, 48)), ([1.0, 2.0, -3.0], (40, 64)), ([0.0, 0.0, 1.0], (64, 64))] {
            let (camera, centre) = turntable(&Object::all(&octree), up, 50.0, f64::from(size.0) / f64::from(size.1));
            let mut least = u32::MAX;
            for turn in 0..12 {
                let turn = glam::DQuat::from_axis_angle(DVec3::from(up).normalize(), f64::from(turn) * TAU / 12.0);
                let eye = centre + turn * (DVec3::from(camera.eye) - centre);
                let turned =
                    Camera { eye: eye.to_array(), forward: (turn * DVec3::from(camera.forward)).to_array(), ..camera };
                for object in 0..2 {
                    let root = octree.objects()[object].root_slot as u32;
                    let view =
                        View::new(&turned, octree.octree_to_mesh(object), root, size, &CastOptions::default()).unwrap();
                    let mut hits = Vec::new();
                    caster.cast(&view, &mut hits).unwrap();
                    let mut seen = false;
                    for (pixel, _) in hits.iter().enumerate().filter(|(_, hit)| !hit.is_miss()) {
                        let (x, y) = (pixel as u32 % size.0, pixel as u32 / size.0);
                        least = least.min(x).min(y).min(size.0 - 1 - x).min(size.1 - 1 - y);
                        seen = true;
                    }
                    assert!(seen);
                }
            }
            assert!((1..12).contains(&least), "{up:?}: {least} pixels are free at the sides");
        }
    }

    #[test]
    fn the_overview_sees_all_objects() {
        let octree = two_objects_apart(3.0).unwrap();
        let mut caster = ReferenceCaster::default();
        caster.load(&octree).unwrap();
        let camera = overview(&octree, [0.0, 1.0, 0.0], 50.0, 1.0);
        let seen: Vec<Vec<bool>> = (0..2)
            .map(|object| {
                let root = octree.objects()[object].root_slot as u32;
                let to_mesh = octree.octree_to_mesh(object);
                let view = View::new(&camera, to_mesh, root, (64, 64), &CastOptions::default()).unwrap();
                let mut hits = Vec::new();
                caster.cast(&view, &mut hits).unwrap();
                hits.iter().map(|hit| !hit.is_miss()).collect()
            })
            .collect();
        let edge = |pixel: usize| [pixel % 64, pixel / 64].iter().any(|at| *at == 0 || *at == 63);
        for seen in &seen {
            assert!(seen.iter().filter(|seen| **seen).count() > 50);
            assert!(seen.iter().enumerate().all(|(pixel, seen)| !seen || !edge(pixel)), "an object is cut off");
        }
        let reach = |octree: &Octree| planes(octree, [0.0; 3]).1;
        assert!(reach(&octree) > 1.5 * reach(&two_objects_apart(0.0).unwrap()));
    }

    #[test]
    fn planes_reach_behind_the_object() {
        let (near, far) = planes(&octree(), [10.0, 0.0, 0.0]);
        assert!(near > 0.0 && far > 48f64.sqrt() && far < 7.1);
    }
}
