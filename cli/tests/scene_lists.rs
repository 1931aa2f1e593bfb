//! Scene lists, and octrees joined into one file.

mod common;

use common::Folder;

/// The box twice, and a hundred times smaller.
const LIST: &str = "\
version = 1

[[place]]
file = \"box.esvo\"

[[place]]
file = \"./box.esvo\"
translation = [0, 2, 0]
rotation = { axis = [0, 1, 0], degrees = 40 }
scale = [1, 0.5, -1]

[[place]]
file = \"other/ball.esvo\"
object = 1
matrix = [[0.5, 0, 0, -1], [0, 0.5, 0, 1], [0, 0, 0.5, 0], [0, 0, 0, 1]]
";

/// The folder with the box, a second octree and the list.
fn folder() -> Folder {
    let folder = Folder::with_octree();
    std::fs::create_dir(folder.path("other")).unwrap();
    folder.put("ball.obj", "v 0 0 0\nv 3 0 0\nv 0 3 0\nv 0 0 3\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n");
    folder.ok(&["build", "ball.obj", "-o", "other/ball.esvo", "--levels", "5"]);
    folder.put("list.toml", LIST);
    folder
}

#[test]
fn a_list_is_drawn_in_every_mode_and_lights_reach_it() {
    let folder = folder();
    let draw = |name: &str, more: &[&str]| {
        let mut arguments = vec!["render", "list.toml", "-o", name, "--size", "64x48"];
        arguments.extend(more);
        let text = folder.ok(&arguments);
        assert!(text.contains("% of the pixels hit") && !text.contains(" 0.0 %"), "{text}");
        std::fs::read(folder.path(name)).unwrap()
    };
    let shaded = draw("shaded.png", &[]);
    let lit = draw("lit.png", &["--light", "sun:0.3,2,0.1"]);
    let bright = draw("bright.png", &["--light", "sun:0.3,2,0.1", "--no-shadows"]);
    assert!(shaded != lit && lit != bright);
    for mode in ["iterations", "normals", "depth", "levels", "voxel-size", "ambient"] {
        draw("mode.png", &["--view-mode", mode]);
    }
    assert_eq!(draw("beam.png", &["--beam"]), shaded);
    assert_eq!(draw("reference.png", &["--backend", "reference"]), shaded);
    assert_eq!(draw("unverified.png", &["--no-verify"]), shaded);
    assert_ne!(draw("near.png", &["--camera=1,3,6,0,-0.2,-1"]), shaded);
}

#[test]
fn a_list_of_one_octree_where_it_is_shows_the_octree() {
    let folder = folder();
    folder.put("one.toml", "version = 1\n[[place]]\nfile = \"box.esvo\"\n");
    let draw = |file: &str, name: &str| {
        folder.ok(&["render", file, "-o", name, "--size", "64x48"]);
        std::fs::read(folder.path(name)).unwrap()
    };
    assert_eq!(draw("one.toml", "list.png"), draw("box.esvo", "octree.png"));
    // Moved, with the camera: the same picture.
    folder.put("moved.toml", "version = 1\n[[place]]\nfile = \"box.esvo\"\ntranslation = [8, 4, -16]\n");
    let at = |file: &str, camera: &str| {
        folder.ok(&["render", file, "-o", "camera.png", "--size", "64x48", camera]);
        std::fs::read(folder.path("camera.png")).unwrap()
    };
    assert_eq!(at("moved.toml", "--camera=8.75,6,-10,0,-0.3,-1"), at("box.esvo", "--camera=0.75,2,6,0,-0.3,-1"));
}

#[test]
fn errors_name_the_place() {
    let folder = folder();
    let place = |what: &str| format!("version = 1\n[[place]]\nfile = \"box.esvo\"\n\n[[place]]\n{what}\n");
    for (text, says) in [
        (String::new(), "missing field `version`"),
        ("version = 1\n".into(), "bad.toml: it places nothing"),
        ("version = 1\n[[place]\n".into(), "bad.toml"),
        (place("file = \"absent.esvo\""), "bad.toml: place 2 (line 5): absent.esvo"),
        (place("file = \"box.obj\""), "place 2 (line 5): box.obj: is a mesh, not an octree"),
        (place("file = \"box.esvo\"\nobject = 2"), "place 2 (line 5): `object` is 2; box.esvo has 1"),
        (place("file = \"box.esvo\"\nscale = 0"), "place 2 (line 5): `scale` is"),
        (
            place("file = \"box.esvo\"\nmatrix = [[1, 0, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]"),
            "place 2 (line 5): the determinant of `matrix` is 0",
        ),
        (place("file = \"box.esvo\"\ncolour = 1"), "unknown field `colour`"),
    ] {
        folder.put("bad.toml", &text);
        folder.fails(&["render", "bad.toml", "-o", "picture.png"], 1, says);
    }
    folder.fails(&["render", "absent.toml", "-o", "picture.png"], 1, "cannot read the scene list absent.toml");
}

#[test]
fn joined_octrees_are_valid_and_look_the_same() {
    let folder = folder();
    let text = folder.ok(&["join", "box.esvo", "other/ball.esvo", "-o", "both.esvo"]);
    assert!(text.starts_with("both.esvo: ") && text.contains(", 2 objects\n"), "{text}");
    folder.ok(&["validate", "both.esvo"]);
    folder.put("both.toml", "version = 1\n[[place]]\nfile = \"box.esvo\"\n[[place]]\nfile = \"other/ball.esvo\"\n");
    let draw = |file: &str, name: &str| {
        folder.ok(&["render", file, "-o", name, "--size", "64x48"]);
        std::fs::read(folder.path(name)).unwrap()
    };
    assert_eq!(draw("both.toml", "list.png"), draw("both.esvo", "joined.png"));
    // What a list places in a file: the same picture, from each engine, and from a list that places the file.
    let text = folder.ok(&["join", "list.toml", "-o", "scene.esvo", "--hash", "--parts"]);
    assert!(text.contains(", 2 objects, 3 instances\n"), "{text}");
    folder.ok(&["validate", "scene.esvo"]);
    folder.put("scene.toml", "version = 1\n[[place]]\nfile = \"scene.esvo\"\n");
    let picture = draw("list.toml", "list.png");
    assert_eq!(draw("scene.esvo", "scene.png"), picture);
    assert_eq!(draw("scene.toml", "scene.png"), picture);
    assert_ne!(draw("both.esvo", "scene.png"), picture, "the objects without the instances");
    for engine in ["reference", "wgpu", "ash"] {
        let on = |file: &str| {
            let drawn = folder.run(&["render", file, "-o", "engine.png", "--size", "64x48", "--backend", engine]);
            drawn.status.success().then(|| std::fs::read(folder.path("engine.png")).unwrap())
        };
        assert_eq!(on("scene.esvo"), on("list.toml"), "{engine}");
    }
    // A list that says no more than the octree gives no instances.
    let text = folder.ok(&["join", "both.toml", "-o", "plain.esvo"]);
    assert!(text.ends_with(", 2 objects\n"), "{text}");
    folder.fails(&["join", "list.toml", "-o", "box.esvo"], 1, "is the input");
    // An object of a joined file, placed; and compressed.
    folder.put("second.toml", "version = 1\n[[place]]\nfile = \"small.esvo\"\nobject = 2\n");
    folder.ok(&["join", "box.esvo", "other/ball.esvo", "-o", "small.esvo", "--compress"]);
    assert_eq!(draw("second.toml", "second.png"), draw("other/ball.esvo", "ball.png"));

    folder.fails(&["join", "box.esvo", "-o", "one.esvo"], 1, "one octree is nothing to join");
    folder.fails(&["join", "box.esvo", "box.obj", "-o", "new.esvo"], 1, "box.obj: is a mesh");
    folder.fails(&["join", "box.esvo", "both.esvo", "-o", "both.esvo"], 1, "is the input");
    folder.fails(&["join", "box.esvo", "both.esvo", "-o", "new.png"], 1, "ends in .esvo");
    let mut damaged = std::fs::read(folder.path("box.esvo")).unwrap();
    let last = damaged.len() - 1;
    damaged[last] ^= 1;
    folder.put("damaged.esvo", &damaged);
    folder.fails(&["join", "box.esvo", "damaged.esvo", "-o", "new.esvo"], 1, "damaged.esvo: ");
}
