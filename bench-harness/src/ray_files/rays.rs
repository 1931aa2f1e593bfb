//! Files of rays.

use std::path::Path;

use esvo_core::Ray;
use esvo_format::write_atomically;
use serde::{Deserialize, Serialize};

use super::table::{FileHeader, Form, Layout, RayFileError, TableReader, TableWriter, float};

/// A ray as files store it.
#[derive(Clone, Copy, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct RayRecord {
    origin: [f32; 3],
    direction: [f32; 3],
    t_min: f32,
    /// `None`: infinite, which JSON has no number for.
    t_max: Option<f32>,
    size_at_origin: f32,
    size_per_t: f32,
}

impl RayRecord {
    fn new(ray: &Ray) -> Self {
        Self {
            origin: ray.origin.into(),
            direction: ray.direction.into(),
            t_min: ray.t_min,
            t_max: Some(ray.t_max).filter(|t| *t != f32::INFINITY),
            size_at_origin: ray.size_at_origin,
            size_per_t: ray.size_per_t,
        }
    }

    fn ray(&self) -> Ray {
        Ray {
            origin: self.origin.into(),
            direction: self.direction.into(),
            t_min: self.t_min,
            t_max: self.t_max.unwrap_or(f32::INFINITY),
            size_at_origin: self.size_at_origin,
            size_per_t: self.size_per_t,
        }
    }
}

impl Layout for RayRecord {
    const MAGIC: &'static [u8; 8] = b"ESVORAYS";
    const SCHEMA: &'static str = "esvo-rays 1";
    const WHAT: &'static str = "rays";
    const BYTES: usize = 40;

    fn put(&self, out: &mut Vec<u8>) {
        let rest = [self.t_min, self.t_max.unwrap_or(f32::INFINITY), self.size_at_origin, self.size_per_t];
        for number in self.origin.into_iter().chain(self.direction).chain(rest) {
            out.extend(number.to_le_bytes());
        }
    }

    fn get(bytes: &[u8]) -> Result<Self, String> {
        let vector = |at: usize| [0, 4, 8].map(|offset| float(bytes, at + offset));
        Ok(Self {
            origin: vector(0),
            direction: vector(12),
            t_min: float(bytes, 24),
            t_max: Some(float(bytes, 28)).filter(|t| *t != f32::INFINITY),
            size_at_origin: float(bytes, 32),
            size_per_t: float(bytes, 36),
        })
    }
}

/// Writes a file of rays, whole or not at all. `.bin` or `.json`, by the extension.
///
/// # Errors
/// Another extension; the system's.
pub fn write_rays(
    path: &Path,
    header: &FileHeader,
    count: u64,
    rays: impl Iterator<Item = Ray>,
) -> Result<(), RayFileError> {
    let form = Form::of(path)?;
    write_atomically(path, |out| {
        let mut table = TableWriter::new::<RayRecord>(out, form, header, count)?;
        for ray in rays {
            table.put(&[RayRecord::new(&ray)])?;
        }
        table.end()
    })
    .map_err(|e| RayFileError::new(path, e))
}

/// A file of rays that is being read.
pub struct RayFile {
    table: TableReader<RayRecord>,
    records: Vec<RayRecord>,
}

impl RayFile {
    /// Opens a file and checks its header and its length.
    ///
    /// # Errors
    /// A file that cannot be read, is no file of rays, or is not whole.
    pub fn open(path: &Path) -> Result<Self, RayFileError> {
        Ok(Self { table: TableReader::open(path)?, records: Vec::new() })
    }

    /// What it says about all rays.
    pub fn header(&self) -> &FileHeader {
        &self.table.header
    }

    /// Number of rays.
    pub fn count(&self) -> u64 {
        self.table.count
    }

    /// Replaces `rays` by the next ones, at most `most`; by none at the end.
    ///
    /// # Errors
    /// The system's.
    pub fn next(&mut self, most: usize, rays: &mut Vec<Ray>) -> Result<(), RayFileError> {
        self.table.next(most, &mut self.records)?;
        rays.clear();
        rays.extend(self.records.iter().map(RayRecord::ray));
        Ok(())
    }
}
