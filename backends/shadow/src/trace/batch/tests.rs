//! Lists against rays one by one, and lists with faults that the same comparison finds.

use glam::DVec3;

use super::{blocked, fault, first_hits};
use crate::trace::{Fidelity, Ray, first_hit, is_blocked};
use crate::{Bricks, Volume};

/// Numbers by a linear congruence.
struct Random(u64);

impl Random {
    fn below(&mut self, n: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % n
    }

    fn between(&mut self, low: i32, high: i32) -> i32 {
        low + self.below((high - low) as u64) as i32
    }
}

/// A ray through a world: often on planes, edges and corners, along axes and diagonals, from outside, and of no length.
fn ray(random: &mut Random, voxels: [u32; 3]) -> Ray {
    loop {
        let mut place = || {
            let how = random.below(6);
            [0, 1, 2].map(|axis| {
                let n = voxels[axis] as i32;
                match how {
                    0 => random.between(-2, n + 3) << 8,
                    1 => random.between(-4, 2 * n + 5) << 7,
                    2 => (random.between(0, n + 1) << 8) + random.between(-1, 2),
                    _ => random.between(0, n << 8),
                }
            })
        };
        let (from, to) = (place(), place());
        let mut way: [i32; 3] = [0, 1, 2].map(|axis| to[axis] - from[axis]);
        match random.below(12) {
            // Along a diagonal of two or three axes.
            0 => way[1] = way[0],
            1 => way = [way[0], -way[0], way[0]],
            // Along an axis or across it.
            2 => way[random.below(3) as usize] = 0,
            3 => way = [0, way[1], 0],
            // Nearly along it.
            4 => way = [way[0], random.between(-2, 3), random.between(-2, 3)],
            5 => {
                let direction = DVec3::from(way.map(f64::from));
                if let Ok(ray) = Ray::new(DVec3::from(from.map(f64::from)) / 256.0, direction, 0.0) {
                    return ray;
                }
            }
            _ => {}
        }
        if let Some(ray) = Ray::exact(from, way) {
            return ray;
        }
    }
}

fn world(random: &mut Random, voxels: [u32; 3], mips: u32) -> Volume {
    let mut volume = Volume::new(voxels, mips).unwrap();
    let all: u64 = voxels.iter().map(|&n| u64::from(n)).product();
    let full = random.below(all / 8 + 2);
    let corners: Vec<_> = (0..full).map(|_| voxels.map(|n| random.below(u64::from(n)) as i32)).collect();
    // A wall, which mips above it know of, and single voxels.
    let wall = (0..voxels[0] as i32 / 2).map(|x| [x, voxels[1] as i32 / 2, voxels[2] as i32 / 3]);
    volume.set(corners.into_iter().chain(wall));
    volume
}

const SIZES: [[u32; 3]; 6] = [[1, 1, 1], [8, 8, 8], [7, 9, 5], [64, 2, 33], [65, 33, 17], [130, 101, 70]];
const FIDELITIES: [(u32, u32); 9] = [(6, 0), (0, 0), (1, 0), (3, 0), (6, 1), (3, 5), (6, 16), (0, 2), (6, u32::MAX)];

/// How many answers of lists differ from those of rays one by one.
fn differences(lengths: &[usize]) -> usize {
    let mut random = Random(1);
    let mut differ = 0;
    for voxels in SIZES {
        for mips in 0..=5 {
            let volume = world(&mut random, voxels, mips);
            for (coarsest, fine_until) in FIDELITIES {
                let fidelity = Fidelity { coarsest, fine_until };
                for &length in lengths {
                    let rays: Vec<Ray> = (0..length).map(|_| ray(&mut random, voxels)).collect();
                    let hits = first_hits(&volume, &rays, fidelity);
                    let blocked = blocked(&volume, &rays, fidelity);
                    assert_eq!((hits.len(), blocked.len()), (length, length));
                    for (ray, (hit, blocked)) in rays.iter().zip(hits.into_iter().zip(blocked)) {
                        let is_same = hit == first_hit(&volume, ray, fidelity).hit;
                        let is_same = is_same && blocked == is_blocked(&volume, ray, fidelity).0;
                        differ += usize::from(!is_same);
                    }
                }
            }
        }
    }
    differ
}

#[test]
fn lists_are_as_rays_one_by_one() {
    assert_eq!(differences(&[0, 1, 7, 8, 9, 200]), 0);
}

#[test]
fn long_lists_are_as_rays_one_by_one() {
    let mut random = Random(7);
    let volume = world(&mut random, [200, 150, 90], 5);
    let rays: Vec<Ray> = (0..20_000).map(|_| ray(&mut random, [200, 150, 90])).collect();
    let one_by_one: Vec<_> = rays.iter().map(|ray| first_hit(&volume, ray, Fidelity::EXACT).hit).collect();
    assert!(first_hits(&volume, &rays, Fidelity::EXACT) == one_by_one);
    assert!(one_by_one.iter().filter(|hit| hit.is_some()).count() > 1000);
}

/// However many rays in a row are none for lanes, those behind them are traced.
#[test]
fn rays_behind_many_that_start_outside_are_traced() {
    let mut random = Random(11);
    let voxels = [40, 30, 20];
    let volume = world(&mut random, voxels, 2);
    let outside = Ray::exact([-700, 300, 300], [9000, 100, 50]).unwrap();
    let inside: Vec<Ray> = (0..200)
        .map(|_| Ray::exact(voxels.map(|n| random.between(1, n as i32 * 256)), [2000, 3001, 1999]).unwrap())
        .collect();
    for count in [120, 128, 129, 300, 1000] {
        let mut rays = vec![outside; count];
        rays.extend(&inside);
        rays.extend(vec![outside; count]);
        let one_by_one: Vec<_> = rays.iter().map(|ray| first_hit(&volume, ray, Fidelity::EXACT).hit).collect();
        assert!(one_by_one.iter().filter(|hit| hit.is_some()).count() > 50);
        assert!(first_hits(&volume, &rays, Fidelity::EXACT) == one_by_one, "behind {count}");
        let is_hit: Vec<bool> = one_by_one.iter().map(Option::is_some).collect();
        assert!(blocked(&volume, &rays, Fidelity::EXACT) == is_hit, "behind {count}");
    }
}

#[cfg(target_arch = "x86_64")]
#[test]
fn faults_are_found() {
    // Faults are in the lanes, which need vectors.
    if super::vectors().is_none() {
        return;
    }
    for (fault, what) in [
        (fault::TIES, "planes crossed at once"),
        (fault::OLD_LIMIT, "the end of the ray before"),
        (fault::ON_PLANE, "planes crossed on the way into a cell"),
        (fault::OLD_BYTE, "the byte of the cell before"),
    ] {
        fault::FAULT.set(fault);
        let differ = differences(&[200]);
        fault::FAULT.set(0);
        assert!(differ > 0, "not found: {what}");
    }
}

/// Volumes that lanes do not know are traced one by one.
#[test]
fn other_volumes_have_lists_too() {
    let mut random = Random(3);
    let volume = world(&mut random, [30, 20, 10], 2);
    let mut bricks = Bricks::new();
    let voxels = (0..30 * 20 * 10).map(|i| [i % 30, i / 30 % 20, i / 600]);
    bricks.set(voxels.filter(|&voxel| volume.get(voxel)));
    let rays: Vec<Ray> = (0..500).map(|_| ray(&mut random, [30, 20, 10])).collect();
    let fidelity = Fidelity::EXACT;
    let expected = blocked(&volume, &rays, fidelity);
    assert_eq!(blocked(&bricks, &rays, fidelity), expected);
    let hits = first_hits(&bricks, &rays, fidelity);
    assert_eq!(hits.iter().map(Option::is_some).collect::<Vec<_>>(), expected);
}
