//! `esvo convert`.

use std::path::{Path, PathBuf};

use clap::Args;
use esvo_format::{Metadata, Octree, WriteOptions, oct};

use crate::fail::{Failure, print};
use crate::files::{check_output, extension, name_file, open_verified};
use crate::remote::{Local, RemoteArguments, bare};
use crate::space::SpaceArguments;
use crate::words::size;

/// A kind of file, given by the extension.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Esvo,
    Oct,
}

/// Convert between .esvo and the .oct files of the paper's authors, or rewrite an .esvo.
#[derive(Debug, Args)]
#[command(after_help = "\
The extension tells the kind of a file. Contours, block-compressed colours and normals are copied
bit for bit. Data that the other kind of file cannot store is listed. An .esvo is checked against
every rule first; if it is damaged, nothing is written. Metadata and instances of an .esvo stay;
--unit, --up and --handedness change what it says of its space.

The input may be on a web server or in an object store (http://, https://, s3://, gs://, az://), if the
program was built with --features remote: all of it is read, to a temporary file.

Examples:
  esvo convert sibenik.oct -o sibenik.esvo
  esvo convert sibenik.esvo -o sibenik.oct
  esvo convert sibenik.esvo -o small.esvo --compress
  esvo convert sibenik.esvo -o served.esvo --parts --hash
  esvo convert scan.esvo -o scan-cm.esvo --unit 0.01 --up +z
  esvo convert https://example.org/sibenik.esvo -o sibenik.esvo")]
pub(crate) struct ConvertArguments {
    /// The file to read: .esvo or .oct, or its address
    pub(crate) input: PathBuf,
    /// The file to write: .esvo or .oct
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: PathBuf,
    /// Compress the blocks of an .esvo with Zstandard at this level, 1 to 22 [without a number: 3]
    #[arg(long, value_name = "LEVEL", num_args = 0..=1, default_missing_value = "3", value_parser = clap::value_parser!(i32).range(1..=22))]
    pub(crate) compress: Option<i32>,
    /// Store the blocks in parts by level, as streams of fields: the smallest files, and a coarse version is read by few
    /// ranges. --compress says how hard their streams are compressed
    #[arg(long)]
    pub(crate) parts: bool,
    /// Write a SHA-256 of the file and an id of its octrees, which `esvo validate` compares. Files that have both get both again
    #[arg(long)]
    pub(crate) hash: bool,
    #[command(flatten)]
    pub(crate) space: SpaceArguments,
    #[command(flatten)]
    pub(crate) remote: RemoteArguments,
}

pub(crate) fn run_convert(arguments: &ConvertArguments) -> Result<(), Failure> {
    let (from, to) = (kind(&bare(&arguments.input))?, kind(&arguments.output)?);
    let option = if arguments.parts { "--parts" } else { "--compress" };
    if (arguments.compress.is_some() || arguments.parts) && to == Kind::Oct {
        return Err(format!("{}: .oct files are not compressed; leave out {option}", arguments.output.display()).into());
    }
    if (arguments.hash || arguments.space.is_given()) && to == Kind::Oct {
        let what = "an .oct file holds neither a hash nor metadata; leave out --hash, --unit, --up and --handedness";
        return Err(format!("{}: {what}", arguments.output.display()).into());
    }
    check_output(&arguments.output)?;
    let local = Local::of(&arguments.input, &arguments.remote)?;
    let opened = read(from, local.path());
    let (mut octree, mut lost) = opened.map_err(|failure| local.rename(failure, &arguments.input))?;
    if arguments.space.is_given() {
        let mut metadata = Metadata::parse(octree.meta())?;
        arguments.space.apply(&mut metadata);
        octree.set_metadata(&metadata).map_err(|e| name_file(&arguments.output, e))?;
    }
    match to {
        Kind::Esvo => {
            let options = WriteOptions { compress: arguments.compress, parts: arguments.parts, hash: arguments.hash };
            octree.write_with(&arguments.output, &options)
        }
        Kind::Oct => oct::write(&octree, &arguments.output).map(|more| lost.extend(more)),
    }
    .map_err(|e| name_file(&arguments.output, e))?;
    let bytes = std::fs::metadata(&arguments.output).map_or(0, |m| m.len());
    let mut text = format!("{}: {}", arguments.output.display(), size(bytes));
    if lost.is_empty() {
        text += ", nothing lost\n";
    } else {
        text += "\nlost or changed:\n";
        lost.iter().for_each(|loss| text += &format!("  {loss}\n"));
    }
    print(&text)
}

/// The octree of a file, and what the file has beside it that is lost.
fn read(kind: Kind, path: &Path) -> Result<(Octree, Vec<String>), Failure> {
    if kind == Kind::Esvo {
        return Ok((open_verified(path)?, Vec::new()));
    }
    let imported = oct::open(path).map_err(|e| name_file(path, e))?;
    imported.octree.sound().map_err(|e| name_file(path, e))?;
    Ok((imported.octree, imported.lost))
}

fn kind(path: &Path) -> Result<Kind, Failure> {
    let name = path.display();
    match extension(path).as_str() {
        "esvo" => Ok(Kind::Esvo),
        "oct" => Ok(Kind::Oct),
        "obj" | "gltf" | "glb" | "ply" | "stl" => {
            Err(format!("{name}: is a mesh; esvo build makes octrees from meshes").into())
        }
        _ => Err(format!("{name}: has an unknown extension; expected .esvo or .oct").into()),
    }
}
