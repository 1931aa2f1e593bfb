//! Effects through a volume against the same effects among boxes that know exactly what a ray meets.

mod scene;

use esvo_shadow::effects::bounce::bounce;
use esvo_shadow::effects::denoise::{Edges, History, blur, smooth, smooth_shares};
use esvo_shadow::effects::fog::{Fog, Veil, fog};
use esvo_shadow::effects::lamps::{lit, shadow, shadows};
use esvo_shadow::effects::occlusion::ambient_occlusion;
use esvo_shadow::effects::reflections::Reflection;
use esvo_shadow::effects::reflections::{Mirror, reflections};
use esvo_shadow::effects::{Cone, Frame, How, Lamp, Obstacles, Offset, Query, Rays, Surface, Through};
use esvo_shadow::trace::Fidelity;
use esvo_shadow::{Mesh, Pose, Shape, Volume, World};
use glam::{DQuat, DVec3, EulerRot, Vec2, Vec3};
use scene::{Blocks, GRID, VOXELS, eye, rmse, room};

const SIZE: (u32, u32) = (96, 64);

fn frame(blocks: &Blocks) -> Frame {
    blocks.frame(eye([2.2, -1.6, 1.7], [1.9, 2.2, 0.4], SIZE))
}

fn through<'a>(volume: &'a Volume, screen: Option<&'a Frame>) -> Through<'a, Volume> {
    Through { volume, grid: GRID, how: How::Walk(Fidelity::EXACT), offset: Offset::SAFE, screen }
}

fn rays(count: u32) -> Rays {
    Rays { count, seed: 3 }
}

/// Rays from a plane never meet the plane's own voxels with the derived offset, however the plane is turned, and do with half of it.
#[test]
fn the_offset_is_safe_and_half_of_it_is_not() {
    let mut met = [0; 2];
    for turn in 0..40 {
        let angle = f64::from(turn) * 0.37;
        let rotation = DQuat::from_euler(EulerRot::ZYX, angle, 0.61 * angle, 1.7 * angle);
        // Also a plane along the grid, in the plane between two voxels.
        let rotation = if turn == 0 { DQuat::IDENTITY } else { rotation };
        let corners =
            [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]].map(DVec3::from).to_vec();
        let sheet = Shape::Mesh(Mesh::surface(corners, vec![[0, 1, 2], [0, 2, 3]]).unwrap());
        let pose = Pose { rotation, position: DVec3::new(2.0, 2.0, 1.2) };
        let mut world = World::new(GRID, VOXELS, 2).unwrap();
        world.add_fixed(&sheet, &pose).unwrap();
        world.update(0);
        let normal = (rotation * DVec3::Z).as_vec3();
        let mut queries = Vec::new();
        for i in 0..2000u32 {
            let place = DVec3::new(f64::from(i % 40) / 22.0 - 0.87, f64::from(i / 40) / 28.0 - 0.88, 0.0);
            // Down to rays along the plane.
            let (around, slope) = (f64::from(i) * 2.4, f64::from(i % 7) / 6.0);
            let local = DVec3::new(
                around.cos() * (1.0 - slope * slope).sqrt(),
                around.sin() * (1.0 - slope * slope).sqrt(),
                slope,
            );
            let direction = (rotation * local).as_vec3().normalize();
            queries.push(Query { from: pose.apply(place).as_vec3(), normal, direction, length: 2.0 });
        }
        for (met, offset) in met.iter_mut().zip([Offset::SAFE, Offset { share: 0.5, ..Offset::SAFE }]) {
            let obstacles = Through { offset, ..through(world.volume(), None) };
            *met += obstacles.blocked(&queries).iter().filter(|&&blocked| blocked).count();
        }
    }
    assert_eq!(met[0], 0);
    assert!(met[1] > 1000, "{met:?}");
}

#[test]
fn ambient_occlusion_is_as_among_boxes() {
    let blocks = room();
    let (frame, world) = (frame(&blocks), blocks.world());
    let exact = ambient_occlusion(&frame, &blocks, 1.0, rays(128));
    let error = |obstacles: &Through<Volume>| rmse(&ambient_occlusion(&frame, obstacles, 1.0, rays(128)), &exact);
    let both = error(&through(world.volume(), Some(&frame)));
    let alone = error(&through(world.volume(), None));
    let acne = error(&Through { offset: Offset::NONE, ..through(world.volume(), None) });
    let steps = How::Steps { length: 1.0, fidelity: Fidelity::EXACT };
    let stepped = error(&Through { how: steps, ..through(world.volume(), Some(&frame)) });
    println!(
        "ambient occlusion, error: {both} with the picture, {alone} without, {stepped} in steps, {acne} without an offset"
    );
    assert!(both < 0.06 && alone < 0.08 && stepped < 0.09 && acne > 0.4, "{both} {alone} {stepped} {acne}");
    // Pixels without a surface, and away from everything, are free.
    let sky = frame.surfaces.iter().position(Option::is_none).expect("the sky is seen");
    assert_eq!(exact[sky], 1.0);
}

/// A picture of a volume shows the faces of its voxels: near the surfaces that they are of, with normals along the axes, on the side of the eye.
#[test]
fn a_volume_shows_its_voxels() {
    let blocks = room();
    let world = blocks.world();
    let exact = frame(&blocks);
    let green = |_: Vec3, normal: Vec3| Vec3::new(0.0, 1.0, normal.z);
    let shown = Frame::of_volume(exact.eye, world.volume(), &GRID, 10.0, &green);
    let (mut near, mut both) = (0, 0);
    for (surface, shown) in exact.surfaces.iter().zip(&shown.surfaces) {
        let Some(shown) = shown else { continue };
        assert_eq!(shown.normal.abs().max_element(), 1.0);
        assert!(shown.normal.dot(shown.position - exact.eye.position) < 0.0 && shown.color.z == shown.normal.z);
        // On a face of a voxel, up to the rounding of rays.
        let face = GRID.to_voxels(shown.position.as_dvec3()).dot(shown.normal.abs().as_dvec3());
        assert!((face - face.round()).abs() < 0.05, "{face}");
        let Some(surface) = surface else { continue };
        both += 1;
        near += usize::from(shown.position.distance(surface.position) < 0.3 && shown.normal == surface.normal);
    }
    assert!(both > 2000 && near * 20 > both * 19, "{near} of {both}");
}

/// A strip half a voxel high shades the floor beside it only if rays begin in the picture.
#[test]
fn the_picture_has_what_the_offset_skips() {
    let blocks = room();
    let world = blocks.world();
    let frame = blocks.frame(eye([3.0, 0.85, 0.42], [3.0, 1.0, 0.213], SIZE));
    let beside = |surface: &Option<Surface>| {
        surface.is_some_and(|surface| {
            surface.normal.z > 0.5
                && surface.position.z < 0.22
                && (0.985..1.0).contains(&surface.position.y)
                && (2.7..3.3).contains(&surface.position.x)
        })
    };
    let mean = |obstacles: &dyn Fn() -> Vec<f32>| {
        let values = obstacles();
        let near: Vec<f32> =
            frame.surfaces.iter().zip(values).filter(|(surface, _)| beside(surface)).map(|(_, value)| value).collect();
        assert!(near.len() > 50);
        near.iter().sum::<f32>() / near.len() as f32
    };
    let exact = mean(&|| ambient_occlusion(&frame, &blocks, 0.5, rays(64)));
    let with = mean(&|| ambient_occlusion(&frame, &through(world.volume(), Some(&frame)), 0.5, rays(64)));
    let without = mean(&|| ambient_occlusion(&frame, &through(world.volume(), None), 0.5, rays(64)));
    println!("beside the strip: {exact} exactly, {with} with the picture, {without} without");
    assert!(
        exact < 0.85 && without > 0.97 && (with - exact).abs() < (without - exact) * 0.5,
        "{exact} {with} {without}"
    );
}

fn lamp(radius: f32) -> Lamp {
    Lamp { position: Vec3::new(0.9, 0.8, 2.2), radius, color: Vec3::ONE, reach: f32::INFINITY, cone: None }
}

#[test]
fn shadows_are_as_among_boxes() {
    let blocks = room();
    let (frame, world) = (frame(&blocks), blocks.world());
    for (radius, most) in [(0.0, 0.2), (0.3, 0.09)] {
        let exact = shadow(&frame, &blocks, &lamp(radius), rays(64));
        let through = shadow(&frame, &through(world.volume(), Some(&frame)), &lamp(radius), rays(64));
        let error = rmse(&exact, &through);
        println!("shadow of a lamp of {radius} m, error {error}");
        assert!(error < most, "{radius}: {error}");
        let (dark, bright) = (exact.iter().filter(|&&s| s == 0.0).count(), exact.iter().filter(|&&s| s == 1.0).count());
        assert!(dark > 200 && bright > 1000);
        assert_eq!(exact.iter().any(|s| (0.01..0.99).contains(s)), radius > 0.0);
    }
    // A cone's light ends.
    let cone = Cone { axis: Vec3::new(0.5, 0.6, -1.0).normalize(), inner: 0.95, outer: 0.9 };
    let spot = Lamp { cone: Some(cone), ..lamp(0.0) };
    let light = lit(&frame, &[spot], &shadows(&frame, &blocks, &[spot], rays(1)));
    let outside = frame.surfaces.iter().zip(&light).filter(|(surface, _)| {
        surface.is_some_and(|surface| (surface.position - spot.position).normalize().dot(cone.axis) < 0.9)
    });
    assert!(outside.clone().count() > 500 && outside.clone().all(|(_, light)| *light == Vec3::ZERO));
    assert!(light.iter().any(|light| light.x > 0.05));
}

#[test]
fn reflections_show_what_the_picture_shows() {
    let blocks = room();
    let (frame, world) = (frame(&blocks), blocks.world());
    let light: Vec<Vec3> =
        frame.surfaces.iter().map(|surface| surface.map_or(Vec3::ZERO, |surface| surface.color)).collect();
    let sky = |_: Vec3| Vec3::new(0.0, 0.0, 1.0);
    let mirror = Mirror { roughness: 0.0, reach: 5.0, tolerance: 0.12 };
    let through = through(world.volume(), Some(&frame));
    let exact = reflections(&frame, &blocks, mirror, rays(1), &light, &sky);
    let here = reflections(&frame, &through, mirror, rays(1), &light, &sky);
    let open = |all: &[Reflection]| all.iter().map(|r| r.open).collect::<Vec<_>>();
    let error = rmse(&open(&exact), &open(&here));
    // The floor mirrors the wall in red where the picture shows it.
    let red = |all: &[Reflection]| {
        let floor = |surface: &Option<Surface>| surface.is_some_and(|s| s.normal.z > 0.5 && s.position.z < 0.25);
        frame
            .surfaces
            .iter()
            .zip(all)
            .filter(|(surface, r)| floor(surface) && r.color.x > 2.0 * r.color.y && r.open == 0.0)
            .count()
    };
    println!("specular occlusion, error {error}; red on the floor: {} exactly, {} here", red(&exact), red(&here));
    assert!(error < 0.2, "{error}");
    assert!(red(&exact) > 150 && red(&here) * 10 > red(&exact) * 8, "{} {}", red(&exact), red(&here));
    // What the picture does not show is black: from above, the wall's front is not seen.
    let above = blocks.frame(eye([2.0, 1.9, 2.3], [2.0, 2.0, 0.0], SIZE));
    let none = vec![Vec3::ONE; light.len()];
    let rough = Mirror { roughness: 0.6, ..mirror };
    let dark = reflections(&above, &Through { screen: Some(&above), ..through }, rough, rays(16), &none, &sky);
    assert!(dark.iter().all(|r| r.open >= 0.0 && r.open <= 1.0 && r.color.z >= r.open * 0.999));
}

#[test]
fn fog_has_shafts() {
    let blocks = room();
    let (frame, world) = (frame(&blocks), blocks.world());
    let mist = Fog { density: 0.3, reach: 6.0 };
    let value = |veils: &[Veil]| veils.iter().map(|veil| veil.color.x).collect::<Vec<_>>();
    let lamps = [lamp(0.0)];
    let exact = value(&fog(&frame, &blocks, mist, &lamps, rays(32)));
    let steps = How::Steps { length: 1.0, fidelity: Fidelity::EXACT };
    let here = fog(&frame, &Through { how: steps, ..through(world.volume(), None) }, mist, &lamps, rays(32));
    let mean = exact.iter().sum::<f32>() / exact.len() as f32;
    let error = rmse(&exact, &value(&here));
    println!("fog, error {error} of {mean}");
    assert!(error < 0.05 * mean, "{error} {mean}");
    // Behind what stands before the lamp is less light than without it, here as there.
    let free = value(&fog(&frame, &Blocks(Vec::new()), mist, &lamps, rays(32)));
    let shaft = |values: &[f32]| free.iter().zip(values).filter(|(free, value)| **value < 0.8 * **free).count();
    println!("pixels in shafts: {} exactly, {} here", shaft(&exact), shaft(&value(&here)));
    assert!(shaft(&exact) > 40 && shaft(&exact).abs_diff(shaft(&value(&here))) * 3 < shaft(&exact));
    // A ray without obstacles gathers what an integral in small steps says.
    let empty = Frame { surfaces: vec![None; frame.surfaces.len()], ..frame.clone() };
    let many = fog(&empty, &Blocks(Vec::new()), mist, &lamps, rays(4096));
    let pixel = (SIZE.1 / 2 * SIZE.0 + SIZE.0 / 2) as usize;
    let direction = frame.eye.direction(Vec2::new(SIZE.0 as f32 / 2.0 + 0.5, SIZE.1 as f32 / 2.0 + 0.5)).normalize();
    let parts = 60_000;
    let part = 6.0 / f64::from(parts);
    let scattered = |i: u32| {
        let distance = (f64::from(i) + 0.5) * part;
        let far = (frame.eye.position + direction * distance as f32).distance(lamps[0].position);
        let light = 1.0 / f64::from(far * far) * (-0.3 * (distance + f64::from(far))).exp();
        light * 0.3 * part / (4.0 * std::f64::consts::PI)
    };
    let integral: f64 = (0..parts).map(scattered).sum();
    assert!((f64::from(many[pixel].color.x) / integral - 1.0).abs() < 0.01, "{} {integral}", many[pixel].color.x);
    for (veil, surface) in here.iter().zip(&frame.surfaces) {
        let length = surface.map_or(6.0, |surface| surface.position.distance(frame.eye.position).min(6.0));
        assert!((veil.clear - (-0.3 * length).exp()).abs() < 1e-5);
    }
}

#[test]
fn light_bounces() {
    let blocks = room();
    let (frame, world) = (frame(&blocks), blocks.world());
    let look = |place: Vec3, direction: Vec3| {
        // What lies within a voxel or two of the place.
        let (_, normal, color) = blocks.meet(place - direction * 0.15, direction, 0.4)?;
        Some((normal, color))
    };
    let lamps = [lamp(0.0)];
    let exact = bounce(&frame, &blocks, &lamps, 4.0, rays(64), &look);
    let here = bounce(&frame, &through(world.volume(), Some(&frame)), &lamps, 4.0, rays(64), &look);
    let near = |all: &[Vec3]| {
        let wall = |surface: &Option<Surface>| {
            surface.is_some_and(|s| s.normal.z > 0.5 && s.position.z < 0.25 && s.position.y > 3.0)
        };
        frame.surfaces.iter().zip(all).filter(|(surface, _)| wall(surface)).map(|(_, light)| *light).sum::<Vec3>()
    };
    let (exact, here) = (near(&exact), near(&here));
    println!("beside the red wall: {exact} exactly, {here} here");
    assert!(exact.x > 3.0 * exact.y && here.x > 3.0 * here.y);
    assert!((here.x / exact.x - 1.0).abs() < 0.15);
}

fn scalars(values: &[f32]) -> Vec<[f32; 1]> {
    values.iter().map(|&value| [value]).collect()
}

fn flat(values: &[[f32; 1]]) -> Vec<f32> {
    values.iter().map(|value| value[0]).collect()
}

/// A filter that knows edges is nearer to the truth than few rays, and nearer than one that does not.
#[test]
fn the_filter_keeps_edges() {
    let blocks = room();
    let frame = frame(&blocks);
    let truth = ambient_occlusion(&frame, &blocks, 1.0, rays(256));
    let noisy = ambient_occlusion(&frame, &blocks, 1.0, rays(4));
    let edges = Edges { passes: 2, distance: 0.02, cosine: 0.9 };
    let blind = Edges { distance: f32::INFINITY, cosine: -1.0, ..edges };
    let error = |edges: &Edges| rmse(&flat(&smooth(&frame, &scalars(&noisy), edges)), &truth);
    let (raw, with, without) = (rmse(&noisy, &truth), error(&edges), error(&blind));
    println!("error {raw} of 4 rays, {with} smoothed, {without} smoothed over edges");
    assert!(with < 0.7 * raw && with < 0.85 * without, "{raw} {with} {without}");
}

/// Edges of shadows stay where they are no noise, and noise goes where there are none.
#[test]
fn the_filter_tells_shadows_from_noise() {
    let blocks = room();
    let frame = frame(&blocks);
    let edges = Edges { passes: 3, distance: 0.02, cosine: 0.9 };
    let errors = |truth: &[f32], values: &[f32], rays: u32| {
        let wide = flat(&smooth(&frame, &scalars(values), &edges));
        let told = flat(&smooth_shares(&frame, &scalars(values), rays, &edges));
        [values, &wide, &told].map(|values| rmse(values, truth))
    };
    let hard = shadow(&frame, &blocks, &lamp(0.0), rays(1));
    let [_, blurred, kept] = errors(&hard, &hard, 1);
    println!("a hard shadow, error {blurred} smoothed, {kept} told from noise");
    assert!(kept < 0.6 * blurred, "{blurred} {kept}");
    let soft = shadow(&frame, &blocks, &lamp(0.3), rays(256));
    for (count, most) in [(1, 0.7), (16, 1.2)] {
        let [raw, blurred, told] = errors(&soft, &shadow(&frame, &blocks, &lamp(0.3), rays(count)), count);
        println!("a soft shadow of {count} rays, error {raw}, {blurred} smoothed, {told} told from noise");
        assert!(told < most * raw && told < 0.6 * blurred, "{count}: {raw} {blurred} {told}");
    }
    let open = ambient_occlusion(&frame, &blocks, 1.0, rays(256));
    for (count, most) in [(1, 0.6), (4, 0.6), (16, 0.8)] {
        let [raw, blurred, told] = errors(&open, &ambient_occlusion(&frame, &blocks, 1.0, rays(count)), count);
        println!("ambient occlusion of {count} rays, error {raw}, {blurred} smoothed, {told} told from noise");
        assert!(told < most * raw, "{count}: {raw} {blurred} {told}");
    }
}

/// The sky's values stay as they are when surfaces are smoothed, and are averaged where all is.
#[test]
fn the_sky_is_no_surface() {
    let blocks = room();
    let frame = frame(&blocks);
    let noise: Vec<[f32; 1]> = (0..frame.surfaces.len()).map(|i| [(i * 7919 % 101) as f32 / 100.0]).collect();
    let edges = Edges { passes: 2, distance: 0.02, cosine: 0.9 };
    let (smoothed, blurred) = (smooth(&frame, &noise, &edges), blur(&frame, &noise, 2));
    let sky: Vec<usize> = (0..noise.len()).filter(|&i| frame.surfaces[i].is_none()).collect();
    assert!(sky.len() > 100);
    let spread = |values: &[[f32; 1]]| sky.iter().map(|&i| (values[i][0] - 0.5).powi(2)).sum::<f32>();
    assert_eq!(spread(&smoothed), spread(&noise));
    assert!(spread(&blurred) < 0.1 * spread(&noise));
}

/// Over the pictures of a moving camera, noise averages out, and what was hidden before is not mixed in.
#[test]
fn pictures_before_count_where_they_show_the_same() {
    let blocks = room();
    let edges = Edges { passes: 0, distance: 0.02, cosine: 0.9 };
    let blind = Edges { distance: f32::INFINITY, cosine: -1.0, ..edges };
    let (mut history, mut careless) = (History::new(), History::new());
    let mut last = (0.0, 0.0, 0.0);
    for i in 0..12u32 {
        let frame = blocks.frame(eye([2.2 - 0.1 * i as f32, -1.6, 1.7], [1.9, 2.2, 0.4], SIZE));
        let truth = ambient_occlusion(&frame, &blocks, 1.0, rays(128));
        let noisy = ambient_occlusion(&frame, &blocks, 1.0, Rays { count: 2, seed: i });
        // The color has edges that the eye's way uncovers, and the occlusion has noise.
        let color = |values: &[f32]| -> Vec<f32> {
            let red = |(surface, value): (&Option<Surface>, &f32)| surface.map_or(0.0, |s| s.color.x) + value;
            frame.surfaces.iter().zip(values).map(red).collect()
        };
        let (truth, noisy) = (color(&truth), color(&noisy));
        let kept = flat(&history.add(&frame, &scalars(&noisy), &edges, 16));
        let mixed = flat(&careless.add(&frame, &scalars(&noisy), &blind, 16));
        last = (rmse(&noisy, &truth), rmse(&kept, &truth), rmse(&mixed, &truth));
    }
    println!("error {} of one picture, {} of several, {} without care", last.0, last.1, last.2);
    assert!(last.1 < 0.55 * last.0 && last.1 < 0.95 * last.2, "{last:?}");
}
