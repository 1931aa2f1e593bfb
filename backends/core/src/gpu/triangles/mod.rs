//! Triangles on a GPU: an eight-wide hierarchy with quantized boxes, the kernel that casts rays at it, and what both share.
//!
//! What a hit is, the exact caster of `esvo_cpu::triangles` defines: closest hits in double precision, watertight, of the lower index
//! at the same `t`. A GPU has single precision. The kernel bounds the errors of what it computes, and its answer for a ray is
//! - the triangle, if no error within the bounds makes another one the closest;
//! - a miss, if no error makes it a hit;
//! - [`UNDECIDED`] otherwise: rays close to an edge, or two triangles in almost the same place. The processor decides these.
//!
//! The triangles of both together are those of the exact caster, whatever driver and compiler did to the arithmetic within the
//! accuracy that WGSL demands. The processor computes `t` from the triangle in double precision.
//!
//! # Bounds
//! In the space of the hierarchy the mesh lies in `[-1, 1]`, and `u` is 2^-24. Each sum and product is off by `u` at most, a
//! division by `5 u` (2.5 units in the last place). The greatest component of the eye is `e`. A ray's way `s` counts along its
//! longest axis: `s = t |d_z|`, with `d_z` the direction's component there. Directions have the error `D` relative to it.
//! - A corner relative to the eye: its own rounding, that of the eye and that of the difference: `p = u (2 + e) + u m`, where `m` is
//!   the greatest component of the three corners.
//! - A sheared coordinate `x - z d_x / d_z`: `q = 2 p + m (3 D + 12 u)`, since `|d_x / d_z| <= 1` has the error `3 D + 8 u`.
//! - An edge function, of coordinates of at most `w`: `E = w (4.25 q + 6 u w) + 3 q²`. One above `E` or below `-E` has its sign for certain.
//! - `s` of a hit: a mean of the corners' `z`, weighted by edge functions: `2 p + 16 u m + 7 E (z_max - z_min) / |determinant|`, if the
//!   determinant is above `8 E`. Otherwise `s` is between the least and the greatest `z`.
//! - Boxes are widened by `(2 + e) (40 u + 3 D)`: corners, eye, direction, the rounding of `origin + quantum × n`, and of the slab test. A ray
//!   then enters every box that holds a part of a triangle that the ray hits.

mod caster;
mod placement;

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use crate::exact::{CameraRays, ExactRay};

pub use self::caster::{Dispatch, LoadedTriangles, TriangleCaster, TriangleDevice, TriangleLimits};
pub use self::placement::TrianglePlacement;

/// The kernel without its prelude.
pub const TRIANGLES_WGSL: &str = include_str!("../../../kernels/triangles.wgsl");

/// [`TriangleRecord::triangle`] of a ray that hits nothing.
pub const MISS: u32 = u32::MAX;
/// [`TriangleRecord::triangle`] of a ray that single precision does not decide.
pub const UNDECIDED: u32 = u32::MAX - 1;
/// Most frames of the kernel's stack: 8 bytes each, in private memory.
pub const MAX_STACK: u32 = 64;

/// Binding in group 0 of the uniform buffer with the [`TriangleView`].
pub const BINDING_VIEW: u32 = 0;
/// Binding in group 0 of the [`TriangleRay`]s.
pub const BINDING_RAYS: u32 = 1;
/// Binding in group 0 of the [`TriangleRecord`]s; in the timing pass, of one `f32` per pixel.
pub const BINDING_OUT: u32 = 2;

/// What a dispatch computes.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum TrianglePass {
    /// The closest hits of a picture.
    Picture,
    /// One `f32` per pixel, which nobody reads.
    Time,
    /// The closest hits of a buffer of rays.
    Closest,
    /// Some hit of each ray of a buffer.
    Any,
}

impl TrianglePass {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Picture, Self::Time, Self::Closest, Self::Any];

    /// Entry point in the kernel.
    pub fn entry(self) -> &'static str {
        match self {
            Self::Picture => "triangles_pass",
            Self::Time => "triangles_timing",
            Self::Closest => "triangles_rays",
            Self::Any => "triangles_any",
        }
    }
}

/// What is asked about a list of rays.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Question {
    /// The closest hit.
    Closest,
    /// Whether there is a hit. The record has the triangle of some hit.
    Any,
}

impl Question {
    /// The pass that answers it.
    pub fn pass(self) -> TrianglePass {
        match self {
            Self::Closest => TrianglePass::Closest,
            Self::Any => TrianglePass::Any,
        }
    }
}

/// A node of the hierarchy: 80 bytes, the layout of `CwBvhNode` of `obvhs` 0.4. A test compares it with the kernel's `Node`.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Debug, Pod, Zeroable)]
pub struct WideNode {
    /// Lower corner of the box.
    pub origin: [f32; 3],
    /// Exponents of the quanta as floats have them, x in the lowest byte; in the highest byte, which children are nodes.
    pub exponents: u32,
    /// Index of the first child that is a node.
    pub first_child: u32,
    /// Index of the first triangle of the children that are leaves.
    pub first_triangle: u32,
    /// One byte per child: 0 for none; bits 0 to 4 are 24 plus its place for a node, and the place of its first triangle for a leaf;
    /// bits 5 to 7 are 001 for a node, and have as many ones as triangles for a leaf.
    pub kinds: [u32; 2],
    /// Sides of the boxes in quanta from `origin`, one byte per child.
    pub min_x: [u32; 2],
    /// See `min_x`.
    pub max_x: [u32; 2],
    /// See `min_x`.
    pub min_y: [u32; 2],
    /// See `min_x`.
    pub max_y: [u32; 2],
    /// See `min_x`.
    pub min_z: [u32; 2],
    /// See `min_x`.
    pub max_z: [u32; 2],
}

impl WideNode {
    /// Which children are nodes, one bit each.
    pub fn inner(&self) -> u32 {
        self.exponents >> 24
    }
}

/// A triangle: 48 bytes.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Debug, Pod, Zeroable)]
pub struct WideTriangle {
    /// First corner.
    pub a: [f32; 3],
    /// Index in the mesh.
    pub index: u32,
    /// Second corner.
    pub b: [f32; 3],
    /// 0.
    pub unused: u32,
    /// Third corner.
    pub c: [f32; 3],
    /// 0.
    pub unused_too: u32,
}

/// The rays of a picture, in the space of the hierarchy: 80 bytes.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Debug, Pod, Zeroable)]
pub struct TriangleView {
    /// The eye.
    pub eye: [f32; 3],
    /// Start of the rays.
    pub t_min: f32,
    /// Direction through the middle of the picture.
    pub middle: [f32; 3],
    /// End of the rays.
    pub t_max: f32,
    /// Direction per pixel to the right.
    pub dx: [f32; 3],
    /// Error of a component of a direction, at most.
    pub direction_error: f32,
    /// Direction per pixel downwards.
    pub dy: [f32; 3],
    /// Width of the picture in pixels.
    pub width: u32,
    /// Height of the picture in pixels.
    pub height: u32,
    /// First row that the dispatch casts.
    pub first_row: u32,
    /// Rays in the buffer.
    pub count: u32,
    /// 0.
    pub padding: u32,
}

/// A ray of a buffer, in the space of the hierarchy: 32 bytes.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Debug, Pod, Zeroable)]
pub struct TriangleRay {
    /// Where `t` is 0.
    pub origin: [f32; 3],
    /// Start of the ray.
    pub t_min: f32,
    /// Displacement over `t` = 1; zero for a ray that single precision does not suffice for.
    pub direction: [f32; 3],
    /// End of the ray.
    pub t_max: f32,
}

/// The kernel's answer for a ray: 8 bytes.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Debug, Pod, Zeroable)]
pub struct TriangleRecord {
    /// About where the ray meets the triangle; 2 without one. With [`Question::Any`], a lower bound.
    pub t: f32,
    /// Index of the triangle, [`MISS`] or [`UNDECIDED`].
    pub triangle: u32,
}

impl TriangleRecord {
    /// A ray that hits nothing.
    pub const MISS: Self = Self { t: 2.0, triangle: MISS };
    /// A ray that single precision does not decide.
    pub const UNDECIDED: Self = Self { t: 2.0, triangle: UNDECIDED };
}

/// From mesh units to the space of a hierarchy, in which the mesh lies in `[-1, 1]`.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct HierarchySpace {
    /// Its origin, in mesh units.
    pub centre: DVec3,
    /// Its units per mesh unit: a power of two.
    pub scale: f64,
}

/// The triangles as a GPU holds them.
#[derive(Clone, PartialEq, Debug)]
pub struct WideTriangles {
    /// Node 0 is the root. Empty without triangles.
    pub nodes: Vec<WideNode>,
    /// In the order of the leaves; one that was split into several boxes occurs several times.
    pub triangles: Vec<WideTriangle>,
    /// Frames of the stack that a traversal needs at most: the longest path of nodes below the root.
    pub stack: u32,
    /// The space of nodes and triangles.
    pub space: HierarchySpace,
}

/// Eyes and directions are within this factor of the size of the mesh. Beyond, the kernel decides nothing, and it could overflow.
const RANGE: f64 = (1u64 << 20) as f64;
/// 2^-24.
const U: f64 = 1.0 / (1 << 24) as f64;

fn single(v: DVec3) -> [f32; 3] {
    v.as_vec3().into()
}

impl HierarchySpace {
    /// A point of the mesh.
    pub fn point(&self, p: DVec3) -> DVec3 {
        (p - self.centre) * self.scale
    }

    /// Whether the kernel takes rays from this point with directions of about this length.
    fn takes(&self, origin: DVec3, length: f64) -> bool {
        let eye = self.point(origin).abs().max_element();
        // Written so that NaN is refused.
        eye <= RANGE && (1.0 / (RANGE * RANGE)..=RANGE * RANGE).contains(&length)
    }

    /// The rays of a picture; `None` if single precision decides none of them: the eye or the far plane is more than 2^20 mesh sizes
    /// away, or numbers are not finite.
    pub fn view(&self, rays: &CameraRays) -> Option<TriangleView> {
        let (width, height) = (f64::from(rays.width), f64::from(rays.height));
        let (dx, dy) = (rays.dx * self.scale, rays.dy * self.scale);
        let middle = rays.direction(width / 2.0, height / 2.0) * self.scale;
        // Four roundings of each term.
        let extent = middle.abs() + dx.abs() * (width / 2.0) + dy.abs() * (height / 2.0);
        let length = extent.max_element();
        let sound = extent.is_finite() && self.takes(rays.origin, length) && (0.0..=1.0).contains(&rays.t_near);
        sound.then(|| TriangleView {
            eye: single(self.point(rays.origin)),
            t_min: rays.t_near as f32,
            middle: single(middle),
            t_max: 1.0,
            dx: single(dx),
            direction_error: (5.0 * U * length) as f32,
            dy: single(dy),
            width: rays.width,
            height: rays.height,
            first_row: 0,
            count: 0,
            padding: 0,
        })
    }

    /// A ray of a buffer.
    pub fn ray(&self, ray: &ExactRay) -> TriangleRay {
        let direction = ray.direction * self.scale;
        let length = direction.abs().max_element();
        let sound = direction.is_finite() && self.takes(ray.origin, length) && ray.t_min >= 0.0 && ray.t_max >= 0.0;
        if !sound {
            return TriangleRay::zeroed();
        }
        // A ray has left the mesh long before.
        let farthest = 4.0 * RANGE / length;
        TriangleRay {
            origin: single(self.point(ray.origin)),
            t_min: ray.t_min.min(farthest) as f32,
            direction: single(direction),
            t_max: ray.t_max.min(farthest) as f32,
        }
    }
}

impl TriangleView {
    /// For a dispatch over `count` rays of a buffer.
    pub fn of_rays(count: u32) -> Self {
        Self { count, ..Self::zeroed() }
    }
}

impl WideTriangles {
    /// Bytes on the device.
    pub fn bytes(&self) -> u64 {
        (size_of_val(&self.nodes[..]) + size_of_val(&self.triangles[..])) as u64
    }

    /// The nodes in slots of the kind [`SlotKind::Quad`](crate::gpu::slots::SlotKind::Quad): five for each.
    pub fn node_slots(&self) -> &[[u32; 4]] {
        bytemuck::cast_slice(&self.nodes)
    }

    /// The triangles in slots of the same kind: three for each.
    pub fn triangle_slots(&self) -> &[[u32; 4]] {
        bytemuck::cast_slice(&self.triangles)
    }
}
