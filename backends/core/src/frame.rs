//! From a camera to rays in octree space.

use bytemuck::{Pod, Zeroable};
use glam::{DMat4, DVec3, Vec3};
use serde::{Deserialize, Serialize};

use crate::{Camera, CastError, Ray};

/// How a frame is cast.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CastOptions {
    /// Clip voxels by their contours; otherwise they are cubes.
    pub contours: bool,
    /// Beam optimization (paper section 4.2): a coarse pass finds where rays may start. Has no effect on views in which it could
    /// change hits: of octrees that are smaller than a few blocks of pixels, or whose transform does not keep pixels square.
    pub beam: bool,
    /// Rays end at voxels that are at most this many pixels large where the ray leaves them (paper section 4.1). At least
    /// 0; 0 casts down to the leaves.
    pub max_voxel_pixels: f32,
}

impl CastOptions {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`CastError::Camera`]: `max_voxel_pixels` is NaN, infinite or below 0.
    pub fn check(&self) -> Result<(), CastError> {
        let pixels = self.max_voxel_pixels;
        if !(pixels >= 0.0 && pixels.is_finite()) {
            let what = format!("max_voxel_pixels is {pixels}; it must be a finite number, at least 0");
            return Err(CastError::Camera(what));
        }
        Ok(())
    }
}

impl Default for CastOptions {
    /// The paper's settings: contours, no beam, one pixel.
    fn default() -> Self {
        Self { contours: true, beam: false, max_voxel_pixels: 1.0 }
    }
}

/// Edge of a block of the coarse pass in pixels.
pub const BEAM_BLOCK: u32 = 4;
/// Edge of a block of the coarse pass in pixels with [`FLAG_WIDE_BEAM`].
pub const WIDE_BEAM_BLOCK: u32 = 8;

/// Most pixels of a picture.
pub const MAX_PIXELS: u64 = 1 << 28;

/// The rays of one frame, as the kernels take them: the uniform buffer of the GPU kernels, 96 bytes. A test compares it
/// with the kernel's struct of the same name.
///
/// The octree is the cube `[1, 2]³`. The ray of pixel `(x, y)`, `(0, 0)` on the top left, starts at `origin` and has the
/// direction `base + (x + 0.5) dx + (y + 0.5) dy`; `t = 1` is the far plane, so `t` is depth over far depth.
///
/// [`new`](Self::new) makes one from a camera. Whoever fills it by hand can ask [`check`](Self::check), as
/// [`Caster::cast`](crate::Caster::cast) does: every number is finite.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Debug, Pod, Zeroable)]
pub struct View {
    /// The eye, in octree space.
    pub origin: [f32; 3],
    /// `t` at the near plane, at least 0.
    pub t_near: f32,
    /// Direction to the top-left corner of the picture.
    pub base: [f32; 3],
    /// Edge of a pixel on the far plane in octree units, at least 0; at `t` it is `t` times as long.
    pub pixel_size: f32,
    /// Direction per pixel to the right.
    pub dx: [f32; 3],
    /// Voxels of at most this many pixels end a ray, at least 0; 0: only leaves do.
    pub max_voxel_pixels: f32,
    /// Direction per pixel downwards.
    pub dy: [f32; 3],
    /// `t` per octree unit of depth, at least 0.
    pub t_per_depth: f32,
    /// Width of the picture in pixels, at least 1; width times height is at most [`MAX_PIXELS`].
    pub width: u32,
    /// Height of the picture in pixels, at least 1.
    pub height: u32,
    /// Slot of the root's child descriptor: the root slot of one of the octree's objects.
    pub root: u32,
    /// [`FLAG_CONTOURS`], [`FLAG_BEAM`] and [`FLAG_WIDE_BEAM`]; the other bits are 0.
    pub flags: u32,
    /// First row of the band that one dispatch of a GPU kernel casts (see [`band_view`](crate::gpu::kernel::band_view)).
    /// 0 in the view of a whole picture, which is what callers pass.
    pub first_row: u32,
    /// Zero: WGSL rounds the size up to a multiple of 16 bytes.
    pub padding: [u32; 3],
}

/// Bit of [`View::flags`]: clip voxels by their contours.
pub const FLAG_CONTOURS: u32 = 1;
/// Bit of [`View::flags`]: beam optimization, so that rays start where the coarse pass found that nothing comes before.
pub const FLAG_BEAM: u32 = 2;
/// Bit of [`View::flags`], read with [`FLAG_BEAM`]: blocks of the coarse pass are [`WIDE_BEAM_BLOCK`] pixels wide and high. Its
/// rays are a quarter as many, but end at voxels that are twice as large.
pub const FLAG_WIDE_BEAM: u32 = 4;

impl View {
    /// The view of an octree whose root descriptor is at slot `root`.
    ///
    /// # Errors
    /// A picture without pixels or with more than [`MAX_PIXELS`], a camera or an option out of its range.
    pub fn new(
        camera: &Camera,
        octree_to_mesh: DMat4,
        root: u32,
        (width, height): (u32, u32),
        options: &CastOptions,
    ) -> Result<Self, CastError> {
        check_size(width, height)?;
        options.check()?;
        let [right, up, forward] = camera.axes()?;
        let mesh_to_octree = octree_to_mesh.inverse();
        let vector = |v: DVec3| mesh_to_octree.transform_vector3(v);
        // Half the extent of the shorter side on the far plane, in mesh units.
        let half = (camera.fov_degrees.to_radians() / 2.0).tan() * camera.far;
        let pixel = 2.0 * half / f64::from(width.min(height));
        let dx = vector(right * pixel);
        let dy = vector(-up * pixel);
        let base = vector(forward * camera.far) - dx * (f64::from(width) / 2.0) - dy * (f64::from(height) / 2.0);
        let origin = mesh_to_octree.transform_point3(DVec3::from(camera.eye)) + DVec3::ONE;
        let beam = options.beam && beam_is_safe(origin, base, dx, dy);
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
            flags: (u32::from(options.contours) * FLAG_CONTOURS) | (u32::from(beam) * FLAG_BEAM),
            first_row: 0,
            padding: [0; 3],
        };
        Ok(view)
    }

    /// Checks everything but the root, which only the loaded octree can tell.
    ///
    /// # Errors
    /// [`CastError::View`]: a picture without pixels or with more than [`MAX_PIXELS`]; a number that is NaN, infinite, or
    /// below 0 where the field says at least 0; unknown flags; a `first_row` other than 0.
    pub fn check(&self) -> Result<(), CastError> {
        check_size(self.width, self.height)?;
        let vectors = [("origin", self.origin), ("base", self.base), ("dx", self.dx), ("dy", self.dy)];
        for (name, vector) in vectors {
            if !Vec3::from(vector).is_finite() {
                return Err(CastError::View(format!("{name} is {vector:?}; every component must be a finite number")));
            }
        }
        let numbers = [
            ("t_near", self.t_near),
            ("pixel_size", self.pixel_size),
            ("max_voxel_pixels", self.max_voxel_pixels),
            ("t_per_depth", self.t_per_depth),
        ];
        for (name, number) in numbers {
            if !(number >= 0.0 && number.is_finite()) {
                return Err(CastError::View(format!("{name} is {number}; it must be a finite number, at least 0")));
            }
        }
        if self.flags & !(FLAG_CONTOURS | FLAG_BEAM | FLAG_WIDE_BEAM) != 0 {
            let what = "its bits are 1, contours, 2, beam, and 4, wide blocks of the beam";
            return Err(CastError::View(format!("flags is {:#x}; {what}", self.flags)));
        }
        if self.first_row != 0 {
            return Err(CastError::View(format!("first_row is {}; it must be 0: only engines set it", self.first_row)));
        }
        Ok(())
    }

    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// Whether contours are clipped against.
    pub fn contours(&self) -> bool {
        self.flags & FLAG_CONTOURS != 0
    }

    /// Whether a coarse pass runs before the main pass.
    pub fn beam(&self) -> bool {
        self.flags & FLAG_BEAM != 0
    }

    /// Edge of a block of the coarse pass in pixels.
    pub fn beam_block(&self) -> u32 {
        if self.flags & FLAG_WIDE_BEAM != 0 { WIDE_BEAM_BLOCK } else { BEAM_BLOCK }
    }

    /// The same view, with or without wide blocks of the coarse pass.
    pub fn with_wide_beam(self, wide: bool) -> Self {
        Self { flags: (self.flags & !FLAG_WIDE_BEAM) | (u32::from(wide) * FLAG_WIDE_BEAM), ..self }
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

    /// Rays of the coarse pass per row and per column: one through each corner of the [blocks](Self::beam_block), and
    /// one ring more around the picture.
    pub fn coarse_size(&self) -> (u32, u32) {
        let block = self.beam_block();
        (self.width.div_ceil(block) + 3, self.height.div_ceil(block) + 3)
    }

    /// The coarse ray at corner `(i, j)` of the grid of [`coarse_size`](Self::coarse_size).
    ///
    /// It ends at voxels smaller than twice the diagonal of a block. Such a voxel is the first that is small enough, so that
    /// it is still larger than the diagonal and cannot lie between the rays of the grid.
    pub fn coarse_ray(&self, i: u32, j: u32) -> Ray {
        let at = |k: u32| (k as f32 - 1.0) * self.beam_block() as f32;
        Ray {
            origin: self.origin.into(),
            direction: self.direction(at(i), at(j)),
            t_min: self.t_near,
            // Continues beyond the far plane: on a neighbouring ray, a voxel there may reach in front of it.
            t_max: f32::MAX,
            size_at_origin: 0.0,
            size_per_t: self.pixel_size * (self.beam_block() as f32 * COARSE_VOXEL_BLOCKS),
        }
    }

    /// What the coarse pass stores for a hit at `t` in a voxel of edge `size`, in octree units.
    ///
    /// A neighbouring ray can enter the same voxel earlier, but not by more than its diagonal.
    pub fn coarse_start(&self, t: f32, size: f32) -> f32 {
        mad(size * -SQRT_3, self.t_per_depth, t).max(self.t_near)
    }

    /// Where the ray of a pixel may start: the least value of the 4 x 4 corners around its block.
    ///
    /// The paper takes the four corners of the block. That misses a voxel of which only a corner reaches between them. Let a
    /// ray of the pixel at `p` hit something in a voxel at which a coarse ray would end: its edge is at least
    /// the diagonal of a block, 1.41 blocks. Its picture holds the picture of its inscribed sphere and, being convex,
    /// every disc between that and `p`: at a distance `x` from `p` one of radius `x / √3`. A disc of radius 0.71 blocks
    /// holds a corner of the grid wherever it lies; it is found at `x` = 1.22 blocks and ends 1.93 blocks from `p`. So
    /// some corner less than two blocks from `p` sees the voxel, and the 4 x 4 corners hold all of these.
    pub fn beam_start(&self, coarse: &[f32], x: u32, y: u32) -> f32 {
        let (i, j) = (x / self.beam_block(), y / self.beam_block());
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

/// Whether the beam changes no hit of a view: the argument of [`View::beam_start`] holds if pixels are squares in octree space, and
/// if the root cube is wherever it reaches so large that a coarse ray would end at it. A smaller object can lie between the rays of
/// the coarse pass. This leaves room for [wide blocks](FLAG_WIDE_BEAM).
fn beam_is_safe(origin: DVec3, base: DVec3, dx: DVec3, dy: DVec3) -> bool {
    let (across, along) = (dx.length(), dy.length());
    let squares = (across - along).abs() <= 1e-3 * across.max(along) && dx.dot(dy).abs() <= 1e-3 * across * along;
    let normal = dx.cross(dy);
    // `t` at the corner of the root cube that is farthest in depth, where the cube is smallest in pixels.
    let farthest = (0..8)
        .map(|corner: u32| DVec3::from([0, 1, 2].map(|axis| f64::from(1 + (corner >> axis & 1)))))
        .map(|corner| (corner - origin).dot(normal) / base.dot(normal))
        .fold(0.0, f64::max);
    let coarse_voxel = f64::from(WIDE_BEAM_BLOCK) * f64::from(COARSE_VOXEL_BLOCKS) * across.max(along);
    squares && farthest * coarse_voxel <= 1.0
}

/// Whether a picture can have this size.
///
/// # Errors
/// [`CastError::View`]: no pixels, or more than [`MAX_PIXELS`].
pub fn check_size(width: u32, height: u32) -> Result<(), CastError> {
    if width == 0 || height == 0 || u64::from(width) * u64::from(height) > MAX_PIXELS {
        let what = format!("a picture of {width} x {height} pixels; it must have between 1 and 2^28");
        return Err(CastError::View(what));
    }
    Ok(())
}

/// Voxel size in blocks at which the coarse pass ends: twice the diagonal of a block.
pub const COARSE_VOXEL_BLOCKS: f32 = 2.0 * std::f32::consts::SQRT_2;

/// √3.
const SQRT_3: f32 = 1.732_050_8;

/// `a * b + c` as every caster computes it.
#[inline(always)]
pub(crate) fn mad(a: f32, b: f32, c: f32) -> f32 {
    a * b + c
}
