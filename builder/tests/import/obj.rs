//! OBJ, and the errors common to all kinds of files.

use crate::support::{Files, png};

const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

#[test]
fn files_that_are_no_mesh_are_named_for_what_they_are() {
    let files = Files::new();
    assert_eq!(files.refuse("a.obj", ""), "a.obj: is empty");
    assert_eq!(
        files.refuse("a.3ds", "solid"),
        "a.3ds: unknown kind of mesh; the extension must be .obj, .gltf, .glb, .ply, .stl or .vox"
    );
    let image = png(1, 1, &[[0; 4]]);
    assert_eq!(files.refuse("b.obj", &image), "b.obj: is a PNG image, not an OBJ text file as its extension says");
    assert_eq!(files.refuse("b.glb", &image), "b.glb: is a PNG image, not a binary glTF file as its extension says");
    assert_eq!(files.refuse("c.glb", TRIANGLE), "c.glb: is a text file, not a binary glTF file as its extension says");
    assert_eq!(files.refuse("c.ply", TRIANGLE), "c.ply: is a text file, not a PLY file as its extension says");
    assert_eq!(files.refuse("d.obj", "{}"), "d.obj: is JSON text, not an OBJ text file as its extension says");
    assert_eq!(files.refuse("d.obj", [1, 0, 2]), "d.obj: is a binary file, not an OBJ text file as its extension says");
    assert_eq!(
        files.refuse("e.obj", b"\x1f\x8b\x08.."),
        "e.obj: is a compressed archive, not an OBJ text file as its extension says"
    );
    std::fs::create_dir(files.path("f.obj")).unwrap();
    let not_a_file = "is not a regular file; give the path of a .obj, .gltf, .glb, .ply, .stl or .vox file";
    assert_eq!(files.error("f.obj"), format!("f.obj: {not_a_file}"));
    std::fs::create_dir(files.path("directory")).unwrap();
    assert_eq!(files.error("directory"), format!("directory: {not_a_file}"));
    assert!(files.error("none.obj").starts_with("none.obj: cannot be read: "));
}

#[test]
fn text_may_be_utf_16_or_carry_a_mark() {
    let text = format!("{TRIANGLE}# \u{e4}\u{1f300}\n");
    let words: Vec<u16> = "\u{feff}".encode_utf16().chain(text.encode_utf16()).collect();
    let files = Files::new();
    for bytes in [
        words.iter().flat_map(|w| w.to_le_bytes()).collect::<Vec<u8>>(),
        words.iter().flat_map(|w| w.to_be_bytes()).collect(),
        format!("\u{feff}{text}").into_bytes(),
    ] {
        assert_eq!(files.accept("a.obj", bytes).triangle_count(), 1);
    }
    // An odd byte at the end is no character.
    assert_eq!(files.refuse("a.obj", b"\xff\xfev"), "a.obj: the mesh has no triangles");
}

#[test]
fn a_plain_triangle() {
    let mesh = Files::new().accept("a.OBJ", TRIANGLE);
    assert_eq!(mesh.positions, [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    assert_eq!(mesh.triangles, [[0, 1, 2]]);
    assert_eq!((mesh.normals.len(), mesh.uvs.len(), mesh.colors.len()), (0, 0, 0));
    assert_eq!((mesh.materials.len(), mesh.warnings.len()), (1, 0));
    assert_eq!(mesh.bounds(), Some(([0.0, 0.0, 0.0], [1.0, 1.0, 0.0])));
}

#[test]
fn positions_keep_double_precision() {
    let mesh = Files::new().accept("a.obj", "v 1000000.0000001 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\n");
    assert_eq!(mesh.positions[0][0], 1000000.0000001);
}

#[test]
fn lines_may_continue_and_comments_may_follow() {
    let text = "# caf\u{e9}\nv 0 0 \\\n 0 # first\nv 1 0 0\r\nv 1 1 0\nv 0 1 0\nf 1 2 \\\n3 4 # a quad\n";
    assert_eq!(Files::new().accept("a.obj", text).triangles, [[0, 1, 2], [0, 2, 3]]);
}

#[test]
fn faces_with_and_without_attributes_do_not_mix_up() {
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt 0.25 0.25\nvt 1 0\nvt 0 1\nvn 0 0 2\n\
                f 1 2 4\nf 1/1/1 2/2/1 3/3/1\nf 2//1 3//1 4//1\nf 1/1 3/2 4/3\n";
    let mesh = Files::new().accept("a.obj", text);
    assert_eq!(mesh.triangle_count(), 4);
    let corner = |t: usize, k: usize| mesh.triangles[t][k] as usize;
    assert_eq!(mesh.positions[corner(1, 0)], [0.0, 0.0, 0.0]);
    // v points down here, up in the file.
    assert_eq!((mesh.uvs[corner(1, 0)], mesh.uvs[corner(1, 2)]), ([0.25, 0.75], [0.0, 0.0]));
    assert_eq!(mesh.uvs[corner(3, 2)], [0.0, 0.0]);
    assert_eq!(mesh.normals[corner(1, 0)], [0.0, 0.0, 1.0]);
    assert_eq!(mesh.normals[corner(2, 2)], [0.0, 0.0, 1.0]);
    // Computed where the file has no normal.
    assert_eq!(mesh.normals[corner(0, 0)], [0.0, -1.0, 0.0]);
    assert_eq!(mesh.normals[corner(3, 1)], [1.0, 0.0, 0.0]);
}

#[test]
fn vertex_colours_are_display_values() {
    let mesh = Files::new().accept("a.obj", "v 0 0 0 1 0.5 0\nv 1 0 0 1 1 1\nv 0 1 0 0 0 0\nf 1 2 3\n");
    assert_eq!(mesh.colors[1], [1.0; 3]);
    assert!((mesh.colors[0][1] - 0.214_041_14).abs() < 1e-6);
    let mixed = Files::new().accept("a.obj", "v 0 0 0 1 0.5 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    assert_eq!(mixed.colors[1..], [[1.0; 3]; 2], "a vertex without colour is white");
    assert!((mixed.colors[0][1] - 0.214_041_14).abs() < 1e-6 && mixed.warnings.is_empty());
    // Without a material, the vertices have all the colour.
    assert_eq!(mixed.materials[0].base_color, [1.0; 4]);
    // With alpha; with a weight; in steps of 255; one that cannot be read.
    let text = "v 0 0 0 255 0 0 9\nv 2 0 0 2\nv 0 1 0 0 x 0\nv 0 0 1 7 7\nf 1 2 3\nf 1 2 4\n";
    let mesh = Files::new().accept("a.obj", text);
    assert_eq!(mesh.colors, [[1.0, 0.0, 0.0], [1.0; 3], [1.0; 3], [1.0; 3]]);
    assert_eq!(mesh.positions[1], [1.0, 0.0, 0.0]);
    assert_eq!(
        mesh.warnings,
        [
            "vertex colours reach 255: they are taken as 0 to 255, not 0 to 1",
            "line 3: 1 vertex colour that cannot be read or is not finite; white is used instead",
            "line 4: 1 vertex with two numbers after its position; these numbers are neither a weight nor a colour and are \
             ignored",
        ]
    );
}

#[test]
fn geometry_errors_name_the_line() {
    let files = Files::new();
    let refuse = |text: &str| files.refuse("a.obj", text);
    assert_eq!(
        refuse("v 0 0 0\n# no faces\nv 1 0 0\n"),
        "a.obj: the mesh has no triangles: it has 2 vertices and no faces; a point cloud has no surface; make a mesh from it \
         first, e.g. in MeshLab or CloudCompare"
    );
    assert_eq!(
        refuse("v 0 0 0\nv 1 0 0\nl 1 2\np 1\n"),
        "a.obj: the mesh has no triangles: line 3 and later: 2 points and lines; only polygons are read"
    );
    assert_eq!(refuse("some words\n"), "a.obj: the mesh has no triangles");
    assert_eq!(
        refuse("v 0 0 0\n\nv 0 NaN 0\nv 1 0 0\nf 1 2 3\n"),
        "a.obj: line 3: vertex 2 is not finite; repair or remove it"
    );
    assert_eq!(
        refuse("v 0 0 0\nv 0 1e999 0\nv 1 0 0\nf 1 2 3\n"),
        "a.obj: line 2: vertex 2 is not finite; repair or remove it"
    );
    assert_eq!(refuse("# x\nv 0 0\n"), "a.obj: line 2: position parse error");
    assert_eq!(refuse("v 0 0 zero\n"), "a.obj: line 1: position parse error");
    let face = |face: &str| refuse(&format!("v 0 0 0\nv 1 0 0\nv 0 1 0\nf {face}\n"));
    assert_eq!(face("1 2 4"), "a.obj: line 4: a face refers to vertex 4, but there are only 3");
    assert_eq!(face("1 2 0"), "a.obj: line 4: a face refers to vertex 0, but there are only 3 so far");
    assert_eq!(face("1 2 -4"), "a.obj: line 4: a face refers to vertex -4, but there are only 3 so far");
    assert_eq!(
        face("1 2 9223372036854775807"),
        "a.obj: line 4: a face refers to vertex 9223372036854775807, but there are only 3"
    );
    assert_eq!(
        face("1 2 -9223372036854775808"),
        "a.obj: line 4: a face refers to vertex -9223372036854775808, but there are only 3 so far"
    );
    assert_eq!(face("1 2 99999999999999999999"), "a.obj: line 4: cannot read the face corner '99999999999999999999'");
    assert_eq!(face("a b c"), "a.obj: line 4: cannot read the face corner 'a'");
    assert_eq!(face("1/1/1/1 2 3"), "a.obj: line 4: cannot read the face corner '1/1/1/1'");
}

#[test]
fn bad_attributes_are_dropped_with_their_place() {
    let files = Files::new();
    let warnings = |text: &str| {
        let mesh = files.accept("a.obj", format!("v 0 0 0\nv 1 0 0\nv 0 1 0\n{text}"));
        assert!(mesh.triangle_count() > 0);
        mesh.warnings
    };
    assert_eq!(
        warnings("f 1/1 2/1 3/1\nf 1/1 2/2 3/x\n"),
        [
            "line 4: texture coordinate 1 of 0 and later: 6 indices of texture coordinates that do not exist; these faces have \
          no texture coordinates"
        ]
    );
    assert_eq!(
        warnings("f 1//5 2//5 3//5\n"),
        [
            "line 4: normal 5 of 0 and later: 3 indices of normals that do not exist; normals of the faces are used instead"
        ]
    );
    assert_eq!(
        warnings("vt 0 0\nvn 0 0 1\nf 1/1 2/1 3/1\nf 1 2/1 3\nf 1 2//1 3\n"),
        [
            "line 7: 1 face with texture coordinates at some corners only; they are left out",
            "line 8: 1 face with normals at some corners only; they are left out",
        ]
    );
    for word in ["x", "nan", "-1.#IND", "-nan(ind)", "1.#QNAN", "inf"] {
        assert_eq!(
            warnings(&format!("vt {word} 0\nvn 0 {word} 0\nf 1/1/1 2/1/1 3/1/1\n")),
            [
                "line 4: 1 texture coordinate that cannot be read or is not finite; faces that use them have no texture \
                 coordinates",
                "line 5: 1 normal that cannot be read or is not finite; normals of the faces are used instead",
            ]
        );
    }
    // Numbers that `tobj` cannot read.
    let mesh = files.accept("a.obj", "v .0 0. 0D0\nv +1 0 0\nv 0 1.D0 0\nvt .5D0\nvn 0 0 1D0\nf 1/1/1 2/1/1 3/1/1\n");
    assert_eq!(mesh.positions, [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    assert_eq!((mesh.uvs[0], mesh.normals[0], mesh.warnings.len()), ([0.5, 1.0], [0.0, 0.0, 1.0], 0));
}

#[test]
fn free_form_surfaces_are_named() {
    let files = Files::new();
    let surface = "v 0 0 0\nv 1 0 0\nv 0 1 0\ncstype bezier\nsurf 0 1 0 1 1 2 3\nend\n";
    assert_eq!(
        files.refuse("a.obj", surface),
        "a.obj: line 5: 'surf': 1 free-form curve or surface and no polygons; convert them to polygons"
    );
    let mesh = files.accept("a.obj", format!("{surface}f 1 2 3\n"));
    assert_eq!(mesh.warnings, ["line 5: 'surf': 1 free-form curve or surface; only polygons are read"]);
}

#[test]
fn points_and_lines_are_skipped_with_a_warning() {
    let mesh = Files::new().accept("a.obj", format!("{TRIANGLE}l 1 2\np 1\nf 1 2\n"));
    assert_eq!(mesh.triangle_count(), 1);
    assert_eq!(mesh.warnings, ["line 5 and later: 3 points and lines; only polygons are read"]);
}

#[test]
fn missing_materials_leave_a_plain_colour_and_a_warning() {
    let files = Files::new();
    files.write("b.mtl", "newmtl red\nKd 1 0 0\nmap_Kd none.png\nnewmtl half\nKd 0.5 0.5 0.5\nd 0.25\n");
    let text = "mtllib none.mtl\nmtllib b.mtl\nvt 0 0\nv 0 0 0\nv 1 0 0\nv 0 1 0\n\
                usemtl red\nf 1/1 2/1 3/1\nusemtl blue\nf 1/1 2/1 3/1\nusemtl half\nf 1/1 2/1 3/1\n";
    let mesh = files.accept("a.obj", text);
    let colors: Vec<_> = mesh
        .triangle_materials
        .iter()
        .map(|&m| (&*mesh.materials[m as usize].name, mesh.materials[m as usize].base_color))
        .collect();
    assert_eq!(colors[0], ("red", [1.0, 0.0, 0.0, 1.0]));
    assert_eq!(colors[1], ("default", [0.8, 0.8, 0.8, 1.0]));
    // Kd is sRGB-encoded: 0.5 decodes to 0.214.
    assert_eq!(colors[2], ("half", [0.214_041_14, 0.214_041_14, 0.214_041_14, 0.25]));
    assert_eq!(
        mesh.warnings,
        [
            "the material library none.mtl is missing",
            "material red: the texture none.png is missing; using a plain colour",
            "no material library defines blue; using a plain colour",
        ]
    );
}

const TEXTURED: &str = "mtllib my lib.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\n\
                        usemtl a\nf 1/1 2/1 3/1\nusemtl b\nf 1/1 2/1 3/1\nf 1 2 3\n";

#[test]
fn textures_are_read_once_and_shared() {
    let files = Files::new();
    std::fs::create_dir(files.path("maps")).unwrap();
    files.write("maps/red.png", png(2, 1, &[[255, 0, 0, 255]; 2]));
    files.write("my lib.mtl", "newmtl a\nmap_Kd maps/red.png\nnewmtl b\nKd 0 0 0\nmap_Kd -s 1 1 1 maps\\red.png\n");
    let mesh = files.accept("a.obj", TEXTURED);
    let [a, b, plain] = &mesh.materials[..] else { panic!("{:?}", mesh.materials) };
    let (a, b) = (a.texture.as_ref().unwrap(), b.texture.as_ref().unwrap());
    assert!(std::sync::Arc::ptr_eq(a, b));
    assert_eq!(a.sample([0.5, 0.5], 1.0), [1.0, 0.0, 0.0, 1.0]);
    assert_eq!(mesh.materials[1].base_color, [1.0; 4]);
    assert!(plain.texture.is_none());
    assert_eq!(
        mesh.warnings,
        [
            "material b: Kd is black; taking the colour from the texture alone",
            "some faces of material b have no texture coordinates; they get its plain colour",
        ]
    );
}

#[test]
fn textures_that_cannot_be_decoded_are_treated_as_missing() {
    let files = Files::new();
    files.write(
        "my lib.mtl",
        "newmtl a\nKd 1 0 0\nmap_Kd bad.png\nmap_d bad.png\nbump bad.png\nnorm bad.png\nnewmtl b\n",
    );
    files.write("bad.png", "this is no image");
    files.write("a.obj", TEXTURED);
    let reason = "cannot be decoded: it is none of PNG, JPEG, WebP, TGA, BMP and DDS; convert it to PNG, JPEG or WebP";
    let mesh = files.mesh("a.obj");
    assert_eq!(mesh.materials[0].base_color, [1.0, 0.0, 0.0, 1.0]);
    assert!(mesh.materials[0].texture.is_none() && mesh.materials[0].height_map.is_none());
    assert_eq!(
        mesh.warnings,
        [
            format!("material a: the texture bad.png {reason}; using a plain colour"),
            format!("material a: the height map bad.png {reason}; it is left out"),
            format!("material a: the normal map bad.png {reason}; it is left out"),
        ]
    );
    let first = || files.mesh("a.obj").warnings[0].clone();
    files.write("bad.png", "");
    assert_eq!(first(), "material a: the texture bad.png cannot be decoded: it is empty; using a plain colour");
    let good = png(8, 8, &[[1, 2, 3, 4]; 64]);
    files.write("bad.png", &good[..good.len() / 2]);
    assert!(first().starts_with("material a: the texture bad.png cannot be decoded: "), "{}", first());
    // A header that declares more texels than allowed.
    let mut huge = good;
    huge[16..24].copy_from_slice(&[0, 1, 0, 0, 0, 1, 0, 0]);
    files.write("bad.png", huge);
    assert!(first().starts_with("material a: the texture bad.png cannot be decoded: "), "{}", first());
}

#[test]
fn opacity_maps_become_alpha() {
    let files = Files::new();
    files.write("color.png", png(2, 1, &[[255, 255, 255, 255]; 2]));
    files.write("mask.png", png(2, 1, &[[0, 0, 0, 255], [255, 255, 255, 255]]));
    files.write("my lib.mtl", "newmtl a\nmap_Kd color.png\nmap_d mask.png\nnewmtl b\nmap_Kd color.png\n");
    let mesh = files.accept("a.obj", TEXTURED);
    let [masked, opaque, ..] = &mesh.materials[..] else { panic!("{:?}", mesh.materials) };
    assert_eq!((masked.alpha_cutoff, opaque.alpha_cutoff), (Some(0.5), None));
    let alpha = |u: f32| masked.texture.as_ref().unwrap().sample([u, 0.5], 1.0)[3];
    assert_eq!((alpha(0.25), alpha(0.75)), (0.0, 1.0));
}

#[test]
fn masks_are_compared_by_their_files() {
    let files = Files::new();
    std::fs::create_dir(files.path("tex")).unwrap();
    // White with a red channel that is no mask: its alpha cuts the hole. And a mask whose name differs after the "#" only.
    let leaf = png(2, 1, &[[255, 255, 255, 0], [0, 255, 255, 255]]);
    files.write("tex/leaf.png", &leaf).write("Leaf #1.png", png(2, 1, &[[255; 4]; 2]));
    files.write("Leaf #2.png", png(2, 1, &[[0, 0, 0, 255], [255, 255, 255, 255]]));
    for (color, mask, expected) in [
        ("Leaf #1.png", "Leaf #2.png", [0.0, 1.0]),
        ("tex/leaf.png", "tex/leaf.png", [0.0, 1.0]),
        ("tex/leaf.png", "tex\\leaf.png", [0.0, 1.0]),
        ("tex/leaf.png", "tex/./leaf.png", [0.0, 1.0]),
        ("tex/leaf.png", "tex/../tex/Leaf.PNG", [0.0, 1.0]),
        ("tex/leaf.png", "-imfchan m tex/leaf.png", [0.0, 1.0]),
        // Another channel of the same file.
        ("tex/leaf.png", "-imfchan r tex/leaf.png", [1.0, 0.0]),
    ] {
        files.write("my lib.mtl", format!("newmtl a\nmap_Kd {color}\nmap_d {mask}\nnewmtl b\n"));
        let mesh = files.accept("a.obj", TEXTURED);
        assert_eq!(mesh.warnings, [""; 0], "{mask}");
        let alpha = [0.25, 0.75].map(|u| mesh.materials[0].texture.as_ref().unwrap().sample([u, 0.5], 1.0)[3]);
        assert_eq!(alpha, expected, "{color} {mask}");
    }
    // Missing: named once if it is one file.
    for (mask, count) in [("none.png", 1), ("no.png", 2)] {
        files.write("my lib.mtl", format!("newmtl a\nmap_Kd none.png\nmap_d {mask}\nnewmtl b\n"));
        assert_eq!(files.accept("a.obj", TEXTURED).warnings.len(), count, "{mask}");
    }
}

#[test]
fn maps_of_detail_are_read() {
    let files = Files::new();
    files.write("height.png", png(2, 1, &[[0, 0, 0, 255], [255, 255, 255, 255]]));
    // Normals that lean to the right, and straight up.
    files.write("normal.png", png(2, 1, &[[204, 128, 230, 255], [128, 128, 255, 255]]));
    files.write(
        "my lib.mtl",
        "newmtl a\nmap_bump -bm 0.25 height.png\nnorm normal.png\nnewmtl b\nbump -bm 2 normal.png\ndisp none.png\n",
    );
    let mesh = files.accept("a.obj", TEXTURED);
    let [a, b, plain] = &mesh.materials[..] else { panic!("{:?}", mesh.materials) };
    let height = a.height_map.as_ref().unwrap();
    assert_eq!((height.sample([0.25, 0.5], 1.0), height.sample([0.75, 0.5], 1.0)), (0.0, 0.25));
    let normal = a.normal_map.as_ref().unwrap();
    let [x, y, z] = normal.sample([0.25, 0.5], 1.0);
    assert!((x - 0.6).abs() < 1e-6 && (y - 0.004).abs() < 1e-3 && (z - 0.8).abs() < 5e-3, "{x} {y} {z}");
    assert!(b.normal_map.is_none() && b.height_map.is_none(), "disp comes before bump, and is missing");
    assert!(plain.normal_map.is_none() && plain.height_map.is_none(), "faces without texture coordinates");
    assert_eq!(mesh.warnings, ["material b: the height map none.png is missing; it is left out"]);

    files.write("my lib.mtl", "newmtl a\nnewmtl b\nbump -bm 2 normal.png\n");
    let mesh = files.mesh("a.obj");
    let b = &mesh.materials[1];
    assert!(b.height_map.is_none());
    assert!((b.normal_map.as_ref().unwrap().sample([0.25, 0.5], 1.0)[0] - 1.2).abs() < 1e-5);
    assert!(mesh.warnings[0].ends_with("normal.png holds normals, not heights; it is used as normal map"));
}

#[test]
fn a_missing_height_map_on_its_own_is_an_error() {
    let files = Files::new();
    let load = || esvo_builder::import::load_height_map(&files.path("h.png"));
    assert!(load().unwrap_err().to_string().contains("h.png: cannot be read: "));
    files.write("h.png", png(1, 1, &[[255, 255, 255, 255]]));
    assert_eq!(load().unwrap().sample([0.0, 0.0], 1.0), 1.0);
    files.write("h.png", "no image");
    assert!(
        load()
            .unwrap_err()
            .to_string()
            .contains("it is none of PNG, JPEG, WebP, TGA, BMP and DDS; convert it to PNG, JPEG or WebP")
    );
}
