//! One ray of the suite alone.

use std::fmt;
use std::fmt::Write;
use std::str::FromStr;

use esvo_core::reference::cast_ray;
use esvo_core::testing::directed::{DATA_SETS, Kind, Target, ray};
use esvo_core::testing::oracle::Oracle;
use esvo_core::{Hit, Rays};

use super::data::{TARGETS, sets};
use super::{StabilityOptions, engines};
use crate::BenchError;

/// The name of a ray: octree, kind, contours or cubes, and number, e.g. `sparse/far/cubes#123`.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Case {
    /// Name of the octree.
    pub set: &'static str,
    /// Kind of the ray.
    pub kind: Kind,
    /// Whether contours clip voxels.
    pub contours: bool,
    /// What the ray is made from.
    pub number: u64,
}

impl fmt::Display for Case {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let shape = if self.contours { "contours" } else { "cubes" };
        write!(f, "{}/{}/{shape}#{}", self.set, self.kind.name(), self.number)
    }
}

impl FromStr for Case {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let expected = || {
            format!(
                "{text}: expected OCTREE/KIND/cubes#NUMBER or OCTREE/KIND/contours#NUMBER, as the report names a ray"
            )
        };
        let (path, number) = text.split_once('#').ok_or_else(expected)?;
        let parts: Vec<&str> = path.split('/').collect();
        let &[set, kind, shape] = &parts[..] else { return Err(expected()) };
        let kinds = || Kind::ALL.map(Kind::name).join(", ");
        let kind = Kind::ALL.into_iter().find(|known| known.name() == kind).ok_or_else(|| {
            format!("{text}: {kind:?} is no kind of rays that are replayed; expected one of {}", kinds())
        })?;
        let set = DATA_SETS
            .into_iter()
            .find(|known| *known == set)
            .ok_or_else(|| format!("{text}: there is no octree {set:?}; expected one of {}", DATA_SETS.join(", ")))?;
        let contours = match shape {
            "contours" => true,
            "cubes" => false,
            _ => return Err(expected()),
        };
        Ok(Self { set, kind, contours, number: number.parse().map_err(|_| expected())? })
    }
}

/// Casts one ray by the reference and by all engines: the ray, what is found, and whether it is right, as text; and whether all is right.
///
/// # Errors
/// The octree cannot be made.
pub fn replay(case: &Case, options: &StabilityOptions) -> Result<(String, bool), BenchError> {
    let all = sets()?;
    let Some(set) = all.iter().find(|set| set.name == case.set) else {
        return Err(BenchError::scene(case.set, "there is no such octree"));
    };
    let oracle = Oracle::new(&set.octree, 0);
    let ray = ray(case.kind, &Target::of(&set.octree, TARGETS), case.number);
    let root = set.octree.objects()[0].root_slot as u32;
    let hit = cast_ray(&set.octree, root, &ray, case.contours);
    let judged = oracle.judge(&ray, case.contours, &hit);
    let mut text = format!("{case}: {}\n\n", set.about);
    let vector = |v: glam::Vec3| format!("{:?} {:?} {:?}", v.x, v.y, v.z);
    let _ = writeln!(text, "origin     {}", vector(ray.origin));
    let _ = writeln!(text, "direction  {}", vector(ray.direction));
    let _ = writeln!(text, "t          {:?} to {:?}", ray.t_min, ray.t_max);
    let _ = writeln!(text, "size       {:?} + t * {:?}", ray.size_at_origin, ray.size_per_t);
    let found = |hit: &Hit| match hit.t() {
        None => format!("misses after {} iterations", hit.iterations),
        Some(t) => format!(
            "t = {t:?}, child {} of slot {}, level {}, {} iterations",
            hit.child(),
            hit.slot,
            hit.level(),
            hit.iterations
        ),
    };
    let _ = writeln!(text, "\nreference: {}", found(&hit));
    let mut right = judged.is_ok();
    let _ = match judged {
        Err(mistake) => writeln!(text, "WRONG: {mistake}"),
        Ok(judged) => writeln!(text, "right: the error of t is {:.3} of its bound", judged.error),
    };
    for mut engine in engines::open(options) {
        engine.load(&set.octree);
        // Alone, and among others of its kind, as casters take them together.
        let rays = vec![ray; 16];
        let cast = Rays { contours: case.contours, ..Rays::new(&set.octree, 0, &rays) };
        for rays in [&rays[..1], &rays] {
            engine.rays(&oracle, Rays { rays, ..cast }, &vec![hit; rays.len()], |_| case.to_string());
        }
        let row = &engine.row;
        let said = match (&row.error, &row.first) {
            (Some(error), _) => error.clone(),
            (None, Some(first)) => format!("WRONG: {first}"),
            (None, None) if row.different > 0 => "another hit, which is right within the bounds".into(),
            (None, None) => "the same".into(),
        };
        right &= row.wrong == 0;
        let _ = writeln!(text, "{}: {said}", row.name);
    }
    Ok((text, right))
}
