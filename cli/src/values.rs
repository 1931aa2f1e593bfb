//! Parsers of option values.

use std::path::PathBuf;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use esvo_bench::paper_bench::Slowed;
use esvo_core::lights::{Light, unit};
use esvo_core::{BEAM_BLOCK, WIDE_BEAM_BLOCK};
use esvo_engines::EngineId;
use glam::DVec3;

/// Reads the name of an engine. Help lists every engine and says which are not built in.
pub(crate) fn engine() -> impl TypedValueParser<Value = EngineId> {
    let value = |id: &EngineId| {
        let engine = id.engine();
        let absent = if engine.is_built_in() { "" } else { " (not built into this program)" };
        PossibleValue::new(engine.name).help(format!("{}{absent}", engine.description))
    };
    PossibleValuesParser::new(EngineId::ALL.iter().map(value)).try_map(|name| name.parse::<EngineId>())
}

/// Gigabytes (10^9 bytes), a number above 0.
pub(crate) fn parse_gigabytes(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().map_err(|e| e.to_string())?;
    if number > 0.0 && number.is_finite() { Ok(number) } else { Err("expected a number above 0".into()) }
}

/// A finite number above 0.
pub(crate) fn parse_positive(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|number| *number > 0.0 && number.is_finite());
    number.ok_or_else(|| "expected a number above 0".into())
}

/// An engine and by how many percent it is slowed: `cpu=10`.
pub(crate) fn parse_slowed(text: &str) -> Result<Slowed, String> {
    let (engine, percent) = text.split_once('=').ok_or("expected ENGINE=PERCENT, e.g. cpu=10")?;
    let engine = engine.parse::<EngineId>().map_err(|e| e.to_string())?;
    Ok(Slowed { engine, percent: parse_positive(percent)? })
}

/// A number of pixels above 0, with or without its unit: `0.5px`.
pub(crate) fn parse_pixels(text: &str) -> Result<f64, String> {
    parse_positive(text.trim_end_matches("px").trim_end())
}

/// Bytes, at least 1: `1500000`, `1500K`, `1.5M` with powers of ten.
pub(crate) fn parse_bytes(text: &str) -> Result<u64, String> {
    let units = [('K', 1e3), ('M', 1e6), ('G', 1e9), ('T', 1e12)];
    let (number, factor) = (units.iter())
        .find_map(|(unit, factor)| Some((text.strip_suffix([*unit, unit.to_ascii_lowercase()])?, *factor)))
        .unwrap_or((text, 1.0));
    let bytes = parse_positive(number).ok().map(|number| number * factor).filter(|bytes| (1.0..1e18).contains(bytes));
    bytes.map(|bytes| bytes as u64).ok_or_else(|| "expected a number of bytes, e.g. 200M".into())
}

/// Width and height in pixels, each 1 to 16384: `1024x768`.
pub(crate) fn parse_size(text: &str) -> Result<[u32; 2], String> {
    let number = |s: &str| s.trim().parse::<u32>().ok().filter(|n| (1..=16384).contains(n));
    match text.split_once(['x', 'X']).map(|(w, h)| (number(w), number(h))) {
        Some((Some(w), Some(h))) => Ok([w, h]),
        _ => Err("expected width x height in pixels, 1x1 to 16384x16384, e.g. 1024x768".into()),
    }
}

/// A number of things, 1 to 10^12: `500000`, `500k`, `10M`.
pub(crate) fn parse_count(text: &str) -> Result<u64, String> {
    let (digits, unit) = match text.strip_suffix(['k', 'M', 'G']) {
        Some(digits) if text.ends_with('k') => (digits, 1000),
        Some(digits) if text.ends_with('M') => (digits, 1_000_000),
        Some(digits) => (digits, 1_000_000_000),
        None => (text, 1),
    };
    let count = digits.parse::<u64>().ok().and_then(|count| count.checked_mul(unit));
    count
        .filter(|count| (1..=1_000_000_000_000).contains(count))
        .ok_or_else(|| "expected a number from 1 to 10^12, e.g. 500000, 500k or 10M".into())
}

/// Finite numbers separated by commas; `None` for anything else.
pub(crate) fn parse_numbers(text: &str) -> Option<Vec<f64>> {
    text.split(',').map(|s| s.trim().parse::<f64>().ok().filter(|x| x.is_finite())).collect()
}

/// Edge of a block of the beam optimization.
pub(crate) fn parse_beam_block(text: &str) -> Result<u32, String> {
    match text.parse() {
        Ok(block @ (BEAM_BLOCK | WIDE_BEAM_BLOCK)) => Ok(block),
        _ => Err(format!("expected {BEAM_BLOCK} or {WIDE_BEAM_BLOCK}")),
    }
}

/// A light of `--light`.
pub(crate) fn parse_light(text: &str) -> Result<Light, String> {
    let expected = "expected sun:X,Y,Z or point:X,Y,Z or spot:X,Y,Z,DX,DY,DZ,DEGREES or sky";
    if text == "sky" {
        return Ok(Light::Sky);
    }
    let (kind, numbers) = text.split_once(':').ok_or(expected)?;
    let numbers = parse_numbers(numbers).ok_or(expected)?;
    let direction =
        |x: f64, y: f64, z: f64| unit(DVec3::new(x, y, z)).ok_or("0,0,0 is no direction; give one, e.g. 0,1,0");
    match (kind, &numbers[..]) {
        ("sun", &[x, y, z]) => Ok(Light::Directional { to_light: direction(x, y, z)? }),
        ("point", &[x, y, z]) => Ok(Light::Point { position: DVec3::new(x, y, z) }),
        ("spot", &[x, y, z, dx, dy, dz, angle_degrees]) if angle_degrees > 0.0 && angle_degrees <= 360.0 => {
            Ok(Light::Spot { position: DVec3::new(x, y, z), direction: direction(dx, dy, dz)?, angle_degrees })
        }
        ("spot", &[_, _, _, _, _, _, degrees]) => Err(format!("an angle of {degrees} degrees is not in 0 to 360")),
        _ => Err(expected.into()),
    }
}

/// The background of `--sky`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum SkyValue {
    /// From the top of the picture to its bottom.
    Screen,
    /// By direction.
    Dome,
    /// One colour.
    Plain([u8; 3]),
}

/// A background: `screen`, `dome`, or a colour in six hexadecimal digits.
pub(crate) fn parse_sky(text: &str) -> Result<SkyValue, String> {
    match text {
        "screen" => Ok(SkyValue::Screen),
        "dome" => Ok(SkyValue::Dome),
        _ => {
            let digits = text.strip_prefix('#').unwrap_or(text);
            let is_color = digits.len() == 6 && digits.bytes().all(|digit| digit.is_ascii_hexdigit());
            let number = u32::from_str_radix(digits, 16).ok().filter(|_| is_color);
            let [_, r, g, b] = number.ok_or("expected screen, dome or a colour, e.g. 87ceeb")?.to_be_bytes();
            Ok(SkyValue::Plain([r, g, b]))
        }
    }
}

/// The displacement of a height of 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Amplitude {
    /// 1/500 of the mesh's largest extent.
    Auto,
    /// In mesh units.
    Units(f64),
}

/// A number of mesh units, or `auto`.
pub(crate) fn parse_amplitude(text: &str) -> Result<Amplitude, String> {
    if text == "auto" {
        return Ok(Amplitude::Auto);
    }
    let number = text.parse::<f64>().ok().filter(|x| x.is_finite());
    number.map(Amplitude::Units).ok_or_else(|| "expected a number of mesh units, e.g. 0.05".into())
}

/// A material and its height map: `stone=stone-height.png`.
pub(crate) fn parse_height_map(text: &str) -> Result<(String, PathBuf), String> {
    match text.split_once('=') {
        Some((material, file)) if !file.is_empty() => Ok((material.to_owned(), file.into())),
        _ => Err("expected MATERIAL=FILE, e.g. stone=stone-height.png".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes() {
        assert_eq!(parse_size("512x384"), Ok([512, 384]));
        for bad in ["", "512", "0x3", "3x0", "x", "1x99999", "-1x2", "1x2x3"] {
            assert!(parse_size(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn amounts() {
        assert_eq!((parse_pixels("0.5px"), parse_pixels("2"), parse_pixels("2 px")), (Ok(0.5), Ok(2.0), Ok(2.0)));
        assert_eq!((parse_bytes("200M"), parse_bytes("1.5k"), parse_bytes("7")), (Ok(200_000_000), Ok(1500), Ok(7)));
        for bad in ["", "0", "-1", "px", "NaN", "inf"] {
            assert!(parse_pixels(bad).is_err(), "{bad}");
        }
        for bad in ["", "0", "M", "0.1", "-1G", "1e30", "5B"] {
            assert!(parse_bytes(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn lights() {
        for sun in ["sun:0,2,0", "sun:0,1e300,0", "sun:0,1e-320,0"] {
            assert_eq!(parse_light(sun), Ok(Light::Directional { to_light: DVec3::Y }));
        }
        assert_eq!(parse_light("sun:0,2,0"), Ok(Light::Directional { to_light: DVec3::Y }));
        assert_eq!(parse_light("sky"), Ok(Light::Sky));
        assert_eq!(parse_light("point:1,2,3"), Ok(Light::Point { position: DVec3::new(1.0, 2.0, 3.0) }));
        let spot = Light::Spot { position: DVec3::ZERO, direction: DVec3::NEG_Y, angle_degrees: 30.0 };
        assert_eq!(parse_light("spot:0,0,0,0,-4,0,30"), Ok(spot));
        for bad in [
            "",
            "sun",
            "sun:1,2",
            "sun:0,0,0",
            "moon:1,2,3",
            "sky:1,2,3",
            "point:1,2,x",
            "spot:0,0,0,0,1,0,0",
            "spot:0,0,0,0,1,0,361",
        ] {
            assert!(parse_light(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn skies() {
        assert_eq!((parse_sky("screen"), parse_sky("dome")), (Ok(SkyValue::Screen), Ok(SkyValue::Dome)));
        assert_eq!(parse_sky("#0a80FF"), Ok(SkyValue::Plain([10, 128, 255])));
        assert_eq!(parse_sky("0a80ff"), parse_sky("#0a80FF"));
        for bad in ["", "blue", "#fff", "+12345", "1234567", "ééé"] {
            assert!(parse_sky(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn options_are_read() {
        assert_eq!(parse_amplitude("-0.5"), Ok(Amplitude::Units(-0.5)));
        assert_eq!(parse_amplitude("auto"), Ok(Amplitude::Auto));
        assert!(parse_amplitude("inf").is_err() && parse_amplitude("").is_err());
        assert_eq!(parse_height_map("a b=c=d.png"), Ok(("a b".into(), "c=d.png".into())));
        assert!(parse_height_map("stone.png").is_err() && parse_height_map("a=").is_err());
    }
}
