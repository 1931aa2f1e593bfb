//! `esvo build --part`: one part of a build, to be joined with the others.

use std::path::Path;
use std::time::Instant;

use esvo_builder::{BuildError, BuildSettings, FileOptions, Mesh, Progress, build_part};
use serde::Serialize;

use crate::commands::build::BuildArguments;
use crate::commands::build::input::Input;
use crate::fail::Failure;
use crate::words::{count, size};

/// What `--json` prints.
#[derive(Serialize)]
struct PartSummary<'a> {
    /// Of the part: its number, the number of parts, cubes, voxels.
    #[serde(flatten)]
    built: esvo_builder::BuiltPart,
    file: &'a Path,
    bytes: u64,
    source: &'a str,
    build_seconds: f64,
}

/// A part as in `2/7`.
pub(crate) fn parse_part(text: &str) -> Result<(u32, u32), String> {
    let numbers = text.split_once('/').and_then(|(part, parts)| Some((part.parse().ok()?, parts.parse().ok()?)));
    let found: Option<(u32, u32)> =
        numbers.filter(|(part, parts)| (1..=4096).contains(parts) && (1..=*parts).contains(part));
    found.ok_or_else(|| "expected K/N with K from 1 to N and N up to 4096, e.g. 2/7".into())
}

/// The mesh of which a part can be built.
fn mesh<'a>(input: &'a Input, source: &str) -> Result<&'a Mesh, Failure> {
    match input {
        Input::Mesh(mesh) => Ok(mesh),
        Input::Displaced(..) => Err(format!(
            "{source}: a mesh that is displaced into more than 1.6 million triangles is built as a whole; leave out --part, or \
             displace it in larger cells (--cell)"
        )
        .into()),
        Input::Voxels(_) => Err(format!("{source}: --part does not apply to voxel models; leave it out").into()),
    }
}

/// Builds a part and says what it has.
pub(crate) fn run(
    arguments: &BuildArguments,
    part: (u32, u32),
    input: &Input,
    source: &str,
    settings: &BuildSettings,
    options: &FileOptions,
    progress: &(dyn Fn(Progress) + Sync),
) -> Result<String, Failure> {
    let start = Instant::now();
    let output = &arguments.output;
    let built = build_part(mesh(input, source)?, settings, part, output, options, progress).map_err(|e| match e {
        BuildError::Io { .. } | BuildError::Busy(_) | BuildError::OtherWork(_) | BuildError::Part { .. } => {
            e.to_string()
        }
        _ => format!("{source}: {e}"),
    })?;
    let bytes = std::fs::metadata(output).map_or(0, |m| m.len());
    let seconds = start.elapsed().as_secs_f64();
    if arguments.json {
        let summary = PartSummary { built, file: output, bytes, source, build_seconds: seconds };
        return Ok(format!("{}\n", serde_json::to_string_pretty(&summary)?));
    }
    Ok(format!(
        "{}: part {} of {}, {}, {}, {}, built in {seconds:.1} s; esvo join takes all parts\n",
        output.display(),
        built.part,
        built.parts,
        count(built.cubes, "cube"),
        count(built.voxels, "voxel"),
        size(bytes),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_two_numbers() {
        assert_eq!(parse_part("2/7"), Ok((2, 7)));
        assert_eq!(parse_part("4096/4096"), Ok((4096, 4096)));
        for wrong in ["0/7", "8/7", "1/0", "1/4097", "2", "/", "a/b", "-1/2", "1/2/3"] {
            assert!(parse_part(wrong).unwrap_err().contains("K/N"), "{wrong}");
        }
    }
}
