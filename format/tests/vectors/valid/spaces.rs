//! Transforms from octree space to mesh space. They apply to contours, but not to normals.

use super::super::common::Rng;
use super::super::writer::{Block, Plan};
use super::attributes::{corners, plain_noise, with_noise};
use super::topology::{branching, smallest};
use super::{Add, one};

/// The octree of [`branching`] with contours.
fn contoured() -> Block {
    let mut block = branching(8);
    block.contour(2, 0b0100_0010, &[0x0de1_ec10, 0x1be9_f008]).contour(4, 0b0001_0000, &[0x2c29_f3d0]);
    block.contour(5, 0b1010_0000, &[0x3c15_ec04, 0x4e21_effc]).contour(7, 0b1000_0100, &[0x5e01_edf8, 0x6c09_f20c]);
    block
}

fn placed(levels: u32, block: Block, transform: [f64; 16]) -> Plan {
    let mut plan = one(levels, block);
    plan.objects[0].1 = transform;
    plan
}

pub(super) fn transforms(add: &mut Add<'_>) {
    // By columns: the images of the three axes, then the image of the origin.
    let rotated = [1.2, 1.6, 0., 0., -1.6, 1.2, 0., 0., 0., 0., 2., 0., -3., 0.25, 7., 1.];
    let mut block = contoured();
    with_noise(&mut block, 2, &[2, 4, 6]);
    add(
        "transform_rotated",
        "rotated about z and twice as large: contours and normal blocks",
        placed(3, block, rotated),
    );
    let mirrored = [-1.5, 0., 0., 0., 0., 1.5, 0., 0., 0., 0., 1.5, 0., 1.5, 0., 0., 1.];
    let mut block = contoured();
    let bytes = plain_noise(&block, 9);
    block.attachment(6, bytes);
    add("transform_mirrored", "mirrored along x: contours and plain normals", placed(3, block, mirrored));
    let sheared = [2., 0.5, -0.25, 0., 0.75, -1., 0.125, 0., 0.25, 0.5, 3., 0., 1., 2., 3., 1.];
    let mut block = contoured();
    let whole = (1u32 << 27) - 1;
    let bytes = corners(&block, &[(2, whole), (4, whole), (5, whole), (6, whole), (7, whole)], 3);
    block.attachment(7, bytes);
    add(
        "transform_sheared",
        "sheared, mirrored and of unequal scales: contours and corners",
        placed(3, block, sheared),
    );
    let huge = [0., 1e100, 0., 0., 0., 0., 1e100, 0., 1e100, 0., 0., 0., 1e300, -1e300, 1e300, 1.];
    let about = "axes exchanged, so large that products with the translation overflow, while the determinant does not";
    add("transform_huge", about, placed(1, smallest(4), huge));
    let tiny = [1e-100, 0., 0., -0., 0., -1e-100, 0., 0., 0., 0., 1e-100, -0., 0., 0., 0., 1.];
    add("transform_tiny", "tiny, with zeros of either sign in the last row", placed(1, smallest(4), tiny));
    let mut rng = Rng(4);
    let mut dense = [0.; 16].map(|_: f64| (rng.bits() >> 40) as f64 / f64::from(1 << 23) - 1.0);
    (dense[3], dense[7], dense[11], dense[15]) = (0., 0., 0., 1.);
    let mut block = contoured();
    with_noise(&mut block, 2, &[2, 4, 6]);
    with_noise(&mut block, 1, &[2, 4, 6]);
    add(
        "transform_dense",
        "no element zero but in the last row: contours, normals and colours",
        placed(3, block, dense),
    );
}
