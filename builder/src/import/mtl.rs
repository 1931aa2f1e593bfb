//! Material libraries of OBJ files: the statements about colour, holes and surface detail.
//!
//! Not read by `tobj`, because `tobj` panics at a colour of fewer than three numbers, drops a whole library for one bad
//! line, and leaves the options of texture statements in the file name.

use super::error::one_line;
use super::map_statement::{MapStatement, map_statement};
use super::names::continued;
use super::numbers::finite;

/// One `newmtl` block.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct MtlMaterial {
    pub(super) name: String,
    /// `Kd` as written: sRGB-encoded, 0..=1.
    pub(super) diffuse: Option<[f64; 3]>,
    /// `d`: opacity.
    pub(super) dissolve: Option<f64>,
    /// `Tr`: one minus opacity.
    pub(super) transparency: Option<f64>,
    pub(super) diffuse_map: Option<MapStatement>,
    pub(super) opacity_map: Option<MapStatement>,
    /// `norm` or `map_Kn`: not part of the original format, but written by exporters.
    pub(super) normal_map: Option<MapStatement>,
    /// `bump` or `map_bump`.
    pub(super) bump_map: Option<MapStatement>,
    /// `disp` or `map_disp`.
    pub(super) displacement_map: Option<MapStatement>,
    /// `Ke`: emitted light, linear, 0 or more.
    pub(super) emission: Option<[f64; 3]>,
    /// `Pr`: roughness.
    pub(super) roughness: Option<f64>,
    /// `Pm`: metalness.
    pub(super) metalness: Option<f64>,
}

impl MtlMaterial {
    /// The opacity, 0..=1. `d` takes precedence over `Tr`, because the format defines it.
    pub(super) fn opacity(&self) -> f64 {
        self.dissolve.or(self.transparency.map(|tr| 1.0 - tr)).unwrap_or(1.0).clamp(0.0, 1.0)
    }

    /// Whether nothing of the material is to be seen: `d` is 0 and `Tr` does not say otherwise. `Tr 1` alone is not enough:
    /// many programs write it for opaque materials.
    pub(super) fn is_invisible(&self) -> bool {
        self.dissolve.is_some_and(|d| d <= 0.0) && self.transparency.is_none_or(|tr| tr > 0.0)
    }
}

/// Reads a library. Statements that cannot be read are skipped and returned as warnings. Keywords may be in any case.
pub(super) fn parse(text: &str) -> (Vec<MtlMaterial>, Vec<String>) {
    let mut materials: Vec<MtlMaterial> = Vec::new();
    let mut warnings = Vec::new();
    let mut lines = text.lines().enumerate();
    while let Some((number, first)) = lines.next() {
        let mut joined: String;
        let mut line = first.trim();
        let name = is_name(line);
        // Comments are not continued.
        if let Some(start) = continued(line, name).filter(|start| !start.is_empty() && !start.starts_with('#')) {
            joined = start.to_owned();
            for (_, next) in lines.by_ref() {
                let (next, goes_on) = continued(next.trim(), name).map_or((next.trim(), false), |part| (part, true));
                joined.extend([" ", next]);
                if !goes_on {
                    break;
                }
            }
            line = joined.trim();
        }
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let (key, value) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        let (key, value) = (key.to_ascii_lowercase(), value.trim());
        if key == "newmtl" {
            materials.push(MtlMaterial { name: value.into(), ..MtlMaterial::default() });
            continue;
        }
        let Some(material) = materials.last_mut() else { continue };
        // Sets `to`, and says whether there was a value.
        fn set<T>(to: &mut Option<T>, value: Option<T>) -> bool {
            let understood = value.is_some();
            *to = value.or(to.take());
            understood
        }
        let understood = match key.as_str() {
            "kd" => set(&mut material.diffuse, rgb(value)),
            // `d -halo f` makes the rim of a surface more opaque; the factor is still the opacity seen head on.
            "d" => set(&mut material.dissolve, number_in(value.trim_start_matches("-halo"))),
            "ke" => set(&mut material.emission, rgb(value)),
            "pr" => set(&mut material.roughness, number_in(value)),
            "pm" => set(&mut material.metalness, number_in(value)),
            "tr" => set(&mut material.transparency, number_in(value)),
            "map_kd" => set(&mut material.diffuse_map, map_statement(value)),
            "map_d" | "map_opacity" => set(&mut material.opacity_map, map_statement(value)),
            "norm" | "map_kn" => set(&mut material.normal_map, map_statement(value)),
            "bump" | "map_bump" => set(&mut material.bump_map, map_statement(value)),
            "disp" | "map_disp" => set(&mut material.displacement_map, map_statement(value)),
            _ => true,
        };
        if !understood {
            warnings.push(format!("line {}: cannot read '{}'; it is ignored", number + 1, one_line(line)));
        }
    }
    (materials, warnings)
}

/// Whether the value of a statement is a name, perhaps after options.
fn is_name(statement: &str) -> bool {
    let key = statement.split_whitespace().next().unwrap_or("").trim_end_matches('\\').to_ascii_lowercase();
    key == "newmtl" || key.starts_with("map_") || ["bump", "disp", "norm", "refl", "decal"].contains(&&*key)
}

fn number_in(value: &str) -> Option<f64> {
    finite(value.split_whitespace().next()?)
}

/// A colour. A single number stands for all three components. Spectral and CIE XYZ colours are not read.
fn rgb(value: &str) -> Option<[f64; 3]> {
    let words = value.split_whitespace().take_while(|word| !word.starts_with('#'));
    let numbers: Option<Vec<f64>> = words.take(3).map(finite).collect();
    match numbers?.as_slice() {
        [r, g, b] => Some([*r, *g, *b]),
        [grey] => Some([*grey; 3]),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statements_are_read_and_junk_is_reported() {
        let text = "Kd 1 0 0\nnewmtl a b\n\tKd 0.5\n Tr 0.25\nmap_Kd -s 1 1 1 -o 0.5 my tex.png\nKd spectral x.rfl\n\
                    newmtl glass\nKd 0.1 0.2 0.3 # comment\nd 0.1\nTr 0.9\nmap_d -clamp on mask.png\nNs junk\nnewmtl c\nd nan\n";
        let (materials, warnings) = parse(text);
        assert_eq!(materials.len(), 3);
        assert_eq!(materials[0].name, "a b");
        assert_eq!((materials[0].diffuse, materials[0].opacity()), (Some([0.5; 3]), 0.75));
        assert_eq!(materials[0].diffuse_map.as_ref().unwrap().file, "my tex.png");
        assert_eq!((materials[1].diffuse, materials[1].opacity()), (Some([0.1, 0.2, 0.3]), 0.1));
        assert_eq!(materials[1].opacity_map.as_ref().unwrap().file, "mask.png");
        assert_eq!(
            warnings,
            ["line 6: cannot read 'Kd spectral x.rfl'; it is ignored", "line 14: cannot read 'd nan'; it is ignored"]
        );
    }

    #[test]
    fn keywords_may_be_in_any_case_and_lines_may_continue() {
        let text = "NEWMTL a #1\nkd 1 \\\n 0 \\\n0\nMAP_KD a.png\nMap_D b.png\n# C:\\x\\\nD 0.5\nBump maps\\\nnewmtl b #2\nKd .5 5. \
                    1.#IND\nKD\n";
        let (materials, warnings) = parse(text);
        let names: Vec<&str> = materials.iter().map(|m| &*m.name).collect();
        assert_eq!(names, ["a #1", "b #2"]);
        let a = &materials[0];
        assert_eq!((a.diffuse, a.dissolve), (Some([1.0, 0.0, 0.0]), Some(0.5)));
        let file = |map: &Option<MapStatement>| map.as_ref().unwrap().file.clone();
        assert_eq!([file(&a.diffuse_map), file(&a.opacity_map), file(&a.bump_map)], ["a.png", "b.png", "maps\\"]);
        assert_eq!(
            warnings,
            ["line 11: cannot read 'Kd .5 5. 1.#IND'; it is ignored", "line 12: cannot read 'KD'; it is ignored"]
        );
    }

    #[test]
    fn the_end_of_the_text_ends_a_statement() {
        let material = |text: &str| parse(&format!("newmtl a\n{text}")).0.remove(0);
        for text in ["Kd 1 0 0 \\", "Kd 1 \\\n0 0\\\n", "Kd\\\n1 0 0 \\\n\n"] {
            assert_eq!(material(text).diffuse, Some([1.0, 0.0, 0.0]), "{text}");
        }
        assert_eq!(material("map_Kd a.png \\\n").diffuse_map.unwrap().file, "a.png");
    }

    #[test]
    fn joining_lines_takes_time_in_proportion_to_their_length() {
        // A statement of 2 MB in 100,000 lines.
        let text = format!("newmtl a\nkd 1 0 0 \\\n{}\n", "0.000000000000000 \\\n".repeat(100_000));
        let start = std::time::Instant::now();
        assert_eq!(parse(&text).0[0].diffuse, Some([1.0, 0.0, 0.0]));
        assert!(start.elapsed() < std::time::Duration::from_secs(5), "{:?}", start.elapsed());
    }

    #[test]
    fn only_a_d_of_zero_makes_invisible() {
        let material = |text: &str| parse(&format!("newmtl a\n{text}")).0.remove(0);
        for (text, invisible) in
            [("d 0", true), ("d 0\nTr 1", true), ("d 0\nTr 0", false), ("Tr 1", false), ("d 0.01", false), ("", false)]
        {
            assert_eq!(material(text).is_invisible(), invisible, "{text}");
        }
    }
}
