//! Viewpoints show something: tested by brute force against the stand-ins. The large meshes take long, so they are ignored
//! by default; `cargo test --release -p esvo-scenes -- --ignored` runs them.

use esvo_builder::mesh::Mesh;
use esvo_scenes::{CameraSpec, SceneManifest};
use glam::DVec3;

/// Rays per side of the coarse picture that is cast.
const RAYS: usize = 7;

fn hit(mesh: &Mesh, t: [u32; 3], origin: DVec3, direction: DVec3) -> Option<f64> {
    let [a, b, c] = t.map(|v| DVec3::from_array(mesh.positions[v as usize]));
    let (e1, e2) = (b - a, c - a);
    let p = direction.cross(e2);
    let det = e1.dot(p);
    if det == 0.0 {
        return None;
    }
    let s = origin - a;
    let u = s.dot(p) / det;
    let q = s.cross(e1);
    let v = direction.dot(q) / det;
    let t = e2.dot(q) / det;
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0).then_some(t)
}

/// Hit distances of a grid of rays, sorted; infinite where nothing is hit.
fn view(mesh: &Mesh, c: &CameraSpec) -> Vec<f64> {
    let eye = DVec3::from_array(c.eye);
    let forward = DVec3::from_array(c.forward);
    let right = forward.cross(DVec3::from_array(c.up)).normalize();
    let up = right.cross(forward);
    let scale = (c.fov_degrees.to_radians() / 2.0).tan();
    let mut distances = Vec::new();
    for y in 0..RAYS {
        for x in 0..RAYS {
            let at = |i: usize| (2.0 * (i as f64 + 0.5) / RAYS as f64 - 1.0) * scale;
            let direction = (forward + right * at(x) + up * at(y)).normalize();
            distances.push(
                mesh.triangles.iter().filter_map(|&t| hit(mesh, t, eye, direction)).fold(f64::INFINITY, f64::min),
            );
        }
    }
    distances.sort_by(f64::total_cmp);
    distances
}

fn check(name: &str, interior: bool, least_hits: f64) {
    let manifest = SceneManifest::builtin().expect("the built-in manifest is valid");
    let scene = manifest.scene(name).expect("a scene of the paper");
    let stand_in = scene.stand_in.as_ref().expect("a stand-in");
    let mesh = stand_in.generate().expect("a generator");
    let mut low = DVec3::INFINITY;
    let mut high = DVec3::NEG_INFINITY;
    for &p in &mesh.positions {
        low = low.min(p.into());
        high = high.max(p.into());
    }
    let size = (high - low).max_element();
    for camera in &stand_in.cameras {
        let eye = DVec3::from_array(camera.eye);
        let label = format!("{name}, camera {}", camera.name);
        if interior {
            assert!(eye.cmpgt(low).all() && eye.cmplt(high).all(), "{label}: the eye is outside");
        }
        let distances = view(&mesh, camera);
        let hits = distances.iter().filter(|d| d.is_finite()).count() as f64 / distances.len() as f64;
        assert!(hits >= least_hits, "{label}: only {hits:.2} of the rays hit");
        assert!(distances[0] > camera.near, "{label}: something is {} before the eye", distances[0]);
        assert!(distances[0] > 0.004 * size, "{label}: blocked at {}", distances[0]);
        let farthest = distances.iter().filter(|d| d.is_finite()).fold(0.0_f64, |a, &b| a.max(b));
        assert!(farthest < camera.far, "{label}: a surface at {farthest} is beyond the far plane");
        // A view of one flat wall is useless.
        let median = distances[distances.len() / 2].min(farthest);
        assert!(farthest > 1.3 * distances[0] && median > 0.0, "{label}: {} to {farthest}", distances[0]);
    }
}

#[test]
fn sibenik_is_closed_and_seen_from_inside() {
    check("SIBENIK", true, 1.0);
}

#[test]
fn conference_is_closed_and_seen_from_inside() {
    check("CONFERENCE", true, 1.0);
}

#[test]
fn fairy_is_seen() {
    check("FAIRY", true, 0.3);
}

#[test]
#[ignore = "brute force over 879,000 triangles; run in release"]
fn city_is_seen() {
    check("CITY", false, 0.5);
}

#[test]
#[ignore = "brute force over 2,880,000 triangles; run in release"]
fn hairball_is_seen() {
    check("HAIRBALL", false, 0.6);
}
