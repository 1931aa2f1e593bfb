//! How fast one thread reads the blocks of files: bytes of the image for each second of processor time, the best of some rounds.
//!
//! `cargo run --release -p esvo-format --example read_blocks -- ROUNDS FILE...`
//!
//! Each file is read into memory first. To compare two builds, run them in turns. Where the system does not tell the processor
//! time of a thread, the time of the clock counts.

use std::error::Error;
use std::hint::black_box;
use std::time::Instant;

use esvo_format::StreamReader;

/// Seconds that this thread has run, or that have passed since `start`.
fn now(start: Instant) -> f64 {
    let stat = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
    let nanoseconds = stat.as_deref().and_then(|stat| stat.split(' ').next()?.parse::<f64>().ok());
    nanoseconds.map_or_else(|| start.elapsed().as_secs_f64(), |time| time * 1e-9)
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (rounds, files) = arguments.split_first().ok_or("expected the number of rounds, and files")?;
    let (rounds, start): (u32, _) = (rounds.parse()?, Instant::now());
    for path in files {
        let bytes = std::fs::read(path)?;
        let reader = StreamReader::open(&bytes)?;
        let image: u64 = reader.blocks().iter().map(|block| block.image_size).sum();
        let mut best = f64::INFINITY;
        for _ in 0..rounds.max(1) {
            let before = now(start);
            for index in 0..reader.blocks().len() as u32 {
                black_box(reader.read_block(index)?);
            }
            best = best.min(now(start) - before);
        }
        println!("{path}: {:.0} MB/s, {} bytes for an image of {image}", image as f64 / best / 1e6, bytes.len());
    }
    Ok(())
}
