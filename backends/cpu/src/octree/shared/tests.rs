//! Packets against the reference, and packets with faults that the same comparison finds.

use std::sync::Arc;

use esvo_core::reference::{ReferenceCaster, cast_coarse, cast_fine};
use esvo_core::testing::sample::{Sample, cameras, strange_views};
use esvo_core::{CastOptions, Caster, Hit, LeaveOut, Ray, Rays, View};
use esvo_format::Octree;

use super::super::lockstep;
use super::super::task::BAND_ROWS;
use super::packet::finest_scale;
use super::*;

/// Casts a picture.
fn picture(set: Vectors, octree: &Octree, view: &View) -> Vec<Hit> {
    let scene = Scene::new(octree, view.root, LeaveOut::ALL);
    let mut coarse = Vec::new();
    if view.beam() {
        let (columns, rows) = view.coarse_size();
        for row in 0..rows {
            let mut starts = vec![0.0; columns as usize];
            let task = Task::CoarseRow { view, row, starts: &mut starts };
            assert!(run(set, &scene, task).is_none(), "{set:?}");
            coarse.extend(starts);
        }
    }
    let mut hits = vec![Hit::miss(0); view.pixels()];
    for (band, hits) in hits.chunks_mut(view.width as usize * BAND_ROWS).enumerate() {
        let task = Task::Band { view, coarse: &coarse, first_row: (band * BAND_ROWS) as u32, hits };
        assert!(run(set, &scene, task).is_none(), "{set:?}");
    }
    hits
}

/// All views of a sample: cameras and strange views, odd sizes, contours, beam, termination.
fn views(octree: &Octree) -> Vec<View> {
    let mut views = Vec::new();
    for max_voxel_pixels in [0.0, 0.5, 1.0, 4.0] {
        for (contours, beam) in [(true, false), (false, false), (true, true)] {
            let options = CastOptions { contours, beam, max_voxel_pixels };
            let view = |camera: usize, size| {
                let root = octree.objects()[0].root_slot as u32;
                View::new(&cameras()[camera], octree.octree_to_mesh(0), root, size, &options).expect("is valid")
            };
            views.extend((0..cameras().len()).map(|camera| view(camera, (93, 61))));
            views.extend([(1, 1), (1, 9), (6, 3), (17, 4)].map(|size| view(0, size)));
            views.extend(strange_views(&view(0, (26, 19))));
        }
    }
    views
}

/// Rays that packets cast otherwise than the reference, and the views of the first of them.
fn differences(set: Vectors, samples: &[Arc<Octree>]) -> (usize, Option<View>) {
    let (mut count, mut first) = (0, None);
    for octree in samples {
        for view in views(octree) {
            let coarse = if view.beam() { cast_coarse(octree, &view) } else { Vec::new() };
            let mut expected = Vec::new();
            cast_fine(octree, &view, &coarse, &mut expected);
            let found = picture(set, octree, &view);
            // Zero has two signs.
            let same = |(a, b): (&Hit, &Hit)| a.raw_t == b.raw_t && a.same_voxel(b);
            assert_eq!(found.len(), expected.len());
            let differ = found.iter().zip(&expected).filter(|pair| !same(*pair)).count();
            if differ != 0 && first.is_none() {
                first = Some(view);
            }
            count += differ;
        }
    }
    (count, first)
}

/// Lists of rays: those of pictures, which stay together, with and without a size at the origin, and mixed ones, which do not.
fn lists(octree: &Octree) -> Vec<Vec<Ray>> {
    let mut lists = Vec::new();
    for max_voxel_pixels in [0.0, 2.0] {
        let options = CastOptions { contours: true, beam: false, max_voxel_pixels };
        let root = octree.objects()[0].root_slot as u32;
        let view = |camera: usize, size| {
            View::new(&cameras()[camera], octree.octree_to_mesh(0), root, size, &options).expect("is valid")
        };
        let mut views: Vec<View> = (0..cameras().len()).map(|camera| view(camera, (61, 37))).collect();
        views.extend(strange_views(&view(0, (21, 11))));
        lists.extend(views.iter().map(|view| -> Vec<Ray> {
            (0..view.height).flat_map(|y| (0..view.width).map(move |x| view.ray(x, y))).collect()
        }));
    }
    let mut mixed: Vec<Ray> = lists.iter().flatten().copied().step_by(7).collect();
    // 7919 is prime, and no list is that long.
    let len = mixed.len();
    mixed = (0..len).map(|k| mixed[k * 7919 % len]).collect();
    let sized = |ray: &Ray| Ray { size_at_origin: 0.01, ..*ray };
    lists.push(mixed.iter().enumerate().map(|(k, ray)| if k % 3 == 0 { sized(ray) } else { *ray }).collect());
    lists.push(mixed);
    // Rays that stay together, each with an origin and a span of its own.
    let own = |(k, ray): (usize, &Ray)| {
        let shift = (k % 7) as f32 * 1e-3;
        Ray { origin: ray.origin + shift, t_min: shift * 90.0, t_max: 1.0 - shift * 110.0, ..*ray }
    };
    lists.push(lists[0].iter().enumerate().map(own).collect());
    lists.extend([1, 3, 4, 17].map(|len| lists[0][..len].to_vec()));
    lists
}

/// Rays of lists that are cast otherwise than the reference casts them.
fn list_differences(set: Vectors, samples: &[Arc<Octree>]) -> usize {
    differences_of(samples, false, |scene, rays, contours, hits| {
        assert!(run(set, scene, Task::Rays { rays, contours, hits }).is_none(), "{set:?}");
    })
}

/// The same for those that `cast` casts, with or without their iterations.
fn differences_of(samples: &[Arc<Octree>], iterations: bool, cast: impl Fn(&Scene, &[Ray], bool, &mut [Hit])) -> usize {
    let mut count = 0;
    for octree in samples {
        let root = octree.objects()[0].root_slot as u32;
        let scene = Scene::new(octree, root, LeaveOut::ALL);
        let mut reference = ReferenceCaster::default();
        reference.load(octree).expect("is sound");
        for (rays, contours) in lists(octree).iter().flat_map(|rays| [(rays, true), (rays, false)]) {
            let mut expected = Vec::new();
            reference.cast_rays(&Rays { root, contours, rays }, &mut expected).expect("is loaded");
            let mut found = vec![Hit::miss(0); rays.len()];
            cast(&scene, rays, contours, &mut found);
            let same = |(a, b): (&Hit, &Hit)| {
                a.raw_t == b.raw_t && a.same_voxel(b) && (!iterations || a.iterations == b.iterations)
            };
            count += found.iter().zip(&expected).filter(|pair| !same(*pair)).count();
        }
    }
    count
}

fn samples() -> Vec<Arc<Octree>> {
    [Sample::plain(7, true), Sample::plain(8, false), Sample::scattered(6, true)]
        .map(|sample| sample.octree().expect("assembles"))
        .to_vec()
}

#[test]
fn packets_find_what_the_reference_finds() {
    for set in Vectors::available() {
        assert_eq!(differences(set, &samples()), (0, None), "{set:?}");
    }
}

/// Sets whose lists are cast in packets: the others cast them one ray at a time.
fn sets_with_lists() -> impl Iterator<Item = Vectors> {
    Vectors::available().filter(|set| ![Vectors::Arrays, Vectors::Sse2].contains(set))
}

/// Casts a list in lockstep.
struct Lockstep<'a> {
    scene: &'a Scene<'a>,
    rays: &'a [Ray],
    contours: bool,
    hits: &'a mut [Hit],
}

impl Work for Lockstep<'_> {
    type Output = ();

    fn run<S: Simd, const TILES: bool, const LISTS: bool>(self, simd: S) {
        if LISTS {
            lockstep::cast(simd, self.scene, self.rays, self.contours, self.hits);
        }
    }
}

#[test]
fn lockstep_finds_what_the_reference_finds() {
    for set in sets_with_lists() {
        let differences = |samples: &[Arc<Octree>]| {
            differences_of(samples, true, |scene, rays, contours, hits| {
                assert!(set.run(Lockstep { scene, rays, contours, hits }).is_ok());
            })
        };
        assert_eq!(differences(&samples()), 0, "{set:?}");
        fault::FAULT.set(fault::OLD_SPAN);
        let count = differences(&samples());
        fault::FAULT.set(0);
        assert_ne!(count, 0, "{set:?}: a ray with the end of the one before");
    }
}

#[test]
fn packets_of_lists_find_what_the_reference_finds() {
    for set in sets_with_lists() {
        assert_eq!(list_differences(set, &samples()), 0, "{set:?}");
    }
}

#[test]
fn faults_of_packets_of_lists_are_found() {
    for set in sets_with_lists() {
        for (fault, what) in [
            (fault::TIES, "a tie decided wrongly"),
            (fault::NO_CHECK, "no check at push"),
            (fault::WRONG_OCTANT, "a wrong octant"),
        ] {
            fault::FAULT.set(fault);
            let count = list_differences(set, &samples());
            fault::FAULT.set(0);
            assert_ne!(count, 0, "{set:?}: {what}");
        }
    }
}

#[test]
fn faults_of_packets_are_found() {
    let set = Vectors::best();
    // Plain arrays have no tiles.
    let tiles = set != Vectors::Arrays;
    for (fault, what, of_tiles) in [
        (fault::TIES, "a tie decided wrongly", false),
        (fault::NO_CHECK, "no check at push", false),
        (fault::WRONG_OCTANT, "a wrong octant", false),
        (fault::NO_SLABS, "slabs of nodes above are forgotten", true),
        (fault::NARROW, "bounds of a tile that are too narrow", true),
        (fault::NO_DOUBT, "no check where a block leaves its tile", true),
    ] {
        if of_tiles && !tiles {
            continue;
        }
        fault::FAULT.set(fault);
        let (count, _) = differences(set, &samples());
        fault::FAULT.set(0);
        assert_ne!(count, 0, "{what}");
    }
}

#[test]
fn planes_are_apart_where_packets_go() {
    assert_eq!(finest_scale([f32::NAN, 1.5, 1.5]), None);
    assert_eq!(finest_scale([1.5, f32::INFINITY, 1.5]), None);
    assert_eq!(finest_scale([1.5, 1e9, 1.5]), None);
    assert_eq!(finest_scale([1.5; 3]), Some(6));
    for origin in [[0.3, 1.2, 1.9], [70.0, -3.0, 1.0], [-3e4, 1.0, 2.0], [1.0, 1.9e6, 1.0]] {
        let scale = finest_scale(origin).expect("is near enough");
        let step = 2f32.powi(scale as i32 - 23);
        for axis in 0..3 {
            for direction in [1e-7, 0.3, 1.0, 7.7, 1e6f32] {
                for mirrored in [false, true] {
                    let coef = 1.0 / -direction;
                    let bias = coef * origin[axis];
                    let bias = if mirrored { 3.0 * coef - bias } else { bias };
                    let steps = (1.0 / step) as u32;
                    let t = |step_of: u32| (1.0 + step_of as f32 * step) * coef - bias;
                    for k in (0..steps).step_by((steps as usize / 999).max(1)) {
                        assert!(t(k + 1) < t(k), "{origin:?}, {axis}, {direction}, {k}");
                    }
                }
            }
        }
    }
}
