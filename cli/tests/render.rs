//! Comparisons, films and skies of `esvo render`.

mod common;

use common::Folder;
use esvo_core::Picture;
use esvo_core::picture::read_picture;

fn picture(folder: &Folder, name: &str) -> Picture {
    read_picture(&folder.path(name)).unwrap()
}

const RENDER: [&str; 6] = ["render", "box.esvo", "-o", "p.png", "--size", "40x30"];

fn with<'a>(more: &[&'a str]) -> Vec<&'a str> {
    RENDER.iter().chain(more).copied().collect()
}

/// A part of a picture that is `width` wide.
fn part(picture: &Picture, left: u32, width: u32) -> Vec<[u8; 3]> {
    (0..picture.height).flat_map(|y| (left..left + width).map(move |x| picture.pixel(x, y))).collect()
}

#[test]
fn both_sides_of_a_comparison_are_what_they_are_alone() {
    let folder = Folder::with_octree();
    let near = "--camera=2.5,1.1,2,-1,-0.2,-1";
    for (a, b, alone, equal) in [
        ("filter", "no-filter", [&[][..], &["--filter", "off"]], false),
        ("shaded", "normals", [&[], &["--view-mode", "normals"]], false),
        (
            "contours+depth",
            "no-contours+iterations",
            [&["--view-mode", "depth"], &["--view-mode", "iterations", "--no-contours"]],
            false,
        ),
        ("cpu", "reference+own-filter", [&[], &["--backend", "reference", "--filter", "own"]], false),
        ("cpu", "reference", [&[], &[]], true),
        ("beam", "no-beam", [&["--beam"], &[]], true),
    ] {
        let said = folder.ok(&with(&[near, "--compare", &format!("{a},{b}")]));
        let whole = picture(&folder, "p.png");
        assert_eq!((whole.width, whole.height), (3 * 40 + 2 * 8 + 4 + 12, 30));
        for (side, options) in alone.iter().enumerate() {
            folder.ok(&with(&[&[near], *options].concat()));
            let one = picture(&folder, "p.png");
            assert_eq!(part(&whole, side as u32 * 48, 40), part(&one, 0, 40), "{a}, {b}: {options:?}");
        }
        assert!(said.contains(&format!("p.png: 40x30, {a}, {b} and their difference\n")), "{said}");
        let says_equal = said.contains("FLIP 0.00000") && said.contains("; 0 of 1200 pixels differ, by 0 of 255");
        assert_eq!(says_equal, equal, "{said}");
        let is_black = part(&whole, 96, 40).iter().all(|rgb| *rgb == [0; 3]);
        assert_eq!(is_black, equal, "{a}, {b}");
        // Cubes reach farther than contours.
        assert_eq!(said.contains("; 0 show another voxel"), !a.contains("contours"), "{said}");
    }
}

#[test]
fn a_turn_is_one_picture_for_each_frame() {
    let folder = Folder::with_octree();
    let said = folder.ok(&with(&["--turn", "--frames", "4", "--times"]));
    assert!(said.starts_with("p-001.png to p-004.png: 4 frames of 40x30, "), "{said}");
    assert!(said.contains("ms, mean of all frames\n"), "{said}");
    assert_eq!(folder.files(), ["box.esvo", "box.obj", "p-001.png", "p-002.png", "p-003.png", "p-004.png"]);
    let frames = [1, 2, 3, 4].map(|number| picture(&folder, &format!("p-00{number}.png")));
    assert!((1..4).all(|i| frames[i] != frames[0]), "the camera moves");

    // A camera of one's own, around the axis through the middle of the box: its floor is from -1 to 3.
    folder.ok(&with(&["--turn", "--frames", "4", "--camera=1,0.5,6,0,0,-1"]));
    let quarter = picture(&folder, "p-002.png");
    folder.ok(&with(&["--camera=6,0.5,1,-1,0,0"]));
    let off = quarter.rgb8.iter().zip(&picture(&folder, "p.png").rgb8).filter(|(a, b)| a.abs_diff(**b) > 12).count();
    assert!(off < 40 * 30 * 3 / 50, "{off}: the box's bounds are a few voxels off its middle");
}

#[test]
fn a_path_goes_from_camera_to_camera() {
    let folder = Folder::with_octree();
    folder.put("walk.txt", "# past the box\n0: 1,0.5,6,0,0,-1\n\n1: 3,0.5,6,-0.3,0,-1\n4: 6,0.5,1,-1,0,0,50\n");
    let said = folder.ok(&with(&["--path", "walk.txt", "--frames", "5", "--compare", "cpu,reference+no-filter"]));
    assert!(said.contains("p-001.png to p-005.png: 5 frames of 40x30, cpu, reference+no-filter and"), "{said}");
    assert!(said.contains(" of 6000 pixels differ"), "{said}");
    for (frame, camera) in [(1, "1,0.5,6,0,0,-1"), (2, "3,0.5,6,-0.3,0,-1"), (5, "6,0.5,1,-1,0,0,50")] {
        let camera = format!("--camera={camera}");
        folder.ok(&with(&[&camera]));
        let (whole, alone) = (picture(&folder, &format!("p-00{frame}.png")), picture(&folder, "p.png"));
        assert_eq!(part(&whole, 0, 40), part(&alone, 0, 40), "{frame}");
    }
    // A field of view is for cameras that have none.
    folder.ok(&with(&["--path", "walk.txt", "--frames", "5", "--fov", "30"]));
    for (frame, camera) in [(1, "1,0.5,6,0,0,-1,30"), (5, "6,0.5,1,-1,0,0,50")] {
        folder.ok(&with(&[&format!("--camera={camera}")]));
        assert_eq!(picture(&folder, &format!("p-00{frame}.png")), picture(&folder, "p.png"), "{frame}");
    }
    folder.fails(&with(&["--path", "walk.txt", "--fov", "200"]), 1, "--fov 200: the field of view");
}

#[test]
fn bad_films_and_comparisons_are_one_line() {
    let folder = Folder::with_octree();
    folder.put("walk.txt", "0,0,9,0,0,-1\n0,0,9,0,0\n");
    folder.fails(&with(&["--path", "walk.txt"]), 1, "walk.txt: line 2: expected six numbers");
    folder.put("walk.txt", "0,0,9,0,0,-1\n");
    folder.fails(&with(&["--path", "walk.txt"]), 1, "walk.txt: has one camera for a path");
    folder.put("walk.txt", "0,0,9,0,0,-1\n0,9,9,0,1,0\n");
    folder.fails(&with(&["--path", "walk.txt", "--frames", "9"]), 1, "walk.txt: frame 9: --up 0,1,0: is parallel");
    folder.put("walk.txt", "0,0,9,0,0,-1\n0,0,1e200,0,0,-1\n");
    folder.fails(&with(&["--path", "walk.txt", "--frames", "2"]), 1, "walk.txt: frame 2: the eye is too far away");
    folder.put("walk.txt", [0xff, 0xfe, 0]);
    folder.fails(&with(&["--path", "walk.txt"]), 1, "walk.txt: is not a text file");
    folder.put("walk.txt", vec![b'\n'; (1 << 20) + 1]);
    folder.fails(&with(&["--path", "walk.txt"]), 1, "walk.txt: is larger than 1 MiB");
    folder.fails(&with(&["--path", "absent.txt"]), 1, "absent.txt: ");
    folder.fails(&with(&["--path", "."]), 1, "");
    folder.fails(&with(&["--path", "walk.txt", "--turn"]), 2, "cannot be used with");
    folder.fails(&with(&["--path", "walk.txt", "--scene", "sibenik"]), 2, "cannot be used with");
    folder.fails(&with(&["--frames", "5"]), 2, "<--path <FILE>|--turn>");
    folder.fails(&with(&["--turn", "--frames", "0"]), 2, "1..=99999");
    std::fs::create_dir(folder.path("p-007.png")).unwrap();
    folder.fails(&with(&["--turn", "--frames", "9"]), 1, "p-007.png: is a folder");
    folder.fails(&with(&["--compare", "filter"]), 2, "expected two sides with a comma between them");
    folder.fails(&with(&["--compare", "filter,sharp"]), 2, "there is no `sharp`; the names are shaded, iterations,");
    folder.fails(&with(&["--compare", "depth,depth+filter"]), 1, "--compare depth+filter: only shaded pictures");
    folder.fails(&with(&["--compare", "depth,normals", "--light", "sky"]), 1, "only shaded pictures are lit");
    folder.fails(&with(&["--sky", "blue"]), 2, "expected screen, dome or a colour");
    folder.fails(&with(&["--sky", "dome", "--view-mode", "depth"]), 1, "--sky: only shaded pictures have a sky");
}

#[test]
fn skies_are_behind_the_objects() {
    let folder = Folder::with_octree();
    folder.ok(&RENDER);
    let before = picture(&folder, "p.png");
    folder.ok(&with(&["--sky", "screen"]));
    assert_eq!(picture(&folder, "p.png"), before);
    folder.ok(&with(&["--sky", "#102030"]));
    let plain = picture(&folder, "p.png");
    let mut sky = 0;
    for (now, before) in plain.rgb8.chunks(3).zip(before.rgb8.chunks(3)) {
        assert!(now == before || now == [0x10, 0x20, 0x30]);
        sky += usize::from(now == [0x10, 0x20, 0x30]);
    }
    assert!((100..1100).contains(&sky), "{sky} of 1200 pixels");
    folder.ok(&with(&["--sky", "dome", "--camera=1,0.5,6,0,0,-1"]));
    let dome = picture(&folder, "p.png");
    folder.ok(&with(&["--camera=1,0.5,6,0,0,-1"]));
    assert_ne!(dome, picture(&folder, "p.png"));
}

#[test]
fn light_of_the_sky_needs_ambient_occlusion() {
    let folder = Folder::with_octree();
    let render = |name: &str, more: &[&str]| {
        let out = folder.run(&[&["render", name, "-o", "p.png", "--size", "40x30"][..], more].concat());
        assert!(out.status.success());
        (picture(&folder, "p.png"), String::from_utf8(out.stderr).unwrap())
    };
    folder.ok(&["ambient", "box.esvo", "-o", "open.esvo", "--rays", "16", "--radius", "0.3"]);
    let what = "box.esvo: has no ambient occlusion, so all of it is shown as open; compute it: esvo ambient box.esvo";
    let (flat, warned) = render("box.esvo", &["--light", "sky"]);
    assert!(warned.starts_with("warning: ") && warned.contains(what) && warned.lines().count() == 1, "{warned}");
    let (occluded, quiet) = render("open.esvo", &["--light", "sky"]);
    assert!(quiet.is_empty(), "{quiet}");
    let darker = flat.rgb8.iter().zip(&occluded.rgb8).filter(|(a, b)| a > b).count();
    assert!(darker > 300 && flat.rgb8.iter().zip(&occluded.rgb8).all(|(a, b)| a >= b), "{darker}");
    assert!(render("box.esvo", &["--view-mode", "ambient"]).1.contains(what));
}

#[test]
fn the_engines_agree_on_every_map_of_several_objects() {
    let folder = Folder::new();
    let two = esvo_core::testing::sample::two_objects_apart(1.2).unwrap();
    let open = |slot: u32, child: u8| (slot * 40 + u32::from(child) * 30) as u8;
    two.with_ambient_occlusion(open).unwrap().write(&folder.path("two.esvo")).unwrap();
    // As in the tests of the casters: without a device this is skipped, unless a device is required.
    let gpu = std::env::var_os("ESVO_REQUIRE_GPU").is_some();
    let engines: &[&str] = if gpu { &["reference", "wgpu", "ash"] } else { &["reference"] };
    let draw = |mode: &str, compare: &str| {
        let options = ["--size", "80x60", "--view-mode", mode, "--compare", compare];
        let said = folder.ok(&[&["render", "two.esvo", "-o", "p.png"][..], &options].concat());
        (said, picture(&folder, "p.png"))
    };
    for mode in ["shaded", "iterations", "normals", "depth", "levels", "voxel-size", "ambient"] {
        for engine in engines {
            let (said, whole) = draw(mode, &format!("cpu,{engine}"));
            assert!(
                said.contains("; 0 of 4800 pixels differ, by 0 of 255 at most; 0 show another voxel"),
                "{mode}: {said}"
            );
            let colors: std::collections::HashSet<_> = part(&whole, 0, 80).into_iter().collect();
            assert!(colors.len() > 2, "{mode} shows nothing");
        }
    }
    assert!(
        !draw("normals", "normals,depth").0.contains("; 0 of 4800 pixels differ"),
        "the comparison sees differences"
    );
}
