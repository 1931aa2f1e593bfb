//! Time of the pieces of reading, writing and casting octrees, each per unit of its work.
//!
//! `cargo bench -p esvo-cpu --bench pieces`; `bench-harness/instructions.sh` counts the instructions of the same pieces.
//! A push of a packet takes an eighth of the difference between packets to 16 and to 8 levels.

mod work;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};

fn pieces(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("pieces");
    for mut piece in work::pieces().expect("the octrees are built") {
        group.throughput(Throughput::Elements((piece.work)()));
        let name = format!("{}, per {}", piece.name, piece.unit);
        group.bench_function(BenchmarkId::from_parameter(name), |bencher| bencher.iter(&mut piece.work));
    }
    group.finish();
}

criterion_group!(benches, pieces);
criterion_main!(benches);
