//! The table of the pictures that were made, and writing it.

use std::path::{Path, PathBuf};

use crate::BenchError;
use crate::output::write_text;
use crate::picture_bench::pictures::{PicturePair, RAYS};
use crate::system::machine::Machine;
use crate::text::{Document, TextTable};

/// Writes `pictures.md`, the table of the pictures, to the folder that they are in, and returns its path.
///
/// # Errors
/// The system's.
pub fn write_picture_table(pairs: &[PicturePair], machine: &Machine, folder: &Path) -> Result<PathBuf, BenchError> {
    let path = folder.join("pictures.md");
    write_text(&path, &to_markdown(pairs, machine))?;
    Ok(path)
}

/// The table of the pictures, as Markdown.
pub fn to_markdown(pairs: &[PicturePair], machine: &Machine) -> String {
    let head = ["picture", "scene", "viewpoint", "levels", "million voxels", "triangles", "FLIP"];
    let mut table = TextTable::new("Pictures", 3, &head);
    table.notes = vec![
        format!(
            "On the left the octree, on the right the triangles: the same view in the same light, {} rays a pixel.",
            RAYS * RAYS
        ),
        "Built with the scene's settings and `--texture-test averages`. Triangles are counted after displacement in displaced \
         scenes (-D). FLIP: visible difference of the halves, mean over the picture, 0 to 1."
            .into(),
    ];
    let mut credits: Vec<[&str; 3]> = Vec::new();
    for pair in pairs {
        let credit = [&*pair.scene, &*pair.credit, &*pair.identity];
        if !credits.contains(&credit) {
            credits.push(credit);
        }
        table.rows.push(vec![
            format!("`{}`", pair.picture.name),
            pair.scene.clone(),
            pair.view.clone(),
            pair.levels.to_string(),
            format!("{:.1}", pair.voxels as f64 / 1e6),
            pair.triangles.to_string(),
            format!("{:.3}", pair.flip),
        ]);
    }
    let header = vec![format!("commit {}, {}, {} build", machine.commit, machine.rustc, machine.profile)];
    let title = format!("esvo bench pictures, {}", machine.date);
    Document { title, header, tables: vec![table], left_out: Vec::new(), credits }.to_markdown()
}

#[cfg(test)]
mod tests {
    use esvo_core::Picture;

    use super::*;
    use crate::output::NamedPicture;

    #[test]
    fn the_table_has_a_row_for_every_picture_and_a_credit_for_every_mesh() {
        let pair = |view: &str| PicturePair {
            scene: "A-D".into(),
            view: view.into(),
            levels: 10,
            voxels: 7_340_000,
            triangles: 12,
            flip: 0.0625,
            credit: "Somebody".into(),
            identity: "verified".into(),
            picture: NamedPicture {
                name: format!("a-{view}.png"),
                picture: Picture { width: 0, height: 0, rgb8: Vec::new() },
            },
        };
        let text = to_markdown(&[pair("front"), pair("back")], &Machine::detect());
        assert!(text.contains("| `a-back.png` | A-D | back | 10 | 7.3 | 12 | 0.062 |"), "{text}");
        assert_eq!(text.matches("Somebody (verified)").count(), 1, "{text}");
    }
}
