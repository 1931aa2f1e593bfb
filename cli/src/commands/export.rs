//! `esvo export`.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use esvo_builder::export::{self, Cubes};
use esvo_format::{Octree, write_atomically};

use crate::fail::{Failure, print};
use crate::files::{check_extension, check_not_input, check_output, extension, name_file, open};
use crate::memory::check_memory;
use crate::words::{count, size};

/// Export the voxels of a level for other programs: points (.ply), a voxel model (.vox) or a grid (.nvdb).
#[derive(Debug, Args)]
#[command(after_help = "\
.ply   one point for each voxel of the level, and for each leaf above it, at its centre in mesh
       space, with its normal, its colour and its size. Binary, for MeshLab, CloudCompare, Blender.
.vox   MagicaVoxel: cubes of the level, in models of up to 256 x 256 x 256, with 255 colours: those of
       the octree, or the best that stand for more.
.nvdb  NanoVDB, version 32: cubes of the level as active values, a float grid 'density' of ones and,
       if the octree has colours, an Rgba8 grid 'color'. Its map places the grids in mesh space.

A leaf above the level fills all cubes in it, but for those that contours leave out.

Examples:
  esvo export sibenik.esvo -o sibenik.ply
  esvo export castle.esvo -o castle.vox --level 8 --up z
  esvo export dragon.esvo -o dragon.nvdb --level 10")]
pub(crate) struct ExportArguments {
    /// The octree
    pub(crate) file: PathBuf,
    /// The file to write: .ply, .vox or .nvdb
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: PathBuf,
    /// The level whose voxels are written, 1 to 21 [default: the deepest one of the object, but at most 8 in a .vox and 10 in a .nvdb]
    #[arg(short, long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=21))]
    pub(crate) level: Option<u32>,
    /// The object, counted from 0
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(crate) object: usize,
    /// The axis of the octree that points up: it becomes the z axis of a .vox [default: y]
    #[arg(long, value_name = "AXIS")]
    pub(crate) up: Option<Up>,
}

/// An axis that points up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Up {
    /// As in most meshes
    Y,
    /// As in octrees of voxel models
    Z,
}

impl From<Up> for export::Up {
    fn from(up: Up) -> Self {
        match up {
            Up::Y => Self::Y,
            Up::Z => Self::Z,
        }
    }
}

pub(crate) fn run_export(arguments: &ExportArguments) -> Result<(), Failure> {
    let ExportArguments { file, output, .. } = arguments;
    check_output(output)?;
    let kind = extension(output);
    if !matches!(kind.as_str(), "ply" | "vox" | "nvdb") {
        check_extension(output, "ply", "voxels are exported as .ply, .vox or .nvdb")?;
    }
    if arguments.up.is_some() && kind != "vox" {
        return Err(format!("--up applies to .vox files only; leave it out for .{kind}").into());
    }
    check_not_input(output, file)?;
    let octree = open(file, true)?;
    let objects = octree.objects();
    let Some(object) = objects.get(arguments.object) else {
        let has = count(objects.len() as u64, "object");
        return Err(format!("--object {}: {} has {has}, counted from 0", arguments.object, file.display()).into());
    };
    let most = match kind.as_str() {
        "vox" => 8,
        "nvdb" => 10,
        _ => 21,
    };
    let level = arguments.level.unwrap_or(object.levels.clamp(1, most));
    let written = match kind.as_str() {
        "ply" => points(arguments, &octree, level)?,
        _ => cubes(arguments, &octree, level, &kind)?,
    };
    let bytes = std::fs::metadata(output).map_or(0, |m| m.len());
    print(&format!("{}: level {level}, {written}, {}\n", output.display(), size(bytes)))
}

fn failed(output: &Path, error: &std::io::Error) -> Failure {
    name_file(output, error).into()
}

/// Writes a point for each voxel. Returns how many, in words.
fn points(arguments: &ExportArguments, octree: &Octree, level: u32) -> Result<String, Failure> {
    write_atomically(&arguments.output, |out| export::write_points(out, octree, arguments.object, level))
        .map_err(|e| failed(&arguments.output, &e))?;
    Ok(count(export::voxel_count(octree, arguments.object, level), "point"))
}

/// Writes the cubes of the level. Returns how many, in words.
fn cubes(arguments: &ExportArguments, octree: &Octree, level: u32, kind: &str) -> Result<String, Failure> {
    let output = &arguments.output;
    let needed = Cubes::count(octree, arguments.object, level);
    let too_many = format!("{}: {needed} cubes of level {level}", output.display());
    if needed > export::MAX_CUBES {
        return Err(
            format!("{too_many}, and at most {} can be written; choose a lower --level", export::MAX_CUBES).into()
        );
    }
    check_memory(needed as usize * Cubes::BYTES, &too_many)?;
    let cubes = Cubes::new(octree, arguments.object, level);
    let up = arguments.up.map_or(export::Up::default(), Into::into);
    write_atomically(output, |out| match kind {
        "vox" => export::write_model(out, &cubes, up),
        _ => export::write_grids(out, &cubes),
    })
    .map_err(|e| failed(output, &e))?;
    Ok(count(cubes.list.len() as u64, "cube"))
}
