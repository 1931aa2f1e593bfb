//! The registered members of the metadata (spec 2.3, rules M002 to M004). None of them makes a file unreadable.

use serde_json::{Map, Value};

use crate::check::metadata::Parsed;
use crate::ids;
use crate::metadata::{COUNTS, FREE, Handedness, STRINGS, UpAxis, bounds_of, whole};

/// The rules that the members break, with the offsets of their names and what is wrong. `counts`: objects and instances of the file.
pub(crate) fn check(parsed: &Parsed<'_>, counts: (usize, usize)) -> Vec<(&'static str, usize, String)> {
    // What keeps M001 is JSON.
    let members: Map<String, Value> = serde_json::from_str(parsed.text).unwrap_or_default();
    let place = |name: &str| parsed.names.iter().find(|(_, found)| found == name).map_or(0, |(at, _)| *at);
    let mut faults = Vec::new();
    for (name, value) in &members {
        let fault = match &name[..] {
            name if STRINGS.contains(&name) && !value.is_string() => {
                Some((ids::META_MEMBERS, format!("the value of {name:?} is not a string")))
            }
            "objects" => entries(value, counts.0, "object", object).map(|what| (ids::META_ENTRIES, what)),
            "instances" => entries(value, counts.1, "instance", named).map(|what| (ids::META_ENTRIES, what)),
            _ => other(name, value)
                .map(|expected| (ids::META_VALUES, format!("{name:?} is {value}, expected {expected}"))),
        };
        faults.extend(fault.map(|(rule, what)| (rule, place(name), shortened(what))));
    }
    faults.sort_unstable_by_key(|(_, at, _)| *at);
    faults
}

/// What a registered member that is neither a string nor a list should be, if it is not that.
fn other(name: &str, value: &Value) -> Option<&'static str> {
    let (keeps, expected) = match name {
        "unit" => (value.as_f64().is_some_and(|unit| unit > 0.0), "a number above 0: metres"),
        "up" => (UpAxis::of(value).is_some(), "\"+x\", \"-x\", \"+y\", \"-y\", \"+z\" or \"-z\""),
        "handedness" => (Handedness::of(value).is_some(), "\"right\" or \"left\""),
        name if COUNTS.contains(&name) => (whole(value).is_some(), "a whole number, not negative, below 2^53"),
        name if FREE.contains(&name) => (value.is_object(), "an object"),
        _ => (true, ""),
    };
    (!keeps).then_some(expected)
}

/// What is wrong with a list that has an entry for each of so many things, by index.
fn entries(
    value: &Value,
    count: usize,
    what: &str,
    check: fn(&Map<String, Value>) -> Option<&'static str>,
) -> Option<String> {
    let Some(list) = value.as_array() else { return Some(format!("\"{what}s\" is not an array")) };
    if list.len() > count {
        return Some(format!("\"{what}s\" has {} entries, the file has {count}", list.len()));
    }
    list.iter().enumerate().find_map(|(index, entry)| {
        let fault = entry.as_object().map_or(Some("it is not an object"), check)?;
        Some(format!("entry {index} of \"{what}s\": {fault}"))
    })
}

fn object(members: &Map<String, Value>) -> Option<&'static str> {
    match members.get("bounds") {
        Some(bounds) if bounds_of(bounds).is_none() => {
            Some("\"bounds\" are not three numbers \"low\" and three numbers \"high\", none below that of \"low\"")
        }
        _ => named(members),
    }
}

fn named(members: &Map<String, Value>) -> Option<&'static str> {
    match (members.get("name"), members.get("metadata")) {
        (Some(name), _) if !name.is_string() => Some("\"name\" is not a string"),
        (_, Some(metadata)) if !metadata.is_object() => Some("\"metadata\" is not an object"),
        _ => None,
    }
}

/// A text of at most 200 characters: values come from strangers.
fn shortened(text: String) -> String {
    match text.char_indices().nth(200) {
        Some((at, _)) => format!("{}…", &text[..at]),
        None => text,
    }
}
