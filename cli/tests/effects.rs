//! `esvo render --effects`.

mod common;

use common::Folder;

const RENDER: [&str; 6] = ["render", "box.esvo", "-o", "p.png", "--size", "40x30"];

fn with<'a>(more: &[&'a str]) -> Vec<&'a str> {
    RENDER.iter().chain(more).copied().collect()
}

/// Coarse voxels and few rays.
const SMALL: [&str; 4] = ["--effect-voxel", "0.1", "--effect-rays", "2"];
const LAMP: [&str; 2] = ["--light", "point:1,3,1"];

#[test]
fn every_effect_changes_the_picture() {
    let folder = Folder::with_octree();
    let draw = |more: &[&str]| {
        let said = folder.ok(&with(more));
        (said, std::fs::read(folder.path("p.png")).unwrap())
    };
    let (said, plain) = draw(&LAMP);
    assert!(!said.contains("volume"), "{said}");
    let mut seen = vec![plain];
    for names in ["ao", "shadows", "reflections", "fog", "bounce", "ao,shadows,reflections,fog,bounce"] {
        let (said, picture) = draw(&[&["--effects", names], &SMALL[..], &LAMP].concat());
        assert!(said.contains("volume of ") && said.contains(" voxels of 0."), "{said}");
        assert!(!seen.contains(&picture), "{names} looks like another");
        assert_eq!(draw(&[&["--effects", names], &SMALL[..], &LAMP].concat()).1, picture, "{names}: twice the same");
        seen.push(picture);
    }
    // Soft shadows; the lamp at the camera and occlusion alone; an edge of voxels by itself.
    let soft = draw(&[&["--effects", "shadows", "--light-radius", "0.4"], &SMALL[..], &LAMP].concat()).1;
    assert!(!seen.contains(&soft));
    let occluded = draw(&[&["--effects", "ao"], &SMALL[..]].concat()).1;
    assert_ne!(occluded, draw(&[]).1);
    assert!(draw(&["--effects", "ao", "--effect-rays", "1"]).0.contains("volume of "));
    assert_eq!(folder.files(), ["box.esvo", "box.obj", "p.png"]);
}

#[test]
fn the_gpu_makes_the_same_effects() {
    // As in the tests of the casters: without a device this is skipped, unless a device is required.
    if !cfg!(feature = "wgpu") || std::env::var_os("ESVO_REQUIRE_GPU").is_none() {
        eprintln!("skipped: ESVO_REQUIRE_GPU is not set");
        return;
    }
    let folder = Folder::with_octree();
    let draw = |names: &str, backend: &str| {
        let options = ["--effects", names, "--light-radius", "0.2", "--backend", backend];
        let said = folder.ok(&with(&[&options, &SMALL[..], &LAMP].concat()));
        assert_eq!(said.contains("effects on "), backend == "wgpu", "{said}");
        esvo_core::picture::read_picture(&folder.path("p.png")).unwrap()
    };
    let differ = |a: &esvo_core::Picture, b: &esvo_core::Picture| {
        let pixels = a.rgb8.chunks_exact(3).zip(b.rgb8.chunks_exact(3));
        pixels.filter(|(a, b)| a.iter().zip(*b).any(|(a, b)| a.abs_diff(*b) > 4)).count()
    };
    let all = draw("ao,shadows,reflections,fog", "wgpu");
    let off = differ(&draw("ao,shadows,reflections,fog", "cpu"), &all);
    assert!(off < 12, "{off} of 1200 pixels differ");
    let without = differ(&draw("ao,shadows,fog", "wgpu"), &all);
    assert!(without > 100, "{without} pixels of a picture without reflections differ");
}

#[test]
fn frames_of_a_film_and_scene_lists_have_effects() {
    let folder = Folder::with_octree();
    folder.put(
        "list.toml",
        "version = 1\n[[place]]\nfile = \"box.esvo\"\n[[place]]\nfile = \"box.esvo\"\ntranslation = [0, 2, 0]\n\
         rotation = { axis = [1, 2, 0], degrees = 40 }\nscale = 0.5\n",
    );
    let list = ["render", "list.toml", "-o", "p.png", "--size", "40x30", "--light", "point:1,5,1"];
    folder.ok(&list);
    let plain = std::fs::read(folder.path("p.png")).unwrap();
    let said = folder.ok(&[&list[..], &["--effects", "ao,shadows"], &SMALL].concat());
    assert!(said.contains("volume of "), "{said}");
    assert_ne!(std::fs::read(folder.path("p.png")).unwrap(), plain);
    std::fs::remove_file(folder.path("p.png")).unwrap();
    folder.ok(&with(&[&["--turn", "--frames", "2", "--effects", "ao"], &SMALL[..]].concat()));
    let [first, second] = ["p-001.png", "p-002.png"].map(|name| std::fs::read(folder.path(name)).unwrap());
    assert_ne!(first, second);
}

#[test]
fn bad_effects_are_one_line_and_nothing_is_written() {
    let folder = Folder::with_octree();
    let effects = |names: &'static str, more: &[&'static str]| with(&[&["--effects", names], more].concat());
    for names in ["shadows", "fog", "bounce"] {
        folder.fails(&effects(names, &[]), 1, "--effects: shadows, fog and bounce need a light; give one");
        folder.fails(&effects(names, &["--light", "sky"]), 1, "--effects: shadows, fog and bounce need a light");
    }
    folder.fails(&effects("ao", &["--view-mode", "normals"]), 1, "--effects: only shaded pictures have effects");
    folder.fails(&effects("ao", &["--compare", "cpu,reference"]), 2, "cannot be used with");
    folder.fails(&effects("nothing", &[]), 2, "possible values: ao, shadows, reflections, fog, bounce");
    folder.fails(&effects("", &[]), 2, "possible values: ao, shadows");
    for edge in ["0", "-1", "nan", "inf", "wide"] {
        folder.fails(&with(&["--effects", "ao", &format!("--effect-voxel={edge}")]), 2, "expected a number above 0");
    }
    for edge in ["1e-9", "1e-300"] {
        folder.fails(&effects("ao", &["--effect-voxel", edge]), 1, "each axis has 1 to 8192. Choose larger voxels");
    }
    for rays in ["0", "5000", "-1", "many"] {
        folder.fails(&with(&["--effects", "ao", &format!("--effect-rays={rays}")]), 2, "--effect-rays");
    }
    for radius in ["-1", "nan", "inf"] {
        let radius = format!("--light-radius={radius}");
        folder.fails(
            &with(&["--effects", "shadows", "--light", "point:1,3,1", &radius]),
            2,
            "expected 0 or a number above",
        );
    }
    for alone in [["--effect-voxel", "0.1"], ["--effect-rays", "2"], ["--light-radius", "0.2"]] {
        folder.fails(&with(&alone), 2, "--effects");
    }
}

#[test]
fn transforms_that_a_volume_does_not_take_are_one_line() {
    let folder = Folder::with_octree();
    for scale in ["[1, 1, -1]", "[1, 0.5, 1]", "[1, 2, -1]"] {
        for before in ["", "[[place]]\nfile = \"box.esvo\"\ntranslation = [0, 4, 0]\n\n"] {
            folder
                .put("list.toml", format!("version = 1\n\n{before}[[place]]\nfile = \"box.esvo\"\nscale = {scale}\n"));
            let list = ["render", "list.toml", "-o", "p.png", "--size", "40x30"];
            folder.fails(
                &[&list[..], &["--effects", "ao"], &SMALL].concat(),
                1,
                "--effects: an octree is placed by a transform that mirrors it",
            );
            // Without effects, the list is drawn.
            folder.ok(&list);
            std::fs::remove_file(folder.path("p.png")).unwrap();
        }
    }
}
