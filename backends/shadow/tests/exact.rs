//! Rays against fractions of whole numbers: which voxels does a ray touch, and when?

use esvo_shadow::trace::{FRACTION_BITS, Fidelity, Ray, Steps, first_hit, is_blocked};
use esvo_shadow::{Bricks, Occupancy, Volume};
use proptest::prelude::*;

const ONE: i128 = 1 << FRACTION_BITS;
const EDGE: i32 = 8;

/// A fraction with a positive denominator.
#[derive(Clone, Copy, Debug)]
struct Fraction(i128, i128);

impl Fraction {
    fn new(numerator: i128, denominator: i128) -> Self {
        Self(numerator * denominator.signum(), denominator.abs())
    }
    fn less(self, other: Self) -> bool {
        self.0 * other.1 < other.0 * self.1
    }
    fn value(self) -> f64 {
        self.0 as f64 / self.1 as f64
    }
}

/// When the segment from `from` to `from + way` touches a closed voxel first: a fraction of the way.
fn touches(from: [i32; 3], way: [i32; 3], voxel: [i32; 3]) -> Option<Fraction> {
    let (mut enter, mut leave) = (Fraction(0, 1), Fraction(1, 1));
    for axis in 0..3 {
        let (p, d) = (i128::from(from[axis]), i128::from(way[axis]));
        let low = i128::from(voxel[axis]) * ONE;
        let high = low + ONE;
        if d == 0 {
            if p < low || p > high {
                return None;
            }
            continue;
        }
        let (near, far) = if d > 0 { (low, high) } else { (high, low) };
        let (near, far) = (Fraction::new(near - p, d), Fraction::new(far - p, d));
        if enter.less(near) {
            enter = near;
        }
        if far.less(leave) {
            leave = far;
        }
    }
    (!leave.less(enter)).then_some(enter)
}

fn length(way: [i32; 3]) -> f64 {
    way.iter().map(|&d| f64::from(d).powi(2)).sum::<f64>().sqrt() / ONE as f64
}

fn voxels() -> impl Iterator<Item = [i32; 3]> {
    (0..EDGE.pow(3)).map(|i| [i % EDGE, i / EDGE % EDGE, i / EDGE / EDGE])
}

/// Places that are often on planes, edges and corners; directions that are often equal on axes, or zero.
fn segment() -> impl Strategy<Value = ([i32; 3], [i32; 3])> {
    let unit = ONE as i32;
    let place = prop_oneof![
        3 => (-2..=EDGE + 2).prop_map(move |x| x * unit),
        2 => (-4..=2 * EDGE + 4).prop_map(move |x| x * unit / 2),
        2 => -unit..=(EDGE + 1) * unit,
        1 => (0..=EDGE, -1..=1i32).prop_map(move |(x, off)| x * unit + off),
    ];
    let ends = [[place.clone(), place.clone(), place.clone()], [place.clone(), place.clone(), place]];
    (ends, 0..4u32).prop_map(|([from, to], how)| {
        let mut way: [i32; 3] = std::array::from_fn(|axis| to[axis] - from[axis]);
        match how {
            // Along a diagonal of two or three axes.
            0 => way[1] = way[0].abs() * way[1].signum(),
            1 => {
                way[1] = way[0].abs() * way[1].signum();
                way[2] = way[0].abs() * way[2].signum();
            }
            _ => {}
        }
        (from, way)
    })
}

/// A tracer that looks at samples, 20 a voxel.
fn broken<O: Occupancy>(volume: &O, ray: &Ray) -> bool {
    let steps = Steps::new(ray, 0.05).unwrap();
    steps.first_hit(volume, ray, Fidelity::EXACT).hit.is_some()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..ProptestConfig::default() })]

    /// Each voxel of a grid alone: it is hit if and only if fractions say so, and then at their time.
    #[test]
    fn every_touched_voxel_is_hit_and_no_other((from, way) in segment(), mips in 0..=3u32, coarsest in 0..=4u32) {
        let Some(ray) = Ray::exact(from, way) else { return Ok(()) };
        let fidelity = Fidelity { coarsest, fine_until: 0 };
        for voxel in voxels() {
            let mut volume = Volume::new([EDGE as u32; 3], mips).unwrap();
            volume.set([voxel]);
            let traced = first_hit(&volume, &ray, fidelity);
            let (blocked, steps) = is_blocked(&volume, &ray, fidelity);
            prop_assert_eq!(blocked, traced.hit.is_some());
            prop_assert_eq!(steps, traced.steps);
            match (traced.hit, touches(from, way, voxel)) {
                (None, None) => {}
                (Some(hit), Some(time)) => {
                    prop_assert_eq!(hit.cell, voxel);
                    prop_assert!((f64::from(hit.distance) - time.value() * length(way)).abs() < 1e-5);
                }
                (hit, time) => prop_assert!(false, "{voxel:?}: {hit:?}, exactly {time:?}"),
            }
        }
    }

    /// Many voxels: the first, whatever the mips, in a volume and in bricks.
    #[test]
    fn the_first_voxel_is_hit((from, way) in segment(), full in prop::collection::vec(0..EDGE.pow(3), 1..60), mips in 0..=3u32, offset in -70i32..70) {
        let full: Vec<[i32; 3]> = full.iter().map(|i| [i % EDGE, i / EDGE % EDGE, i / EDGE / EDGE]).collect();
        let mut volume = Volume::new([EDGE as u32; 3], mips).unwrap();
        volume.set(full.iter().copied());
        let mut bricks = Bricks::new();
        bricks.set(full.iter().map(|voxel| voxel.map(|c| c + offset)));
        let Some(ray) = Ray::exact(from, way) else { return Ok(()) };
        let moved = Ray::exact(from.map(|x| x + offset * ONE as i32), way).unwrap();
        let exact = full.iter().filter_map(|voxel| touches(from, way, *voxel)).reduce(|a, b| if b.less(a) { b } else { a });
        for (traced, offset) in [(first_hit(&volume, &ray, Fidelity::EXACT), 0), (first_hit(&volume, &ray, Fidelity::WITHOUT_MIPS), 0), (first_hit(&bricks, &moved, Fidelity::EXACT), offset)] {
            match (traced.hit, exact) {
                (None, None) => {}
                (Some(hit), Some(time)) => {
                    prop_assert!(full.contains(&hit.cell.map(|c| c - offset)));
                    prop_assert!((f64::from(hit.distance) - time.value() * length(way)).abs() < 1e-5);
                }
                (hit, time) => prop_assert!(false, "{hit:?}, exactly {time:?}"),
            }
        }
    }

    /// Samples in fixed steps are those of the definition, with mips and without, and never hit what is not touched.
    #[test]
    fn steps_are_as_defined((from, way) in segment(), full in prop::collection::vec(0..EDGE.pow(3), 1..60), step in 0.02..9.0f64) {
        let full: Vec<[i32; 3]> = full.iter().map(|i| [i % EDGE, i / EDGE % EDGE, i / EDGE / EDGE]).collect();
        let mut volume = Volume::new([EDGE as u32; 3], 2).unwrap();
        volume.set(full.iter().copied());
        let Some(ray) = Ray::exact(from, way) else { return Ok(()) };
        let steps = Steps::new(&ray, step).unwrap();
        let with = steps.first_hit(&volume, &ray, Fidelity::EXACT);
        let without = steps.first_hit(&volume, &ray, Fidelity::WITHOUT_MIPS);
        prop_assert_eq!(with.hit, without.hit);
        let direction = ray.direction().normalize();
        let samples = (length(way) / step).floor() as u32;
        let sample = |k: u32| (ray.origin() + direction * (step * f64::from(k))).floor().as_ivec3().to_array();
        let expected = (0..=samples).find(|&k| full.contains(&sample(k)));
        // Steps are rounded: samples near a border may be on either side of it.
        let near = (0..=samples).any(|k| {
            let at = ray.origin() + direction * (step * f64::from(k));
            (at - at.round()).abs().min_element() < 0.02
        });
        if !near && (length(way) / step).fract() > 1e-6 {
            prop_assert_eq!(with.hit.map(|hit| hit.cell), expected.map(sample));
        }
    }

    /// Coarse fidelity blocks at least what is blocked at full resolution, and no earlier than the distance it is fine for.
    #[test]
    fn coarse_cells_block_more((from, way) in segment(), full in prop::collection::vec(0..EDGE.pow(3), 1..20), fine_until in 1..6u32) {
        let full: Vec<[i32; 3]> = full.iter().map(|i| [i % EDGE, i / EDGE % EDGE, i / EDGE / EDGE]).collect();
        let mut volume = Volume::new([EDGE as u32; 3], 2).unwrap();
        volume.set(full.iter().copied());
        let Some(ray) = Ray::exact(from, way) else { return Ok(()) };
        let fine = first_hit(&volume, &ray, Fidelity::EXACT);
        let coarse = first_hit(&volume, &ray, Fidelity { fine_until, ..Fidelity::EXACT });
        if let Some(fine) = fine.hit {
            prop_assert!(coarse.hit.is_some_and(|coarse| coarse.distance <= fine.distance));
        }
        if let Some(coarse) = coarse.hit && coarse.level > 0 {
            prop_assert!(f64::from(coarse.distance) + 2.0 * f64::from(1 << coarse.level) > f64::from(fine_until), "{coarse:?}");
        }
    }
}

/// The test of touched voxels catches a tracer that looks at samples, be they 20 a voxel.
#[test]
fn samples_are_caught() {
    let mut missed = 0;
    for voxel in voxels() {
        let mut volume = Volume::new([EDGE as u32; 3], 2).unwrap();
        volume.set([voxel]);
        let (from, way) = ([0, 0, 0], [EDGE * 256, EDGE * 256, EDGE * 256]);
        let ray = Ray::exact(from, way).unwrap();
        missed += u32::from(touches(from, way, voxel).is_some() && !broken(&volume, &ray));
    }
    assert!(missed > 0, "no voxel at a corner was missed");
}

#[test]
fn rays_that_are_no_rays_are_refused() {
    use glam::DVec3;
    for (origin, direction, length) in [
        (DVec3::NAN, DVec3::X, 1.0),
        (DVec3::splat(1e9), DVec3::X, 1.0),
        (DVec3::ZERO, DVec3::ZERO, 1.0),
        (DVec3::ZERO, DVec3::new(f64::INFINITY, 0.0, 0.0), 1.0),
        (DVec3::ZERO, DVec3::X, -1.0),
        (DVec3::ZERO, DVec3::X, f64::NAN),
    ] {
        assert!(Ray::new(origin, direction, length).is_err(), "{origin} {direction} {length}");
    }
    assert!(Ray::between(DVec3::ONE, DVec3::ONE).is_err());
    for far in [i32::MIN, i32::MAX, (1 << 29) + 1] {
        assert!(Ray::exact([0, far, 0], [1, 0, 0]).is_none(), "{far}");
    }
    // Whatever the direction: a long one is cut, and divided.
    for (way, length) in [(i32::MIN, 8191.0), (i32::MAX, 8191.0), (65_536, 256.0)] {
        let ray = Ray::exact([1 << 29, 0, -(1 << 29)], [0, way, 0]).unwrap();
        assert_eq!((ray.length(), ray.direction().normalize()), (length, DVec3::Y * f64::from(way.signum())));
        assert!(first_hit(&Bricks::new(), &ray, Fidelity::EXACT).hit.is_none());
    }
    let ray = Ray::new(DVec3::ZERO, DVec3::new(0.0, -3.0, 1.0), f64::INFINITY).unwrap();
    assert!((ray.length() - 8191.0 * (1.0f64 + 1.0 / 9.0).sqrt()).abs() < 0.5);
    for length in [0.0, -1.0, 65.0, f64::NAN, 1e-9] {
        assert!(Steps::new(&ray, length).is_err(), "{length}");
    }
}
