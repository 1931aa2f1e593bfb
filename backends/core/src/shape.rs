//! The place and the exact shape of a hit voxel, and where a ray leaves it.
//!
//! # How far from a voxel a secondary ray must start (the paper's section 3.4)
//!
//! A caster computes in `f32`, with `u` = 2^-24 the largest relative error of an operation. What follows bounds its errors as
//! lengths in cast space, across the plane in question, where all coordinates of the octree are at most 2. Lengths across a
//! plane do not grow when a ray grazes it, as an error of `t` does.
//!
//! - **The origin** is rounded to `f32`: at most `2u` on an axis, `3.5u` in any direction.
//! - **A plane of the grid** at `x` is met at `t = x·coef - bias`. `x·coef` is rounded by `2u`; `bias`, which is
//!   `coef·origin` or 3 times `coef` less that, by `2u + 3u + 2u`; the sum by `u` of what is left, which is small near the
//!   voxel. The error of `coef` itself moves all planes of an axis and the origin together, so it cancels. The middle plane
//!   of a cube is computed from its corner, which adds at most `2u`. Together `11u`, and with the origin `13u`.
//! - **A plane of a contour** is met where the weighted sum of the middle planes says so. Each of the three has an error of `11u`, so
//!   their sum has at most `11u·√3 = 19u` along the normal. Products and sums add `6u` of the voxel's edge, at most `3u`. The
//!   product of normal and direction may be off by `3u·√3` of its largest possible value, which moves the plane by `4.5u` over the
//!   diagonal of a voxel of the coarsest level. Together `27u`, and with the origin `30u`.
//!
//! [`Margins::DERIVED`] are the next numbers above that are simple: `16u` and `40u`. A ray that goes away from the plane by which
//! the ray before it entered starts this far in front of the plane. It cannot meet the voxel again, since the voxel is convex
//! and lies behind the plane. The lift is along the normal, so that it is as short at grazing angles as elsewhere.
//!
//! A ray that goes into the voxel, or through it, starts at the `t` where it leaves the cube and the contour, each
//! moved outwards by its margin. If it is then still closer than the margin to a face by which it came in, as a grazing ray is,
//! it is moved out of that face by up to 2.5 margins. Otherwise the caster may find that it crosses the face later than it
//! starts at one level of the octree, and earlier at the next, and then goes back to where the face was crossed, in front of
//! the exit.
//!
//! In all cases the ray skips only what lies in the voxel's own cube and within 40u of it. A voxel at level 12, whose edge is
//! 4096u, is 100 times as thick.

use esvo_format::{Octree, Slab};
use glam::{DVec3, Vec3};

use crate::hit::Hit;
use crate::ray::Ray;
use crate::reference::{EPSILON, away_from_zero};

/// Largest relative error of an operation in `f32`.
const UNIT: f64 = 1.0 / (1u32 << 24) as f64;
/// A component of a direction below this is as good as zero: the caster changes it by at most this.
const SMALLEST: f64 = EPSILON as f64;

/// How far a caster may mistake a plane, in cast space.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Margins {
    /// A plane of the grid.
    pub(crate) grid: f64,
    /// A plane of a contour.
    pub(crate) contour: f64,
}

impl Margins {
    /// See the [module](self).
    pub(crate) const DERIVED: Self = Self { grid: 16.0 * UNIT, contour: 40.0 * UNIT };
}

/// A plane of a convex shape: `normal·x <= offset` inside, in cast space.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Plane {
    /// Outward, of length 1.
    pub(crate) normal: DVec3,
    offset: f64,
    contour: bool,
}

impl Plane {
    fn margin(&self, margins: &Margins) -> f64 {
        if self.contour { margins.contour } else { margins.grid }
    }

    /// The planes of a contour of the cube at `corner`.
    fn of_slab(slab: &Slab, corner: DVec3, size: f64) -> [Self; 2] {
        let normal = DVec3::from(slab.normal);
        let (length, centre) = (normal.length(), corner + size * 0.5);
        let at = |bound: f64| (normal.dot(centre) + bound * size) / length;
        let normal = normal / length;
        [
            Self { normal, offset: at(slab.hi()), contour: true },
            Self { normal: -normal, offset: -at(slab.lo()), contour: true },
        ]
    }

    /// The faces of the cube at `corner`.
    fn of_cube(corner: DVec3, size: f64) -> [Self; 6] {
        std::array::from_fn(|face| {
            let normal = [DVec3::X, DVec3::Y, DVec3::Z][face % 3];
            if face < 3 {
                Self { normal, offset: normal.dot(corner + size), contour: false }
            } else {
                Self { normal: -normal, offset: -normal.dot(corner), contour: false }
            }
        })
    }
}

/// A hit voxel: its place, and the shape that a ray saw.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shape {
    /// Lower corner of the cube in cast space.
    pub(crate) corner: DVec3,
    /// Edge of the cube.
    pub(crate) size: f64,
    /// The voxel's own contour.
    slab: Option<Slab>,
    /// Where the ray met the shape, in cast space.
    pub(crate) point: DVec3,
    /// By which plane it came in; `None` for a ray that started inside.
    pub(crate) entry: Option<Plane>,
}

/// A step of the way from the root to a voxel.
struct Step {
    slot: u32,
    child: u8,
    corner: DVec3,
    size: f64,
}

impl Shape {
    /// Finds the voxel of a hit in an octree. `None`: the ray does not pass it.
    pub(crate) fn find(octree: &Octree, root: u32, contours: bool, ray: &Ray, hit: &Hit) -> Option<Self> {
        let (origin, direction) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
        let point = origin + direction * f64::from(hit.raw_t);
        // Errors of `t` grow with the distance of the origin, and their effect along the ray with the angle to the plane.
        let error = 32.0 * UNIT * (2.0 + origin.abs().max_element());
        let mut path = Vec::new();
        let near = |corner: DVec3, size: f64| {
            let beyond = (corner - point).max(point - corner - size).max_element();
            beyond <= error
        };
        let along = |corner: DVec3, size: f64| {
            let (low, high) = (corner - error - origin, corner + size + error - origin);
            let axes = [0, 1, 2].map(|axis| {
                let d = direction[axis];
                if d.abs() < SMALLEST {
                    let slack = SMALLEST * f64::from(hit.raw_t.abs());
                    return if low[axis] <= slack && high[axis] >= -slack { (f64::MIN, f64::MAX) } else { (1.0, 0.0) };
                }
                let (a, b) = (low[axis] / d, high[axis] / d);
                (a.min(b), a.max(b))
            });
            let first = axes.iter().fold(f64::MIN, |t, axis| t.max(axis.0));
            let last = axes.iter().fold(f64::MAX, |t, axis| t.min(axis.1));
            first <= last
        };
        let found = descend(octree, root, DVec3::ONE, 1.0, hit, &near, &mut path)
            || descend(octree, root, DVec3::ONE, 1.0, hit, &along, &mut path);
        if !found {
            return None;
        }
        // From the voxel up to the root.
        let own = path.first()?;
        let leaf = octree.descriptor(own.slot).leaf_mask() >> own.child & 1 != 0;
        let slab_of = |step: &Step| octree.contour(step.slot, step.child).filter(|_| contours).map(|c| c.decode());
        let mut planes: Vec<Plane> = Plane::of_cube(own.corner, own.size).to_vec();
        for step in &path[1..] {
            planes.extend(slab_of(step).into_iter().flat_map(|slab| Plane::of_slab(&slab, step.corner, step.size)));
        }
        let without = enter(&planes, origin, direction, f64::from(ray.t_min));
        let slab = slab_of(own).filter(|_| leaf);
        planes.extend(slab.into_iter().flat_map(|slab| Plane::of_slab(&slab, own.corner, own.size)));
        let with = enter(&planes, origin, direction, f64::from(ray.t_min));
        // A small voxel ends a ray before its contour is looked at.
        let off = |entry: &(f64, Option<Plane>)| (entry.0 - f64::from(hit.raw_t)).abs();
        let small = ray.has_size() && off(&without) < off(&with);
        let (t, entry) = if small { without } else { with };
        let slab = slab.filter(|_| !small);
        let mut point = (origin + direction * t).clamp(own.corner, own.corner + own.size);
        if let Some(plane) = entry {
            // Back on the plane, exactly.
            point += plane.normal * (plane.offset - plane.normal.dot(point));
        }
        Some(Self { corner: own.corner, size: own.size, slab, point, entry })
    }

    /// A ray from where this voxel was hit, in cast space, that does not meet the voxel.
    pub(crate) fn leave(&self, direction: Vec3, margins: &Margins) -> Ray {
        let exact = direction.as_dvec3();
        if let Some(plane) = self.entry.filter(|plane| plane.normal.dot(exact) >= -4.0 * UNIT * exact.length()) {
            let origin = self.point + plane.normal * plane.margin(margins);
            return Ray::new(origin.as_vec3(), direction);
        }
        // As the caster reads it.
        let cast = DVec3::from(direction.to_array().map(|d| f64::from(away_from_zero(d))));
        let slab = self.slab.into_iter().flat_map(|slab| Plane::of_slab(&slab, self.corner, self.size));
        let faces = Plane::of_cube(self.corner, self.size);
        let planes: Vec<Plane> = faces.into_iter().chain(slab).collect();
        let mut ray = Ray::new(self.point.as_vec3(), direction);
        // Each move changes where the ray leaves the planes of the contour, by less than the move before.
        for _ in 0..3 {
            let origin = ray.origin.as_dvec3();
            let exit = planes.iter().fold(f64::MAX, |t, plane| {
                let speed = plane.normal.dot(cast);
                let way = plane.offset + plane.margin(margins) - plane.normal.dot(origin);
                if speed > 0.0 { t.min(way / speed) } else { t }
            });
            ray.t_min = (exit.max(0.0) as f32).next_up();
            let start = origin + cast * f64::from(ray.t_min);
            let close = faces.iter().filter(|face| face.normal.dot(cast) < 0.0).fold(DVec3::ZERO, |sum, face| {
                let depth = face.offset - face.normal.dot(start);
                if depth.abs() < face.margin(margins) {
                    sum + face.normal * (depth + face.margin(margins))
                } else {
                    sum
                }
            });
            if close == DVec3::ZERO {
                break;
            }
            // A little more, so that rounding does not take it back.
            ray.origin = (origin + close * 1.25).as_vec3();
        }
        ray
    }
}

/// Where a ray comes into a convex shape, not before `start`, and by which plane; `None` if it starts inside.
fn enter(planes: &[Plane], origin: DVec3, direction: DVec3, start: f64) -> (f64, Option<Plane>) {
    planes.iter().fold((start, None), |first, plane| {
        let speed = plane.normal.dot(direction);
        let t = (plane.offset - plane.normal.dot(origin)) / speed;
        if speed < 0.0 && t > first.0 { (t, Some(*plane)) } else { first }
    })
}

/// Looks for the voxel of a hit below the descriptor at `slot`, in the cubes that `takes` says. Fills `path` with the steps,
/// the last one first.
fn descend(
    octree: &Octree,
    slot: u32,
    corner: DVec3,
    size: f64,
    hit: &Hit,
    takes: &dyn Fn(DVec3, f64) -> bool,
    path: &mut Vec<Step>,
) -> bool {
    let size = size * 0.5;
    let descriptor = octree.descriptor(slot);
    let last = size <= f64::from(hit.size());
    for child in (0..8u8).filter(|child| descriptor.valid_mask() >> child & 1 != 0) {
        let offset = DVec3::from(std::array::from_fn(|axis| f64::from(child >> axis & 1)));
        let corner = corner + offset * size;
        let here = last && slot == hit.slot && child == hit.child();
        if (last && !here) || !takes(corner, size) {
            continue;
        }
        let mut below =
            || octree.child(slot, child).is_some_and(|next| descend(octree, next, corner, size, hit, takes, path));
        if here || below() {
            path.push(Step { slot, child, corner, size });
            return true;
        }
    }
    false
}
