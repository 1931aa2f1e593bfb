//! Files of hits, and casting the rays of a file.

use std::io::Write;
use std::path::Path;

use esvo_core::{Caster, Hit, Ray, Rays};
use esvo_format::Octree;
use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::rays::RayFile;
use super::table::{
    FileHeader, Form, Layout, RayFileError, TableReader, TableWriter, double, first_not_finite, float, whole,
};

/// Rays that are cast at once: few enough to keep memory small.
const BATCH: usize = 1 << 20;

/// A hit as files store it; see the [module](super) for units.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HitRecord {
    /// Whether something was hit.
    pub hit: bool,
    /// Where the ray enters the voxel, in lengths of the direction.
    pub t: f32,
    /// Edge of the voxel.
    pub size: f32,
    /// Slot of the descriptor of the voxel's parent.
    pub slot: u32,
    /// Child slot of the voxel.
    pub child: u8,
    /// Scale of the voxel.
    pub scale: u8,
    /// Position in mesh units.
    pub position: [f64; 3],
    /// Iterations of the caster's loop.
    pub iterations: u32,
}

impl HitRecord {
    /// The record of a ray's hit.
    fn new(ray: &Ray, hit: &Hit, octree: &Octree, object: usize) -> Self {
        if hit.is_miss() {
            return Self {
                hit: false,
                t: Hit::MISS_T,
                size: 0.0,
                slot: 0,
                child: 0,
                scale: 0,
                position: [0.0; 3],
                iterations: hit.iterations,
            };
        }
        let at = ray.origin.as_dvec3() + ray.direction.as_dvec3() * f64::from(hit.raw_t) - DVec3::ONE;
        Self {
            hit: true,
            t: hit.raw_t,
            size: hit.size(),
            slot: hit.slot,
            child: hit.child(),
            scale: hit.scale() as u8,
            position: octree.octree_to_mesh(object).transform_point3(at).to_array(),
            iterations: hit.iterations,
        }
    }
}

impl Layout for HitRecord {
    const MAGIC: &'static [u8; 8] = b"ESVOHITS";
    const SCHEMA: &'static str = "esvo-hits 1";
    const WHAT: &'static str = "hits";
    const BYTES: usize = 48;

    fn put(&self, out: &mut Vec<u8>) {
        out.extend(self.t.to_le_bytes());
        out.extend(self.size.to_le_bytes());
        out.extend(self.slot.to_le_bytes());
        out.extend([self.child, self.scale, u8::from(self.hit), 0]);
        self.position.iter().for_each(|x| out.extend(x.to_le_bytes()));
        out.extend(self.iterations.to_le_bytes());
        out.extend([0; 4]);
    }

    fn get(bytes: &[u8]) -> Result<Self, String> {
        let hit = match u16::from_le_bytes([bytes[14], bytes[15]]) {
            0 => false,
            1 => true,
            other => return Err(format!("`hit` is {other}; it must be 0 or 1")),
        };
        Ok(Self {
            hit,
            t: float(bytes, 0),
            size: float(bytes, 4),
            slot: whole(bytes, 8),
            child: bytes[12],
            scale: bytes[13],
            position: [16, 24, 32].map(|at| double(bytes, at)),
            iterations: whole(bytes, 40),
        })
    }

    fn not_in_json(&self) -> Option<(&'static str, f64)> {
        let position = self.position.iter().find(|x| !x.is_finite()).map(|x| ("position", *x));
        first_not_finite(&[("t", &[self.t]), ("size", &[self.size])]).or(position)
    }
}

/// Writes hits one after the other.
pub struct HitWriter<'a>(TableWriter<'a>);

impl<'a> HitWriter<'a> {
    /// Writes the header of a file of `count` hits. `path` tells the form: `.bin` or `.json`.
    ///
    /// # Errors
    /// Another extension; a count other than that of the header's picture; the system's.
    pub fn new(out: &'a mut dyn Write, path: &Path, header: &FileHeader, count: u64) -> std::io::Result<Self> {
        let form = Form::of(path).map_err(std::io::Error::other)?;
        TableWriter::new::<HitRecord>(out, form, header, count).map(Self)
    }

    /// Writes some hits.
    ///
    /// # Errors
    /// More hits than were announced; in a `.json` a number that is infinite or NaN; the system's.
    pub fn put(&mut self, hits: &[HitRecord]) -> std::io::Result<()> {
        self.0.put(hits)
    }

    /// Writes what follows the last hit.
    ///
    /// # Errors
    /// Fewer hits than were announced; the system's.
    pub fn end(self) -> std::io::Result<()> {
        self.0.end()
    }
}

/// A file of hits that is being read.
pub struct HitFile(TableReader<HitRecord>);

impl HitFile {
    /// Opens a file and checks its header and its length.
    ///
    /// # Errors
    /// A file that cannot be read, is no file of hits, or is not whole.
    pub fn open(path: &Path) -> Result<Self, RayFileError> {
        TableReader::open(path).map(Self)
    }

    /// Number of hits.
    pub fn count(&self) -> u64 {
        self.0.count
    }

    /// Replaces `hits` by the next ones, at most `most`; by none at the end.
    ///
    /// # Errors
    /// The system's; a hit that is neither 0 nor 1.
    pub fn next(&mut self, most: usize, hits: &mut Vec<HitRecord>) -> Result<(), RayFileError> {
        self.0.next(most, hits)
    }
}

/// Casts the rays of a file, in their order, and passes the hits to `sink`, some at a time. `caster` has loaded `octree`.
///
/// # Errors
/// The file's, as a [`RayFileError`] that names it, also for an object that the octree does not have; the caster's, as an
/// [`esvo_core::CastError`]; those of `sink`, unchanged.
pub fn cast_file(
    rays: &mut RayFile,
    octree: &Octree,
    caster: &mut dyn Caster,
    sink: &mut dyn FnMut(&[HitRecord]) -> std::io::Result<()>,
) -> std::io::Result<()> {
    let (object, contours) = (rays.header().object as usize, rays.header().contours);
    let Some(entry) = octree.objects().get(object) else {
        let objects = octree.objects().len();
        let what = format!("its rays are for object {object}, counted from 0; the octree has {objects}");
        return Err(std::io::Error::other(rays.error(what)));
    };
    let root = entry.root_slot as u32;
    let (mut batch, mut hits, mut records) = (Vec::new(), Vec::new(), Vec::new());
    loop {
        rays.next(BATCH, &mut batch).map_err(std::io::Error::other)?;
        if batch.is_empty() {
            return Ok(());
        }
        caster.cast_rays(&Rays { root, contours, rays: &batch }, &mut hits).map_err(std::io::Error::other)?;
        records.clear();
        records.extend(batch.iter().zip(&hits).map(|(ray, hit)| HitRecord::new(ray, hit, octree, object)));
        sink(&records)?;
    }
}
