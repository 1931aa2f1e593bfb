//! The records of the benchmarks against their JSON Schemas, `schemas/<name>.v<version>.json`: stored records, and small ones made anew. The
//! record of `esvo bench build`, which starts the program, is made in `cli/tests/schemas.rs`.

mod common;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use esvo_bench::compare::{Measured, compare};
use esvo_bench::format_bench::{FormatBenchOptions, run_format_bench};
use esvo_bench::matrix_parts::LeftOut;
use esvo_bench::needs_bench::{NeedsBenchOptions, run_needs_bench};
use esvo_bench::paper_bench::slowed::Slowed;
use esvo_bench::paper_bench::{PaperBenchOptions, run_paper_bench};
use esvo_bench::ray_bench::{RayBenchOptions, run_ray_bench};
use esvo_bench::records::{Record, read_record};
use esvo_bench::serve_bench::{ServeReport, ServeRow, ServedFile};
use esvo_bench::shadow_bench::{ShadowOptions, run_shadow_bench, write_shadow_record};
use esvo_bench::stability_bench::{StabilityOptions, run_stability_bench};
use esvo_bench::sweep_bench::{Cache, SweepBenchOptions, SweepPlan, run_sweep_bench};
use esvo_bench::system::machine::Machine;
use esvo_bench::voxel_bench::{
    CurvePoint, Grid, MethodRow, PictureGroup, SceneVoxels, VoxelBenchOptions, VoxelReport, to_text,
};
use esvo_bench::{Matrix, PaperReport, Progress};
use esvo_core::{Device, DeviceKind};
use esvo_engines::EngineId;
use jsonschema::Validator;
use serde_json::{Value, json};

/// Names of the schemas, and fields by which records are known.
const RECORDS: [(&str, &[&str]); 10] = [
    ("shadow", &["moving", "world"]),
    ("voxelize", &["curve", "device"]),
    ("stability", &["controls", "leaks"]),
    ("sweep", &["plan"]),
    ("rays", &["sets", "view"]),
    ("needs", &["cases"]),
    ("tables", &["matrix", "devices"]),
    ("format", &["storage"]),
    ("serve", &["served"]),
    ("build", &["matrix"]),
];

/// Counts that may be negative.
const SIGNED: [&str; 1] = ["/storage/*/zstd"];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn read(path: &Path) -> Value {
    let text = std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    serde_json::from_str(&text).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

struct Schema {
    text: Value,
    validator: Validator,
}

impl Schema {
    fn of(name: &str) -> Self {
        let text = read(&root().join(format!("schemas/{name}.v1.json")));
        let validator = jsonschema::draft202012::new(&text).unwrap_or_else(|e| panic!("{name}: {e}"));
        Self { text, validator }
    }

    /// What is wrong with a record: place and words.
    fn errors(&self, record: &Value) -> Vec<(String, String)> {
        self.validator.iter_errors(record).map(|e| (e.instance_path().to_string(), e.to_string())).collect()
    }

    fn accepts(&self, record: &Value, name: &str) {
        let errors = self.errors(record);
        assert!(errors.is_empty(), "{name}: {:#?}", &errors[..errors.len().min(10)]);
    }

    /// The fields that the schema has, as paths of [`fields`].
    fn fields(&self) -> BTreeSet<String> {
        let mut found = BTreeSet::new();
        self.collect(&self.text, "", &mut found);
        found
    }

    fn collect(&self, node: &Value, path: &str, found: &mut BTreeSet<String>) {
        if let Some(reference) = node["$ref"].as_str() {
            self.collect(self.text.pointer(reference.trim_start_matches('#')).unwrap(), path, found);
        }
        for (key, property) in node["properties"].as_object().into_iter().flatten() {
            found.insert(format!("{path}/{key}"));
            self.collect(property, &format!("{path}/{key}"), found);
        }
        if node["items"].is_object() {
            self.collect(&node["items"], &format!("{path}/*"), found);
        }
    }
}

/// The first place of every field and item of a record that is not null there, by its path with `*` for indices. Null places count if
/// there is no other.
fn places(value: &Value, place: &str, path: &str, found: &mut BTreeMap<String, (String, Value)>) {
    if found.get(path).is_none_or(|(_, known)| known.is_null()) {
        found.insert(path.into(), (place.into(), value.clone()));
    }
    match value {
        Value::Object(fields) => {
            for (key, value) in fields {
                places(value, &format!("{place}/{key}"), &format!("{path}/{key}"), found);
            }
        }
        Value::Array(items) => {
            for (index, value) in items.iter().enumerate() {
                places(value, &format!("{place}/{index}"), &format!("{path}/*"), found);
            }
        }
        _ => {}
    }
}

/// Holds a schema to a record that has every field: it is accepted, the schema has no other fields, and whatever is changed is refused where
/// it stands. What may be absent must be what `optional` says: the last two names of its paths.
fn holds(name: &str, record: &Value, optional: &[&str]) {
    let schema = Schema::of(name);
    schema.accepts(record, name);
    let mut all = BTreeMap::new();
    places(record, "", "", &mut all);
    let is_field = |path: &&String| !path.is_empty() && !path.ends_with('*');
    let written: BTreeSet<String> = all.keys().filter(is_field).cloned().collect();
    let differ: Vec<_> = written.symmetric_difference(&schema.fields()).cloned().collect();
    assert!(differ.is_empty(), "{name}, only written or only in the schema: {differ:?}");

    let refused = |change: &str, record: &Value, place: &str| {
        let errors = schema.errors(record);
        assert!(errors.iter().any(|(at, _)| at == place), "{name}, {change} at {place}: {errors:?}");
        errors
    };
    let mut absent = BTreeSet::new();
    for (path, (place, value)) in &all {
        let changed = |place: &str, change: &dyn Fn(&mut Value)| {
            let mut record = record.clone();
            change(record.pointer_mut(place).unwrap());
            record
        };
        if let Some((parent, key)) = place.rsplit_once('/').filter(|_| is_field(&path)) {
            let without = changed(parent, &|object| drop(object.as_object_mut().unwrap().remove(key)));
            if schema.errors(&without).is_empty() {
                let names: Vec<_> = path.split('/').filter(|name| *name != "*").collect();
                absent.insert(names[names.len() - 2..].join("/"));
            } else {
                let errors = refused("a field is removed", &without, parent);
                assert!(errors.iter().any(|(_, what)| what.contains(key)), "{name}, {path} is removed: {errors:?}");
            }
        }
        if value.is_object() {
            let more = changed(place, &|object| object["unheard_of"] = json!(1));
            let errors = refused("an unknown field", &more, place);
            assert!(errors.iter().any(|(_, what)| what.contains("unheard_of")), "{name}, {path}: {errors:?}");
        }
        if value.is_number() {
            refused("a text for a number", &changed(place, &|number| *number = json!(number.to_string())), place);
        }
        if value.is_u64() && !SIGNED.contains(&path.as_str()) {
            refused("a negative count", &changed(place, &|count| *count = json!(-1)), place);
        }
        if value.is_string() {
            refused("a number for a text", &changed(place, &|text| *text = json!(1)), place);
        }
    }
    assert_eq!(absent, optional.iter().map(ToString::to_string).collect(), "{name}");
}

fn left_out() -> LeftOut {
    LeftOut { what: "SIBENIK-D".into(), reason: "it is displaced at each level".into() }
}

fn parse(json: &str) -> Value {
    serde_json::from_str(json).unwrap()
}

#[test]
fn schemas_are_schemas_and_describe_every_field() {
    fn described(node: &Value, place: &str) {
        if let Value::Object(fields) = node {
            if fields.contains_key("properties") && place != "/properties" {
                assert_eq!(node["additionalProperties"], false, "{place}");
                for (key, property) in node["properties"].as_object().unwrap() {
                    assert!(property["description"].as_str().is_some_and(|text| text.ends_with('.')), "{place}/{key}");
                }
            }
            fields.iter().for_each(|(key, value)| described(value, &format!("{place}/{key}")));
        }
    }
    let mut names = BTreeSet::new();
    for file in std::fs::read_dir(root().join("schemas")).unwrap() {
        let path = file.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap().to_owned();
        let schema = read(&path);
        jsonschema::meta::validate(&schema).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_eq!(schema["$id"], name.as_str());
        assert_eq!(
            name,
            format!("{}.v{}.json", name.split('.').next().unwrap(), schema["properties"]["schema"]["const"])
        );
        described(&schema, &name);
        names.insert(name);
    }
    let expected = RECORDS.map(|(name, _)| name).into_iter().chain(["compare"]);
    assert_eq!(names, expected.map(|name| format!("{name}.v1.json")).collect());
}

#[test]
fn every_stored_record_is_as_its_schema_says() {
    fn json_files(folder: &Path, files: &mut Vec<PathBuf>) {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                json_files(&path, files);
            } else if path.extension().is_some_and(|e| e == "json") {
                files.push(path);
            }
        }
    }
    let mut files = Vec::new();
    json_files(&root().join("../results"), &mut files);
    json_files(&root().join("tests/data"), &mut files);
    let mut seen = BTreeSet::new();
    for path in files {
        let record = read(&path);
        if record.get("machine").is_none() || record["schema"] != 1 {
            continue;
        }
        let known = RECORDS.iter().find(|(_, fields)| fields.iter().all(|field| record.get(field).is_some()));
        let (name, _) = known.unwrap_or_else(|| panic!("{}: of which benchmark?", path.display()));
        Schema::of(name).accepts(&record, &path.display().to_string());
        seen.insert(*name);
    }
    assert_eq!(seen.len(), RECORDS.len(), "a benchmark has no stored record: {seen:?}");
}

#[test]
fn tables() {
    let mut matrix = Matrix::default_run();
    // The stand-in, wherever this runs.
    matrix.select_scenes(&["fairy".into()]);
    matrix.scenes[0].levels = vec![4];
    (matrix.views, matrix.rounds, matrix.warm_up) = (1, 1, 0);
    matrix.time_limit_seconds = Some(600.0);
    matrix.resolutions = vec![[24, 18]];
    matrix.backends = vec![EngineId::Cpu];
    matrix.left_out = vec![left_out()];
    let slowed = vec![Slowed { engine: EngineId::Cpu, percent: 1.0 }];
    let options = PaperBenchOptions { threads: Some(1), slowed, ..PaperBenchOptions::new(matrix) };
    let mut report = run_paper_bench(&options, &Progress::hidden()).unwrap().report;
    Schema::of("tables").accepts(&parse(&report.to_json()), "as it was made");
    // What only displaced meshes and GPUs have.
    report.scenes[0].builds[0].displaced_triangles = Some(12);
    report.scenes[0].checks[0].undecided = Some(0);
    report.scenes[0].checks[0].error = Some("lost".into());
    let record = parse(&report.to_json());
    let optional = [
        "/calibration",
        "/slowed",
        "builds/displaced_triangles",
        "builds/image_sha256",
        "checks/error",
        "checks/undecided",
        "errors/hit_levels",
        "errors/pictures",
        "guard/calibration_cpu_seconds",
        "guard/cpu_seconds",
        "matrix/left_out",
        "matrix/time_limit_seconds",
        "samples/coarse_seconds",
        "samples/guard",
        "scenes/filters",
        "scenes/mesh_sha256",
        "views/hit_voxels",
    ];
    holds("tables", &record, &optional);
    Schema::of("tables").accepts(&parse(&common::fake_report().to_json()), "made up");
}

#[test]
fn sweep() {
    let mut plan = SweepPlan::default_run();
    plan.select_scenes(&["fairy".into()]);
    plan.set_levels(&[4]);
    (plan.size, plan.views, plan.rounds, plan.warm_up) = ([24, 18], 1, 1, 0);
    plan.terminations = vec![1.0];
    plan.engines = vec![EngineId::Cpu];
    let cache = Cache::none();
    let options = SweepBenchOptions {
        plan,
        scenes_dir: None,
        manifest: None,
        threads: Some(1),
        all_on_software: true,
        cache,
        views: Vec::new(),
    };
    let mut report = run_sweep_bench(&options, &Progress::hidden()).unwrap();
    report.left_out.push(left_out());
    let optional =
        ["/all_on_software", "/calibration", "cells/guard", "guard/calibration_cpu_seconds", "guard/cpu_seconds"];
    holds("sweep", &parse(&report.to_json()), &optional);
}

/// A record that is made up: one that is measured needs a GPU.
#[test]
fn voxelize() {
    let methods = ["a", "g"].map(|letter| MethodRow {
        letter: letter.into(),
        name: "a method".into(),
        tested: letter == "g",
        voxels: 10,
        cracks: 1,
        holes: 2,
        extra: 3,
        beyond_bound: 0,
        undecided: 4,
        fragments: 20,
        voxelize_ms: vec![1.5, 1.25],
        compact_ms: vec![0.5, 0.25],
        host_ms: vec![0.125, 0.0625],
        bytes: 1 << 20,
        tiles: 3,
        tiles_of_grid: 8,
    });
    let grid =
        Grid { level: 8, voxels: 12, exact_ms: vec![2.5], build_ms: 4.5, mean_edge: 3.5, methods: methods.to_vec() };
    let text = |text: &str| text.to_owned();
    let scene = SceneVoxels {
        name: text("FLOOR"),
        identity: text("generated"),
        credit: text("generated"),
        triangles: 7,
        grids: vec![grid],
    };
    let point = CurvePoint { edge: 2.5, letter: text("b"), voxels: 100, missing: 9, holes: 4 };
    let options = VoxelBenchOptions {
        device: Some(text("llvmpipe")),
        methods: vec![text("a"), text("g")],
        time_limit_seconds: Some(60.0),
        left_out: vec![left_out()],
        ..VoxelBenchOptions::default()
    };
    let report = VoxelReport {
        schema: esvo_bench::voxel_bench::SCHEMA,
        machine: Machine::detect(),
        options,
        device: Device { name: text("llvmpipe"), kind: DeviceKind::SoftwareGpu, detail: text("wgpu") },
        left_out: vec![left_out()],
        scenes: vec![scene],
        curve: vec![point],
        pictures: vec![PictureGroup {
            what: text("Needles"),
            credit: text("generated"),
            files: vec![text("voxels-needles-compute.png")],
        }],
        seconds: 1.5,
    };
    // Method g of this record misses voxels, and the exact one would not.
    assert!(!report.passed());
    let mut good = report.clone();
    let row = &mut good.scenes[0].grids[0].methods[1];
    (row.cracks, row.holes, row.extra) = (0, 0, 0);
    assert!(good.passed());
    good.scenes[0].grids[0].methods[1].beyond_bound = 1;
    assert!(!good.passed());
    holds("voxelize", &parse(&report.to_json()), &["options/device", "options/left_out", "options/time_limit_seconds"]);
    insta::assert_snapshot!("voxelize", to_text(&report).lines().skip(3).collect::<Vec<_>>().join("\n"));
}

/// A small one, measured.
#[test]
fn shadow() {
    let options = ShadowOptions {
        scenes: vec!["fairy".into()],
        voxels_cm: vec![20.0],
        rays: vec![1],
        size: (24, 16),
        levels: 6,
        converged: 4,
        rounds: 1,
        leak_rays: 3000,
        world: [160, 160, 160],
        picture: (40, 30),
        pictures: true,
        scenes_dir: None,
    };
    let outcome = run_shadow_bench(&options, &Progress::hidden()).unwrap();
    let report = &outcome.report;
    assert!(report.passed());
    let mut leaking = report.clone();
    leaking.leaks[0].leaks = 1;
    assert!(!leaking.passed());
    let mut tight = report.clone();
    tight.leaks.iter_mut().for_each(|row| row.leaks = 0);
    assert!(!tight.passed(), "without leaks of long steps nothing shows that leaks would be seen");
    let mut wrong = report.clone();
    wrong.moving[0].as_if_from_nothing = false;
    assert!(!wrong.passed());
    let mut another = report.clone();
    another.picture.as_mut().unwrap().rows[0].different = 0.5;
    assert!(!another.passed());
    let mut other = report.clone();
    other.scenes[0].rates.iter_mut().find(|row| row.tracer.starts_with("every voxel")).unwrap().different = 1;
    assert!(!other.passed(), "a ray with another answer");
    assert_eq!(report.pictures.len(), outcome.pictures.len());
    let folder = tempfile::tempdir().unwrap();
    let made = write_shadow_record(&outcome, folder.path(), Some("m")).unwrap();
    match read_record(&made.join("report.json")).unwrap() {
        Some(Record::Shadow(read)) => assert_eq!(*read, *report),
        other => panic!("{other:?}"),
    }
    let mut value = parse(&report.to_json());
    value["left_out"] = json!([left_out()]);
    // On a machine without a device nothing is sent to it.
    for row in value["moving"].as_array_mut().unwrap() {
        row["send_ms"] = json!(1.5);
        row["single_send_ms"] = json!(2.5);
    }
    let optional =
        ["leaks/step", "errors/step", "moving/send_ms", "moving/single_send_ms", "/picture", "options/picture"];
    holds("shadow", &value, &optional);
}

#[test]
fn rays() {
    let options = RayBenchOptions {
        scene: "fairy".into(),
        levels: 4,
        size: [24, 16],
        rays: 100,
        seconds: 0.0,
        engines: vec![EngineId::Cpu],
        threads: Some(1),
        ..RayBenchOptions::default()
    };
    let report = run_ray_bench(&options, &Progress::hidden()).unwrap();
    let optional = [
        "/calibration",
        "/image_sha256",
        "/options",
        "cells/guard",
        "guard/calibration_cpu_seconds",
        "guard/cpu_seconds",
        "options/threads",
    ];
    let mut record = parse(&report.to_json());
    Schema::of("rays").accepts(&record, "as it was made");
    record["engines"][0]["error"] = json!("lost");
    holds("rays", &record, &optional);
    // An engine that could not be opened.
    record["engines"][0]["device"] = Value::Null;
    record["engines"][0]["cells"] = json!([]);
    Schema::of("rays").accepts(&record, "without a device");
}

#[test]
fn needs() {
    let options = NeedsBenchOptions {
        scenes: vec!["fairy".into()],
        levels: vec![4],
        size: [24, 16],
        views: 1,
        rounds: 1,
        threads: Some(1),
        ..NeedsBenchOptions::default()
    };
    let mut report = run_needs_bench(&options, &Progress::hidden()).unwrap();
    report.left_out.push(left_out());
    let optional = [
        "/calibration",
        "/left_out",
        "/options",
        "cases/image_sha256",
        "cases/unread",
        "cases/upload_bytes",
        "cells/guard",
        "guard/calibration_cpu_seconds",
        "guard/cpu_seconds",
        "options/threads",
    ];
    holds("needs", &parse(&report.to_json()), &optional);
}

#[test]
fn stability() {
    let options = StabilityOptions {
        rays: 2000,
        gpu_rays: 1,
        mesh_rays: 20,
        engines: vec![EngineId::Cpu],
        ..StabilityOptions::default()
    };
    let report = run_stability_bench(&options, &Progress::hidden()).unwrap();
    let mut record = parse(&report.to_json());
    Schema::of("stability").accepts(&record, "as it was made");
    // What only failures have.
    record["cells"][0]["failure"] = json!("another voxel");
    record["engines"][0]["first"] = json!("sparse/far/cubes#575");
    record["engines"][0]["error"] = json!("lost");
    // One item of each list is enough to be changed.
    for list in ["sets", "cells", "symmetries", "engines", "meshes", "controls"] {
        record[list].as_array_mut().unwrap().truncate(1);
    }
    holds("stability", &record, &["/options"]);
}

#[test]
fn format() {
    let options =
        FormatBenchOptions { large_bytes: 1 << 20, levels: 4, block_slots: 256, seconds: 0.0, files: Vec::new() };
    let report = run_format_bench(&options, &Progress::hidden()).unwrap();
    // Absent in rows of blocks that are not in parts.
    holds("format", &parse(&report.to_json()), &["storage/parts"]);
}

/// A record that is made up: one that is measured needs the feature `remote`.
#[test]
fn serve() {
    let row = |what: &str, different: Option<u64>| ServeRow {
        what: what.into(),
        bytes: 32_768,
        requests: Some(1),
        seconds: Some(0.25),
        octree_bytes: different.map(|_| 8192),
        different,
        control: different.map(|_| 9),
    };
    let file = ServedFile {
        name: "a.esvo".into(),
        stored: "parts by level".into(),
        file_bytes: 1 << 20,
        head_bytes: 16_000,
        levels: 9,
        voxels: 100_000,
        rows: vec![row("opened", None), row("16 px", Some(0))],
    };
    let report = ServeReport {
        schema: esvo_bench::serve_bench::SCHEMA,
        machine: Machine::detect(),
        delay_ms: 50,
        mbit: 50.0,
        camera: "Camera nave-east of SIBENIK".into(),
        size: [1024, 768],
        served: vec![file],
        seconds: 1.5,
    };
    assert!(report.passed());
    let with = |change: fn(&mut ServeRow)| {
        let mut report = report.clone();
        change(&mut report.served[0].rows[1]);
        report
    };
    assert!(!with(|row| row.different = Some(1)).passed());
    assert!(!with(|row| row.control = Some(0)).passed(), "nothing shows that a difference would be seen");
    holds("serve", &parse(&report.to_json()), &[]);
    let text = esvo_bench::serve_bench::to_text(&report);
    assert!(text.contains("0.03 / 1 / 0.25"), "{text}");
}

#[test]
fn build() {
    let mut record = read(&root().join("../results/amd-epyc-2-threads/2026-11-23-build/build.json"));
    record["matrix"]["time_limit_seconds"] = json!(600.0);
    for place in ["/left_out", "/matrix/left_out"] {
        *record.pointer_mut(place).unwrap() = serde_json::to_value([left_out()]).unwrap();
    }
    let stopped = json!([{ "contours": "off", "levels": 12, "limit": "memory", "why": "it takes 20 GB" }]);
    record["scenes"][0]["stopped"] = stopped;
    // What records have since 2026-11-27.
    let row = &mut record["scenes"][0]["rows"][0];
    let errors = json!({
        "both_hit": 100, "elsewhere": 2, "normals": row["error"]["pixels"], "colors": row["error"]["pixels"],
    });
    (row["attributes"], row["attributes_at_pixel"]) = (errors.clone(), errors);
    row["flip_at_pixel"] = json!(0.08);
    row["samples"][0]["cpu_seconds"] = json!(3.5);
    row["beside"] = json!({ "voxels": 10, "image_bytes": 80, "samples": row["samples"] });
    record["beside"] = json!({ "commit": "357f17512345" });
    let optional = [
        "/beside",
        "/complete",
        "error/hit_voxels",
        "error_at_pixel/hit_voxels",
        "matrix/left_out",
        "matrix/time_limit_seconds",
        "rows/attributes",
        "rows/attributes_at_pixel",
        "rows/beside",
        "rows/flip_at_pixel",
        "samples/cpu_seconds",
        "saved/measure",
        "scenes/stopped",
    ];
    holds("build", &record, &optional);
}

#[test]
fn comparisons() {
    let run = |name: &str| {
        let text = std::fs::read_to_string(root().join(format!("tests/data/guard-{name}.json"))).unwrap();
        PaperReport::from_json(&text).unwrap()
    };
    let (before, after) = (run("before"), run("slowed"));
    let report =
        |after: &PaperReport| parse(&compare(&before.measured(), &after.measured(), ["a", "b"], 5.0).to_json());
    let record = report(&after);
    holds("compare", &record, &[]);
    // Fields of times are all there or all absent.
    let mut other = after;
    other.machine.cpu = "another".into();
    let record = report(&other);
    assert_eq!(record["cells"][0]["verdict"], "incomparable");
    Schema::of("compare").accepts(&record, "not comparable");
}
