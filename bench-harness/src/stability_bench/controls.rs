//! Mistakes that are made on purpose, which must be caught.

use esvo_core::reference::cast_ray;
use esvo_core::testing::directed::{DataSet, Kind, Target, ray};
use esvo_core::testing::oracle::Oracle;
use esvo_core::{Hit, Ray};

use super::Control;
use super::data::TARGETS;
use super::engines::same;
use crate::BenchError;

/// Rays of each octree and kind that a mistake is made with.
const RAYS: u64 = 200;

/// What is wrong: makes a hit of a ray, by casting it or by changing what was found.
type Mistake = fn(&DataSet, u32, &Ray, Hit) -> Hit;

const MISTAKES: [(&str, bool, Mistake); 7] = [
    ("another child of the same node", true, |_, _, _, hit| Hit { voxel: hit.voxel ^ 1, ..hit }),
    ("a voxel one level above", true, |_, _, _, hit| Hit { voxel: hit.voxel + 0x100, ..hit }),
    ("a miss", true, |_, _, _, hit| Hit::miss(hit.iterations)),
    ("t is off by a thousandth", true, |_, _, _, hit| Hit { raw_t: hit.raw_t * 1.001 + 1e-3, ..hit }),
    ("no contours", true, |set, root, ray, _| cast_ray(&set.octree, root, ray, false)),
    ("t is off by one unit in the last place", false, |_, _, _, hit| Hit { raw_t: hit.raw_t.next_up(), ..hit }),
    // Rays through edges and corners then pass on the other side.
    ("ties are decided otherwise", false, |set, root, ray, _| {
        let origin = ray.origin.map(|x| if x > 1.5 { x.next_up() } else { x.next_down() });
        cast_ray(&set.octree, root, &Ray { origin, ..*ray }, true)
    }),
];

/// Makes each mistake in hits of all octrees, and counts what is caught: by the oracle, or by the comparison with the reference.
pub(super) fn run(sets: &[DataSet]) -> Result<Vec<Control>, BenchError> {
    let mut controls = Vec::new();
    for (what, by_oracle, mistake) in MISTAKES {
        let by = if by_oracle { "oracle" } else { "engines" };
        let mut control = Control { what: what.into(), by: by.into(), cases: 0, caught: 0 };
        for set in sets {
            let oracle = Oracle::new(&set.octree, 0);
            let target = Target::of(&set.octree, TARGETS);
            let root = set.octree.objects()[0].root_slot as u32;
            for kind in [Kind::Plain, Kind::Corners, Kind::Boundaries] {
                for number in 0..RAYS {
                    let ray = ray(kind, &target, number);
                    let right = cast_ray(&set.octree, root, &ray, true);
                    if right.is_miss() {
                        continue;
                    }
                    let wrong = mistake(set, root, &ray, right);
                    control.cases += 1;
                    let caught =
                        if by_oracle { oracle.judge(&ray, true, &wrong).is_err() } else { !same(&wrong, &right) };
                    control.caught += u64::from(caught);
                }
            }
        }
        controls.push(control);
    }
    Ok(controls)
}
