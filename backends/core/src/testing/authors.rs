//! What the authors' caster hit: octrees that their builder made, with rays and hits of two cameras.
//!
//! The files are not in the repository. They are looked for in `$ESVO_REFERENCE`, then in `../shared/reference` next to the
//! repository.

use std::path::PathBuf;

use esvo_format::{Octree, oct};
use glam::Vec3;

use crate::{Hit, Ray};

/// Width and height of the pictures.
pub const SIZE: (u32, u32) = (128, 96);

/// An octree and the pictures of its cameras, row by row from the bottom left.
pub struct Scene {
    /// Name of the octree's file without its extension.
    pub name: &'static str,
    /// The octree; sound.
    pub octree: Octree,
    /// The pictures.
    pub cameras: Vec<Vec<Record>>,
}

/// SIBENIK with 7 levels, without and with contours. `None`, with a message on standard error, if there are no files.
///
/// `manifest` is the folder of the crate that asks, two folders below the repository.
///
/// # Panics
/// A file is missing or damaged.
pub fn scenes(manifest: &str) -> Option<[Scene; 2]> {
    let folder = folder(manifest)?;
    Some(["sibenik_L7_cubical_dxt", "sibenik_L7_contours_dxt"].map(|name| {
        let octree = oct::open(&folder.join(name).with_extension("oct")).unwrap().octree;
        octree.sound().unwrap();
        let cameras = (0..2).map(|camera| records(folder.join(format!("{name}_cam{camera}.hits")))).collect();
        Scene { name, octree, cameras }
    }))
}

/// A ray and the hit of the authors' caster.
pub struct Record {
    /// The ray.
    pub ray: Ray,
    /// Where it hits, or 2.
    pub t: f32,
    child: u32,
    scale: u32,
    iterations: u32,
    position: Vec3,
}

fn folder(manifest: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("ESVO_REFERENCE")
        .map_or_else(|| PathBuf::from(manifest).join("../../../shared/reference"), PathBuf::from)
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
    assert_eq!((header[0], header[1]), SIZE, "{}: size", path.display());
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
pub struct Difference {
    /// Rays.
    pub rays: usize,
    /// Rays that hit with the authors' caster.
    pub hits: usize,
    /// One hits, the other does not.
    pub missed: usize,
    /// Another voxel, by slot or scale, or by where it is.
    pub voxels: usize,
    /// The same voxel, another `t`.
    pub t: usize,
    /// Largest difference of `t` where the voxel is the same.
    pub worst_t: f32,
    /// The same voxel and `t`, another number of iterations.
    pub iterations: usize,
}

impl Difference {
    /// Compares the hits of a caster, one for each record.
    ///
    /// # Panics
    /// There are more or fewer hits than records.
    pub fn of(records: &[Record], hits: &[Hit]) -> Self {
        assert_eq!(records.len(), hits.len(), "number of hits");
        let mut difference = Self { rays: records.len(), ..Self::default() };
        for (record, hit) in records.iter().zip(hits) {
            difference.add(record, hit);
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
    pub fn wrong(&self) -> usize {
        self.missed + self.voxels
    }
}
