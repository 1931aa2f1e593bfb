//! MagicaVoxel's `.vox`, written with `dot_vox`.

use std::collections::BTreeMap;

use dot_vox::{Color, Dict, DotVoxData, Frame, Model, SceneNode, ShapeModel, Size, Voxel};

use super::cubes::Cubes;
use super::palette::Palette;

/// The axis of an octree that points up. It becomes the z axis of a model, and axes stay right-handed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Up {
    /// As in most meshes.
    #[default]
    Y,
    /// As in octrees of voxel models.
    Z,
}

/// Largest edge of a model.
const SIDE: u32 = 256;

/// The cubes as models that a scene places side by side.
pub(super) fn model(cubes: &Cubes, up: Up) -> DotVoxData {
    let all = 1u32 << cubes.level;
    let side = all.min(SIDE);
    let palette = Palette::new(cubes.list.iter().map(|cube| cube.color));
    let mut chunks: BTreeMap<[u32; 3], Vec<Voxel>> = BTreeMap::new();
    for cube in &cubes.list {
        let [x, y, z] = cube.position;
        // z points up in these files, and the axes stay right-handed.
        let place = match up {
            Up::Y => [x, all - 1 - z, y],
            Up::Z => [x, y, z],
        };
        let [x, y, z] = place.map(|k| (k % side) as u8);
        let i = palette.index(cube.color);
        chunks.entry(place.map(|k| k / side)).or_default().push(Voxel { x, y, z, i });
    }
    let transform = |attributes: Dict, child: usize| SceneNode::Transform {
        attributes: Dict::new(),
        frames: vec![Frame::new(attributes)],
        child: child as u32,
        layer_id: 0,
    };
    let children = (0..chunks.len()).map(|model| 2 + 2 * model as u32).collect();
    let mut scenes = vec![transform(Dict::new(), 1), SceneNode::Group { attributes: Dict::new(), children }];
    let mut models = Vec::new();
    for (chunk, voxels) in chunks {
        // A model is placed by its middle.
        let [x, y, z] = chunk.map(|k| k * side + side / 2);
        let moved = Dict::from([("_t".to_string(), format!("{x} {y} {z}"))]);
        scenes.push(transform(moved, scenes.len() + 1));
        let model = ShapeModel { model_id: models.len() as u32, attributes: Dict::new() };
        scenes.push(SceneNode::Shape { attributes: Dict::new(), models: vec![model] });
        models.push(Model { size: Size { x: side, y: side, z: side }, voxels });
    }
    let color = |index: usize| {
        let [r, g, b] = palette.colors.get(index).copied().unwrap_or_default();
        Color { r, g, b, a: 255 }
    };
    DotVoxData {
        version: 150,
        index_map: Vec::new(),
        models,
        palette: (0..256).map(color).collect(),
        materials: Vec::new(),
        scenes,
        layers: Vec::new(),
    }
}
