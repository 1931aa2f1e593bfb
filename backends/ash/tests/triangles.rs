//! Triangles: the hits of the exact caster, on whatever device there is.

use esvo_ash::{AshTriangles, GpuOptions};
use esvo_core::CastError;
use esvo_core::exact::ExactRay;
use esvo_core::gpu::triangles::{Question, TRIANGLES_WGSL, TriangleCaster};
use esvo_core::testing::conformance::REQUIRE_GPU;
use esvo_cpu::triangles::TriangleScene;
use esvo_cpu::triangles::testing::{Comparison, MISTAKES, cases, compare};

/// `None` without a device, unless one is demanded.
fn open(options: &GpuOptions) -> Option<AshTriangles> {
    match AshTriangles::new(options) {
        Ok(caster) => Some(caster),
        Err(error) if std::env::var_os(REQUIRE_GPU).is_some() => panic!("{error}"),
        Err(error) => {
            eprintln!("skipped: {error}");
            None
        }
    }
}

#[test]
fn every_hit_is_the_exact_caster_s() {
    let Some(mut caster) = open(&GpuOptions::default()) else { return };
    let mut all = Comparison::default();
    for case in cases().unwrap() {
        let found = compare(&mut caster, &case).unwrap();
        println!("{}: {found:?}", case.name);
        assert_eq!(found.different, 0, "{}: {found:?}", case.name);
        // The kernel decides what is not meant to be hard.
        let hard = ["grid", "pile", "without area"].contains(&case.name);
        assert!(hard || found.undecided_pixels * 500 < found.pixels, "{}: {found:?}", case.name);
        all += found;
    }
    assert!(all.undecided * 3 < all.rays && all.hits * 5 > all.rays, "{all:?}");
}

#[test]
fn mistakes_are_noticed() {
    let cases = cases().unwrap();
    for (name, right, wrong) in MISTAKES {
        assert_eq!(TRIANGLES_WGSL.matches(right).count(), 1, "{right}");
        let triangles_kernel = Some(TRIANGLES_WGSL.replace(right, wrong));
        let Some(mut caster) = open(&GpuOptions { triangles_kernel, ..GpuOptions::default() }) else { return };
        let mut found = cases.iter().map(|case| compare(&mut caster, case).unwrap());
        assert!(found.any(|found| found.different > 0), "{name}");
    }
}

#[test]
fn lists_are_split_over_dispatches() {
    let Some(mut caster) = open(&GpuOptions { max_rays: Some(1000), ..GpuOptions::default() }) else { return };
    let found = compare(&mut caster, &cases().unwrap()[0]).unwrap();
    assert!(found.different == 0 && found.rays > 20_000, "{found:?}");
}

#[test]
fn what_does_not_fit_is_refused_before_it_is_copied() {
    let triangle = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]];
    let ray = [ExactRay { origin: [0.0, 0.0, 1.0].into(), direction: [0.0, 0.0, -1.0].into(), t_min: 0.0, t_max: 2.0 }];
    let mut records = Vec::new();
    let Some(mut caster) = open(&GpuOptions { max_part_bytes: Some(200), ..GpuOptions::default() }) else { return };
    assert!(matches!(caster.cast_rays(&ray, Question::Any, &mut records), Err(CastError::NotLoaded)));
    caster.load(&TriangleScene::new(vec![triangle]).unwrap().wide()).unwrap();
    let many = (0..40).map(|k| triangle.map(|[x, y, _]| [x, y, f64::from(k)])).collect();
    let error = caster.load(&TriangleScene::new(many).unwrap().wide()).unwrap_err().to_string();
    assert!(error.contains("more than a binding of 200 bytes") && error.contains("on the processor"), "{error}");
    // The triangles before are still there.
    caster.cast_rays(&ray, Question::Any, &mut records).unwrap();
    assert_eq!(records[0].triangle, 0);

    let Some(mut caster) = open(&GpuOptions::default()) else { return };
    let error = caster.load(&TriangleScene::new(vec![triangle; 5000]).unwrap().wide()).unwrap_err().to_string();
    assert!(error.contains("stack has 64 frames"), "{error}");
}
