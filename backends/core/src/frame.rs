//! From a camera to rays in octree space.

use bytemuck::{Pod, Zeroable};
use glam::{DMat4, DVec3, Vec3};
use serde::{Deserialize, Serialize};

use crate::{Camera, CastError};

/// How a frame is cast.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CastOptions {
    /// Clip voxels by their contours; otherwise they are cubes.
    pub contours: bool,
    /// Start rays where a coarse pass found that nothing comes before (paper section 4.2).
    pub beam: bool,
    /// End at voxels that are at most this many pixels large where the ray leaves them (paper section 4.1); 0 casts
    /// down to the leaves.
    pub max_voxel_pixels: f32,
}

impl Default for CastOptions {
    /// The paper's: contours, no beam, one pixel.
    fn default() -> Self {
        Self { contours: true, beam: false, max_voxel_pixels: 1.0 }
    }
}

/// Edge of a block of the coarse pass in pixels.
pub const BEAM_BLOCK: u32 = 4;

/// The rays of one frame, as the kernels take them: the uniform buffer of the GPU kernels, 96 bytes.
///
/// The octree is the cube `[1, 2]³`. The ray of pixel `(x, y)`, `(0, 0)` on the top left, starts at `origin` and has the
/// direction `base + (x + 0.5) dx + (y + 0.5) dy`; `t = 1` is the far plane, so `t` is depth over far depth.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Debug, Pod, Zeroable)]
pub struct View {
    /// The eye.
    pub origin: [f32; 3],
    /// `t` at the near plane.
    pub t_near: f32,
    /// Direction to the top-left corner of the picture.
    pub base: [f32; 3],
    /// Edge of a pixel on the far plane in octree units; at `t` it is `t` times as long.
    pub pixel_size: f32,
    /// Direction per pixel to the right.
    pub dx: [f32; 3],
    /// Voxels at most this many pixels large end a ray; 0: none.
    pub max_voxel_pixels: f32,
    /// Direction per pixel downwards.
    pub dy: [f32; 3],
    /// `t` per octree unit of depth.
    pub t_per_depth: f32,
    /// Width of the picture in pixels.
    pub width: u32,
    /// Height of the picture in pixels.
    pub height: u32,
    /// Slot of the root's child descriptor.
    pub root: u32,
    /// Bit 0: contours. Bit 1: start at what the coarse pass found.
    pub flags: u32,
    /// Zero.
    pub padding: [u32; 4],
}

/// [`View::flags`]: contours.
pub const FLAG_CONTOURS: u32 = 1;
/// [`View::flags`]: beam optimization.
pub const FLAG_BEAM: u32 = 2;

/// One ray in octree space: the octree is `[1, 2]³`.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Ray {
    /// Where `t` is 0.
    pub origin: Vec3,
    /// Displacement over `t` = 1.
    pub direction: Vec3,
    /// First `t` of interest, at least 0.
    pub t_min: f32,
    /// Last `t` of interest.
    pub t_max: f32,
    /// Voxels of this size end the ray at `t` = 0 ...
    pub size_at_origin: f32,
    /// ... and this much more per unit of `t`. Both 0: only leaves end it.
    pub size_per_t: f32,
}

impl View {
    /// The view of an octree whose root descriptor is at slot `root`.
    ///
    /// # Errors
    /// An empty picture or one of more than 2^28 pixels, a camera without direction, planes or angle out of range.
    pub fn new(
        camera: &Camera,
        octree_to_mesh: DMat4,
        root: u32,
        (width, height): (u32, u32),
        options: &CastOptions,
    ) -> Result<Self, CastError> {
        let bad = |what: &str| Err(CastError::Camera(what.into()));
        if width == 0 || height == 0 || u64::from(width) * u64::from(height) > 1 << 28 {
            return bad("a picture has between 1 and 2^28 pixels");
        }
        if !(options.max_voxel_pixels >= 0.0 && options.max_voxel_pixels.is_finite()) {
            return bad("the largest voxel is 0 or a positive number of pixels");
        }
        let numbers = [camera.eye, camera.forward, camera.up].concat();
        if numbers.iter().any(|x| !x.is_finite()) {
            return bad("every component is a finite number");
        }
        if !(camera.near > 0.0 && camera.far > camera.near && camera.far.is_finite()) {
            return bad("0 < near < far");
        }
        if !(camera.fov_degrees > 0.0 && camera.fov_degrees < 180.0) {
            return bad("the field of view is between 0 and 180 degrees");
        }
        let Some(forward) = DVec3::from(camera.forward).try_normalize() else { return bad("forward is not zero") };
        let Some(right) = forward.cross(DVec3::from(camera.up)).try_normalize() else {
            return bad("up is not parallel to forward");
        };
        let up = right.cross(forward);
        let mesh_to_octree = octree_to_mesh.inverse();
        let vector = |v: DVec3| mesh_to_octree.transform_vector3(v);
        // Half the extent of the shorter side on the far plane, in mesh units.
        let half = (camera.fov_degrees.to_radians() / 2.0).tan() * camera.far;
        let pixel = 2.0 * half / f64::from(width.min(height));
        let dx = vector(right * pixel);
        let dy = vector(-up * pixel);
        let base = vector(forward * camera.far) - dx * (f64::from(width) / 2.0) - dy * (f64::from(height) / 2.0);
        let origin = mesh_to_octree.transform_point3(DVec3::from(camera.eye)) + DVec3::ONE;
        let view = Self {
            origin: origin.as_vec3().into(),
            t_near: (camera.near / camera.far) as f32,
            base: base.as_vec3().into(),
            pixel_size: dx.cross(dy).length().sqrt() as f32,
            dx: dx.as_vec3().into(),
            max_voxel_pixels: options.max_voxel_pixels,
            dy: dy.as_vec3().into(),
            t_per_depth: (1.0 / vector(forward * camera.far).length()) as f32,
            width,
            height,
            root,
            flags: (u32::from(options.contours) * FLAG_CONTOURS) | (u32::from(options.beam) * FLAG_BEAM),
            padding: [0; 4],
        };
        Ok(view)
    }

    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// Whether contours are clipped against.
    pub fn contours(&self) -> bool {
        self.flags & FLAG_CONTOURS != 0
    }

    /// Whether a coarse pass comes first.
    pub fn beam(&self) -> bool {
        self.flags & FLAG_BEAM != 0
    }

    /// Direction through a point of the picture in pixels.
    pub fn direction(&self, x: f32, y: f32) -> Vec3 {
        let component = |i: usize| mad(self.dy[i], y, mad(self.dx[i], x, self.base[i]));
        Vec3::new(component(0), component(1), component(2))
    }

    /// The ray of a pixel, from the near to the far plane.
    pub fn ray(&self, x: u32, y: u32) -> Ray {
        Ray {
            origin: self.origin.into(),
            direction: self.direction(x as f32 + 0.5, y as f32 + 0.5),
            t_min: self.t_near,
            t_max: 1.0,
            size_at_origin: 0.0,
            size_per_t: self.pixel_size * self.max_voxel_pixels,
        }
    }

    /// Rays of the coarse pass per row and per column: one through each corner of the blocks of [`BEAM_BLOCK`] pixels,
    /// and one more ring around them.
    pub fn coarse_size(&self) -> (u32, u32) {
        (self.width.div_ceil(BEAM_BLOCK) + 3, self.height.div_ceil(BEAM_BLOCK) + 3)
    }

    /// The coarse ray at corner `(i, j)` of the grid of [`coarse_size`](Self::coarse_size).
    ///
    /// It ends at voxels smaller than twice the diagonal of a block: their parents still cover it, so that they
    /// themselves, larger than the diagonal, cannot slip through the grid.
    pub fn coarse_ray(&self, i: u32, j: u32) -> Ray {
        let at = |k: u32| (k as f32 - 1.0) * BEAM_BLOCK as f32;
        Ray {
            origin: self.origin.into(),
            direction: self.direction(at(i), at(j)),
            t_min: self.t_near,
            // Beyond the far plane too: a voxel there may reach in front of it on a neighbouring ray.
            t_max: f32::MAX,
            size_at_origin: 0.0,
            size_per_t: self.pixel_size * COARSE_VOXEL_PIXELS,
        }
    }

    /// What the coarse pass stores for a hit at `t` in a voxel of edge `size`, in octree units.
    ///
    /// A neighbouring ray can enter the same voxel earlier, by its diagonal at most.
    pub fn coarse_start(&self, t: f32, size: f32) -> f32 {
        mad(size * -SQRT_3, self.t_per_depth, t).max(self.t_near)
    }

    /// Where the rays of a pixel may start: the least value of the 4 x 4 corners around its block.
    ///
    /// The paper takes the block's own four corners; that misses a voxel which reaches between them with a corner of its
    /// own. Let a ray of the pixel at `p` hit something in a voxel at which a coarse ray would end: its edge is at least
    /// the diagonal of a block, 1.41 blocks. Its picture holds the picture of its inscribed sphere and, being convex,
    /// every disc between that and `p`: at a distance `x` from `p` one of radius `x / √3`. A disc of radius 0.71 blocks
    /// holds a corner of the grid wherever it lies; it is found at `x` = 1.22 blocks and ends 1.93 blocks from `p`. So
    /// some corner less than two blocks from `p` sees the voxel, and the 4 x 4 corners hold all of these.
    pub fn beam_start(&self, coarse: &[f32], x: u32, y: u32) -> f32 {
        let (i, j) = (x / BEAM_BLOCK, y / BEAM_BLOCK);
        let columns = self.coarse_size().0;
        let mut start = 1.0f32;
        for row in j..j + 4 {
            for column in i..i + 4 {
                start = start.min(coarse[(row * columns + column) as usize]);
            }
        }
        start
    }
}

/// Voxel size in pixels at which the coarse pass ends: twice the diagonal of a block.
pub const COARSE_VOXEL_PIXELS: f32 = BEAM_BLOCK as f32 * 2.0 * std::f32::consts::SQRT_2;

/// √3.
const SQRT_3: f32 = 1.732_050_8;

/// `a * b + c` as every caster computes it.
#[inline(always)]
pub(crate) fn mad(a: f32, b: f32, c: f32) -> f32 {
    a * b + c
}
