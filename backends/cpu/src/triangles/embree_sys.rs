//! The few functions of Embree 3 that [`embree`](super::embree) calls, by hand from its C header `rtcore.h` (3.13).

use std::ffi::{c_char, c_int, c_uint, c_void};

/// `RTC_ERROR_NONE`.
pub(super) const ERROR_NONE: c_int = 0;
/// `RTC_GEOMETRY_TYPE_TRIANGLE`.
pub(super) const GEOMETRY_TRIANGLE: c_int = 0;
/// `RTC_BUFFER_TYPE_INDEX`.
pub(super) const BUFFER_INDEX: c_int = 0;
/// `RTC_BUFFER_TYPE_VERTEX`.
pub(super) const BUFFER_VERTEX: c_int = 1;
/// `RTC_FORMAT_UINT3`.
pub(super) const FORMAT_UINT3: c_int = 0x5003;
/// `RTC_FORMAT_FLOAT3`.
pub(super) const FORMAT_FLOAT3: c_int = 0x9003;
/// `RTC_BUILD_QUALITY_HIGH`: surface area heuristic with spatial splits.
pub(super) const QUALITY_HIGH: c_int = 2;
/// `RTC_INTERSECT_CONTEXT_FLAG_COHERENT`.
pub(super) const CONTEXT_COHERENT: c_int = 1;
/// `RTC_INVALID_GEOMETRY_ID`.
pub(super) const INVALID_ID: u32 = u32::MAX;
/// `RTC_DEVICE_PROPERTY_NATIVE_RAY8_SUPPORTED`.
pub(super) const PROPERTY_NATIVE_RAY8: c_int = 33;
/// `RTC_DEVICE_PROPERTY_NATIVE_RAY16_SUPPORTED`.
pub(super) const PROPERTY_NATIVE_RAY16: c_int = 34;

/// `RTCMemoryMonitorFunction`: gets its own pointer, the bytes that are allocated (negative: freed), and whether that has
/// happened already. False cancels the work.
pub(super) type MemoryMonitor = unsafe extern "C" fn(own: *mut c_void, bytes: isize, post: bool) -> bool;

/// What `RTCDevice` points to.
#[repr(C)]
pub(super) struct Device {
    opaque: [u8; 0],
}

/// What `RTCScene` points to.
#[repr(C)]
pub(super) struct Scene {
    opaque: [u8; 0],
}

/// What `RTCGeometry` points to.
#[repr(C)]
pub(super) struct Geometry {
    opaque: [u8; 0],
}

/// `RTCIntersectContext` without the member of `RTC_MIN_WIDTH`, which Debian's build does not have, and with the default
/// instance depth of 1.
#[repr(C)]
pub(super) struct IntersectContext {
    pub(super) flags: c_int,
    pub(super) filter: *const c_void,
    pub(super) instance: [c_uint; 1],
}

/// `RTCRayHit` for `N` = 1, `RTCRayHit8` and `RTCRayHit16` otherwise: `RTCRay` and then `RTCHit`, which are arrays of `N`
/// numbers each and have no padding at these widths. The alignment is that of the widest.
#[repr(C, align(64))]
#[derive(Clone)]
pub(super) struct RayHits<const N: usize> {
    pub(super) origin: [[f32; N]; 3],
    /// Start of the ray.
    pub(super) near: [f32; N],
    pub(super) direction: [[f32; N]; 3],
    /// For motion blur.
    pub(super) time: [f32; N],
    /// End of the ray; after the call where it hits, if it does.
    pub(super) far: [f32; N],
    pub(super) mask: [u32; N],
    pub(super) id: [u32; N],
    /// Reserved, zero.
    pub(super) flags: [u32; N],
    /// Not of unit length.
    pub(super) normal: [[f32; N]; 3],
    pub(super) barycentric: [[f32; N]; 2],
    /// Index of the triangle in its geometry.
    pub(super) primitive: [u32; N],
    /// [`INVALID_ID`] before the call; after it only for a miss.
    pub(super) geometry: [u32; N],
    pub(super) instance: [u32; N],
}

/// Which rays of a packet are cast: those with -1. The others have 0.
#[repr(C, align(64))]
pub(super) struct Valid<const N: usize>(pub(super) [c_int; N]);

#[link(name = "embree3")]
unsafe extern "C" {
    pub(super) fn rtcNewDevice(config: *const c_char) -> *mut Device;
    pub(super) fn rtcReleaseDevice(device: *mut Device);
    pub(super) fn rtcGetDeviceError(device: *mut Device) -> c_int;
    pub(super) fn rtcGetDeviceProperty(device: *mut Device, property: c_int) -> isize;
    pub(super) fn rtcSetDeviceMemoryMonitorFunction(device: *mut Device, monitor: MemoryMonitor, own: *mut c_void);

    pub(super) fn rtcNewGeometry(device: *mut Device, kind: c_int) -> *mut Geometry;
    pub(super) fn rtcReleaseGeometry(geometry: *mut Geometry);
    pub(super) fn rtcCommitGeometry(geometry: *mut Geometry);
    pub(super) fn rtcSetNewGeometryBuffer(
        geometry: *mut Geometry,
        kind: c_int,
        slot: c_uint,
        format: c_int,
        stride: usize,
        count: usize,
    ) -> *mut c_void;

    pub(super) fn rtcNewScene(device: *mut Device) -> *mut Scene;
    pub(super) fn rtcReleaseScene(scene: *mut Scene);
    pub(super) fn rtcSetSceneBuildQuality(scene: *mut Scene, quality: c_int);
    pub(super) fn rtcAttachGeometry(scene: *mut Scene, geometry: *mut Geometry) -> c_uint;
    pub(super) fn rtcCommitScene(scene: *mut Scene);

    pub(super) fn rtcIntersect1(scene: *mut Scene, context: *mut IntersectContext, rays: *mut RayHits<1>);
    pub(super) fn rtcIntersect8(
        valid: *const Valid<8>,
        scene: *mut Scene,
        context: *mut IntersectContext,
        rays: *mut RayHits<8>,
    );
    pub(super) fn rtcIntersect16(
        valid: *const Valid<16>,
        scene: *mut Scene,
        context: *mut IntersectContext,
        rays: *mut RayHits<16>,
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Offsets of `RTCRayHit16`, which the header gives by its order: twelve arrays of the ray, then eight of the hit.
    #[test]
    fn packets_are_laid_out_as_in_the_header() {
        assert_eq!(std::mem::offset_of!(RayHits<1>, far), 32);
        assert_eq!(std::mem::offset_of!(RayHits<1>, normal), 48);
        assert_eq!(std::mem::offset_of!(RayHits<1>, geometry), 72);
        assert_eq!(std::mem::offset_of!(RayHits<16>, far), 8 * 64);
        assert_eq!(std::mem::offset_of!(RayHits<16>, normal), 12 * 64);
        assert_eq!(std::mem::offset_of!(RayHits<16>, geometry), 18 * 64);
        assert_eq!((size_of::<RayHits<8>>(), size_of::<RayHits<16>>()), (20 * 32, 20 * 64));
        assert_eq!(std::mem::offset_of!(IntersectContext, instance), 16);
    }
}
