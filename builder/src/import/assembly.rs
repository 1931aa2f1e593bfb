//! Assembles one mesh from the parts of a file.

use std::path::Path;

use glam::{DMat4, DVec3};

use super::error::{ImportError, one_line};
use crate::mesh::transform::{mirrors, normal_matrix, transform_normal, transform_tangent};
use crate::mesh::{MAX_ELEMENTS, Mesh};

/// Triangles of one material with their own vertices. An empty attribute array means that the part has no such attribute.
#[derive(Clone, Debug, Default)]
pub(super) struct Part {
    pub(super) positions: Vec<[f64; 3]>,
    pub(super) normals: Vec<[f32; 3]>,
    pub(super) uvs: Vec<[f32; 2]>,
    pub(super) colors: Vec<[f32; 3]>,
    /// Empty if there are no normals.
    pub(super) tangents: Vec<[f32; 4]>,
    pub(super) triangles: Vec<[u32; 3]>,
    /// Index into the materials of the mesh.
    pub(super) material: u32,
}

impl Part {
    /// Some of the triangles with the vertices that they use.
    pub(super) fn of_triangles(&self, mut triangles: Vec<[u32; 3]>) -> Self {
        let used = compact(&mut triangles, self.positions.len());
        Self {
            positions: rows(&self.positions, &used),
            normals: rows(&self.normals, &used),
            uvs: rows(&self.uvs, &used),
            colors: rows(&self.colors, &used),
            tangents: rows(&self.tangents, &used),
            triangles,
            material: self.material,
        }
    }
}

/// The values of an attribute at some vertices; empty if there is no such attribute.
fn rows<T: Copy>(values: &[T], vertices: &[u32]) -> Vec<T> {
    if values.is_empty() { Vec::new() } else { vertices.iter().map(|&v| values[v as usize]).collect() }
}

/// Numbers the vertices that triangles use from 0 on, in the same order, and returns their numbers so far, which are below
/// `vertices`.
pub(super) fn compact(triangles: &mut [[u32; 3]], vertices: usize) -> Vec<u32> {
    let mut used: Vec<u32> = triangles.as_flattened().to_vec();
    used.sort_unstable();
    used.dedup();
    if used.len() < vertices {
        for corner in triangles.as_flattened_mut() {
            // Always found: `used` contains every corner.
            *corner = used.partition_point(|&v| v < *corner) as u32;
        }
    }
    used
}

/// A mesh under construction. Attributes that only some parts have are filled in for the others.
#[derive(Debug, Default)]
pub(super) struct Assembly {
    pub(super) mesh: Mesh,
}

impl Assembly {
    /// Checks that `copies` of `part` fit. Called for all instances together before the first is added, so that a file with
    /// too many is refused before memory is allocated for them.
    pub(super) fn check_room(&self, path: &Path, part: &Part, copies: usize) -> Result<(), ImportError> {
        for (what, have, more) in [
            ("triangles", self.mesh.triangles.len(), part.triangles.len()),
            ("vertices", self.mesh.positions.len(), part.positions.len()),
        ] {
            let total = more.saturating_mul(copies).saturating_add(have);
            if total > MAX_ELEMENTS {
                return Err(ImportError::TooLarge {
                    path: path.into(),
                    what: format!("the mesh has at least {total} {what} with all instances"),
                    limit: MAX_ELEMENTS as u64,
                });
            }
        }
        Ok(())
    }

    /// Adds `part`, transformed by `transform` (normals by the inverse transpose; winding swapped if it mirrors).
    pub(super) fn append(&mut self, path: &Path, part: &Part, transform: Option<&DMat4>) -> Result<(), ImportError> {
        self.check_room(path, part, 1)?;
        let mesh = &mut self.mesh;
        let first = mesh.positions.len();
        // Zero marks a missing normal; `finish` computes it.
        let moved = |normals: &[[f32; 3]]| match transform {
            Some(matrix) => {
                let matrix = normal_matrix(matrix);
                normals.iter().map(|&n| transform_normal(&matrix, n)).collect()
            }
            None => normals.to_vec(),
        };
        append_attribute(&mut mesh.normals, &moved(&part.normals), first, part.positions.len(), [0.0; 3]);
        let turned: Vec<[f32; 4]> = match transform {
            Some(matrix) => part.tangents.iter().map(|&t| transform_tangent(matrix, t)).collect(),
            None => part.tangents.clone(),
        };
        append_attribute(&mut mesh.tangents, &turned, first, part.positions.len(), [0.0; 4]);
        append_attribute(&mut mesh.uvs, &part.uvs, first, part.positions.len(), [0.0; 2]);
        append_attribute(&mut mesh.colors, &part.colors, first, part.positions.len(), [1.0; 3]);
        match transform {
            Some(matrix) => mesh
                .positions
                .extend(part.positions.iter().map(|&p| matrix.transform_point3(DVec3::from(p)).to_array())),
            None => mesh.positions.extend_from_slice(&part.positions),
        }
        // No overflow: MAX_ELEMENTS is below u32::MAX. Indices out of range are found by the final validation.
        let base = first as u32;
        let flip = transform.is_some_and(mirrors);
        mesh.triangles.extend(part.triangles.iter().map(|&[a, b, c]| {
            let [a, b, c] = [a, b, c].map(|i| i.saturating_add(base));
            if flip { [a, c, b] } else { [a, b, c] }
        }));
        mesh.triangle_materials.resize(mesh.triangles.len(), part.material);
        Ok(())
    }

    /// Adds a part as it is. The first part is not copied.
    pub(super) fn append_all(&mut self, path: &Path, part: Part) -> Result<(), ImportError> {
        if !self.mesh.positions.is_empty() {
            return self.append(path, &part, None);
        }
        self.check_room(path, &part, 1)?;
        let Part { positions, normals, uvs, colors, tangents, triangles, material } = part;
        let mesh = &mut self.mesh;
        mesh.triangle_materials.resize(triangles.len(), material);
        (mesh.positions, mesh.triangles) = (positions, triangles);
        (mesh.normals, mesh.uvs, mesh.colors, mesh.tangents) = (normals, uvs, colors, tangents);
        Ok(())
    }

    /// The finished mesh, not yet validated.
    pub(super) fn finish(mut self) -> Mesh {
        self.mesh.fill_missing_normals();
        self.mesh
    }

    /// What was read, or `None` with a warning that says why `what` cannot be used: `result` is an error, or there is no such
    /// file.
    pub(super) fn or_warn<T>(
        &mut self,
        result: Result<Option<T>, ImportError>,
        what: &str,
        consequence: &str,
    ) -> Option<T> {
        let line = match result {
            Ok(Some(found)) => return Some(found),
            Ok(None) => format!("{what} is missing; {consequence}"),
            Err(ImportError::Image { what: reason, .. }) => {
                format!("{what} cannot be decoded: {reason}; {consequence}")
            }
            Err(error) => format!("{what} cannot be read: {}; {consequence}", one_line(error)),
        };
        self.warn(line);
        None
    }

    pub(super) fn warn(&mut self, line: impl Into<String>) {
        warn(&mut self.mesh.warnings, line.into());
    }
}

/// Most warnings that are kept.
const MAX_WARNINGS: usize = 100;

/// Logs a warning, and keeps it unless it is one of `warnings` or these are too many: repeated lines carry no information, and
/// a file could produce them without end.
pub(super) fn warn(warnings: &mut Vec<String>, line: String) {
    tracing::warn!("{line}");
    if warnings.len() < MAX_WARNINGS && !warnings.contains(&line) {
        warnings.push(line);
    }
}

/// Extends an attribute array that is either empty or as long as the positions, and keeps it so.
fn append_attribute<T: Copy>(all: &mut Vec<T>, more: &[T], before: usize, added: usize, missing: T) {
    if all.is_empty() && more.is_empty() {
        return;
    }
    all.resize(before, missing);
    all.extend_from_slice(&more[..more.len().min(added)]);
    all.resize(before + added, missing);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Material;

    fn triangle(z: f64) -> Part {
        Part {
            positions: vec![[0.0, 0.0, z], [1.0, 0.0, z], [0.0, 1.0, z]],
            triangles: vec![[0, 1, 2]],
            ..Part::default()
        }
    }

    fn geometric_normal(mesh: &Mesh, t: usize) -> DVec3 {
        let [a, b, c] = mesh.triangles[t].map(|v| DVec3::from(mesh.positions[v as usize]));
        (b - a).cross(c - a).normalize()
    }

    #[test]
    fn parts_with_and_without_attributes_mix() {
        let mut assembly = Assembly::default();
        let path = Path::new("x");
        assembly.append(path, &triangle(0.0), None).unwrap();
        let with = Part { normals: vec![[1.0, 0.0, 0.0]; 3], uvs: vec![[0.5, 0.25]; 3], ..triangle(1.0) };
        assembly.append(path, &with, None).unwrap();
        assembly.append(path, &Part { colors: vec![[0.0, 0.5, 1.0]; 3], ..triangle(2.0) }, None).unwrap();
        assembly.mesh.materials.push(Material::default());
        let mesh = assembly.finish();
        mesh.validate().unwrap();
        assert_eq!(mesh.normals[0], [0.0, 0.0, 1.0]);
        assert_eq!(mesh.normals[3], [1.0, 0.0, 0.0]);
        assert_eq!(mesh.normals[8], [0.0, 0.0, 1.0]);
        assert_eq!((mesh.uvs[0], mesh.uvs[4], mesh.uvs[8]), ([0.0, 0.0], [0.5, 0.25], [0.0, 0.0]));
        assert_eq!((mesh.colors[0], mesh.colors[8]), ([1.0; 3], [0.0, 0.5, 1.0]));
        assert_eq!(mesh.triangles[2], [6, 7, 8]);
    }

    #[test]
    fn mirrored_parts_still_point_outwards() {
        let mut assembly = Assembly::default();
        let part = Part { normals: vec![[0.0, 0.0, 1.0]; 3], ..triangle(0.0) };
        // Mirrors in x, compresses z, moves: the face still points along +z.
        let matrix =
            DMat4::from_translation(DVec3::new(5.0, 6.0, 7.0)) * DMat4::from_scale(DVec3::new(-1.0, 1.0, 0.25));
        assembly.append(Path::new("x"), &part, Some(&matrix)).unwrap();
        let mesh = assembly.finish();
        assert_eq!(mesh.positions[1], [4.0, 6.0, 7.0]);
        assert_eq!(geometric_normal(&mesh, 0), DVec3::Z);
        assert_eq!(mesh.normals[0], [0.0, 0.0, 1.0]);
    }

    #[test]
    fn a_shared_vertex_without_normal_is_doubled_at_an_edge() {
        let mut assembly = Assembly::default();
        let with = Part { normals: vec![[1.0, 0.0, 0.0]; 3], ..triangle(9.0) };
        let folded = Part {
            positions: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            triangles: vec![[0, 1, 2], [0, 3, 1]],
            ..Part::default()
        };
        assembly.append(Path::new("x"), &with, None).unwrap();
        assembly.append(Path::new("x"), &folded, None).unwrap();
        assembly.mesh.materials.push(Material::default());
        let mesh = assembly.finish();
        mesh.validate().unwrap();
        for t in 1..3 {
            let flat = geometric_normal(&mesh, t).as_vec3().to_array();
            assert!(mesh.triangles[t].iter().all(|&v| mesh.normals[v as usize] == flat));
        }
        assert_eq!(mesh.positions.len(), 9, "two of the four vertices lie on both faces");
    }
}
