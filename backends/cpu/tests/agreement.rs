//! The CPU caster against the reference where the checks of `conformance.rs` do not look: beams, extreme numbers.

use std::sync::Arc;

use esvo_core::testing::compare::Comparison;
use esvo_core::testing::sample::{Sample, cameras, options};
use esvo_core::{CastError, CastOptions, Caster, View};
use esvo_cpu::{CpuCaster, InstructionSet};
use esvo_format::Octree;

fn sample(sample: Sample) -> Arc<Octree> {
    sample.octree().expect("the sample assembles")
}

#[test]
fn the_beam_changes_no_hit() {
    let mut caster = CpuCaster::new(None).unwrap();
    for octree in [Sample::plain(8, true), Sample::plain(7, false)].map(sample) {
        caster.load(&octree).unwrap();
        let (mut with, mut without) = (Vec::new(), Vec::new());
        let mut iterations = [[0u64; 2]; 2];
        for camera in cameras() {
            for options in options().into_iter().filter(|o| o.beam) {
                let size = (203, 150);
                let view = |options| View::new(&camera, octree.octree_to_mesh(0), 2, size, &options).unwrap();
                caster.cast(&view(CastOptions { beam: false, ..options }), &mut without).unwrap();
                for wide in [false, true] {
                    caster.cast(&view(options).with_wide_beam(wide), &mut with).unwrap();
                    let comparison = Comparison::of(&with, &without);
                    assert_eq!(comparison.mismatches(), 0, "{options:?}, wide {wide}, {camera:?}: {comparison:?}");
                    for (total, hits) in iterations[usize::from(wide)].iter_mut().zip([&with, &without]) {
                        *total += hits.iter().map(|h| u64::from(h.iterations)).sum::<u64>();
                    }
                }
            }
        }
        // Wide blocks save little in so small a picture.
        let [[with, without], [with_wide, _]] = iterations;
        assert!(with < without, "the beam must save iterations: {with}, {without}");
        assert!(with_wide != without && with_wide != with, "wide blocks have starts of their own");
    }
}

/// Numbers of all magnitudes in every place of a view: what is finite is cast and agrees, the rest is refused.
#[test]
fn extreme_views_end_and_agree() {
    let octree = sample(Sample::plain(6, true));
    let mut rays = 0;
    for instructions in InstructionSet::available() {
        let mut caster = CpuCaster::with_instructions(Some(2), instructions).unwrap();
        caster.load(&octree).unwrap();
        let mut reference = esvo_core::reference::ReferenceCaster::default();
        reference.load(&octree).unwrap();
        let options = CastOptions { max_voxel_pixels: 0.0, ..CastOptions::default() };
        let base = View::new(&cameras()[0], octree.octree_to_mesh(0), 2, (16, 12), &options).unwrap();
        let numbers = [0.0, -0.0, 1e-42, 1e-30, 1.0, 1.5, 2.0, 1e6, 1e30, f32::MAX, f32::MIN, f32::INFINITY, f32::NAN];
        let (mut ours, mut theirs) = (Vec::new(), Vec::new());
        for a in numbers {
            for b in numbers {
                for view in [
                    View { base: [a, b, 1.0], ..base },
                    View { origin: [1.5, a, b], ..base },
                    View { base: [-1.0, a, 0.0], dx: [0.0; 3], dy: [0.0, b, 0.0], ..base },
                    View { origin: [a, 1.25, 1.5], base: [0.0, 0.0, b], dx: [0.0; 3], dy: [0.0; 3], ..base },
                ] {
                    let result = caster.cast(&view, &mut ours);
                    if !(a.is_finite() && b.is_finite()) {
                        assert!(matches!(result, Err(CastError::View(_))), "{view:?}: {result:?}");
                        continue;
                    }
                    result.unwrap();
                    reference.cast(&view, &mut theirs).unwrap();
                    let comparison = Comparison::of(&ours, &theirs);
                    assert_eq!(comparison.mismatches(), 0, "{view:?}: {comparison:?}");
                    assert!(ours.iter().all(|hit| !hit.raw_t.is_nan()), "{view:?}");
                    rays += comparison.rays;
                }
            }
        }
        assert!(rays > 90_000);
    }
}
