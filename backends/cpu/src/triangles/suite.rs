//! The tests of every engine that casts triangles on a GPU: [`triangle_suite!`](crate::triangle_suite).

use esvo_core::exact::{CameraRays, ExactRay};
use esvo_core::gpu::kernel::GpuOptions;
use esvo_core::gpu::slots::SlotsIn;
use esvo_core::gpu::triangles::{Question, TRIANGLES_WGSL, TriangleCaster, TriangleRecord};
use esvo_core::testing::conformance::REQUIRE_GPU;
use esvo_core::{Camera, CastError};

use super::TriangleScene;
use super::testing::{Comparison, MISTAKES, cases, compare};

/// Opens the engine that is tested.
pub type Open = fn(&GpuOptions) -> Result<Box<dyn TriangleCaster>, CastError>;

/// `None` without a device, unless one is demanded.
#[expect(clippy::needless_pass_by_value, reason = "callers make the options for this call")]
fn opened(open: Open, options: GpuOptions) -> Option<Box<dyn TriangleCaster>> {
    match open(&options) {
        Ok(caster) => Some(caster),
        Err(error) if std::env::var_os(REQUIRE_GPU).is_some() => panic!("{error}"),
        Err(error) => {
            eprintln!("skipped: {error}");
            None
        }
    }
}

/// Every hit of every case is the exact caster's, and most rays are decided by the kernel.
///
/// # Panics
/// If it is not so.
pub fn every_hit_is_the_exact_caster_s(open: Open) {
    let Some(mut caster) = opened(open, GpuOptions::default()) else { return };
    let mut all = Comparison::default();
    for case in cases().unwrap() {
        let found = compare(&mut *caster, &case).unwrap();
        println!("{}: {found:?}", case.name);
        assert_eq!(found.different, 0, "{}: {found:?}", case.name);
        // The kernel decides what is not meant to be hard.
        let hard = ["grid", "pile", "without area"].contains(&case.name);
        assert!(hard || found.undecided_pixels * 500 < found.pixels, "{}: {found:?}", case.name);
        all += found;
    }
    assert!(all.undecided * 3 < all.rays && all.hits * 5 > all.rays, "{all:?}");
}

/// The negative control: a kernel with any of several mistakes in it is noticed.
///
/// # Panics
/// If it is not so.
pub fn mistakes_are_noticed(open: Open) {
    let cases = cases().unwrap();
    for (name, right, wrong) in MISTAKES {
        assert_eq!(TRIANGLES_WGSL.matches(right).count(), 1, "{right}");
        let triangles_kernel = Some(TRIANGLES_WGSL.replace(right, wrong));
        let Some(mut caster) = opened(open, GpuOptions { triangles_kernel, ..GpuOptions::default() }) else { return };
        let mut found = cases.iter().map(|case| compare(&mut *caster, case).unwrap());
        assert!(found.any(|found| found.different > 0), "{name}");
    }
}

/// A list of rays that is longer than a dispatch gives the same hits.
///
/// # Panics
/// If it is not so.
pub fn lists_are_split_over_dispatches(open: Open) {
    let Some(mut caster) = opened(open, GpuOptions { max_rays: Some(1000), ..GpuOptions::default() }) else { return };
    let found = compare(&mut *caster, &cases().unwrap()[0]).unwrap();
    assert!(found.different == 0 && found.rays > 20_000, "{found:?}");
}

/// A picture that is cast in bands is that of one band.
///
/// # Panics
/// If it is not so.
pub fn pictures_in_bands_agree(open: Open) {
    let triangles = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]];
    let triangles = TriangleScene::new(vec![triangles]).unwrap().wide();
    let camera = Camera {
        eye: [0.2, 0.1, 3.0],
        forward: [0.0, 0.0, -1.0],
        up: [0.0, 1.0, 0.0],
        fov_degrees: 45.0,
        near: 0.1,
        far: 10.0,
    };
    let rays = CameraRays::new(&camera, (40, 30)).unwrap();
    let cast = |options| {
        let mut caster = opened(open, options)?;
        caster.load(&triangles).unwrap();
        let mut records = Vec::new();
        caster.cast(&rays, &mut records).unwrap();
        caster.time(&rays).unwrap();
        Some(records)
    };
    let Some(whole) = cast(GpuOptions::default()) else { return };
    // Bands of seven rows, and of one.
    for rows in [7, 1] {
        let max_part_bytes = Some(40 * size_of::<TriangleRecord>() as u64 * rows);
        assert_eq!(cast(GpuOptions { max_part_bytes, ..GpuOptions::default() }).as_ref(), Some(&whole));
    }
    let hits = whole.iter().filter(|record| record.triangle == 0).count();
    assert!((100..1100).contains(&hits), "{hits}");
}

/// Nodes and triangles in several bindings, and in textures, give the same hits; so do other workgroups.
///
/// # Panics
/// If it is not so.
pub fn hits_are_the_same_wherever_the_triangles_are(open: Open) {
    let case = &cases().unwrap()[1];
    let bytes = case.scene.wide().triangles.len() as u64 * 48;
    // Three bindings of triangles.
    let split = GpuOptions { max_part_bytes: Some(bytes.next_power_of_two() / 4), ..GpuOptions::default() };
    let within = |slots_in| GpuOptions { slots_in: Some(slots_in), ..GpuOptions::default() };
    let shaped = |workgroup| GpuOptions { workgroup: Some(workgroup), ..GpuOptions::default() };
    for (name, options) in [
        ("several bindings", split),
        ("buffers", within(SlotsIn::Buffers)),
        ("textures", within(SlotsIn::Texture)),
        ("small workgroups", shaped((4, 2))),
        ("large workgroups", shaped((16, 8))),
    ] {
        let Some(mut caster) = opened(open, options) else { return };
        let found = compare(&mut *caster, case).unwrap();
        assert!(found.different == 0 && found.hits > 1000, "{name}: {found:?}");
    }
}

/// Triangles over all bindings or over the memory, and hierarchies deeper than the stack, are refused; those before stay.
///
/// # Panics
/// If it is not so.
pub fn what_does_not_fit_is_refused_before_it_is_copied(open: Open) {
    let triangle = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]];
    let ray = [ExactRay { origin: [0.0, 0.0, 1.0].into(), direction: [0.0, 0.0, -1.0].into(), t_min: 0.0, t_max: 2.0 }];
    let mut records = Vec::new();
    let Some(mut caster) = opened(open, GpuOptions { max_part_bytes: Some(80), ..GpuOptions::default() }) else {
        return;
    };
    assert!(matches!(caster.cast_rays(&ray, Question::Any, &mut records), Err(CastError::NotLoaded)));
    caster.load(&TriangleScene::new(vec![triangle]).unwrap().wide()).unwrap();
    let many = (0..400).map(|k| triangle.map(|[x, y, _]| [x, y, f64::from(k)])).collect();
    let error = caster.load(&TriangleScene::new(many).unwrap().wide()).unwrap_err().to_string();
    assert!(error.contains("bindings of 80 bytes") && error.contains("on the processor"), "{error}");
    // The triangles before are still there.
    caster.cast_rays(&ray, Question::Any, &mut records).unwrap();
    assert_eq!(records[0].triangle, 0);

    let options = GpuOptions { memory_bytes: Some(200), ..GpuOptions::default() };
    let Some(mut caster) = opened(open, options) else { return };
    let error = caster.load(&TriangleScene::new(vec![triangle; 40]).unwrap().wide()).unwrap_err().to_string();
    assert!(error.contains("memory of 200 bytes") && error.contains("on the processor"), "{error}");

    let Some(mut caster) = opened(open, GpuOptions::default()) else { return };
    let error = caster.load(&TriangleScene::new(vec![triangle; 5000]).unwrap().wide()).unwrap_err().to_string();
    assert!(error.contains("stack has 64 frames"), "{error}");
}

/// Makes the tests of an engine that casts triangles: one for each function of this module. `$open` is an [`Open`].
#[macro_export]
macro_rules! triangle_suite {
    ($open:expr) => {
        $crate::triangle_suite! { @tests $open;
            every_hit_is_the_exact_caster_s
            mistakes_are_noticed
            lists_are_split_over_dispatches
            pictures_in_bands_agree
            hits_are_the_same_wherever_the_triangles_are
            what_does_not_fit_is_refused_before_it_is_copied
        }
    };
    (@tests $open:expr; $($test:ident)*) => {
        $(
            #[test]
            fn $test() {
                $crate::triangles::suite::$test($open);
            }
        )*
    };
}
