//! Pictures of the axis that triangles are projected along, and of the pixels of the three projections: the document's Figures 5 and 6.

use esvo_core::Picture;
use esvo_raster::{Method, Options, Surface, Voxelizer};
use glam::{DVec2, DVec3};

use super::facets::{Facet, draw, tint};
use super::pixels::near_edge;
use super::{camera, meshes};
use crate::BenchError;
use crate::voxel_bench::surface::failed;

/// Level of the grid.
const LEVEL: u32 = 4;
/// Where the eye is: the planes at 0 lie behind the mesh.
const EYE: DVec3 = DVec3::new(2.25, 1.75, 1.65);
/// Colors of the axes x, y and z.
const AXES: [[f32; 3]; 3] = [[0.85, 0.30, 0.24], [0.22, 0.62, 0.30], [0.20, 0.42, 0.84]];

/// A picture for each of the two figures.
///
/// # Errors
/// What the device says.
pub(super) fn pictures(voxelizer: &Voxelizer) -> Result<[(&'static str, Picture); 2], BenchError> {
    let camera = camera(EYE, DVec3::splat(0.42), 40.0);
    let triangle = meshes::one_triangle();
    let axis = chosen(voxelizer, &[triangle])?
        .axis()
        .ok_or_else(|| failed("picture", "a triangle is not projected along one axis"))?;
    let mut facets = Vec::new();
    for along in 0..3 {
        let shaded = fixed(voxelizer, &[triangle], along)?;
        let strength = if along == axis { 0.85 } else { 0.35 };
        facets.push(plane(along, shaded, strength, vec![triangle]));
    }
    facets.push(Facet::triangle(triangle, AXES[axis], 0.9));
    let one = draw(&facets, &camera)?;

    let mesh = meshes::closed();
    let mut facets = Vec::new();
    let all = chosen(voxelizer, &mesh)?.shaded;
    facets.extend(all.into_iter().enumerate().map(|(along, shaded)| plane(along, shaded, 0.7, Vec::new())));
    for triangle in mesh {
        let axis = chosen(voxelizer, &[triangle])?.axis();
        let color = axis.map_or([0.5; 3], |axis| AXES[axis]);
        facets.push(Facet::triangle(triangle, color, 1.0));
    }
    Ok([("one-triangle-on-three-planes", one), ("faces-by-their-axis", draw(&facets, &camera)?)])
}

/// Which pixels of the projections along x, y and z are shaded: for each coordinate of the axis before the projection's a row, for each
/// of the axis after it a column.
struct Shaded {
    shaded: [Vec<bool>; 3],
}

impl Shaded {
    /// The only axis that has pixels.
    fn axis(&self) -> Option<usize> {
        let mut with = (0..3).filter(|axis| self.shaded[*axis].contains(&true));
        with.next().filter(|_| with.next().is_none())
    }
}

/// The pixels that are shaded with the projections that the voxelizer chooses.
fn chosen(voxelizer: &Voxelizer, corners: &[[DVec3; 3]]) -> Result<Shaded, BenchError> {
    let surface = Surface { corners, looks: None };
    let options = Options::new(LEVEL, Method::DominantAxis);
    let pixels = voxelizer.pixels(&surface, &options).map_err(|e| failed("picture", e))?;
    let size = (pixels.edge as usize).pow(2);
    let of = |axis: usize| pixels.counts[axis * size..][..size].iter().map(|count| *count > 0).collect();
    Ok(Shaded { shaded: [of(0), of(1), of(2)] })
}

/// The pixels that are shaded with a projection along this axis: the fixed one, of a mesh that is turned.
fn fixed(voxelizer: &Voxelizer, corners: &[[DVec3; 3]], axis: usize) -> Result<Vec<bool>, BenchError> {
    let turned: Vec<[DVec3; 3]> = corners
        .iter()
        .map(|triangle| triangle.map(|p| DVec3::new(p[(axis + 1) % 3], p[(axis + 2) % 3], p[axis])))
        .collect();
    let surface = Surface { corners: &turned, looks: None };
    let options = Options::new(LEVEL, Method::FixedAxis);
    let pixels = voxelizer.pixels(&surface, &options).map_err(|e| failed("picture", e))?;
    let size = (pixels.edge as usize).pow(2);
    Ok(pixels.counts[2 * size..].iter().map(|count| *count > 0).collect())
}

/// The face of the grid behind the mesh along an axis, with its pixels and the outlines of triangles.
fn plane<'a>(axis: usize, shaded: Vec<bool>, strength: f32, outlines: Vec<[DVec3; 3]>) -> Facet<'a> {
    let edge = 1usize << LEVEL;
    let [column, row] = [(axis + 1) % 3, (axis + 2) % 3];
    let outlines: Vec<[DVec2; 3]> =
        outlines.into_iter().map(|triangle| triangle.map(|p| DVec2::new(p[column], p[row]))).collect();
    Facet::new(DVec3::ZERO, [DVec3::AXES[column], DVec3::AXES[row]], move |s, t| {
        let at = [s, t].map(|x| ((x * edge as f64) as usize).min(edge - 1));
        let from_line = [s, t].map(|x| (x * edge as f64 - (x * edge as f64).round()).abs());
        let pixel =
            if shaded[at[1] * edge + at[0]] { AXES[axis].map(|c| 1.0 + (c - 1.0) * strength) } else { [1.0; 3] };
        if outlines.iter().any(|outline| near_edge(*outline, DVec2::new(s, t), 0.004)) {
            tint([0.1, 0.1, 0.3], 1.0)
        } else if from_line[0].min(from_line[1]) < 0.05 {
            tint(pixel.map(|c| c * 0.84), 1.0)
        } else {
            tint(pixel, 1.0)
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::voxel_bench::pictures::tests::voxelizer;

    fn count(shaded: &[bool]) -> usize {
        shaded.iter().filter(|shaded| **shaded).count()
    }

    #[test]
    fn the_projection_that_is_chosen_has_most_pixels() {
        let Some(voxelizer) = voxelizer() else { return };
        let triangle = meshes::one_triangle();
        let found = chosen(&voxelizer, &[triangle]).unwrap();
        assert_eq!(found.axis(), Some(1));
        let counts = [0, 1, 2].map(|axis| count(&fixed(&voxelizer, &[triangle], axis).unwrap()));
        // It is the same projection, and the others have pixels as well.
        assert_eq!(fixed(&voxelizer, &[triangle], 1).unwrap(), found.shaded[1]);
        assert!(counts[1] > counts[0] && counts[1] > counts[2] && counts[0] > 0 && counts[2] > 0, "{counts:?}");
    }

    #[test]
    fn faces_of_the_closed_mesh_are_projected_along_all_axes() {
        let Some(voxelizer) = voxelizer() else { return };
        let mesh = meshes::closed();
        assert_eq!(mesh.len(), 20);
        let mut faces = [0; 3];
        for triangle in &mesh {
            let axis = chosen(&voxelizer, &[*triangle]).unwrap().axis().unwrap();
            let normal = (triangle[1] - triangle[0]).cross(triangle[2] - triangle[0]).abs();
            assert_eq!(normal[axis], normal.max_element());
            faces[axis] += 1;
        }
        assert!(faces.iter().all(|count| *count >= 4), "{faces:?}");
        assert!(chosen(&voxelizer, &mesh).unwrap().axis().is_none());
        let pictures = pictures(&voxelizer).unwrap();
        // Each has pixels that are clearly of each axis.
        for (name, picture) in pictures {
            for axis in 0..3 {
                let others = [(axis + 1) % 3, (axis + 2) % 3];
                let clear = |p: &&[u8]| others.iter().all(|other| i32::from(p[axis]) > i32::from(p[*other]) + 25);
                let pixels = picture.rgb8.chunks_exact(3).filter(clear).count();
                assert!(pixels > 300, "{name}, axis {axis}: {pixels}");
            }
        }
    }
}
