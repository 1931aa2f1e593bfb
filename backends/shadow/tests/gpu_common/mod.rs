//! What the tests on a device share.

use std::sync::OnceLock;

use esvo_device::Gpu;
use esvo_shadow::Volume;
use esvo_shadow::gpu::{GpuVolume, texture_size};

/// The device of the tests; `None`, with a line of output, where there is none and none is required.
pub(crate) fn gpu() -> Option<&'static Gpu> {
    static OPEN: OnceLock<Option<Gpu>> = OnceLock::new();
    OPEN.get_or_init(|| match Gpu::open(None) {
        Ok(gpu) => Some(gpu),
        Err(error) if std::env::var_os("ESVO_REQUIRE_GPU").is_some() => panic!("{error}"),
        Err(error) => {
            println!("skipped: {error}");
            None
        }
    })
    .as_ref()
}

/// Numbers from a seed.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn below(&mut self, end: u32) -> i32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) % u64::from(end)) as i32
    }

    pub(crate) fn between(&mut self, low: i32, high: i32) -> i32 {
        low + self.below((high - low + 1) as u32)
    }

    /// From 0 to 1.
    pub(crate) fn unit(&mut self) -> f64 {
        f64::from(self.below(1 << 30)) / f64::from(1 << 30)
    }
}

/// The first level and byte in which the device's copy is not the volume; what the texture has beyond the volume must be zero.
pub(crate) fn difference(gpu: &Gpu, copy: &GpuVolume, volume: &Volume) -> Option<String> {
    (0..=volume.mips()).find_map(|mip| {
        let (size, bytes) = copy.read_level(gpu, mip).unwrap();
        assert_eq!(size, texture_size(volume.voxels(), volume.mips()).map(|n| (n >> mip) as usize));
        let (within, expected) = volume.level(mip);
        let mut rows = bytes.chunks_exact(size[0]).enumerate();
        rows.find_map(|(i, row)| {
            let (y, z) = (i % size[1], i / size[1]);
            let there = y < within[1] && z < within[2];
            let start = within[0] * (y + within[1] * z);
            let (row, rest) = row.split_at(if there { within[0] } else { 0 });
            let same = !there || row == &expected[start..start + within[0]];
            (!same || rest.iter().any(|&byte| byte != 0)).then(|| format!("mip {mip}, row {y} of layer {z}"))
        })
    })
}
