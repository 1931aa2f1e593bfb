//! Scene lists: octrees, and where they stand.

use std::path::{Path, PathBuf};

use glam::{DMat3, DMat4, DQuat, DVec3, DVec4};
use serde::Deserialize;
use toml::Spanned;

/// The version of scene lists that this crate reads.
pub const LIST_VERSION: u32 = 1;

/// A list of placed octrees, in the order of the file. There is one at least.
#[derive(Clone, PartialEq, Debug)]
pub struct SceneList {
    /// The places.
    pub places: Vec<Place>,
}

/// An octree, or one object of it, at a place. The same file may be placed any number of times.
#[derive(Clone, PartialEq, Debug)]
pub struct Place {
    /// The octree's file; a relative path was joined to the folder of the list.
    pub file: PathBuf,
    /// The object of the file, counted from 0; `None`: all of them.
    pub object: Option<usize>,
    /// A name for what is there.
    pub name: Option<String>,
    /// From the space of the octree's mesh to that of the scene: affine, with an inverse.
    pub mesh_to_scene: DMat4,
    /// Number in the list, counted from 1.
    pub number: usize,
    /// Line of the list at which it begins, counted from 1.
    pub line: usize,
}

/// Why a scene list could not be used.
#[derive(Debug, thiserror::Error)]
pub enum ListError {
    /// The file could not be read.
    #[error("cannot read the scene list {}: {source}", path.display())]
    Read {
        /// The list.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// Not TOML, or a key is unknown, missing, or of the wrong type. The source names line and column.
    #[error("scene list {}: {source}", path.display())]
    Parse {
        /// The list.
        path: PathBuf,
        /// What the parser said.
        source: Box<toml::de::Error>,
    },
    /// A value is out of range or contradicts another.
    #[error("scene list {}: {what}", path.display())]
    Invalid {
        /// The list.
        path: PathBuf,
        /// The place and what is wrong with it.
        what: String,
    },
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawList {
    version: u32,
    #[serde(default, rename = "place")]
    places: Vec<Spanned<RawPlace>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawPlace {
    file: String,
    object: Option<usize>,
    name: Option<String>,
    translation: Option<[f64; 3]>,
    rotation: Option<Rotation>,
    quaternion: Option<[f64; 4]>,
    scale: Option<Scale>,
    matrix: Option<[[f64; 4]; 4]>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Rotation {
    axis: [f64; 3],
    degrees: f64,
}

#[derive(Deserialize)]
#[serde(untagged, expecting = "expected a number, or three numbers")]
enum Scale {
    Uniform(f64),
    PerAxis([f64; 3]),
}

impl SceneList {
    /// Reads and checks a list. Paths are relative to the folder that it is in.
    ///
    /// # Errors
    /// A file that cannot be read or is no list; the text says where and what is wrong.
    pub fn load(path: &Path) -> Result<Self, ListError> {
        let text = std::fs::read_to_string(path).map_err(|source| ListError::Read { path: path.to_owned(), source })?;
        Self::parse(&text, path)
    }

    /// The same from text. `path` is where it would be.
    ///
    /// # Errors
    /// As [`load`](Self::load).
    pub fn parse(text: &str, path: &Path) -> Result<Self, ListError> {
        let invalid = |what: String| ListError::Invalid { path: path.to_owned(), what };
        let list: RawList = toml::from_str(text)
            .map_err(|source| ListError::Parse { path: path.to_owned(), source: Box::new(source) })?;
        if list.version != LIST_VERSION {
            return Err(invalid(format!(
                "`version` is {}, this program reads version {LIST_VERSION}: use the esvo release that the list was made for",
                list.version
            )));
        }
        if list.places.is_empty() {
            return Err(invalid("it places nothing; give one `[[place]]` at least".into()));
        }
        let folder = path.parent().unwrap_or(Path::new(""));
        let place = |(number, raw): (usize, &Spanned<RawPlace>)| {
            let line = 1 + text.as_bytes()[..raw.span().start.min(text.len())].iter().filter(|b| **b == b'\n').count();
            let raw = raw.get_ref();
            let of_place = |what: String| invalid(format!("place {number} (line {line}): {what}"));
            if raw.file.is_empty() {
                return Err(of_place("`file` is empty".into()));
            }
            let object = match raw.object {
                Some(0) => return Err(of_place("`object` is 0; objects are counted from 1".into())),
                object => object.map(|object| object - 1),
            };
            let mesh_to_scene = raw.transform().map_err(of_place)?;
            let name = raw.name.clone();
            Ok(Place { file: folder.join(&raw.file), object, name, mesh_to_scene, number, line })
        };
        Ok(Self { places: (1..).zip(&list.places).map(place).collect::<Result<_, _>>()? })
    }
}

impl RawPlace {
    /// Scaled, then turned, then moved; or the matrix.
    fn transform(&self) -> Result<DMat4, String> {
        let finite = |key: &str, numbers: &[f64]| match numbers.iter().find(|x| !x.is_finite()) {
            Some(bad) => Err(format!("`{key}` has {bad}; every number must be finite")),
            None => Ok(()),
        };
        if let Some(rows) = self.matrix {
            if self.translation.is_some()
                || self.rotation.is_some()
                || self.quaternion.is_some()
                || self.scale.is_some()
            {
                return Err(
                    "`matrix` stands alone; leave out `translation`, `rotation`, `quaternion` and `scale`".into()
                );
            }
            finite("matrix", rows.as_flattened())?;
            if rows[3] != [0.0, 0.0, 0.0, 1.0] {
                return Err(format!("the last row of `matrix` is {:?}; it must be 0, 0, 0, 1", rows[3]));
            }
            let [x, y, z, w] = rows.map(DVec4::from);
            let matrix = DMat4::from_cols(x, y, z, w).transpose();
            let determinant = DMat3::from_mat4(matrix).determinant();
            if !determinant.is_normal() {
                return Err(format!("the determinant of `matrix` is {determinant}; it must have an inverse"));
            }
            return Ok(matrix);
        }
        let translation = self.translation.unwrap_or_default();
        finite("translation", &translation)?;
        let scale = match self.scale {
            None => [1.0; 3],
            Some(Scale::Uniform(scale)) => [scale; 3],
            Some(Scale::PerAxis(scale)) => scale,
        };
        finite("scale", &scale)?;
        if !scale.iter().product::<f64>().is_normal() {
            return Err(format!("`scale` is {scale:?}; no axis may be 0, and their product must be a normal number"));
        }
        let turn = match (&self.rotation, self.quaternion) {
            (Some(_), Some(_)) => return Err("`rotation` and `quaternion` say the same; give only one of them".into()),
            (None, None) => DQuat::IDENTITY,
            (Some(Rotation { axis, degrees }), None) => {
                finite("rotation", &[axis[0], axis[1], axis[2], *degrees])?;
                let unit = DVec3::from(*axis).try_normalize();
                let unit = unit.ok_or_else(|| format!("`rotation.axis` is {axis:?}; it must have a length above 0"))?;
                DQuat::from_axis_angle(unit, degrees.to_radians())
            }
            (None, Some(numbers)) => {
                finite("quaternion", &numbers)?;
                let length = DVec4::from(numbers).try_normalize();
                let unit =
                    length.ok_or_else(|| format!("`quaternion` is {numbers:?}; it must have a length above 0"))?;
                DQuat::from_vec4(unit)
            }
        };
        Ok(DMat4::from_scale_rotation_translation(scale.into(), turn, translation.into()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<SceneList, ListError> {
        SceneList::parse(text, Path::new("lists/scene.toml"))
    }

    #[test]
    fn places_are_what_they_say() {
        let list = parse(
            "version = 1\n\n[[place]]\nfile = \"a.esvo\"\n\n[[place]]\nfile = \"../b.esvo\"\nobject = 2\n\
             translation = [1, 2.5, 3]\nrotation = { axis = [0, 2, 0], degrees = 90 }\nscale = 2\n\n\
             [[place]]\nfile = \"/c.esvo\"\nname = \"C\"\nquaternion = [0, 0, 3, 0]\nscale = [1, -2, 3]\n\n\
             [[place]]\nfile = \"a.esvo\"\nmatrix = [[0, 2, 0, 7], [1, 0, 0, 8], [0, 0, 1, 9], [0, 0, 0, 1]]\n",
        )
        .unwrap();
        let files: Vec<_> = list.places.iter().map(|place| place.file.to_str().unwrap()).collect();
        assert_eq!(files, ["lists/a.esvo", "lists/../b.esvo", "/c.esvo", "lists/a.esvo"]);
        let lines: Vec<_> = list.places.iter().map(|place| (place.number, place.line, place.object)).collect();
        assert_eq!(lines, [(1, 3, None), (2, 6, Some(1)), (3, 13, None), (4, 19, None)]);
        assert_eq!((&list.places[1].name, list.places[2].name.as_deref()), (&None, Some("C")));
        let at = |number: usize, point: [f64; 3]| list.places[number].mesh_to_scene.transform_point3(point.into());
        assert_eq!(at(0, [1.0, 2.0, 3.0]), DVec3::new(1.0, 2.0, 3.0));
        // Twice as large, x to -z, then moved.
        assert!(at(1, [1.0, 1.0, 0.0]).distance(DVec3::new(1.0, 4.5, 1.0)) < 1e-12);
        // Half a turn around z.
        assert!(at(2, [1.0, 1.0, 1.0]).distance(DVec3::new(-1.0, 2.0, 3.0)) < 1e-12);
        assert_eq!(at(3, [1.0, 2.0, 3.0]), DVec3::new(11.0, 9.0, 12.0));
    }

    #[test]
    fn what_is_wrong_is_said_with_its_line() {
        let place = |what: &str| format!("version = 1\n[[place]]\nfile = \"a\"\n\n[[place]]\nfile = \"b\"\n{what}\n");
        for (text, says) in [
            ("version = 2\n".into(), "`version` is 2"),
            ("version = 1\n".into(), "places nothing"),
            ("version = 1\nplaces = 3\n".into(), "unknown field `places`"),
            ("version = 1\n[[place]]\n".into(), "missing field `file`"),
            ("version = 1\n[[place]]\nfile = \"\"\n".into(), "place 1 (line 2): `file` is empty"),
            (place("object = 0"), "place 2 (line 5): `object` is 0"),
            (place("object = -1"), "line 7"),
            (place("color = 1"), "unknown field `color`"),
            (place("translation = [0, nan, 0]"), "place 2 (line 5): `translation` has NaN"),
            (place("translation = [0, 0]"), "line 7"),
            (place("scale = 0"), "`scale` is [0.0, 0.0, 0.0]"),
            (place("scale = [1, 1e-320, 1]"), "`scale` is"),
            (place("scale = inf"), "`scale` has inf"),
            (place("scale = \"2\""), "expected a number, or three numbers"),
            (place("rotation = { axis = [0, 0, 0], degrees = 3 }"), "`rotation.axis` is"),
            (place("rotation = { axis = [0, 1, 0] }"), "missing field `degrees`"),
            (place("quaternion = [0, 0, 0, 0]"), "`quaternion` is"),
            (place("quaternion = [0, 0, 0, 1]\nrotation = { axis = [0, 1, 0], degrees = 3 }"), "only one of them"),
            (place("matrix = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]"), "line 7"),
            (place("matrix = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 1, 1]]"), "the last row"),
            (
                place("matrix = [[1, 0, 0, 0], [2, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]"),
                "determinant of `matrix` is 0",
            ),
            (place("matrix = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\nscale = 2"), "stands alone"),
        ] {
            let error = parse(&text).unwrap_err().to_string();
            assert!(error.contains("lists/scene.toml") && error.contains(says), "{text}: {error}");
        }
    }
}
