//! Damaged files: no command writes an octree or a picture of one, and each error names the rule.

mod common;

use common::Folder;

/// The files: their names and one of their bytes that is in a block and changes nothing that a pointer leads to.
fn files(folder: &Folder) -> [&'static str; 4] {
    folder.ok(&["build", "box.obj", "-o", "plain.esvo", "--levels", "5", "--plain-attributes"]);
    folder.ok(&["ambient", "box.esvo", "-o", "ao.esvo", "--rays", "4"]);
    folder.ok(&["convert", "box.esvo", "-o", "packed.esvo", "--compress"]);
    ["box.esvo", "plain.esvo", "ao.esvo", "packed.esvo"]
}

#[test]
fn damaged_octrees_are_refused_everywhere() {
    let folder = Folder::with_octree();
    for name in files(&folder) {
        let whole = std::fs::read(folder.path(name)).unwrap();
        for place in [whole.len() - 8192 + 24, whole.len() / 2, whole.len() - 1] {
            let mut bytes = whole.clone();
            bytes[place] ^= 0x10;
            folder.put("bad.esvo", &bytes);
            // The padding after a compressed block belongs to no block.
            let rule = if name == "packed.esvo" && place != 8192 && whole[place] == 0 { "D009" } else { "B006" };
            for command in [
                &["convert", "bad.esvo", "-o", "out.esvo"][..],
                &["convert", "bad.esvo", "-o", "out.esvo", "--compress"],
                &["convert", "bad.esvo", "-o", "out.oct"],
                &["ambient", "bad.esvo", "-o", "out.esvo", "--rays", "4"],
                &["render", "bad.esvo", "-o", "out.png", "--size", "32x24"],
                &["info", "bad.esvo"],
                &["info", "bad.esvo", "--verify"],
                &["diff", "bad.esvo", "box.esvo"],
                &["diff", "box.esvo", "bad.esvo"],
                &["dump", "bad.esvo"],
                &["dump", "bad.esvo", "--verify", "--block", "0"],
            ] {
                folder.fails(command, 1, &format!("rule {rule}"));
                folder.fails(command, 1, "get the file again, or list all damage: esvo validate bad.esvo");
            }
            assert_eq!(folder.run(&["validate", "bad.esvo"]).status.code(), Some(1));
        }
    }
}

#[test]
fn checksums_can_be_left_out_for_reading() {
    let folder = Folder::with_octree();
    let mut bytes = std::fs::read(folder.path("box.esvo")).unwrap();
    // The padding after the last part of the last block.
    *bytes.last_mut().unwrap() ^= 1;
    folder.put("bad.esvo", &bytes);
    folder.ok(&["render", "box.esvo", "-o", "right.png", "--size", "32x24"]);
    folder.ok(&["render", "bad.esvo", "-o", "out.png", "--size", "32x24", "--no-verify"]);
    let picture = |name: &str| std::fs::read(folder.path(name)).unwrap();
    assert!(picture("right.png") == picture("out.png"));
    folder.ok(&["info", "bad.esvo", "--no-verify"]);
    folder.fails(&["info", "bad.esvo", "--no-verify", "--verify"], 2, "--verify");
    folder.fails(&["convert", "bad.esvo", "-o", "x.esvo"], 1, "block 0 is damaged: its checksum differs");
}

#[test]
fn a_dump_shows_what_can_be_read_of_a_damaged_file() {
    let folder = Folder::new();
    // Enough voxels for several blocks.
    folder.put("box.obj", common::BOX);
    folder.ok(&["build", "box.obj", "-o", "box.esvo", "--levels", "9"]);
    let tables: serde_json::Value = serde_json::from_str(&folder.ok(&["dump", "box.esvo", "--json"])).unwrap();
    let blocks = tables["blocks"].as_array().unwrap();
    assert!(blocks.len() > 2, "{} blocks", blocks.len());
    let last = blocks.len() - 1;
    let mut bytes = std::fs::read(folder.path("box.esvo")).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    folder.put("bad.esvo", &bytes);
    let damaged = format!("block {last} is damaged");
    for arguments in [&["dump", "bad.esvo"][..], &["dump", "bad.esvo", "--block", &last.to_string()]] {
        folder.fails(arguments, 1, &damaged);
        assert!(folder.run(arguments).stdout.len() > 1000, "{arguments:?} shows nothing");
    }
    // Other blocks are shown without a word about it, unless everything is to be verified.
    folder.ok(&["dump", "bad.esvo", "--block", "0"]);
    folder.ok(&["dump", "bad.esvo", "--path", "/"]);
    folder.fails(&["dump", "bad.esvo", "--path", "/", "--verify"], 1, &damaged);
}
