//! MagicaVoxel's `.vox`: models, palette, and the scene that places the models.
//!
//! Read with `dot_vox`, except for rotations, at which it panics if they are not valid. The axes stay those of the program:
//! z points up.

use std::path::Path;

use dot_vox::{Dict, DotVoxData, SceneNode};

use super::assembly::warn;
use super::error::{ImportError, one_line};
use crate::mesh::MAX_ELEMENTS;
use crate::voxels::{ModelVoxel, VoxelModel};

/// Most nodes of the scene that are read, counted once for each way from the root to them.
const MAX_VISITS: usize = 1 << 20;
/// Greatest distance of a voxel from the origin.
const MAX_COORDINATE: i64 = 1 << 30;

/// A rotation or reflection that maps axes to axes, and a translation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Placement {
    /// Coordinate `i` of the result is `signs[i]` times coordinate `axes[i]`.
    axes: [usize; 3],
    signs: [i64; 3],
    moved: [i64; 3],
}

impl Placement {
    const IDENTITY: Self = Self { axes: [0, 1, 2], signs: [1; 3], moved: [0; 3] };

    /// `_r` packs a matrix with one entry in each row: bits 0 to 1 and 2 to 3 hold its column in the first and second row,
    /// bits 4 to 6 the signs.
    fn of_frame(attributes: &Dict) -> Result<Self, String> {
        let mut placement = Self::IDENTITY;
        if let Some(text) = attributes.get("_r") {
            let bad = || format!("the rotation '{}' is not valid", one_line(text));
            let byte: u8 = text.trim().parse().map_err(|_| bad())?;
            let (first, second) = (usize::from(byte & 3), usize::from(byte >> 2 & 3));
            if first == second || first == 3 || second == 3 {
                return Err(bad());
            }
            placement.axes = [first, second, 3 - first - second];
            placement.signs = std::array::from_fn(|row| if byte >> (4 + row) & 1 == 0 { 1 } else { -1 });
        }
        if let Some(text) = attributes.get("_t") {
            let numbers: Option<Vec<i64>> =
                text.split_whitespace().map(|word| word.parse::<i32>().ok().map(i64::from)).collect();
            placement.moved = numbers
                .and_then(|numbers| numbers.try_into().ok())
                .ok_or_else(|| format!("the translation '{}' is not three integers", one_line(text)))?;
        }
        Ok(placement)
    }

    fn apply(&self, p: [i64; 3]) -> [i64; 3] {
        std::array::from_fn(|i| self.signs[i] * p[self.axes[i]] + self.moved[i])
    }

    /// First `inner`, then `self`.
    fn after(&self, inner: &Self) -> Self {
        Self {
            axes: self.axes.map(|axis| inner.axes[axis]),
            signs: std::array::from_fn(|i| self.signs[i] * inner.signs[self.axes[i]]),
            moved: self.apply(inner.moved),
        }
    }

    /// The lower corner of the unit cube at `p` after it has moved.
    fn apply_to_cube(&self, p: [i64; 3]) -> [i64; 3] {
        let corner = self.apply(p);
        // Along a mirrored axis, the upper corner of the cube becomes the lower one.
        std::array::from_fn(|i| if self.signs[i] < 0 { corner[i] - 1 } else { corner[i] })
    }
}

/// Reads a file. Hidden parts are left out, with a warning.
pub(super) fn load(path: &Path, bytes: &[u8]) -> Result<VoxelModel, ImportError> {
    let data = dot_vox::load_bytes(bytes).map_err(|e| ImportError::malformed(path, one_line(e)))?;
    let mut reader = Reader { path, data: &data, model: VoxelModel::default(), uncolored: 0, visits: 0 };
    if data.scenes.is_empty() {
        if data.models.len() > 1 {
            let frames = data.models.len();
            reader.warn(format!(
                "the file has {frames} models without a scene, which are frames of an animation; the first is read"
            ));
        }
        if !data.models.is_empty() {
            // Without a scene, the model's corner is the origin.
            let pivot = pivot(&data, 0);
            reader.add(0, &Placement { moved: pivot, ..Placement::IDENTITY })?;
        }
    } else {
        reader.visit_scene()?;
    }
    if reader.uncolored > 0 {
        let count = reader.uncolored;
        reader.warn(format!("the palette has no colour for {count} of the voxels; they are grey"));
    }
    if reader.model.voxels.is_empty() {
        let hidden = if reader.model.warnings.is_empty() { "" } else { ", or all of them are hidden" };
        return Err(ImportError::unsupported(path, format!("the file has no voxels{hidden}")));
    }
    Ok(reader.model)
}

/// The point of a model that its scene places: the middle, rounded down.
fn pivot(data: &DotVoxData, model: usize) -> [i64; 3] {
    let size = data.models[model].size;
    [size.x, size.y, size.z].map(|x| i64::from(x / 2))
}

struct Reader<'a> {
    path: &'a Path,
    data: &'a DotVoxData,
    model: VoxelModel,
    /// Voxels without a colour in the palette.
    uncolored: usize,
    visits: usize,
}

impl Reader<'_> {
    fn warn(&mut self, line: String) {
        warn(&mut self.model.warnings, line);
    }

    fn visit_scene(&mut self) -> Result<(), ImportError> {
        let data = self.data;
        let mut stack = vec![(0u32, Placement::IDENTITY)];
        while let Some((index, outer)) = stack.pop() {
            self.visits += 1;
            if self.visits > MAX_VISITS {
                return Err(ImportError::malformed(
                    self.path,
                    format!("the scene has more than {MAX_VISITS} nodes, or one that contains itself"),
                ));
            }
            let Some(node) = data.scenes.get(index as usize) else {
                return Err(ImportError::malformed(
                    self.path,
                    format!("node {index} does not exist: there are only {}", data.scenes.len()),
                ));
            };
            match node {
                SceneNode::Transform { attributes, frames, child, layer_id } => {
                    let name = attributes.get("_name").map_or(String::new(), |name| format!(" ({})", one_line(name)));
                    let layer = data.layers.get(*layer_id as usize);
                    if attributes.get("_hidden").is_some_and(|hidden| hidden == "1") {
                        self.warn(format!("node {index}{name} is hidden; it is left out"));
                        continue;
                    }
                    if layer.is_some_and(dot_vox::Layer::hidden) {
                        self.warn(format!(
                            "node {index}{name} is in layer {layer_id}, which is hidden; it is left out"
                        ));
                        continue;
                    }
                    if frames.len() > 1 {
                        let count = frames.len();
                        self.warn(format!("node {index}{name} moves in {count} frames; the first is read"));
                    }
                    let inner = match frames.first() {
                        Some(frame) => Placement::of_frame(&frame.attributes)
                            .map_err(|what| ImportError::malformed(self.path, format!("node {index}{name}: {what}")))?,
                        None => Placement::IDENTITY,
                    };
                    let placement = outer.after(&inner);
                    self.check_range(placement.moved)?;
                    stack.push((*child, placement));
                }
                SceneNode::Group { children, .. } => {
                    // Reversed, because the last node on the stack is processed first.
                    stack.extend(children.iter().rev().map(|&child| (child, outer)));
                    if stack.len() > MAX_VISITS {
                        return Err(ImportError::malformed(
                            self.path,
                            format!("the scene has more than {MAX_VISITS} nodes"),
                        ));
                    }
                }
                SceneNode::Shape { models, .. } => {
                    if models.len() > 1 {
                        let count = models.len();
                        self.warn(format!("node {index} is an animation of {count} models; the first is read"));
                    }
                    if let Some(model) = models.first() {
                        self.add(model.model_id as usize, &outer)?;
                    }
                }
            }
        }
        Ok(())
    }

    /// Refuses places that are too far from the origin, so that sums do not overflow.
    fn check_range(&self, at: [i64; 3]) -> Result<(), ImportError> {
        match at.into_iter().find(|x| x.abs() > MAX_COORDINATE) {
            Some(x) => Err(ImportError::TooLarge {
                path: self.path.into(),
                what: format!("the scene has a coordinate of {x}"),
                limit: MAX_COORDINATE as u64,
            }),
            None => Ok(()),
        }
    }

    /// Adds a model at a place.
    fn add(&mut self, index: usize, placement: &Placement) -> Result<(), ImportError> {
        let data = self.data;
        let Some(model) = data.models.get(index) else {
            let count = data.models.len();
            return Err(ImportError::malformed(
                self.path,
                format!("model {index} does not exist: there are only {count}"),
            ));
        };
        let total = self.model.voxels.len() + model.voxels.len();
        if total > MAX_ELEMENTS {
            return Err(ImportError::TooLarge {
                path: self.path.into(),
                what: format!("the scene has at least {total} voxels with all instances"),
                limit: MAX_ELEMENTS as u64,
            });
        }
        let pivot = pivot(data, index);
        let centred = Placement { moved: pivot.map(|x| -x), ..Placement::IDENTITY };
        let placement = placement.after(&centred);
        self.check_range(placement.moved)?;
        self.model.voxels.reserve(model.voxels.len());
        for voxel in &model.voxels {
            let at = placement.apply_to_cube([voxel.x, voxel.y, voxel.z].map(i64::from)).map(|x| x as i32);
            let color = match data.palette.get(usize::from(voxel.i)) {
                Some(color) => [color.r, color.g, color.b],
                None => {
                    self.uncolored += 1;
                    [128; 3]
                }
            };
            self.model.voxels.push(ModelVoxel { at, color });
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(pairs: &[(&str, &str)]) -> Dict {
        pairs.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned())).collect()
    }

    #[test]
    fn rotations_map_cubes_to_cubes() {
        // Rows: x from y, negative; y from x; z from z. A quarter turn about z.
        let turn = Placement::of_frame(&frame(&[("_r", &(1u8 | 1 << 4).to_string()), ("_t", "10 20 -3")])).unwrap();
        assert_eq!(turn.apply([1, 2, 3]), [8, 21, 0]);
        // The cube from 1, 2, 3 to 2, 3, 4 becomes the one from 7 to 8, 21 to 22 and 0 to 1.
        assert_eq!(turn.apply_to_cube([1, 2, 3]), [7, 21, 0]);
        let twice = turn.after(&turn);
        assert_eq!(twice.apply([1, 2, 3]), turn.apply(turn.apply([1, 2, 3])));
        for bad in ["0", "3", "12", "x", "-1", "300"] {
            assert!(Placement::of_frame(&frame(&[("_r", bad)])).is_err(), "{bad}");
        }
        for bad in ["", "1 2", "1 2 3 4", "1 2 99999999999"] {
            assert!(Placement::of_frame(&frame(&[("_t", bad)])).is_err(), "{bad}");
        }
    }
}
