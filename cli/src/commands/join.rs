//! `esvo join`: octrees into one file with all their objects, or the parts of a build into its octree.

use std::path::{Path, PathBuf};

use clap::Args;
use esvo_builder::{BuildError, is_part, join_parts};
use esvo_format::file::InstanceEntry;
use esvo_format::{Metadata, ObjectMetadata, Octree, WriteOptions, join};
use glam::DMat4;

use crate::fail::{Failure, print};
use crate::files::{check_extension, check_not_input, check_output, extension, name_file, open_verified};
use crate::memory::check_memory;
use crate::space::SpaceArguments;
use crate::stage::{LIST, Listed};
use crate::words::{count, size};

/// Join octrees into one file, all their objects at their places, or what a scene list places; or the parts of a build into its octree.
#[derive(Debug, Args)]
#[command(after_help = "\
Every file is checked against every rule first; if one is damaged, nothing is written. Objects keep
their transforms and all their data, and instances stay. Metadata that all files have alike stay
those of the file; all others become those of the objects, and objects without a name get that of
their file. Sections of vendors stay behind.

Parts that esvo build --part made become the file of a whole build, byte for byte: all of them are
needed, in any order. Their metadata is that of the build. --compress, --parts and --hash say how it
is stored.

A scene list (.toml) in place of octrees makes a file with each of its octrees once, and an instance
for every place: esvo render shows the same for the list and for the file. A place may have a name.
scenes/README.md has the keys of a list.

Examples:
  esvo join house.esvo garden.esvo -o place.esvo
  esvo join forest.toml -o forest.esvo --hash
  esvo join *.esvopart -o city.esvo")]
pub(crate) struct JoinArguments {
    /// The octrees, at least two; or one scene list; or the parts of a build
    #[arg(required = true, num_args = 1..)]
    pub(crate) files: Vec<PathBuf>,
    /// The file to write: .esvo
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: PathBuf,
    /// Compress the blocks with Zstandard at this level, 1 to 22 [without a number: 3]
    #[arg(long, value_name = "LEVEL", num_args = 0..=1, default_missing_value = "3", value_parser = clap::value_parser!(i32).range(1..=22))]
    pub(crate) compress: Option<i32>,
    /// Store the blocks in parts by level, as streams of fields: the smallest files, and a coarse version is read by few
    /// ranges. --compress says how hard their streams are compressed
    #[arg(long)]
    pub(crate) parts: bool,
    /// Write a SHA-256 of the file and an id of its octrees, which `esvo validate` compares
    #[arg(long)]
    pub(crate) hash: bool,
    #[command(flatten)]
    pub(crate) space: SpaceArguments,
}

pub(crate) fn run_join(arguments: &JoinArguments) -> Result<(), Failure> {
    let output = &arguments.output;
    check_output(output)?;
    check_extension(output, "esvo", "octrees are joined in an .esvo")?;
    arguments.files.iter().try_for_each(|file| check_not_input(output, file))?;
    let options = WriteOptions { compress: arguments.compress, parts: arguments.parts, hash: arguments.hash };
    let mut parts = Vec::new();
    for file in &arguments.files {
        if is_part(file).map_err(|error| format!("{}: cannot be read: {error}", file.display()))? {
            parts.push(file);
        }
    }
    if parts.len() == arguments.files.len() {
        return run_join_parts(arguments, &options);
    }
    if let Some(part) = parts.first() {
        let what = "is a part of a build, and other files are octrees; join the parts of a build first";
        return Err(format!("{}: {what}", part.display()).into());
    }
    let Joined { mut octree, names, files, vendors } = match &arguments.files[..] {
        [list] if extension(list) == LIST => of_list(list, output)?,
        [_] => {
            let what = "one octree is nothing to join; give two or more, a scene list (.toml), or all parts of a build";
            return Err(what.into());
        }
        files => of_octrees(files, output)?,
    };
    let mut metadata = Metadata::parse(octree.meta())?;
    arguments.space.apply(&mut metadata);
    name_objects(&mut metadata, &files);
    if let Some(names) = names {
        let name = |name: Option<String>| ObjectMetadata { name, ..ObjectMetadata::default() };
        let named = !octree.instances().is_empty() && names.iter().any(Option::is_some);
        metadata.instances = if named { names.into_iter().map(name).collect() } else { Vec::new() };
    }
    octree.set_metadata(&metadata).map_err(|error| name_file(output, error))?;
    octree.write_with(output, &options).map_err(|error| name_file(output, error))?;
    let bytes = std::fs::metadata(output).map_or(0, |m| m.len());
    let mut text = format!("{}: {}, {}", output.display(), size(bytes), count(octree.objects().len() as u64, "object"));
    if !octree.instances().is_empty() {
        text += &format!(", {}", count(octree.instances().len() as u64, "instance"));
    }
    text.push('\n');
    for file in vendors {
        text += &format!("left out: sections of vendors of {}\n", file.display());
    }
    print(&text)
}

fn run_join_parts(arguments: &JoinArguments, options: &WriteOptions) -> Result<(), Failure> {
    let output = &arguments.output;
    if arguments.space.is_given() {
        return Err("parts have the metadata of their build; leave out --unit, --up and --handedness".into());
    }
    let object = join_parts(&arguments.files, output, options).map_err(|error| match error {
        BuildError::Format(error) => name_file(output, error),
        error => error.to_string(),
    })?;
    let bytes = std::fs::metadata(output).map_or(0, |m| m.len());
    let voxels = object.descriptors + object.leaf_voxels - 1;
    print(&format!(
        "{}: {}, {}, {}, of {}\n",
        output.display(),
        size(bytes),
        count(object.levels, "level"),
        count(voxels, "voxel"),
        count(arguments.files.len() as u64, "part"),
    ))
}

/// Octrees in one.
struct Joined {
    octree: Octree,
    /// Names of the instances, if a list says them.
    names: Option<Vec<Option<String>>>,
    /// The file that an object comes from.
    files: Vec<PathBuf>,
    /// Files with sections that stay behind.
    vendors: Vec<PathBuf>,
}

fn of_octrees(files: &[PathBuf], output: &Path) -> Result<Joined, Failure> {
    let octrees: Vec<Octree> = files.iter().map(|file| open_verified(file)).collect::<Result<_, _>>()?;
    let bytes = octrees.iter().map(|octree| size_of_val(octree.slots())).sum();
    check_memory(bytes, &format!("{}: {} octrees", output.display(), octrees.len()))?;
    let octree = join(&octrees.iter().collect::<Vec<_>>()).map_err(|error| name_file(output, error))?;
    let each = || files.iter().zip(&octrees);
    let of_objects = each().flat_map(|(file, octree)| octree.objects().iter().map(|_| file.clone())).collect();
    let vendors = each().filter(|(_, octree)| !octree.unknown_sections().is_empty()).map(|(file, _)| file.clone());
    Ok(Joined { octree, names: None, files: of_objects, vendors: vendors.collect() })
}

fn of_list(list: &Path, output: &Path) -> Result<Joined, Failure> {
    let Listed { mut octree, instances, names, files } = Listed::load(list, true)?;
    files.iter().try_for_each(|file| check_not_input(output, file))?;
    octree.verified().map_err(|broken| name_file(list, broken))?;
    // If each object is there once, where its own transform puts it, nothing needs to be said.
    let plain = |(object, one): (u32, &InstanceEntry)| one.object == object && one.matrix() == DMat4::IDENTITY;
    let trivial = instances.len() == octree.objects().len() && (0..).zip(&instances).all(plain);
    let named = names.iter().any(Option::is_some);
    let instances = if trivial && !named { Vec::new() } else { instances };
    octree.set_instances(instances).map_err(|broken| name_file(list, broken))?;
    Ok(Joined { octree, names: Some(names), files, vendors: Vec::new() })
}

/// Gives objects without a name that of their file.
fn name_objects(metadata: &mut Metadata, files: &[PathBuf]) {
    metadata.objects.resize(files.len(), ObjectMetadata::default());
    for (object, file) in metadata.objects.iter_mut().zip(files) {
        let stem = || Some(file.file_stem()?.to_string_lossy().into_owned());
        object.name = object.name.take().or_else(stem);
    }
}
