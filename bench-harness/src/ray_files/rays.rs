//! Files of rays.

use std::path::Path;

use esvo_core::Ray;
use esvo_format::write_atomically;
use serde::{Deserialize, Serialize};

use super::table::{FileHeader, Form, Layout, RayFileError, TableReader, TableWriter, first_not_finite, float};

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

    fn not_in_json(&self) -> Option<(&'static str, f64)> {
        first_not_finite(&[
            ("origin", &self.origin),
            ("direction", &self.direction),
            ("t_min", &[self.t_min]),
            ("t_max", self.t_max.as_slice()),
            ("size_at_origin", &[self.size_at_origin]),
            ("size_per_t", &[self.size_per_t]),
        ])
    }
}

/// Writes a file of rays, whole or not at all. `.bin` or `.json`, by the extension.
///
/// # Errors
/// Another extension; a number of rays other than `count`, or other than that of the header's picture; in a `.json` a number
/// that is infinite, `t_max` excepted, or NaN; the system's.
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

    /// An error of this file.
    pub(super) fn error(&self, what: impl ToString) -> RayFileError {
        self.table.error(what)
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

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    const HEADER: FileHeader = FileHeader { object: 0, contours: true, size: [0, 0], octree_to_mesh: [0.0; 16] };

    #[test]
    fn what_is_written_is_read_and_what_could_not_be_read_is_not_written() {
        let folder = tempfile::tempdir().unwrap();
        let ray = Ray::new(Vec3::new(1.5, 1.25, -3.0), Vec3::new(0.1, -0.2, 1.0));
        let finite = Ray { t_min: 0.5, t_max: 7.25, size_at_origin: 0.01, size_per_t: -0.1, ..ray };
        let strange = [
            ("t_min is -inf", Ray { t_min: f32::NEG_INFINITY, ..ray }),
            ("t_max is NaN", Ray { t_max: f32::NAN, ..ray }),
            ("t_max is -inf", Ray { t_max: f32::NEG_INFINITY, ..ray }),
            ("origin is NaN", Ray { origin: Vec3::new(1.0, f32::NAN, 1.0), ..ray }),
            ("direction is inf", Ray { direction: Vec3::INFINITY, ..ray }),
            ("size_at_origin is inf", Ray { size_at_origin: f32::INFINITY, ..ray }),
            ("size_per_t is NaN", Ray { size_per_t: f32::NAN, ..ray }),
        ];
        for name in ["rays.bin", "rays.json"] {
            let path = folder.path().join(name);
            let write = |header: &FileHeader, count, rays: &[Ray]| {
                let written = write_rays(&path, header, count, rays.iter().copied());
                written.map_err(|error| error.to_string().split_once(": ").unwrap().1.to_owned())
            };
            let read = || {
                let (mut file, mut rays) = (RayFile::open(&path).unwrap(), Vec::new());
                file.next(10, &mut rays).unwrap();
                rays
            };
            write(&HEADER, 2, &[ray, finite]).unwrap();
            assert_eq!(read(), [ray, finite]);
            for (what, strange) in strange {
                match write(&HEADER, 2, &[ray, strange]) {
                    Ok(()) => {
                        assert_eq!(name, "rays.bin");
                        assert_eq!(bits(&read()[1]), bits(&strange), "{what}");
                    }
                    Err(error) => {
                        assert_eq!(error, format!("record 1: {what}, which JSON cannot hold; use .bin"));
                        assert_eq!(name, "rays.json");
                    }
                }
            }
            write(&HEADER, 1, &[ray]).unwrap();
            assert_eq!(write(&HEADER, 3, &[ray; 2]).unwrap_err(), "there are 2 rays, but the header announces 3");
            assert_eq!(write(&HEADER, 1, &[ray; 2]).unwrap_err(), "there are more rays than the 1 of the header");
            let picture = FileHeader { size: [2, 3], ..HEADER };
            assert_eq!(write(&picture, 2, &[ray; 2]).unwrap_err(), "a picture of 2x3 has 6 rays, not 2");
            // The file from before.
            assert_eq!(read(), [ray]);
        }
    }

    /// The numbers of a ray as bits, in which NaN equals NaN.
    fn bits(ray: &Ray) -> Vec<u32> {
        let rest = [ray.t_min, ray.t_max, ray.size_at_origin, ray.size_per_t];
        let all = ray.origin.to_array().into_iter().chain(ray.direction.to_array()).chain(rest);
        all.map(f32::to_bits).collect()
    }
}
