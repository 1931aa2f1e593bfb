// Traces a list of rays. Follows trace.wgsl.

/// What became of a ray; src/gpu/tracer.rs has the same struct.
struct Answer {
    cell: vec3<i32>,
    level: u32,
    numerator: i32,
    denominator: i32,
    looks: u32,
    is_hit: u32,
}

@group(1) @binding(0) var<uniform> fidelity: Fidelity;
@group(1) @binding(1) var<storage, read> rays: array<Ray>;
@group(1) @binding(2) var<storage, read_write> answers: array<Answer>;
@group(1) @binding(3) var<storage, read> steps: array<Steps>;

fn store(index: u32, hit: Hit) {
    answers[index] = Answer(hit.cell, hit.level, hit.numerator, hit.denominator, looks, hit.is_hit);
}

@compute @workgroup_size(64)
fn trace_rays(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < arrayLength(&rays) {
        store(id.x, walk_first(rays[id.x], fidelity));
    }
}

@compute @workgroup_size(64)
fn trace_steps(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < arrayLength(&rays) {
        store(id.x, steps_first(rays[id.x], steps[id.x], fidelity));
    }
}
