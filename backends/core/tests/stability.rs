//! Hard rays through hard octrees: the reference caster is right within derived bounds, and the oracle sees what is not.

use esvo_core::reference::cast_ray;
use esvo_core::testing::directed::{DATA_SETS, DataSet, Kind, Target, data_sets, leaks, ray, sphere};
use esvo_core::testing::oracle::{Mistake, Oracle};
use esvo_core::{Hit, Ray};
use glam::Vec3;

/// Rays of each octree and kind. `esvo bench stability` casts more.
const COUNT: u64 = 300;

fn root(set: &DataSet) -> u32 {
    set.octree.objects()[0].root_slot as u32
}

#[test]
fn the_reference_is_right_within_the_bounds() {
    let sets = data_sets().unwrap();
    assert_eq!(sets.iter().map(|set| set.name).collect::<Vec<_>>(), DATA_SETS);
    for set in sets {
        let oracle = Oracle::new(&set.octree, 0);
        let target = Target::of(&set.octree, 10_000);
        for contours in [false, true] {
            let (mut hits, mut worst) = (0, 0.0f64);
            for (kind, number) in Kind::ALL.into_iter().flat_map(|kind| (0..COUNT).map(move |number| (kind, number))) {
                let ray = ray(kind, &target, number);
                let hit = cast_ray(&set.octree, root(&set), &ray, contours);
                match oracle.judge(&ray, contours, &hit) {
                    Ok(right) => worst = worst.max(right.error),
                    Err(mistake) => panic!("{} {} {number}: {mistake}: {ray:?}", set.name, kind.name()),
                }
                hits += u64::from(!hit.is_miss());
            }
            // Rays that hit nothing and bounds that are far too wide test nothing.
            assert!(hits > COUNT / 4 && worst > 0.05 && worst <= 1.0, "{}: {hits} hits, {worst}", set.name);
        }
    }
}

#[test]
fn no_ray_leaves_a_closed_shell() {
    let octree = sphere(6).unwrap();
    let root = octree.objects()[0].root_slot as u32;
    let target = Target::of(&octree, 100_000);
    for number in 0..20_000 {
        let ray = leaks(&target, number);
        assert!(!cast_ray(&octree, root, &ray, false).is_miss(), "{number}: {ray:?}");
    }
}

#[test]
fn the_oracle_notices_mistakes() {
    type Wrong = fn(&Ray, Hit) -> Hit;
    let wrong: [(&str, Wrong); 5] = [
        ("another child", |_, hit| Hit { voxel: hit.voxel ^ 1, ..hit }),
        ("a miss", |_, hit| Hit::miss(hit.iterations)),
        ("t", |_, hit| Hit { raw_t: hit.raw_t + 1e-4 * (1.0 + hit.raw_t.abs()), ..hit }),
        ("NaN", |_, hit| Hit { raw_t: f32::NAN, ..hit }),
        ("too many iterations", |_, hit| Hit { iterations: 1 << 19, ..hit }),
    ];
    let sets = data_sets().unwrap();
    for (what, wrong) in wrong {
        let (mut caught, mut all) = (0, 0);
        for set in sets.iter().filter(|set| set.octree.needs().levels < 10) {
            let oracle = Oracle::new(&set.octree, 0);
            let target = Target::of(&set.octree, 10_000);
            for number in 0..COUNT {
                let ray = ray(Kind::Plain, &target, number);
                let hit = cast_ray(&set.octree, root(set), &ray, true);
                if !hit.is_miss() {
                    all += 1;
                    caught += u64::from(oracle.judge(&ray, true, &wrong(&ray, hit)).is_err());
                }
            }
        }
        // A neighbour that the ray touches within the bounds is no mistake.
        assert!(all > 1000 && caught * 100 > all * 95, "{what}: {caught} of {all}");
    }
}

#[test]
fn rays_that_must_not_be_cast_must_miss() {
    let set = &data_sets().unwrap()[0];
    let oracle = Oracle::new(&set.octree, 0);
    let ray = Ray::new(Vec3::splat(f32::NAN), Vec3::X);
    assert_eq!(oracle.judge(&ray, true, &Hit::new(0.5, root(set), 5, 22, 1)), Err(Mistake::NotCast));
    assert!(oracle.judge(&ray, true, &Hit::miss(0)).is_ok());
}

/// Casts one ray through an octree of the suite; it must hit, and be right.
fn hits(set: &str, ray: Ray) -> f32 {
    let sets = data_sets().unwrap();
    let set = sets.iter().find(|known| known.name == set).unwrap();
    let hit = cast_ray(&set.octree, root(set), &ray, false);
    Oracle::new(&set.octree, 0).judge(&ray, false, &hit).unwrap();
    hit.t().expect("it hits")
}

fn cast(origin: [f32; 3], direction: [f32; 3]) -> Ray {
    Ray::new(origin.into(), direction.into())
}

/// POP read a frame that PUSH had not written, since two planes had the same `t`: each of these rays missed.
#[test]
fn planes_with_the_same_t_lose_no_voxel() {
    hits("chains", cast([1.779_990_6, 1.302_970_4, 1.365_225_7], [0.0, 0.584_728_7, 0.703_364_85]));
    hits("chains", cast([21754.62, -19263.04, -3177.8394], [-21753.5, 19264.436, 3179.7659]));
    hits("sparse", cast([-417.66525, 1.6129375, -45.23584], [714.40295, -1.0, 79.35393]));
}

/// ADVANCE took the `t` of a plane that the ray had crossed before: these hits were before the ray's span, or before the
/// plane by which it enters the voxel.
#[test]
fn t_does_not_go_back() {
    let ray = cast([1.3698479, 2.0841415, 1.283301], [-1.7868137, -7.3345304, 2.9213977]);
    assert!(hits("full", Ray { t_min: 0.102_051_996, t_max: 1.0, ..ray }) >= 0.102_051_996);
    // The root begins at x = 1, which the ray crosses at 0.096.
    assert!(hits("checkers", cast([0.8889695, 1.0755838, 1.4843749], [1.1562438, 1e-20, 1.788_139_3e-7])) > 0.095);
}
