//! The kernel against the reference caster, on whatever device there is.

use std::sync::Arc;

use esvo_core::compare::Comparison;
use esvo_core::kernel::CAST_WGSL;
use esvo_core::sample::{Sample, against_reference, cameras, strange_against_reference};
use esvo_core::{CastError, CastOptions, Caster, DeviceKind, Hit, View};
use esvo_format::Octree;
use esvo_wgpu::{GpuOptions, WgpuCaster};

/// A caster, or `None` where there is no device and none is demanded.
fn caster(options: &GpuOptions) -> Option<WgpuCaster> {
    match WgpuCaster::new(options) {
        Ok(caster) => Some(caster),
        Err(error) if std::env::var_os("ESVO_REQUIRE_GPU").is_some() => panic!("{error}"),
        Err(error) => {
            println!("skipped: {error}");
            None
        }
    }
}

/// A software driver rounds as the reference does and must agree in every ray and every bit. A GPU's compiler may fuse
/// multiplications with additions and its division need not be exact: 1 ray in 100,000 may end elsewhere.
fn assert_agrees(caster: &WgpuCaster, comparison: Comparison) {
    let (share, ulps) = if caster.device().kind == DeviceKind::SoftwareGpu { (0.0, 0) } else { (1e-5, 1 << 12) };
    assert!(comparison.within(share, ulps), "{}: {comparison:?}", caster.device().name);
    assert!(comparison.rays > 0);
}

fn sample(sample: Sample) -> Arc<Octree> {
    sample.octree().expect("the sample assembles")
}

#[test]
fn finds_what_the_reference_finds() {
    let Some(mut caster) = caster(&GpuOptions::default()) else { return };
    for octree in [Sample::plain(7, true), Sample::plain(6, false), Sample::scattered(7, true)].map(sample) {
        let comparison = against_reference(&mut caster, &octree, (131, 75)).expect("casts");
        assert_agrees(&caster, comparison);
    }
}

#[test]
fn finds_the_same_along_strange_rays() {
    let Some(mut caster) = caster(&GpuOptions::default()) else { return };
    for octree in [Sample::plain(7, true), Sample::scattered(6, true)].map(sample) {
        let comparison = strange_against_reference(&mut caster, &octree, (32, 24)).expect("casts");
        // Rays that touch planes between voxels go either way where a driver rounds in its own way.
        if caster.device().kind == DeviceKind::SoftwareGpu {
            assert_agrees(&caster, comparison);
        }
    }
}

#[test]
fn finds_the_same_in_an_octree_split_over_bindings() {
    let octree = sample(Sample::scattered(6, true));
    let part = (octree.slots().len() * 8 / 3) as u64;
    let Some(mut caster) = caster(&GpuOptions { max_part_bytes: Some(part), ..GpuOptions::default() }) else { return };
    let comparison = against_reference(&mut caster, &octree, (64, 48)).expect("casts");
    assert_agrees(&caster, comparison);
}

#[test]
fn broken_kernels_are_caught() {
    let octree = sample(Sample::scattered(6, true));
    for (right, wrong) in [
        ("if tc_max < h {", "if tc_max > h {"),
        (
            "let crossed = t_corner <= vec3<f32>(tc_max);",
            "let crossed = t_corner < vec3<f32>(tc_max) + vec3<f32>(1e-3);",
        ),
        ("if CONTOURS {", "if CONTOURS && false {"),
        ("if FAR_POINTERS {", "if FAR_POINTERS && scale < 20u {"),
        ("if tc_max * ray.size_per_t >= size {", "if tc_max * ray.size_per_t > size * 1.5 {"),
        ("t_max = stack_t_max[scale - LOWEST_SCALE];", "t_max = 1.0;"),
    ] {
        assert!(CAST_WGSL.contains(right), "{right}");
        let kernel = Some(CAST_WGSL.replace(right, wrong));
        let Some(mut caster) = caster(&GpuOptions { kernel, ..GpuOptions::default() }) else { return };
        let comparison = against_reference(&mut caster, &octree, (64, 48)).expect("casts");
        assert!(!comparison.within(1e-5, 1 << 12), "{wrong}: {comparison:?}");
    }
}

#[test]
fn errors_are_values() {
    let Some(mut caster) = caster(&GpuOptions::default()) else { return };
    let octree = sample(Sample::plain(3, false));
    let view = |size| View::new(&cameras()[0], octree.octree_to_mesh(0), 2, size, &CastOptions::default());
    let view_of = |size| view(size).expect("the view is valid");
    let mut hits = Vec::new();
    assert!(matches!(caster.cast(&view_of((8, 8)), &mut hits), Err(CastError::NotLoaded)));
    assert_eq!(caster.resident_bytes(), 0);
    caster.load(&octree).expect("loads");
    assert!(caster.resident_bytes() > 0);
    let wide = caster.cast(&view_of((1 << 20, 1)), &mut hits);
    assert!(matches!(&wide, Err(CastError::Device(what)) if what.contains("smaller")), "{wide:?}");
    caster.cast(&view_of((8, 8)), &mut hits).expect("still casts");

    let nobody = WgpuCaster::new(&GpuOptions { adapter: Some("nobody's".into()), ..GpuOptions::default() });
    assert!(matches!(nobody.map(|_| ()), Err(CastError::Device(what)) if what.contains("nobody's")));
    let tiny = GpuOptions { max_part_bytes: Some(64), ..GpuOptions::default() };
    let large = sample(Sample::plain(6, false));
    let refused = WgpuCaster::new(&tiny).and_then(|mut caster| caster.load(&large));
    assert!(matches!(&refused, Err(CastError::Device(what)) if what.contains("fewer levels")), "{refused:?}");
    let nonsense = GpuOptions { kernel: Some("fn cast( {".into()), ..GpuOptions::default() };
    let mut broken = WgpuCaster::new(&nonsense).expect("opens");
    broken.load(&octree).expect("loads");
    assert!(matches!(broken.cast(&view_of((8, 8)), &mut hits), Err(CastError::Device(_))));
}

#[test]
fn times_are_plausible() {
    let Some(mut caster) = caster(&GpuOptions::default()) else { return };
    let octree = sample(Sample::plain(7, true));
    caster.load(&octree).expect("loads");
    for beam in [false, true] {
        let options = CastOptions { beam, ..CastOptions::default() };
        let view = View::new(&cameras()[0], octree.octree_to_mesh(0), 2, (256, 192), &options).expect("is valid");
        caster.time(&view).expect("compiles and warms up");
        let mut mostly_work = caster.device().kind != DeviceKind::SoftwareGpu;
        for _ in 0..10 {
            let start = std::time::Instant::now();
            let time = caster.time(&view).expect("times");
            let wall = start.elapsed();
            assert!(time.total <= wall && time.total.as_nanos() > 0, "{time:?} of {wall:?}");
            assert!(time.coarse <= time.total && (time.coarse.as_nanos() > 0) == beam, "{time:?}");
            mostly_work |= time.total * 4 >= wall;
        }
        // On a busy machine a run may wait longer than it works, but not every time.
        assert!(mostly_work, "the software driver's own times leave most of the time unexplained");
    }
}

#[test]
fn nothing_is_left_of_the_frame_before() {
    let Some(mut caster) = caster(&GpuOptions::default()) else { return };
    let octree = sample(Sample::plain(5, true));
    caster.load(&octree).expect("loads");
    let view = |size| View::new(&cameras()[0], octree.octree_to_mesh(0), 2, size, &CastOptions::default());
    let mut cast = |size| {
        let mut hits = vec![Hit::miss(7); 3];
        caster.cast(&view(size).expect("is valid"), &mut hits).expect("casts");
        hits
    };
    let small = cast((20, 10));
    let large = cast((90, 70));
    assert_eq!((small.len(), large.len()), (200, 6300));
    assert_eq!(cast((20, 10)), small);
}
