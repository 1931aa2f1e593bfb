//! What differs between two records, but for times.

use serde_json::Value;

use crate::system::machine::Machine;

/// Something that differs.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Difference {
    /// Where in the record: `scenes[SIBENIK].builds[levels 9, contours].bytes`.
    pub place: String,
    /// What the first record has; JSON.
    pub before: String,
    /// What the second record has.
    pub after: String,
}

/// Fields that depend on time or on the day, and what was asked for.
const PASSED_OVER: [&str; 23] = [
    "machine",
    "calibration",
    "guard",
    "samples",
    "seconds",
    "mesh_seconds",
    "build_seconds",
    "build_ms",
    "exact_ms",
    "voxelize_ms",
    "compact_ms",
    "host_ms",
    "rasterize_ms",
    "update_ms",
    "send_ms",
    "single_send_ms",
    "ms",
    "fill_seconds",
    "update_seconds",
    "peak_bytes",
    "mrays",
    "options",
    "all_on_software",
];

/// Fields that tell an element of a list from others, in the order in which they are printed.
const NAMES: [&str; 22] = [
    "name", "scene", "set", "what", "backend", "variant", "contours", "levels", "kind", "size", "objects", "edge",
    "wall", "tracer", "coarsest", "first", "effect", "voxel_cm", "step", "rays", "screen", "smoothed",
];

/// Characters of a value that are printed.
const MOST_CHARACTERS: usize = 60;

/// Where the machine and the software differ.
pub(super) fn software(before: &Machine, after: &Machine) -> Vec<Difference> {
    let fields = |machine: &Machine| {
        let Machine { cpu, threads, memory_mb, os, rustc, profile, commit, date: _ } = machine.clone();
        [
            ("processor", cpu),
            ("threads", threads.to_string()),
            ("memory in MiB", memory_mb.to_string()),
            ("system", os),
            ("compiler", rustc),
            ("profile", profile),
            ("commit", commit),
        ]
    };
    let both = fields(before).into_iter().zip(fields(after));
    let different = both.filter(|(before, after)| before.1 != after.1);
    different.map(|((place, before), (_, after))| Difference { place: place.into(), before, after }).collect()
}

/// Where results differ. Fields that only one record has are passed over: fields may be added within a version.
pub(super) fn results(before: &Value, after: &Value) -> Vec<Difference> {
    let mut found = Vec::new();
    walk("", before, after, &mut found);
    // A sweep's hash of a mesh has that of the builder's sources in it, and says nothing of the mesh alone.
    if before.get("plan").is_some() {
        found.retain(|difference| !difference.place.ends_with(".mesh_sha256"));
    }
    found
}

fn walk(place: &str, before: &Value, after: &Value, found: &mut Vec<Difference>) {
    match (before, after) {
        (Value::Object(a), Value::Object(b)) => {
            for (key, value) in a {
                if let Some(other) = b.get(key).filter(|_| !PASSED_OVER.contains(&key.as_str())) {
                    let place = if place.is_empty() { key.clone() } else { format!("{place}.{key}") };
                    walk(&place, value, other, found);
                }
            }
        }
        (Value::Array(a), Value::Array(b)) if a.len() == b.len() => {
            for (index, (value, other)) in a.iter().zip(b).enumerate() {
                walk(&format!("{place}[{}]", label(index, value)), value, other, found);
            }
        }
        (Value::Array(a), Value::Array(b)) => {
            let count = |list: &Vec<Value>| format!("{} entries", list.len());
            found.push(Difference { place: place.into(), before: count(a), after: count(b) });
        }
        _ if before == after => {}
        _ => found.push(Difference { place: place.into(), before: short(before), after: short(after) }),
    }
}

/// What an element of a list is called.
fn label(index: usize, value: &Value) -> String {
    let name = |key: &&str| match value.get(*key)? {
        Value::String(text) => Some(text.clone()),
        Value::Bool(true) => Some((*key).to_string()),
        Value::Number(number) => Some(format!("{key} {number}")),
        Value::Array(list) if *key == "size" => Some(list.iter().map(Value::to_string).collect::<Vec<_>>().join("x")),
        _ => None,
    };
    let names: Vec<_> = NAMES.iter().filter_map(name).collect();
    if names.is_empty() { index.to_string() } else { names.join(", ") }
}

fn short(value: &Value) -> String {
    let text = value.to_string();
    if text.chars().count() <= MOST_CHARACTERS {
        return text;
    }
    text.chars().take(MOST_CHARACTERS).chain("...".chars()).collect()
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn results_are_compared_and_times_are_not() {
        let before = json!({
            "seconds": 1.0,
            "scenes": [{
                "name": "SIBENIK",
                "builds": [{"levels": 9, "contours": true, "bytes": 10, "seconds": 2.0}],
                "views": [[1, 2], [3]],
            }],
        });
        assert_eq!(results(&before, &before), []);
        let mut after = before.clone();
        after["seconds"] = json!(9.0);
        after["scenes"][0]["builds"][0]["seconds"] = json!(3.0);
        after["scenes"][0]["new"] = json!(1);
        assert_eq!(results(&before, &after), []);
        after["scenes"][0]["builds"][0]["bytes"] = json!(11);
        after["scenes"][0]["views"] = json!([[1, 4], [3, 5]]);
        let found = results(&before, &after);
        let places: Vec<_> = found.iter().map(|d| format!("{} {} {}", d.place, d.before, d.after)).collect();
        assert_eq!(
            places,
            [
                "scenes[SIBENIK].builds[contours, levels 9].bytes 10 11",
                "scenes[SIBENIK].views[0][1] 2 4",
                "scenes[SIBENIK].views[1] 1 entries 2 entries",
            ]
        );
    }

    #[test]
    fn times_of_voxelization_are_passed_over_and_its_counts_are_not() {
        let row = |ms: f64, holes: u64| json!({"name": "compute", "voxelize_ms": [ms], "compact_ms": [ms], "host_ms": [ms], "holes": holes});
        let grid =
            |ms: f64, holes: u64| json!({"grids": [{"exact_ms": [ms], "build_ms": ms, "methods": [row(ms, holes)]}]});
        assert_eq!(results(&grid(1.0, 0), &grid(2.5, 0)), []);
        assert_eq!(results(&grid(1.0, 0), &grid(2.5, 3))[0].place, "grids[0].methods[compute].holes");
    }

    #[test]
    fn times_of_bit_volumes_are_passed_over_and_their_counts_are_not() {
        let record = |time: f64, leaks: u64, right: bool, different: u64, steps: f64| {
            json!({
                "world": {"voxels": [160, 160, 160], "fill_seconds": time, "update_seconds": time, "peak_bytes": (1e6 * time) as u64},
                "moving": [{"objects": 200, "edge": 8, "rasterize_ms": time, "update_ms": time, "send_ms": time, "single_send_ms": time, "as_if_from_nothing": right}],
                "leaks": [{"wall": "faces", "step": 0.5, "leaks": leaks}],
                "scenes": [{
                    "name": "FLOOR",
                    "volumes": [{"voxel_cm": 20.0, "fill_seconds": time}],
                    "rates": [{"kind": "shadow", "tracer": "every voxel", "coarsest": 8, "first": true, "seconds": [time], "steps": steps, "different": different}],
                    "errors": [{"effect": "fog", "voxel_cm": 20.0, "smoothed": true, "ms": [time]}],
                }],
                "seconds": time,
            })
        };
        let before = record(1.0, 0, true, 0, 1.5);
        assert_eq!(results(&before, &record(2.5, 0, true, 0, 1.5)), []);
        let found = results(&before, &record(2.5, 1, false, 2, 1.75));
        let places: Vec<_> = found.iter().map(|difference| &difference.place[..]).collect();
        assert_eq!(
            places,
            [
                "leaks[faces, step 0.5].leaks",
                "moving[objects 200, edge 8].as_if_from_nothing",
                "scenes[FLOOR].rates[shadow, every voxel, coarsest 8, first].different",
                "scenes[FLOOR].rates[shadow, every voxel, coarsest 8, first].steps",
            ]
        );
    }

    #[test]
    fn another_mesh_is_told_where_its_hash_is_of_the_mesh_alone() {
        let tables = |hash: &str| json!({"matrix": {}, "scenes": [{"name": "SIBENIK", "mesh_sha256": hash}]});
        assert_eq!(results(&tables("1"), &tables("2"))[0].place, "scenes[SIBENIK].mesh_sha256");
        let sweep = |hash: &str| json!({"plan": {}, "scenes": [{"name": "SIBENIK", "mesh_sha256": hash}]});
        assert_eq!(results(&sweep("1"), &sweep("2")), []);
    }

    #[test]
    fn a_new_compiler_is_told() {
        let before = Machine::detect();
        assert_eq!(software(&before, &before), []);
        let found = software(&before, &Machine { rustc: "other".into(), ..before.clone() });
        assert!(found.len() == 1 && found[0].place == "compiler" && found[0].after == "other");
    }
}
