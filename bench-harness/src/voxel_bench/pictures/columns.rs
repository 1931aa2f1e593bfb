//! Pictures of how many voxels of a pixel's column a plane meets: the document's Figure 11.

use std::collections::BTreeMap;

use esvo_core::Picture;
use esvo_raster::{Method, Options, Surface, Voxelizer, morton_place};
use glam::{DMat4, DVec3};

use super::cubes::cubes;
use super::facets::{Facet, draw};
use super::{camera, meshes};
use crate::BenchError;
use crate::voxel_bench::surface::failed;

/// Level of the grid.
pub(super) const LEVEL: u32 = 4;
/// Where the eye is.
pub(super) const EYE: DVec3 = DVec3::new(-1.0, -0.65, 1.55);
/// Colors of voxels whose column has one, two or three.
const COUNTS: [[f32; 3]; 3] = [[0.74, 0.76, 0.80], [0.36, 0.58, 0.86], [0.90, 0.36, 0.20]];

/// Voxels of a plane by the columns of its pixels, each along the axis that the plane is projected along.
struct Columns {
    codes: Vec<u64>,
    /// By the two other coordinates.
    columns: BTreeMap<[u32; 2], Vec<[u32; 3]>>,
}

/// The axis that [`meshes::slope`] is projected along.
const AXIS: usize = 2;

fn place([x, y, _]: [u32; 3]) -> [u32; 2] {
    [x, y]
}

/// The columns of what a method finds of the plane.
fn columns(voxelizer: &Voxelizer, method: Method) -> Result<Columns, BenchError> {
    let corners = meshes::slope();
    let surface = Surface { corners: &corners, looks: None };
    let options = Options::new(LEVEL, method);
    let codes = voxelizer.voxelize(&surface, &options).map_err(|e| failed(method.name(), e))?.codes;
    let mut columns: BTreeMap<[u32; 2], Vec<[u32; 3]>> = BTreeMap::new();
    for cell in codes.iter().map(|code| morton_place(*code)) {
        columns.entry(place(cell)).or_default().push(cell);
    }
    Ok(Columns { codes, columns })
}

/// All voxels, colored by the number of their column, and the three of one pixel with the plane between them.
///
/// # Errors
/// What the device says.
pub(super) fn pictures(voxelizer: &Voxelizer) -> Result<[(&'static str, Picture); 2], BenchError> {
    let Columns { codes, columns } = columns(voxelizer, Method::ExpandedTested)?;
    let count = |code: u64| columns.get(&place(morton_place(code))).map_or(1, Vec::len);
    let color = |code: u64| COUNTS[count(code).clamp(1, 3) - 1];
    let all = cubes((LEVEL, &codes), DMat4::IDENTITY, &camera(EYE, DVec3::new(0.5, 0.5, 0.42), 36.0), color)?;

    let middle = f64::from(1u32 << LEVEL) * 0.5;
    let from_middle = |at: &[u32; 2]| at.iter().map(|x| (f64::from(*x) + 0.5 - middle).abs()).sum::<f64>();
    let three = columns.iter().filter(|(_, cells)| cells.len() == 3);
    let (at, cells) = three
        .min_by(|a, b| from_middle(a.0).total_cmp(&from_middle(b.0)))
        .ok_or_else(|| failed("picture", "no column has three voxels"))?;
    Ok([("voxels-of-a-column", all), ("three-voxels-of-one-pixel", draw(&of_pixel(*at, cells), &camera_of(cells))?)])
}

/// The voxels of a pixel, the pixel below them, and the plane.
fn of_pixel<'a>(at: [u32; 2], cells: &[[u32; 3]]) -> Vec<Facet<'a>> {
    let edge = 1.0 / f64::from(1u32 << LEVEL);
    let mut facets = Vec::new();
    for cell in cells {
        let low = DVec3::from(cell.map(f64::from)) * edge;
        facets.extend(Facet::faces_of_box(low, DVec3::splat(edge), COUNTS[2], 0.3));
    }
    // The column that the pixel stands for, and its pixel.
    let low = cells.iter().map(|cell| cell[AXIS]).min().unwrap_or(0);
    let foot = DVec3::new(f64::from(at[0]), f64::from(at[1]), f64::from(low) - 1.5) * edge;
    facets.extend(Facet::faces_of_box(foot, DVec3::new(edge, edge, edge * 6.0), [0.55; 3], 0.04));
    facets.extend(Facet::faces_of_box(foot, DVec3::new(edge, edge, edge * 0.03), [0.2, 0.62, 0.3], 0.95));
    // The part of the plane around the pixel.
    let [a, b, c] = meshes::slope()[0];
    let normal = (b - a).cross(c - a);
    let on_plane = |x: f64, y: f64| {
        let (x, y) = ((f64::from(at[0]) + x) * edge, (f64::from(at[1]) + y) * edge);
        DVec3::new(x, y, a.z - (normal.x * (x - a.x) + normal.y * (y - a.y)) / normal.z)
    };
    let (from, to) = (-0.35, 1.35);
    let corner = on_plane(from, from);
    let sides = [on_plane(to, from) - corner, on_plane(from, to) - corner];
    facets.push(Facet::new(corner, sides, |_, _| [0.50, 0.20, 0.62, 0.75]));
    facets
}

fn camera_of(cells: &[[u32; 3]]) -> esvo_core::Camera {
    let edge = 1.0 / f64::from(1u32 << LEVEL);
    let sum: DVec3 = cells.iter().map(|cell| DVec3::from(cell.map(f64::from)) + 0.5).sum();
    let middle = sum / cells.len().max(1) as f64 * edge;
    camera(middle + DVec3::new(-7.5, -4.6, 3.4) * edge, middle, 42.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::voxel_bench::pictures::tests::voxelizer;

    #[test]
    fn a_pixel_of_a_plane_has_one_two_or_three_voxels() {
        let Some(voxelizer) = voxelizer() else { return };
        let corners = meshes::slope();
        let surface = Surface { corners: &corners, looks: None };
        let pixels = voxelizer.pixels(&surface, &Options::new(LEVEL, Method::DominantAxis)).unwrap();
        let size = (pixels.edge as usize).pow(2);
        for (axis, counts) in pixels.counts.chunks(size).enumerate() {
            assert_eq!(counts.iter().any(|count| *count > 0), axis == AXIS);
        }
        let of = |method| columns(&voxelizer, method).unwrap();
        let tested = of(Method::ExpandedTested);
        assert_eq!(tested.codes, esvo_raster::bounds::voxels(&corners, LEVEL));
        let mut numbers = [0; 4];
        tested.columns.values().for_each(|cells| numbers[cells.len() - 1] += 1);
        assert!(numbers[0] > 0 && numbers[1] > 0 && numbers[2] > 20 && numbers[3] == 0, "{numbers:?}");
        // One after the other along the axis.
        assert!(tested.columns.values().all(|cells| cells.windows(2).all(|two| two[0][AXIS] + 1 == two[1][AXIS])));
        // Without a range of depth there is one for each pixel: two thirds of the voxels are missing.
        let one = of(Method::DominantAxis);
        assert!(one.columns.values().all(|cells| cells.len() == 1));
        assert!(one.codes.len() * 2 < tested.codes.len());
        for (name, picture) in pictures(&voxelizer).unwrap() {
            let red = |p: &&[u8]| i32::from(p[0]) > i32::from(p[2]) + 60;
            assert!(picture.rgb8.chunks_exact(3).filter(red).count() > 2000, "{name}");
        }
    }
}
