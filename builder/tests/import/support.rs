//! Files in a temporary directory, and what the importer makes of them.

use std::fs;
use std::path::PathBuf;

use base64::Engine;
use esvo_builder::import::load_mesh;
use esvo_builder::{BuildSettings, Mesh, build};
use esvo_format::Octree;
use tempfile::TempDir;

/// A directory that holds the files of one test.
pub(crate) struct Files(TempDir);

impl Files {
    pub(crate) fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub(crate) fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> &Self {
        fs::write(self.path(name), bytes).unwrap();
        self
    }

    /// The mesh in a valid file.
    pub(crate) fn mesh(&self, name: &str) -> Mesh {
        let mesh = load_mesh(&self.path(name)).unwrap_or_else(|e| panic!("{e}"));
        mesh.validate().unwrap();
        mesh
    }

    /// The error for an invalid file, without the directory of the test.
    pub(crate) fn error(&self, name: &str) -> String {
        let error = load_mesh(&self.path(name)).map(|m| m.triangle_count()).expect_err("the file must be refused");
        error.to_string().replace(&format!("{}/", self.0.path().display()), "")
    }

    /// Writes a file and returns the error for it.
    pub(crate) fn refuse(&self, name: &str, bytes: impl AsRef<[u8]>) -> String {
        self.write(name, bytes).error(name)
    }

    /// Writes a file and returns the mesh in it.
    pub(crate) fn accept(&self, name: &str, bytes: impl AsRef<[u8]>) -> Mesh {
        self.write(name, bytes).mesh(name)
    }
}

/// A PNG file of RGBA texels.
pub(crate) fn png(width: u32, height: u32, texels: &[[u8; 4]]) -> Vec<u8> {
    let image = image::RgbaImage::from_raw(width, height, texels.as_flattened().to_vec()).unwrap();
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}

/// Bytes as a data URI.
pub(crate) fn data_uri(bytes: &[u8]) -> String {
    format!("data:application/octet-stream;base64,{}", base64::engine::general_purpose::STANDARD.encode(bytes))
}

/// The finest voxels of a mesh with their places and colours (sRGB-encoded), without contours, so that every voxel that meets
/// the surface is there.
pub(crate) fn voxels(mesh: &Mesh, levels: u32) -> Vec<([u32; 3], [u8; 3])> {
    let settings = BuildSettings { levels, contours: false, plain_attributes: true, ..BuildSettings::default() };
    octree_voxels(&build(mesh, &settings, &|_| ()).unwrap_or_else(|e| panic!("{e}")).octree, levels)
}

/// The leaves of an octree with their places, in voxels of the deepest level, and colours. All must be on that level.
pub(crate) fn octree_voxels(octree: &Octree, levels: u32) -> Vec<([u32; 3], [u8; 3])> {
    octree.sound().unwrap();
    let mut found = Vec::new();
    let mut waiting = vec![(octree.objects()[0].root_slot as u32, 1, [0; 3])];
    while let Some((slot, level, at)) = waiting.pop() {
        let descriptor = octree.descriptor(slot);
        for child in (0..8u8).filter(|c| descriptor.valid_mask() >> c & 1 != 0) {
            let at: [u32; 3] = std::array::from_fn(|axis| 2 * at[axis] + u32::from(child >> axis & 1));
            match octree.child(slot, child) {
                Some(next) => waiting.push((next, level + 1, at)),
                None => {
                    assert_eq!(level, levels, "a leaf above the deepest level");
                    let color = octree.color(slot, child).unwrap();
                    found.push((at, std::array::from_fn(|k| (color[k] * 255.0).round() as u8)));
                }
            }
        }
    }
    found
}

/// How many voxels have each colour, the least colour first.
pub(crate) fn colors(voxels: &[([u32; 3], [u8; 3])]) -> Vec<([u8; 3], usize)> {
    let mut counts = std::collections::BTreeMap::new();
    for (_, color) in voxels {
        *counts.entry(*color).or_insert(0) += 1;
    }
    counts.into_iter().collect()
}

/// For a square of 16 x 16 voxels with a texture of red and white: the row of voxels through the upper half of its middle
/// third, from left to right, and the column through the left half of its middle third, from top to bottom.
pub(crate) fn lines(mesh: &Mesh) -> (String, String) {
    let voxels = voxels(mesh, 4);
    assert_eq!(voxels.len(), 256);
    // At least half of the light is red, in linear values.
    let letter = |(_, color): ([u32; 3], [u8; 3])| if color[1] < 188 { 'r' } else { 'w' };
    let line = |along: usize, across: usize, place: u32| {
        let mut line: Vec<_> = voxels.iter().copied().filter(|(at, _)| at[across] == place).collect();
        line.sort_by_key(|(at, _)| at[along]);
        line
    };
    (line(0, 1, 9).into_iter().map(letter).collect(), line(1, 0, 6).into_iter().rev().map(letter).collect())
}
