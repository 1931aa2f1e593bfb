//! Another esvo program that builds the same octrees: what it is, and what is read of its builds.

use std::path::Path;
use std::process::{Command, Stdio};

use serde::Deserialize;

use super::record::{BesideBuilds, BuildSample, OtherProgram};
use crate::BenchError;
use crate::build_summary::BuildSeconds;

/// What is read of the summary that the other program prints: less than all of it, so that programs of other versions can be used.
#[derive(Debug, Deserialize)]
pub(super) struct OtherSummary {
    seconds: BuildSeconds,
    peak_bytes: u64,
    voxels: u64,
    image_bytes: u64,
}

/// Asks a program for its commit.
///
/// # Errors
/// The program cannot be started, or it fails.
pub(super) fn identify(program: &Path) -> Result<OtherProgram, BenchError> {
    let failed = |e: std::io::Error| BenchError::io(program, e);
    let not_esvo =
        || failed(std::io::Error::other("is not an esvo program that runs here; --beside needs the path of one"));
    if !program.is_file() {
        return Err(not_esvo());
    }
    // A name without a folder is a file here, not a command.
    let path = std::path::absolute(program).map_err(failed)?;
    let output = Command::new(path).arg("--version").stdin(Stdio::null()).output().map_err(|_| not_esvo())?;
    if !output.status.success() {
        return Err(not_esvo());
    }
    Ok(OtherProgram { commit: commit_of(&String::from_utf8_lossy(&output.stdout)).to_owned() })
}

/// The commit in what `--version` prints.
fn commit_of(version: &str) -> &str {
    version.lines().find_map(|line| line.strip_prefix("commit:")).map_or("unknown", str::trim)
}

/// Adds a build to those of an octree.
pub(super) fn add(builds: &mut Option<BesideBuilds>, summary: &OtherSummary, cpu_seconds: Option<f64>, load: f64) {
    let OtherSummary { seconds, peak_bytes, voxels, image_bytes } = *summary;
    let all = builds.get_or_insert(BesideBuilds { voxels, image_bytes, samples: Vec::new() });
    all.samples.push(BuildSample { seconds, peak_bytes, cpu_seconds, load });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_commit_is_found_where_version_names_it() {
        assert_eq!(commit_of("esvo 0.1.0\ncommit:  357f17512345\nengines: cpu\n"), "357f17512345");
        assert_eq!(commit_of("esvo 0.1.0\n"), "unknown");
        assert!(identify(Path::new("no/such/program")).is_err());
    }

    #[test]
    fn summaries_with_other_settings_are_read() {
        let text = r#"{"schema": 1, "settings": {"texture_test": "of another version"}, "voxels": 7, "image_bytes": 40, "peak_bytes": 9,
            "seconds": {"import": 1.0, "build": 2.0, "prepare": 0.1, "voxelize": 1.8, "write": 0.1}}"#;
        let summary: OtherSummary = serde_json::from_str(text).unwrap();
        let mut builds = None;
        add(&mut builds, &summary, Some(3.0), 0.5);
        add(&mut builds, &summary, None, 0.5);
        let builds = builds.unwrap();
        assert_eq!((builds.voxels, builds.image_bytes, builds.samples.len()), (7, 40, 2));
        assert_eq!((builds.samples[0].cpu_seconds, builds.samples[1].cpu_seconds), (Some(3.0), None));
    }
}
