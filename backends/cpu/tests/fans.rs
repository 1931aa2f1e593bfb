//! Bundles of rays: every instruction set finds in them what the reference finds.

use esvo_core::reference::ReferenceCaster;
use esvo_core::testing::sample::Sample;
use esvo_core::{CastError, Caster, Fan, Fans, Hit};
use esvo_cpu::{CpuCaster, InstructionSet};
use glam::{Mat3, Vec3};

#[test]
fn fans_of_any_number_of_rays_are_the_reference_s() {
    let octree = Sample::scattered(7, true).octree().unwrap();
    let root = octree.objects()[0].root_slot as u32;
    let fans: Vec<Fan> = (0..70)
        .map(|i| Fan {
            origin: Vec3::splat(1.5) + Vec3::new(0.004, -0.0033, 0.0027) * i as f32,
            axes: Mat3::from_rotation_x(i as f32) * 0.4,
        })
        .collect();
    let mut reference = ReferenceCaster::default();
    reference.load(&octree).unwrap();
    for instructions in InstructionSet::available() {
        let mut caster = CpuCaster::with_instructions(Some(2), instructions).unwrap();
        let nothing = Fans { root, contours: true, fans: &fans, directions: &[] };
        assert!(matches!(caster.cast_fans(&nothing, &mut Vec::new()), Err(CastError::NotLoaded)));
        caster.load(&octree).unwrap();
        for rays in [0, 1, 15, 16, 17, 100, 5000] {
            let directions: Vec<Vec3> = (0..rays).map(|i| Vec3::new((i as f32).sin(), 0.3, (i as f32).cos())).collect();
            for contours in [false, true] {
                let fans = Fans { root, contours, fans: &fans, directions: &directions };
                let (mut ours, mut theirs) = (Vec::new(), Vec::new());
                caster.cast_fans(&fans, &mut ours).unwrap();
                reference.cast_fans(&fans, &mut theirs).unwrap();
                assert!(rays < 100 || theirs.iter().filter(|hit| hit.is_miss()).count() > 100);
                // The iterations of a packet are another number.
                let same = |(a, b): (&Hit, &Hit)| a.raw_t == b.raw_t && a.same_voxel(b);
                let all_same = ours.len() == theirs.len() && ours.iter().zip(&theirs).all(same);
                assert!(all_same, "{instructions}, {rays} rays each, contours {contours}");
                let alone =
                    [InstructionSet::Scalar, InstructionSet::Arrays, InstructionSet::Sse2].contains(&instructions);
                assert!(!alone || ours == theirs, "{instructions}: iterations");
            }
        }
    }
}
