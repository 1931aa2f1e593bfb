//! `esvo convert`.

use std::path::Path;

use esvo_bench::text::short;
use esvo_format::{Octree, WriteOptions, oct};

use crate::args::Convert;
use crate::fail::{Failure, check_output, name_file, print};

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
        Kind::Esvo => (Octree::open(&arguments.input).map_err(input)?, Vec::new()),
        Kind::Oct => {
            let imported = oct::open(&arguments.input).map_err(input)?;
            (imported.octree, imported.lost)
        }
    };
    octree.sound().map_err(|e| name_file(&arguments.input, e))?;
    match to {
        Kind::Esvo => octree.write_with(&arguments.output, &WriteOptions { compress: arguments.compress }),
        Kind::Oct => oct::write(&octree, &arguments.output).map(|more| lost.extend(more)),
    }
    .map_err(|e| name_file(&arguments.output, e))?;
    let megabytes = |path: &Path| std::fs::metadata(path).map_or(0.0, |m| m.len() as f64 / (1u64 << 20) as f64);
    let mut text = format!("{}: {} MB", arguments.output.display(), short(megabytes(&arguments.output)));
    if lost.is_empty() {
        text += ", nothing lost\n";
    } else {
        text += "\nlost or changed:\n";
        lost.iter().for_each(|loss| text += &format!("  {loss}\n"));
    }
    print(&text)
}

fn kind(path: &Path) -> Result<Kind, Failure> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    match extension.as_deref() {
        Some("esvo") => Ok(Kind::Esvo),
        Some("oct") => Ok(Kind::Oct),
        _ => Err(format!("{}: what kind of file this is, its name must say: .esvo or .oct", path.display()).into()),
    }
}
