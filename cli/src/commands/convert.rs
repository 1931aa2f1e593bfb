//! `esvo convert`.

use std::path::Path;

use esvo_format::{WriteOptions, oct};

use crate::args::Convert;
use crate::fail::{Failure, check_output, extension, name_file, open, print};
use crate::words::size;

/// A kind of file, told by the extension.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Esvo,
    Oct,
}

pub(crate) fn run(arguments: &Convert) -> Result<(), Failure> {
    let (from, to) = (kind(&arguments.input)?, kind(&arguments.output)?);
    if arguments.compress.is_some() && to == Kind::Oct {
        return Err(
            format!("{}: .oct files are not compressed; leave out --compress", arguments.output.display()).into()
        );
    }
    check_output(&arguments.output)?;
    let input = |e| name_file(&arguments.input, e);
    let (octree, mut lost) = match from {
        Kind::Esvo => (open(&arguments.input)?, Vec::new()),
        Kind::Oct => {
            let imported = oct::open(&arguments.input).map_err(input)?;
            imported.octree.sound().map_err(|e| name_file(&arguments.input, e))?;
            (imported.octree, imported.lost)
        }
    };
    match to {
        Kind::Esvo => octree.write_with(&arguments.output, &WriteOptions { compress: arguments.compress }),
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

fn kind(path: &Path) -> Result<Kind, Failure> {
    let name = path.display();
    match extension(path).as_str() {
        "esvo" => Ok(Kind::Esvo),
        "oct" => Ok(Kind::Oct),
        "obj" | "gltf" | "glb" | "ply" | "stl" => {
            Err(format!("{name}: is a mesh; octrees are made of meshes by esvo build").into())
        }
        _ => Err(format!("{name}: what kind of file this is, its name must say: .esvo or .oct").into()),
    }
}
