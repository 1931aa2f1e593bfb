//! PLY in all three encodings.

use crate::support::{Files, png};

const HEADER: &str = "element vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
                      element face 1\nproperty list uchar int vertex_indices\nend_header\n";

fn ascii(body: &str) -> String {
    format!("ply\nformat ascii 1.0\n{HEADER}{body}")
}

fn binary(big_endian: bool) -> Vec<u8> {
    let order = if big_endian { "big" } else { "little" };
    let mut bytes = format!("ply\nformat binary_{order}_endian 1.0\n{HEADER}").into_bytes();
    let mut word = |w: u32| bytes.extend(if big_endian { w.to_be_bytes() } else { w.to_le_bytes() });
    for x in [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0] {
        word(x.to_bits());
    }
    bytes.push(4);
    for i in 0..4u32 {
        bytes.extend(if big_endian { i.to_be_bytes() } else { i.to_le_bytes() });
    }
    bytes
}

#[test]
fn all_encodings_give_the_same_mesh() {
    let files = Files::new();
    let text = ascii("0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n");
    for bytes in [text.into_bytes(), binary(false), binary(true)] {
        let mesh = files.accept("a.ply", bytes);
        assert_eq!(mesh.positions, [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]);
        assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
    }
}

#[test]
fn attributes_are_read() {
    let files = Files::new();
    files.write("t.png", png(1, 1, &[[0, 0, 255, 255]]));
    let text = "ply\nformat ascii 1.0\ncomment TextureFile t.png\nelement face 1\nproperty list uchar uint vertex_index\n\
                element vertex 3\nproperty double x\nproperty double y\nproperty double z\nproperty float nx\n\
                property float ny\nproperty float nz\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n\
                property float s\nproperty float t\nend_header\n\
                3 0 1 2\n0 0 0.1 0 0 3 255 128 0 0.25 0.25\n1 0 0 0 0 1 0 0 0 1 0\n0 1 0 0 0 1 0 0 0 0 1\n";
    let mesh = files.accept("a.ply", text);
    assert_eq!(mesh.positions[0], [0.0, 0.0, 0.1]);
    assert_eq!(mesh.normals[0], [0.0, 0.0, 1.0]);
    assert_eq!(mesh.uvs[0], [0.25, 0.75]);
    assert_eq!((mesh.colors[0][0], mesh.colors[0][2]), (1.0, 0.0));
    assert!((mesh.colors[0][1] - 0.215_860_5).abs() < 1e-6);
    assert!(mesh.materials[0].texture.is_some());
}

#[test]
fn triangle_strips_are_unrolled() {
    let text = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
                element tristrips 1\nproperty list int int vertex_indices\nend_header\n\
                0 0 0\n1 0 0\n0 1 0\n1 1 0\n8 0 1 2 3 -1 3 2 1\n";
    assert_eq!(Files::new().accept("a.ply", text).triangles, [[0, 1, 2], [2, 1, 3], [3, 2, 1]]);
}

#[test]
fn errors_say_what_and_where() {
    let files = Files::new();
    let refuse = |body: &str| files.refuse("a.ply", ascii(body));
    let vertices = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n";
    assert_eq!(refuse(&format!("{vertices}3 0 1 4\n")), "a.ply: face 0: it refers to vertex 4, but there are only 4");
    assert_eq!(refuse(&format!("{vertices}3 0 1 -1\n")), "a.ply: face 0: it refers to vertex -1, but there are only 4");
    assert_eq!(refuse(&format!("{vertices}2 0 1\n")), "a.ply: the mesh has no triangles");
    assert_eq!(
        refuse("0 0 0\n1 1e39 0\n1 1 0\n0 1 0\n3 0 1 2\n"),
        "a.ply: vertex 1 is not finite; repair or remove it"
    );
    assert_eq!(refuse("0 0 0\n"), "a.ply: line 10: the file ends within vertex 1, but the header declares 4");
    assert_eq!(
        refuse(&format!("{vertices}300000000 0 1 2\n")),
        "a.ply: line 14: the file ends within face 0, but the header declares 1"
    );
    assert_eq!(files.refuse("a.ply", "ply\n"), "a.ply: line 2: the file ends within its header");
    let whole = binary(true);
    assert_eq!(
        files.refuse("a.ply", &whole[..whole.len() - 3]),
        "a.ply: the file ends within face 0, but the header declares 1"
    );
    let header = |elements: &str| format!("ply\nformat binary_little_endian 1.0\n{elements}end_header\n");
    assert_eq!(
        files.refuse("a.ply", header("element vertex 1\nproperty float x\n") + "...."),
        "a.ply: is a PLY point cloud (its header declares no element 'face'); a point cloud has no surface; make a mesh from it \
         first, e.g. in MeshLab or CloudCompare"
    );
    assert_eq!(
        files.refuse("a.ply", header("element nothing 18446744073709551615\n")),
        "a.ply: the header declares 18446744073709551615 elements 'nothing', more than 84 bytes can hold"
    );
    assert_eq!(
        files.refuse("a.ply", header("element vertex 4000000000\nproperty float x\n")),
        "a.ply: the header declares 4000000000 elements 'vertex', more than 90 bytes can hold"
    );
    assert_eq!(
        files.refuse("a.ply", header("element face 0\nproperty list uchar int vertex_indices\n")),
        "a.ply: the header declares no element 'vertex'"
    );
    assert_eq!(
        files.refuse(
            "a.ply",
            header("element vertex 1\nproperty uchar x\nelement face 1\nproperty list uchar int vertex_indices\n")
                + "A\0"
        ),
        "a.ply: the vertices have no property 'y'"
    );
}

#[test]
fn statements_of_the_header_that_are_none_are_named() {
    let error = Files::new().refuse("a.ply", "ply\nformat ascii 1.0\nMade by hand\nend_header\n");
    assert_eq!(error, "a.ply: line 3: cannot read 'Made by hand' in the header");
}

#[test]
fn lines_with_too_many_values_are_read_as_far_as_declared() {
    let mesh = Files::new().accept("a.ply", ascii("0 0 0 9\n1 0 0 9\n1 1 0\n0 1 0\n4 0 1 2 3\n"));
    assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
    assert_eq!(
        mesh.warnings,
        ["line 10 and later: 2 lines with more values than the header declares; the rest of each is ignored"]
    );
}

#[test]
fn concave_faces_keep_their_shape() {
    let mesh = Files::new().accept("a.ply", ascii("0 0 0\n1 1 0\n0 3 0\n3 1 0\n4 0 1 2 3\n"));
    assert!(mesh.triangles.len() == 2 && mesh.triangles.iter().all(|t| t.contains(&1) && t.contains(&3)));
}
