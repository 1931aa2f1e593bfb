//! The displacement options of `esvo build`.

use std::path::{Path, PathBuf};

use clap::Args;
use esvo_bench::scene;
use esvo_builder::{BuildError, Mesh, displace, displaced_triangles, import};

use crate::commands::build::input::Input;
use crate::fail::Failure;
use crate::values::{Amplitude, parse_amplitude, parse_height_map};

/// Options of displacement.
#[derive(Debug, Args)]
pub(crate) struct Displacement {
    /// Displace surfaces by the height maps of their materials (map_bump and disp of .mtl). AMPLITUDE is the displacement of
    /// white in mesh units, multiplied by the material's factor [without a number: 1/500 of the mesh's largest extent]
    #[arg(long, value_name = "AMPLITUDE", num_args = 0..=1, default_missing_value = "auto", allow_negative_numbers = true, value_parser = parse_amplitude)]
    pub(crate) displace: Option<Amplitude>,
    /// Set or replace the height map of a material; implies --displace
    #[arg(long, value_name = "MATERIAL=FILE", value_parser = parse_height_map)]
    pub(crate) height_map: Vec<(String, PathBuf)>,
}

/// Displaced meshes with more triangles than this, about, are built subtree by subtree, which takes less time and memory. Fixed, so that the
/// octree does not depend on the memory.
const WHOLE: f64 = 1.6e6;

impl Displacement {
    /// Displaces the mesh for an octree of `levels`, in cells of two finest voxels, if an option asks for it or `always` is set;
    /// otherwise returns it unchanged. If it would be large and `whole` is not set, it is left to be displaced while it is built.
    /// Errors call the mesh `source`.
    pub(crate) fn apply(
        &self,
        mut mesh: Mesh,
        source: &str,
        levels: u32,
        always: bool,
        whole: bool,
    ) -> Result<Input, Failure> {
        if self.displace.is_none() && self.height_map.is_empty() && !always {
            return Ok(Input::Mesh(mesh));
        }
        for (name, file) in &self.height_map {
            set_height_map(&mut mesh, name, file)?;
        }
        let mut options = scene::displacement(&mesh, levels);
        if let Some(Amplitude::Units(units)) = self.displace {
            options.scale = units;
        }
        let explain = |error: BuildError| match error {
            BuildError::Setting { .. } => format!("--displace: {error}"),
            _ => format!("{source}: {error}"),
        };
        if !whole && displaced_triangles(&mesh, &options).map_err(explain)? > WHOLE {
            return Ok(Input::Displaced(mesh, options));
        }
        Ok(Input::Mesh(displace(&mesh, &options).map_err(explain)?))
    }
}

fn set_height_map(mesh: &mut Mesh, name: &str, file: &Path) -> Result<(), Failure> {
    let map = import::load_height_map(file)?;
    let mut found = false;
    for material in mesh.materials.iter_mut().filter(|m| m.name == name) {
        material.height_map = Some(map.clone());
        found = true;
    }
    if found {
        return Ok(());
    }
    let mut names: Vec<&str> = mesh.materials.iter().map(|m| m.name.as_str()).collect();
    names.sort_unstable();
    names.dedup();
    let more = names.len().saturating_sub(20);
    names.truncate(20);
    let rest = if more > 0 { format!(" and {more} more") } else { String::new() };
    Err(format!("--height-map: the mesh has no material {name}; it has {}{rest}", names.join(", ")).into())
}
