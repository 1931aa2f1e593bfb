//! What a built file says about itself: the registered metadata (spec 2.3).

use std::path::Path;

use esvo_builder::BuildSettings;
use esvo_builder::import::Format;
use esvo_format::{Bounds, Handedness, Metadata, ObjectMetadata, UpAxis};
use serde_json::Value;

use super::BuildArguments;
use super::input::{Input, is_standard_input};
use crate::fail::Failure;

/// The metadata of what is built. `source`: name of the mesh.
pub(super) fn metadata(
    arguments: &BuildArguments,
    input: &Input,
    source: &str,
    settings: &BuildSettings,
) -> Result<Metadata, Failure> {
    let object = ObjectMetadata { name: name(arguments), bounds: bounds(input), ..ObjectMetadata::default() };
    let mut members = serde_json::to_value(settings)?.as_object().cloned();
    let components = settings.components.names();
    if let Some(members) = members.as_mut().filter(|_| !components.is_empty()) {
        members.insert("components".into(), components.into());
    }
    let mut metadata = Metadata {
        generator: Some(concat!("esvo ", env!("CARGO_PKG_VERSION")).into()),
        source: Some(source.into()),
        settings: members,
        objects: if object == ObjectMetadata::default() { Vec::new() } else { vec![object] },
        ..Metadata::default()
    };
    match input {
        Input::Voxels(model) => metadata.model_voxels = Some(model.voxels.len() as u64),
        Input::Mesh(_) | Input::Displaced(..) => metadata.triangles = Some(input.triangles() as u64),
    }
    if let Input::Displaced(_, displacement) = input {
        let members = [("scale", displacement.scale), ("cell", displacement.cell)];
        metadata.displacement =
            Some(members.map(|(name, value)| (name.into(), Value::from(value))).into_iter().collect());
    }
    say_space(arguments, &mut metadata);
    Ok(metadata)
}

/// What the format of the mesh says of its space, and the user, who knows better.
fn say_space(arguments: &BuildArguments, metadata: &mut Metadata) {
    let given = arguments.format.map(Format::from);
    match given.or_else(|| Format::of_extension(arguments.mesh.as_deref()?)) {
        Some(Format::Gltf | Format::Glb) => {
            (metadata.unit, metadata.up, metadata.handedness) = (Some(1.0), Some(UpAxis::Y), Some(Handedness::Right));
        }
        Some(Format::Vox) => (metadata.up, metadata.handedness) = (Some(UpAxis::Z), Some(Handedness::Right)),
        _ => {}
    }
    arguments.space.apply(metadata);
}

fn name(arguments: &BuildArguments) -> Option<String> {
    let of_file = |path: &Path| Some(path.file_stem()?.to_string_lossy().into_owned());
    let mesh = || arguments.mesh.as_deref().filter(|path| !is_standard_input(path)).and_then(of_file);
    arguments.name.clone().or_else(|| arguments.scene.clone()).or_else(mesh)
}

/// Bounds of the surface; not known of a mesh that is displaced while it is built.
fn bounds(input: &Input) -> Option<Bounds> {
    let (low, high) = match input {
        Input::Mesh(mesh) => mesh.bounds()?,
        Input::Voxels(model) => model.bounds()?,
        Input::Displaced(..) => return None,
    };
    Some(Bounds { low, high })
}
