use esvo_builder::{HeightMap, LinearTexture, UvTransform, displace};
use esvo_core::Camera;

use super::*;

/// A box without a lid, with bumps: its walls hide others, and there is nothing to see beside it.
pub(crate) fn bumpy_box() -> Mesh {
    let texels = (0..64u32 * 64).map(|i| [(i.wrapping_mul(2_654_435_761) >> 16) as u16]).collect();
    let texture = Arc::new(LinearTexture::new(64, 64, texels).unwrap());
    let map = HeightMap { texture, amplitude: 0.02, bias: 0.0, uv_transform: UvTransform::IDENTITY };
    let materials = vec![esvo_builder::Material { height_map: Some(map), ..Default::default() }];
    let mut mesh = Mesh { materials, ..Mesh::default() };
    let faces = [[0, 1, 3, 2], [0, 1, 5, 4], [1, 3, 7, 5], [3, 2, 6, 7], [2, 0, 4, 6]];
    for face in faces {
        let first = mesh.positions.len() as u32;
        mesh.positions.extend(face.map(|k| [f64::from(k & 1), f64::from(k >> 1 & 1), f64::from(k >> 2 & 1)]));
        mesh.uvs.extend([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0f32]]);
        mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        mesh.triangle_materials.extend([0; 2]);
    }
    mesh
}

pub(crate) fn options(mesh: &Mesh) -> DisplaceOptions {
    DisplaceOptions { max_triangles: 1000, ..DisplaceOptions::for_levels(mesh, 7, 1.0) }
}

/// From above, which shows the floor; and from the side, which shows the outside of two walls.
pub(crate) fn rays() -> [CameraRays; 2] {
    let camera = |eye: [f64; 3], fov_degrees| {
        let forward = (DVec3::new(0.5, 0.5, 0.4) - DVec3::from(eye)).to_array();
        let camera = Camera { eye, forward, up: [0.1, 1.0, 0.2], fov_degrees, near: 0.1, far: 10.0 };
        CameraRays::new(&camera, (40, 30)).unwrap()
    };
    [camera([0.45, 0.55, 2.5], 14.0), camera([2.0, 2.2, 0.8], 40.0)]
}

/// Pixels that differ.
fn differing(a: &Seen, b: &Seen) -> usize {
    let pixel = |seen: &Seen, i: usize| {
        (seen.hits[i].t.to_bits(), seen.surfaces[i], [0, 1, 2].map(|channel| seen.picture.rgb8[3 * i + channel]))
    };
    (0..a.hits.len()).filter(|&i| pixel(a, i) != pixel(b, i)).count()
}

#[test]
fn what_no_ray_needs_is_not_diced_and_nothing_else_changes() {
    let (mesh, rays) = (bumpy_box(), rays());
    let options = options(&mesh);
    let (seen, few) = see_displaced(&mesh, &options, &rays).unwrap();
    let (all_seen, all) = see_parts(&mesh, &options, &rays, |_, _| true).unwrap();
    assert_eq!(all.diced, all.parts);
    assert!(few.parts == all.parts && few.diced * 10 < all.diced * 8, "{few:?} {all:?}");
    // The whole mesh gives the same, in every bit.
    let whole = displace(&mesh, &DisplaceOptions { max_triangles: 1 << 24, ..options }).unwrap();
    let triangles = sorted(&whole).unwrap();
    for (k, rays) in rays.iter().enumerate() {
        assert!(seen[k].hits.iter().filter(|hit| !hit.is_miss()).count() > 300, "view {k}");
        assert_eq!(differing(&seen[k], &all_seen[k]), 0, "view {k}");
        assert_eq!(differing(&seen[k], &Seen::of(&whole, &triangles, rays)), 0, "view {k}");
    }
    // Views together show what each shows alone.
    let alone = see_displaced(&mesh, &options, &rays[..1]).unwrap().0;
    assert_eq!(differing(&alone[0], &seen[0]), 0);
}

/// The negative controls: a part that is needed, and larger cells.
#[test]
fn what_is_missing_or_coarser_is_noticed() {
    let (mesh, rays) = (bumpy_box(), rays());
    let options = options(&mesh);
    let seen = see_displaced(&mesh, &options, &rays).unwrap().0;
    let all = |differ: fn(&Seen, &Seen) -> usize, other: &[Seen]| -> usize {
        seen.iter().zip(other).map(|(a, b)| differ(a, b)).sum()
    };
    let left_out = AtomicUsize::new(usize::MAX);
    let without = see_parts(&mesh, &options, &rays, |part, wanted| {
        // The first that is needed: the nearest one.
        let first = || left_out.compare_exchange(usize::MAX, part, Ordering::Relaxed, Ordering::Relaxed);
        wanted && first().is_err_and(|first| first != part)
    });
    assert!(all(differing, &without.unwrap().0) > 0);
    let coarser = DisplaceOptions { cell: 3.0 * options.cell, ..options };
    assert!(all(differing, &see_displaced(&mesh, &coarser, &rays).unwrap().0) > 300);
}

#[test]
fn a_mesh_of_which_nothing_moves_is_seen_as_it_is() {
    let (mut mesh, rays) = (bumpy_box(), rays());
    mesh.materials[0].height_map = None;
    let options = options(&mesh);
    let (seen, diced) = see_displaced(&mesh, &options, &rays).unwrap();
    assert_eq!(diced, Diced { parts: 1, diced: 1, triangles: 10 });
    let triangles = sorted(&mesh).unwrap();
    assert!(rays.iter().zip(&seen).all(|(rays, seen)| differing(seen, &Seen::of(&mesh, &triangles, rays)) == 0));
}

#[test]
fn pixels_of_a_cube_are_found_wherever_it_is() {
    let rays = &rays()[1];
    let view = ViewOfParts::new(rays);
    for k in 0..200u32 {
        let of = |m: u32| f64::from(k.wrapping_mul(m) % 101) / 20.0 - 1.5;
        let low = DVec3::new(of(7919), of(104_729), of(1_299_709));
        let cube = Cube { low, high: low + 0.3 };
        let [columns, rows] = view.pixels(&cube);
        for pixel in 0..rays.pixels() {
            let (x, y) = (pixel as u32 % rays.width, pixel as u32 / rays.width);
            let meets = cube.clip(&rays.ray(x, y)).is_some();
            assert!(!meets || columns.contains(&x) && rows.contains(&y), "{cube:?}: {x} {y}");
        }
    }
}
