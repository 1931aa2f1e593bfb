//! The same triangles cast by Embree 3, for comparison: single rays and packets of 8 and 16, build quality high.
//!
//! Needs the feature `embree` and the library (Debian: `libembree-dev`, 3.13). Embree's triangle test is the fast one of Möller and
//! Trumbore in single precision, not its robust one. Rays are marked as coherent.

use std::ffi::{c_int, c_void};
use std::sync::atomic::{AtomicIsize, Ordering};

use esvo_core::CastError;
use esvo_core::exact::{CameraRays, TriangleHit};
use glam::DVec3;
use rayon::prelude::*;

use super::TriangleScene;
use super::bvh::Placement;
use super::embree_sys::{self as sys, IntersectContext, RayHits, Valid};

/// Edge in pixels of the tiles in which rays are cast. The same as that of this crate's own packets.
const EDGE: usize = super::packet::EDGE;

/// Most triangles: Embree's buffers are limited to 16 GB, and a triangle has 36 bytes of corners.
const MAX_TRIANGLES: usize = 1 << 28;

/// How many rays Embree gets at once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EmbreeRays {
    /// One (`rtcIntersect1`).
    Single,
    /// Tiles of 4 x 2 (`rtcIntersect8`).
    Packets8,
    /// Tiles of 4 x 4 (`rtcIntersect16`).
    Packets16,
}

impl EmbreeRays {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Single, Self::Packets8, Self::Packets16];

    /// `single rays`, `packets of 8`, `packets of 16`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Single => "single rays",
            Self::Packets8 => "packets of 8",
            Self::Packets16 => "packets of 16",
        }
    }
}

/// Triangles in a hierarchy of Embree.
pub struct EmbreeScene {
    device: *mut sys::Device,
    scene: *mut sys::Scene,
    placement: Placement,
    /// Triangles, those without area included.
    count: usize,
    /// Bytes that Embree has allocated. Embree adds to it until the device is released.
    allocated: Box<AtomicIsize>,
}

// SAFETY: the pointers are owned by this value alone. Embree's device and scene may be used and released on any thread.
unsafe impl Send for EmbreeScene {}
// SAFETY: the scene is committed before `EmbreeScene::new` returns it and is not changed afterwards. Embree allows any number of
// threads to cast rays at a committed scene, and to ask for properties of a device.
unsafe impl Sync for EmbreeScene {}

impl Drop for EmbreeScene {
    fn drop(&mut self) {
        // SAFETY: each pointer is null or was made by Embree, and is released once. Null is left out.
        unsafe {
            if !self.scene.is_null() {
                sys::rtcReleaseScene(self.scene);
            }
            if !self.device.is_null() {
                sys::rtcReleaseDevice(self.device);
            }
        }
    }
}

impl EmbreeScene {
    /// Builds Embree's hierarchy over the triangles of a scene, on all cores. Corners are the single-precision ones that the fast caster
    /// of `scene` has; triangles without area are kept, so that indices stay.
    ///
    /// # Errors
    /// More than 2^28 triangles, and what Embree reports: a processor that it does not support, or too little memory.
    pub fn new(scene: &TriangleScene) -> Result<Self, CastError> {
        let count = scene.triangles().len();
        if count > MAX_TRIANGLES {
            return Err(CastError::Device(format!(
                "a scene of {count} triangles: Embree takes at most {MAX_TRIANGLES} here; cast fewer at a time"
            )));
        }
        // SAFETY: null stands for the default configuration.
        let device = unsafe { sys::rtcNewDevice(std::ptr::null()) };
        let allocated = Box::new(AtomicIsize::new(0));
        let mut made = Self { device, scene: std::ptr::null_mut(), placement: scene.placement, count, allocated };
        made.check("making a device", device.is_null())?;
        // SAFETY: the device is not null. The number lies in a box, which is dropped after the device is released.
        unsafe {
            let own = std::ptr::from_ref::<AtomicIsize>(&made.allocated).cast_mut().cast();
            sys::rtcSetDeviceMemoryMonitorFunction(device, count_bytes, own);
        }
        // SAFETY: the device is not null.
        made.scene = unsafe { sys::rtcNewScene(device) };
        made.check("making a scene", made.scene.is_null())?;
        if count > 0 {
            made.attach(scene.triangles())?;
        }
        // SAFETY: the scene is not null, and nobody else has it yet.
        unsafe {
            sys::rtcSetSceneBuildQuality(made.scene, sys::QUALITY_HIGH);
            sys::rtcCommitScene(made.scene);
        }
        made.check("building a hierarchy", false)?;
        Ok(made)
    }

    /// Makes a geometry of the triangles and adds it to the scene, which keeps it.
    fn attach(&self, triangles: &[[DVec3; 3]]) -> Result<(), CastError> {
        let count = triangles.len();
        // SAFETY: the device is not null.
        let geometry = unsafe { sys::rtcNewGeometry(self.device, sys::GEOMETRY_TRIANGLE) };
        self.check("making a geometry", geometry.is_null())?;
        // SAFETY: the geometry is not null. The buffers have the formats and numbers of items that triangles need.
        let (corners, indices) = unsafe {
            let corners =
                sys::rtcSetNewGeometryBuffer(geometry, sys::BUFFER_VERTEX, 0, sys::FORMAT_FLOAT3, 12, 3 * count);
            (corners, sys::rtcSetNewGeometryBuffer(geometry, sys::BUFFER_INDEX, 0, sys::FORMAT_UINT3, 12, count))
        };
        let lacking = corners.is_null() || indices.is_null();
        if !lacking {
            let (corners, indices) = (corners.cast::<[[f32; 3]; 3]>(), indices.cast::<[u32; 3]>());
            for (place, triangle) in triangles.iter().enumerate() {
                let first = 3 * place as u32;
                // SAFETY: the buffers have room for 3 * count corners and count triangles, and `place` is below count. Embree
                // aligns buffers to 16 bytes.
                unsafe {
                    corners.add(place).write(triangle.map(|p| self.placement.point(p).as_vec3().into()));
                    indices.add(place).write([first, first + 1, first + 2]);
                }
            }
            // SAFETY: the geometry and the scene are not null, and the buffers are filled.
            unsafe {
                sys::rtcCommitGeometry(geometry);
                sys::rtcAttachGeometry(self.scene, geometry);
            }
        }
        // SAFETY: the geometry is not null. The scene has its own reference.
        unsafe { sys::rtcReleaseGeometry(geometry) };
        self.check("filling a geometry", lacking)
    }

    /// An error if Embree reports one, or if what it was to make is `missing`.
    fn check(&self, doing: &str, missing: bool) -> Result<(), CastError> {
        // SAFETY: null asks for the error of a device that could not be made.
        let code = unsafe { sys::rtcGetDeviceError(self.device) };
        if code == sys::ERROR_NONE && !missing {
            return Ok(());
        }
        let what = match code {
            2 => "invalid argument",
            3 => "invalid operation",
            4 => "out of memory",
            5 => "the processor is not supported",
            6 => "cancelled",
            _ => "unknown error",
        };
        Err(CastError::Device(format!("Embree failed at {doing}: {what} (code {code})")))
    }

    /// Whether Embree casts such packets as they are on this processor, and does not split them.
    pub fn is_native(&self, rays: EmbreeRays) -> bool {
        let property = match rays {
            EmbreeRays::Single => return true,
            EmbreeRays::Packets8 => sys::PROPERTY_NATIVE_RAY8,
            EmbreeRays::Packets16 => sys::PROPERTY_NATIVE_RAY16,
        };
        // SAFETY: the device is not null once `new` has returned it.
        unsafe { sys::rtcGetDeviceProperty(self.device, property) != 0 }
    }

    /// Bytes of the hierarchy with its copies of the triangles: what Embree has allocated, less the buffers of corners and indices,
    /// which casting does not read.
    pub fn resident_bytes(&self) -> u64 {
        let buffers = self.count * (size_of::<[[f32; 3]; 3]>() + size_of::<[u32; 3]>());
        self.allocated.load(Ordering::Relaxed).saturating_sub(buffers as isize).max(0) as u64
    }

    /// Casts a picture as [`TriangleScene::cast`] does, in tiles of 4 x 4 pixels: `hits[y * width + x]`. Resizes `hits`.
    pub fn cast(&self, at_once: EmbreeRays, rays: &CameraRays, hits: &mut Vec<TriangleHit>) {
        hits.resize(rays.pixels(), TriangleHit::MISS);
        if self.count == 0 {
            hits.fill(TriangleHit::MISS);
            return;
        }
        hits.par_chunks_mut(EDGE * rays.width as usize).enumerate().for_each(|(strip, hits)| match at_once {
            EmbreeRays::Single => self.cast_rows::<1>(rays, strip * EDGE, hits),
            EmbreeRays::Packets8 => self.cast_rows::<8>(rays, strip * EDGE, hits),
            EmbreeRays::Packets16 => self.cast_rows::<16>(rays, strip * EDGE, hits),
        });
    }

    /// Casts the rows of a picture from `first_row` on that `hits` has room for.
    fn cast_rows<const N: usize>(&self, rays: &CameraRays, first_row: usize, hits: &mut [TriangleHit])
    where
        RayHits<N>: Intersect,
    {
        let width = rays.width as usize;
        let rows = hits.len() / width;
        let scaled = |v: DVec3| (v * self.placement.scale).as_vec3();
        let (dx, dy) = (scaled(rays.dx), scaled(rays.dy));
        let eye = self.placement.point(rays.origin).as_vec3();
        let mut packet = RayHits::<N> {
            origin: eye.to_array().map(|x| [x; N]),
            near: [rays.t_near as f32; N],
            direction: [[0.0; N]; 3],
            time: [0.0; N],
            far: [1.0; N],
            mask: [u32::MAX; N],
            id: [0; N],
            flags: [0; N],
            normal: [[0.0; N]; 3],
            barycentric: [[0.0; N]; 2],
            primitive: [sys::INVALID_ID; N],
            geometry: [sys::INVALID_ID; N],
            instance: [sys::INVALID_ID; N],
        };
        let mut context =
            IntersectContext { flags: sys::CONTEXT_COHERENT, filter: std::ptr::null(), instance: [sys::INVALID_ID] };
        for row in (0..rows).step_by(EDGE) {
            for column in (0..width).step_by(EDGE) {
                let corner = scaled(rays.direction(column as f64 + 0.5, (first_row + row) as f64 + 0.5));
                for first in (0..EDGE * EDGE).step_by(N) {
                    // Lanes beyond the picture have the rays of pixels beyond it.
                    let pixel = |lane: usize| ((first + lane) % EDGE, (first + lane) / EDGE);
                    if N == 1 && (column + pixel(0).0 >= width || row + pixel(0).1 >= rows) {
                        continue;
                    }
                    for axis in 0..3 {
                        for lane in 0..N {
                            let (x, y) = pixel(lane);
                            packet.direction[axis][lane] = corner[axis] + dx[axis] * x as f32 + dy[axis] * y as f32;
                        }
                    }
                    packet.far = [1.0; N];
                    packet.geometry = [sys::INVALID_ID; N];
                    packet.intersect(self, &mut context);
                    for lane in 0..N {
                        let (x, y) = (column + pixel(lane).0, row + pixel(lane).1);
                        if x < width && y < rows {
                            hits[y * width + x] = if packet.geometry[lane] == sys::INVALID_ID {
                                TriangleHit::MISS
                            } else {
                                TriangleHit { t: f64::from(packet.far[lane]), triangle: packet.primitive[lane] }
                            };
                        }
                    }
                }
            }
        }
    }
}

/// Adds to the count of bytes of an [`EmbreeScene`].
///
/// # Safety
/// `own` points to an [`AtomicIsize`].
unsafe extern "C" fn count_bytes(own: *mut c_void, bytes: isize, _post: bool) -> bool {
    // SAFETY: the caller's promise.
    let allocated = unsafe { &*own.cast::<AtomicIsize>() };
    allocated.fetch_add(bytes, Ordering::Relaxed);
    true
}

/// Rays that Embree casts in one call.
trait Intersect {
    /// Finds the closest hits.
    fn intersect(&mut self, scene: &EmbreeScene, context: &mut IntersectContext);
}

impl Intersect for RayHits<1> {
    #[inline]
    fn intersect(&mut self, scene: &EmbreeScene, context: &mut IntersectContext) {
        // SAFETY: the scene is committed. Context and ray are laid out as the header demands and are borrowed alone.
        unsafe { sys::rtcIntersect1(scene.scene, context, self) }
    }
}

/// Every ray of a packet is cast.
const fn all<const N: usize>() -> Valid<N> {
    Valid([-1 as c_int; N])
}

impl Intersect for RayHits<8> {
    #[inline]
    fn intersect(&mut self, scene: &EmbreeScene, context: &mut IntersectContext) {
        static ALL: Valid<8> = all();
        // SAFETY: as for one ray. Mask and packet are aligned to 64 bytes; 32 are demanded.
        unsafe { sys::rtcIntersect8(&ALL, scene.scene, context, self) }
    }
}

impl Intersect for RayHits<16> {
    #[inline]
    fn intersect(&mut self, scene: &EmbreeScene, context: &mut IntersectContext) {
        static ALL: Valid<16> = all();
        // SAFETY: as for one ray. Mask and packet are aligned to 64 bytes, as demanded.
        unsafe { sys::rtcIntersect16(&ALL, scene.scene, context, self) }
    }
}
