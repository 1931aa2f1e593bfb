//! What the tests share: an open voxelizer, and the exact answer.

use std::collections::BTreeSet;
use std::sync::OnceLock;

use esvo_raster::{Method, Options, RasterError, Surface, Voxelizer, Voxels, bounds, morton_place};
use glam::DVec3;

/// The voxelizer of the tests; `None`, with a line of output, where there is no device and none is required.
pub(crate) fn voxelizer() -> Option<&'static Voxelizer> {
    static OPEN: OnceLock<Option<Voxelizer>> = OnceLock::new();
    OPEN.get_or_init(|| match Voxelizer::open(None) {
        Ok(voxelizer) => Some(voxelizer),
        Err(error) if std::env::var_os("ESVO_REQUIRE_GPU").is_some() => panic!("{error}"),
        Err(error) => {
            println!("skipped: {error}");
            None
        }
    })
    .as_ref()
}

/// The voxels that a method finds, or `None`, with a line of output, where the device lacks what it needs.
pub(crate) fn found(voxelizer: &Voxelizer, corners: &[[DVec3; 3]], level: u32, method: Method) -> Option<Voxels> {
    match voxelizer.voxelize(&Surface { corners, looks: None }, &Options::new(level, method)) {
        Ok(voxels) => Some(voxels),
        Err(RasterError::Lacks { method, device, lacks }) => {
            static SAID: OnceLock<()> = OnceLock::new();
            SAID.get_or_init(|| println!("{method} left out: {device} {lacks}"));
            None
        }
        Err(error) => panic!("{method}: {error}"),
    }
}

/// The voxels that the closed triangles meet, by double precision.
pub(crate) fn exact(corners: &[[DVec3; 3]], level: u32) -> BTreeSet<u64> {
    bounds::voxels(corners, level).into_iter().collect()
}

/// Whether some triangle is so close to meeting this voxel, or to missing it, that single precision cannot say.
pub(crate) fn is_within_bound(corners: &[[DVec3; 3]], level: u32, code: u64) -> bool {
    let scale = f64::from(1u32 << level);
    let cell = morton_place(code).map(i64::from);
    corners.iter().any(|triangle| bounds::may_differ(&triangle.map(|corner| corner * scale), cell))
}

/// Whether some triangle is so close to touching this voxel, or touches it, that the border counts as in the triangle: nearer than a
/// millionth of single precision's bound.
#[allow(dead_code, reason = "not every test needs it")]
pub(crate) fn is_in_border(corners: &[[DVec3; 3]], level: u32, code: u64) -> bool {
    let scale = f64::from(1u32 << level);
    let cell = morton_place(code).map(i64::from);
    let over_bound =
        |triangle: &[DVec3; 3]| bounds::separation(&triangle.map(|corner| corner * scale), cell).over_bound;
    corners.iter().any(|triangle| over_bound(triangle).abs() < 1e-6)
}
