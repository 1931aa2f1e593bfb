//! STL: both encodings, several solids, and errors.

use std::time::{Duration, Instant};

use crate::support::Files;

const TETRAHEDRON: [[[f32; 3]; 3]; 4] = [
    [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]],
    [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
    [[0.0, -0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]],
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
];

fn binary(comment: &[u8], triangles: &[[[f32; 3]; 3]]) -> Vec<u8> {
    let mut bytes = comment.to_vec();
    bytes.resize(80, b' ');
    bytes.extend((triangles.len() as u32).to_le_bytes());
    for triangle in triangles {
        bytes.extend([0; 12]);
        bytes.extend(triangle.as_flattened().iter().flat_map(|x| x.to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}

fn text(triangles: &[[[f32; 3]; 3]]) -> String {
    let facet = |t: &[[f32; 3]; 3]| {
        let corners: String = t.iter().map(|[x, y, z]| format!("  vertex {x} {y} {z}\n")).collect();
        format!("facet normal 0 0 nan\n outer loop\n{corners} endloop\nendfacet\n")
    };
    format!("solid a thing\n{}endsolid a thing\n", triangles.iter().map(facet).collect::<String>())
}

#[test]
fn both_encodings_give_the_same_closed_mesh() {
    let files = Files::new();
    let a = files.accept("a.stl", binary(b"solid by a careless program", &TETRAHEDRON));
    let b = files.accept("b.STL", text(&TETRAHEDRON));
    assert_eq!((a.positions.len(), a.triangle_count()), (4, 4), "corners at one place are one vertex");
    assert_eq!((&a.positions, &a.triangles), (&b.positions, &b.triangles));
    assert!(a.warnings.is_empty() && b.warnings.is_empty());
    assert!(a.normals.is_empty());
}

#[test]
fn all_solids_are_read_in_full_precision() {
    let one = "SOLID\nFACET NORMAL 0 0 1\nOUTER LOOP\nVERTEX 0.1 0 0\nVERTEX 1 0 0\nVERTEX 0 1e0 0\nENDLOOP\nENDFACET\nENDSOLID\n";
    let empty = "solid none\nendsolid none\n\n";
    let mesh = Files::new().accept("a.stl", format!("{one}{empty}{}", text(&TETRAHEDRON[..1])));
    assert_eq!(mesh.triangle_count(), 2);
    assert_eq!(mesh.positions[0][0], 0.1);
}

#[test]
fn what_follows_a_binary_mesh_is_ignored_aloud() {
    let mut bytes = binary(&[0], &TETRAHEDRON);
    bytes.extend([7; 60]);
    let mesh = Files::new().accept("a.stl", bytes);
    assert_eq!(mesh.warnings, ["60 bytes after the 4 triangles that the header declares are not read"]);
}

#[test]
fn errors_say_what_and_where() {
    let refuse = |bytes: &[u8]| Files::new().refuse("a.stl", bytes);
    let mut cut = binary(b"x", &TETRAHEDRON);
    cut.truncate(200);
    assert_eq!(refuse(&cut), "a.stl: the header declares 4 triangles, but the file ends after 2");
    assert_eq!(refuse(&cut[..50]), "a.stl: neither begins with 'solid' nor has the 84 bytes of a binary header");
    let mut huge = binary(b"x", &[]);
    huge[80..84].fill(255);
    assert_eq!(refuse(&huge), "a.stl: the header declares 4294967295 triangles, but the file ends after 0");
    assert_eq!(refuse(&binary(b"x", &[])), "a.stl: the mesh has no triangles");
    let mut bad = TETRAHEDRON;
    bad[2][1][0] = f32::NAN;
    assert_eq!(refuse(&binary(b"x", &bad)), "a.stl: corner 1 of triangle 2 is not finite; repair or remove it");
    assert_eq!(
        refuse(text(&bad).as_bytes()),
        "a.stl: line 19: the vertex is not finite; repair or remove it",
        "{}",
        text(&bad)
    );
    let start = "solid\nfacet normal 0 0 1\nouter loop\n";
    let after = |rest: &str| refuse(format!("{start}{rest}").as_bytes());
    assert_eq!(after("vertex 1 2\n"), "a.stl: line 4: cannot read 'vertex 1 2' as a vertex");
    assert_eq!(after("vertex 1 2 3\nendfacet\n"), "a.stl: line 2: the facet has 1 corners; it must have 3");
    assert_eq!(after("facet\n"), "a.stl: line 4: a facet begins inside that of line 2");
    assert_eq!(after("vertex 1 2 3\n"), "a.stl: the file ends inside the facet of line 2");
    assert_eq!(refuse(b"solid\nvertex 1 2 3\n"), "a.stl: line 2: a vertex outside of a facet");
    assert_eq!(refuse(b"solid\nendfacet\n"), "a.stl: line 2: a facet ends that has not begun");
    assert_eq!(refuse(b"\x89PNG...."), "a.stl: is a PNG image, not an STL file as its extension says");
}

#[test]
fn text_in_one_line_takes_time_in_proportion_to_its_length() {
    // Many solids of one facet each, in one line of about 3 MB.
    let solids = 30_000;
    let solid = text(&TETRAHEDRON[3..]).replace('\n', " ");
    let start = Instant::now();
    let mesh = Files::new().accept("a.stl", solid.repeat(solids));
    assert_eq!((mesh.triangle_count(), mesh.positions.len(), mesh.warnings.len()), (solids, 3, 0));
    assert!(start.elapsed() < Duration::from_secs(5), "{:?}", start.elapsed());
}
