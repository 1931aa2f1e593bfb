//! Damaged files: for any damage, the importer quickly returns a mesh or an error of one line.

use std::time::{Duration, Instant};

use esvo_builder::import::load_mesh;

use crate::support::{Files, data_uri, png};

/// Small pseudo-random numbers from a fixed seed (the generator SplitMix64).
struct Random(u64);

impl Random {
    fn below(&mut self, end: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) % end as u64) as usize
    }
}

/// Words that replace numbers and names in text files.
const NASTY: [&str; 16] = [
    "-1",
    "0",
    "4294967295",
    "18446744073709551615",
    "-9223372036854775808",
    "1e308",
    "-1e-308",
    "nan",
    "inf",
    "",
    "{}",
    "[]",
    "null",
    "/",
    "\\",
    "\u{e4}",
];

fn damage(bytes: &[u8], random: &mut Random) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    for _ in 0..1 + random.below(3) {
        if bytes.is_empty() {
            break;
        }
        let at = random.below(bytes.len());
        match random.below(5) {
            0 => bytes.truncate(at),
            1 => bytes[at] = random.below(256) as u8,
            2 => bytes[at] ^= 1 << random.below(8),
            3 => {
                // One number becomes another.
                let digit = |b: &u8| b.is_ascii_digit() || *b == b'-' || *b == b'.';
                let Some(start) = bytes[at..].iter().position(digit).map(|p| at + p) else { continue };
                let end = bytes[start..].iter().position(|b| !digit(b)).map_or(bytes.len(), |p| start + p);
                bytes.splice(start..end, NASTY[random.below(NASTY.len())].bytes());
            }
            _ => {
                let end = (at + random.below(40)).min(bytes.len());
                bytes.drain(at..end);
            }
        }
    }
    bytes
}

/// Loads `rounds` damaged copies of a valid file.
fn survive(name: &str, good: &[u8], rounds: usize) {
    let files = Files::new();
    files.write("t.png", png(2, 2, &[[9, 9, 9, 9]; 4]));
    files.write("m.mtl", "newmtl a\nKd 1 1 1\nmap_Kd t.png\nbump t.png\n");
    files.accept(name, good);
    let mut random = Random(1);
    let mut refused = 0;
    for round in 0..rounds {
        let bad = damage(good, &mut random);
        files.write(name, &bad);
        let start = Instant::now();
        match load_mesh(&files.path(name)) {
            Ok(mesh) => mesh.validate().unwrap(),
            Err(error) => {
                let message = error.to_string();
                assert!(!message.contains('\n') && message.len() < 1000, "round {round}: {message}");
                refused += 1;
            }
        }
        let took = start.elapsed();
        assert!(took < Duration::from_secs(5), "round {round} took {took:?}: {}", String::from_utf8_lossy(&bad));
    }
    assert!(refused > rounds / 10, "the damage must be felt: {refused} of {rounds}");
}

#[test]
fn damaged_obj_files() {
    let good = "mtllib m.mtl\nusemtl a\nv 0 0 0 1 1 1\nv 1 0 0 1 1 1\nv 0 1 0 1 1 1\nv 1 1 1 1 1 1\nvt 0 1\nvt 1 1\nvn 0 0 1\n\
                f 1 2 3\nf 1/1 2/2 -2/-1\nf 1//1 2//1 3//1 4//1\nf 1/1/1 \\\n2/2/1 3/1/-1\n";
    survive("a.obj", good.as_bytes(), 600);
}

#[test]
fn damaged_material_libraries() {
    let files = Files::new();
    files.write("t.png", png(2, 2, &[[9, 9, 9, 9]; 4]));
    files.write("a.obj", "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl a\nf 1/1 2/1 3/1\n");
    let good =
        b"newmtl a\nKd 0.5 0.5 0.5\nd 0.5\nTr 0.5\nmap_Kd -s 1 1 1 -o 0 0 t.png\nmap_d -clamp on t.png\nbump -bm 0.5 t.png\n\
          norm -bm 2 t.png\ndisp -mm 0 1 t.png\nillum 2\n";
    let mut random = Random(2);
    for _ in 0..300 {
        files.write("m.mtl", damage(good, &mut random));
        // A damaged library never costs the triangles.
        load_mesh(&files.path("a.obj")).unwrap();
    }
}

#[test]
fn damaged_ply_files() {
    let header = |format: &str| {
        format!(
            "ply\nformat {format} 1.0\ncomment TextureFile t.png\nelement vertex 3\nproperty float x\nproperty float y\n\
             property float z\nproperty uchar red\nproperty float s\nproperty float t\nelement face 1\n\
             property list uchar int vertex_indices\nend_header\n"
        )
    };
    let text = header("ascii") + "0 0 0 1 0 0\n1 0 0 2 0 1\n0 1 0 3 1 1\n3 0 1 2\n";
    survive("a.ply", text.as_bytes(), 600);
    let mut binary = header("binary_little_endian").into_bytes();
    for vertex in [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]] {
        binary.extend(vertex.iter().flat_map(|x| x.to_le_bytes()));
        binary.push(200);
        binary.extend([0; 8]);
    }
    binary.push(3);
    binary.extend([0, 1, 2].iter().flat_map(|x: &u32| x.to_le_bytes()));
    survive("a.ply", &binary, 600);
}

/// A document that uses most features: sparse and plain accessors, indices, nodes, a texture with a transform.
fn gltf(buffer: &str) -> String {
    let image = data_uri(&png(2, 2, &[[200, 100, 50, 128]; 4]));
    format!(
        r#"{{"asset":{{"version":"2.0"}},"buffers":[{{"byteLength":96{buffer}}}],
        "bufferViews":[{{"buffer":0,"byteLength":36,"byteStride":12}},{{"buffer":0,"byteOffset":36,"byteLength":24}},
            {{"buffer":0,"byteOffset":60,"byteLength":36}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","sparse":{{"count":1,
                "indices":{{"bufferView":2,"componentType":5121,"byteOffset":12}},"values":{{"bufferView":0,"byteOffset":12}}}}}},
            {{"bufferView":1,"componentType":5126,"count":3,"type":"VEC2"}},
            {{"bufferView":2,"componentType":5125,"count":3,"type":"SCALAR"}},
            {{"bufferView":2,"componentType":5121,"normalized":true,"count":9,"type":"VEC4"}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"TEXCOORD_0":1,"COLOR_0":3,"NORMAL":0,"TANGENT":3}},"indices":2,"material":0}},
            {{"attributes":{{"POSITION":0}},"mode":5}}]}}],
        "materials":[{{"normalTexture":{{"index":0,"scale":0.5,"extensions":{{"KHR_texture_transform":{{"scale":[2,2]}}}}}},
            "alphaMode":"BLEND","pbrMetallicRoughness":{{"baseColorFactor":[1,0.5,0.5,1],"baseColorTexture":
            {{"index":0,"extensions":{{"KHR_texture_transform":{{"offset":[0.1,0.2],"rotation":1,"scale":[2,3]}}}}}}}}}}],
        "textures":[{{"source":0,"sampler":0}}],"samplers":[{{"wrapS":33071}}],"images":[{{"uri":"{image}"}}],
        "nodes":[{{"children":[1,2],"rotation":[0,0,1,0]}},{{"mesh":0,"scale":[1,-2,3]}},
            {{"mesh":0,"matrix":[1,0,0,0,0,1,0,0,0,0,1,0,5,6,7,1]}}],
        "scene":0,"scenes":[{{"nodes":[0]}}]}}"#
    )
}

fn gltf_buffer() -> Vec<u8> {
    let floats = [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0];
    let mut bytes: Vec<u8> = floats.iter().flat_map(|x| x.to_le_bytes()).collect();
    bytes.extend([0, 1, 2].iter().flat_map(|x: &u32| x.to_le_bytes()));
    bytes.extend([2; 24]);
    bytes
}

#[test]
fn damaged_gltf_files() {
    let uri = format!(r#","uri":"{}""#, data_uri(&gltf_buffer()));
    survive("a.gltf", gltf(&uri).as_bytes(), 1200);
}

#[test]
fn damaged_glb_files() {
    let mut text = gltf("").into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut bytes = b"glTF\x02\0\0\0".to_vec();
    bytes.extend((28 + text.len() as u32 + 96).to_le_bytes());
    for (kind, chunk) in [(b"JSON", &text), (b"BIN\0", &gltf_buffer())] {
        bytes.extend((chunk.len() as u32).to_le_bytes());
        bytes.extend(kind);
        bytes.extend(chunk);
    }
    survive("a.glb", &bytes, 800);
}

#[test]
fn damaged_stl_files() {
    let facet = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n";
    survive("a.stl", format!("solid\n{facet}{facet}endsolid\n").as_bytes(), 400);
    let mut binary = vec![b'x'; 80];
    binary.extend(3u32.to_le_bytes());
    for corner in 0..9u8 {
        binary.extend((0..12).flat_map(|i| f32::from(corner * 12 + i).to_le_bytes()));
        if corner % 3 == 2 {
            binary.extend([0; 6]);
        }
    }
    binary.truncate(84 + 150);
    survive("a.stl", &binary, 400);
}
