//! Displacement as `esvo build` offers it.

use std::path::{Path, PathBuf};

use clap::Args;
use esvo_bench::scene;
use esvo_builder::{BuildError, Mesh, displace, import};

use crate::fail::Failure;

/// Options of displacement.
#[derive(Debug, Args)]
pub(crate) struct Displacement {
    /// Displace surfaces by the height maps of their materials (map_bump and disp of .mtl): AMPLITUDE is what white stands
    /// for, in mesh units, where the material says a factor of 1 [without a number: 1/500 of the mesh's largest extent]
    #[arg(long, value_name = "AMPLITUDE", num_args = 0..=1, default_missing_value = "auto", allow_negative_numbers = true, value_parser = parse_amplitude)]
    pub(crate) displace: Option<Amplitude>,
    /// Give a material a height map, or another one; implies --displace
    #[arg(long, value_name = "MATERIAL=FILE", value_parser = parse_height_map)]
    pub(crate) height_map: Vec<(String, PathBuf)>,
}

/// What a height of 1 stands for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Amplitude {
    /// In proportion to the mesh.
    Auto,
    /// In mesh units.
    Units(f64),
}

fn parse_amplitude(text: &str) -> Result<Amplitude, String> {
    if text == "auto" {
        return Ok(Amplitude::Auto);
    }
    let number = text.parse::<f64>().ok().filter(|x| x.is_finite());
    number.map(Amplitude::Units).ok_or_else(|| "write a number of mesh units, as 0.05".into())
}

fn parse_height_map(text: &str) -> Result<(String, PathBuf), String> {
    match text.split_once('=') {
        Some((material, file)) if !file.is_empty() => Ok((material.to_owned(), file.into())),
        _ => Err("write the name of a material, an equals sign and an image file, as stone=stone-height.png".into()),
    }
}

impl Displacement {
    /// The mesh as it is to be built to `levels`: displaced if that was asked for, or if the scene `always` is. In cells of
    /// two of the finest voxels. `source` is what errors call the mesh.
    pub(crate) fn apply(&self, mut mesh: Mesh, source: &str, levels: u32, always: bool) -> Result<Mesh, Failure> {
        if self.displace.is_none() && self.height_map.is_empty() && !always {
            return Ok(mesh);
        }
        for (name, file) in &self.height_map {
            set_height_map(&mut mesh, name, file)?;
        }
        let mut options = scene::displacement(&mesh, levels);
        if let Some(Amplitude::Units(units)) = self.displace {
            options.scale = units;
        }
        displace(&mesh, &options).map_err(|error| match error {
            BuildError::Setting { .. } => format!("--displace: {error}").into(),
            _ => format!("{source}: {error}").into(),
        })
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_are_read() {
        assert_eq!(parse_amplitude("-0.5"), Ok(Amplitude::Units(-0.5)));
        assert_eq!(parse_amplitude("auto"), Ok(Amplitude::Auto));
        assert!(parse_amplitude("inf").is_err() && parse_amplitude("").is_err());
        assert_eq!(parse_height_map("a b=c=d.png"), Ok(("a b".into(), "c=d.png".into())));
        assert!(parse_height_map("stone.png").is_err() && parse_height_map("a=").is_err());
    }
}
