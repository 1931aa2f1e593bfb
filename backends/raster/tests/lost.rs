//! A device that is lost before a call or in the middle of one.

use std::sync::atomic::{AtomicU32, Ordering};

use esvo_device::{DeviceError, Gpu};
use esvo_raster::{Method, Options, Pair, RasterError, Surface, Voxelizer, bounds};
use glam::DVec3;

/// A voxelizer of its own for each test, since others go on with theirs.
fn open() -> Option<Voxelizer> {
    match Voxelizer::open(None) {
        Err(error) if std::env::var_os("ESVO_REQUIRE_GPU").is_none() => {
            println!("skipped: {error}");
            None
        }
        opened => Some(opened.unwrap()),
    }
}

/// Walls in borders of voxels, which single precision cannot decide, and a slope.
fn corners() -> Vec<[DVec3; 3]> {
    let p = DVec3::new;
    vec![
        [p(0.25, 0.125, 0.125), p(0.25, 0.875, 0.25), p(0.25, 0.5, 0.75)],
        [p(0.1, 0.2, 0.3), p(0.9, 0.3, 0.4), p(0.5, 0.8, 0.7)],
    ]
}

fn is_lost<T: std::fmt::Debug>(voxelizer: &Voxelizer, what: &str, result: Result<T, RasterError>) {
    let error = result.expect_err(what);
    let named = matches!(&error, RasterError::Device(DeviceError::Lost { device, .. }) if *device == voxelizer.gpu().about().name);
    assert!(named, "{what}: {error:?}");
    let text = error.to_string();
    assert!(
        text.contains("the device is lost") && text.contains("open it again") && !text.contains('\n'),
        "{what}: {text}"
    );
}

#[test]
fn every_call_on_a_lost_device_says_so() {
    let corners = corners();
    let surface = Surface { corners: &corners, looks: None };
    for method in Method::ALL {
        let Some(voxelizer) = open() else { return };
        if matches!(voxelizer.check(method), Err(RasterError::Lacks { .. })) {
            continue;
        }
        let options = Options::new(4, method);
        // It works, so that what comes later is the loss.
        let codes = voxelizer.voxelize(&surface, &options).unwrap().codes;
        assert!(!codes.is_empty(), "{method}");
        voxelizer.gpu().device().destroy();
        is_lost(&voxelizer, method.name(), voxelizer.voxelize(&surface, &options));
        is_lost(&voxelizer, "check", voxelizer.check(method));
        is_lost(&voxelizer, "cracks", voxelizer.cracks(&surface, &options, &codes));
        is_lost(&voxelizer, "pixels", voxelizer.pixels(&surface, &options));
    }
}

#[test]
fn a_device_that_is_lost_before_the_shaders_are_made() {
    let Some(voxelizer) = open() else { return };
    let name = voxelizer.gpu().about().name.clone();
    let gpu = Gpu::open(Some(&name)).unwrap();
    gpu.device().destroy();
    is_lost(&voxelizer, "new", Voxelizer::new(gpu).map(|_| ()));
}

#[test]
fn a_device_that_is_lost_in_the_middle_gives_no_voxels() {
    // Several tiles, each with something to decide.
    let Some(voxelizer) = open().map(|voxelizer| voxelizer.with_tiles(8)) else { return };
    let corners = corners();
    let surface = Surface { corners: &corners, looks: None };
    let calls = AtomicU32::new(0);
    let meets = |pairs: &[Pair]| -> Vec<bool> {
        let scale = 32.0;
        let of = |pair: &Pair| {
            bounds::meets(&corners[pair.triangle as usize].map(|corner| corner * scale), pair.cell.map(i64::from))
        };
        pairs.iter().map(of).collect()
    };
    let decide = |pairs: &[Pair]| {
        // In the second of the tiles that have something to decide.
        if !pairs.is_empty() && calls.fetch_add(1, Ordering::Relaxed) == 1 {
            voxelizer.gpu().device().destroy();
        }
        meets(pairs)
    };
    let options = Options { decide: Some(&decide), ..Options::new(5, Method::Compute) };
    is_lost(&voxelizer, "compute", voxelizer.voxelize(&surface, &options));
    assert_eq!(calls.load(Ordering::Relaxed), 2);
}
