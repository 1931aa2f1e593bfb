//! Properties of the generators: counts, extents, determinism, finite values, closed surfaces.

use std::collections::HashMap;

use esvo_builder::mesh::Mesh;
use esvo_scenes::generate::{GENERATORS, Generator, cube, generator, single_triangle, slivers, sphere};
use esvo_scenes::procedural;
use sha2::{Digest, Sha256};

/// First eight bytes of the SHA-256 over positions and indices.
fn fingerprint(mesh: &Mesh) -> u64 {
    let mut hash = Sha256::new();
    for x in mesh.positions.iter().flatten() {
        hash.update(x.to_bits().to_le_bytes());
    }
    for v in mesh.triangles.iter().flatten() {
        hash.update(v.to_le_bytes());
    }
    let digest = hash.finalize();
    digest[..8].iter().fold(0, |value, &b| value << 8 | u64::from(b))
}

fn check(g: &Generator, mesh: &Mesh) {
    let name = g.name;
    assert_eq!(mesh.triangles.len(), g.triangles, "{name}");
    assert_eq!(mesh.triangle_materials.len(), g.triangles, "{name}");
    assert_eq!(mesh.normals.len(), mesh.positions.len(), "{name}");
    assert!(mesh.positions.iter().flatten().all(|x| x.is_finite()), "{name}");
    for n in &mesh.normals {
        let length = n.iter().map(|x| x * x).sum::<f32>().sqrt();
        assert!((length - 1.0).abs() < 1e-5, "{name}: a normal of length {length}");
    }
    assert!(mesh.triangles.iter().flatten().all(|&v| (v as usize) < mesh.positions.len()), "{name}");
    assert!(mesh.triangle_materials.iter().all(|&m| (m as usize) < mesh.materials.len()), "{name}");
    assert!(mesh.materials.iter().all(|m| m.base_color.iter().all(|c| (0.0..=1.0).contains(c))), "{name}");
}

fn bounds(mesh: &Mesh) -> ([f64; 3], [f64; 3]) {
    let mut low = [f64::INFINITY; 3];
    let mut high = [f64::NEG_INFINITY; 3];
    for p in &mesh.positions {
        for k in 0..3 {
            low[k] = low[k].min(p[k]);
            high[k] = high[k].max(p[k]);
        }
    }
    (low, high)
}

/// How often the geometric normal of a triangle agrees with its vertices' normals, over triangles that have an area.
fn facing(mesh: &Mesh) -> f64 {
    let (mut agree, mut all) = (0u64, 0u64);
    for t in &mesh.triangles {
        let [a, b, c] = t.map(|v| mesh.positions[v as usize]);
        let u: [f64; 3] = std::array::from_fn(|k| b[k] - a[k]);
        let v: [f64; 3] = std::array::from_fn(|k| c[k] - a[k]);
        let n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
        let mean: [f64; 3] =
            std::array::from_fn(|k| t.iter().map(|&v| f64::from(mesh.normals[v as usize][k])).sum::<f64>());
        let dot = (0..3).map(|k| n[k] * mean[k]).sum::<f64>();
        if n.iter().any(|x| x.abs() > 1e-12) {
            all += 1;
            agree += u64::from(dot > 0.0);
        }
    }
    agree as f64 / all as f64
}

/// Every edge belongs to exactly two triangles that run through it in opposite directions (vertices joined by position).
fn is_closed(mesh: &Mesh, triangles: std::ops::Range<usize>) -> bool {
    let mut ids: HashMap<[u64; 3], u32> = HashMap::new();
    let mut edges: HashMap<(u32, u32), u32> = HashMap::new();
    for t in &mesh.triangles[triangles] {
        let t = t.map(|v| {
            let key = mesh.positions[v as usize].map(|x| (x + 0.0).to_bits());
            let next = ids.len() as u32;
            *ids.entry(key).or_insert(next)
        });
        for k in 0..3 {
            *edges.entry((t[k], t[(k + 1) % 3])).or_default() += 1;
        }
    }
    edges.iter().all(|(&(a, b), &n)| a != b && n == 1 && edges.get(&(b, a)) == Some(&1))
}

/// If one of these changes, results with the old and the new mesh must not be compared: say so in the commit.
const FINGERPRINTS: &[(&str, u64)] = &[
    ("city", 0x7692_b731_04e1_a7f9),
    ("sibenik", 0x297e_d5c3_9d7a_8f26),
    ("hairball", 0x1128_d547_77ee_6693),
    ("fairy", 0x5294_e69a_3b78_d072),
    ("conference", 0x4d50_4909_e93c_a319),
    ("single-triangle", 0xf786_57cd_3b2f_46b2),
    ("cube", 0x7dbc_4b8f_25cd_5ec4),
    ("sphere", 0xe56d_72a9_cc7a_71c5),
    ("bumpy-sphere-on-plane", 0x22e5_7e02_3481_babf),
    ("slivers", 0x17ff_9b67_6e3b_cb5f),
];

#[test]
fn every_generator_makes_what_it_says() {
    let mut wrong = Vec::new();
    for g in GENERATORS {
        let mesh = (g.make)(g.seed);
        check(g, &mesh);
        let expected = FINGERPRINTS.iter().find(|(name, _)| *name == g.name).map(|f| f.1);
        let found = fingerprint(&mesh);
        if expected != Some(found) {
            wrong.push(format!("(\"{}\", 0x{found:016x}),", g.name));
        }
        let share = facing(&mesh);
        assert!(share > 0.97, "{}: only {share:.3} of the triangles face where their normals point", g.name);
    }
    assert!(wrong.is_empty(), "meshes have changed:\n{}", wrong.join("\n"));
}

#[test]
fn counts_hold_for_other_seeds_and_seeds_matter() {
    for name in ["sibenik", "conference", "fairy", "city"] {
        let g = generator(name).unwrap_or_else(|| panic!("no generator {name}"));
        let usual = fingerprint(&(g.make)(g.seed));
        for seed in [2, 77, u64::MAX] {
            let mesh = (g.make)(seed);
            assert_eq!(mesh.triangles.len(), g.triangles, "{name} with seed {seed}");
            assert_ne!(fingerprint(&mesh), usual, "{name} with seed {seed}");
        }
    }
}

#[test]
fn closed_meshes_are_closed() {
    assert!(is_closed(&cube(), 0..12));
    for n in 0..5 {
        let ball = sphere(n);
        assert_eq!(ball.triangles.len(), 20 << (2 * n));
        assert!(is_closed(&ball, 0..ball.triangles.len()), "{n} subdivisions");
    }
    // Negative controls: an open sphere, and a triangle.
    let ball = sphere(2);
    assert!(!is_closed(&ball, 1..ball.triangles.len()));
    assert!(!is_closed(&single_triangle(), 0..1));
    // Each strand of the hairball is a closed tube of 480 triangles.
    let hair = procedural("hairball").unwrap_or_default();
    for strand in [0, 17, 5999] {
        assert!(is_closed(&hair, strand * 480..(strand + 1) * 480), "strand {strand}");
    }
    let bumpy = procedural("bumpy_sphere_on_plane").unwrap_or_default();
    let n = bumpy.triangles.len();
    assert!(is_closed(&bumpy, n - 20480..n));
}

#[test]
fn extents_are_as_documented() {
    let within = |name: &str, low: [f64; 3], high: [f64; 3]| {
        let (l, h) = bounds(&procedural(name).unwrap_or_default());
        for k in 0..3 {
            assert!(l[k] >= low[k] && h[k] <= high[k], "{name}: {l:?} .. {h:?}");
            // The mesh fills at least three quarters of the stated extent.
            assert!(h[k] - l[k] > 0.75 * (high[k] - low[k]), "{name}: {l:?} .. {h:?}");
        }
    };
    within("city", [-352.1, -0.2, -352.1], [352.1, 120.0, 352.1]);
    within("sibenik", [-20.8, -0.5, -9.0], [20.8, 16.0, 9.0]);
    within("hairball", [-4.6141; 3], [4.6141; 3]);
    within("fairy", [-6.5, -0.5, -6.5], [6.5, 5.5, 6.5]);
    within("conference", [-0.1; 3], [11.1, 2.9, 7.1]);
    let farthest = procedural("hairball")
        .unwrap_or_default()
        .positions
        .iter()
        .map(|p| p.iter().map(|x| x * x).sum::<f64>().sqrt())
        .fold(0.0, f64::max);
    assert!(farthest <= 4.6141 && farthest > 4.6, "{farthest}");
}

#[test]
fn slivers_holds_what_it_promises() {
    let mesh = slivers();
    let area = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| mesh.positions[v as usize]);
        let u: [f64; 3] = std::array::from_fn(|k| b[k] - a[k]);
        let v: [f64; 3] = std::array::from_fn(|k| c[k] - a[k]);
        let n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
        n.iter().map(|x| x * x).sum::<f64>().sqrt() / 2.0
    };
    let degenerate = mesh.triangles.iter().filter(|t| area(t) < 1e-16).count();
    assert!((48..48 + 64).contains(&degenerate), "{degenerate}");
    let exact = mesh.triangles.iter().filter(|t| area(t) == 0.0).count();
    assert!(exact >= 32, "{exact}");
    let coplanar = mesh.triangles.iter().filter(|t| t.iter().all(|&v| mesh.positions[v as usize][2] == 0.5)).count();
    assert_eq!(coplanar, 32);
}

#[test]
fn names_are_found_without_regard_to_case() {
    assert!(procedural("Bumpy_Sphere_On_Plane").is_some());
    assert!(procedural("teapot").is_none());
}
