//! Time to encode a block of sixteen colours or normals, for different contents.
//!
//! `cargo bench -p esvo-format --bench encoders`

#[path = "../tests/encoders/blocks.rs"]
#[allow(dead_code, reason = "the tests use more of it")]
mod blocks;

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use esvo_format::{ColorBlock, NormalBlock, RawNormal};

const BLOCKS: usize = 1000;

fn encoders(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("colors");
    for (name, blocks) in blocks::color_sets(BLOCKS) {
        group.throughput(Throughput::Elements(BLOCKS as u64));
        group.bench_function(BenchmarkId::from_parameter(name), |bencher| {
            bencher.iter(|| black_box(&blocks).iter().fold(0, |sum, block| sum ^ ColorBlock::encode(block).indices));
        });
    }
    group.finish();
    let mut group = criterion.benchmark_group("normals");
    let sets = blocks::normal_sets(BLOCKS);
    for (name, blocks) in &sets {
        group.throughput(Throughput::Elements(BLOCKS as u64));
        group.bench_function(BenchmarkId::from_parameter(name), |bencher| {
            bencher.iter(|| black_box(blocks).iter().fold(0, |sum, block| sum ^ NormalBlock::encode(block).u_indices));
        });
    }
    group.finish();
    let normals: Vec<_> = sets.iter().flat_map(|(_, blocks)| blocks).flatten().flatten().copied().collect();
    let mut group = criterion.benchmark_group("raw normals");
    group.throughput(Throughput::Elements(normals.len() as u64));
    group.bench_function("any", |bencher| {
        bencher.iter(|| black_box(&normals).iter().fold(0, |sum, normal| sum ^ RawNormal::encode(*normal).0));
    });
    group.finish();
}

criterion_group!(benches, encoders);
criterion_main!(benches);
