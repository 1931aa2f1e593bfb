//! The reference caster compared with the authors' caster, ray by ray, on octrees that the authors' builder made.
//!
//! The files are not in the repository. The test looks for them in `$ESVO_REFERENCE`, then in `../shared/reference` next to
//! the repository.
//!
//! Both casters do the same steps in the same order, in single precision without fused operations: every hit is equal in
//! every bit, with cubes and with contours.

use std::path::PathBuf;

use esvo_core::reference::cast_ray;
use esvo_core::{Hit, Ray};
use esvo_format::{Octree, oct};
use glam::Vec3;

/// A ray and the hit of the authors' caster.
struct Record {
    ray: Ray,
    t: f32,
    child: u32,
    scale: u32,
    iterations: u32,
    position: Vec3,
}

fn folder() -> Option<PathBuf> {
    let folder = std::env::var_os("ESVO_REFERENCE")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/reference"), PathBuf::from)
        .join("oct");
    if !folder.is_dir() {
        eprintln!(
            "skipped: there is no folder {}: not tested: the authors' hits (set ESVO_REFERENCE)",
            folder.display()
        );
        return None;
    }
    Some(folder)
}

fn records(path: PathBuf) -> Vec<Record> {
    let bytes = std::fs::read(&path).unwrap();
    let words: Vec<u32> = bytes.as_chunks().0.iter().map(|word| u32::from_le_bytes(*word)).collect();
    let (header, rest) = words.split_at(4);
    assert_eq!(header[2], 64, "{}: bytes of a record", path.display());
    assert_eq!(rest.len() as u32, header[0] * header[1] * 16, "{}: number of records", path.display());
    (rest.chunks_exact(16))
        .map(|record| {
            let float = |at: usize| f32::from_bits(record[at]);
            let vector = |at: usize| Vec3::new(float(at), float(at + 1), float(at + 2));
            Record {
                ray: Ray {
                    origin: vector(8),
                    direction: vector(12),
                    t_min: 0.0,
                    t_max: 1.0,
                    size_at_origin: float(11),
                    size_per_t: float(15),
                },
                t: float(0),
                child: record[3],
                scale: record[4],
                iterations: record[2],
                position: vector(5),
            }
        })
        .collect()
}

/// How the hits of one picture differ.
#[derive(Debug, Default)]
struct Difference {
    rays: usize,
    hits: usize,
    /// One hits, the other does not.
    missed: usize,
    /// Another voxel, by slot or scale, or by where it is.
    voxels: usize,
    /// The same voxel, another `t`.
    t: usize,
    /// Largest difference of `t` where the voxel is the same.
    worst_t: f32,
    /// The same voxel and `t`, another number of iterations.
    iterations: usize,
}

impl Difference {
    fn of(octree: &Octree, records: &[Record], contours: bool) -> Self {
        let mut difference = Self { rays: records.len(), ..Self::default() };
        for record in records {
            let hit = cast_ray(octree, octree.objects()[0].root_slot as u32, &record.ray, contours);
            difference.add(record, &hit);
        }
        difference
    }

    fn add(&mut self, record: &Record, hit: &Hit) {
        let theirs = record.t <= 1.0;
        self.hits += usize::from(theirs);
        if hit.is_miss() || !theirs {
            self.missed += usize::from(hit.is_miss() == theirs);
            return;
        }
        // The authors' point is in the voxel; ours must be in the same voxel, up to rounding.
        let point = record.ray.origin + record.ray.direction * hit.raw_t;
        let near = (point - record.position).abs().max_element() < 0.5 * hit.size();
        if u32::from(hit.child()) != record.child || hit.scale() != record.scale || !near {
            self.voxels += 1;
        } else if hit.raw_t != record.t {
            self.t += 1;
            self.worst_t = self.worst_t.max((hit.raw_t - record.t).abs());
        } else if hit.iterations != record.iterations {
            self.iterations += 1;
        }
    }

    /// Rays that hit something else or nothing.
    fn wrong(&self) -> usize {
        self.missed + self.voxels
    }
}

fn compare(name: &str, contours: bool) -> Option<Vec<Difference>> {
    let folder = folder()?;
    let octree = oct::open(&folder.join(name).with_extension("oct")).unwrap().octree;
    octree.sound().unwrap();
    Some(
        (0..2)
            .map(|camera| {
                let records = records(folder.join(format!("{name}_cam{camera}.hits")));
                let difference = Difference::of(&octree, &records, contours);
                println!("{name}, camera {camera}, contours {contours}: {difference:?}");
                difference
            })
            .collect(),
    )
}

#[test]
fn cubes_are_hit_where_the_authors_hit_them() {
    for difference in compare("sibenik_L7_cubical_dxt", true).into_iter().flatten() {
        assert!(difference.hits > 12_000, "{difference:?}");
        assert_eq!(difference.wrong() + difference.t + difference.iterations, 0, "{difference:?}");
    }
}

#[test]
fn contours_are_hit_where_the_authors_hit_them() {
    for difference in compare("sibenik_L7_contours_dxt", true).into_iter().flatten() {
        assert!(difference.hits > 12_000, "{difference:?}");
        assert_eq!(difference.wrong() + difference.t + difference.iterations, 0, "{difference:?}");
    }
}

/// The comparison notices a difference: without contours most rays end at the faces of cubes.
#[test]
fn without_contours_the_answers_differ() {
    for difference in compare("sibenik_L7_contours_dxt", false).into_iter().flatten() {
        assert!(difference.wrong() + difference.t > difference.rays / 2, "{difference:?}");
    }
}
