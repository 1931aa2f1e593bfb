//! Measures the format on one core: opening a large file and reading one block of it, validating, compressing.
//!
//! ```text
//! cargo run --release -p esvo-format --example format_bench -- FILE.esvo [MEGABYTES [FILE.esvo...]] > format-benchmark.md
//! ```
//!
//! The large file, of a thousand megabytes if nothing is said, is made of copies of the first as objects, in a
//! temporary folder (`$TMPDIR`). The other files are validated only.

use std::fs::File;
use std::path::Path;
use std::time::Instant;

use esvo_format::file::NO_PARENT;
use esvo_format::{FormatError, Octree, Region, StreamReader, WriteOptions, stats, validate_file};

type Failure = Box<dyn std::error::Error + Send + Sync>;

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let Some(path) = arguments.first() else {
        return Err("usage: format_bench FILE.esvo [MEGABYTES [FILE.esvo...]]".into());
    };
    let megabytes: u64 = arguments.get(1).map_or(Ok(1000), |text| text.parse())?;
    let octree = Octree::open(Path::new(path))?;
    let folder = tempfile::tempdir()?;
    println!("# The format, measured on one core\n");
    println!("`cargo run --release -p esvo-format --example format_bench -- {}`\n", arguments.join(" "));
    println!("{}.\n", processor());
    println!(
        "Everything is in the page cache. The machine is shared: best runs say what the code can do, medians what it did.\n"
    );
    // One thread, as the numbers are per core.
    rayon::ThreadPoolBuilder::new().num_threads(1).build()?.install(|| {
        compression(&octree)?;
        let large = folder.path().join("large.esvo");
        copies(&octree, megabytes * 1_000_000)?.write(&large)?;
        let mut files = vec![(path.as_str(), Path::new(path)), ("the large file", &large)];
        files.extend(arguments.iter().skip(2).map(|path| (path.as_str(), Path::new(path))));
        validation(&files)?;
        streaming(&large)
    })
}

/// The octree as the objects of one that is about so many bytes large.
fn copies(octree: &Octree, bytes: u64) -> Result<Octree, FormatError> {
    let one = octree.slots().len();
    let count = (bytes / 8 / one as u64).max(1);
    let mut image = Vec::with_capacity(one * count as usize);
    let (mut objects, mut blocks) = (Vec::new(), Vec::new());
    for _ in 0..count {
        let (start, first_block, first_object) = (image.len(), blocks.len() as u32, objects.len() as u32);
        image.extend_from_slice(octree.slots());
        for (block, parts) in octree.blocks().iter().zip(octree.parts()) {
            let mut block = *block;
            block.object += first_object;
            if block.parent != NO_PARENT {
                block.parent += first_block;
            }
            block.image_offset += start as u64 * 8;
            // The first field of the info section is the number of the block.
            image[start + (parts.start + parts.array_slots) as usize] += u64::from(first_block);
            blocks.push(block);
        }
        for object in octree.objects() {
            let mut object = *object;
            object.root_block += first_block;
            object.root_slot += start as u64;
            objects.push(object);
        }
    }
    Octree::from_parts(objects, blocks, image)
}

/// Seconds that a run takes, the best and the median of at least five runs and two seconds, and what the last returned.
fn time<T>(mut run: impl FnMut() -> Result<T, FormatError>) -> Result<(f64, f64, T), FormatError> {
    let started = Instant::now();
    let mut seconds = Vec::new();
    loop {
        let before = Instant::now();
        let result = run()?;
        seconds.push(before.elapsed().as_secs_f64());
        if seconds.len() >= 5 && started.elapsed().as_secs_f64() > 2.0 {
            seconds.sort_unstable_by(f64::total_cmp);
            return Ok((seconds[0], seconds[seconds.len() / 2], result));
        }
    }
}

/// What the system calls the processor, if it tells.
fn processor() -> String {
    let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = text.lines().find(|line| line.starts_with("model name")).and_then(|line| line.split(": ").nth(1));
    name.unwrap_or("A processor without a name").into()
}

fn megabytes(bytes: u64) -> f64 {
    bytes as f64 / 1e6
}

fn compression(octree: &Octree) -> Result<(), Failure> {
    let image = octree.slots().len() as u64 * 8;
    let counted = stats(octree);
    println!("## Compression\n");
    println!("{} levels, {} voxels, {} blocks.\n", counted.levels, counted.voxels, counted.blocks);
    if !octree.meta().is_empty() {
        println!("Metadata: `{}`\n", octree.meta());
    }
    println!("| stored | MB | bytes per voxel | of raw | writing MB/s | reading MB/s |");
    println!("|---|---|---|---|---|---|");
    for (name, compress) in [("raw", None), ("zstd 1", Some(1)), ("zstd 3", Some(3)), ("zstd 9", Some(9))] {
        let (writing, _, file) = time(|| {
            let mut file = Vec::new();
            let written = octree.write_to_with(&mut file, &WriteOptions { compress });
            written.map(|()| file).map_err(|source| FormatError::Io { path: "memory".into(), source })
        })?;
        let reader = StreamReader::open(&file)?;
        // As a program does that loads blocks: fetched from memory, checked, decompressed.
        let (reading, _, ()) =
            time(|| (0..reader.blocks().len() as u32).try_for_each(|i| reader.read_block(i).map(drop)))?;
        println!(
            "| {name} | {:.1} | {:.2} | {:.0} % | {:.0} | {:.0} |",
            megabytes(file.len() as u64),
            file.len() as f64 / counted.voxels as f64,
            file.len() as f64 * 100.0 / image as f64,
            megabytes(image) / writing,
            megabytes(image) / reading,
        );
    }
    println!("\nMB/s of what is in memory, best runs. Writing is into memory; reading is with checksums.\n");
    Ok(())
}

fn validation(files: &[(&str, &Path)]) -> Result<(), Failure> {
    println!("## Validation\n\n| | MB | seconds, best | median | MB/s, best | median |\n|---|---|---|---|---|---|");
    for (name, path) in files {
        let (best, median, report) = time(|| validate_file(path))?;
        if !report.findings.is_empty() {
            return Err(report.to_string().into());
        }
        let size = megabytes(std::fs::metadata(path)?.len());
        let (fast, usual) = (size / best, size / median);
        println!("| {name} | {size:.1} | {best:.3} | {median:.3} | {fast:.0} | {usual:.0} |");
    }
    println!();
    Ok(())
}

fn streaming(path: &Path) -> Result<(), Failure> {
    println!("## A large file\n");
    println!("{:.0} MB.\n", megabytes(std::fs::metadata(path)?.len()));
    println!("| | milliseconds, best | bytes read | reads |\n|---|---|---|---|");
    let row = |name: &str, seconds: f64, bytes: u64, reads: u64| {
        println!("| {name} | {:.3} | {bytes} | {reads} |", seconds * 1e3);
    };
    let open = || {
        let file = File::open(path).map_err(|source| FormatError::Io { path: path.to_owned(), source })?;
        StreamReader::open(file)
    };
    let (seconds, _, reader) = time(open)?;
    row("open: header, directory, tables", seconds, reader.bytes_read(), reader.reads());
    let (opened, asked) = (reader.bytes_read(), reader.reads());
    let middle = reader.blocks().len() as u32 / 2;
    let before = (reader.bytes_read(), reader.reads());
    reader.read_block(middle)?;
    let one = (reader.bytes_read() - before.0, reader.reads() - before.1);
    let (seconds, _, _) = time(|| reader.read_block(middle))?;
    row("read one block, check it", seconds, one.0, one.1);
    let (seconds, _, _) = time(|| open()?.read_block(middle))?;
    row("both", seconds, opened + one.0, asked + one.1);
    let object = reader.objects().len() / 2;
    let (seconds, _, part) = time(|| reader.partial(&reader.blocks_for(object, &Region::ALL, 3)))?;
    let bytes = part.slots().len() as u64 * 8;
    row("an object down to level 3, ready to cast", seconds, bytes, part.blocks().len() as u64);
    let (seconds, _, octree) = time(|| Octree::open(path))?;
    // A mapped file is read by pages: those of the tables and of each block's first and info section.
    let pages = octree.blocks().len() as u64 * 2;
    println!("| open by mapping | {:.3} | about {} pages touched | |", seconds * 1e3, pages + 2);
    println!();
    Ok(())
}
