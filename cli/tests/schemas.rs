//! What the program writes as JSON against the schemas in `bench-harness/schemas/`, where the program is needed to make it.

mod common;

use std::path::Path;

use common::{BOX, Folder};
use serde_json::{Value, json};

fn schema(name: &str) -> Value {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../bench-harness/schemas/{name}.v1.json"));
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// Places and words of what is wrong.
fn errors(schema: &Value, record: &Value) -> Vec<String> {
    let validator = jsonschema::draft202012::new(schema).unwrap();
    validator.iter_errors(record).map(|e| format!("{}: {e}", e.instance_path())).collect()
}

#[test]
fn builds_are_recorded_as_the_schema_says() {
    let folder = Folder::new();
    std::fs::create_dir(folder.path("sibenik")).unwrap();
    folder.put("sibenik/sibenik.obj", BOX);
    let bench = "bench build --scenes sibenik --levels 3,4 --scenes-dir . --repeats 2 --out out";
    let mut bench: Vec<_> = bench.split(' ').collect();
    bench.extend(["--beside", env!("CARGO_BIN_EXE_esvo")]);
    folder.ok(&bench);
    let text = std::fs::read_to_string(folder.path("out/build.json")).unwrap();
    let mut record: Value = serde_json::from_str(&text).unwrap();
    let mut schema = schema("build");
    assert_eq!(errors(&schema, &record), [""; 0]);
    assert_eq!(record["scenes"][0]["rows"].as_array().unwrap().len(), 4);
    for row in record["scenes"][0]["rows"].as_array().unwrap() {
        let beside = &row["beside"];
        assert_eq!(
            [&beside["voxels"], &beside["image_bytes"]],
            [&row["build"]["voxels"], &row["build"]["image_bytes"]]
        );
        for samples in [&row["samples"], &beside["samples"]] {
            let cpu = |sample: &Value| sample["cpu_seconds"].as_f64().is_some_and(|seconds| seconds > 0.0);
            assert_eq!(samples.as_array().unwrap().len(), 2);
            assert!(!cfg!(unix) || samples.as_array().unwrap().iter().all(cpu), "{samples}");
        }
    }

    // The negative control.
    record["scenes"][0]["rows"][3]["build"]["voxels"] = json!(-1);
    let errors_now = errors(&schema, &record);
    assert!(errors_now.len() == 1 && errors_now[0].starts_with("/scenes/0/rows/3/build/voxels: "), "{errors_now:?}");

    // `esvo build --json` prints a part of it.
    let built = folder.ok(&["build", "sibenik/sibenik.obj", "-o", "box.esvo", "--levels", "3", "--json"]);
    for keyword in ["type", "required", "properties", "additionalProperties"] {
        schema.as_object_mut().unwrap().remove(keyword);
    }
    schema["$ref"] = json!("#/$defs/summaryOfBuild");
    assert_eq!(errors(&schema, &serde_json::from_str(&built).unwrap()), [""; 0]);
    assert!(!errors(&schema, &record).is_empty());
}

#[test]
fn comparisons_are_printed_as_the_schema_says() {
    let folder = Folder::new();
    let bench =
        "bench rays --scene fairy --levels 4 --size 16x16 --rays 10 --seconds 0 --backends cpu --out out --machine m";
    folder.ok(&bench.split(' ').collect::<Vec<_>>());
    let run = std::fs::read_dir(folder.path("out/m")).unwrap().next().unwrap().unwrap().path().join("report.json");
    let run = run.to_str().unwrap();
    let record: Value = serde_json::from_str(&folder.ok(&["bench", "compare", run, run, "--json"])).unwrap();
    assert_eq!(errors(&schema("compare"), &record), [""; 0]);
    assert!(record["cells"].as_array().unwrap().iter().any(|cell| cell["verdict"] == "same"), "{record}");
    let text = json!(record.to_string());
    assert!(!errors(&schema("compare"), &text).is_empty());
}
