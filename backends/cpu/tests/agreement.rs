//! The CPU caster against the reference: equal in every ray and every bit, whatever the instruction set.

use std::sync::Arc;

use esvo_core::testing::compare::Comparison;
use esvo_core::testing::sample::{Sample, against_reference, cameras, options};
use esvo_core::{CastError, CastOptions, Caster, Device, FLAG_CONTOURS, FrameTime, Hit, View};
use esvo_cpu::{CpuCaster, Engine};
use esvo_format::Octree;

fn sample(sample: Sample) -> Arc<Octree> {
    sample.octree().expect("the sample assembles")
}

fn engines() -> impl Iterator<Item = CpuCaster> {
    [Engine::Scalar, Engine::Wide].into_iter().map(|engine| CpuCaster::with_engine(Some(2), engine).unwrap())
}

#[test]
fn every_hit_is_the_reference_s() {
    for mut caster in engines() {
        for octree in [Sample::plain(7, true), Sample::plain(6, false), Sample::scattered(7, true)].map(sample) {
            // Neither side is a multiple of a packet's.
            let comparison = against_reference(&mut caster, &octree, (131, 75)).unwrap();
            assert!(comparison.rays > 300_000);
            assert!(comparison.within(0.0, 0), "{}: {comparison:?}", caster.device().detail);
        }
    }
}

/// Breaks another caster in one way.
struct Broken(CpuCaster, fn(&mut View, &mut Vec<Hit>));

impl Caster for Broken {
    fn name(&self) -> &'static str {
        "broken"
    }

    fn device(&self) -> &Device {
        self.0.device()
    }

    fn load(&mut self, octree: &Arc<Octree>) -> Result<(), CastError> {
        self.0.load(octree)
    }

    fn cast(&mut self, view: &View, hits: &mut Vec<Hit>) -> Result<(), CastError> {
        let mut view = *view;
        self.1(&mut view, &mut Vec::new());
        self.0.cast(&view, hits)?;
        self.1(&mut view, hits);
        Ok(())
    }

    fn time(&mut self, view: &View) -> Result<FrameTime, CastError> {
        self.0.time(view)
    }

    fn resident_bytes(&self) -> u64 {
        self.0.resident_bytes()
    }
}

#[test]
fn broken_casters_are_caught() {
    let octree = sample(Sample::scattered(6, true));
    let ways: [fn(&mut View, &mut Vec<Hit>); 4] = [
        |view, _| view.flags &= !FLAG_CONTOURS,
        |view, _| view.max_voxel_pixels *= 1.5,
        |view, _| view.origin[0] += 1e-3,
        |_, hits| {
            if let Some(hit) = hits.iter_mut().find(|hit| !hit.is_miss()) {
                hit.voxel ^= 1;
            }
        },
    ];
    for (i, way) in ways.into_iter().enumerate() {
        let mut broken = Broken(CpuCaster::new(Some(1)).unwrap(), way);
        let comparison = against_reference(&mut broken, &octree, (64, 48)).unwrap();
        assert!(!comparison.within(0.0, 0), "way {i} is not noticed: {comparison:?}");
    }
}

#[test]
fn the_beam_changes_no_hit() {
    let mut caster = CpuCaster::new(None).unwrap();
    for octree in [Sample::plain(8, true), Sample::plain(7, false)].map(sample) {
        caster.load(&octree).unwrap();
        let (mut with, mut without) = (Vec::new(), Vec::new());
        let mut iterations = [0u64; 2];
        for camera in cameras() {
            for options in options().into_iter().filter(|o| o.beam) {
                let size = (203, 150);
                let view = |options| View::new(&camera, octree.octree_to_mesh(0), 2, size, &options).unwrap();
                caster.cast(&view(options), &mut with).unwrap();
                caster.cast(&view(CastOptions { beam: false, ..options }), &mut without).unwrap();
                let comparison = Comparison::of(&with, &without);
                assert_eq!(comparison.mismatches(), 0, "{options:?}, {camera:?}: {comparison:?}");
                for (total, hits) in iterations.iter_mut().zip([&with, &without]) {
                    *total += hits.iter().map(|h| u64::from(h.iterations)).sum::<u64>();
                }
            }
        }
        assert!(iterations[0] < iterations[1], "the beam must save iterations: {iterations:?}");
    }
}

#[test]
fn extreme_views_end_and_agree() {
    let octree = sample(Sample::plain(6, true));
    let mut rays = 0;
    for mut caster in engines() {
        caster.load(&octree).unwrap();
        let mut reference = esvo_core::reference::ReferenceCaster::default();
        reference.load(&octree).unwrap();
        let options = CastOptions { max_voxel_pixels: 0.0, ..CastOptions::default() };
        let base = View::new(&cameras()[0], octree.octree_to_mesh(0), 2, (16, 12), &options).unwrap();
        let numbers = [0.0, -0.0, 1e-42, 1e-30, 1.0, 1.5, 2.0, 1e6, 1e30, f32::INFINITY, f32::NEG_INFINITY, f32::NAN];
        let (mut ours, mut theirs) = (Vec::new(), Vec::new());
        for a in numbers {
            for b in numbers {
                for view in [
                    View { base: [a, b, 1.0], ..base },
                    View { origin: [1.5, a, b], ..base },
                    View { base: [-1.0, a, 0.0], dx: [0.0; 3], dy: [0.0, b, 0.0], ..base },
                    View { origin: [a, 1.25, 1.5], base: [0.0, 0.0, b], dx: [0.0; 3], dy: [0.0; 3], ..base },
                ] {
                    caster.cast(&view, &mut ours).unwrap();
                    reference.cast(&view, &mut theirs).unwrap();
                    let comparison = Comparison::of(&ours, &theirs);
                    assert_eq!(comparison.mismatches(), 0, "{view:?}: {comparison:?}");
                    assert!(ours.iter().all(|hit| !hit.t.is_nan()), "{view:?}");
                    rays += comparison.rays;
                }
            }
        }
    }
    assert!(rays > 100_000);
}

#[test]
fn nothing_loaded_is_an_error() {
    let mut caster = CpuCaster::new(Some(1)).unwrap();
    let view = View::new(&cameras()[0], glam::DMat4::IDENTITY, 2, (8, 8), &CastOptions::default()).unwrap();
    assert!(matches!(caster.cast(&view, &mut Vec::new()), Err(CastError::NotLoaded)));
    assert!(matches!(caster.time(&view), Err(CastError::NotLoaded)));
}
