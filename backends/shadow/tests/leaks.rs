//! No ray leaves a closed room, however thin its wall; fixed steps do.

use esvo_shadow::rooms::{Room, Wall};
use esvo_shadow::trace::{FRACTION_BITS, Fidelity, Ray, Steps, is_blocked};
use glam::{DMat3, DQuat, EulerRot};

/// Numbers from a seed.
struct Random(u64);

impl Random {
    fn below(&mut self, end: u32) -> i32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) % u64::from(end)) as i32
    }
}

/// Boxes turned to many directions, boxes along the axes, and a ball.
fn rooms(wall: Wall) -> impl Iterator<Item = Room> {
    let turns = (0..6).map(|i| {
        let angle = f64::from(i) * 0.137;
        Some(DMat3::from_quat(DQuat::from_euler(EulerRot::XYZ, angle, 2.0 * angle, 3.1 * angle)))
    });
    turns.chain([None]).map(move |turned| Room::new(32, 3, wall, turned).unwrap())
}

/// A ray from inside a room to far outside: through corners and edges of voxels, along diagonals, and in any direction.
fn ray(room: &Room, random: &mut Random) -> Ray {
    let unit = 1 << FRACTION_BITS;
    let voxel = room.inside[random.below(room.inside.len() as u32) as usize];
    let kind = random.below(4);
    let from = voxel.map(|c| {
        let within = match kind {
            // Just within the corner: corners themselves may belong to the wall, which is a hit as well.
            0 => [0, unit][random.below(2) as usize],
            1 => unit / 2,
            _ => random.below(unit as u32 + 1),
        };
        c * unit + within
    });
    loop {
        let way: [i32; 3] = std::array::from_fn(|_| match kind {
            0 | 1 => (random.below(5) - 2) * 40 * unit,
            _ => (random.below(2001) - 1000) * 13,
        });
        let far = way.iter().map(|d| d.abs()).max().unwrap_or(0);
        if far > 0 {
            // Long enough to leave the room.
            let way = way.map(|d| (i64::from(d) * 65_535 / i64::from(far)) as i32);
            return Ray::exact(from, way).unwrap();
        }
    }
}

#[test]
fn no_ray_leaves_a_room_and_samples_do() {
    const RAYS: u32 = 8000;
    let lengths = [0.1, 0.5, 1.0, 2.0];
    let mut leaks = [0; 4];
    for wall in Wall::ALL {
        for room in rooms(wall) {
            let mut random = Random(7);
            for _ in 0..RAYS {
                let ray = ray(&room, &mut random);
                for fidelity in [Fidelity::EXACT, Fidelity::WITHOUT_MIPS, Fidelity { fine_until: 3, ..Fidelity::EXACT }]
                {
                    assert!(is_blocked(&room.volume, &ray, fidelity).0, "{ray:?} leaves a room with {wall:?}");
                }
                for (count, length) in leaks.iter_mut().zip(lengths) {
                    let steps = Steps::new(&ray, length).unwrap();
                    *count += u32::from(steps.first_hit(&room.volume, &ray, Fidelity::EXACT).hit.is_none());
                }
            }
        }
    }
    println!("of {} rays left the rooms in steps of {lengths:?}: {leaks:?}", 3 * 7 * RAYS);
    assert!(leaks[3] > leaks[2] && leaks[2] > leaks[1] && leaks[1] > leaks[0] && leaks[0] > 0, "{leaks:?}");
}
