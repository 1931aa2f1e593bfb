//! A grid in tiles: each is as large as one binding of the device, and empty ones are skipped.

use glam::DVec3;
use rayon::prelude::*;

/// A cube of the grid, and the triangles that may meet it.
#[derive(Clone, Debug)]
pub(crate) struct Tile {
    /// Its lowest voxel.
    pub(crate) corner: [u32; 3],
    /// Voxels along its edge, a power of two.
    pub(crate) edge: u32,
    /// Indices of triangles, ascending.
    pub(crate) triangles: Vec<u32>,
}

/// Most voxels along the edge of a tile: the code of a voxel in it has 30 bits.
const LARGEST: u32 = 1024;

/// Voxels along the edge of the tiles of a grid of `voxels` voxels, where a binding has at most `bytes`.
pub(crate) fn edge(voxels: u32, bytes: u64) -> u32 {
    let mut edge = voxels.min(LARGEST);
    while edge > 32 && u64::from(edge).pow(3) / 8 > bytes {
        edge /= 2;
    }
    edge
}

/// The tiles of a grid that triangles may meet, in Morton order. `corners` are in edges of the grid.
pub(crate) fn tiles(corners: &[[DVec3; 3]], voxels: u32, edge: u32) -> Vec<Tile> {
    let across = voxels / edge;
    let mut corners_of_tiles: Vec<[u32; 3]> = (0..across.pow(3))
        .map(|i| [i % across * edge, i / across % across * edge, i / (across * across) * edge])
        .collect();
    corners_of_tiles.sort_by_key(|&corner| esvo_format::morton(corner));
    corners_of_tiles
        .into_par_iter()
        .filter_map(|corner| {
            // A voxel more, for surfaces in the faces of the tile.
            let low = DVec3::from(corner.map(|x| (f64::from(x) - 1.0) / f64::from(voxels)));
            let high = DVec3::from(corner.map(|x| (f64::from(x + edge) + 1.0) / f64::from(voxels)));
            let meets =
                |[a, b, c]: &[DVec3; 3]| a.max(*b).max(*c).cmpge(low).all() && a.min(*b).min(*c).cmple(high).all();
            let triangles: Vec<u32> =
                (0..corners.len() as u32).filter(|&index| meets(&corners[index as usize])).collect();
            (!triangles.is_empty()).then_some(Tile { corner, edge, triangles })
        })
        .collect()
}
