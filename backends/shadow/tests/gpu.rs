//! Rays on a device against those of the processor: equal in every bit, and mistakes put into the kernels are caught.

mod gpu_common;

use bytemuck::{Pod, Zeroable};
use esvo_device::{Gpu, Usage, storage, wgpu};
use esvo_shadow::Volume;
use esvo_shadow::gpu::{GpuVolume, TRACE_WGSL, Tracer, volume_layout};
use esvo_shadow::rooms::{Room, Wall};
use esvo_shadow::trace::{FRACTION_BITS, Fidelity, Ray, Steps, Traced, first_hit};
use glam::{DMat3, DQuat, DVec3, EulerRot};
use gpu_common::{Random, difference, gpu};

const UNIT: i32 = 1 << FRACTION_BITS;

const FIDELITIES: [Fidelity; 8] = [
    Fidelity::EXACT,
    Fidelity::WITHOUT_MIPS,
    Fidelity { coarsest: 1, fine_until: 0 },
    Fidelity { coarsest: 6, fine_until: 1 },
    Fidelity { coarsest: 6, fine_until: 5 },
    Fidelity { coarsest: 2, fine_until: 3 },
    Fidelity { coarsest: 9, fine_until: 7 << 16 },
    Fidelity { coarsest: 6, fine_until: u32::MAX },
];

/// Lengths of steps, in voxels.
const LENGTHS: [f64; 7] = [0.0001, 0.05, 0.37, 1.0, 1.9, 7.3, 64.0];

/// Where rays begin and end, around a volume of so many voxels: on planes, edges and corners of voxels, one unit beside them, and anywhere, inside and outside.
fn place(random: &mut Random, voxels: u32) -> i32 {
    let edge = voxels as i32;
    match random.below(6) {
        0 | 1 => random.between(-3, edge + 3) * UNIT,
        2 => random.between(-6, 2 * edge + 6) * UNIT / 2,
        3 => random.between(0, edge) * UNIT + random.between(-1, 1),
        _ => random.between(-UNIT, (edge + 1) * UNIT),
    }
}

/// Rays that are hard to get right: through edges and corners, along diagonals, along axes within planes, from far outside, longer than any volume.
fn rays(random: &mut Random, voxels: [u32; 3], count: usize) -> Vec<Ray> {
    let mut rays = Vec::with_capacity(count);
    while rays.len() < count {
        let from = voxels.map(|n| place(random, n));
        let to = voxels.map(|n| place(random, n));
        let mut way: [i32; 3] = std::array::from_fn(|axis| to[axis] - from[axis]);
        match random.below(9) {
            0 => way[1] = way[0].abs() * way[1].signum(),
            1 => {
                way[1] = way[0].abs() * way[1].signum();
                way[2] = way[0].abs() * way[2].signum();
            }
            // Along one axis, or within a plane.
            2 => {
                let axis = random.below(3) as usize;
                way = std::array::from_fn(|other| if other == axis { way[other] } else { 0 });
            }
            3 => way[random.below(3) as usize] = 0,
            // Small whole multiples of each other, far beyond the volume.
            4 => way = std::array::from_fn(|_| random.between(-3, 3) * 8000),
            5 => way = std::array::from_fn(|_| random.between(-40_000_000, 40_000_000)),
            _ => {}
        }
        rays.extend(Ray::exact(from, way));
    }
    rays
}

/// A volume of random voxels: `full` of a thousand.
fn random_volume(random: &mut Random, voxels: [u32; 3], mips: u32, full: u32) -> Volume {
    let mut volume = Volume::new(voxels, mips).unwrap();
    let all = voxels.iter().map(|&n| u64::from(n)).product::<u64>();
    let count = (all * u64::from(full)).div_ceil(1000);
    volume.set((0..count).map(|_| voxels.map(|n| random.below(n))));
    volume
}

/// The volumes that rays are traced through.
fn volumes() -> Vec<Volume> {
    let random = &mut Random(11);
    let mut volumes = Vec::new();
    for mips in 0..=5 {
        for (voxels, full) in [([9, 7, 13], 60), ([33, 18, 21], 12), ([64, 31, 47], 2), ([5, 5, 5], 400)] {
            volumes.push(random_volume(random, voxels, mips, full));
        }
    }
    volumes.push(Volume::new([1, 1, 1], 3).unwrap());
    volumes.push(random_volume(random, [701, 250, 97], 5, 1));
    volumes.push(random_volume(random, [130, 3, 300], 2, 1));
    let turned = DMat3::from_quat(DQuat::from_euler(EulerRot::XYZ, 0.3, 0.7, 1.1));
    for wall in Wall::ALL {
        volumes.push(Room::new(32, 3, wall, Some(turned)).unwrap().volume);
        volumes.push(Room::new(27, 2, wall, None).unwrap().volume);
    }
    volumes
}

/// Whether two results are one, in every bit.
fn same(a: &Traced, b: &Traced) -> bool {
    let bits = |traced: &Traced| (traced.steps, traced.hit.map(|hit| (hit.cell, hit.level, hit.distance.to_bits())));
    bits(a) == bits(b)
}

/// How many rays are compared.
#[derive(Clone, Copy, PartialEq)]
enum Compare {
    All,
    /// Those up to the first volume with a difference.
    UntilDifferent,
}

/// What was compared, and what was not equal.
#[derive(Default, Debug)]
struct Comparison {
    rays: u32,
    hits: u32,
    different: u32,
    first: Option<String>,
}

impl Comparison {
    fn add(&mut self, expected: &[Traced], found: &[Traced], name: impl Fn(usize) -> String) {
        assert_eq!(expected.len(), found.len());
        for (i, (expected, found)) in expected.iter().zip(found).enumerate() {
            self.rays += 1;
            self.hits += u32::from(expected.hit.is_some());
            if !same(expected, found) {
                self.different += 1;
                self.first.get_or_insert_with(|| format!("{}: {found:?}, on the processor {expected:?}", name(i)));
            }
        }
    }
}

/// Every voxel that rays touch, on the device and on the processor, `count` rays for each volume and fidelity.
fn compare_walks(gpu: &Gpu, tracer: &Tracer, volumes: &[Volume], count: usize, how: Compare) -> Comparison {
    let (mut comparison, random) = (Comparison::default(), &mut Random(5));
    for volume in volumes {
        let copy = GpuVolume::new(gpu, volume).unwrap();
        for fidelity in FIDELITIES {
            let rays = rays(random, volume.voxels(), count);
            let expected: Vec<Traced> = rays.iter().map(|ray| first_hit(volume, ray, fidelity)).collect();
            let found = tracer.trace(gpu, &copy, &rays, fidelity).unwrap().rays;
            let name = |i: usize| format!("{:?} voxels, {fidelity:?}, {:?}", volume.voxels(), rays[i]);
            comparison.add(&expected, &found, name);
        }
        if how == Compare::UntilDifferent && comparison.different > 0 {
            break;
        }
    }
    comparison
}

/// The same with samples in fixed steps, `count` rays for each volume, fidelity and length of steps.
fn compare_steps(gpu: &Gpu, tracer: &Tracer, volumes: &[Volume], count: usize, how: Compare) -> Comparison {
    let (mut comparison, random) = (Comparison::default(), &mut Random(6));
    for volume in volumes {
        let copy = GpuVolume::new(gpu, volume).unwrap();
        for fidelity in FIDELITIES {
            let rays: Vec<(Ray, Steps)> = (LENGTHS.iter())
                .flat_map(|&length| rays(random, volume.voxels(), count).into_iter().map(move |ray| (ray, length)))
                .map(|(ray, length)| (ray, Steps::new(&ray, length).unwrap()))
                .collect();
            let expected: Vec<Traced> =
                rays.iter().map(|(ray, steps)| steps.first_hit(volume, ray, fidelity)).collect();
            let found = tracer.trace_steps(gpu, &copy, &rays, fidelity).unwrap().rays;
            let name = |i: usize| format!("{:?} voxels, {fidelity:?}, {:?}", volume.voxels(), rays[i]);
            comparison.add(&expected, &found, name);
        }
        if how == Compare::UntilDifferent && comparison.different > 0 {
            break;
        }
    }
    comparison
}

#[test]
fn every_bit_of_a_walk_is_that_of_the_processor() {
    let Some(gpu) = gpu() else { return };
    let found = compare_walks(gpu, &Tracer::new(gpu).unwrap(), &volumes(), 3000, Compare::All);
    println!("{} rays, {} hits", found.rays, found.hits);
    assert_eq!(found.different, 0, "of {} rays: {}", found.rays, found.first.unwrap_or_default());
    assert!(found.hits > found.rays / 5 && found.hits < found.rays);
}

#[test]
fn every_bit_of_samples_is_that_of_the_processor() {
    let Some(gpu) = gpu() else { return };
    let found = compare_steps(gpu, &Tracer::new(gpu).unwrap(), &volumes(), 400, Compare::All);
    println!("{} rays, {} hits", found.rays, found.hits);
    assert_eq!(found.different, 0, "of {} rays: {}", found.rays, found.first.unwrap_or_default());
    assert!(found.hits > found.rays / 5 && found.hits < found.rays);
}

/// A kernel with a mistake.
fn broken(gpu: &Gpu, (right, wrong): (&str, &str)) -> Tracer {
    assert_eq!(TRACE_WGSL.matches(right).count(), 1, "{right}");
    Tracer::with_kernel(gpu, &TRACE_WGSL.replace(right, wrong)).unwrap()
}

#[test]
fn mistakes_in_the_walk_are_caught() {
    let Some(gpu) = gpu() else { return };
    let volumes = volumes();
    for mistake in [
        // Planes that are crossed at once are crossed one after the other.
        ("if distance < 0 {", "if distance <= 0 {"),
        ("vec3<bool>(distance <= 0)", "vec3<bool>(distance < 0)"),
        // A ray in the middle of a cell is in the lower half.
        ("vec3<i32>(1), distance <= vec3<i32>(0));", "vec3<i32>(1), distance < vec3<i32>(0));"),
        // Voxels at edges and corners are not looked at: on the way to the next cell, on the way down, and at the origin.
        ("vec3<u32>(1u)) > 1u;", "vec3<u32>(1u)) > 3u;"),
        ("touches_others = any((distance == vec3<i32>(0)) & !walk.still);", "touches_others = false;"),
        ("= any((walk.origin & vec3<i32>(UNIT - 1)) == vec3<i32>(0));", "= false;"),
        // Of the voxels at an edge or a corner, not all.
        ("choice = (choice - all) & all;", "break;"),
        // Mirrored cells are off by one.
        ("let place = select(cell, beside, other);", "let place = select(cell, beside, other) + walk.flip;"),
        ("vec3<i32>(-1), flip != vec3<i32>(0));", "vec3<i32>(0), flip != vec3<i32>(0));"),
        // Of two voxels that the ray lies between, one.
        ("let beside = (walk.start - vec3<i32>(1))", "let beside = walk.start"),
        // The end is not part of the ray.
        ("walk.direction[walk.major] < 0 {", "walk.direction[walk.major] <= 0 {"),
        // Coarse too early.
        ("voxels / fidelity.fine_until + 1u", "voxels / fidelity.fine_until + 2u"),
        // Two bits of a byte are taken for each other.
        ("(odd.y << 1u) | (odd.z << 2u)", "(odd.y << 2u) | (odd.z << 1u)"),
        // A mip for another.
        ("select(level - 1u, 0u, of_bit)", "select(level / 2u, 0u, of_bit)"),
    ] {
        let found = compare_walks(gpu, &broken(gpu, mistake), &volumes, 100, Compare::UntilDifferent);
        println!("{} of {} rays differ: {mistake:?}", found.different, found.rays);
        assert!(found.different > 0, "not caught: {mistake:?}");
    }
}

#[test]
fn mistakes_in_samples_are_caught() {
    let Some(gpu) = gpu() else { return };
    let volumes = volumes();
    for mistake in [
        // A sample too far, and places that are counted from another base.
        ("select(1, 0, is_up))", "select(1, 1, is_up))"),
        ("& vec3<i32>(~((1 << MAX_LEVEL) - 1));", "& vec3<i32>(~7);"),
        // The end of the volume: a voxel early.
        ("(voxel >= shadow.voxels)", "(voxel >= shadow.voxels - vec3<i32>(1))"),
        // Samples that are left, and those until steps are longer.
        ("left / 2u + (left & 1u)", "left / 2u"),
        ("quotient + select(1u, 0u, quotient == 0xffffffffu)", "quotient"),
        ("if whole >= 0x10000u {", "if false {"),
        ("+ second / step", ""),
    ] {
        let found = compare_steps(gpu, &broken(gpu, mistake), &volumes, 30, Compare::UntilDifferent);
        println!("{} of {} rays differ: {mistake:?}", found.different, found.rays);
        assert!(found.different > 0, "not caught: {mistake:?}");
    }
}

#[test]
fn lists_are_traced_in_parts() {
    let Some(gpu) = gpu() else { return };
    let random = &mut Random(3);
    let volume = random_volume(random, [40, 30, 20], 2, 30);
    let copy = GpuVolume::new(gpu, &volume).unwrap();
    let tracer = Tracer::new(gpu).unwrap().with_parts(100);
    for count in [0, 1, 99, 100, 101, 1000, 1037] {
        let rays = rays(random, volume.voxels(), count);
        let expected: Vec<Traced> = rays.iter().map(|ray| first_hit(&volume, ray, Fidelity::EXACT)).collect();
        assert_eq!(tracer.trace(gpu, &copy, &rays, Fidelity::EXACT).unwrap().rays, expected);
        let rays: Vec<_> = rays.iter().map(|ray| (*ray, Steps::new(ray, 0.5).unwrap())).collect();
        let expected: Vec<Traced> =
            rays.iter().map(|(ray, steps)| steps.first_hit(&volume, ray, Fidelity::EXACT)).collect();
        assert_eq!(tracer.trace_steps(gpu, &copy, &rays, Fidelity::EXACT).unwrap().rays, expected);
    }
}

#[test]
fn rays_of_real_numbers_are_those_of_the_processor() {
    let Some(gpu) = gpu() else { return };
    let random = &mut Random(9);
    let volume = random_volume(random, [200, 180, 90], 3, 1);
    let copy = GpuVolume::new(gpu, &volume).unwrap();
    assert_eq!(difference(gpu, &copy, &volume), None);
    let mut number = |from: f64, to: f64| from + random.unit() * (to - from);
    let rays: Vec<Ray> = (0..20_000)
        .map(|_| {
            let origin = DVec3::new(number(-50.0, 250.0), number(-50.0, 250.0), number(-50.0, 150.0));
            let direction = DVec3::new(number(-1.0, 1.0), number(-1.0, 1.0), number(-1.0, 1.0));
            Ray::new(origin, direction, number(0.0, 9000.0)).unwrap()
        })
        .collect();
    let tracer = Tracer::new(gpu).unwrap();
    let mut comparison = Comparison::default();
    for fidelity in FIDELITIES {
        let expected: Vec<Traced> = rays.iter().map(|ray| first_hit(&volume, ray, fidelity)).collect();
        let found = tracer.trace(gpu, &copy, &rays, fidelity).unwrap();
        comparison.add(&expected, &found.rays, |i| format!("{fidelity:?}, {:?}", rays[i]));
    }
    assert_eq!(comparison.different, 0, "{comparison:?}");
    assert!(comparison.hits > 0);
}

/// A kernel of one's own that makes rays of floating-point numbers and asks whether they are blocked.
const OWN_WGSL: &str = "
struct Wish { origin: vec3<f32>, length: f32, direction: vec3<f32>, is_blocked: u32 }
@group(1) @binding(0) var<storage, read_write> wishes: array<Wish>;
@group(1) @binding(1) var<storage, read_write> made: array<Ray>;
@compute @workgroup_size(64) fn ask(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < arrayLength(&wishes) {
        let wish = wishes[id.x];
        made[id.x] = new_ray(wish.origin, wish.direction, wish.length);
        wishes[id.x].is_blocked = u32(is_blocked(made[id.x], Fidelity(6u, 0u)));
    }
}";

#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct Wish {
    origin: [f32; 3],
    length: f32,
    direction: [f32; 3],
    is_blocked: u32,
}

/// Other kernels can follow the tracer's text. The rays that they make are those of the processor, or next to them, and these are traced as there.
#[test]
fn kernels_make_rays_and_ask() {
    let Some(gpu) = gpu() else { return };
    let random = &mut Random(13);
    let volume = random_volume(random, [200, 180, 90], 3, 1);
    let copy = GpuVolume::new(gpu, &volume).unwrap();
    let wishes: Vec<Wish> = (0..6400)
        .map(|i| {
            let axis = |random: &mut Random| (random.unit() * 2.0 - 1.0) as f32;
            let mut direction = [axis(random), axis(random), axis(random)];
            match i % 8 {
                0 => direction[i / 8 % 3] = 0.0,
                1 => direction = std::array::from_fn(|other| if other == i / 8 % 3 { direction[other] } else { 0.0 }),
                2 => direction[1] = -direction[0],
                _ => {}
            }
            let origin = [200.0, 180.0, 90.0].map(|edge| (random.unit() * edge) as f32);
            let length = (random.unit() * if i % 5 == 0 { 20_000.0 } else { 100.0 }) as f32;
            Wish { origin, length, direction, is_blocked: 2 }
        })
        .collect();
    let own = gpu.bind_group_layout("own", &[storage(0, false), storage(1, false)]).unwrap();
    let module = gpu.shader("own", &[TRACE_WGSL, OWN_WGSL].concat()).unwrap();
    let pipeline = gpu.compute_pipeline(&module, "ask", &[&volume_layout(gpu).unwrap(), &own]).unwrap();
    let asked = gpu.upload("wishes", &wishes, Usage::STORAGE | Usage::COPY_SRC).unwrap();
    let bytes = (wishes.len() * size_of::<Ray>()) as u64;
    let made = gpu.buffer("rays", bytes, Usage::STORAGE | Usage::COPY_SRC).unwrap();
    let group = gpu.bind_group(&own, &[&asked, &made]).unwrap();
    gpu.run(|commands| {
        let mut pass = commands.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, copy.bind_group(), &[]);
        pass.set_bind_group(1, &group, &[]);
        pass.dispatch_workgroups(wishes.len() as u32 / 64, 1, 1);
    })
    .unwrap();
    let answers: Vec<Wish> = gpu.read(&asked, wishes.len()).unwrap();
    let rays: Vec<Ray> = gpu.read(&made, wishes.len()).unwrap();
    let (mut equal, mut blocked) = (0, 0);
    for ((wish, answer), ray) in wishes.iter().zip(&answers).zip(&rays) {
        let [origin, direction] = [wish.origin, wish.direction].map(|v| DVec3::from(v.map(f64::from)));
        let expected = Ray::new(origin, direction, f64::from(wish.length)).unwrap();
        let [found, numbers]: [[i32; 8]; 2] = [bytemuck::cast(*ray), bytemuck::cast(expected)];
        assert_eq!(found[3], numbers[3], "the major axis of {wish:?}");
        assert!((0..8).all(|i| found[i].abs_diff(numbers[i]) <= 1), "{wish:?}: {ray:?}, on the processor {expected:?}");
        equal += u32::from(ray == &expected);
        let is_blocked = first_hit(&volume, ray, Fidelity::EXACT).hit.is_some();
        assert_eq!(answer.is_blocked, u32::from(is_blocked), "{ray:?}");
        blocked += answer.is_blocked;
    }
    println!("of {} rays {equal} are equal to the processor's, {blocked} are blocked", rays.len());
    assert!(equal as usize > rays.len() / 2 && blocked > 0 && (blocked as usize) < rays.len());
}
