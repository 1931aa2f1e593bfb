//! Files that are named on the command line: opening octrees, and checking outputs before long work is done for them.

use std::fmt::Display;
use std::path::Path;

use esvo_format::{Broken, FormatError, Octree, OpenOptions, ids};

use crate::fail::Failure;
use crate::remote::{is_address, shown};

/// The error with the file's name in front, unless it starts with the name.
pub(crate) fn name_file(path: &Path, error: impl Display) -> String {
    let (path, error) = (path.display().to_string(), error.to_string());
    if error.starts_with(&path) { error } else { format!("{path}: {error}") }
}

/// Opens an octree and checks that it is sound. With `verify`, the checksums of all blocks are compared first; without it,
/// neither here nor by casters. If the file is a mesh, a voxel model or an .oct file, the
/// error says so.
pub(crate) fn open(path: &Path, verify: bool) -> Result<Octree, Failure> {
    let options = OpenOptions { verify, ..OpenOptions::default() };
    let octree = Octree::open_with(path, &options).map_err(|error| not_opened(path, error))?;
    octree.intact().and_then(|()| octree.sound()).map_err(|broken| damaged(path, &broken))?;
    Ok(octree)
}

/// Opens an octree and checks every rule: for commands that write an octree or compare two.
pub(crate) fn open_verified(path: &Path) -> Result<Octree, Failure> {
    let octree = Octree::open(path).map_err(|error| not_opened(path, error))?;
    octree.verified().map_err(|broken| damaged(path, &broken))?;
    Ok(octree)
}

/// The error for a file that was not opened.
pub(crate) fn not_opened(path: &Path, error: FormatError) -> String {
    if matches!(error, FormatError::Io { .. }) && is_address(path) {
        let what =
            "is not read from a server here: esvo info, validate, render and convert do that; get the file first";
        let name = shown(path);
        return format!("{name}: {what}: esvo convert {name} -o FILE");
    }
    if let Some(what) = wrong_kind(path, &error) {
        return what;
    }
    // Another copy of a file of another kind or version does not help.
    let strange = [ids::IDENTIFIER, ids::MAJOR_VERSION, ids::REQUIRED_FEATURES, ids::SECTION_REQUIRED];
    match &error {
        FormatError::Broken(broken) if !strange.contains(&broken.rule) => damaged(path, broken),
        _ => name_file(path, error),
    }
}

/// The error for a file that breaks a rule.
pub(crate) fn damaged(path: &Path, broken: &Broken) -> String {
    let name = path.display();
    format!("{name}: {broken}; get the file again, or list all damage: esvo validate {name}")
}

/// The error for a mesh, a voxel model or an .oct file in place of an octree. `None` for other errors and other extensions.
pub(crate) fn wrong_kind(path: &Path, error: &FormatError) -> Option<String> {
    if !matches!(error, FormatError::Broken(broken) if broken.rule == ids::IDENTIFIER) {
        return None;
    }
    let (name, better) = (path.display(), path.with_extension("esvo"));
    match extension(path).as_str() {
        kind @ ("obj" | "gltf" | "glb" | "ply" | "stl" | "vox") => Some(format!(
            "{name}: is a {}, not an octree; build an octree from it first: esvo build {name} -o {}",
            if kind == "vox" { "voxel model" } else { "mesh" },
            better.display()
        )),
        "oct" => Some(format!(
            "{name}: is a file of ESVO 1.4; convert it first: esvo convert {name} -o {}",
            better.display()
        )),
        _ => None,
    }
}

/// The extension in lower-case letters; empty without one.
pub(crate) fn extension(path: &Path) -> String {
    path.extension().map_or(String::new(), |e| e.to_string_lossy().to_lowercase())
}

/// Rejects an output whose extension is not `wanted`.
pub(crate) fn check_extension(path: &Path, wanted: &str, what: &str) -> Result<(), Failure> {
    if extension(path) == wanted {
        return Ok(());
    }
    Err(format!("{}: {what}; give a name that ends in .{wanted}", path.display()).into())
}

/// Rejects an output that cannot be written, before any long work.
pub(crate) fn check_output(path: &Path) -> Result<(), Failure> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if !folder.is_dir() {
        return Err(format!("{}: the folder {} does not exist; make it first", path.display(), folder.display()).into());
    }
    let link = std::fs::read_link(path).ok().filter(|_| !path.exists());
    if let Some(target) = link {
        let (name, target) = (path.display(), target.display());
        return Err(format!(
            "{name}: is a link to {target}, which does not exist; remove the link or give another name"
        )
        .into());
    }
    if path.is_dir() {
        return Err(format!("{}: is a folder; give the name of a file", path.display()).into());
    }
    if std::fs::metadata(path).is_ok_and(|m| !m.is_file()) {
        return Err(
            format!("{}: is not a regular file; output is written to a file and renamed", path.display()).into()
        );
    }
    if std::fs::metadata(path).is_ok_and(|m| m.permissions().readonly()) {
        return Err(format!("{}: is read-only; give another name or make it writable", path.display()).into());
    }
    // Output is written under a temporary name first, next to the file that a link leads to.
    let resolved = path.canonicalize().ok();
    let folder = resolved.as_deref().and_then(Path::parent).unwrap_or(folder);
    esvo_bench::output::check_writable(folder)
        .map_err(|e| format!("{}: nothing can be written to its folder: {e}", path.display()).into())
}

/// Rejects an output that is the same file as the input, also through links.
pub(crate) fn check_not_input(output: &Path, input: &Path) -> Result<(), Failure> {
    match (output.canonicalize(), input.canonicalize()) {
        (Ok(a), Ok(b)) if a == b => {
            Err(format!("{}: is the input; give the output another name", output.display()).into())
        }
        _ => Ok(()),
    }
}
