//! The vectors of closed sets of parts: what the reader in Python makes of them, this library must make, too.

use std::fs;

use esvo_format::{FormatError, IndexReader, Octree, Region, StreamReader, validate};
use serde_json::Value;

use crate::common::bytes_of;
use crate::{folder, reads_compressed};

fn lines() -> Vec<Value> {
    let text = fs::read(folder("streaming_parts").join("index.json")).unwrap();
    serde_json::from_slice(&text).unwrap()
}

fn file(line: &Value) -> Vec<u8> {
    fs::read(folder("").join(line["file"].as_str().unwrap())).unwrap()
}

fn expected(line: &Value) -> Vec<u8> {
    fs::read(folder("streaming_parts").join(line["part"].as_str().unwrap())).unwrap()
}

/// Object, box and level, where the line has them.
fn region(line: &Value) -> Option<(usize, Region, u32)> {
    let level = line.get("level")?.as_u64().unwrap() as u32;
    let corner = |name: &str| serde_json::from_value::<[f64; 3]>(line[name].clone()).unwrap().into();
    Some((line["object"].as_u64().unwrap() as usize, Region { low: corner("low"), high: corner("high") }, level))
}

fn ranges(line: &Value, name: &str) -> Vec<(u64, u64)> {
    serde_json::from_value(line[name].clone()).unwrap()
}

/// The indices of the parts of a line.
fn parts(line: &Value, reader: &StreamReader<&Vec<u8>>) -> Vec<u32> {
    let names: Vec<(u32, u8)> = serde_json::from_value(line["parts"].clone()).unwrap();
    let of = |(block, level): &(u32, u8)| {
        let at = reader.parts().iter().position(|p| p.block == *block && p.first_level == *level);
        at.expect("the part") as u32
    };
    names.iter().map(of).collect()
}

/// Asserts that an octree is the one that the line names.
fn same(line: &Value, part: &Octree) {
    let name = line["part"].as_str().unwrap();
    assert!(validate(part).findings.is_empty(), "{name}: {}", validate(part));
    let expected = expected(line);
    let other = Octree::from_bytes(&expected).unwrap();
    assert_eq!(part.objects(), other.objects(), "{name}");
    assert_eq!(part.blocks().len(), other.blocks().len(), "{name}");
    assert!(part.slots() == other.slots(), "{name}: the image");
    assert!(bytes_of(part) == expected, "{name}: written");
}

#[test]
fn closed_sets_of_parts_are_what_the_second_reader_makes() {
    let lines = lines();
    assert!(lines.len() > 20);
    for line in lines.iter().filter(|_| reads_compressed()) {
        let bytes = file(line);
        let reader = StreamReader::open(&bytes).unwrap();
        let indices = parts(line, &reader);
        if let Some((object, region, level)) = region(line) {
            assert_eq!(reader.parts_for(object, &region, level), indices, "{line}");
        }
        same(line, &reader.partial_parts(&indices).unwrap());
    }
}

#[test]
fn the_index_leads_to_the_parts_that_the_second_reader_finds() {
    for line in lines().iter().filter(|_| reads_compressed()) {
        let Some((object, region, level)) = region(line) else { continue };
        let mut bytes = file(line);
        let tables = StreamReader::open(&bytes).unwrap();
        // The index alone is for blocks in streams of fields.
        if parts(line, &tables).iter().any(|part| codec(&tables, *part) != 2) {
            continue;
        }
        let head = u32::from_le_bytes(bytes[56..60].try_into().unwrap()) as u64;
        let mut kept = ranges(line, "ranges");
        kept.extend(ranges(line, "pages"));
        kept.push((0, head));
        // Nothing else in the file is looked at.
        for (at, byte) in bytes.iter_mut().enumerate() {
            let at = at as u64;
            if kept.iter().all(|(start, size)| at < *start || start + size <= at) {
                *byte = 0xa5;
            }
        }
        let mut reader = IndexReader::open(&bytes).unwrap();
        same(line, &reader.octree(object, &region, level).unwrap());
    }
}

#[test]
fn another_set_makes_another_octree() {
    let lines = lines();
    let line = lines.iter().find(|line| parts_of(line) > 2).filter(|_| reads_compressed());
    let Some(line) = line else { return };
    let bytes = file(line);
    let reader = StreamReader::open(&bytes).unwrap();
    let mut indices = parts(line, &reader);
    indices.pop();
    assert!(bytes_of(&reader.partial_parts(&indices).unwrap()) != expected(line));
    // Without the first part nothing is closed.
    let refused = reader.partial_parts(&indices[1..]).map(|part| part.slots().len());
    assert!(matches!(refused, Err(FormatError::Limit(_))), "{refused:?}");
}

fn codec(reader: &StreamReader<&Vec<u8>>, part: u32) -> u32 {
    reader.blocks()[reader.parts()[part as usize].block as usize].codec
}

fn parts_of(line: &Value) -> usize {
    line["parts"].as_array().unwrap().len()
}
