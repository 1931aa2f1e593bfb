//! The reference caster compared with the authors' caster, ray by ray, on octrees that the authors' builder made.
//!
//! Both casters do the same steps in the same order, in single precision without fused operations: every hit is equal in
//! every bit, with cubes and with contours. Without the files, which are not in the repository, the tests are skipped.

use esvo_core::Hit;
use esvo_core::reference::cast_ray;
use esvo_core::testing::authors::{Difference, scenes};

/// Compares on the octree at this place of [`scenes`].
fn compare(place: usize, contours: bool) -> Option<Vec<Difference>> {
    let scene = &scenes(env!("CARGO_MANIFEST_DIR"))?[place];
    let root = scene.octree.objects()[0].root_slot as u32;
    let differences = scene.cameras.iter().enumerate().map(|(camera, records)| {
        let hits: Vec<Hit> = records.iter().map(|r| cast_ray(&scene.octree, root, &r.ray, contours)).collect();
        let difference = Difference::of(records, &hits);
        println!("{}, camera {camera}, contours {contours}: {difference:?}", scene.name);
        difference
    });
    Some(differences.collect())
}

#[test]
fn cubes_are_hit_where_the_authors_hit_them() {
    for difference in compare(0, true).into_iter().flatten() {
        assert!(difference.hits > 12_000, "{difference:?}");
        assert_eq!(difference.wrong() + difference.t + difference.iterations, 0, "{difference:?}");
    }
}

#[test]
fn contours_are_hit_where_the_authors_hit_them() {
    for difference in compare(1, true).into_iter().flatten() {
        assert!(difference.hits > 12_000, "{difference:?}");
        assert_eq!(difference.wrong() + difference.t + difference.iterations, 0, "{difference:?}");
    }
}

/// The comparison notices a difference: without contours most rays end at the faces of cubes.
#[test]
fn without_contours_the_answers_differ() {
    for difference in compare(1, false).into_iter().flatten() {
        assert!(difference.wrong() + difference.t > difference.rays / 2, "{difference:?}");
    }
}
