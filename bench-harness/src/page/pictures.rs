//! Pictures to compare, as data in the page.

use std::path::Path;

use base64::Engine;

use crate::records::{Found, Record};
use crate::shadow_bench::PictureNote;
use crate::system::machine::slug;

/// The first bytes of a PNG file, up to the length of its first chunk.
const PNG: &[u8] = b"\x89PNG\r\n\x1a\n";

/// Pictures of one scene from one viewpoint.
pub(super) struct Comparison {
    pub(super) scene: String,
    pub(super) credit: String,
    pub(super) shots: Vec<Shot>,
}

/// A picture.
#[derive(PartialEq)]
pub(super) struct Shot {
    /// What it shows.
    pub(super) label: String,
    /// The file as a data URI.
    pub(super) uri: String,
    pub(super) width: u32,
    pub(super) height: u32,
}

/// The pictures of all records of the paper's tables, of voxelization and of bit volumes, and what was left out. Scenes whose pictures may not be published have none.
/// Those that another record has in the same way are shown once.
pub(super) fn comparisons(found: &[Found], most_bytes: u64) -> (Vec<Comparison>, Vec<String>) {
    let (mut all, mut left_out, mut bytes) = (Vec::<Comparison>::new(), Vec::new(), 0);
    for one in found {
        let folder = one.path.parent().unwrap_or(Path::new(""));
        if let Record::Voxelize(report) = &one.record {
            for group in &report.pictures {
                let mut shots = Vec::new();
                for name in &group.files {
                    match shot(folder, name, method_label(name), most_bytes.saturating_sub(bytes)) {
                        Ok((shot, size)) => {
                            bytes += size;
                            shots.push(shot);
                        }
                        Err(why) => left_out.push(format!("{name} of {}: {why}", one.name)),
                    }
                }
                if !shots.is_empty() {
                    all.push(Comparison { scene: group.what.clone(), credit: group.credit.clone(), shots });
                }
            }
        }
        if let Record::Shadow(report) = &one.record {
            for (scene, notes) in by_scene(&report.pictures) {
                let mut shots = Vec::new();
                for (what, file) in notes {
                    match shot(folder, file, what.to_owned(), most_bytes.saturating_sub(bytes)) {
                        Ok((shot, size)) => {
                            bytes += size;
                            shots.push(shot);
                        }
                        Err(why) => left_out.push(format!("{file} of {}: {why}", one.name)),
                    }
                }
                if !shots.is_empty() {
                    let credit = report.scenes.iter().find(|of| of.name == scene).map_or("", |of| &of.credit);
                    all.push(Comparison { scene: format!("Bit volume: {scene}"), credit: credit.into(), shots });
                }
            }
        }
        let Record::Paper(report) = &one.record else { continue };
        for scene in &report.scenes {
            if !scene.publish {
                if !scene.pictures.is_empty() {
                    left_out.push(format!("pictures of {}: they may not be published", scene.name));
                }
                continue;
            }
            let mut shots = Vec::new();
            for name in &scene.pictures {
                match shot(folder, name, label(name, &scene.name), most_bytes.saturating_sub(bytes)) {
                    Ok((shot, _)) if all.iter().any(|known| known.shots.contains(&shot)) => {}
                    Ok((shot, size)) => {
                        bytes += size;
                        shots.push(shot);
                    }
                    Err(why) => left_out.push(format!("{name} of {}: {why}", one.name)),
                }
            }
            if !shots.is_empty() {
                let scene_name = format!("{}, {}", scene.name, scene.mesh.title());
                all.push(Comparison { scene: scene_name, credit: scene.credit.clone(), shots });
            }
        }
    }
    (all, left_out)
}

/// What pictures show and their files, by the scene that is named before the colon.
fn by_scene(notes: &[PictureNote]) -> Vec<(&str, Vec<(&str, &str)>)> {
    let mut scenes: Vec<(&str, Vec<(&str, &str)>)> = Vec::new();
    for note in notes {
        let (scene, what) = note.what.split_once(": ").unwrap_or(("", &note.what));
        match scenes.iter_mut().find(|(name, _)| *name == scene) {
            Some((_, notes)) => notes.push((what, &note.file)),
            None => scenes.push((scene, vec![(what, &note.file)])),
        }
    }
    scenes
}

/// Reads a picture of at most `room` bytes.
fn shot(folder: &Path, name: &str, label: String, room: u64) -> Result<(Shot, u64), String> {
    // A record names files beside it, and nothing else.
    if name.is_empty() || name.contains(['/', '\\', ':']) || name.starts_with('.') {
        return Err("is no name of a file beside the record".into());
    }
    let path = folder.join(name);
    if !path.exists() {
        return Err("its file is not beside the record".into());
    }
    let size = std::fs::metadata(&path).map_err(|e| e.to_string())?.len();
    if size > room {
        return Err(format!("has {:.1} MB, more than is left for pictures; see --picture-mb", size as f64 / 1e6));
    }
    let file = std::fs::read(&path).map_err(|e| e.to_string())?;
    let Some([width, height]) = png_size(&file) else { return Err("is no PNG file".into()) };
    let uri = format!("data:image/png;base64,{}", base64::engine::general_purpose::STANDARD.encode(&file));
    Ok((Shot { label, uri, width, height }, size))
}

fn png_size(file: &[u8]) -> Option<[u32; 2]> {
    let header = file.strip_prefix(PNG)?;
    let number = |at: usize| Some(u32::from_be_bytes(header.get(at..at + 4)?.try_into().ok()?));
    let is_header = header.get(4..8)? == b"IHDR";
    Some([number(8)?, number(12)?]).filter(|size| is_header && size.iter().all(|n| (1..=16384).contains(n)))
}

/// What a picture of a method of voxelization shows, by the name that its record gives it: `voxels-steep-fixed-axis.png`.
fn method_label(name: &str) -> String {
    let stem = name.trim_end_matches(".png");
    // The longest name: that of one method can be the end of another's.
    let known = METHODS.iter().filter(|method| stem.ends_with(*method)).max_by_key(|method| method.len());
    known.map_or(stem, |method| method).replace('-', " ")
}

/// Names of the methods of voxelization.
const METHODS: [&str; 10] = [
    "fixed-axis",
    "dominant-axis",
    "expanded",
    "expanded-clipped",
    "expanded-tested",
    "multisampled-4",
    "multisampled-8",
    "hardware",
    "hardware-tested",
    "compute",
];

/// What a picture shows, by the name that its record gives it: `sibenik-12-cubical.png`, `sibenik-triangles.png`.
fn label(name: &str, scene: &str) -> String {
    let stem = name.trim_end_matches(".png");
    let rest = stem.strip_prefix(&slug(scene)).map_or(stem, |rest| rest.trim_start_matches('-'));
    match rest.split_once('-') {
        Some((levels, kind)) if levels.parse::<u32>().is_ok() => {
            let kind = match kind {
                "cubical" => "cubes",
                "contours" => "contours",
                other => other,
            };
            format!("{kind}, {levels} levels")
        }
        _ => rest.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_are_named_by_what_they_show() {
        assert_eq!(label("sibenik-12-cubical.png", "SIBENIK"), "cubes, 12 levels");
        assert_eq!(label("sibenik-d-9-contours.png", "SIBENIK-D"), "contours, 9 levels");
        assert_eq!(label("sibenik-triangles.png", "SIBENIK"), "triangles");
        assert_eq!(label("other.png", "SIBENIK"), "other");
    }

    #[test]
    fn pictures_of_methods_are_named_by_them() {
        assert_eq!(method_label("voxels-sibenik-expanded-tested.png"), "expanded tested");
        assert_eq!(method_label("pixels-multisampled-4.png"), "multisampled 4");
        assert_eq!(method_label("pixels-unheard-of.png"), "pixels unheard of");
    }

    #[test]
    fn pictures_of_bit_volumes_go_by_their_scene() {
        let note = |what: &str| PictureNote { what: what.into(), file: format!("{}.png", what.len()) };
        let notes = ["A: one", "B: in steps: two", "A: three", "four"].map(note);
        let expected = [
            ("A", vec![("one", "6.png"), ("three", "8.png")]),
            ("B", vec![("in steps: two", "16.png")]),
            ("", vec![("four", "4.png")]),
        ];
        assert_eq!(by_scene(&notes), expected);
    }

    #[test]
    fn only_png_files_are_taken() {
        let mut file = PNG.to_vec();
        file.extend(13u32.to_be_bytes());
        file.extend(b"IHDR");
        file.extend([0, 0, 4, 0, 0, 0, 3, 0]);
        assert_eq!(png_size(&file), Some([1024, 768]));
        file[18] = 0;
        assert_eq!(png_size(&file), None);
        assert_eq!(png_size(b"<svg/>"), None);
        assert_eq!(png_size(PNG), None);
    }
}
