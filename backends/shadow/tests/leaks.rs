//! No ray leaves a closed room, however thin its wall; fixed steps do.

use esvo_shadow::rooms::{Room, Wall};
use esvo_shadow::trace::{Fidelity, Steps, is_blocked};

#[test]
fn no_ray_leaves_a_room_and_samples_do() {
    const RAYS: usize = 8000;
    let lengths = [0.1, 0.5, 1.0, 2.0];
    let mut leaks = [0; 4];
    for wall in Wall::ALL {
        for room in Room::all(32, 3, wall, 6).unwrap() {
            for ray in room.rays(7).take(RAYS) {
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
